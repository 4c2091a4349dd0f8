#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the thread sanitizer. SUITE=regex takes a part of it.
set -euo pipefail
if ! command -v clang >/dev/null; then
    echo "clang is not installed; tools/setup.sh --long installs it"
    exit 77
fi
cd "$SPAREGS_SOURCE"
cmake --preset tsan >/dev/null
cmake --build build/tsan -j "${JOBS:-$(nproc)}"
ctest --test-dir build/tsan --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
