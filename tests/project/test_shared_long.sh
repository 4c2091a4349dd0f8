#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# shared_build_works: the program and a test that uses internals, linked with the shared library, without optimisation.
# static_subproject_works: the consumer project with the sources as a static subproject. test_subproject_long builds a shared one.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT

# build LOG SOURCE TARGETS ARGUMENT...: configures and builds below $temporary/build.
build() {
    local log=$1 source=$2 targets=$3
    shift 3
    rm -rf "$temporary/build"
    {
        cmake -S "$source" -B "$temporary/build" -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX" "$@" &&
            # shellcheck disable=SC2086 # several words
            cmake --build "$temporary/build" -j "$(nproc)" --target $targets
    } >"$log" 2>&1 || { grep -E 'rror' "$log" || tail "$log"; echo "FAIL: no build of $targets"; exit 1; }
}

build "$temporary/log" "$SPAREGS_SOURCE" "sparegs sparegs-cli test_spare" -DBUILD_SHARED_LIBS=ON -DCMAKE_BUILD_TYPE=Debug \
    -DCMAKE_C_FLAGS_DEBUG=-O0 -DCMAKE_CXX_FLAGS_DEBUG=-O0
ldd "$temporary/build/sparegs" | grep -q 'libsparegs\.so' || { echo "FAIL: the program is linked with the static library"; exit 1; }
"$temporary/build/sparegs" --version
"$temporary/build/tests/test_spare" >/dev/null 2>&1 || { echo "FAIL: test_spare of the shared build"; exit 1; }

build "$temporary/log" "$SPAREGS_SOURCE/tests/project/consumer" all -DCONSUMER_SUBPROJECT="$SPAREGS_SOURCE"
"$temporary/build/consumer_c"
"$temporary/build/consumer_cpp"
