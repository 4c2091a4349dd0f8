#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs split, train --region and merge, from a scene to a run folder that eval accepts: by the scripts of split, also
# interrupted and resumed; a merged model has each block's own primitives; missing, unfinished and foreign blocks are refused.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
export SPAREGS=$program
dir=$temporary/blocks
options=(--downscale 16 --eval --quiet)

# split_writes_a_plan_and_scripts
run 0 split "$room" -o "$dir" --blocks 3
prints "block    points   views   box"
json "$dir/blocks.json" '(.blocks | length) == 3 and ([.blocks[].points] | add) == '"$("$program" info "$room" --json | jq .points)"
json "$dir/blocks.json" '[.blocks[] | .low + .high | map(select(. == null)) | length] | all(. >= 3 and . <= 5)'
check scripts_are_valid bash -n "$dir/blocks.sh" "$dir/coarse.sh"
check a_task_has_a_whole_machine test "$(grep -cxE '#SBATCH --(exclusive|mem=0)' "$dir/blocks.sh")" = 2
check the_array_has_a_task_per_block grep -qx '#SBATCH --array=0-2' "$dir/blocks.sh"
run 1 split "$room" -o "$dir"
reports "blocks/blocks.json: already exists, and trained blocks depend on it; choose another folder"
run 0 split "$room" -o "$temporary/json" --blocks 2 --json
json "$temporary/stdout" '(.blocks | length) == 2 and (.files | length) == 3 and (.blocks[0].views | type) == "number"'
cd "$SPAREGS_SOURCE/tests/data"
run 0 split room -o "$temporary/relative"
cd - >/dev/null
json "$temporary/relative/blocks.json" ".scene == \"$(realpath "$room")\"" # merge may run in another folder
run 2 split "$room" -o "$temporary/x" --blocks 1
reports "--blocks"
run 2 split "$room"
reports "split requires an output folder, -o DIR"
run 1 split "$room" -o "$temporary/x" --blocks 256
check nothing_was_written test ! -e "$temporary/x"
# A name that JSON cannot contain would be missing in the views of the blocks.
cp -r "$room" "$temporary/latin"
mv "$temporary/latin/images/0004.jpg" "$temporary/latin/images/"$'\xe9''004.jpg'
LC_ALL=C sed -i 's/0004\.jpg/\xe9004.jpg/' "$temporary/latin/sparse/0/images.bin"
run 1 split "$temporary/latin" -o "$temporary/x"
reports "is not UTF-8, and a plan of blocks cannot contain it; rename the file"
check nothing_was_written test ! -e "$temporary/x"

# merge_refuses_a_missing_block
run 1 merge "$dir" -o "$temporary/merged"
reports "blocks/block_0: block 0 of 3 is missing; train it with"
one_line

# the_scripts_train_the_coarse_model_and_the_blocks (block 1 is interrupted and resumed)
last_command="coarse.sh and blocks.sh"
check coarse_trains bash "$dir/coarse.sh" --iterations 90 "${options[@]}"
check block_0_trains env SLURM_ARRAY_TASK_ID=0 bash "$dir/blocks.sh" --iterations 90 "${options[@]}"
run 0 train "$room" -o "$temporary/straight" --region "$dir/blocks.json:1" --init "$dir/coarse" --iterations 90 "${options[@]}"
check block_1_trains env SLURM_ARRAY_TASK_ID=1 bash "$dir/blocks.sh" --iterations 90 --checkpoint-every 30 "${options[@]}"
# As if it had been killed after the checkpoint of iteration 60.
mv "$dir/block_1/checkpoint/state.previous.bin" "$dir/block_1/checkpoint/state.bin"
rm -r "$dir/block_1/summary.json" "$dir/block_1/point_cloud"
run 1 merge "$dir" -o "$temporary/merged"
reports "blocks/block_"
cp -r "$dir/block_1" "$temporary/again"
run 0 train "$room" -o "$temporary/again" --resume --quiet # plan, block and initial model: those of the run
check a_block_resumes_without_its_options test \
    "$(jq .model_hash "$temporary/straight/summary.json")" = "$(jq .model_hash "$temporary/again/summary.json")"
