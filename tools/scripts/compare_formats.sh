#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Compares the readers and writers of model formats with programs of others, in both directions: PlayCanvas's
# splat-transform, and tinyusdz for OpenUSD. Requires node, python3 and, the first time, the npm registry:
#     tools/scripts/compare_formats.sh [FILE...]
# Without files a model of the bundled scene is trained. Given files (of any format that both programs read) are also
# compared as they are. Each pair of PLY files must agree to the rounding of floats, unless the line says otherwise.
set -uo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
program=${SPAREGS_PROGRAM:-$root/build/sparegs}
npm=$root/build/npm
work=$root/build/compare_formats
mkdir -p "$npm" "$work"
for package in @playcanvas/splat-transform@2.7.1 tinyusdz@0.9.0-rc10; do
    [ -d "$npm/node_modules/${package%@*}" ] || (cd "$npm" && npm install --silent --no-audit --no-fund "$package") >/dev/null 2>&1 ||
        { echo "compare_formats: cannot install $package from npm" >&2; exit 77; }
done
transform=$npm/node_modules/.bin/splat-transform
failures=0

# compare NAME A B [OPTION...]
compare() {
    local name=$1 result status=0
    shift
    result=$(python3 "$root/tools/scripts/compare_models.py" "$@" 2>&1) || status=1
    failures=$((failures + status))
    printf '%-28s %s %s\n' "$name" "$([ $status = 0 ] && echo ok || echo FAIL)" "$result"
}
run() {
    "$@" >"$work/log" 2>&1 || { echo "FAIL: $*: $(tail -n 1 "$work/log")"; failures=$((failures + 1)); return 1; }
}

# Both programs read a file.
same_reading() { # NAME FILE [OPTION...]
    local name=$1 file=$2
    shift 2
    run "$program" convert "$file" "$work/ours.ply" --quiet && run "$transform" -w "$file" "$work/theirs.ply" &&
        compare "$name" "$work/ours.ply" "$work/theirs.ply" "$@"
}

model=$work/room.ply
if [ ! -e "$model" ]; then
    run "$program" train "$root/tests/data/room" -o "$work/room" --overwrite --iterations 300 --downscale 4 --quiet || exit 1
    run "$program" convert "$work/room" "$model" || exit 1
fi

# Files of sparegs. splat-transform decodes rotations of .splat as b/255 2 - 1 instead of (b - 128)/128, and 8-bit
# opacities of 0 and 1 without a limit.
loose=(--tolerance opacity=2e-5)
for name in a.compressed.ply a.spz a.sog; do
    run "$program" convert "$model" "$work/$name" && same_reading "ours: $name" "$work/$name" "${loose[@]}"
done
run "$program" convert "$model" "$work/4.spz" --spz-version 4 && same_reading "ours: spz, version 4" "$work/4.spz" "${loose[@]}"
run "$program" convert "$model" "$work/a.splat" && same_reading "ours: a.splat" "$work/a.splat" "${loose[@]}" --tolerance rotation=0.01
for level in 0 1 2; do
    run "$program" convert "$model" "$work/a.ksplat" --ksplat-level $level &&
        same_reading "ours: ksplat, level $level" "$work/a.ksplat" "${loose[@]}"
done
run "$program" convert "$model" "$work/sog/meta.json" && same_reading "ours: sog in files" "$work/sog/meta.json" "${loose[@]}"

# Files of splat-transform.
for name in b.ply b.compressed.ply b.spz; do
    run "$transform" -w "$model" "$work/$name" && same_reading "theirs: $name" "$work/$name" "${loose[@]}"
done
run "$transform" -g cpu -w "$model" "$work/b.sog" && same_reading "theirs: b.sog" "$work/b.sog" "${loose[@]}"
# It reads no GLB: the model must come back.
run "$transform" -w "$model" "$work/b.glb" && run "$program" convert "$work/b.glb" "$work/ours.ply" &&
    compare "theirs: b.glb" "$model" "$work/ours.ply"

# Transforms: the same rotation about the vertical axis in both conventions of axes, (x, y, z) -> (-x, -y, z).
run "$program" convert "$model" "$work/ours.ply" --rotate 0,0,30 --scale 2 &&
    run "$transform" -w "$model" -r 0,0,30 -s 2 "$work/theirs.ply" && compare "rotated and scaled" "$work/ours.ply" "$work/theirs.ply" \
    --tolerance sh=1e-5

# OpenUSD.
if run "$program" convert "$model" "$work/a.usda" "$root/tests/data/room" --downscale 4; then
    counts=$(node "$root/tools/scripts/usda_counts.mjs" "$npm/node_modules/tinyusdz" "$work/a.usda" 2>&1)
    expected="$("$program" info "$model" --json | sed -n 's/.*"gaussians": \([0-9]*\).*/\1/p') 35"
    if [ "$counts" = "$expected" ]; then
        printf '%-28s ok %s primitives and cameras\n' "ours: a.usda" "$counts"
    else
        printf '%-28s FAIL %s instead of %s\n' "ours: a.usda" "$counts" "$expected"
        failures=$((failures + 1))
    fi
fi

for file in "$@"; do
    case $file in
        *.splat) same_reading "$(basename "$file")" "$file" "${loose[@]}" --tolerance rotation=0.01 ;;
        *) same_reading "$(basename "$file")" "$file" "${loose[@]}" ;;
    esac
done
echo "$failures failure(s)"
[ "$failures" = 0 ]
