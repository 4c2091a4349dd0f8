#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Tiny training runs by the program: the files of OUT and their keys, resuming, stopping on a signal, a full disk.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
out=$temporary/out
data=("$room" --downscale 8 --threads 2 --quiet)

# training_writes_the_documented_files
run 0 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --save-at 10 --checkpoint-every 5 --json
cp "$temporary/stdout" "$temporary/printed.json"
check quiet_is_quiet test ! -s "$temporary/stderr"
for file in point_cloud/iteration_10/point_cloud.ply point_cloud/iteration_20/point_cloud.ply cameras.json input.ply \
    config.json train.csv spare.csv summary.json checkpoint/state.bin checkpoint/state.previous.bin; do
    check "there_is_$file" test -s "$out/$file"
done
check no_temporary_file_is_left test -z "$(find "$out" -name '*.tmp*' -o -name '.sparegs*')"
check printed_summary_is_the_file cmp "$temporary/printed.json" "$out/summary.json"
json "$out/summary.json" '.iterations == 20 and .stop_reason == "schedule" and .gaussians > 0 and .train_seconds > 0'
json "$out/summary.json" '[.seconds | has("gather", "forward", "loss", "backward", "optimizer", "bvh_refit", "bvh_build",
    "density", "spare", "image_io", "checkpoint")] | all'
json "$out/summary.json" '.seconds | .project > 0 and .project < .forward' # a part of it
json "$out/summary.json" '.seconds.checkpoint > 0'
json "$out/summary.json" '.test.images == 5 and .test.psnr > 5 and .test.ssim > 0 and .test.lpips == null'
json "$out/summary.json" '.train.images == 30 and .train.psnr > 5 and .train.ssim > 0'
json "$out/summary.json" '.threads == 2 and (.isa | type) == "string" and .peak_rss_bytes > 1000000 and .seed == 0'
check the_peak_is_at_least_every_row test "$(jq .peak_rss_bytes "$out/summary.json")" -ge "$(tail -n +2 "$out/train.csv" | cut -d, -f9 | sort -n | tail -n 1)"
json "$out/summary.json" '.model_hash | test("^[0-9a-f]{16}$")'
json "$out/config.json" '.options.iterations == 20 and .options.test_every == 8 and .options.downscale == 8 and .seed == 0'
json "$out/config.json" '.options.spare == ["bmd", "rap"] and .options.background == [0, 0, 0]'
json "$out/cameras.json" 'length > 0 and (.[0] | has("id", "img_name", "width", "height", "position", "rotation", "fx", "fy"))'
check train_csv_has_its_columns grep -qx \
    'iteration,seconds,loss,gaussians,psnr_train,densified,pruned,spare_pruned,rss_bytes' "$out/train.csv"
check train_csv_ends_with_the_last_iteration grep -q '^20,' "$out/train.csv"
check spare_csv_has_its_columns grep -qx \
    'iteration,regions,gaussians,over_budget_share,mean_weight,bmd_suppressed,bmd_boosted,rap_pruned,seconds' "$out/spare.csv"
check ply_has_62_properties test "$(head -c 4000 "$out/point_cloud/iteration_20/point_cloud.ply" | grep -ac '^property float')" = 62
hash=$(jq -r .model_hash "$out/summary.json")

# progress_is_a_line_per_100_iterations
run 0 train "$room" --downscale 16 -o "$temporary/lines" --iterations 200 --spare off
reports "100/200"
reports "200/200"
prints "training images: PSNR"
check no_escape_codes_in_a_log test -z "$(tr -d -c '\033' <"$temporary/stderr")"

# a_trailing_slash_is_removed_from_paths, and one iteration is singular
run 0 train "$room/" --downscale 8 -o "$temporary/slash/" --iterations 1 --spare off --quiet
prints "1 iteration in "
prints "$temporary/slash/point_cloud/iteration_1/point_cloud.ply"
check the_config_has_no_trailing_slash test "$(jq -r .scene "$temporary/slash/config.json")" = "$room"

