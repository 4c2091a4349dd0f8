#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# calls_have_no_circle: the object files of src/, bvh/ and spare/ call each other without a circle.
# global_symbols_have_a_prefix: every global C symbol of the static library has one of its prefixes.
set -euo pipefail
library=$SPAREGS_BUILD/libsparegs.a
if [ ! -e "$library" ]; then
    echo "skipped: this build has no static library"
    exit 77
fi
edges=$(mktemp)
trap 'rm -f "$edges" "$edges.loops"' EXIT
nm -A "$library" | sed -E 's/^[^:]*:([^:]*):/\1 /' | awk '
    NF == 4 && $3 ~ /^[TDBRVW]$/ { home[$4] = $1 }
    NF == 3 && $2 == "U" { caller[++n] = $1; called[n] = $3 }
    END { for (i = 1; i <= n; ++i) if (called[i] in home && home[called[i]] != caller[i]) print caller[i], home[called[i]] }' |
    sort -u >"$edges"
[ "$(wc -l <"$edges")" -gt 100 ] || { echo "FAIL: only $(wc -l <"$edges") calls between files were seen"; exit 1; }
if ! tsort "$edges" >/dev/null 2>"$edges.loops"; then
    echo "FAIL: circle of calls: $(grep -v 'input contains a loop' "$edges.loops" | sed 's/tsort: //' | tr '\n' ' ')"
    exit 1
fi
echo "no circle in $(wc -l <"$edges") calls between files"

# C++ names are mangled (_Z); names that begin with two underscores, and DW.ref, are the compiler's.
nm -g --defined-only "$library" | awk 'NF == 3 { print $3 }' | sort -u >"$edges"
[ "$(wc -l <"$edges")" -gt 500 ] || { echo "FAIL: only $(wc -l <"$edges") global symbols were seen"; exit 1; }
if foreign=$(grep -Ev '^(sgs_|sgsi_|spare_|_Z|__|DW\.ref\.)' "$edges"); then
    echo "FAIL: global symbols without the prefix sgs_, sgsi_ or spare_, which a program may have, too:" $foreign
    exit 1
fi
echo "all of $(wc -l <"$edges") global symbols have a prefix"