check blocks_resume bash -c 'bash "$0" "${@:2}" 2>"$1"' "$dir/blocks.sh" "$temporary/stderr" --iterations 90 --downscale 16 --eval
reports "block_1: resuming at iteration 60"
check resumed_block_has_the_same_bits test \
    "$(jq -r .model_hash "$dir/block_1/summary.json")" = "$(jq -r .model_hash "$temporary/straight/summary.json")"

# a_signal_ends_the_mixing_of_the_images (of full size with one thread, so that it takes long enough)
last_command="sparegs train --region and SIGTERM"
"$program" train "$room" -o "$temporary/stopped" --region "$dir/blocks.json:1" --init "$dir/coarse" --iterations 100000 --threads 1 \
    2>"$temporary/stderr" &
process=$!
for _ in $(seq 2400); do
    if grep -q "mixing the images" "$temporary/stderr" || ! kill -0 "$process" 2>/dev/null; then break; fi
    sleep 0.05
done
kill -TERM "$process"
status=0
wait "$process" || status=$?
check the_status_is_that_of_sigterm test "$status" -eq 143
reports "stopped: stopped before the first iteration; nothing was written"
check nothing_was_written test ! -e "$temporary/stopped"

# another_initial_model_is_refused
mv "$dir/coarse" "$dir/kept"
cp -r "$dir/block_0" "$dir/coarse"
run 1 train "$room" -o "$dir/block_1" --region "$dir/blocks.json:1" --init "$dir/coarse" --iterations 90 "${options[@]}" --resume
reports "block_1/config.json: the model of --init changed since the run started"
one_line
rm -r "$dir/coarse"
mv "$dir/kept" "$dir/coarse"

# signals_save_the_state_and_usr2_requeues_the_task (a scontrol that records its arguments stands in for Slurm's)
mkdir "$temporary/bin"
printf '#!/bin/bash\necho "$@" >"%s/requeued"\n' "$temporary" >"$temporary/bin/scontrol"
chmod +x "$temporary/bin/scontrol"
task() { # ID [NAME=VALUE...]: starts task 1 of the two blocks in the background
    env PATH="$temporary/bin:$PATH" COARSE="$dir/coarse" SLURM_JOB_ID="$1" SLURM_ARRAY_TASK_ID=1 "${@:2}" \
        bash "$temporary/json/blocks.sh" --iterations 100000 "${options[@]}" >/dev/null 2>"$temporary/stderr" &
    job=$!
}
stop_after() { # ITERATION SIGNAL: waits for it, then sends the signal to the shell only, as --signal=B:USR2 does
    for _ in $(seq 600); do
        if [ "$(tail -n 1 "$temporary/json/block_1/train.csv" 2>/dev/null | cut -d, -f1 | grep -x '[0-9]*' || echo 0)" -ge "$1" ]; then break; fi
        sleep 0.1
    done
    kill "-$2" "$job"
    status=0
    wait "$job" || status=$?
}
last_command="blocks.sh and SIGTERM" # of scancel
check the_signal_is_that_of_the_traps grep -qx '#SBATCH --signal=B:USR2@300' "$temporary/json/blocks.sh"
task 40
stop_after 100 TERM
check the_status_is_that_of_sigterm test "$status" -eq 143
check the_task_ends test ! -e "$temporary/requeued"
json "$temporary/json/block_1/summary.json" '.stop_reason == "signal" and .iterations >= 100'
# A program that saves from SIGUSR2 to SIGTERM.
printf '#!/bin/bash\ntrap "touch %s/saving" USR2\ntrap "exit 143" TERM\ntouch %s/begun\nwhile :; do sleep 0.02; done\n' \
    "$temporary" "$temporary" >"$temporary/bin/slow"