# without_a_test_split_the_test_score_is_null
json "$temporary/lines/summary.json" '.test.images == 0 and .test.psnr == null and .train.images == 35'

# resume_reaches_the_same_model
rm "$out/summary.json"
run 0 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --checkpoint-every 5 --resume
json "$out/summary.json" ".model_hash == \"$hash\""

# resume_falls_back_when_the_newest_checkpoint_is_damaged
cp "$out/checkpoint/state.previous.bin" "$temporary/previous"
truncate -s 100 "$out/checkpoint/state.bin"
run 0 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --checkpoint-every 0 --resume
reports "warning"
reports "state.bin"
json "$out/summary.json" ".model_hash == \"$hash\""
check csv_rows_are_not_doubled test "$(grep -c '^20,' "$out/train.csv")" = 1
truncate -s 100 "$out/checkpoint/state.bin" "$out/checkpoint/state.previous.bin"
run 1 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --resume

# resume_does_not_call_an_unreadable_checkpoint_damaged
rm "$out/checkpoint/"state*.bin
mkdir "$out/checkpoint/state.bin"
run 1 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --resume
reports "state.bin: cannot be read, and there is no previous checkpoint; make it readable, then rerun with --resume"
rmdir "$out/checkpoint/state.bin"

# resume_refuses_other_options
run 1 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 30 --resume
one_line
reports "--iterations was 20"
run 1 train "${data[@]}" -o "$out" --eval --spare bmd,rap --iterations 20 --spare-grid 16 --resume
reports "--spare-grid was 32"

# signals_save_and_report
for signal in INT:130 TERM:143; do
    rm -rf "$out"
    last_command="train, then SIG${signal%:*}"
    "$program" train "${data[@]}" -o "$out" --iterations 1000000 --spare off >"$temporary/stdout" 2>"$temporary/stderr" &
    process=$!
    for _ in $(seq 6000); do
        grep -q '^100,' "$out/train.csv" 2>/dev/null && break
        sleep 0.1
    done
    kill -"${signal%:*}" "$process"
    status=0
    wait "$process" || status=$?
    check "status_${signal#*:}" test "$status" -eq "${signal#*:}"
    json "$out/summary.json" '.stop_reason == "signal" and .iterations >= 100 and .test.images == 0 and .test.psnr == null'
    check a_checkpoint_is_saved test -s "$out/checkpoint/state.bin"
    check the_model_is_saved test -s "$out/point_cloud/iteration_$(jq .iterations "$out/summary.json")/point_cloud.ply"
done

# killed_and_resumed_equals_uninterrupted, also with another number of threads (a run that has ended before the signal is
# repeated: it shows nothing)
# shellcheck disable=SC2054
data=("$room" --downscale 8 --iterations 180 --eval --spare bmd,rap --checkpoint-every 30 --quiet)
run 0 train "${data[@]}" -o "$temporary/whole" --threads 2
for signal in KILL:137 INT:130; do
    last_iteration=180
    for _ in $(seq 20); do
        rm -rf "$out"
        last_command="train, then SIG${signal%:*}"
        "$program" train "${data[@]}" -o "$out" --threads 1 >"$temporary/stdout" 2>"$temporary/stderr" &
        process=$!
        for _ in $(seq 6000); do
            if grep -q '^100,' "$out/train.csv" 2>/dev/null || ! kill -0 "$process" 2>/dev/null; then break; fi
            sleep 0.02
        done
        kill -"${signal%:*}" "$process" 2>/dev/null || true
        status=0
        wait "$process" 2>/dev/null || status=$?
        if [ "$status" = 0 ]; then continue; fi
        last_iteration=$(tail -n 1 "$out/checkpoint/sums.csv" | grep -oE '^[0-9]+' || echo 0)
        if [ "$last_iteration" -lt 180 ]; then break; fi
    done
    check "status_${signal#*:}" test "$status" -eq "${signal#*:}"
    check the_signal_came_before_the_last_iteration test "$last_iteration" -lt 180
    signal=${signal%:*}
    run 0 train "${data[@]}" -o "$out" --threads 2 --resume
    check "same_model_after_$signal" cmp <(jq .model_hash "$out/summary.json") <(jq .model_hash "$temporary/whole/summary.json")
    check "same_table_after_$signal" cmp <(cut -d, -f1,3-8 "$out/train.csv") <(cut -d, -f1,3-8 "$temporary/whole/train.csv")
    check "same_decisions_after_$signal" cmp <(cut -d, -f1-8 "$out/spare.csv") <(cut -d, -f1-8 "$temporary/whole/spare.csv")
