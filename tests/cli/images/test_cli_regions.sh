#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The layers `region` and `slack` of render: a pixel's region is the one that holds the centre of the primitive in
# `primitive`, and its slack is what `explain` prints for that region. Centres are read from the PLY by od.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
model=$temporary/model
run 0 train "$room" -o "$model" --downscale 8 --eval --iterations 100 --quiet
run 0 render "$model" "$room" --view 0009 --aov primitive,region,slack -o "$temporary/exr"
oiiotool --info -v "$temporary/exr/0009.exr" >"$temporary/info"
check layers_have_their_names grep -qF 'channel list: primitive.id (uint), region.id (uint), slack.S (float)' "$temporary/info"

# uint channels come from oiiotool as fractions of 2^32 - 1
oiiotool "$temporary/exr/0009.exr" --ch primitive.id,region.id,slack.S -d float --mulc 4294967295,4294967295,1 \
    -o "$temporary/float.exr"
oiiotool --dumpdata "$temporary/float.exr" | sed -n 's/.*Pixel (.*): //p' >"$temporary/pixels"
run 0 explain "$model" --top 100000 --json
jq -r '.regions[] | [.voxel, .slack, .center[]] | map(tostring) | join(" ")' "$temporary/stdout" >"$temporary/regions"
ply=$model/point_cloud/iteration_100/point_cloud.ply
header=$(($(head -c 4000 "$ply" | grep -abo end_header | head -1 | cut -d: -f1) + 11))
tail -c +$((header + 1)) "$ply" | od -An -v -t f4 -w248 | awk '{ print $1, $2, $3 }' >"$temporary/centres"

cat >"$temporary/compare.awk" <<'E2'
function within(at, x, axis) { # of the voxel, or beyond the border of the grid
    return (x >= low[axis] + cell[axis] * at * (1 - 1e-5) - 1e-5 || at == 0) && (x <= low[axis] + cell[axis] * (at + 1) + 1e-5 || at == 31)
}
FILENAME ~ /regions$/ {
    slack[$1] = $2
    split($1 % 32 " " int($1 / 32) % 32 " " int($1 / 1024), at, " ")
    for (k = 1; k <= 3; ++k) {
        if (!(k in first)) { first[k] = at[k]; point[k] = $(2 + k) }
        if (at[k] != first[k]) { cell[k] = ($(2 + k) - point[k]) / (at[k] - first[k]); low[k] = point[k] - (first[k] + 0.5) * cell[k] }
    }
    next
}
FILENAME ~ /centres$/ { for (k = 1; k <= 3; ++k) centre[n + 0, k] = $k; ++n; next }
{
    primitive = int($1 + 0.5); region = int($2 + 0.5)
    if (primitive > 4e9) { ++nothing; bad += region < 4e9 || $3 != 0; next }
    if (region > 4e9) { ++empty; bad += $3 != 0; next }
    ++seen
    known[region] = 1
    if (!(region in slack) || ($3 - slack[region]) ^ 2 > 1e-8 * (1 + slack[region] ^ 2)) ++bad
    if (!within(region % 32, centre[primitive, 1], 1) || !within(int(region / 32) % 32, centre[primitive, 2], 2) ||
        !within(int(region / 1024), centre[primitive, 3], 3)) ++bad
}
END {
    for (k in known) ++regions
    printf "%d pixels in %d regions, %d in none, %d wrong\n", seen, regions, empty, bad
    exit !(seen > 1000 && regions > 20 && empty < seen / 10 && !bad)
}
E2
check pixels_have_the_region_of_their_primitive awk -f "$temporary/compare.awk" "$temporary/regions" "$temporary/centres" "$temporary/pixels"
cat "$temporary/check"
awk 'NR == 1000 { $2 = $2 + 1 } { print }' "$temporary/pixels" >"$temporary/wrong"
check a_wrong_region_is_found bash -c "! awk -f '$temporary/compare.awk' '$temporary/regions' '$temporary/centres' '$temporary/wrong'"

run 0 render "$model" "$room" --view 0009 --aov region,slack --format png -o "$temporary/png"
for name in region slack; do
    check "picture_${name}_opens" oiiotool "$temporary/png/0009.$name.png"
done

