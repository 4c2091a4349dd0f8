#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the thread sanitizer with clang's OpenMP runtime. SUITE=regex takes a part of it.
set -euo pipefail
if ! command -v clang >/dev/null || ! ldconfig -p | grep -q libomp; then
    echo "clang with its OpenMP runtime is not installed; tools/setup.sh --long installs it"
    exit 77
fi
cd "$SPAREGS_SOURCE"
cmake --preset tsan >/dev/null
cmake --build build/tsan -j "${JOBS:-$(nproc)}"
exec ctest --test-dir build/tsan --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