done

# a_full_disk_keeps_the_earlier_files (simulated by a limit on the file size; larger for a file of the thread sanitizer)
run 0 train "$room" --downscale 8 -o "$temporary/full" --iterations 3
cp "$temporary/full/summary.json" "$temporary/before.json"
least=16
if is_sanitized thread; then least=1024; fi
# shellcheck disable=SC2016
check fails_with_status_1 bash -c 'trap "" XFSZ; ulimit -f "$4"; status=0
    "$0" train "$1" --downscale 8 -o "$2" --iterations 3 --quiet --resume 2>"$3" || status=$?; [ $status = 1 ]' \
    "$program" "$room" "$temporary/full" "$temporary/stderr" $least
reports "cannot be written"
check summary_is_intact cmp "$temporary/full/summary.json" "$temporary/before.json"

# room_for_the_model_but_not_for_its_checkpoint (the result is still evaluated)
model_bytes=$(stat -c %s "$temporary/full/point_cloud/iteration_3/point_cloud.ply")
check fails_without_a_checkpoint bash -c 'trap "" XFSZ; ulimit -f "$3"; status=0
    "$0" train "$1" --downscale 8 -o "$2" --iterations 4 --eval --overwrite >/dev/null 2>"$4" || status=$?; test $status = 1' \
    "$program" "$room" "$temporary/full" $((model_bytes * 3 / 2 / 1024)) "$temporary/stderr"
check names_the_checkpoint grep -q 'checkpoint' "$temporary/stderr"
json "$temporary/full/summary.json" '.iterations == 4 and .test.psnr > 5'
check no_temporary_file_is_left test -z "$(find "$temporary/full" -name '*.tmp*' -o -name '.sparegs*')"

# a_trace_that_cannot_be_written_loses_nothing_else (it is larger than the limit, the other files are smaller)
limit=128 iterations=200
if is_sanitized thread; then limit=1024 iterations=1200; fi
last_command="train --trace with a limit on the file size"
# shellcheck disable=SC2016
check fails_without_its_trace bash -c 'trap "" XFSZ; ulimit -f "$4"; status=0
    "$0" train "$1" --downscale 16 -o "$2" --iterations "$5" --max-gaussians 100 --spare off --eval --quiet --trace "$2/trace.json" \
    >"$3.stdout" 2>"$3" || status=$?; test $status = 1' "$program" "$room" "$temporary/traced" "$temporary/stderr" "$limit" "$iterations"
reports "traced/trace.json: cannot be written: File too large"
check the_result_is_printed grep -q "^held-out images: PSNR" "$temporary/stderr.stdout"
check the_model_is_saved test -s "$temporary/traced/point_cloud/iteration_$iterations/point_cloud.ply"
check the_checkpoint_is_saved test -s "$temporary/traced/checkpoint/state.bin"
json "$temporary/traced/summary.json" ".iterations == $iterations and .stop_reason == \"schedule\" and .test.psnr > 5"
check no_temporary_file_is_left test -z "$(find "$temporary/traced" -name '*.tmp*')"

# many_threads (of five photos)
cp -r "$room" "$temporary/five"
find "$temporary/five/images" -name '*.jpg' | sort | tail -n +6 | xargs rm
for threads in 1100 2; do
    run 0 train "$temporary/five" --downscale 8 -o "$temporary/threads_$threads" --iterations 3 --threads $threads --quiet
