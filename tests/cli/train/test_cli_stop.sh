#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Ends of a run and what comes after: signals, a time limit, a second run on the same folder, resuming with changed
# options, leftovers of a killed run.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
out=$temporary/out
data=("$room" --downscale 8 --threads 2)

# start ARGUMENT...: a training run in the background. wait_for_iteration_100: until its first row is written.
start() {
    last_command="sparegs train $*"
    "$program" train "$@" >"$temporary/started_stdout" 2>"$temporary/started_stderr" & # apart from those of other commands
    process=$!
}
wait_for_iteration_100() {
    for _ in $(seq 600); do
        if grep -q '^100,' "$out/train.csv" 2>/dev/null; then break; fi
        sleep 0.05
    done
}
finish_with() {
    local status=0
    wait "$process" || status=$?
    check "exit_status_$1" test "$status" -eq "$1"
}

# usr1_saves_and_continues, hangup_saves_and_ends, a_second_run_is_refused
start "${data[@]}" -o "$out" --iterations 1000000 --spare off --checkpoint-every 0
wait_for_iteration_100
check no_checkpoint_before_the_signal test ! -e "$out/checkpoint/state.bin"
kill -USR1 "$process"
for _ in $(seq 100); do
    if [ -e "$out/checkpoint/state.bin" ]; then break; fi
    sleep 0.05
done
check usr1_saves_a_checkpoint test -s "$out/checkpoint/state.bin"
check usr1_does_not_end_the_run kill -0 "$process"
check the_second_run_fails bash -c '! "$@" 2>"$0"' "$temporary/stderr" "$program" train "${data[@]}" -o "$out" --iterations 5
reports "in use by another run"
one_line
check the_first_run_continues kill -0 "$process"
kill -HUP "$process"
finish_with 129
json "$out/summary.json" '.stop_reason == "signal"'

# a_soft_limit_of_cpu_time_saves_and_ends (the kernel repeats the signal every second)
rm -rf "$out"
start "${data[@]}" -o "$out" --iterations 1000000 --spare off --checkpoint-every 0
wait_for_iteration_100
kill -XCPU "$process"
kill -XCPU "$process"
finish_with 143
check its_state_is_saved test -s "$out/checkpoint/state.bin"

# a_run_that_is_stopped_while_it_is_evaluated_is_not_complete (resuming it evaluates the same model)
for every in 1000 0; do
    rm -rf "$out"
    start "$room" --downscale 2 --threads 1 --iterations 2 -o "$out" --checkpoint-every $every
    for _ in $(seq 1000); do
        if [ -e "$out/checkpoint/state.bin" ]; then break; fi
        sleep 0.02
    done
    kill -TERM "$process"
    finish_with 143
    json "$out/summary.json" '.stop_reason == "signal" and .stop_text == "stopped by a signal" and .iterations == 2 and .train.psnr == null'
    hash=$(jq .model_hash "$out/summary.json")
    run 0 train "$room" --downscale 2 --threads 1 --iterations 2 -o "$out" --resume --checkpoint-every $every
    json "$out/summary.json" ".stop_reason == \"schedule\" and .model_hash == $hash and .train.images == 35"
done

# a_run_on_another_machine_is_noticed (its kernel has the lock of the folder, but file servers share those of files)
exec 9>"$out/.lock"
flock -n 9
run 1 train "${data[@]}" -o "$out" --iterations 2 --overwrite
reports "$out: in use by another run"
one_line
exec 9>&-
run 0 train "${data[@]}" -o "$out" --iterations 2 --overwrite

