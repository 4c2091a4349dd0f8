#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Fuzzes the readers with libFuzzer under address and undefined-behaviour sanitizers:
#     tools/scripts/fuzz.sh [SECONDS [TARGET...]]        300 seconds each, all targets
# Writes new inputs to build/fuzz/corpus and failures to build/fuzz/found; prints the number of executions per target and in
# total. Fails if any target fails.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
seconds=${1:-300}
shift || true
cd "$root"
build=$root/build/fuzz
cmake --preset fuzz >"$root/build/fuzz.log"
targets=("$@")
if [ $# = 0 ]; then
    for folder in tests/fuzz/corpus/*/; do
        targets+=("$(basename "$folder")")
    done
fi
cmake --build "$build" -j "$(nproc)" --target "${targets[@]/#/fuzz_}" >>"$root/build/fuzz.log"

mkdir -p "$build/found"
total=0
failed=0
for target in "${targets[@]}"; do
    mkdir -p "$build/corpus/$target"
    log=$build/$target.log
    UBSAN_OPTIONS=print_stacktrace=1 "$build/tests/fuzz/fuzz_$target" -max_total_time="$seconds" -timeout=60 \
        -rss_limit_mb=2048 -malloc_limit_mb=512 -max_len=65536 -verbosity=0 -print_final_stats=1 \
        -artifact_prefix="$build/found/$target-" "$build/corpus/$target" "tests/fuzz/corpus/$target" >"$log" 2>&1 || {
        failed=$((failed + 1))
        echo "$target: FAILED, see $log and $build/found"
    }
    executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    printf '%-24s %12s executions\n' "$target" "${executions:-0}"
    total=$((total + ${executions:-0}))
done
printf '%-24s %12s executions, %s targets failed\n' all "$total" "$failed"
[ "$failed" = 0 ]
