#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# SIGKILL (or SIGNAL=TERM) at KILLS random times (the seed is printed), each time resumed with another number of threads:
# the model equals that of an uninterrupted run; after SIGKILL at most one checkpoint interval is repeated, after SIGTERM
# none.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
kills=${KILLS:-2}
signal=${SIGNAL:-KILL}
RANDOM=${SEED:-$((${EPOCHSECONDS:-1} % 30000))}
echo "seed of the moments: SEED=$RANDOM"
interval=5
options=("$room" --downscale 16 --spare on --spare-patience 1000 --checkpoint-every $interval --iterations "${ITERATIONS:-150}")

start=$EPOCHREALTIME
run 0 train "${options[@]}" --quiet -o "$temporary/whole"
length=$(((${EPOCHREALTIME/./} - ${start/./}) / 1000)) # milliseconds, load and evaluation included
hash=$(jq -r .model_hash "$temporary/whole/summary.json")
out=$temporary/out
killed=0
finished=0
resume=()
while { [ "$killed" -lt "$kills" ] || [ "$finished" = 0 ]; } && [ "$failures" -lt 5 ]; do
    last_command="train with ${#resume[@]} resume options, $killed kills so far"
    before=0
    [ ! -s "$out/checkpoint/sums.csv" ] || before=$(tail -n 1 "$out/checkpoint/sums.csv" | grep -oE '^[0-9]+' || echo 0)
    status=0
    { # the shell's own word on a killed child goes there too
        "$program" train "${options[@]}" -o "$out" --threads $((1 + RANDOM % 3)) "${resume[@]}" >"$temporary/stdout" &
        child=$! killer=
        if [ "$killed" -lt "$kills" ]; then # not by timeout, which SIGKILL ends before its child
            moment=$((50 + RANDOM % length))
            { sleep "$((moment / 1000)).$(printf %03d $((moment % 1000)))" && kill -s "$signal" "$child"; } >/dev/null &
            killer=$!
        fi
        wait "$child" || status=$?
        [ -z "$killer" ] || kill "$killer" || true
        wait
    } 2>"$temporary/stderr"
    at=$(sed -n 's/.*resuming at iteration \([0-9]*\)$/\1/p' "$temporary/stderr")
    check at_most_one_interval_is_done_again test "${at:-$before}" -ge $((before - interval))
    check no_checkpoint_is_damaged bash -c '! grep -Eq "damaged|corrupt" "$0"' "$temporary/stderr"
    resume=()
    [ ! -e "$out/config.json" ] || resume=(--resume) # killed before the run began
    if [ "$status" = 0 ]; then
        finished=$((finished + 1))
        check the_model_is_the_same test "$(jq -r .model_hash "$out/summary.json")" = "$hash"
        check no_temporary_file_is_left test -z "$(find "$out" -name '*.tmp.*')"
        rm -rf "$out"
        resume=()
    else
        killed=$((killed + 1))
        check killed_not_failed test "$status" = $((128 + $(kill -l "$signal")))
    fi
done
echo "$killed kills, $finished runs to the end, model $hash"
finish
