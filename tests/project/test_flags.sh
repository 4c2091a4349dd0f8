#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# no_source_is_contracted: all sources of the library are compiled with -ffp-contract=off (compile_commands.json).
# include_folders_exist.
set -euo pipefail
cd "$SPAREGS_SOURCE"
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
commands=$SPAREGS_BUILD/compile_commands.json

# unmarked JSON: sources of the library without the flag, or with another -ffp-contract after it.
unmarked() {
    jq -r --arg root "$SPAREGS_SOURCE/" '.[] | (.file | ltrimstr($root)) + " " +
        ([(.command | split(" "))[] | select(startswith("-ffp-contract") or . == "-ffast-math" or . == "-Ofast")] | last // "none")' "$1" |
        sort -u >"$temporary/flags"
    # src/cluster/ranks_mpi.c is compiled for the MPI libraries that are installed.
    printf '%s\n' src/*/*.c src/*/*.cpp bvh/*.c spare/*.c | awk '
        NR == FNR { compiled[$1] = 1; if ($2 != "-ffp-contract=off") wrong[$1] = 1; next }
        $1 in wrong || !($1 in compiled) && $1 != "src/cluster/ranks_mpi.c"' "$temporary/flags" -
}

found=$(unmarked "$commands")
[ -z "$found" ] || { printf 'FAIL: compiled without -ffp-contract=off:\n%s\n' "$found"; exit 1; }

# check_detects_planted_faults
jq '(.[] | select(.file | endswith("spare/spare.c")) | .command) |= gsub("-ffp-contract=off"; "")' "$commands" >"$temporary/missing.json"
jq '(.[] | select(.file | endswith("bvh/bvh.c")) | .command) |= . + " -ffp-contract=fast"' "$commands" >"$temporary/later.json"
jq 'map(select(.file | endswith("image_oiio.cpp") | not))' "$commands" >"$temporary/absent.json"
[ "$(unmarked "$temporary/missing.json")" = spare/spare.c ] || { echo "FAIL: a missing flag is not seen"; exit 1; }
[ "$(unmarked "$temporary/later.json")" = bvh/bvh.c ] || { echo "FAIL: a later flag is not seen"; exit 1; }
[ "$(unmarked "$temporary/absent.json")" = src/image/image_oiio.cpp ] || { echo "FAIL: a missing file is not seen"; exit 1; }
# Quotes are those of a path with blanks.
jq -r '.[].command' "$commands" | grep -oE -- '-(I|isystem )("[^"]+"|[^ "]+)' | sed -E 's/^-(I|isystem )//; s/"//g' | sort -u >"$temporary/folders"
while read -r folder; do
    [ -d "$folder" ] || { echo "FAIL: the include folder $folder does not exist"; exit 1; }
done <"$temporary/folders"
echo "-ffp-contract=off: $(jq length "$commands") commands"
