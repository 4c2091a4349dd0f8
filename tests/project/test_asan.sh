#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Address and undefined-behaviour sanitizers on the fast tests: file readers, checkpoints with tiny training runs,
# spare/, gradients of renderings, scenes in memory and the examples. test_asan_long runs all tests, in the same build folder.
set -euo pipefail
cd "$SPAREGS_SOURCE"
tests=(test_colmap test_transforms test_ply_errors test_checkpoint test_spare test_renderer_gradient test_scene_create)
cmake --preset asan >/dev/null
cmake --build build/asan -j "$(nproc)" --target "${tests[@]}" fit_image render_ply | grep -E 'warning:|error:' || true
exec ctest --test-dir build/asan --output-on-failure -R "^($(IFS='|' && echo "${tests[*]}")|test_examples)\$"
