#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Memory of ranks: with a million primitives, the peak of each of four ranks over a whole run (initial model, structural
# updates, checkpoints, model file, evaluation) is at most 0.35 of that of one process. Program and photos are not
# counted: they are what a training run of 1000 primitives needs. Skipped without mpirun or without a plug-in.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"

find_mpirun
if is_sanitized; then
    echo "skipped: sanitizers need memory of their own"
    exit 77
fi

# The room without its points, so that training starts from random ones.
cp -r "$room" "$temporary/scene"
head -c 8 /dev/zero >"$temporary/scene/sparse/0/points3D.bin"

# peaks RANKS PRIMITIVES OPTION...: the peak memory of each process, in kB; the run is in $temporary/runRANKS.
peaks() {
    local count=$1 primitives=$2 start=()
    shift 2
    [ "$count" = 1 ] || start=("${launcher[@]}" -n "$count")
    "${start[@]}" "$program" train "$temporary/scene" -o "$temporary/run$count" --overwrite --downscale 2 --eval \
        --random-points "$primitives" --iterations 100 --checkpoint-every 40 --threads 1 --quiet --json "$@" \
        >"$temporary/stdout" 2>"$temporary/stderr"
    jq '(.per_rank // [.])[].peak_rss_bytes / 1024 | floor' "$temporary/stdout"
}

# share OPTION...: peaks of ranks against that of one process; the same model and scores.
share() {
    local base whole ranks_base peak all
    last_command="sparegs train with random points on 1 and 4 ranks $*"
    base=$(peaks 1 1000 "$@")
    whole=$(peaks 1 1000000 "$@")
    ranks_base=$(peaks 4 1000 "$@" | sort -n | head -1)
    all=$(peaks 4 1000000 "$@")
    check updated test "$(sed -n 2p "$temporary/run1/train.csv" | cut -d, -f4)" != 1000000
    check four_ranks test "$(wc -w <<<"$all")" = 4
    for peak in $all; do
        echo "rank: $peak kB with $ranks_base kB of program and photos; one process: $whole kB with $base kB: share" \
            "$(awk -v p="$peak" -v b="$ranks_base" -v w="$whole" -v o="$base" 'BEGIN { printf "%.3f", (p - b) / (w - o) }')"
        check share_of_a_rank awk -v p="$peak" -v b="$ranks_base" -v w="$whole" -v o="$base" \
            'BEGIN { exit !((p - b) <= 0.35 * (w - o)) }'
    done
    check same_scores test "$(jq -c '[.model_hash, .test, .train]' "$temporary/run1/summary.json")" = \
        "$(jq -c '[.model_hash, .test, .train]' "$temporary/run4/summary.json")"
}

share
share --filter mip
finish