# removed_or_replaced_photos_end_the_run_resumably (the resumed run gives the same model; pipelines read photos in each
# iteration, at a change of the image size, and for the scores of an update)
scene=$temporary/scene
cp -r "$room" "$scene"
iterations=190 # the photos are gone long before the end
pipelines=(3dgs fastgs)
if is_long; then pipelines+=(dash); fi
for pipeline in "${pipelines[@]}"; do
    vanishing=("$scene" -o "$out" --downscale 8 --threads 2 --iterations $iterations --pipeline "$pipeline" --spare off --checkpoint-every 0)
    rm -rf "$out"
    run 0 train "${vanishing[@]}" # reads each photo once
    vanishing+=(--image-cache 1)
    expected=$(jq -r .model_hash "$out/summary.json")
    rm -rf "$out"
    start "${vanishing[@]}"
    wait_for_iteration_100
    mv "$scene/images" "$temporary/kept"
    if [ "$pipeline" = fastgs ]; then # a damaged copy over them: sizes beyond the limit
        mkdir "$scene/images"
        for image in "$temporary/kept"/*; do printf 'P6\n60000 60000\n255\n' >"$scene/images/${image##*/}"; done
    fi
    finish_with 1
    check "reports_what_is_missing_and_what_to_do ($pipeline)" grep -q \
        "$scene/images/.*saved a checkpoint at iteration [0-9]*: .*--resume" "$temporary/started_stderr"
    check "the_state_is_kept ($pipeline)" test -s "$out/checkpoint/state.bin"
    check "the_model_is_kept ($pipeline)" test -n "$(find "$out/point_cloud" -name point_cloud.ply)"
    rm -rf "$scene/images"
    mv "$temporary/kept" "$scene/images"
    run 0 train "${vanishing[@]}" --resume
    reports "resuming at iteration"
    check "nothing_is_lost ($pipeline)" test "$(jq -r .model_hash "$out/summary.json")" = "$expected"
done

# a_signal_received_twice_is_one_request (a batch system signals the experiment, which forwards it, and its training)
rm -rf "$out"
start "${data[@]}" -o "$out" --iterations 1000000 --spare off --checkpoint-every 0
wait_for_iteration_100
kill -USR2 "$process"
kill -TERM "$process"
finish_with 143
check its_state_is_saved test -s "$out/checkpoint/state.bin"

# a_sigterm_sent_twice_is_one_request (a batch system signals the ranks, and its launcher forwards it)
for pause in 0 0.05; do
    rm -rf "$out"
    start "${data[@]}" -o "$out" --iterations 1000000 --spare off --checkpoint-every 0
    wait_for_iteration_100
    kill -TERM "$process"
    sleep $pause
    kill -TERM "$process" 2>/dev/null || true
    finish_with 143
    check the_state_is_saved_once test -s "$out/checkpoint/state.bin"
done

# nohup_is_obeyed
rm -rf "$out"
last_command="nohup sparegs train"
nohup "$program" train "${data[@]}" -o "$out" --iterations 1000000 --spare off >"$temporary/stdout" 2>"$temporary/stderr" &
process=$!
wait_for_iteration_100
rows=$(wc -l <"$out/train.csv")
kill -HUP "$process"
for _ in $(seq 6000); do
    if [ "$(wc -l <"$out/train.csv")" -ge $((rows + 2)) ] || ! kill -0 "$process" 2>/dev/null; then break; fi
    sleep 0.05
done
check a_hangup_does_not_end_the_run kill -TERM "$process"
finish_with 143

# a_signal_ends_the_rendering_of_a_view, without its file (the file of a small first view shows that the large one has
# begun, which takes minutes)
last_command="sparegs render --spp 1024"
mkdir -p "$temporary/drawn"
jq '[(.[0] | .width = 16 | .height = 16), (.[1] | .width = 1600 | .height = 1200)]' "$out/cameras.json" >"$temporary/cameras.json"
"$program" render "$out" --camera "$temporary/cameras.json" --aov rgba --spp 1024 --threads 1 -o "$temporary/drawn" \
    >"$temporary/stdout" 2>"$temporary/stderr" &
process=$!
for _ in $(seq 2400); do
    if [ -e "$temporary/drawn/0001.exr" ] || ! kill -0 "$process" 2>/dev/null; then break; fi
    sleep 0.05
