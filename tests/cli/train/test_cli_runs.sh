#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# A run keeps its split, its files when the same command is repeated, and its result when stdout fails. A limit without
# time, a missing run to resume and an existing run in OUT are errors that change nothing.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
scene=$temporary/scene
cp -r "$room" "$scene"
out=$temporary/out
data=("$scene" --downscale 16 --threads 2 --quiet)
names() { jq -r '.images[].name' "$temporary/stdout" | sort | tr '\n' ' '; }
files() { (cd "$1" && find . -path ./previous -prune -o -type f ! -path ./.lock -print | LC_ALL=C sort | xargs md5sum); }

# the_split_is_that_of_the_run (a removed or masked photo does not change the split of the others)
run 0 train "${data[@]}" -o "$out" --eval --iterations 12
json "$out/config.json" '.test_images == ["0001.jpg", "0009.jpg", "0017.jpg", "0025.jpg", "0033.jpg"]'
run 0 eval "$out" "$scene" --json
all=$(names)
mv "$scene/images/0003.jpg" "$temporary/"
run 0 eval "$out" "$scene" --json
check same_images_without_a_photo test "$(names)" = "$all"
json "$temporary/stdout" '.schema == 1 and .split == "test" and .training_images == 0'
run 0 render "$out" "$scene" --aov rgba -o "$temporary/views"
check same_views_are_rendered test "$(cd "$temporary/views" && echo *)" = '0001.exr 0009.exr 0017.exr 0025.exr 0033.exr'
run 0 eval "$out" "$scene" --test-every 8 --json
check an_explicit_split_overrides_it test "$(names)" = '0001.jpg 0010.jpg 0018.jpg 0026.jpg 0034.jpg '
mv "$temporary/0003.jpg" "$scene/images/"
mkdir "$scene/masks"
oiiotool --create 480x270 1 -d uint8 -o "$scene/masks/0004.png"
run 0 eval "$out" "$scene" --json
check same_images_with_a_black_mask test "$(names)" = "$all"
rm -r "$scene/masks"
mv "$scene/images/0009.jpg" "$temporary/"
run 0 eval "$out" "$scene" --json
check a_missing_held_out_image_is_only_missing test "$(names)" = '0001.jpg 0017.jpg 0025.jpg 0033.jpg '
run 1 train "${data[@]}" -o "$out" --eval --iterations 12 --resume
reports "the held-out image '0009.jpg' is missing from $scene; restore it to resume"
mv "$temporary/0009.jpg" "$scene/images/"
run 0 train "${data[@]}" -o "$out" --eval --iterations 12 --resume

# the_milestones_are_recorded
milestones() { # FILTER TRAIN-OPTION...
    run 0 train "$scene" --downscale 8 --threads 2 --quiet -o "$temporary/milestones" --overwrite --iterations 2 "${@:2}"
    json "$temporary/milestones/config.json" ".milestones | $1"
}
milestones '.reset_interval == 0 and .gradient_factor == 1.7 and .shape_factor == 2 and .sh_factor == 2 and .ssim_weight == 0.2 and .optimizer == "sparse"'
milestones '.ssim_weight == 0.6 and .half_size_until == 0' --ssim-weight 0.6
published='.reset_interval == 3000 and .gradient_factor == 1 and .shape_factor == 1 and .sh_factor == 1 and .sh_interval == 1000'
milestones "$published and [.densify_from, .densify_until, .densify_interval] == [500, 15000, 100]" --schedule paper
milestones '.reset_interval == 0 and .optimizer == "dense" and .densify_until == 25000' --pipeline mcmc --schedule paper
milestones '.max_gaussians == 57400 and .image_reduction == 8' --pipeline mcmc # ten times the 5740 points
milestones '.max_gaussians == 900' --pipeline mcmc --max-gaussians 900
milestones '.max_gaussians == 0' --pipeline 3dgs
json "$temporary/milestones/config.json" '[.trace, .view, .view_share, .lpips] == [null, null, null, null]'
milestones '.densify_from == 0 and .densify_until == 0 and .densify_interval == 0 and .sh_interval == 0' --schedule finetune \
    --init "$out"
