#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# KILLS (30) ends of a training run on three ranks at random times (the seed is printed): SIGKILL of a rank or of mpirun, SIGTERM
# or SIGUSR2 of mpirun, a time limit. It is resumed on two ranks, ended again, and resumed without MPI: the model equals
# that of an uninterrupted run, and no rank is left behind.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"
kills=${KILLS:-30}
if ! mpirun --version 2>&1 | grep -q "Open MPI" || [ ! -e "$SPAREGS_BUILD/ranks-openmpi.so" ]; then
    echo "skipped: mpirun of Open MPI or its plug-in is missing (install libopenmpi-dev and openmpi-bin)"
    exit 77
fi
# shellcheck disable=SC2119 # no argument
if is_sanitized; then
    echo "skipped: the MPI library is not built with a sanitizer"
    exit 77
fi
RANDOM=${SEED:-$((${EPOCHSECONDS:-1} % 30000))}
echo "seed of the moments: SEED=$RANDOM"
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
interval=5
options=("$room" --downscale 16 --spare on --spare-patience 1000 --threads 1 --checkpoint-every $interval
    --iterations "${ITERATIONS:-400}")
out=$temporary/out

ranks=()
launch() { # COUNT ARGUMENT...: in the background
    local count=$1
    shift
    mpirun --oversubscribe --bind-to none -n "$count" "$program" train "${options[@]}" -o "$out" "$@" \
        >"$temporary/stdout" 2>"$temporary/stderr" &
    job=$!
}
all_ended() {
    for rank in "${ranks[@]}"; do
        [ ! -e "/proc/$rank" ] || [ "$(cut -d' ' -f3 "/proc/$rank/stat" 2>/dev/null || echo Z)" = Z ] || return 1
    done
}
await_end() { # ranks without their launcher notice its end
    for ((i = 0; i < 300; ++i)); do
        if all_ended; then return 0; fi
        sleep 0.1
    done
    kill -KILL "${ranks[@]}" || true
    return 1
}
last_checkpoint() { tail -n 1 "$out/checkpoint/sums.csv" 2>/dev/null | grep -oE '^[0-9]+' || echo 0; }
pause() { sleep "$(($1 / 1000)).$(printf %03d $(($1 % 1000)))"; }

# Ends the running job in a random way at a random moment.
end_job() {
    local way=$1 moment=$2
    pause "$moment"
    mapfile -t ranks < <(pgrep -P "$job" || true)
    case $way in
        rank) [ "${#ranks[@]}" = 0 ] || kill -KILL "${ranks[$((RANDOM % ${#ranks[@]}))]}" 2>/dev/null || true ;;
        mpirun) kill -KILL "$job" 2>/dev/null || true ;;
        term) kill -TERM "$job" 2>/dev/null || true ;;
        usr2) kill -USR2 "$job" 2>/dev/null || true ;;
    esac
    { wait "$job" || true; } 2>>"$temporary/shell"
    check "no_rank_is_left ($way)" await_end
}

run 0 train "${options[@]}" --quiet -o "$temporary/whole"
hash=$(jq -r .model_hash "$temporary/whole/summary.json")
start=$EPOCHREALTIME
launch 3 --quiet
wait "$job"
length=$(((${EPOCHREALTIME/./} - ${start/./}) / 1000)) # milliseconds, load and evaluation included
check three_ranks_give_the_model test "$(jq -r .model_hash "$out/summary.json")" = "$hash"

ways=(rank mpirun term usr2 limit)
declare -A done_by=()
killed=0
while [ "$killed" -lt "$kills" ] && [ "$failures" -lt 5 ]; do
    rm -rf "$out"
    for count in 3 2; do
        way=${ways[$((RANDOM % ${#ways[@]}))]}
        moment=$((50 + RANDOM % length))
        last_command="$count ranks ended by $way after $moment ms, $killed ends so far"
        extra=()
        [ ! -e "$out/config.json" ] || extra=(--resume) # ended before the run began
        [ "$way" != limit ] || extra+=(--time-limit "$((2 + moment / 1000))s")
        before=$(last_checkpoint)
        launch "$count" "${extra[@]}"
        if [ "$way" = limit ]; then moment=0; fi
        end_job "$way" "$moment"
        at=$(sed -n 's/.*resuming at iteration \([0-9]*\)$/\1/p' "$temporary/stderr")
        check at_most_one_interval_is_done_again test "${at:-$before}" -ge $((before - interval))
        check no_checkpoint_is_damaged bash -c '! grep -Eq "damaged|corrupt" "$0"' "$temporary/stderr"
        killed=$((killed + 1))
        done_by[$way]=$((${done_by[$way]:-0} + 1))
    done
    extra=()
    [ ! -e "$out/config.json" ] || extra=(--resume)
    if [ "$(jq -r .stop_reason "$out/summary.json" 2>/dev/null)" != schedule ]; then
        run 0 train "${options[@]}" -o "$out" "${extra[@]}"
    fi
    check the_model_is_the_same test "$(jq -r .model_hash "$out/summary.json")" = "$hash"
    check no_temporary_file_is_left test -z "$(find "$out" -name '*.tmp.*')"
done
for way in "${!done_by[@]}"; do echo "$way: ${done_by[$way]}"; done
echo "$killed ends, model $hash"
finish
