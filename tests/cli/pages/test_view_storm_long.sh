#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# 10 000 malformed frames and requests against the viewer under the address and undefined-behaviour sanitizers: it serves
# afterwards, its memory is bounded, and it ends with status 0, which a leak prevents.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
cd "$SPAREGS_SOURCE" || exit 1
cmake --preset asan -B "$SPAREGS_BUILD/asan" >/dev/null || exit 1
cmake --build "$SPAREGS_BUILD/asan" -j "$(nproc)" --target sparegs-cli >"$temporary/build.log" 2>&1 || { tail "$temporary/build.log"; exit 1; }
run 0 train "$room" -o "$temporary/run" --iterations 60 --downscale 8 --quiet
sanitized=$SPAREGS_BUILD/asan/sparegs
last_command="sparegs view"
"$sanitized" view "$temporary/run" "$room" --downscale 8 --port 0 >"$temporary/url" 2>"$temporary/stderr" &
server=$!
for _ in $(seq 600); do
    [ -s "$temporary/url" ] && break
    sleep 0.1
done
url=$(head -1 "$temporary/url")
resident() { awk '/^VmRSS/ { print $2 }' "/proc/$server/status"; }
python3 "$SPAREGS_SOURCE/tests/cli/pages/view_client.py" "$url" storm 2000 >"$temporary/page" 2>&1
first=$(resident)
status=0
python3 "$SPAREGS_SOURCE/tests/cli/pages/view_client.py" "$url" storm "${STORM:-10000}" >"$temporary/page" 2>&1 || status=$?
cat "$temporary/page"
check serves_after_the_storm test "$status" -eq 0
last=$(resident)
echo "resident after 2000 inputs: $first kB, after ${STORM:-10000} more: $last kB"
check memory_is_bounded test "$last" -lt $((2 * first))
kill -TERM "$server"
status=0
wait "$server" || status=$?
check ends_with_status_0 test "$status" -eq 0
check no_finding bash -c "! grep -E 'Sanitizer|runtime error' '$temporary/stderr'"
finish