done
check it_renders kill -0 "$process"
check the_first_view_is_written test -s "$temporary/drawn/0001.exr"
kill -TERM "$process"
finish_with 143
check there_is_no_other_file test "$(find "$temporary/drawn" -type f)" = "$temporary/drawn/0001.exr"

# a_closed_stderr_does_not_end_the_run
rm -rf "$out"
last_command="sparegs train | head -1"
{ "$program" train "${data[@]}" -o "$out" --iterations 101 --spare off 2>&1 >"$temporary/stdout" || true; } | head -1 >/dev/null
json "$out/summary.json" '.iterations == 101' # a line was due at 100

# the_time_limit_ends_with_a_resumable_state (with a sanitizer the limit is longer, because loading takes seconds)
for limit in 3s 12s 48s; do
    rm -rf "$out"
    status=0
    "$program" train "${data[@]}" -o "$out" --iterations 1000000 --spare off --time-limit "$limit" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
    [ "$status" = 0 ] && break
    check no_iteration_is_an_error test "$status" = 1 -a ! -e "$out/summary.json"
done
json "$out/summary.json" '.stop_reason == "time_limit" and .stop_text == "stopped by --time-limit" and .iterations > 0 and .iterations < 1000000 and .train.psnr == null'
reports "continue with --resume"
check the_state_is_saved test -s "$out/checkpoint/state.bin"
at=$(jq .iterations "$out/summary.json")
run 0 train "${data[@]}" -o "$out" --iterations 1000000 --spare off --resume --time-limit "$((2 * ${limit%s}))s"
reports "resuming at iteration $at"
run 0 train "${data[@]}" -o "$temporary/short" --iterations 1 --quiet --time-limit 1d3h55m1.5s
run 1 train "$temporary" -o "$temporary/none" --time-limit 2d12h # accepted; there is no scene
reports "$temporary: "
run 1 train "$temporary" -o "$temporary/none" --time-limit 1200
reports "$temporary: "
for text in 3h55x m 55m3h -3s 3s4 3hh ''; do
    run 2 train "${data[@]}" -o "$out" --time-limit "$text"
    reports "--time-limit"
    one_line
done

# max_memory_refuses_with_its_estimate, and_ends_a_run_that_would_exceed_it
rm -rf "$out"
run 1 train "${data[@]}" -o "$out" --iterations 5 --max-memory 100M
one_line
reports "training requires about 0."
reports "more than --max-memory (0.10 GiB)"
check nothing_is_left test ! -e "$out"
run 0 train "${data[@]}" -o "$out" --iterations 2 --max-memory 8G --quiet
for text in 8X G -1G 1K ''; do
    run 2 train "${data[@]}" -o "$out" --max-memory "$text"
    reports "--max-memory"
done

# changed_options_are_used_and_recorded, or refused by name
rm -rf "$out"
paper=(-o "$out" --schedule paper --spare bmd,rap --checkpoint-every 20 --quiet)
run 0 train "${data[@]}" "${paper[@]}" --iterations 40
run 0 train "${data[@]}" "${paper[@]}" --iterations 60 --max-gaussians 100000 --resume
reports "--iterations was 40 and is 60 from iteration 41 on"
reports "--max-gaussians was 0 and is 100000 from iteration 41 on"
json "$out/config.json" '.options.iterations == 60 and .resumed == [{"iteration": 40,
    "changed_from": {"iterations": 40, "max_gaussians": 0}}]'
json "$out/summary.json" '.iterations == 60'
run 0 train "${data[@]}" -o "$temporary/whole" --schedule paper --spare bmd,rap --iterations 60 --quiet
check a_longer_run_is_the_long_run cmp <(jq .model_hash "$out/summary.json") <(jq .model_hash "$temporary/whole/summary.json")
run 1 train "${data[@]}" "${paper[@]}" --iterations 80 --max-gaussians 10 --resume
reports "more than --max-gaussians 10"
run 1 train "${data[@]}" "${paper[@]}" --iterations 60 --sh-degree 2 --resume
reports "--sh-degree was 3 when the run started and is 2 now"
one_line
jq 'del(.options.sh_degree)' "$out/config.json" >"$temporary/edited" && cp "$temporary/edited" "$out/config.json"
run 1 train "${data[@]}" "${paper[@]}" --iterations 60 --resume
reports "--sh-degree was not recorded"

