#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs prune: counts and quality of the outputs, scores, several ratios, fine-tuning, the same bits with any number of
# threads, and messages for incomplete command lines.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
model=$temporary/model
run 0 train "$room" -o "$model" --downscale 8 --iterations 100 --spare off --quiet
input=$(jq .gaussians "$model/summary.json")
psnr() { "$program" eval "$1" "$room" --downscale 8 --split train --json 2>/dev/null | jq .mean.psnr; }
above() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a > b) }'; }

# several_ratios_make_a_folder (the number of primitives is exact)
run 0 prune "$model" -o "$temporary/refine" --method refine --ratio 0.3,0.50,0.7 --json
json "$temporary/stdout" ".method == \"refine\" and .input == $input and [.outputs[].ratio] == [0.3, 0.5, 0.7]"
json "$temporary/stdout" "[.outputs[].gaussians] == [0.3, 0.5, 0.7 | $input - ($input * . | floor)]"
check files_are_named_as_given test "$(cd "$temporary/refine" && echo *)" = 'prune_0.3.ply prune_0.50.ply prune_0.7.ply'
check bytes_are_those_of_the_file test "$(jq '.outputs[2].bytes' "$temporary/stdout")" = "$(stat -c %s "$temporary/refine/prune_0.7.ply")"

# lightgaussian_writes_scores
run 0 prune "$model" "$room" -o "$temporary/light.ply" --method lightgaussian --ratio 0.7 --scores "$temporary/light.csv" --threads 1
prints "light.ply:"
check a_row_for_each_primitive test "$(wc -l <"$temporary/light.csv")" -eq $((input + 1))
check has_a_header test "$(head -1 "$temporary/light.csv")" = primitive,score
run 0 prune "$model" "$room" -o "$temporary/light2.ply" --method lightgaussian --ratio 0.7 --scores "$temporary/light2.csv" --threads 3
check the_same_scores_with_three_threads cmp "$temporary/light.csv" "$temporary/light2.csv"
check the_same_model_with_three_threads cmp "$temporary/light.ply" "$temporary/light2.ply"
run 0 prune "$model" --scores "$temporary/only.csv" --method refine
check scores_alone_write_no_model test "$(find "$temporary" -maxdepth 1 -name '*.ply' | wc -l)" -eq 2

# pup_scores_at_reduced_size
run 0 prune "$model" "$room" -o "$temporary/pup.ply" --method pup --ratio 0.5 --scores "$temporary/pup4.csv" --threads 1
run 0 prune "$model" "$room" -o "$temporary/pup3.ply" --method pup --ratio 0.5 --threads 3 --quiet
check the_same_model_with_three_threads cmp "$temporary/pup.ply" "$temporary/pup3.ply"
run 0 prune "$model" "$room" --method pup --fisher-downscale 2 --scores "$temporary/pup2.csv" --quiet
check the_size_changes_the_scores bash -c "! cmp -s '$temporary/pup4.csv' '$temporary/pup2.csv'"
check pup_keeps_the_image above "$(psnr "$temporary/pup.ply")" 10

# run_gives_a_derived_model_the_options_of_its_run: size, split, filter and background
run 0 train "$room" -o "$temporary/base" --downscale 8 --eval --iterations 30 --background 0.2,0.4,0.9 --filter none --quiet
base=$temporary/base
cp "$base/point_cloud/iteration_30/point_cloud.ply" "$temporary/derived.ply"
like_its_run() { # SUFFIX COMMAND ARGUMENT...: the same file of the run and of the derived model, another one without --run
    run 0 "$2" "$base" "${@:3}" -o "$temporary/of_run.ply" --quiet
    run 0 "$2" "$temporary/derived.ply" "${@:3}" --run "$base" -o "$temporary/of_derived.ply" --quiet
    check "$2_as_of_the_run" cmp "$temporary/of_run.ply$1" "$temporary/of_derived.ply$1"
    run 0 "$2" "$temporary/derived.ply" "${@:3}" -o "$temporary/of_file.ply" --quiet
    check "$2_without_it_differs" bash -c "! cmp -s '$temporary/of_run.ply$1' '$temporary/of_file.ply$1'"
    rm -r "$temporary"/of_*
}
like_its_run /0001.png render "$room" --view 0001 --format png
like_its_run "" prune "$room" --method lightgaussian --ratio 0.5
pup_scores() { # NAME MODEL OPTION...
    run 0 prune "$2" "$room" --method pup --scores "$temporary/pup_$1.csv" --quiet "${@:3}"
    check "no_option_of_$1_is_idle" test ! -s "$temporary/stderr"
}
pup_scores run "$base"
pup_scores same "$base" --background 0.2,0.4,0.9
pup_scores black "$base" --background 0,0,0
check pup_uses_the_background_of_the_run cmp "$temporary/pup_run.csv" "$temporary/pup_same.csv"
check the_background_changes_its_scores bash -c "! cmp -s '$temporary/pup_run.csv' '$temporary/pup_black.csv'"
run 0 prune "$base" "$room" --method lightgaussian --scores "$temporary/x.csv" --background 0,0,0 --quiet
reports "--background has no effect without --finetune: only --method pup reads it"
like_its_run "" compress "$room" --method lightgaussian --keep 0.5 --finetune 0 --vq-steps 10
for name in base derived.ply; do
    run 0 profile "$temporary/$name" "$room" --run "$base" --views 1 --refits 1 --repeat 1 --samples 0 --json
    jq '.view | [.rays, .hits]' "$temporary/stdout" >"$temporary/$name.views"