check finetuning_a_model_causes_no_warning bash -c "! grep -q warning '$temporary/stderr'"
run 0 train "${data[@]}" -o "$temporary/milestones" --overwrite --iterations 2 --schedule finetune
reports "--schedule finetune is for a trained model: without --init"

# a_run_without_recorded_names_uses_its_options
cp -r "$out" "$temporary/old"
jq 'del(.test_images)' "$out/config.json" >"$temporary/old/config.json"
run 0 eval "$temporary/old" "$scene" --json
check its_options_decide test "$(names)" = "$all"
run 0 train "${data[@]}" -o "$temporary/old" --eval --iterations 12 --resume

# eval_names_the_split
run 0 eval "$out" "$scene"
prints "over 5 images (held out)"
run 0 eval "$out" "$scene" --split all
prints "over 35 images (30 training images, 5 held out)"
for option in --eval "--test-every 4" "--test-images 0001.jpg"; do
    # shellcheck disable=SC2086 # option and value
    run 0 eval "$out" "$scene" --split all $option
    prints "over 35 images (30 training images, 5 held out)"
    reports "warning: ${option%% *} has no effect with --split all on a run, which records the held-out images"
done
run 0 eval "$out/point_cloud/iteration_12/point_cloud.ply" "$scene" --split all --test-every 5 --downscale 8
prints "over 35 images (28 training images, 7 held out)"
check it_has_an_effect_on_a_file bash -c "! grep -q 'has no effect' '$temporary/stderr'"
run 0 eval "$out" "$scene" --split all --json
json "$temporary/stdout" '.split == "all" and .training_images == 30'
# Training images do not become held-out images by an option: 2 of these 12 were held out.
run 0 eval "$out" "$scene" --test-every 3
prints "over 12 images (10 training images, 2 held out)"
reports "$out was trained on 10 of the 12 images; their scores are not those of held-out images"
run 0 eval "$out" "$scene" --test-every 3 --json --quiet
json "$temporary/stdout" '.split == "test" and .training_images == 10'
ply=$out/point_cloud/iteration_12/point_cloud.ply
run 0 eval "$ply" "$scene" --downscale 8
prints "over 35 images (35 training images, 0 held out)"

