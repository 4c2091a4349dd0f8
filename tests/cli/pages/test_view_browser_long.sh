#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The viewer in headless Chromium: every control is operated and its effect checked (view_browser.py). Prints pictures per
# second and latency. Then the page of `view --export`, opened from a file (page_browser.py). Skipped without Chromium. VIEW_SCREENSHOTS=DIR keeps the screenshots.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
if ! command -v chromium chromium-browser google-chrome >/dev/null; then
    echo "skipped: Chromium is not installed; tools/setup.sh --long installs it"
    exit 77
fi
run 0 train "$room" -o "$temporary/run" --iterations 600 --downscale 2 --eval --quiet
mkdir -p "$temporary/pages"
status=0
python3 "$SPAREGS_SOURCE/tests/cli/pages/view_browser.py" "$program" "$temporary/run" "$room" "$temporary/pages" >"$temporary/page" 2>&1 || status=$?
grep -vE '^ok ' "$temporary/page"
last_command="view_browser.py"
check every_control_works test "$status" -eq 0 -a "$(grep -c '^ok ' "$temporary/page")" -gt 90
for picture in opened depth slider pixel crop phone fisheye; do
    check "screenshot: $picture" test -s "$temporary/pages/$picture.png"
done
status=0
python3 "$SPAREGS_SOURCE/tests/cli/pages/page_browser.py" "$program" "$temporary/run" "$temporary/pages" >"$temporary/page" 2>&1 || status=$?
grep -vE '^ok ' "$temporary/page"
last_command="page_browser.py"
check the_exported_page_works test "$status" -eq 0 -a "$(grep -c '^ok ' "$temporary/page")" -gt 30
if [ -n "${VIEW_SCREENSHOTS:-}" ]; then
    mkdir -p "$VIEW_SCREENSHOTS" && cp "$temporary"/pages/*.png "$VIEW_SCREENSHOTS"
fi
finish
