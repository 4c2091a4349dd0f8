#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The same model for any number of threads, AVX2 and AVX-512, a copy of the scene under another name, and a Debug build.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
options=(--downscale 8 --spare bmd,rap --iterations 200 --quiet)

# same NAME PROGRAM ARGUMENT...: trains and compares the hash with the first one.
hash=
same() {
    local name=$1 hash_now
    last_command="$*"
    shift
    check trains "$@" "${options[@]}" -o "$temporary/$name"
    hash_now=$(jq -r .model_hash "$temporary/$name/summary.json")
    echo "$hash_now $name"
    check "same_model: $name" test "${hash:=$hash_now}" = "$hash_now"
}

for threads in 1 2 3 5; do
    same "threads_$threads" "$program" train "$room" --threads "$threads"
done
for isa in avx2 avx512; do
    if "$program" info "$room" --isa "$isa" >/dev/null 2>&1; then
        same "$isa" "$program" train "$room" --isa "$isa"
    fi
done
cp -r "$room" "$temporary/renamed scene"
same renamed "$program" train "$temporary/renamed scene"
cp -r "$room" "$temporary/split"
same relative env -C "$temporary" "$program" train ./split

cmake -S "$SPAREGS_SOURCE" -B "$SPAREGS_BUILD/debug" -DCMAKE_BUILD_TYPE=Debug -DSPAREGS_TESTS=OFF >"$temporary/log" 2>&1
cmake --build "$SPAREGS_BUILD/debug" -j "$(nproc)" --target sparegs-cli >>"$temporary/log" 2>&1
same debug "$SPAREGS_BUILD/debug/sparegs" train "$room"

finish
