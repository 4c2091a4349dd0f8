#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Sessions of an experiment: other threads and instruction sets, suspended, killed and limited runs, an ignored SIGCHLD.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
plan=$temporary/plan.json out=$temporary/out
process=
trap '[ -z "$process" ] || kill -KILL "$process"; rm -rf "$temporary"' EXIT
off=$out/runs/room/3dgs/off/seed_0 on=$out/runs/room/3dgs/on/seed_0

write_plan() { # CHANGE
    jq -n --arg room "$room" '{scenes: [{name: "room", path: $room}], pipelines: ["3dgs"],
        options: {iterations: 5, downscale: 16, eval: true}} | '"$1" >"$plan"
}
# start ARGUMENT...: an experiment in the background, in a process group of its own, as a shell starts it.
start() {
    last_command="sparegs experiment $*"
    set -m
    "$program" experiment "$plan" -o "$out" "$@" 2>"$temporary/stderr" &
    process=$!
    set +m
}
# wait_until COMMAND...: for at most two minutes.
wait_until() {
    for _ in $(seq 1200); do
        if "$@" 2>/dev/null; then return; fi
        sleep 0.1
    done
    check "in_time: $*" false
}
has_iteration_100() { grep -q '^100,' "$1/train.csv"; }
training_of() { pgrep -P "$process"; }
state_of() { sed 's/.*) \(.\).*/\1/' "/proc/$1/stat"; }
is_suspended() { [ "$(state_of "$1")" = T ]; }
continues() { [ "$(state_of "$1")" != T ]; }
grows() { [ "$(wc -l <"$1/train.csv")" -gt "$2" ]; }
finish_with() { # STATUS
    local status=0
    wait "$process" || status=$?
    process=
    check "exit_status_$1" test "$status" -eq "$1"
}

# other_threads_are_reported, and the report has no change of time; the model stays the same
write_plan .
run 0 experiment "$plan" -o "$out" --threads 1
check no_warning_at_first bash -c "! grep -q warning '$temporary/stderr'"
hash=$(jq .model_hash "$on/summary.json")
run 0 report "$out" --pictures 0 --maps 0
check there_is_a_change_of_time grep -qE '^\| 3dgs \| room \|.*\| [+-][0-9.]+ % \| [+-][0-9.]+ % \| ' "$out/report.md"
check there_is_no_note bash -c "! grep -q 'Δ time is' '$out/report.md'"
run 0 experiment "$plan" -o "$out" --threads 2
check complete_runs_are_no_reason_for_a_warning bash -c "! grep -q warning '$temporary/stderr'"
rm -r "$on"
run 0 experiment "$plan" -o "$out" --threads 2
reports "warning: $off: was trained with threads 1, the remaining runs use 2; 'sparegs report' omits changes of time between such runs"
check the_model_is_the_same test "$(jq .model_hash "$on/summary.json")" = "$hash"
run 0 report "$out" --pictures 0 --maps 0
check there_is_no_change_of_time grep -qE '^\| 3dgs \| room \|.*\| - \| [+-][0-9.]+ % \| ' "$out/report.md"
check the_note_says_why grep -qF 'Δ time is "-" where the compared runs differ in: threads.' "$out/report.md"

# another_instruction_set_that_computes_other_bits_is_refused, before anything runs
if [ "$(jq -r .isa "$off/summary.json")" != baseline ]; then
    rm -r "$on"
    run 1 experiment "$plan" -o "$out" --isa baseline
    one_line
    reports "$off: was trained with isa $(jq -r .isa "$off/summary.json"), but the experiment now uses baseline, which gives another model; set --isa,"
    check nothing_ran test ! -e "$on"
    write_plan '.options.isa = "baseline"'
    run 1 experiment "$plan" -o "$out" --check
    reports "but the experiment now uses baseline"
fi
rm -r "$out"

# a_run_that_continues_with_other_threads_records_both_sessions, and the report has no change of time
write_plan '.variants = [{name: "off", options: {spare: "off", iterations: 250}}, {name: "on"}]'
start --threads 1
wait_until has_iteration_100 "$off"
kill -TERM "$process"
finish_with 143
run 0 experiment "$plan" -o "$out" --threads 2
reports "warning: $off: was trained with threads 1, the remaining runs use 2;"
json "$out/results.json" '[.runs[0].sessions[].threads] == [1, 2] and .runs[1].sessions == null'
run 0 report "$out" --pictures 0 --maps 0
check the_note_says_why grep -qF 'Δ time is "-" where the compared runs differ in: threads.' "$out/report.md"
run 0 experiment "$plan" -o "$out" --threads 2
check the_plan_is_still_the_same bash -c "! grep -q 'was trained' '$temporary/stderr'"
rm -r "$out"

