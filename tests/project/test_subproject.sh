#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# subproject_does_not_change_the_parent: the consumer project adds the sources with add_subdirectory, builds and runs. Its
# settings do not change (consumer/CMakeLists.txt compares them), and the subproject installs nothing, registers no test
# and builds no program.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
build=$temporary/build

builds() {
    cmake -S "$SPAREGS_SOURCE/tests/project/consumer" -B "$build" -DCONSUMER_SUBPROJECT="$SPAREGS_SOURCE" \
        -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX" -DCMAKE_EXPORT_COMPILE_COMMANDS=ON
    cmake --build "$build" -j "$(nproc)"
}
builds >"$temporary/log" 2>&1 || { grep -E 'rror' "$temporary/log" || tail "$temporary/log"; echo "FAIL: the consumer does not build"; exit 1; }
"$build/consumer_c"
"$build/consumer_cpp"

# A parent without a build type keeps none, and its files are compiled with its own flags only: none, or
# -std=gnu17 if that is not the compiler's default.
grep -q '^CMAKE_BUILD_TYPE:[A-Z]*=$' "$build/CMakeCache.txt" || { echo "FAIL: the build type of the parent changed"; exit 1; }
flags=$(jq -r '.[] | select(.file | endswith("/consumer.c")) | .command' "$build/compile_commands.json" |
    tr ' ' '\n' | grep '^-' | sed -E '/^-(I|o|c$)/d' | tr '\n' ' ')
[ -z "${flags#-std=gnu17 }" ] || { echo "FAIL: the parent's file is compiled with '$flags'"; exit 1; }

tests=$(ctest --test-dir "$build" -N | sed -n 's/^Total Tests: //p')
[ "$tests" = 0 ] || { echo "FAIL: the parent has $tests tests"; exit 1; }
cmake --install "$build" --prefix "$temporary/prefix" >/dev/null
installed=$(find "$temporary/prefix" -type f 2>/dev/null || true)
[ -z "$installed" ] || { printf 'FAIL: installed by a parent:\n%s\n' "$installed"; exit 1; }
[ ! -e "$build/sparegs/sparegs" ] || { echo "FAIL: the program was built"; exit 1; }
