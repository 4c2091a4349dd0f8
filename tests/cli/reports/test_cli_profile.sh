#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# profile: its numbers are consistent, other programs read its files; --trace of profile and train.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
model=$temporary/model
run 0 train "$room" -o "$model" --downscale 8 --eval --iterations 5 --spare off --threads 1 --quiet --trace "$temporary/train.json"
trace=$temporary/train.json
json "$trace" '[.traceEvents[] | select(.name | startswith("iteration"))] | length == 5'
json "$trace" 'all(.traceEvents[]; .ph == "X" and .dur >= 0 and .ts >= 0 or .ph == "C")'
# phases_are_within_their_iteration
json "$trace" '[.traceEvents[] | select(.ph == "X")] | (map(select(.name == "forward")) | length == 5) and
    (map(select(.name | startswith("iteration")) | .dur) | add) >= 0.999 * (map(select(.name | startswith("iteration") | not) | .dur) | add)'
json "$trace" '[.traceEvents[] | select(.name == "bvh_callbacks") | .args.bvh_callbacks] | length == 5 and all(. > 0)'
json "$trace" '[.traceEvents[] | select(.name == "gaussians") | .args.gaussians] | length == 5 and all(. > 0)'

run 0 profile "$model" "$room" --view 0009 -o "$temporary/maps" --repeat 1 --threads 1 --trace "$temporary/trace.json" --json --quiet
json "$temporary/stdout" '[.trees[].name] == ["low", "medium", "high", "refit", "aged"]'
json "$temporary/stdout" 'all(.trees[]; .build_seconds > 0 and .bytes > 0 and .callbacks > 0 and .surface_area_cost > 1)'
json "$temporary/stdout" '.views == 1 and .view.rays == 60 * 33 and .view.hits_per_ray > 1'
json "$temporary/stdout" 'all(.trees[]; .nodes > .leaves and .depth > 2 and .node_visits > 0 and .distinct_callbacks <= .callbacks)'
json "$temporary/stdout" '.per_view | length == 1 and .[0].name == "0009.jpg" and (.[0].trees | length) == 5'
json "$temporary/stdout" '.per_view[0].hits == .view.hits and .traced_primitives == null and .view.traced_primitives > 0'
json "$temporary/stdout" '.model != null and .scene != null and .version != null and .repeat == 1 and (.primitives | floor) == .primitives'
json "$temporary/stdout" 'all(.view.false_positives[]; . >= 0 and . < 1)'
json "$temporary/stdout" '.answers | (.quality_training | length > 0) and (.dominant_share > 0 and .dominant_share < 1)'
json "$temporary/stdout" '.training_seconds | .iteration > 0.9 * (.refit + .gather + .forward + .loss + .backward + .optimizer)'
json "$temporary/stdout" 'all(.trees[]; .gather_with_depth_bound_core_seconds > 0)'
json "$temporary/stdout" '.view.gather_noise == null and .answers.quality_drawing == null' # of one repetition
json "$temporary/stdout" '.per_view[0].built_for | type == "string" and . != "0009.jpg"'
built_elsewhere=$(jq '.trees[3].surface_area_cost' "$temporary/stdout")
# the_trace_is_a_timeline: builds and iterations one after the other, phases inside their iteration
json "$temporary/trace.json" '.traceEvents | map(.name) | contains(["bvh_build", "iteration 1", "backward"])'
json "$temporary/trace.json" '[.traceEvents[] | select(.name == "bvh_build" or (.name | startswith("iteration")))] |
    . as $s | all(range(1; length); $s[.].ts >= $s[. - 1].ts + $s[. - 1].dur)'
# a_device_or_a_pipe_is_not_replaced (as root, --trace /dev/null would remove the device)
mkfifo "$temporary/pipe" "$temporary/pipe.ply"
run 1 profile "$model" "$room" --view 0009 --repeat 1 --samples 0 --threads 1 --trace "$temporary/pipe" --quiet
one_line
reports "pipe: is a device or a pipe; choose the name of a file"
run 1 convert "$model" "$temporary/pipe.ply" --quiet
one_line
for name in pipe pipe.ply; do check "$name is still a pipe" test -p "$temporary/$name"; done
run 0 profile "$model" "$room" --view 0009 --repeat 2 --samples 0 --threads 1 --filter mip --json --quiet
json "$temporary/stdout" '.view.gather_noise >= 0'
json "$temporary/stdout" '.view.sampled_hits == null and .view.hits_per_ray > 1'
for map in profile tiles; do
    check "${map}_exr_opens" oiiotool --info -v "$temporary/maps/0009.$map.exr"
done
check hits_are_in_the_exr bash -c "oiiotool --info -v '$temporary/maps/0009.profile.exr' | grep -q 'hits.count'"
if installed exrcheck; then
    check valid_by_exrcheck exrcheck "$temporary/maps/0009.profile.exr" "$temporary/maps/0009.tiles.exr"
fi
for map in hits block_hits tile_candidates tile_cost; do
    check "${map}_png_has_the_size_of_the_view" bash -c "oiiotool --info '$temporary/maps/0009.$map.png' | grep -qE '60 x +33'"
done

run 0 profile "$model" "$room" --orbit 2 --repeat 1 --samples 8 --threads 1
prints "Build quality for training: "
prints ". For a fixed model: "
prints "Rebuild:"
prints "Dominant phase:"
prints " that a ray can hit, "
prints "timing noise unknown with one repetition"
prints "SAH cost"
check no_refit_of_trees_that_are_rebuilt test "$(grep -cE '^(low|medium|high) +[0-9.]+ +- +[0-9.]+ ' "$temporary/stdout")" = 3
# the_only_view_of_a_split
alone=(profile "$model" "$room" --split test --test-images 0009.jpg --repeat 1 --samples 0 --threads 1 --quiet)
run 0 "${alone[@]}"
prints "refit, aged: built for the same camera, the only one"
run 0 "${alone[@]}" --json
json "$temporary/stdout" '.per_view | length == 1 and .[0].built_for == null'
json "$temporary/stdout" ".trees[3].surface_area_cost != $built_elsewhere"
run 1 profile "$model" "$room" --view nothing
one_line
for both in "--orbit 2 --view 0009" "--orbit 2 --split test" "--view 0009 --views 2"; do
    # shellcheck disable=SC2086
    run 2 profile "$model" "$room" $both
    one_line
done
run 2 profile "$model"
one_line
run 2 profile "$model" "$room" --compact-box 0.5
reports "--compact-box has no effect on profile"
one_line

finish
