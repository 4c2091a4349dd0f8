#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# layout_holds: all #includes follow the tables below; there are no cycles between files or folders; all source files
# are in folders of the tables; no folder of the tables is empty; all files named in src/README.md exist. Calls between
# object files are checked by test_calls.sh.
set -euo pipefail
cd "$SPAREGS_SOURCE"
shopt -s nullglob

failures=0
fail() {
    printf 'FAIL: %s\n' "$1"
    failures=$((failures + 1))
}

# Folder of src/ -> the folders it may include besides itself, base, simd and public headers.
declare -A src_may=(
    [base]="" [simd]="" [rays]="" [image]="" [model]=""
    [storage]="model"
    [ply]="model storage"
    [sog]="storage"
    [usd]="model storage"
    [web_page]="storage sog"
    [formats]="model storage ply sog usd web_page"
    [scene]="rays image model storage ply"
    [loss]="image"
    [reference]="rays"
    [trace]="rays model bvh"
    [optimize]="trace"
    [render]="rays model trace optimize"
    [density]="model spare"
    [cluster]=""
    [train]="rays image model ply scene loss reference trace optimize density cluster bvh spare"
    [prune]="rays model trace"
    [compress]="model storage trace scene image loss optimize prune"
    [measure]="rays image model scene loss reference trace optimize density train bvh spare"
)
# Folder of tools/ -> the folders it may include besides itself and public headers.
declare -A tools_may=(
    [cli]=""
    [options]="cli"
    [processes]="options cli"
    [arguments]="processes options cli"
    [cameras]="arguments options cli"
    [plan]="processes options cli"
    [run]="arguments processes options cli"
    [blocks]="run arguments processes cli"
    [draw]="run cameras arguments processes options cli"
    [report]="draw run cameras cli"
    [viewer]="draw run cameras arguments processes cli"
    [commands]="viewer report draw blocks run plan cameras arguments processes options cli"
)
# Folders of tools/ without C sources, and of tests/ that mirror no folder of src/.
tools_other=" bench examples experiments manual package scripts "
tests_other=" bvh spare cli viewer project support fuzz data "

allowed() { # WORD LIST
    [[ " $2 " == *" $1 "* ]]
}

# ---- All files are in folders of the tables, and no folder of the tables is empty ----
for file in src/* tools/*; do
    case $file in
        src/README.md | tools/setup.sh | tools/test.sh | tools/demo.sh) ;;
        *) [ -d "$file" ] || fail "$file is not in a folder" ;;
    esac
done
for folder in src/*/; do
    name=${folder%/} name=${name##*/}
    [ -n "${src_may[$name]+set}" ] || fail "src/$name is not in the table of this test"
done
for folder in tools/*/; do
    name=${folder%/} name=${name##*/}
    [ -n "${tools_may[$name]+set}" ] || allowed "$name" "$tools_other" || fail "tools/$name is not in the table of this test"