# another_scene_causes_a_warning
cp -r "$room" "$temporary/other"
sed_poses() { awk '/^#/ { print; next } { if (++n % 2) { $6 += 3 } print }' "$1" >"$1.new" && mv "$1.new" "$1"; }
if installed colmap; then
    colmap model_converter --input_path "$temporary/other/sparse/0" --output_path "$temporary/other/sparse/0" --output_type TXT >/dev/null 2>&1
    rm -f "$temporary"/other/sparse/0/*.bin
    sed_poses "$temporary/other/sparse/0/images.txt"
    run 0 eval "$out" "$temporary/other" --json
    reports "0 of 35 cameras match those of the run $out"
fi
run 0 eval "$out" "$scene" --json
check no_warning_about_its_own_scene test ! -s "$temporary/stderr"

# a_scene_that_names_its_test_views (without an option, without a run)
mkdir -p "$temporary/nerf/train" "$temporary/nerf/test"
frame() { printf '{"camera_angle_x": 0.8, "frames": [{"file_path": "./%s/r_0", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,%s],[0,0,0,1]]}]}' "$1" "$2"; }
for split in train:4 test:5; do
    frame "${split%:*}" "${split#*:}" >"$temporary/nerf/transforms_${split%:*}.json"
    oiiotool --create 24x16 4 --fill:color=0.8,0.2,0.1,1 24x16 -d uint8 -o "$temporary/nerf/${split%:*}/r_0.png"
done
run 0 eval "$ply" "$temporary/nerf" --split test --json
check its_own_test_views test "$(names)" = 'test/r_0.png '
run 0 render "$ply" "$temporary/nerf" --split test --aov rgba -o "$temporary/nerf_views"
check one_view test "$(find "$temporary/nerf_views" -name '*.exr' | wc -l)" = 1

# a_run_on_images_in_other_folders_is_evaluated (its config names no folder, unless --images did)
nerf_run=$temporary/nerf_run
run 0 train "$temporary/nerf" -o "$nerf_run" --iterations 3 --eval --random-points 200 --quiet
json "$nerf_run/config.json" '.options.images == null'
run 0 eval "$nerf_run" "$temporary/nerf" --json
check the_held_out_views test "$(names)" = 'test/r_0.png '
run 0 render "$nerf_run" "$temporary/nerf" --split test --aov rgba -o "$temporary/nerf_run_views"
run 0 train "$temporary/nerf" -o "$nerf_run" --iterations 3 --eval --random-points 200 --quiet --resume
cp -r "$nerf_run" "$temporary/nerf_old"
# a_recorded_split_causes_no_warning about the scene's own test views, as in merge, where no names are used
jq 'del(.test_images)' "$nerf_run/config.json" >"$temporary/nerf_old/config.json"
run 0 eval "$temporary/nerf_old" "$temporary/nerf" --quiet
check no_option_is_ignored test ! -s "$temporary/stderr"
run 0 train "$temporary/nerf" -o "$nerf_run" --resume --quiet
check its_own_test_views_are_used_without_a_warning test ! -s "$temporary/stderr"
jq 'del(.precise) | .options.images = "images"' "$nerf_run/config.json" >"$temporary/recorded.json" # as recorded before
cp "$temporary/recorded.json" "$nerf_run/config.json"
cp "$temporary/recorded.json" "$temporary/nerf_old/config.json"
run 0 train "$temporary/nerf" -o "$temporary/nerf_old" --resume --quiet
run 0 train "$temporary/nerf" -o "$nerf_run" --iterations 3 --eval --random-points 200 --quiet --resume

# a_random_background_is_evaluated_over_black_in_training_and_later (a white data set, too)
oiiotool --create 24x16 4 --fill:color=0.8,0.2,0.1,1 12x16 -d uint8 -o "$temporary/nerf/train/r_0.png"
run 0 train "$temporary/nerf" -o "$nerf_run" --iterations 3 --random-points 200 --opaque --json --overwrite
in_training=$(jq .train.psnr "$temporary/stdout")
run 0 eval "$nerf_run" "$temporary/nerf" --json
json "$temporary/stdout" "(.mean.psnr - $in_training | fabs) < 1e-6"

# the_colour_maps_are_saved_with_each_model (a killed run is evaluated with them)
"$program" train "${data[@]}" -o "$temporary/killed" --exposure --save-at 5 --iterations 100000 2>"$temporary/stderr" &
killed=$!
for ((wait = 0; wait < 300; ++wait)); do
    if [ -s "$temporary/killed/exposure.json" ]; then break; fi
    sleep 0.1
done
kill -9 "$killed"
wait "$killed" 2>/dev/null || true
check maps_of_the_saved_model test -s "$temporary/killed/exposure.json"
json "$temporary/killed/exposure.json" 'length == 35'

# identical_images (their PSNR is infinite: "inf", null, and 100 dB in the mean)
cp -r "$room" "$temporary/same"
one=(--downscale 1 --test-images "0001.jpg,0002.jpg")
run 0 eval "$ply" "$temporary/same" "${one[@]}" --save "$temporary/drawn"
rm "$temporary/same/images/0001.jpg"
cp "$temporary/drawn/0001.png" "$temporary/same/images/"
run 0 eval "$ply" "$temporary/same" "${one[@]}" --json
json "$temporary/stdout" '.images[0].psnr == null and .images[0].identical and (.images[1].identical | not)'
json "$temporary/stdout" '.mean.identical == 1 and (.mean.psnr - (100 + .images[1].psnr) / 2 | fabs) < 1e-6'
run 0 eval "$ply" "$temporary/same" "${one[@]}"
check the_table_has_inf grep -qE '^0001.jpg +inf dB' "$temporary/stdout"
prints "1 of them identical to the photo: PSNR is infinite and counts as 100 dB in the mean"

# render_honours_the_space_of_the_colours (bare models and runs)
for model in "$ply" "$out"; do
    run 0 render "$model" "$room" --downscale 8 --view 0009 --aov rgba --train-space linear --white 1 -o "$temporary/white1"
    run 0 render "$model" "$room" --downscale 8 --view 0009 --aov rgba --train-space linear --white 10 -o "$temporary/white10"
    run 0 render "$model" "$room" --downscale 8 --view 0009 --aov rgba -o "$temporary/display"
    check white_scales_the_light oiiotool --fail 0.001 "$temporary/white1/0009.exr" --mulc 10,10,10,1 "$temporary/white10/0009.exr" --diff
    check linear_colours_are_not_decoded bash -c "! oiiotool --fail 0.01 '$temporary/white1/0009.exr' '$temporary/display/0009.exr' --diff"
done

# the_same_command_again_changes_nothing
before=$(files "$out")
run 1 train "${data[@]}" -o "$out" --eval --iterations 5
one_line
reports "already contains a run; continue it with --resume, or replace it with --overwrite"
check nothing_changed test "$(files "$out")" = "$before"
run 1 train "${data[@]}" -o "$temporary/mistyped" --eval --iterations 5 --resume
one_line
reports "no run to resume: config.json does not exist"
check no_folder_is_made test ! -e "$temporary/mistyped"
run 2 train "${data[@]}" -o "$out" --resume --overwrite
one_line
reports "--resume and --overwrite are mutually exclusive"

# overwrite_moves_the_earlier_run, and keeps one earlier run only
touch "$out/notes.txt"
before=$(files "$out" | grep -v notes.txt)
run 0 train "${data[@]}" -o "$out" --iterations 3 --overwrite
check the_earlier_run_is_whole test "$(files "$out/previous")" = "$before"
check the_new_run_is_in_out test "$(jq .iterations "$out/summary.json")" = 3
check other_files_stay test -e "$out/notes.txt"
run 0 eval "$out/previous" "$scene" --json
before=$(files "$out" | grep -v notes.txt)
run 0 train "${data[@]}" -o "$out" --iterations 4 --overwrite
check one_earlier_run_is_kept test "$(files "$out/previous")" = "$before" -a ! -e "$out/previous/previous"

# a_failed_write_restores_the_earlier_run
before=$(files "$out")
kept=$(files "$out/previous")
last_command="train --overwrite with a limit on the size of files"
# shellcheck disable=SC2016
check fails_with_status_1 bash -c 'trap "" XFSZ; ulimit -f 1; status=0
    "$0" train "$1" --downscale 8 -o "$2" --iterations 3 --quiet --overwrite 2>"$3" || status=$?; [ $status = 1 ]' \
    "$program" "$room" "$out" "$temporary/stderr"
check the_run_is_back test "$(files "$out")" = "$before" -a "$(files "$out/previous")" = "$kept"
check no_leftover test -z "$(find "$out" -maxdepth 1 -name '*previous.*')"

# a_process_killed_while_it_moved_the_run (an incomplete move is undone; a complete one stays)
mkdir "$out/previous.next"
mv "$out/point_cloud" "$out/train.csv" "$out/previous.next/"
run 1 train "${data[@]}" -o "$out" --iterations 3
check an_incomplete_move_is_undone test "$(files "$out")" = "$before"
mkdir "$out/previous.next"
for file in point_cloud cameras.json input.ply train.csv spare.csv summary.json regions.bin checkpoint config.json; do
    [ ! -e "$out/$file" ] || mv "$out/$file" "$out/previous.next/"
done
touch "$out/cameras.json"
run 0 train "${data[@]}" -o "$out" --iterations 3
check a_complete_move_stays test "$(files "$out/previous")" = "$(grep -v notes.txt <<<"$before")"

# an_impossible_trace_leaves_the_run
before=$(files "$out")
run 1 train "${data[@]}" -o "$out" --iterations 3 --overwrite --trace "$out/notes.txt/trace.json"
one_line
check the_run_stays test "$(files "$out")" = "$before"

# a_run_without_results_does_not_replace_the_previous_one
kept=$(files "$out/previous")
rm -r "$out/point_cloud" "$out/checkpoint" "$out/summary.json"
run 0 train "${data[@]}" -o "$out" --iterations 3 --overwrite
check the_previous_run_stays test "$(files "$out/previous")" = "$kept"
check no_leftover_is_there test -z "$(find "$out" -maxdepth 1 -name '*previous.*')"

# held_out_images_that_are_missing_are_reported
cp -r "$scene" "$temporary/fewer"
run 0 train "$temporary/fewer" --downscale 8 --threads 2 --quiet -o "$temporary/held" --iterations 3 --eval
held=$(jq -r '.test_images[]' "$temporary/held/config.json")
# held_out_images_are_found_in_another_folder (a transforms.json of the same cameras)
jq '{camera_model: "PINHOLE", w: 480, h: 270, frames: [.[] | .rotation as $r | .position as $p | {
    file_path: ("images/" + .img_name), fl_x: (.fx * 480 / .width), fl_y: (.fy * 270 / .height),
    transform_matrix: [range(3) as $i | [$r[$i][0], -$r[$i][1], -$r[$i][2], $p[$i]]]}]}' \
    "$temporary/held/cameras.json" >"$temporary/fewer/transforms.json"
mv "$temporary/fewer/sparse" "$temporary/sparse"
run 0 eval "$temporary/held" "$temporary/fewer" --json --quiet
check same_images test "$(jq -r '.images[].name' "$temporary/stdout")" = "$(sed 's,^,images/,' <<<"$held")"
check no_warning test ! -s "$temporary/stderr"
mv "$temporary/sparse" "$temporary/fewer/sparse"
rm "$temporary/fewer/transforms.json"
rm "$temporary/fewer/images/$(head -1 <<<"$held")"
run 0 eval "$temporary/held" "$temporary/fewer" --json
json "$temporary/stdout" ".split == \"test\" and (.images | length) == $(($(wc -l <<<"$held") - 1))"
reports "contains $(($(wc -l <<<"$held") - 1)) of the $(wc -l <<<"$held") held-out images of the run"
for name in $held; do rm -f "$temporary/fewer/images/$name"; done
run 1 eval "$temporary/held" "$temporary/fewer"
reports "contains none of the $(wc -l <<<"$held") held-out images of the run"
run 0 eval "$temporary/held" "$temporary/fewer" --split all --json

# models_of_other_programs_are_not_replaced
mkdir -p "$temporary/foreign/point_cloud/iteration_30000"
touch "$temporary/foreign/point_cloud/iteration_30000/point_cloud.ply"
for option in --eval --overwrite; do
    run 1 train "${data[@]}" -o "$temporary/foreign" --iterations 3 $option
    one_line
    reports "foreign: contains models, but no config.json: the output of another program"
done
check only_the_model_is_there test "$(cd "$temporary/foreign" && find . -type f)" = "./point_cloud/iteration_30000/point_cloud.ply"

for name in cameras.json summary.json input.ply train.csv checkpoint/state.bin; do
    mkdir -p "$(dirname "$temporary/own/$name")"
    echo mine >"$temporary/own/$name"
    for option in --eval --overwrite; do
        run 1 train "${data[@]}" -o "$temporary/own" --iterations 3 $option
        one_line
        reports "own: contains ${name/checkpoint*/a checkpoint}, but no config.json: the output of another program"
    done
    check only_my_file_is_there test "$(cd "$temporary/own" && find . -type f -exec grep -H . {} +)" = "./$name:mine"
    rm "$temporary/own/$name"
