#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# `train --view`: the model has the same bits with pages that move all the time; pause, continue, checkpoint and stop;
# the end of a training run with connected pages.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
client=$SPAREGS_SOURCE/tests/cli/pages/view_client.py
small=("$room" --downscale 4 --quiet)
port=0

# start NAME ARGUMENT...: trains into $temporary/NAME in the background with a viewer; sets training and url.
start() {
    local name=$1
    shift
    last_command="sparegs train ${small[*]} -o $name --view $port $*"
    : >"$temporary/stderr"
    : >"$temporary/$name.out"
    "$program" train "${small[@]}" -o "$temporary/$name" --view "$port" "$@" >"$temporary/$name.out" 2>"$temporary/stderr" &
    training=$!
    for _ in $(seq 600); do
        grep -q http "$temporary/$name.out" "$temporary/stderr" || ! kill -0 "$training" 2>/dev/null && break
        sleep 0.1
    done
    url=$(grep -ohE 'http://[^ ]*' "$temporary/$name.out" "$temporary/stderr" | head -1)
    check has_a_url test -n "$url"
}
wait_for() { # TEXT FILE [TRIES]
    for _ in $(seq "${3:-600}"); do
        grep -q "$1" "$2" 2>/dev/null || ! kill -0 "$training" 2>/dev/null && break
        sleep 0.05
    done
}
ends() {
    local status=0
    wait "$training" || status=$?
    check "ends_with_status_$1" test "$status" -eq "$1"
}
page() {
    local status=0
    python3 "$client" "$url" "$@" >"$temporary/page" 2>&1 || status=$?
    grep '^FAIL' "$temporary/page"
    check "client: $*" test "$status" -eq 0 -a "$(grep -c '^FAIL' "$temporary/page")" -eq 0
}

# a_pause_outlives_its_page_by_a_minute (test_cli_parts_long): checked at the end.
if is_long; then
    small=("$room" --downscale 4) # without --quiet: notes
    start idle --iterations 100000 --threads 1
    mv "$temporary/stderr" "$temporary/idle.err"
    idle=$training
    wait_for '^100,' "$temporary/idle/train.csv"
    page action pause leave
    wait_for 'paused from the viewer; press Ctrl-C to save and quit' "$temporary/idle.err"
    page action continue leave
    page action pause leave
    paused_at=$(date +%s)
    page action pause leave # a second request says nothing
    small+=(--quiet)
fi

# viewing_keeps_the_bits: the pages wait for the server, so that they see the whole training.
run 0 train "${small[@]}" -o "$temporary/alone" --iterations 300
port=$(python3 -c 'import socket; print(socket.create_server(("127.0.0.1", 0)).getsockname()[1])')
python3 "$client" "http://127.0.0.1:$port/" move early >"$temporary/first" 2>&1 &
first=$!
python3 "$client" "http://127.0.0.1:$port/" move early >"$temporary/second" 2>&1 &
second=$!
start viewed --iterations 300 --view-share 50
ends 0
wait "$first" "$second"
port=0
pictures_of() { tail -n 1 "$temporary/$1"; }
hash_of() { jq -r .model_hash "$temporary/$1/summary.json"; }
check same_model_with_two_moving_pages test "$(hash_of alone)" = "$(hash_of viewed)"
check pages_saw_pictures test "$(pictures_of first)" -gt 0 -a "$(pictures_of second)" -gt 0
check pages_saw_the_last_model grep -qx 'last iteration 300' "$temporary/first"
check same_files cmp "$temporary/alone/point_cloud/iteration_300/point_cloud.ply" "$temporary/viewed/point_cloud/iteration_300/point_cloud.ply"

# pages_control_the_run: pause, checkpoint while paused, continue, tables, regions, stop.
start controlled --iterations 100000
page control "$temporary/controlled"
ends 130
check stopped_by_the_page test "$(jq -r .stop_reason "$temporary/controlled/summary.json")" = signal
check the_viewer_is_named test "$(jq -r .stop_text "$temporary/controlled/summary.json")" = "stopped from the viewer"
check it_can_be_resumed test -e "$temporary/controlled/checkpoint/state.bin"

# a_page_cannot_end_a_training_with_max_memory: it requests more than the memory that is reserved for it
if ! is_sanitized; then
    start limited --iterations 100000 --threads 1 --view-share 100 --max-gaussians 10000 --max-memory 560M
    page limited
    ends 130
    check the_page_did_not_end_it test "$(jq -r .stop_reason "$temporary/limited/summary.json")" = signal
    check the_memory_is_within_the_limit jq -e '.peak_rss_bytes < 560 * 1048576' "$temporary/limited/summary.json"
fi

# a_first_signal_after_a_stop_of_the_page_is_the_same_request
small=("$room" --downscale 4)
start both --iterations 100000
wait_for '^100,' "$temporary/both/train.csv"
python3 "$client" "$url" action stop &
first=$!
wait_for 'stopped from the viewer' "$temporary/stderr"
kill -TERM "$training"
status=0
wait "$training" || status=$?
wait "$first"
reports 'sparegs: stopped from the viewer; saving'
check its_status_is_that_of_a_saved_stop test "$status" -eq 143 -o "$status" -eq 130
check it_is_saved test -e "$temporary/both/checkpoint/state.bin"
small+=(--quiet)

