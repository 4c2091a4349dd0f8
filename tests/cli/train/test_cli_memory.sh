#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The estimate behind --max-memory is within 20 % of the peak memory of training runs: with 8-bit and half-float photos,
# with and without SPARE-GS and checkpoints, from an initial model, and resumed. Trainings and frames that exceed the
# machine's memory are refused at the start.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
if is_sanitized; then
    echo "skipped: a sanitizer keeps its own books; nothing to compare"
    exit 77
fi
mkdir -p "$temporary/hdr/images"
cp -r "$room/sparse" "$temporary/hdr/"
oiiotool --frames 1-35 "$room/images/%04d.jpg" --colorconvert sRGB linear -d half -o "$temporary/hdr/images/%04d.exr"

# near NAME ARGUMENT...: trains, then compares.
near() {
    local name=$1
    shift
    run 0 train "$@" -o "$temporary/$name" --threads 2 --quiet
    jq -r --arg name "$name" '"\($name): estimated \(.memory_estimate_bytes / 1e6 | floor) MB, peak \(.peak_rss_bytes / 1e6 | floor) MB, \(.memory_estimate_bytes / .peak_rss_bytes * 100 | floor) %"' \
        "$temporary/$name/summary.json"
    json "$temporary/$name/summary.json" '.memory_estimate_bytes / .peak_rss_bytes | . > 0.8 and . < 1.2'
}
near bytes "$room" --iterations 3 --spare off --checkpoint-every 0
near halves "$temporary/hdr" --iterations 12 --spare on --checkpoint-every 10
near small "$room" --downscale 8 --iterations 150 --spare on
near refined "$room" --downscale 4 --iterations 30 --init "$temporary/small"

# no_run_exceeds_its_limit (tiny images, few and many threads; the update that would exceed it is not made, and resuming
# without the limit gives the same model). The estimates for the first and the last number of primitives give the limits.
limited() { # LIMIT in bytes: in $temporary/limited; sets status
    last_command="train --downscale $scale --threads $threads --max-memory ${1}B"
    status=0
    rm -rf "$temporary/limited"
    "$program" train "${small[@]}" -o "$temporary/limited" --max-memory "${1}B" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
}
peak_is_below() { json "$temporary/limited/summary.json" ".peak_rss_bytes <= $1"; }
settings=('8 2')
if is_long; then settings+=('4 4' '16 1' '4 2'); fi
for setting in "${settings[@]}"; do
    read -r scale threads <<<"$setting"
    small=("$room" --downscale "$scale" --iterations 200 --spare off --quiet --threads "$threads")
    run 0 train "${small[@]}" -o "$temporary/unlimited" --overwrite
    last=$(jq .memory_estimate_bytes "$temporary/unlimited/summary.json")
    limited $((last / 2))
    check refused_at_the_start test "$status" = 1 -a ! -e "$temporary/limited/summary.json"
    reports "more than --max-memory"
    first=$(sed -n 's/.* requires about \([0-9.]*\) GiB .*/\1/p' "$temporary/stderr" | awk '{ printf "%d", $1 * 2 ^ 30 }')
    check the_estimate_grows_with_the_model test $((last - first)) -gt 10000000
    for share in 20 60; do # percent of the growth: refused by the first and by a later update
        limit=$((first + (last - first) / 100 * share))
        limited $limit
        check stopped_before_the_update test "$status" = 1
        reports "may exceed --max-memory; saved a checkpoint"
        json "$temporary/limited/summary.json" '.stop_reason == "memory_limit" and .iterations < 200'
        peak_is_below $limit
        run 0 train "${small[@]}" -o "$temporary/limited" --resume
        check the_model_is_the_same cmp <(jq .model_hash "$temporary/limited/summary.json") <(jq .model_hash "$temporary/unlimited/summary.json")
    done
    limit=$(jq '[.memory_estimate_bytes, .peak_rss_bytes] | max * 1.2 | floor' "$temporary/unlimited/summary.json")
    limited "$limit"
    check the_limit_is_enough test "$status" = 0
    peak_is_below "$limit"
done

# the_estimate_counts_the_resumed_model: `small` has more primitives than the scene has points
points=$(jq .gaussians "$temporary/small/summary.json")
run 1 train "$room" --downscale 4 --iterations 30 --init "$temporary/small" -o "$temporary/refused" --max-memory 20M
reports "initial model of $points primitives"
run 1 train "$room" --downscale 8 --iterations 150 --spare on --resume -o "$temporary/small" --max-memory 20M
check resume_counts_the_checkpoint test "$(grep -oE 'initial model of [0-9]+ primitives' "$temporary/stderr" | grep -oE '[0-9]+')" \
    -gt $((points * 95 / 100))

# the_estimate_counts_the_viewer: a second model, its renderer and pages
run 0 train "$room" --downscale 8 --iterations 2 --threads 2 --max-memory 300M -o "$temporary/unseen" --quiet
run 1 train "$room" --downscale 8 --iterations 2 --threads 2 --max-memory 300M -o "$temporary/seen" --quiet --view 0
reports "more than --max-memory"
reports "omit --view"

# the_image_cache: its default is at most half of the limit; the note counts the images that fit
run 0 train "$room" --downscale 8 --iterations 2 --checkpoint-every 0 -o "$temporary/cached" --max-memory 2G
json "$temporary/cached/config.json" '.image_cache == 1073741824'
check no_note_if_all_images_fit test "$(grep -c 'image cache' "$temporary/stderr")" = 0
run 0 train "$room" --downscale 8 --iterations 2 --checkpoint-every 0 -o "$temporary/uncached" --image-cache 110000
json "$temporary/uncached/config.json" '.image_cache == 110000'
reports "about 17 of 35 images fit in the image cache (107.42 of 212.05 KiB)"
reports "raise --image-cache"
reports "warning: --image-cache is 110000 bytes, less than 1 MiB; append a unit, for example 4GiB"
check notes_once test "$(grep -c 'image cache' "$temporary/stderr")" = 1
check the_cache_does_not_change_the_model cmp <(jq .model_hash "$temporary/cached/summary.json") <(jq .model_hash "$temporary/uncached/summary.json")
run 0 train "$room" --downscale 8 --iterations 2 --checkpoint-every 0 -o "$temporary/uncached" --image-cache 110000 --overwrite --quiet
check quiet_omits_the_note test "$(grep -c 'image cache' "$temporary/stderr")" = 0

# more_than_the_machine_has (with a limit on the address space, in case the machine has that much)
ulimit -v 6000000
run 1 render "$temporary/small" "$room" --orbit 1 --size 65536x65536 --aov all -o "$temporary/huge"
reports "a frame of 65536x65536 pixels"
mkdir "$temporary/empty"
cp -r "$room/images" "$room/sparse" "$temporary/empty/"
rm "$temporary"/empty/sparse/0/points3D.*
if [ "$(awk '/^(Mem|Swap)Total/ { sum += $2 } END { print sum }' /proc/meminfo)" -lt 300000000 ]; then
    run 1 train "$temporary/empty" --downscale 8 --random-points 100000000 --iterations 1 -o "$temporary/huge_run"
    reports "more than the memory of the machine"
    reports "larger --max-memory"
    check nothing_is_written test ! -e "$temporary/huge_run/config.json"
    run 1 train "$temporary/empty" --downscale 8 --random-points 100000000 --iterations 1 -o "$temporary/huge_run" --max-memory 100T
    reports "not enough memory for"
    check warns_once test "$(grep -c 'no points3D' "$temporary/stderr")" = 1
fi
finish