done
check profile_as_of_the_run cmp "$temporary/base.views" "$temporary/derived.ply.views"
run 0 view "$temporary/derived.ply" "$room" --run "$base" --export "$temporary/of_run.html" --quiet
run 0 view "$temporary/derived.ply" "$room" --export "$temporary/of_file.html" --quiet
check view_without_it_differs bash -c "! cmp -s '$temporary/of_run.html' '$temporary/of_file.html'"
none=(-o "$temporary/none.ply")
for arguments in "render ${none[*]}" "profile ${none[*]}" "prune --method pup --ratio 0.5 ${none[*]}" "compress --method mesongs -o $temporary/none.bin" view; do
    # shellcheck disable=SC2086 # several arguments
    run 1 $arguments "$temporary/derived.ply" "$room" --run "$temporary/derived.ply"
    reports "derived.ply: not a run folder: config.json does not exist or is damaged"
    one_line
done
check nothing_was_written test ! -e "$temporary/none.ply" -a ! -e "$temporary/none.bin"

# rap_takes_the_weights_of_the_user (random ones here); its features need none
weights=$SPAREGS_SOURCE/tests/fuzz/corpus/rap_network/valid
run 0 prune "$model" --method rap --weights "$weights" -o "$temporary/rap" --ratio 0.3,0.7 --features "$temporary/rap.csv" --json
json "$temporary/stdout" "[.outputs[].gaussians] == [0.7, 0.3 | $input * . | floor]"
run 0 prune "$model" --method rap --features "$temporary/rap3.csv" --threads 3
check the_same_features_with_three_threads cmp "$temporary/rap.csv" "$temporary/rap3.csv"
check features_have_names test "$(head -1 "$temporary/rap.csv" | tr ',' '\n' | wc -l)" -eq 16
check features_are_shares awk -F, 'NR > 1 { for (k = 2; k <= NF; ++k) bad += $k < 0 || $k > 1 } END { exit bad > 0 || NR < 2 }' "$temporary/rap.csv"
run 2 prune "$model" --method rap -o "$temporary/x.ply" --ratio 0.5
reports "--method rap requires --weights FILE, the network of RAP's authors (net_f15.pth), which is not part of sparegs"
one_line
run 1 prune "$model" --method rap --weights "${weights%valid}missing" -o "$temporary/x.ply" --ratio 0.5
reports "missing: a tensor is missing; expected the network file of RAP's authors (net_f15.pth)"
run 1 prune "$model" --method rap --weights "$temporary/nothing" -o "$temporary/x.ply" --ratio 0.5
reports "nothing"

# pruning_without_training_costs_quality
full=$(psnr "$model") half=$(psnr "$temporary/refine/prune_0.50.ply")
check pruning_costs_quality above "$full" "$half"

# fine_tuning_does_not_apply_the_3d_filter_twice: the stored model of Mip-Splatting includes it
run 0 train "$room" -o "$temporary/mip" --downscale 8 --eval --iterations 60 --pipeline mip --spare off --quiet
run 0 prune "$temporary/mip" "$room" -o "$temporary/mip.ply" --method lightgaussian --ratio 0 --finetune 1 --quiet
for name in mip mip.ply; do
    run 0 eval "$temporary/$name" "$room" --run "$temporary/mip" --json
    jq .mean "$temporary/stdout" >"$temporary/$name.mean"
