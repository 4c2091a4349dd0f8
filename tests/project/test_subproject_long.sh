#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# subproject_does_not_change_the_parent: the consumer project adds the sources with add_subdirectory as a shared library,
# builds and runs. Its settings do not change (consumer/CMakeLists.txt compares them), and the subproject installs nothing,
# registers no test and builds no program.
# shared_library_exports_only_public_functions: it exports all functions declared in include/ and no others, and the program
# needs no others. The headers and the library have the same version.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
build=$temporary/build

builds() {
    cmake -S "$SPAREGS_SOURCE/tests/project/consumer" -B "$build" -DCONSUMER_SUBPROJECT="$SPAREGS_SOURCE" -DBUILD_SHARED_LIBS=ON \
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

# exported LIBRARY: its exported functions and data.
exported() { nm -D --defined-only "$1" | awk '{ sub(/@.*/, "", $3); print $3 }' | sort -u; }
# Declarations: SGS_API, a type, the name; clang-format may break the line before the name.
cat "$SPAREGS_SOURCE"/include/sparegs/*.h | tr '\n' ' ' | grep -oE 'SGS_API [a-z_0-9* ]*\bsgs_[a-z_0-9]+\(' |
    grep -oE 'sgs_[a-z_0-9]+\($' | tr -d '(' | sort -u >"$temporary/declared"
exported "$(find "$build" -name libsparegs.so)" >"$temporary/exported"
[ "$(wc -l <"$temporary/declared")" -gt 100 ] || { echo "FAIL: only $(wc -l <"$temporary/declared") declarations are seen"; exit 1; }
diff "$temporary/declared" "$temporary/exported" >"$temporary/difference" ||
    { echo "FAIL: declared (<) and exported (>) functions differ"; cat "$temporary/difference"; exit 1; }

# A function without SGS_API would be missing from a shared build.
unmarked=$(grep -HnE '^(const |unsigned |struct )?[a-z_0-9]+ \**sgs_[a-z_0-9]+\(' "$SPAREGS_SOURCE"/include/sparegs/*.h || true)
[ -z "$unmarked" ] || { printf 'FAIL: declared without SGS_API:\n%s\n' "$unmarked"; exit 1; }

# The objects of the program: what they need of the library.
find "$SPAREGS_BUILD"/CMakeFiles/sparegs-{tools,cli}.dir -name '*.o' -exec nm -u {} + |
    sed -nE 's/^ +U (sgsi?_[a-z_0-9]+)$/\1/p' | sort -u >"$temporary/needed"
[ "$(wc -l <"$temporary/needed")" -gt 100 ] || { echo "FAIL: only $(wc -l <"$temporary/needed") functions of the program are seen"; exit 1; }
internal=$(comm -13 "$temporary/exported" "$temporary/needed")
[ -z "$internal" ] || { printf 'FAIL: the program needs functions that are not exported:\n%s\n' "$internal"; exit 1; }

version=$(printf '#include <sparegs/version.h>\nSGS_VERSION' | "$CC" -E -P -I"$SPAREGS_SOURCE/include" - | tr -d '" \n')
linked=$("$SPAREGS_BUILD/sparegs" --version | sed -n '1s/^sparegs \([^ ]*\).*/\1/p')
configured=$(sed -n 's/^CMAKE_PROJECT_VERSION:[A-Z]*=//p' "$SPAREGS_BUILD/CMakeCache.txt")
[ "$version" = "$linked" ] && [ "$version" = "$configured" ] ||
    { echo "FAIL: version $version of the headers, $linked of the library, $configured of the project"; exit 1; }
echo "$(wc -l <"$temporary/exported") exported functions, all declared"
