#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Tests with all their parts (is_long): stopped runs of more pipelines, errors of bench, the time limits of the viewer,
# all differences between ranks, all formats of models, more memory limits, slow examples, golden numbers of all pipelines
# with all instruction sets.
set -eu
export SPAREGS_LONG=1
failed=0
skipped=0
for name in test_cli_stop test_cli_bench test_cli_view test_cli_view_train test_cli_ranks test_cli_ranks_views test_cli_convert test_cli_memory test_cli_guard test_docs; do
    echo "== $name"
    status=0
    bash "$SPAREGS_SOURCE"/tests/cli/*/"$name.sh" || status=$?
    case $status in
    0) ;;
    77) skipped=1 ;;
    *) failed=1 ;;
    esac
done
echo "== test_golden"
"$SPAREGS_BUILD/tests/test_golden" || failed=1
[ "$failed" = 0 ] || exit 1
[ "$skipped" = 0 ] || exit 77
