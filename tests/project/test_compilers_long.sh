#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# All sources build without warnings with gcc, clang 14 and clang 16 and give the golden numbers; then
# tools/scripts/lint.sh.
set -euo pipefail
missing=()
for program in clang clang-16 clang-tidy cppcheck; do
    command -v $program >/dev/null || missing+=("$program")
done
if [ ${#missing[@]} -gt 0 ]; then
    echo "skipped: not installed: ${missing[*]}; tools/setup.sh --long installs them"
    exit 77
fi
cd "$SPAREGS_SOURCE"
mkdir -p build

# builds NAME ARGUMENT...: configures and builds build/NAME.
builds() {
    local name=$1
    shift
    cmake -S . -B "build/$name" -DCMAKE_BUILD_TYPE=Release -DSPAREGS_WERROR=ON "$@" >"build/$name.log"
    if ! cmake --build "build/$name" -j "$(nproc)" >>"build/$name.log" 2>&1; then
        grep -E 'error:|warning:' "build/$name.log" || tail "build/$name.log"
        echo "FAIL: $name"
        exit 1
    fi
    echo "$name: $(sed -n 's/^CMAKE_C_COMPILER:[A-Z]*=//p' "build/$name/CMakeCache.txt") builds without a warning"
    ctest --test-dir "build/$name" --output-on-failure -R '^test_golden' || { echo "FAIL: golden numbers with $name"; exit 1; }
}
builds gcc -DCMAKE_C_COMPILER=gcc -DCMAKE_CXX_COMPILER=g++
builds clang -DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++
builds clang-16 -DCMAKE_C_COMPILER=clang-16 -DCMAKE_CXX_COMPILER=clang++-16

exec tools/scripts/lint.sh
