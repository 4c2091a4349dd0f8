#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The page of `sparegs report` in a browser: loads without an error and shows its data. Skipped without Chromium.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

browser=$(command -v chromium || command -v chromium-browser || true)
if [ -z "$browser" ]; then
    echo "skipped: Chromium is not installed; tools/setup.sh --long installs it"
    exit 77
fi
load() { # PAGE: what is in the document once its script has run
    "$browser" --headless --no-sandbox --disable-gpu --enable-logging=stderr --virtual-time-budget=8000 \
        --user-data-dir="$temporary/profile" --dump-dom "file://$1" >"$temporary/dom" 2>"$temporary/console"
}
has() { check "$2 times $1" test "$(grep -o "$1" "$temporary/dom" | wc -l)" -eq "$2"; }

cat >"$temporary/plan.json" <<PLAN
{"title": "A </script><b>title", "scenes": [{"name": "room", "path": "$room"}], "pipelines": ["3dgs", "fastgs"],
 "options": {"iterations": 70, "downscale": 8, "eval": true},
 "post": [{"prune": {"method": "refine"}}]}
PLAN
run 0 experiment "$temporary/plan.json" -o "$temporary/out" --quiet
run 0 report "$temporary/out" --pictures 1
last_command="loading report.html"
load "$temporary/out/report.html"
check no_error_on_the_console test "$(grep -cE 'CONSOLE|Uncaught' "$temporary/console")" -eq 0
has '<polyline' 8                        # a curve per run, and its curve of size and quality
has '<circle' 20                         # a point per run, one for each curve of a single row, three per curve of size
has '<figcaption' 7                      # two plots of counts, one of quality, two of size, the phases, the map
has 'x="370"[^>]*text-anchor="end">70<' 2 # the last number of an axis is not cut
has 'data-drawn="7"' 1                   # set by the script's last line
has '<h1 id="title">A &lt;/script&gt;&lt;b&gt;title' 1  # texts are texts
check map_of_regions test "$(sed -n 's/.*id="regionMap">\(.*\)/\1/p' "$temporary/dom" | grep -o '<rect' | wc -l)" -gt 10

status=0
mkdir -p "$temporary/pages"
python3 "$SPAREGS_SOURCE/tests/cli/pages/report_browser.py" "$temporary/out/report.html" "$temporary/pages" >"$temporary/page" 2>&1 || status=$?
grep -vE '^ok ' "$temporary/page" || true
last_command="report_browser.py"
check the_page_fits_and_is_named test "$status" -eq 0 -a "$(grep -c '^ok ' "$temporary/page")" -gt 10

# The check detects an error.
sed "s/^'use strict';/'use strict'; nothing.here;/" "$temporary/out/report.html" >"$temporary/broken.html"
load "$temporary/broken.html"
check a_broken_page_is_noticed grep -q Uncaught "$temporary/console"
has 'data-drawn' 0
finish
