#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# skipped_parts_are_listed: tools/scripts/skipped_tests.sh on the log of a run of CTest, with a cmocka program and scripts
# that skip a part, everything or nothing. Strict mode fails if there is one.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
cd "$temporary"
cat >program.c <<'END'
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include "support/skip_support.h"
static void passes(void **state) { (void)state; }
static void lacks_a_unit(void **state) { (void)state; skip_because("no unit of size %d", 7); }
static void lacks_a_reason(void **state) { (void)state; skip(); }
int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(lacks_a_unit), cmocka_unit_test(passes), cmocka_unit_test(lacks_a_reason)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
END
read -ra cmocka <<<"$(pkg-config --cflags --libs cmocka)"
"$CC" -I "$SPAREGS_SOURCE/tests" program.c -o program "${cmocka[@]}"
cat >CTestTestfile.cmake <<END
add_test(program "$temporary/program")
add_test(complete "sh" "-c" "echo all is there; echo images are skipped: no")
add_test(part "sh" "-c" "echo 'skipped: tool is not installed'; echo 3 of 3 checks passed")
add_test(whole "sh" "-c" "echo 'skipped: no such processor'; exit 77")
set_tests_properties(whole PROPERTIES SKIP_RETURN_CODE 77)
END
ctest >output || { cat output; exit 1; }
list=$SPAREGS_SOURCE/tools/scripts/skipped_tests.sh
log=Testing/Temporary/LastTest.log
expect() { # STATUS COMMAND...: and the output in `expected`
    local expected=$1 status=0
    "${@:2}" >found 2>errors || status=$?
    [ "$status" -eq "$expected" ] || { echo "FAIL: status $status instead of $expected"; cat found errors; exit 1; }
    diff expected found || { echo "FAIL: another list"; exit 1; }
}
cat >expected <<'END'
Skipped on this machine:
    program: lacks_a_unit: no unit of size 7
    program: lacks_a_reason: no reason given
    part: tool is not installed
    whole: no such processor
END
unset SPAREGS_NO_SKIP
expect 0 "$list" "$log"
SPAREGS_NO_SKIP=0 expect 0 "$list" "$log"
SPAREGS_NO_SKIP=1 expect 1 "$list" "$log"
# every_script_reports_why_it_is_skipped
awk 'FNR == 1 { before = "" } /exit 77/ && before $0 !~ /skipped/ { print FILENAME ":" FNR; bad = 1 } { before = $0 } END { exit bad }' \
    "$SPAREGS_SOURCE"/tests/*/test_*.sh "$SPAREGS_SOURCE"/tests/cli/*/test_*.sh "$SPAREGS_SOURCE/tests/cli/cli_support.sh" || { echo "FAIL: these give no reason"; exit 1; }

# strict_mode_accepts_a_run_without_skipped_parts
: >expected
ctest -R complete >output
SPAREGS_NO_SKIP=1 expect 0 "$list" "$log"
SPAREGS_NO_SKIP=1 expect 0 "$list" no.log