done
json "$temporary/threads_1100/summary.json" '.skipped.gradients == 0 and .threads == 1100 and .train.images == 5'
check same_model_with_1100_threads cmp <(jq .model_hash "$temporary/threads_1100/summary.json") \
    <(jq .model_hash "$temporary/threads_2/summary.json")
run 0 train "$room" --downscale 8 -o "$temporary/many" --iterations 3 --quiet

# max_gaussians_caps_the_initial_cloud
run 0 train "$room" --downscale 8 -o "$temporary/capped" --iterations 3 --max-gaussians 500 --quiet
json "$temporary/capped/summary.json" '.gaussians <= 500'

# init_starts_from_a_model
run 0 train "$room" --downscale 8 -o "$temporary/refined" --iterations 1 --init "$temporary/capped" --quiet
json "$temporary/refined/summary.json" '.gaussians <= 500'
# options_without_effect_on_a_trained_model_are_named
finetune() { run "$1" train "$room" --downscale 8 -o "$temporary/idle" --iterations 1 --init "$temporary/capped" --schedule finetune --overwrite "${@:2}"; }
for option in "--spare-grid 8" "--spare-range 0.1" "--spare-tau-alpha 0.1" "--pipeline dash --dash-count 9" "--pipeline taming --taming-count 9" \
    "--pipeline taming --taming-multiplier 2" "--pipeline taming --taming-opacity frozen" "--pipeline fastgs --fastgs-loss 0.2" "--pipeline fastgs --fastgs-gradient 0.2" \
    "--pipeline fastgs --fastgs-dense 0.2" "--pipeline mcmc --mcmc-growth 0.1" "--pipeline mcmc --mcmc-redundant relocate"; do
    # shellcheck disable=SC2086 # options and values
    finetune 2 $option
    reports "requires --schedule scaled or --schedule paper"
    one_line
done
for option in mcmc-start-scale mcmc-start-opacity; do
    run 2 train "$room" --downscale 8 -o "$temporary/idle" --iterations 1 --init "$temporary/capped" --pipeline mcmc --$option 0.5
    reports "--$option has no effect with --init"
    one_line
done
finetune 0 --pipeline mcmc --mcmc-noise 1 --mcmc-opacity-loss 0 --mcmc-units world --spare-eps-loss 0.1 --spare-interval 10
check these_have_an_effect bash -c "! grep -q 'has no effect' '$temporary/stderr'"
finetune 0 --spare bmd,rap --quiet
reports "warning: --spare has no effect with --schedule finetune unless it contains edt"
finetune 0 --spare off --quiet
check off_is_no_mistake test ! -s "$temporary/stderr"
# input_ply_has_the_centres_and_base_colours_of_the_model: 0.5 + 0.28209479 f_dc (Kerbl et al. 2023), in 8 bits
check input_ply_shows_the_model python3 - "$temporary/capped/point_cloud/iteration_3/point_cloud.ply" "$temporary/refined/input.ply" <<'PYTHON'
import struct, sys
def rows(path, form):
    header, body = open(path, "rb").read().split(b"end_header\n", 1)
    count = int(header.split(b"element vertex ")[1].split()[0])
    assert len(body) == count * struct.calcsize(form), (count, len(body))
    return header, list(struct.iter_unpack(form, body))
_, model = rows(sys.argv[1], "<62f")
header, cloud = rows(sys.argv[2], "<6f3B")
assert b"property float x" in header and b"property uchar blue" in header
key = lambda row: row[:3]
model.sort(key=key)
cloud.sort(key=key)
assert 0 < len(model) == len(cloud)
assert len({row[6:] for row in cloud}) > 50
for was, now in zip(model, cloud):
    assert was[:3] == now[:3] and now[3:6] == (0, 0, 0), (was[:3], now)
    for c in range(3):
        colour = 255 * min(max(0.5 + 0.28209479177387814 * was[6 + c], 0), 1)
        assert abs(colour - now[6 + c]) <= 0.501, (colour, now)