# a_signal_with_connected_pages
start stopped --iterations 100000 --json
check json_has_stdout_for_itself test "$(grep -c http "$temporary/stopped.out")" -eq 0
python3 "$client" "$url" move >"$temporary/first" 2>&1 &
first=$!
wait_for 'first picture' "$temporary/first"
check the_page_is_connected grep -q 'first picture' "$temporary/first"
kill -TERM "$training"
ends 143
wait "$first" || true # its connection ends with the program
check the_page_saw_pictures test "$(pictures_of first)" -gt 0
check the_result_is_json jq -e .model_hash "$temporary/stopped.out"

# an_exr_file_does_not_delay_a_stop: it is given up, and the run is saved.
start saving --iterations 100000 --max-gaussians 8000
python3 "$client" "$url" exr >"$temporary/first" 2>&1 &
first=$!
wait_for requested "$temporary/first"
sleep 0.3
written=
test ! -e "$temporary/saving/view_0001.exr" || written=1 # on a fast machine
kill -TERM "$training"
ends 143
wait "$first"
check the_run_is_saved test -e "$temporary/saving/checkpoint/state.bin" -a -e "$temporary/saving/summary.json"
test -n "$written" || check the_exr_file_is_given_up test ! -e "$temporary/saving/view_0001.exr"

# a_page_cannot_stop_a_training_that_has_ended: the model is evaluated, and the run is complete.
# The page must connect before the run ends: on a fast machine, more iterations are needed.
for iterations in 60 240 960 3840; do
    rm -rf "$temporary/complete"
    start complete --iterations "$iterations" --eval
    python3 "$client" "$url" late >"$temporary/first" 2>&1 &
    first=$!
    ends 0
    wait "$first" && break
done
check the_page_was_late grep -qx late "$temporary/first"
check the_run_is_complete jq -e ".stop_reason == \"schedule\" and .iterations == $iterations and .test.psnr > 0 and .train.psnr > 0" \
    "$temporary/complete/summary.json"

if is_long; then # the pause from above
    training=$idle
    last_command="sparegs train, paused"
    before=$(tail -1 "$temporary/idle/train.csv" | cut -d, -f1)
    if [ $(($(date +%s) - paused_at)) -lt 50 ]; then
        check a_pause_holds_without_its_page bash -c "sleep 2; test $before = \"\$(tail -1 '$temporary/idle/train.csv' | cut -d, -f1)\""
    fi
    wait_for 'resumed: no page has been open for a minute' "$temporary/idle.err" 2400
    wait_for "^$((before + 100))," "$temporary/idle/train.csv"
    check it_continues_by_itself grep -q "^$((before + 100))," "$temporary/idle/train.csv"
    kill -INT "$training"
    ends 130
    check notes_in_order test "$(grep -oE '^sparegs: (paused|resumed)[a-z: ]*' "$temporary/idle.err" | tr '\n' '|')" = \
        'sparegs: paused from the viewer|sparegs: resumed from the viewer|sparegs: paused from the viewer|sparegs: resumed: no page has been open for a minute|'
fi

# the_line_on_a_terminal_says_that_it_is_paused
last_command="sparegs train, on a terminal"
python3 -c 'import pty, sys; pty.spawn(sys.argv[1:])' "$program" train "$room" --downscale 4 -o "$temporary/terminal" --view 0 \
    --iterations 100000 >"$temporary/terminal.out" </dev/null &
training=$!
wait_for http "$temporary/terminal.out"
url=$(grep -o 'http://[^ [:cntrl:]]*' "$temporary/terminal.out" | head -1)
wait_for 'ETA [0-9]' "$temporary/terminal.out" # the rate is known
page action pause leave
wait_for 'primitives  paused  RSS' "$temporary/terminal.out"
check the_line_says_paused grep -q 'primitives  paused  RSS' "$temporary/terminal.out"
# The bar leaves room for the numbers in 80 columns.
check the_line_has_the_remaining_time grep -qE 'it/s  ETA [0-9]+(:[0-9]{2}){1,2}  RSS' "$temporary/terminal.out"
page action stop
wait "$training"

# ---- Errors ----
python3 -c 'import socket, sys, time
server = socket.create_server(("127.0.0.1", 0)); print(server.getsockname()[1], flush=True); time.sleep(60)' >"$temporary/port" &
holder=$!
while [ ! -s "$temporary/port" ]; do sleep 0.1; done
run 1 train "${small[@]}" -o "$temporary/viewed" --overwrite --iterations 10 --view "$(cat "$temporary/port")"
one_line
reports "is in use; choose another port"
check the_earlier_run_is_kept test "$(hash_of viewed)" = "$(hash_of alone)"
kill "$holder"
run 1 train "${small[@]}" -o "$temporary/none" --iterations 10 --view 192.0.2.77:0
reports "192.0.2.77 is not an address of this machine"
run 2 train "${small[@]}" -o "$temporary/none" --view nowhere
reports "--view: must be PORT or ADDRESS:PORT"
run 2 train "${small[@]}" -o "$temporary/none" --view 70000
run 2 train "${small[@]}" -o "$temporary/none" --view 0 --view-token "a b"
reports "--view-token: must be"
check no_folder test ! -e "$temporary/none"
finish