done
mkdir -p "$temporary/own/point_cloud" "$temporary/own/checkpoint"
echo mine >"$temporary/own/notes.txt"
run 0 train "${data[@]}" -o "$temporary/own" --iterations 3
# an_interrupted_start_may_be_repeated (it left the lock and a file; the second start fails before it writes any)
mkdir "$temporary/begun"
touch "$temporary/begun/.lock" "$temporary/begun/cameras.json"
run 1 train "$temporary/nothing" -o "$temporary/begun" --iterations 3
run 0 train "${data[@]}" -o "$temporary/begun" --iterations 3

# other_folders_are_not_removed
mkdir "$out/previous.old"
touch "$out/previous.old/mine"
run 0 train "${data[@]}" -o "$out" --iterations 3 --overwrite
check it_stays test -e "$out/previous.old/mine"
mv "$out/previous" "$temporary/"
mkdir "$out/previous"
touch "$out/previous/mine"
run 1 train "${data[@]}" -o "$out" --iterations 3 --overwrite
one_line
reports "previous: is not an earlier run"
check it_is_there test -e "$out/previous/mine"

# a_finished_run_without_a_checkpoint_is_not_started_again
run 0 train "${data[@]}" -o "$temporary/unsaved" --iterations 3 --checkpoint-every 0
check no_checkpoint_is_left test ! -e "$temporary/unsaved/checkpoint/state.bin"
run 1 train "${data[@]}" -o "$temporary/unsaved" --iterations 3 --checkpoint-every 0 --resume
one_line
reports "no checkpoint to resume from: checkpoint/state.bin does not exist; start again with --overwrite"

