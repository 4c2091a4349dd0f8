#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Memory of ranks: with a million primitives, the peak of each of four ranks during training, including structural
# updates, is at most 0.35 of that of one process. Program and photographs are not counted: they are what a training of
# 1000 primitives needs. Skipped without mpirun or without a plug-in.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/cli_support.sh"

find_mpirun
if is_sanitized; then
    echo "skipped: sanitizers need memory of their own"
    exit 77
fi

# The room without its points, so that training starts from random ones.
cp -r "$room" "$temporary/scene"
head -c 8 /dev/zero >"$temporary/scene/sparse/0/points3D.bin"

# Every process writes its number and becomes the program.
cat >"$temporary/program" <<END
#!/bin/sh
echo \$\$ >"$temporary/pids/\$\$"
exec "$program" "\$@"
END
chmod +x "$temporary/program"

# peaks RANKS PRIMITIVES: the peak memory of each process after 100 iterations with updates, in kB. The run is then
# stopped: its end would evaluate the whole model.
peaks() {
    local count=$1 primitives=$2 start=() job i
    rm -rf "$temporary/pids" "$temporary/run"
    mkdir "$temporary/pids"
    [ "$count" = 1 ] || start=("${launcher[@]}" -n "$count")
    "${start[@]}" "$temporary/program" train "$temporary/scene" -o "$temporary/run" --downscale 2 --random-points "$primitives" \
        --iterations 300 --threads 1 --quiet >"$temporary/stdout" 2>"$temporary/stderr" &
    job=$!
    for ((i = 0; i < 9000; ++i)); do
        [ ! -s "$temporary/run/train.csv" ] || [ "$(wc -l <"$temporary/run/train.csv")" -lt 2 ] || break
        sleep 0.1
    done
    for pid in "$temporary"/pids/*; do
        awk '/^VmHWM/ { print $2 }' "/proc/${pid##*/}/status"
    done
    kill -USR2 "$job"
    wait "$job" || true
}

last_command="sparegs train with random points on 1 and 4 ranks"
base=$(peaks 1 1000)
whole=$(peaks 1 1000000)
check stopped test "$(jq -r .stop_reason "$temporary/run/summary.json")" = signal
check updated test "$(sed -n 2p "$temporary/run/train.csv" | cut -d, -f4)" != 1000000
ranks_base=$(peaks 4 1000 | sort -n | head -1)
for peak in $(peaks 4 1000000); do
    echo "rank: $peak kB with $ranks_base kB of program and photographs; one process: $whole kB with $base kB"
    check share_of_a_rank awk -v p="$peak" -v b="$ranks_base" -v w="$whole" -v o="$base" \
        'BEGIN { exit !((p - b) <= 0.35 * (w - o)) }'
done
finish
