#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the address, undefined-behaviour and leak sanitizers. SUITE=regex selects tests.
set -euo pipefail
cd "$SPAREGS_SOURCE"
cmake --preset asan >/dev/null
cmake --build build/asan -j "${JOBS:-$(nproc)}"
exec ctest --test-dir build/asan --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
