#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs train SCENE -o OUT --resume: options that are not repeated have the recorded values, to the last bit; options that
# are given must agree; a damaged record is one line of error and changes nothing.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
hash_of() { jq -r .model_hash "$1/summary.json"; }
# rewind RUN: as if the run had been killed after its last checkpoint but one.
rewind() {
    cp "$1/checkpoint/state.previous.bin" "$1/checkpoint/state.bin"
    rm -r "$1/point_cloud" "$1/summary.json"
}
# cut_run NAME OPTION...: trains, goes back to iteration 40 of 60 and continues without the options.
cut_run() {
    run 0 train "$room" -o "$temporary/$1" --iterations 60 --downscale 16 --checkpoint-every 20 --quiet "${@:2}"
    hash=$(hash_of "$temporary/$1")
    cp "$temporary/$1/config.json" "$temporary/before.json"
    rewind "$temporary/$1"
    run 0 train "$room" -o "$temporary/$1" --resume --quiet
    check "${1}_has_the_same_bits" test "$(hash_of "$temporary/$1")" = "$hash"
    check "${1}_has_the_same_options" cmp <(jq .options "$temporary/before.json") <(jq .options "$temporary/$1/config.json")
    json "$temporary/$1/config.json" '.resumed[0] == {"iteration": 40, "changed_from": {}}'
}

# the_recorded_options_are_used
cut_run many --pipeline mcmc --mcmc-noise 100.123456789012 --mcmc-units world --max-gaussians 900 --sh-degree 2 --seed 7 \
    --ssim-weight 0.234567890123 --ssim-sigma 1.25 --batch 2 --background random --exposure --spare bmd,rap --spare-grid 8 \
    --spare-demand h,v --filter none --optimizer dense --compact-box 0.9 --test-every 5 --schedule paper --images images
json "$temporary/many/config.json" '.precise == {"ssim_weight": "0.234567890123", "mcmc_noise": "100.123456789012"}'
cut_run opaque --opaque --eval --pipeline taming --taming-count 1200 --spare off
cut_run white --background 1,1,1 --test-images 0001.jpg,0005.jpg --pipeline mip
json "$temporary/white/config.json" '.test_images == ["0001.jpg", "0005.jpg"]'
cut_run region --init "$temporary/white" --region=-inf,-inf,-inf,0.5,inf,inf
cut_run linear --train-space linear --alpha ignore --white 1.23456789012345