done
for name in "${!src_may[@]}"; do
    files=(src/"$name"/*.[ch] src/"$name"/*.cpp src/"$name"/*.inl)
    [ ${#files[@]} -gt 0 ] || fail "src/$name has no file"
done
for name in "${!tools_may[@]}"; do
    files=(tools/"$name"/*.[ch])
    [ ${#files[@]} -gt 0 ] || fail "tools/$name has no file"
done
for file in src/*/*/* bvh/*/* spare/*/* include/sparegs/*/* tools/{cli,options,processes,arguments,cameras,run,draw,report,viewer,commands}/*/* tests/*.c tests/*.sh; do
    fail "$file is not in a folder of the tables"
done
for folder in tests/*/; do
    name=${folder%/} name=${name##*/}
    [ -n "${src_may[$name]+set}" ] || allowed "$name" "$tests_other" || fail "tests/$name mirrors no folder"
done

# ---- All #includes follow the tables ----
standard='(assert|ctype|errno|fenv|float|inttypes|limits|math|stdalign|stdarg|stdatomic|stdbool|stddef|stdint|stdio|stdlib|string|time)\.h'
public=(include/sparegs/*.h)
src=(src/*/*.c src/*/*.cpp src/*/*.h src/*/*.inl)
bvh=(bvh/*.c bvh/*.h)
spare=(spare/*.c spare/*.h)
tools=(tools/*/*.c tools/*/*.h)
# Lines "FILE INCLUDED" of the quoted includes of the files.
quoted() { grep -HE '^[[:space:]]*#[[:space:]]*include[[:space:]]*"' "$@" | sed -E 's/^([^:]*):[^"]*"([^"]*)".*/\1 \2/'; }
# The same for bracketed includes.
bracketed() { grep -HE '^[[:space:]]*#[[:space:]]*include[[:space:]]*<' "$@" | sed -E 's/^([^:]*):[^<]*<([^>]*)>.*/\1 \2/'; }

edges=$(mktemp)
trap 'rm -f "$edges" "$edges.folders" "$edges.loops"' EXIT
while read -r file included; do
    target=
    case $included in sparegs/*) continue ;; esac
    case $file in
        src/*)
            from=${file#*/} to=${included%%/*}
            from=${from%%/*}
            if [ "$to" = bvh ] || [ "$to" = spare ]; then target=$included; else target=src/$included; fi
            allowed "$to" "$from base simd ${src_may[$from]-}" || fail "$file may not include $included: src/$from sees ${src_may[$from]:-only base and simd}"
            ;;
        bvh/*)
            to=${included%%/*}
            target=$included
            [ "$to" = bvh ] || target=src/$included
            allowed "$to" "bvh base" || fail "$file may not include $included: bvh/ sees base only"
            ;;
        spare/*)
            target=$included
            [ "${included%%/*}" = spare ] || fail "$file may not include $included: spare/ sees its own header and the standard library"
            ;;
        tools/*)
            from=${file#*/} to=${included%%/*}
            from=${from%%/*}
            target=tools/$included
            allowed "$to" "$from ${tools_may[$from]-}" || fail "$file may not include $included: tools/$from sees ${tools_may[$from]:-public headers only}"
            ;;
        include/*)
            fail "$file may not include $included: public headers include standard headers and each other"
            continue
            ;;
    esac
    if [ -e "$target" ]; then
        echo "$file $target" >>"$edges"
    else
        fail "$file includes $included, which does not exist; includes name the folder"
    fi
done < <(quoted "${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}")
while read -r file included; do
    case $file in
        include/* | spare/*) [[ $included =~ ^$standard$ ]] || fail "$file may not include <$included>: standard headers only" ;;
    esac
    case $included in
        embree* | rtcore*) [ "$file" = bvh/embree_include.h ] || fail "$file may not include <$included>: only bvh/embree_include.h does" ;;
    esac
done < <(bracketed "${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}")
[ "$(wc -l <"$edges")" -gt 100 ] || fail "only $(wc -l <"$edges") includes were seen"

# ---- No cycles between files or folders ----
tsort "$edges" >/dev/null 2>"$edges.loops" || fail "circle between files: $(grep -v 'input contains a loop' "$edges.loops" | sed 's/tsort: //' | tr '\n' ' ')"
sed -E 's:^(src|tools)/([^/]*)/[^ ]* :\1/\2 :; s:^(bvh|spare)/[^ ]* :\1 :; s: (src|tools)/([^/]*)/.*: \1/\2:; s: (bvh|spare)/.*: \1:' "$edges" |
    awk '$1 != $2 && !($1 == "bvh" && $2 == "src/base")' | sort -u >"$edges.folders"
tsort "$edges.folders" >/dev/null 2>"$edges.loops" || fail "circle between folders: $(grep -v 'input contains a loop' "$edges.loops" | sed 's/tsort: //' | tr '\n' ' ')"

# ---- Size, licence, names, forbidden contents ----
sources=("${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}" tests/*/*.[ch] tests/*/*.inl tests/*/*.sh tools/*.sh
    tests/cli/*/*.sh tools/scripts/*.sh CMakeLists.txt tests/CMakeLists.txt)
while read -r lines file; do
    [ "$file" = total ] || [ "$lines" -le 800 ] || fail "$file has $lines lines; split files of more than 800"
done < <(wc -l "${sources[@]}")
while read -r file; do
    fail "$file names no licence"
done < <(grep -L 'SPDX-License-Identifier: Apache-2.0' "${sources[@]}")
duplicates=$(printf '%s\n' "${sources[@]##*/}" | grep -v '^CMakeLists.txt$' | sort | uniq -d)
[ -z "$duplicates" ] || fail "file names are unique in the repository: $duplicates"
# deny REASON PATTERN FILE...: fails if a line of the files matches, unless it has the text $allowed.
deny() {
    local why=$1 pattern=$2 found
    shift 2
    if found=$(grep -nHE -- "$pattern" "$@" | grep -v -- "${allowed:-^$}"); then
        fail "$why:
$found"
    fi
}
deny "a path of one machine" '(^|[^[:alnum:]_.])/(home|root|work|Users|mnt)/[[:alnum:]_]' "${sources[@]}" ./*.md src/*.md tools/manual/*.md
allowed="srun --mpi=list" deny "a message of the library names a flag of the command line; name the option's field" '"[^"]*--[a-z]' "${src[@]}" "${bvh[@]}" "${spare[@]}"
deny "unfinished work" '\b(TODO|FIXME|XXX)\b' "${public[@]}" "${src[@]}" "${bvh[@]}" "${spare[@]}" "${tools[@]}"

# ---- Architecture page ----
if [ -e src/README.md ]; then
    while read -r named; do
        [ -e "$named" ] || [ -e "src/$named" ] || fail "src/README.md names $named, which does not exist"
    done < <(grep -oE '\b(src/|bvh/|spare/|tools/|tests/|include/)?[a-z_0-9]+/[a-z_0-9/]+\.(c|h|cpp|inl|sh)\b' src/README.md | sort -u)
    # `folder/file.c:name`: the name occurs in the file.
    functions=$(grep -oE '`[A-Za-z_0-9./]+\.(c|h|cpp|inl|sh):[A-Za-z_][A-Za-z_0-9]*`' src/README.md | tr -d '`' | sort -u)
    [ "$(wc -l <<<"$functions")" -gt 100 ] || fail "src/README.md names fewer than 100 functions"
    while IFS= read -r missing; do
        fail "src/README.md names $missing, which does not contain it"
    done < <(awk -F: '
        function found(file, name, line) {
            if (!(file in text)) {
                while ((getline line <file) > 0) text[file] = text[file] "\n" line
                close(file)
                gsub(/[^A-Za-z0-9_]+/, " ", text[file])
            }
            return index(text[file] " ", " " name " ")
        }
        !found($1, $2) && !found("src/" $1, $2) { print $2 " in " $1 }' <<<"$functions")
    # The tables of folders: | `name/` | contents | may include |
    architecture=$(<src/README.md)
    has_row() { # FOLDER ALLOWED
        [[ $architecture =~ $'\n'"| \`$1/\` | "[^$'\n']*"| $2${2:+ }|"$'\n' ]] || fail "src/README.md lacks a row of $1/ that allows: ${2:-nothing more}"
    }
    for name in "${!src_may[@]}"; do has_row "$name" "${src_may[$name]}"; done
    for name in "${!tools_may[@]}"; do has_row "$name" "${tools_may[$name]}"; done
else
    fail "src/README.md is missing"
fi

[ "$failures" -eq 0 ] && echo "layout holds over ${#sources[@]} files and $(wc -l <"$edges") includes"