PYTHON
cp "$temporary/refined/input.ply" "$temporary/input.ply"
run 0 train "$room" --downscale 8 -o "$temporary/refined" --iterations 1 --init "$temporary/capped" --quiet --resume
check resume_keeps_it cmp "$temporary/input.ply" "$temporary/refined/input.ply"
# resume_accepts_the_same_model_under_another_path
resume_refined() { run "$1" train "$room" --downscale 8 -o "$temporary/refined" --iterations 1 --resume --quiet --init "$2"; }
mv "$temporary/capped" "$temporary/kept"
resume_refined 0 "$temporary/kept/point_cloud/iteration_3/point_cloud.ply"
resume_refined 1 "$temporary/many"
reports "--init was $temporary/kept/point_cloud/iteration_3/point_cloud.ply when the run started and is $temporary/many now"
# without_a_region the checkpoint replaces a model that changed
cp -r "$temporary/many/." "$temporary/kept/"
resume_refined 0 "$temporary/kept/point_cloud/iteration_3/point_cloud.ply"

# a_new_iteration_to_save_that_has_passed_is_reported
run 0 train "$room" --downscale 8 -o "$temporary/many" --iterations 3 --resume --save-at 2,3
reports "warning: --save-at: the run resumes at iteration 3; the model of iteration 2 cannot be saved"
run 0 train "$room" --downscale 8 -o "$temporary/many" --iterations 3 --resume --save-at 2,3
check it_is_reported_once bash -c "! grep -q save-at '$temporary/stderr'"
run 0 train "$room" --downscale 8 -o "$temporary/many" --iterations 3 --resume
mkdir "$temporary/many/point_cloud/iteration_1"
cp "$temporary/many/point_cloud/iteration_3/point_cloud.ply" "$temporary/many/point_cloud/iteration_1/"
run 0 train "$room" --downscale 8 -o "$temporary/many" --iterations 3 --resume --save-at 1
check a_saved_model_is_not_reported bash -c "! grep -q save-at '$temporary/stderr'"

# the_word_auto_is_the_number_that_stands_for_it, and the default
run 0 train --help
for text in '[0 to 1, or auto; default: auto: 0.2; ' '[0 to 3, or auto; default: auto: 1.5; ' '[0 to 0.25, or auto; default: auto: 0; ' \
    'x position learning rate, or auto; default: auto: 500000; '; do
    check "help_has: $text" grep -qF -- "$text" <(tr -s ' \n' '  ' <"$temporary/stdout")
done
automatic() { run 0 train "$room" --downscale 16 -o "$temporary/auto" --overwrite --pipeline mcmc --iterations 2 --quiet "$@"; }
numbers='.options | [.ssim_weight, .ssim_sigma, .mcmc_noise, .spare_grid_quantile] == [-1, 0, -1, -1]'
automatic --ssim-weight auto --ssim-sigma auto --mcmc-noise auto --spare-grid-quantile auto
json "$temporary/auto/config.json" "$numbers"
automatic --ssim-weight -1 --ssim-sigma 0 --mcmc-noise -1 --spare-grid-quantile -1
json "$temporary/auto/config.json" "$numbers"

# opaque_photos: sets background and weight unless given; a run records the option
run 0 train "$room" --downscale 8 -o "$temporary/opaque" --iterations 150 --opaque --quiet
json "$temporary/opaque/config.json" '.options | .opaque == true and .background == "random" and .alpha_loss == 0.1'
run 0 train "$room" --downscale 8 -o "$temporary/holes" --iterations 150 --quiet
json "$temporary/holes/config.json" '.options | .opaque == false and .alpha_loss == 0'
for name in opaque holes; do
    run 0 render "$temporary/$name" "$room" --view 0001 --aov rgba -o "$temporary/$name"
    oiiotool --stats "$temporary/$name/0001.exr" | awk '/Stats Avg/ { print $6 }' >"$temporary/$name.alpha"
