#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# exr_has_the_golden_pixels: the pixels of a rendered EXR and deep EXR, hashed by oiiotool, equal tests/data/golden.json.
# SPAREGS_UPDATE_GOLDEN=1 accepts new numbers.
set -euo pipefail
golden=$SPAREGS_SOURCE/tests/data/golden.json
room=$SPAREGS_SOURCE/tests/data/room
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
"$SPAREGS_PROGRAM" train "$room" -o "$temporary/run" --downscale 4 --iterations 150 --isa baseline --quiet >/dev/null
failures=0
compared=0
for isa in baseline avx2 avx512; do
    if ! "$SPAREGS_PROGRAM" render "$temporary/run" "$room" --downscale 4 --view 0001.jpg --isa "$isa" -o "$temporary/probe" \
        --quiet >/dev/null 2>"$temporary/stderr" && grep -q "kernels require" "$temporary/stderr"; then
        echo "$isa: not on this CPU"
        continue
    fi
    set_name="avx2 and avx512"
    [ "$isa" != baseline ] || set_name=baseline
    for kind in flat deep; do
        options=(--aov rgba,depth,depth_median,depth_first,transmittance,hits,normal,position,primitive,region,slack)
        [ "$kind" = flat ] || options=(--deep)
        rm -rf "$temporary/out"
        "$SPAREGS_PROGRAM" render "$temporary/run" "$room" --downscale 4 --view 0001.jpg --isa "$isa" "${options[@]}" -o "$temporary/out" --quiet >/dev/null
        file=$(find "$temporary/out" -name '*.exr' | { if [ "$kind" = deep ]; then grep deep; else grep -v deep; fi; })
        hash=$(oiiotool --hash "$file" 2>/dev/null | sed -n 's/.*SHA-1: *//p')
        [ -n "$hash" ] || { echo "FAIL: oiiotool printed no hash of $file"; exit 1; }
        if [ -n "${SPAREGS_UPDATE_GOLDEN:-}" ]; then
            jq -S --indent 1 --arg set "$set_name" --arg kind "$kind" --arg hash "$hash" '.exr[$set][$kind] = $hash' "$golden" >"$temporary/new"
            cp "$temporary/new" "$golden"
        elif [ "$(jq -r --arg set "$set_name" --arg kind "$kind" '.exr[$set][$kind]' "$golden")" != "$hash" ]; then
            echo "FAIL: $kind EXR with $isa: pixels hash to $hash, golden.json has another value"
            failures=$((failures + 1))
        fi
        compared=$((compared + 1))
    done
done
[ "$compared" -ge 2 ] || { echo "FAIL: only $compared files were compared"; exit 1; }
[ "$failures" -eq 0 ] && echo "$compared files have the golden pixels"
