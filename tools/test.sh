#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Installs missing packages, builds and runs the tests; with --long also the tests that take minutes each.
# Further arguments are passed to ctest: tools/test.sh -R ply
# Lists at the end what was skipped on this machine; with SPAREGS_NO_SKIP=1 that is a failure.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tests=(-j $(($(nproc) + 2))) # most tests use one or two threads; some wait
setup=()
if [ "${1:-}" = --long ]; then
    tests=(-C long)
    setup=(--long)
    shift
fi

"$root/tools/setup.sh" "${setup[@]}"
cmake -S "$root" -B "$root/build" -DCMAKE_BUILD_TYPE=Release
cmake --build "$root/build" -j "$(nproc)"
log=$root/build/Testing/Temporary/LastTest.log
rm -f "$log"
status=0
ctest --test-dir "$root/build" --output-on-failure "${tests[@]}" "$@" || status=$?
"$root/tools/scripts/skipped_tests.sh" "$log" || status=1
exit "$status"