chmod +x "$temporary/bin/slow"
task 40 SPAREGS="$temporary/bin/slow"
until [ -e "$temporary/begun" ]; do sleep 0.02; done
kill -USR2 "$job"
until [ -e "$temporary/saving" ]; do sleep 0.02; done
kill -TERM "$job"
status=0
wait "$job" || status=$?
check a_task_that_is_cancelled_while_it_saves_ends test "$status" -eq 143 -a ! -e "$temporary/requeued"
last_command="blocks.sh and SIGUSR2" # before the time limit
first=$(jq .iterations "$temporary/json/block_1/summary.json")
task 41
stop_after $((first + 100)) USR2
check the_status_is_that_of_sigterm test "$status" -eq 143
check the_task_is_requeued grep -qx 'requeue 41' "$temporary/requeued"
json "$temporary/json/block_1/summary.json" ".stop_reason == \"signal\" and .iterations > $first"
first=$(jq .iterations "$temporary/json/block_1/summary.json")
# The last task of an array has the job ID of the array, by which scontrol would requeue all of its tasks.
task 42 SLURM_ARRAY_JOB_ID=42
stop_after $((first + 100)) USR2
check only_its_task_is_requeued grep -qx 'requeue 42_1' "$temporary/requeued"
json "$temporary/json/block_1/summary.json" ".iterations > $first"
json "$temporary/json/block_1/config.json" ".resumed[-1].iteration == $first"

# the_scene_may_be_a_copy, and its path any text
odd="$temporary/odd {scene} it's"
cp -r "$room" "$odd"
run 0 split "$odd" -o "$temporary/odd_blocks" --blocks 2
check odd_paths_are_quoted bash "$temporary/odd_blocks/coarse.sh" --iterations 10 "${options[@]}"
json "$temporary/odd_blocks/coarse/config.json" ".scene == \"$odd\""
check a_copy_is_read env SCENE="$room" SLURM_ARRAY_TASK_ID=0 bash "$temporary/odd_blocks/blocks.sh" --iterations 10 "${options[@]}"
json "$temporary/odd_blocks/block_0/config.json" ".scene == \"$room\""

# a_block_reads_its_views_only_and_keeps_the_split_of_the_scene
json "$dir/block_0/config.json" '.block.index == 0 and (.block.scene_hash | length) == 16 and (.options.region | startswith("-inf"))'
held_out=$("$program" eval "$dir/coarse" "$room" --downscale 16 --eval --json 2>/dev/null | jq -c '[.images[].name]')
for block in 0 1 2; do
    json "$dir/block_$block/config.json" ".test_images - $held_out == []"
    check cameras_are_those_of_the_plan test "$(jq length "$dir/block_$block/cameras.json")" -eq \
        "$(jq ".blocks[$block].views | length" "$dir/blocks.json")"
    json "$dir/block_$block/summary.json" '.region_gaussians > 0 and .region_gaussians < .gaussians'
done

# merged_model_has_the_own_primitives_of_each_block
run 0 merge "$dir" -o "$temporary/merged"
prints "seams: PSNR"
prints "3 blocks,"
own=$(jq -s 'map(.region_gaussians) | add' "$dir"/block_?/summary.json)
json "$temporary/merged/summary.json" ".gaussians == $own and (.block_gaussians | add) == $own and .seams.images == ($held_out | length)"
json "$temporary/merged/summary.json" '.seams.psnr_seam > 5 and .seams.reference_psnr_rest > 5 and (.seams.loss | type) == "number"'
json "$temporary/merged/config.json" ".options.region == \"none\" and .merged.blocks == 3 and .block == null and .test_images == $held_out"
run 0 eval "$temporary/merged" "$room" --json
json "$temporary/stdout" "[.images[].name] == $held_out and .mean.psnr > 10"
run 0 info "$temporary/merged" --json
run 0 render "$temporary/merged" "$room" --view "$(jq -r '.[0]' <<<"$held_out")" -o "$temporary/frames" --format png
touch "$temporary/merged/config.json.tmp.77" "$temporary/merged/frame.tmp.0001"
run 1 merge "$dir" -o "$temporary/merged"
reports "merged: already contains a run; replace it with --overwrite"
check a_refused_merge_removes_nothing test -e "$temporary/merged/config.json.tmp.77" -a -e "$temporary/merged/frame.tmp.0001"
run 0 merge "$dir" "$room" -o "$temporary/merged" --overwrite --seam-images 2 --seam-reference none --json
check leftovers_of_a_killed_merge_are_removed test ! -e "$temporary/merged/config.json.tmp.77" -a -e "$temporary/merged/frame.tmp.0001"
json "$temporary/stdout" '.seams.images == 2 and .seams.reference_psnr_seam == null'
check stdout_is_the_summary test "$(jq -Sc . "$temporary/stdout")" = "$(jq -Sc . "$temporary/merged/summary.json")"
run 0 merge "$dir" -o "$temporary/without" --seam-images 0
run 2 merge "$dir" -o "$temporary/idle" --seam-images 0 --seam-reference none
json "$temporary/without/summary.json" '.seams == null'
# merge_does_not_replace_its_inputs
inputs() { (cd "$dir" && find . -type f ! -name .lock -exec sha256sum {} + | LC_ALL=C sort); }
before=$(inputs)
ln -s "$dir/block_1" "$temporary/linked_block"
for case in "$dir/block_0:is a block of this command" "$dir/../blocks/block_2/:is a block of this command" \
    "$temporary/linked_block:is a block of this command" "$dir/coarse:is the model that the blocks started from"; do
    run 1 merge "$dir" -o "${case%%:*}" --overwrite --seam-images 0
    one_line
    path=${case%%:*}
    reports "${path%/}: ${case#*:}; choose another folder with -o"
