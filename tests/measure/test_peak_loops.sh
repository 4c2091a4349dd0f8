#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# peak_loops_execute_what_they_count: each loop of multiply_add (limit_kernels.inl) has one multiplication per register of
# its chains, twelve, in the object of each instruction set.
set -euo pipefail
objects=$SPAREGS_BUILD/CMakeFiles/sparegs-objects.dir/src/measure
command -v objdump >/dev/null || { echo "skipped: objdump is not installed"; exit 77; }
[ "$(uname -m)" = x86_64 ] || { echo "skipped: only for x86-64"; exit 77; }
jq -e '[.[] | select(.file | endswith("/limit_kernels_baseline.c")) | .command] |
    all(test("-O[23]") and (test("-fsanitize") | not))' "$SPAREGS_BUILD/compile_commands.json" >/dev/null ||
    { echo "skipped: not an optimised build"; exit 77; }

# loops FILE INSTRUCTION: how many of these instructions are in each loop of multiply_add that has any.
loops() {
    objdump -d --no-show-raw-insn --disassemble=multiply_add "$1" | awk -v name="$2" '
        /^ *[0-9a-f]+:/ {
            sub(":", "", $1)
            place[++lines] = $1
            counts[lines] = $2 ~ name
            if ($2 ~ /^j/)
                for (i = 1; i < lines; ++i)
                    if (place[i] == $3) {
                        sum = 0
                        for (k = i; k < lines; ++k)
                            sum += counts[k]
                        if (sum)
                            print sum
                    }
        }'
}

checked=0
for set in baseline:^mulps avx2:^vfmadd avx512:^vfmadd; do
    object=$objects/limit_kernels_${set%%:*}.c.o
    [ -f "$object" ] || continue
    found=$(loops "$object" "${set#*:}")
    [ -n "$found" ] || { [ "${set%%:*}" != baseline ] && continue; echo "FAIL: $object: no loop in multiply_add"; exit 1; }
    # A compiler may unroll.
    while read -r count; do
        [ $((count % 12)) -eq 0 ] || { echo "FAIL: $object: a loop has $count multiplications, not 12"; exit 1; }
    done <<<"$found"
    checked=$((checked + 1))
done
[ "$checked" -gt 0 ] || { echo "FAIL: no object in $objects"; exit 1; }
echo "$checked objects"