# a_measured_white_point_is_recorded_to_the_last_bit
cp -r "$room" "$temporary/hdr"
rm "$temporary"/hdr/images/*
oiiotool --frames 1-35 "$room/images/%04d.jpg" --tocolorspace linear --mulc 1.7 -d half -o "$temporary/hdr/images/%04d.exr"
sed -i 's/\.jpg/.exr/g' "$temporary/hdr/sparse/0/images.bin"
room=$temporary/hdr cut_run measured --train-space linear
json "$temporary/measured/config.json" '.options.white != 1 and (.precise.white | type) == "string"'

# an_option_that_is_given_must_agree; its condition may be a recorded option
run 1 train "$room" -o "$temporary/many" --resume --seed 8 --quiet
reports "--seed was 7 when the run started and is 8 now"
one_line
run 0 train "$room" -o "$temporary/many" --resume --mcmc-units world --quiet
run 1 train "$room" -o "$temporary/many" --resume --mcmc-units extent --quiet
reports "--mcmc-units was world when the run started and is extent now"
run 2 train "$room" -o "$temporary/many" --resume --taming-count 100 --quiet
reports "--taming-count requires --pipeline taming"
one_line
run 2 train "$room" -o "$temporary/many" --resume --save-at 61 --quiet
reports "--save-at: the run ends at iteration 60"

# the_options_of_the_output_are_kept: --save-at, --checkpoint-every and --lpips, whose weights must exist
run 0 train "$room" -o "$temporary/kept" --iterations 60 --downscale 16 --save-at 30,50 --checkpoint-every 20 --quiet
json "$temporary/kept/config.json" '.checkpoint_every_given and .lpips == null and .lpips_input == "unit"'
rewind "$temporary/kept"
run 0 train "$room" -o "$temporary/kept" --resume --quiet
json "$temporary/kept/config.json" '.save_at == [30, 50] and .checkpoint_every == 20 and .checkpoint_every_given'
check the_model_of_iteration_50_is_saved test -s "$temporary/kept/point_cloud/iteration_50/point_cloud.ply"
run 0 train "$room" -o "$temporary/kept" --resume --save-at 55 --checkpoint-every 0 --quiet
json "$temporary/kept/config.json" '.save_at == [55] and .checkpoint_every == 0'
run 0 train "$room" -o "$temporary/kept" --resume --quiet
json "$temporary/kept/config.json" '.save_at == [55] and .checkpoint_every == 0'
jq --arg file "$temporary/gone.bin" '.lpips = $file | .lpips_input = "signed"' "$temporary/kept/config.json" \
    >"$temporary/weights.json"
cp "$temporary/weights.json" "$temporary/kept/config.json"
run 1 train "$room" -o "$temporary/kept" --resume --quiet
reports "config.json: the LPIPS weights of the run, $temporary/gone.bin, do not exist; specify their file with --lpips FILE"
one_line
check the_record_stays cmp "$temporary/weights.json" "$temporary/kept/config.json"
echo "no weights" >"$temporary/gone.bin"
run 1 train "$room" -o "$temporary/kept" --resume --quiet
reports "$temporary/gone.bin"
one_line
jq 'del(.checkpoint_every_given, .lpips, .lpips_input) | .checkpoint_every = 1000' "$temporary/weights.json" \
    >"$temporary/kept/config.json" # of an earlier version
run 0 train "$room" -o "$temporary/kept" --resume --quiet
json "$temporary/kept/config.json" '.checkpoint_every == 1000 and (.checkpoint_every_given | not) and .lpips == null'

# a_model_is_refined_in_its_own_folder: the run continues although --overwrite has moved the model that it began from
place=$temporary/place
refine=("$room" --pipeline mip --iterations 30 --downscale 16 --checkpoint-every 10 --quiet)
run 0 train "${refine[@]}" -o "$place"
cp -r "$place" "$temporary/start"
run 0 train "${refine[@]}" -o "$temporary/elsewhere" --init "$temporary/start"
run 0 train "${refine[@]}" -o "$place" --init "$place" --overwrite
hash=$(hash_of "$temporary/elsewhere")
check the_model_is_that_of_another_folder test "$(hash_of "$place")" = "$hash"
json "$place/config.json" ".options.init == \"$place/previous\""
init=$(jq -r .init_hash "$temporary/elsewhere/config.json")
cp "$place/input.ply" "$temporary/input.ply"
continues() { # NAME OPTION...: with the same result
    run 0 train "$room" -o "$place" --resume --quiet "${@:2}"
    check "the_model_is_the_same: $1" test "$(hash_of "$place")" = "$hash"
    json "$place/config.json" ".init_hash == \"$init\" and (.options.init | startswith(\"$place/previous\"))"
    check "input_ply_is_the_same: $1" cmp "$place/input.ply" "$temporary/input.ply"
}
cp "$place/checkpoint/state.previous.bin" "$place/checkpoint/state.bin"
continues a_new_model_is_in_its_place
rewind "$place"
continues killed --init "$place" # the options are repeated
continues the_file_is_named --init "$place/point_cloud/iteration_30/point_cloud.ply"
json "$place/config.json" ".options.init == \"$place/previous/point_cloud/iteration_30/point_cloud.ply\""
rm -r "$place/checkpoint" "$place/point_cloud" "$place/summary.json"
continues without_a_checkpoint
mv "$place/previous" "$temporary/previous"
rewind "$place"
continues the_model_was_deleted

# without_a_checkpoint the initial model must be the same
rm -r "$place/checkpoint" "$place/point_cloud" "$place/summary.json"
cp -r "$temporary/elsewhere" "$place/previous"
cp "$place/config.json" "$temporary/before.json"
run 1 train "$room" -o "$place" --resume --quiet
one_line
reports "place/config.json: the model of --init changed since the run started; resume with the same model"
check the_record_stays cmp "$place/config.json" "$temporary/before.json"

# a_model_that_overwrite_would_delete_is_refused
cp -r "$temporary/elsewhere" "$temporary/start/previous"
run 1 train "${refine[@]}" -o "$temporary/start" --init "$temporary/start/previous/point_cloud/iteration_30" --overwrite
one_line
reports "iteration_30: --overwrite deletes this initial model with $temporary/start/previous; move it away, or choose another folder with -o"
check both_runs_stay test -s "$temporary/start/summary.json" -a -s "$temporary/start/previous/summary.json"
rm -r "$temporary/start/point_cloud" "$temporary/start/checkpoint" "$temporary/start/summary.json" # without results
run 0 train "${refine[@]}" -o "$temporary/start" --init "$temporary/start/previous" --overwrite
check the_model_stays test -s "$temporary/start/previous/summary.json"

# an_option_that_may_change is changed alone
run 0 train "$room" -o "$temporary/many" --resume --iterations 62 --quiet
json "$temporary/many/config.json" '.resumed[-1].changed_from == {"iterations": 60} and .options.max_gaussians == 900'

# a_run_that_trains_further_has_no_summary_until_its_end; one that fails before its first iteration keeps it
further=$temporary/further
run 0 train "$room" -o "$further" --schedule paper --iterations 20 --downscale 16 --spare off --quiet
cp "$further/summary.json" "$temporary/summary.json"
run 1 train "$room" -o "$further" --resume --sh-degree 1 --quiet
check a_failure_keeps_the_summary cmp "$further/summary.json" "$temporary/summary.json"
last_command="train --resume --iterations 1000000, then SIGKILL"
"$program" train "$room" -o "$further" --resume --iterations 1000000 --checkpoint-every 0 --quiet >"$temporary/stdout" 2>"$temporary/stderr" &
process=$!
for _ in $(seq 600); do
    if grep -q '^100,' "$further/train.csv" || ! kill -0 "$process" 2>/dev/null; then break; fi
    sleep 0.1
done
kill -KILL "$process"
wait "$process" 2>/dev/null
check it_has_trained grep -q '^100,' "$further/train.csv"
check there_is_no_summary test ! -e "$further/summary.json"
run 0 train "$room" -o "$further" --resume --iterations 25 --quiet
json "$further/summary.json" '.iterations == 25 and .stop_reason == "schedule"'

# a_damaged_record_is_refused and stays
jq '.options.sh_degree = "high"' "$temporary/many/config.json" >"$temporary/damaged.json"
cp "$temporary/damaged.json" "$temporary/many/config.json"
run 1 train "$room" -o "$temporary/many" --resume --quiet
reports "$temporary/many/config.json: --sh-degree: 'high' is not a whole number from 0 to 3"
one_line
check the_record_stays cmp "$temporary/damaged.json" "$temporary/many/config.json"
jq '.options = null' "$temporary/damaged.json" >"$temporary/many/config.json"
run 1 train "$room" -o "$temporary/many" --resume --quiet
reports "was not recorded when the run started"
one_line

finish
