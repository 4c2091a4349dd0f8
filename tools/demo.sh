#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# From a fresh clone to a trained scene: installs missing packages, builds, trains the bundled scene with every 8th
# photo held out, compares the held-out views with their photos and writes EXRs.
set -euo pipefail

iterations=3000

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
scene=$root/tests/data/room
out=$root/out/room

"$root/tools/setup.sh"
echo "== building"
cmake -S "$root" -B "$root/build" -DCMAKE_BUILD_TYPE=Release
cmake --build "$root/build" -j "$(nproc)" --target sparegs-cli
program=$root/build/sparegs

echo "== training: $iterations iterations"
"$program" train "$scene" -o "$out" --overwrite --eval --iterations "$iterations"

echo "== evaluating held-out views"
"$program" eval "$out" "$scene" --save "$out/eval" | tee "$out/eval.txt"
"$program" render "$out" "$scene" --split test --aov rgba,depth --format exr -o "$out/exr" >/dev/null

echo "== files"
echo "model, for any 3DGS viewer:"
ls -1 "$out"/point_cloud/iteration_*/point_cloud.ply
echo "held-out views and their photos:"
ls -1 "$out"/eval/*.png
echo "EXR with RGBA and depth:"
ls -1 "$out"/exr/*.exr
echo "held-out views: $(tail -n 1 "$out/eval.txt")"