# a_run_that_was_stopped_before_its_first_iteration_starts
rm -r "$temporary/unsaved/point_cloud"
jq '.iterations = 0 | .stop_reason = "signal"' "$temporary/unsaved/summary.json" >"$temporary/stopped.json"
mv "$temporary/stopped.json" "$temporary/unsaved/summary.json"
run 0 train "${data[@]}" -o "$temporary/unsaved" --iterations 3 --checkpoint-every 0 --resume
json "$temporary/unsaved/summary.json" '.iterations == 3'

# the_loop_of_a_batch_system (the same line starts and resumes)
rm -rf "$temporary/queue"
batch() {
    local r=
    [ ! -e "$temporary/queue/config.json" ] || r=--resume
    # shellcheck disable=SC2086
    run "$1" train "${data[@]}" -o "$temporary/queue" --iterations 20 "${@:2}" $r
}
batch 0 --checkpoint-every 5
batch 0 --checkpoint-every 5
json "$temporary/queue/summary.json" '.stop_reason == "schedule" and .iterations == 20'

# a_limit_without_time_is_an_error
for limit in 0s 0.3s; do
    run 1 train "${data[@]}" -o "$temporary/no_time" --iterations 20 --time-limit $limit
    one_line
    reports "--time-limit $limit leaves no time for an iteration"
    check nothing_is_written test ! -e "$temporary/no_time"
