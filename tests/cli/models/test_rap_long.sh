#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# prune --method rap against PyTorch: a weight file of torch.save with random weights, the 15 features, the scores and the
# primitives that remain. Skipped without PyTorch.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
find_torch
reference=$SPAREGS_SOURCE/tests/prune/rap_reference.py
weights=$temporary/net_f15.pth

run 0 train "$room" -o "$temporary/model" --downscale 4 --iterations 120 --spare off --quiet
"$python" "$reference" random "$weights"
run 0 convert "$temporary/model" "$temporary/model.ply" --quiet
run 0 prune "$temporary/model.ply" --method rap --weights "$weights" --ratio 0.6 -o "$temporary/pruned.ply" \
    --features "$temporary/features.csv" --scores "$temporary/scores.csv" --quiet
check agrees_with_pytorch "$python" "$reference" compare "$temporary/model.ply" "$weights" "$temporary/features.csv" \
    "$temporary/scores.csv" "$temporary/pruned.ply" 0.6
cat "$temporary/check"

# the_comparison_can_fail (features of a model without bands 2 and 3)
run 0 convert "$temporary/model.ply" "$temporary/other.ply" --filter-harmonics 1 --quiet
run 0 prune "$temporary/other.ply" --method rap --features "$temporary/features.csv" --quiet
check other_features_are_noticed bash -c '! "$@"' - "$python" "$reference" compare "$temporary/model.ply" "$weights" \
    "$temporary/features.csv" "$temporary/scores.csv" "$temporary/pruned.ply" 0.6
cat "$temporary/check"
finish
