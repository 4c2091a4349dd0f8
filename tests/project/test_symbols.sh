#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# shared_library_exports_only_public_functions: builds the shared library, the program and a test that uses internals,
# without optimisation. All functions declared in include/ are exported, and no others; the headers and the library have
# the same version.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT

builds() {
    cmake -S "$SPAREGS_SOURCE" -B "$temporary" -DBUILD_SHARED_LIBS=ON -DCMAKE_BUILD_TYPE=Debug -DCMAKE_C_FLAGS_DEBUG=-O0 \
        -DCMAKE_CXX_FLAGS_DEBUG=-O0 -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX"
    cmake --build "$temporary" -j "$(nproc)" --target sparegs sparegs-cli test_spare
}
builds >"$temporary/log" 2>&1 || { grep -E 'rror' "$temporary/log" || tail "$temporary/log"; echo "FAIL: no shared build"; exit 1; }

# exported LIBRARY: its exported functions and data.
exported() { nm -D --defined-only "$1" | awk '{ sub(/@.*/, "", $3); print $3 }' | sort -u; }
# Declarations: SGS_API, a type, the name; clang-format may break the line before the name.
cat "$SPAREGS_SOURCE"/include/sparegs/*.h | tr '\n' ' ' | grep -oE 'SGS_API [a-z_0-9* ]*\bsgs_[a-z_0-9]+\(' |
    grep -oE 'sgs_[a-z_0-9]+\($' | tr -d '(' | sort -u >"$temporary/declared"
exported "$temporary/libsparegs.so" >"$temporary/exported"
[ "$(wc -l <"$temporary/declared")" -gt 100 ] || { echo "FAIL: only $(wc -l <"$temporary/declared") declarations are seen"; exit 1; }
diff "$temporary/declared" "$temporary/exported" >"$temporary/difference" ||
    { echo "FAIL: declared (<) and exported (>) functions differ"; cat "$temporary/difference"; exit 1; }

# A function without SGS_API would be missing from a shared build.
unmarked=$(grep -HnE '^(const |unsigned |struct )?[a-z_0-9]+ \**sgs_[a-z_0-9]+\(' "$SPAREGS_SOURCE"/include/sparegs/*.h || true)
[ -z "$unmarked" ] || { printf 'FAIL: declared without SGS_API:\n%s\n' "$unmarked"; exit 1; }

version=$(printf '#include <sparegs/version.h>\nSGS_VERSION' | "$CC" -E -P -I"$SPAREGS_SOURCE/include" - | tr -d '" \n')
linked=$("$temporary/sparegs" --version | sed -n '1s/^sparegs \([^ ]*\).*/\1/p')
configured=$(sed -n 's/^CMAKE_PROJECT_VERSION:[A-Z]*=//p' "$temporary/CMakeCache.txt")
[ "$version" = "$linked" ] && [ "$version" = "$configured" ] ||
    { echo "FAIL: version $version of the headers, $linked of the library, $configured of the project"; exit 1; }
"$temporary/tests/test_spare" >/dev/null 2>&1 || { echo "FAIL: test_spare of the shared build"; exit 1; }
echo "$(wc -l <"$temporary/exported") exported functions, all declared"