# convert_filters_by_region: the fullest region, by its number and by its slack as `explain` prints them.
run 0 explain "$model" --top 100000 --json
read -r voxel slack above < <(jq -r '.regions | max_by(.count) | [.voxel, .slack - 0.001, .slack + 0.001] | map(tostring) | join(" ")' "$temporary/stdout")
run 0 convert "$model" "$temporary/part.ply" --filter-region "$voxel" --json
part=$(jq .output "$temporary/stdout")
check a_region_has_some_primitives test "$part" -gt 0 -a "$part" -lt "$(jq .input "$temporary/stdout")"
header=$(($(head -c 4000 "$temporary/part.ply" | grep -abo end_header | head -1 | cut -d: -f1) + 11))
tail -c +$((header + 1)) "$temporary/part.ply" | od -An -v -t f4 -w248 | awk '{ print $1, $2, $3 }' >"$temporary/inside"
# The voxel is half-way to the next centres on both sides; those at the border of the grid have no limit outside.
jq -r '.regions[] | [.voxel, .center[]] | map(tostring) | join(" ")' <("$program" explain "$model" --top 100000 --json) >"$temporary/centers"
cat >"$temporary/inside.awk" <<'E2'
FILENAME ~ /centers$/ {
    for (k = 1; k <= 3; ++k) {
        place[$1, k] = int($1 / 32 ^ (k - 1)) % 32
        if ($1 == voxel) middle[k] = $(k + 1)
        if (FNR > 1 && place[$1, k] != place[last, k]) cell[k] = ($(k + 1) - before[k]) / (place[$1, k] - place[last, k])
        before[k] = $(k + 1)
    }
    last = $1
    next
}
{
    for (k = 1; k <= 3; ++k) {
        d = ($k - middle[k]) / cell[k]
        if ((d < -0.5001 && place[voxel, k] > 0) || (d > 0.5001 && place[voxel, k] < 31)) bad = 1
    }
}
END { exit bad || !FNR }
E2
check they_are_in_the_voxel awk -v voxel="$voxel" -f "$temporary/inside.awk" "$temporary/centers" "$temporary/inside"
run 0 convert "$model" "$temporary/same.ply" --filter-region "$voxel" --filter-slack="$slack" --json
check its_own_slack_keeps_it test "$(jq .output "$temporary/stdout")" = "$part"
run 1 convert "$model" "$temporary/none.ply" --filter-region "$voxel" --filter-slack="$above"
reports "no primitive is left"

# Without recorded regions, naming them is an error, and `all` omits them.
cp "$ply" "$temporary/alone.ply"
run 1 render "$temporary/alone.ply" "$room" --downscale 8 --view 0009 --aov rgba,slack -o "$temporary/exr"
one_line
reports "run folder trained with --spare on"
run 0 render "$temporary/alone.ply" "$room" --downscale 8 --view 0009 --aov all -o "$temporary/alone"
reports "region and slack are omitted"
oiiotool --info -v "$temporary/alone/0009.exr" >"$temporary/info"
check the_others_are_there grep -qF 'primitive.id (uint), transmittance.T' "$temporary/info"
# The folder of an iteration has the regions of its run.
iteration=$model/point_cloud/iteration_100
run 0 render "$iteration" "$room" --view 0009 --aov primitive,region,slack -o "$temporary/of_iteration"
check the_pixels_are_the_same oiiotool "$temporary/exr/0009.exr" "$temporary/of_iteration/0009.exr" --diff
run 0 convert "$iteration" "$temporary/of_iteration.ply" --filter-region "$voxel"
check the_same_primitives cmp "$temporary/of_iteration.ply" "$temporary/part.ply"
head -c 100 "$model/regions.bin" >"$temporary/cut" && cat "$temporary/cut" "$temporary/cut" >"$model/regions.bin"
run 1 render "$model" "$room" --view 0009 --aov region -o "$temporary/exr"
one_line
reports "regions.bin"

# options_that_others_disable_are_reported
idle() { # OPTION WHY ARGUMENT...
    local option=$1 why=$2
    shift 2
    run 0 train "$room" -o "$temporary/idle" --downscale 16 --iterations 2 --quiet --overwrite "$@"
    reports "--$option has no effect $why"
}
idle spare-range "with --spare-phi product or plain" --spare-phi plain --spare-range 0.2
idle spare-capacity-min "on a --spare-demand without c" --spare-demand h,v --spare-capacity-min 0.1
idle spare-capacity-max "on a --spare-demand without c" --spare-demand h --spare-capacity-max 3
run 0 train "$room" -o "$temporary/idle" --downscale 16 --iterations 2 --quiet --overwrite --spare-phi constant --spare-range 0.2 --spare-demand c --spare-capacity-min 0
check no_option_is_idle bash -c "! grep 'has no effect' '$temporary/stderr'"

finish