done
run 1 merge "$dir" -o "$temporary/merged" --overwrite --seam-reference "$temporary/merged"
reports "merged: is the model of --seam-reference; choose another folder with -o"
check the_inputs_are_intact test "$before" = "$(inputs)"
# a_moved_folder_of_blocks_is_complete: its coarse model is found, its scripts and --resume work there
compared=$(jq -c .seams "$temporary/merged/summary.json")
mv "$dir" "$temporary/moved"
run 0 merge "$temporary/moved" "$room" -o "$temporary/from_moved" --seam-images 2 --json
json "$temporary/stdout" '.seams.reference_psnr_seam > 5 and '"$compared"'.psnr_seam == .seams.psnr_seam'
check the_moved_script_continues env SLURM_ARRAY_TASK_ID=0 bash "$temporary/moved/blocks.sh" --iterations 90 "${options[@]}"
# Slurm runs copies of the scripts in a folder of its own.
mkdir "$temporary/spool"
for script in coarse blocks; do
    cp "$temporary/moved/$script.sh" "$temporary/spool/slurm_script"
    last_command="a copy of $script.sh"
    check a_copy_finds_the_blocks env SLURM_SUBMIT_DIR="$temporary/moved" SLURM_ARRAY_TASK_ID=0 \
        bash "$temporary/spool/slurm_script" --iterations 90 "${options[@]}"
    for place in "SLURM_SUBMIT_DIR=$temporary" SLURM_SUBMIT_DIR=; do
        status=0
        env "$place" bash "$temporary/spool/slurm_script" --iterations 90 "${options[@]}" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
        check it_ends_without_blocks test "$status" -eq 1 -a "$(wc -l <"$temporary/stderr")" -eq 1
        reports "$dir: no blocks.json here or in $temporary"
    done
done
check nothing_was_trained_elsewhere test ! -e "$temporary/spool/coarse" -a ! -e "$temporary/coarse" -a ! -e "$temporary/block_0" -a ! -e "$dir"
mv "$temporary/moved/coarse" "$temporary/gone"
run 0 merge "$temporary/moved" "$room" -o "$temporary/from_moved" --seam-images 2 --json --overwrite
reports "the model that the blocks started from is missing or was retrained"
json "$temporary/stdout" '.seams.reference_psnr_seam == null'
mv "$temporary/gone" "$temporary/moved/coarse"
mv "$temporary/moved" "$dir"
run 1 merge "$dir" -o "$temporary/no" --seam-reference "$temporary/nowhere" --quiet
one_line
reports "nowhere: no such model"
check nothing_was_merged test ! -e "$temporary/no"