# a_session_that_does_not_train_is_not_recorded: stopped before its first iteration, then for the evaluation only
write_plan '.variants = [{name: "off", options: {spare: "off", iterations: 250}}]'
start --threads 1
wait_until has_iteration_100 "$off"
kill -TERM "$process"
finish_with 143
write_plan '.variants = [{name: "off", options: {spare: "off", iterations: 250}}] | .options.time_limit = "0s"'
run 1 experiment "$plan" -o "$out" --threads 2
check the_session_that_trained_is_kept test "$(jq -c '[.sessions[].threads]' "$off/experiment.json")" = '[1]'
rm -r "$out"
write_plan '.variants = [{name: "off", options: {spare: "off"}}]'
run 0 experiment "$plan" -o "$out" --threads 1
run 0 train "$room" -o "$temporary/same" --iterations 5 --downscale 16 --eval --spare off --threads 1 --quiet
cp -r "$temporary/same/checkpoint" "$off/"
rm "$off/summary.json"
run 0 experiment "$plan" -o "$out" --threads 2
json "$out/results.json" '.runs[0].summary.threads == 2 and [.runs[0].sessions[].threads] == [1]'
check it_resumed jq -e '.resumed[0].iteration == 5' "$off/config.json"
rm -r "$out"

# ctrl_z_suspends_the_training_too (the terminal signals the process group of the experiment only)
write_plan '.options.iterations = 1000000 | .options.threads = 1'
start
wait_until has_iteration_100 "$off"
training=$(training_of)
kill -TSTP -- "-$process"
wait_until is_suspended "$process"
wait_until is_suspended "$training"
rows=$(wc -l <"$off/train.csv")
kill -CONT -- "-$process"
wait_until continues "$training"
wait_until grows "$off" "$rows"
check the_experiment_continues continues "$process"
# a_killed_training_is_reported_with_its_signal, and the next run starts
kill -KILL "$training"
wait_until has_iteration_100 "$on"
reports "warning: $off: training was killed by signal 9 (SIGKILL; the system may have run out of memory); continuing with the remaining runs"
# a_suspended_experiment_obeys_a_signal
kill -TSTP -- "-$process"
wait_until is_suspended "$process"
kill -TERM "$process"
kill -CONT "$process"
finish_with 143
check its_state_is_saved test -s "$on/checkpoint/state.bin"
rm -r "$out"

# a_run_at_its_time_limit_has_not_failed
for limit in 2s 8s 32s; do
    write_plan '.options += {iterations: 1000000, threads: 1, time_limit: "'$limit'"} | .variants = [{name: "on"}]'
    run 1 experiment "$plan" -o "$out"
    grep -q "leaves no time" "$temporary/stderr" || break
    rm -r "$out"
done
reports "warning: $on: reached its time limit; rerun the experiment to continue it"
reports "$out: 1 of 1 runs reached their time limit; rerun the experiment to continue them"
check it_is_no_failure bash -c "! grep -q 'failed\|repeat' '$temporary/stderr'"
check it_can_continue test -s "$on/checkpoint/state.bin"
rm -r "$out"

# an_ignored_sigchld_changes_nothing: the caller may have set it, and programs inherit it
ignoring=(python3 -c 'import os, signal, sys
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
os.execv(sys.argv[1], sys.argv[1:])' "$program")
ignored() { # STATUS ARGUMENT...
    local expected=$1 status=0
    shift
    last_command="sparegs $* with SIGCHLD ignored"
    "${ignoring[@]}" "$@" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
    check "exit_status_$expected" test "$status" -eq "$expected"
}
write_plan '.variants = [{name: "on"}]'
ignored 0 experiment "$plan" -o "$out" --quiet
json "$out/results.json" '.runs | length == 1'
mkdir "$temporary/photos"
cp "$room"/images/* "$temporary/photos/"
printf '#!/bin/sh\necho the database is full\nexit 3\n' >"$temporary/colmap"
chmod +x "$temporary/colmap"
ignored 1 reconstruct "$temporary/photos" -o "$temporary/scene" --colmap "$temporary/colmap"
reports "colmap feature_extractor failed with status 3: the database is full"

finish
