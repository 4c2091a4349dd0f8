#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# every_public_header_compiles_alone: as C17 and as C++17, without warnings, and included twice. sparegs.h includes all.
set -euo pipefail

failures=0
for header in "$SPAREGS_SOURCE"/include/sparegs/*.h; do
    name=sparegs/$(basename "$header")
    if [ "$name" != sparegs/sparegs.h ] && ! grep -q "#include \"$name\"" "$SPAREGS_SOURCE/include/sparegs/sparegs.h"; then
        echo "FAIL: sparegs.h does not include $name"
        failures=$((failures + 1))
    fi
    for language in c c++; do
        compiler=$CC
        [ "$language" = c ] || compiler=$CXX
        standard=${language}17
        if ! printf '#include "%s"\n#include "%s"\nextern int not_empty;\n' "$name" "$name" |
            "$compiler" -x "$language" -std="$standard" -Wall -Wextra -Wshadow -pedantic -Werror -fsyntax-only \
                -I"$SPAREGS_SOURCE/include" -; then
            echo "FAIL: $name does not compile alone as $standard"
            failures=$((failures + 1))
        fi
    done
done
[ "$failures" -eq 0 ]
