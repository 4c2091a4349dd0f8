#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Lists what the last run of CTest has skipped, with the reasons: lines `skipped: REASON` of tests. CTest itself only
# reports tests that are skipped as a whole: a cmocka program with skipped tests has passed, and so has a script that
# leaves out a part.
#     tools/scripts/skipped_tests.sh LOG       LOG: Testing/Temporary/LastTest.log in the build folder
# With SPAREGS_NO_SKIP=1 it fails if there are any.
set -euo pipefail

[ -e "$1" ] || exit 0 # no test has run
skipped=$(awk '
    function part(name) { print test ": " (name == "" ? "" : name ": ") (reason == "" ? "no reason given" : reason); reason = "" }
    /^[0-9]+\/[0-9]+ Testing: / { test = $3; reason = ""; split("", named) }
    sub(/^skipped: /, "") { if (reason != "") part(""); reason = $0; next }
    /^\[  SKIPPED \] [A-Za-z_]/ { if (!($4 in named)) part($4); named[$4]; next } # cmocka lists them once more at the end
    /^<end of output>/ { if (reason != "") part("") }' "$1")
[ -n "$skipped" ] || exit 0
echo "Skipped on this machine:"
while IFS= read -r line; do echo "    $line"; done <<<"$skipped"
if [ "${SPAREGS_NO_SKIP:-0}" = 1 ]; then
    echo "SPAREGS_NO_SKIP=1: skipped tests are failures" >&2
    exit 1
fi
