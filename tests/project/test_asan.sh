#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The quick part of the address and undefined-behaviour sanitizers: what reads files, the checkpoint with its tiny
# trainings, and spare/. test_asan_long runs everything, in the same folder.
set -euo pipefail
cd "$SPAREGS_SOURCE"
tests=(test_colmap test_transforms test_ply_errors test_checkpoint test_spare)
cmake --preset asan >/dev/null
cmake --build build/asan -j "$(nproc)" --target "${tests[@]}" | grep -E 'warning:|error:' || true
exec ctest --test-dir build/asan --output-on-failure -R "^($(IFS='|' && echo "${tests[*]}"))\$"