# a_run_that_ended_in_equilibrium_continues_with_other_tolerances
rm -rf "$out"
still=(-o "$out" --iterations 150 --spare-interval 300 --spare-patience 1)
run 0 train "${data[@]}" "${still[@]}" --spare-eps-loss 1 --spare-eps-count 1
json "$out/summary.json" '.stop_reason == "equilibrium" and .iterations < 150'
at=$(jq .iterations "$out/summary.json")
hash=$(jq .model_hash "$out/summary.json")
run 0 train "${data[@]}" "${still[@]}" --spare-eps-loss 1 --spare-eps-count 1 --resume
reports "the run ended in equilibrium at iteration $at of 150; to continue it, change --spare-eps-loss"
check the_model_stays test "$(jq .model_hash "$out/summary.json")" = "$hash"
# --spare-interval was 300, --spare-patience 1; without edt they are neither read nor compared
run 0 train "${data[@]}" -o "$out" --iterations 150 --spare bmd,rap --resume
reports "--spare was bmd,rap,edt and is bmd,rap from iteration $((at + 1)) on"
json "$out/summary.json" '.stop_reason == "schedule" and .iterations == 150'

# leftovers_of_a_killed_run_are_removed, other files stay, and all stay if the run is refused
cloud=$(dirname "$(find "$out/point_cloud" -name point_cloud.ply -print -quit)")
mkdir -p "$out/nested/checkpoint"
leftovers=("$out/checkpoint/state.next.bin.tmp.123" "$out/config.json.tmp.77" "$cloud/point_cloud.ply.tmp.7")
kept=("$out/notes.tmp.txt" "$out/keep.me" "$out/frame.tmp.0001" "$out/config.json.tmp.7b" "$out/.sparegs.notes"
    "$out/nested/config.json.tmp.8" "$out/nested/checkpoint/state.next.bin.tmp.9")
touch "${leftovers[@]}" "${kept[@]}"
run 1 train "${data[@]}" -o "$out" --iterations 2 --quiet
for file in "${leftovers[@]}"; do check "a_refused_run_removes_nothing: $file" test -e "$file"; done
run 0 train "${data[@]}" -o "$out" --iterations 2 --quiet --overwrite
check no_temporary_file_is_left test -z "$(find "$out" -name '*.tmp.123' -o -name '*.tmp.77' -o -name '*.tmp.7')"
for file in "${kept[@]}"; do check "other_files_stay: $file" test -e "$file"; done

# a_damaged_checkpoint_is_replaced_by_the_previous_one
rm -rf "$out"
run 0 train "${data[@]}" -o "$out" --iterations 30 --checkpoint-every 10 --quiet
hash=$(jq .model_hash "$out/summary.json")
for damage in 'truncate -s 5000' 'dd conv=notrunc status=none bs=1 seek=70000 count=1 if=/dev/urandom of='; do
    last_command="$damage state.bin"
    if [ "${damage%of=}" = "$damage" ]; then
        $damage "$out/checkpoint/state.bin"
    else # one bit
        byte=$(od -An -tu1 -j70000 -N1 "$out/checkpoint/state.bin")
        printf "\\x$(printf %x $((byte ^ 4)))" | ${damage/if=\/dev\/urandom /}"$out/checkpoint/state.bin"
    fi
    run 0 train "${data[@]}" -o "$out" --iterations 30 --checkpoint-every 10 --quiet --resume
    reports "state.bin"
    reports "replaced by the previous checkpoint"
    check the_model_is_the_same test "$(jq .model_hash "$out/summary.json")" = "$hash"
done

finish
