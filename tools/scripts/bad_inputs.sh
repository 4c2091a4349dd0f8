#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Runs the tests of bad inputs in build/ and prints the number of cases per test. Each case checks the message.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
log=$root/build/bad_inputs.log
# Counted tests: programs with bad_input.h, scripts with cli_support.sh.
tests=$(cd "$root/tests" && grep -lE 'bad_input\.h"|cli_support\.sh"' */test_*.c */test_*.sh | sed 's:.*/::' | grep -v _long | sed 's/\.[a-z]*$//' | paste -sd'|')
status=0
ctest --test-dir "$root/build" -V -R "^($tests)\$" >"$log" 2>&1 || status=$?
awk '$1 == "test" { getline; name = "" }
    /^ *Start +[0-9]+:/ { names[$2 + 0] = $3 }
    / bad inputs: / { split($0, part, ":"); printf "%-24s %5d\n", names[part[1] + 0], $NF; sum += $NF }
    END { printf "%-24s %5d bad inputs, each with its message checked\n", "all", sum }' "$log"
[ "$status" = 0 ] || { echo "bad_inputs: a test failed, see $log"; exit 1; }
