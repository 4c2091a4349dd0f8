# shellcheck shell=bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Functions shared by the tests of the program: a temporary folder, runs with an expected exit status, checks named after
# the property. Sourced by test_cli_*.sh; call `finish` last.

program=$SPAREGS_PROGRAM
# shellcheck disable=SC2034 # used by the tests
room=$SPAREGS_SOURCE/tests/data/room
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
failures=0
checks=0
bad_inputs=0 # runs that failed and whose message was checked

# run STATUS ARGUMENT...: runs the program; its output is in $temporary/stdout and stderr.
run() {
    local expected=$1 status=0
    shift
    refused=$((expected == 1 || expected == 2))
    last_command="sparegs $*"
    "$program" "$@" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
    check "exit_status_$expected" test "$status" -eq "$expected"
}

# is_sanitized [address|thread]: the program is built with a sanitizer: it is slow and uses more memory.
is_sanitized() { grep -qE "^SPAREGS_SANITIZE:[A-Z]*=${1:-.}" "$SPAREGS_BUILD/CMakeCache.txt"; }

# is_long: the test is run by test_cli_parts_long, with the parts that are too slow for every run.
is_long() { [ -n "${SPAREGS_LONG:-}" ]; }

# installed PROGRAM: for parts of a test that use a program which is not required; reports that they are skipped.
installed() {
    command -v "$1" >/dev/null && return
    echo "skipped: $1 is not installed"
    return 1
}

# find_mpirun: sets launcher to mpirun with its options; without it or a plug-in the test is skipped.
find_mpirun() {
    if ! command -v mpirun >/dev/null || ! ls "$SPAREGS_BUILD"/ranks-*.so >/dev/null 2>&1; then
        echo "skipped: mpirun or the MPI plug-in is missing (install libopenmpi-dev and openmpi-bin)"
        exit 77
    fi
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    launcher=(mpirun)
    if mpirun --version 2>&1 | grep -q "Open MPI"; then
        launcher+=(--oversubscribe --bind-to none)
    fi
}

# find_torch: sets python to an interpreter with NumPy and PyTorch; without one the test is skipped.
find_torch() {
    for python in python3 /usr/bin/python3; do
        if "$python" -c 'import numpy, torch' 2>/dev/null; then return; fi
    done
    echo "skipped: PyTorch is not installed; tools/setup.sh --long installs it"
    exit 77
}

# check PROPERTY COMMAND...: the command must succeed.
check() {
    local property=$1
    shift
    checks=$((checks + 1))
    if ! "$@" >"$temporary/check" 2>&1; then
        failures=$((failures + 1))
        echo "FAIL: $property after: $last_command"
        echo "      checked by: $*"
        sed 's/^/      /' "$temporary/check" "$temporary/stderr" | head -20
    fi
}

# reports TEXT: stderr contains the text. one_line: stderr is a single line that begins as errors do.
reports() {
    check "stderr_has: $1" grep -qF -- "$1" "$temporary/stderr"
    bad_inputs=$((bad_inputs + ${refused:-0}))
    refused=0
}
# ranks STATUS COUNT ARGUMENT...: as run, on COUNT ranks, for at most ranks_seconds. mpirun adds lines of its own after a failure.
ranks() {
    local expected=$1 count=$2 status=0
    shift 2
    refused=$((expected == 1 || expected == 2))
    last_command="mpirun -n $count sparegs $*"
    timeout "$ranks_seconds" "${launcher[@]}" -n "$count" "$program" "$@" >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
    check "exit_status_$expected" test "$status" -eq "$expected"
}
# one_voice: one rank has printed one message; other lines are those of mpirun, and the warning that the ranks share cores.
one_voice() { check one_line_of_sparegs test "$(grep '^sparegs: ' "$temporary/stderr" | grep -vc ' oversubscribe the ')" = 1; }
# exr_size FILE: of its display window, which begins at 0.
exr_size() { exrheader "$1" | sed -n 's/^displayWindow .*: (0 0) - (\([0-9]*\) \([0-9]*\))$/\1 \2/p' | awk '{ print $1 + 1 "x" $2 + 1 }'; }
prints() { check "stdout_has: $1" grep -qF -- "$1" "$temporary/stdout"; }
one_line() { check one_line_of_error test "$(grep -c '^sparegs: ' "$temporary/stderr")" = "$(wc -l <"$temporary/stderr")" -a \
    "$(wc -l <"$temporary/stderr")" = 1; }
# json FILE EXPRESSION: the jq expression is true.
json() { check "json: $2" jq -e "$2" "$1"; }

finish() {
    echo "$((checks - failures)) of $checks checks passed"
    echo "bad inputs: $bad_inputs"
    [ "$failures" -eq 0 ]
}
