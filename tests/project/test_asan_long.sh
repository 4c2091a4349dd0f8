#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The whole default suite under the address, undefined-behaviour and leak sanitizers. SUITE=regex selects tests.
set -euo pipefail
cd "$SPAREGS_SOURCE"

# A planted fault ends a program with an error.
planted=$(mktemp -d)
trap 'rm -rf "$planted"' EXIT
cat >"$planted/overflow.c" <<'C'
#include <limits.h>

int main(int argc, char **argv)
{
    (void)argv;
    volatile int x = INT_MAX;
    x += argc;
    return 0;
}
C
flags=$(sed -n 's/.*INTERFACE -O1.*\(-fsanitize=address.*\)/\1/p' CMakeLists.txt)
[ -n "$flags" ] || { echo "FAIL: the flags of the sanitizers are not found in CMakeLists.txt"; exit 1; }
"${CC:-cc}" -g $flags "$planted/overflow.c" -o "$planted/overflow"
if "$planted/overflow" 2>/dev/null; then echo "FAIL: an overflow is not seen"; exit 1; fi

build=$SPAREGS_BUILD/asan
cmake --preset asan -DSPAREGS_PORTABLE=OFF -B "$build" >/dev/null
cmake --build "$build" -j "${JOBS:-$(nproc)}"
ctest --test-dir "$build" --no-tests=error --output-on-failure -R "${SUITE:-.}" -E 'test_package|test_setup' --timeout 1800