done
check fewer_holes bash -c "paste '$temporary/opaque.alpha' '$temporary/holes.alpha' | awk '{ exit !(\$1 > \$2 && \$1 > 0.98) }'"
run 0 train "$room" --downscale 8 -o "$temporary/given" --iterations 2 --opaque --alpha-loss 0.2 --background 0,1,0 --quiet
json "$temporary/given/config.json" '.options | .background == [0, 1, 0] and .alpha_loss == 0.2'
check no_warning test ! -s "$temporary/stderr"
run 0 train "$room" -o "$temporary/given" --resume --quiet
json "$temporary/given/config.json" '.options | .opaque and .background == [0, 1, 0] and .alpha_loss == 0.2'
run 2 train "$room" --downscale 8 -o "$temporary/none" --opaque --alpha-loss 0
reports "--opaque requires --alpha-loss above 0"

# the_evaluated_training_images_are_evenly_spaced: the 1st, 11th and 21st of 30; the choice is kept and free on resuming
some=$temporary/some
run 0 train "${data[@]}" -o "$some" --eval --iterations 2 --eval-train 3
prints "(3 of 30 images, "
run 0 eval "$some" "$room" --split train --json --quiet
jq '[.images[0, 10, 20].psnr] | add / 3' "$temporary/stdout" >"$temporary/mean"
json "$some/summary.json" ".test.images == 5 and .train.images == 3 and (.train.psnr - $(cat "$temporary/mean") | fabs) < 1e-4"
json "$some/config.json" '.eval_train == 3'
hash=$(jq -r .model_hash "$some/summary.json")
run 0 train "$room" -o "$some" --resume --eval-train 0 --quiet
check no_training_images bash -c "! grep 'training images' '$temporary/stdout'"
run 0 train "$room" -o "$some" --resume --quiet
json "$some/summary.json" '.stop_reason == "schedule" and .test.images == 5 and .train.images == 0 and .train.psnr == null'
run 0 train "$room" -o "$some" --resume --eval-train all --quiet
prints "(30 images, "
json "$some/config.json" '.eval_train == "all"'
json "$some/summary.json" ".train.images == 30 and .model_hash == \"$hash\""
run 2 train "$room" -o "$some" --resume --eval-train some
reports "--eval-train: 'some' is not a whole number from 0 to 1000000000 images, or all"
one_line
mkdir -p "$temporary/many/images"
oiiotool --create 30x17 3 -o "$temporary/many/images/a_0001.jpg"
jq '{fl_x: 25, w: 30, h: 17, frames: [("a", "b") as $row | .[] | {file_path: "images/\($row)_\(.img_name)", transform_matrix:
    ([range(3) as $i | [.rotation[$i][0], -.rotation[$i][1], -.rotation[$i][2], .position[$i]]] + [[0, 0, 0, 1]])}]}' \
    "$some/cameras.json" >"$temporary/many/transforms.json"
jq -r '.frames[].file_path' "$temporary/many/transforms.json" | while read -r name; do
    cp -n "$temporary/many/images/a_0001.jpg" "$temporary/many/$name"
done
run 0 train "$temporary/many" -o "$temporary/of_many" --iterations 2 --random-points 200 --quiet
prints "(64 of 70 images, "
json "$temporary/of_many/summary.json" '.train.images == 64'

# names_that_json_cannot_hold_are_refused: without them in config.json, eval would take another split, other images or masks
latin=$temporary/latin
cp -r "$room" "$latin"
mv "$latin/images/0004.jpg" "$latin/images/"$'\xe9''004.jpg'
LC_ALL=C sed -i 's/0004\.jpg/\xe9004.jpg/' "$latin/sparse/0/images.bin"
for option in images masks test-images; do
    run 2 train "$latin" --downscale 16 -o "$temporary/refused" --iterations 1 "--$option" $'\xe9''004.jpg' --quiet
    reports "--$option: '"
    reports "is not UTF-8, and config.json cannot record it; rename the file or folder"
done
run 1 train "$latin" --downscale 16 -o "$temporary/refused" --iterations 1 --exposure --quiet
one_line
reports "is not UTF-8, and exposure.json cannot contain it; rename the file and its entry in the scene"
check nothing_was_trained test ! -e "$temporary/refused/config.json"
run 0 train "$latin" --downscale 16 -o "$temporary/accepted" --iterations 1 --eval --quiet

finish