# other_blocks_are_refused
mv "$dir/block_2" "$dir/block_9"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_2: block 2 of 3 is missing"
mv "$dir/block_9" "$dir/block_2"
mv "$dir/block_1/summary.json" "$temporary/kept.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: block 1 is unfinished: summary.json does not exist"
jq '.stop_reason = "signal"' "$temporary/kept.json" >"$dir/block_1/summary.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: is unfinished (stopped by: signal); continue it with --resume"
mv "$temporary/kept.json" "$dir/block_1/summary.json"
cp "$dir/block_1/config.json" "$temporary/config.json"
jq '.block.scene_hash = "0123456789abcdef"' "$temporary/config.json" >"$dir/block_1/config.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: was trained on a scene other than that of"
jq '.options.region = "0,0,0,1,1,1"' "$temporary/config.json" >"$dir/block_1/config.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: its box differs from that of block 1"
jq '.options.filter = "none"' "$temporary/config.json" >"$dir/block_1/config.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: option filter differs from that of block 0"
sed -E 's/("init_hash": ")[0-9a-f]+/\10123456789abcdef/' "$temporary/config.json" >"$dir/block_1/config.json"
run 1 merge "$dir" -o "$temporary/no"
reports "blocks/block_1: initial model differs from that of $dir/block_0; retrain one of them"
one_line
# held_out_images_are_those_of_all_blocks, and of the coarse model
hold_out_nothing() { sed -Ez 's/("test_images": \[)[^]]*\]/\1]/' "$temporary/config.json"; }
hold_out_nothing >"$dir/block_1/config.json"
run 1 merge "$dir" -o "$temporary/no" --seam-images 0
reports "blocks/block_1: was trained on "
reports " held-out images of the merged model; train all blocks with the same --eval, --test-every or --test-images"
one_line
cp "$temporary/config.json" "$dir/block_1/config.json"
cp "$dir/coarse/config.json" "$temporary/config.json"
hold_out_nothing >"$dir/coarse/config.json"
run 0 merge "$dir" -o "$temporary/seen" --seam-images 0
reports "blocks/coarse: the model that the blocks started from was trained on $(jq length <<<"$held_out") of the "
one_line
cp "$temporary/config.json" "$dir/coarse/config.json"
run 0 merge "$dir" -o "$temporary/seen" --seam-images 0 --overwrite
check no_warning test "$(grep -c warning "$temporary/stderr")" = 0
# the_start_is_found_in_a_moved_folder, also if another model has its former name
start=$(jq -r .options.init "$dir/block_0/config.json") # where block 0 was resumed
check it_was_elsewhere test "$start" != "$dir/coarse" -a ! -e "$start"
mkdir "${start%/*}"
cp -r "$dir/block_0" "$start"
hold_out_nothing >"$dir/coarse/config.json"
for seams in 0 2; do
    run 0 merge "$dir" "$room" -o "$temporary/start_$seams" --seam-images $seams --json
    reports "blocks/coarse: the model that the blocks started from was trained on $(jq length <<<"$held_out") of the "
done
json "$temporary/stdout" '.seams.reference_psnr_seam > 5'
rm -r "${start%/*}"
cp "$temporary/config.json" "$dir/coarse/config.json"
# a_deleted_start_is_looked_for_in_the_folder_of_blocks, then is a warning: a file, a folder without models
cp "$dir/block_0/config.json" "$temporary/block_0.json"
mkdir -p "$temporary/emptied/point_cloud"
for start in "$temporary/deleted.ply" "$temporary/emptied"; do
    sed -E "s|(\"init\": \")[^\"]*|\1$start|" "$temporary/block_0.json" >"$dir/block_0/config.json"
    json "$dir/block_0/config.json" ".options.init == \"$start\""
    run 0 merge "$dir" -o "$temporary/deleted" --seam-images 0 --overwrite
    check no_warning test "$(grep -c warning "$temporary/stderr")" = 0
    run 0 merge "$dir" "$room" -o "$temporary/deleted" --seam-images 2 --overwrite --json
    json "$temporary/stdout" '.seams.reference_psnr_seam > 5'
    mv "$dir/coarse" "$temporary/gone"
    run 0 merge "$dir" -o "$temporary/deleted" --seam-images 0 --overwrite
    run 0 merge "$dir" "$room" -o "$temporary/deleted" --seam-images 2 --overwrite --json
    reports "$start: the model that the blocks started from is missing or was retrained"
    check only_one_warning test "$(grep -c warning "$temporary/stderr")" = 1 -a "$(grep -c error "$temporary/stderr")" = 0
    json "$temporary/stdout" '.seams.reference_psnr_seam == null'
    mv "$temporary/gone" "$dir/coarse"
