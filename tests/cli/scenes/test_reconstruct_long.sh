#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# COLMAP on the photos of the bundled scene, then a short training with its cameras. Skipped without COLMAP.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

if ! command -v colmap >/dev/null; then
    echo "skipped: COLMAP is not installed; tools/setup.sh --long installs it"
    exit 77
fi
run 0 reconstruct "$room/images" -o "$temporary/scene" --matcher sequential --json --quiet
cp "$temporary/stdout" "$temporary/reconstruction.json"
json "$temporary/reconstruction.json" '.photos == 35 and .registered >= 30 and .mean_reprojection_error < 1.5'
run 0 train "$temporary/scene" -o "$temporary/out" --iterations 500 --downscale 2 --eval --json --quiet
json "$temporary/stdout" '.test.psnr > 18'
finish
