#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs train --batch: recorded in config.json and summary.json, another model than without, the same with any number of
# threads and after an interruption inside of a batch; a resumed run must use the same number.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
options=(--downscale 16 --iterations 60 --eval --quiet)

run 0 train "$room" -o "$temporary/one" "${options[@]}" --threads 1
run 0 train "$room" -o "$temporary/three" "${options[@]}" --batch 3 --threads 1
json "$temporary/one/summary.json" '.batch == 1'
json "$temporary/three/summary.json" '.batch == 3 and .iterations == 60'
json "$temporary/three/config.json" '.options.batch == 3'
hash_of() { jq -r .model_hash "$1/summary.json"; }
check batches_are_another_result test "$(hash_of "$temporary/one")" != "$(hash_of "$temporary/three")"
run 0 train "$room" -o "$temporary/parts" "${options[@]}" --batch 3 --threads 2 --checkpoint-every 25
check threads_change_nothing test "$(hash_of "$temporary/parts")" = "$(hash_of "$temporary/three")"
cp "$temporary/parts/checkpoint/state.previous.bin" "$temporary/state.bin"
mv "$temporary/state.bin" "$temporary/parts/checkpoint/state.bin" # of iteration 50
run 0 train "$room" -o "$temporary/parts" "${options[@]}" --batch 3 --threads 2 --checkpoint-every 25 --resume
check resuming_changes_nothing test "$(hash_of "$temporary/parts")" = "$(hash_of "$temporary/three")"
json "$temporary/parts/config.json" '.resumed[0].iteration < 60'
run 1 train "$room" -o "$temporary/parts" "${options[@]}" --batch 2 --checkpoint-every 25 --resume
reports "--batch was 3 when the run started and is 2 now"
one_line
run 2 train "$room" -o "$temporary/no" --batch 0
reports "--batch"
run 2 train "$room" -o "$temporary/no" --batch 1025
reports "--batch"

finish