done
check one_iteration_changes_little jq -ne --slurpfile a "$temporary/mip.mean" --slurpfile b "$temporary/mip.ply.mean" \
    '($a[0].psnr - $b[0].psnr | fabs) < 0.1 and ($a[0].sharpness - $b[0].sharpness | fabs) < 0.01'

# finetuning_recovers_quality_and_keeps_the_number
run 0 prune "$model" "$room" -o "$temporary/tuned.ply" --method refine --ratio 0.5 --finetune 60 --seed 2 --quiet --json
check the_seed_is_used bash -c "! grep 'has no effect' '$temporary/stderr'"
json "$temporary/stdout" ".outputs[0].gaussians == ($input - ($input * 0.5 | floor))"
check finetuning_helps above "$(psnr "$temporary/tuned.ply")" "$(awk "BEGIN { print $half + 1 }")"

# incomplete_command_lines
usage() { # MESSAGE ARGUMENT...
    local message=$1
    shift
    run 2 prune "$@"
    reports "$message"
    one_line
}
usage "prune requires --method" "$model" -o "$temporary/x.ply" --ratio 0.5
usage "prune requires an output, -o OUT, --scores FILE or --features FILE" "$model" --method refine
usage "-o requires --ratio R" "$model" --method refine -o "$temporary/x.ply"
usage "--ratio: '1' is not a share from 0 to less than 1" "$model" --method refine -o "$temporary/x.ply" --ratio 0.5,1
usage "--ratio: '' is not a share" "$model" --method refine -o "$temporary/x.ply" --ratio 0.5,
usage "--ratio: 'nan' is not a share" "$model" --method refine -o "$temporary/x.ply" --ratio nan
usage "-o $temporary/x.ply: several ratios require a folder; give one ratio, or a name without a model extension" "$model" \
    --method refine -o "$temporary/x.ply" --ratio 0.3,0.5
usage "--ratio: 0.50 is given twice" "$model" --method refine -o "$temporary/x.ply" --ratio 0.5,0.50
usage "x.xyz: the name has no known extension; use .ply," "$model" --method refine -o "$temporary/x.xyz" --ratio 0.5
usage "x.html: a page cannot be read as a model" "$model" --method refine -o "$temporary/x.html" --ratio 0.5
usage "--method lightgaussian requires the argument SCENE" "$model" --method lightgaussian -o "$temporary/x.ply" --ratio 0.5
usage "--method pup requires the argument SCENE" "$model" --method pup -o "$temporary/x.ply" --ratio 0.5
usage "--finetune requires the argument SCENE" "$model" --method refine -o "$temporary/x.ply" --ratio 0.5 --finetune 9
usage "--downscale has no effect without SCENE" "$model" --method refine -o "$temporary/x.ply" --ratio 0.5 --downscale 2
run 0 prune "$model" "$room" -o "$temporary/near.ply" --method refine --ratio 0.5 --finetune 1 --near 0.1 --downscale 8
reports "--near has no effect on --finetune, which trains with the near distance of the scene"
run 0 prune "$model" "$room" --method refine --scores "$temporary/x.csv" --filter none --seed 2
reports "--seed has no effect without --finetune"
reports "--filter has no effect on a score that renders no views"
run 0 prune "$model" "$room" --method refine -o "$temporary/mip.ply" --ratio 0.5 --filter mip
check no_warning test ! -s "$temporary/stderr"
check the_filter_is_recorded grep -aq '^comment SplatRenderMode: mip$' "$temporary/mip.ply"
run 0 prune "$model/point_cloud/"iteration_* --method refine -o "$temporary/folder.ply" --ratio 0.3 # cameras of its run
check the_pruned_model_is_that_of_the_run cmp "$temporary/folder.ply" "$temporary/refine/prune_0.3.ply"
run 1 prune "$temporary/light.ply" --method refine -o "$temporary/x.ply" --ratio 0.5
reports "light.ply: no cameras: give SCENE, or a run folder with cameras.json"
one_line
run 1 prune "$model" --method refine -o "$temporary/none/x.ply" --ratio 0.5 --scores /proc/x.csv
reports "/proc/x.csv"
check an_error_leaves_no_model test ! -e "$temporary/none"
run 1 prune "$model" --method refine -o /proc/none/x.ply --ratio 0.5 --scores "$temporary/y.csv"
reports "/proc/none/x.ply: cannot be written: /proc: "
one_line
check the_output_is_checked_before_the_work test ! -e "$temporary/y.csv"
run 1 prune "$temporary/nowhere" --method refine -o "$temporary/x.ply" --ratio 0.5
reports "nowhere"
check nothing_was_written test ! -e "$temporary/x.ply"

finish
