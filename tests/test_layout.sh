#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# layout_holds: the arrows between the folders, as include lines; the size of files; what must not be in any file.
set -euo pipefail
cd "$SPAREGS_SOURCE"
shopt -s nullglob

failures=0
# deny WHY PATTERN FILE...: no line of the files may match.
deny() {
    local why=$1 pattern=$2
    shift 2
    [ $# -gt 0 ] || return 0
    local found
    if found=$(grep -nHE -- "$pattern" "$@"); then
        printf 'FAIL: %s:\n%s\n' "$why" "$found"
        failures=$((failures + 1))
    fi
}
# Names of the headers of a folder as an alternation: a\.h|b\.h
headers_of() {
    (cd "$1" && printf '%s\n' *.h *.inl) | sed 's/\./\\./' | paste -sd'|'
}

include='^[[:space:]]*#[[:space:]]*include[[:space:]]*'
public=(include/sparegs/*.h)
src=(src/*.c src/*.cpp src/*.h src/*.inl)
bvh=(bvh/*.c bvh/*.h bvh/*.inl)
spare=(spare/*.c spare/*.h)
tools=(tools/*.c tools/*.h)
standard='(assert|ctype|errno|fenv|float|inttypes|limits|math|stdalign|stdarg|stdatomic|stdbool|stddef|stdint|stdio|stdlib|string|time)\.h'

deny "only bvh/*.c and its one internal header may include Embree" "${include}[<\"](embree[34]?|rtcore)" \
    "${public[@]}" "${src[@]}" "${spare[@]}" "${tools[@]}"
for file in "${public[@]}"; do
    if found=$(grep -nE "$include" "$file" | grep -vE "<$standard>|\"sparegs/[a-z0-9_]+\.h\""); then
        printf 'FAIL: public headers include standard headers and each other only:\n%s: %s\n' "$file" "$found"
        failures=$((failures + 1))
    fi
done
for file in "${spare[@]}"; do
    if found=$(grep -nE "$include" "$file" | grep -vE "<$standard>|\"($(headers_of spare))\""); then
        printf 'FAIL: spare/ is pure functions over its own headers and the standard library:\n%s: %s\n' "$file" "$found"
        failures=$((failures + 1))
    fi
done
deny "bvh/ does not see spare/" "${include}\"(spare/|$(headers_of spare))" "${bvh[@]}"
for file in "${tools[@]}"; do
    if found=$(grep -nE "${include}\"" "$file" | grep -vE "\"(sparegs/[a-z0-9_]+\.h|$(headers_of tools))\""); then
        printf 'FAIL: tools/ includes public headers and its own only:\n%s: %s\n' "$file" "$found"
        failures=$((failures + 1))
    fi
done

sources=("${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}" tests/*.c tests/*.h tests/*.sh tools/*.sh
    CMakeLists.txt tests/CMakeLists.txt)
for file in "${sources[@]}"; do
    lines=$(wc -l <"$file")
    if [ "$lines" -gt 800 ]; then
        echo "FAIL: $file has $lines lines; more than 800 belong into two files"
        failures=$((failures + 1))
    fi
    if ! grep -q 'SPDX-License-Identifier: Apache-2.0' "$file"; then
        echo "FAIL: $file names no licence"
        failures=$((failures + 1))
    fi
done
duplicates=$(for file in "${sources[@]}"; do basename "$file"; done | grep -v '^CMakeLists.txt$' | sort | uniq -d)
if [ -n "$duplicates" ]; then
    printf 'FAIL: file names are unique in the repository:\n%s\n' "$duplicates"
    failures=$((failures + 1))
fi
deny "a path of one machine" '(^|[^[:alnum:]_.])/(home|root|work|Users|mnt)/[[:alnum:]_]' "${sources[@]}" README.md CHANGELOG.md
deny "unfinished work" '\b(TODO|FIXME|XXX)\b' "${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}"

[ "$failures" -eq 0 ] && echo "layout holds over ${#sources[@]} files"
