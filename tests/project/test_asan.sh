#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Address and undefined-behaviour sanitizers on the fast tests: file readers, spare/, gradients of renderings, scenes in
# memory and the examples. Without the kernels for AVX2 and AVX-512, which are long to compile: test_asan_long runs all
# tests with all kernels, in the same build folder.
set -euo pipefail
cd "$SPAREGS_SOURCE"
tests=(test_colmap test_transforms test_ply_errors test_spare test_renderer_gradient test_scene_create)
build=$SPAREGS_BUILD/asan
cmake --preset asan -DSPAREGS_PORTABLE=ON -B "$build" >/dev/null
if ! cmake --build "$build" -j "$(nproc)" --target "${tests[@]}" fit_image render_ply >"$build/build.log" 2>&1; then
    grep -E 'warning:|error:' "$build/build.log" || tail -n 20 "$build/build.log"
    exit 1
fi
exec ctest --test-dir "$build" --no-tests=error --output-on-failure -R "^($(IFS='|' && echo "${tests[*]}")|test_examples)\$"