done
before=$(files "$temporary/queue")
run 1 train "${data[@]}" -o "$temporary/queue" --iterations 20 --checkpoint-every 5 --resume --time-limit 0s
check the_run_is_as_before test "$(files "$temporary/queue")" = "$before"

# the_summary_names_its_files
json "$temporary/queue/summary.json" '.schema == 1 and .wall_seconds > 0 and (.version | length) > 0'
check the_model_is_there test -s "$(jq -r .model "$temporary/queue/summary.json")"

# stdout_that_fails_does_not_hide_a_finished_run
last_command="train with a closed stdout"
check closed_is_silent bash -c '"$0" train "$@" >&-' "$program" "${data[@]}" -o "$temporary/closed" --iterations 3
json "$temporary/closed/summary.json" '.iterations == 3 and .wall_seconds >= .train_seconds'
check tables_are_not_mixed_with_stdout bash -c '! grep -rq "primitives, model" "$0"' "$temporary/closed"
last_command="train to /dev/full"
status=0
"$program" train "${data[@]}" -o "$temporary/full" --iterations 3 >/dev/full 2>"$temporary/stderr" || status=$?
check status_1 test "$status" = 1
reports "the run is complete, its result is in $temporary/full/summary.json"
one_line
# a_closed_pipe_is_no_error, and a full disk has its reason
last_command="eval to a closed pipe"
for format in "" --json; do
    # shellcheck disable=SC2086 # none or one
    "$program" eval "$temporary/full" "$scene" --downscale 16 --quiet $format 2>"$temporary/stderr" | head -c 1 >"$temporary/stdout"
    status=${PIPESTATUS[0]}
    check status_0 test "$status" = 0
    check no_message test ! -s "$temporary/stderr"
done
last_command="info to /dev/full"
for format in "" --json; do
    status=0
    # shellcheck disable=SC2086 # none or one
    "$program" info "$scene" $format >/dev/full 2>"$temporary/stderr" || status=$?
    check status_1 test "$status" = 1
    reports "standard output: cannot be written: No space left on device"
    one_line
done

# save_at_after_the_end
run 2 train "${data[@]}" -o "$temporary/none" --iterations 20 --save-at 10,99
one_line
reports "--save-at: the run ends at iteration 20"

finish