done
cp "$temporary/block_0.json" "$dir/block_0/config.json"
# a_reference_has_its_own_colour_maps
run 0 split "$room" -o "$temporary/exposed" --blocks 2
for script in coarse blocks; do
    last_command="$script.sh --exposure"
    check it_trains bash "$temporary/exposed/$script.sh" --iterations 20 --downscale 16 --exposure --quiet
done
run 0 merge "$temporary/exposed" -o "$temporary/bright" --seam-images 3
for block in 0 1; do
    file=$temporary/exposed/block_$block/exposure.json
    jq 'map_values(map(map(. / 2)))' "$file" >"$temporary/dark.json"
    mv "$temporary/dark.json" "$file"
done
run 0 merge "$temporary/exposed" -o "$temporary/dark" --seam-images 3
check the_reference_is_as_bright test "$(jq .seams.reference_psnr_rest "$temporary/bright/summary.json")" = \
    "$(jq .seams.reference_psnr_rest "$temporary/dark/summary.json")"
check the_blocks_are_darker jq -en --slurpfile a "$temporary/bright/summary.json" --slurpfile b "$temporary/dark/summary.json" \
    '$a[0].seams.psnr_rest > $b[0].seams.psnr_rest + 1'
jq '.scene_hash = "0123456789abcdef"' "$dir/blocks.json" >"$temporary/json/blocks.json"
run 1 train "$room" -o "$temporary/no" --region "$temporary/json/blocks.json:0" --init "$dir/coarse" "${options[@]}"
reports "json/blocks.json: the plan does not match the scene"
for bad in '{}' '{"schema":1,"scene_hash":"0123456789abcdef","blocks":[{},{}]}' 'x'; do
    echo "$bad" >"$temporary/json/blocks.json"
    run 1 merge "$temporary/json" -o "$temporary/no"
    reports "json/blocks.json"
    one_line
done
run 1 merge "$temporary/nowhere" -o "$temporary/no"
reports "nowhere/blocks.json"
check nothing_was_written test ! -e "$temporary/no"

# a_box_is_a_region_too
run 0 train "$room" -o "$temporary/box" --init "$dir/coarse" --region -inf,-inf,-inf,0,inf,inf --iterations 30 "${options[@]}"
json "$temporary/box/summary.json" '.region_gaussians > 0 and .region_gaussians < .gaussians'
json "$temporary/box/config.json" '.options.region == "-inf,-inf,-inf,0,inf,inf" and .block == null'
run 2 train "$room" -o "$temporary/no" --region 0,0,0,1,1,1
reports "--region requires --init"
usage() { # MESSAGE REGION
    run 2 train "$room" -o "$temporary/no" --init "$dir/coarse" --region "$2"
    reports "--region: $1"
    one_line
}
usage "'0,0,0,1,1' is neither a box" 0,0,0,1,1
usage "'0,0,0,1,1,1,1' is neither a box" 0,0,0,1,1,1,1
usage "'0,0,0,1,nan,1' is neither a box" 0,0,0,1,nan,1
usage "region must have a lower bound below" 0,0,2,1,1,1
usage "'plan:x' is not PLAN:K" plan:x
usage "'plan:-1' is not PLAN:K" plan:-1
run 1 train "$room" -o "$temporary/no" --init "$dir/coarse" --region "$dir/blocks.json:3" "${options[@]}"
reports "blocks.json: has no block 3; its blocks are 0 to 2"
run 1 train "$room" -o "$temporary/no" --init "$dir/coarse" --region 1e8,1e8,1e8,2e8,2e8,2e8 "${options[@]}"
reports "no centre of the initial model is in the region"
run 2 train "$room" -o "$temporary/no" --init "$dir/coarse" --region 0,0,0,1,1,1 --pipeline taming --taming-opacity linear
reports "--taming-opacity linear and --region are mutually exclusive"
check nothing_was_written test ! -e "$temporary/no"

finish
