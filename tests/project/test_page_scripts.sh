#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# variables_of_the_pages_are_assigned: a variable that a page declares with `let` and no value is given one elsewhere.
# Needs no browser; test_view_browser_long operates the pages.
set -euo pipefail
cd "$SPAREGS_SOURCE"
python3 - src/web_page/web_page.js <(cat tools/viewer/page_*.js) <<'CHECK'
import re
import sys

failed, seen = 0, 0
for path in sys.argv[1:]:
    text = re.sub(r"//[^\n]*", "", open(path, encoding="utf-8").read())
    for declaration in re.findall(r"^\s*let ([^;]*);", text, re.M):
        for name in re.findall(r"(?:^|,)\s*(\w+)\s*(?=,|$)", re.sub(r"[\[({].*?[\])}]", "", declaration)):
            seen += 1
            alone = rf"(?<!const )(?<!let )\b{name}\s*(?:[-+*/]?=(?!=)|\+\+)|\+\+{name}\b"
            among = rf"(?<!const )(?<!let )\[[^\]\n]*\b{name}\b[^\]\n]*\] = "
            if not re.search(f"{alone}|{among}", text.replace(f"let {declaration};", "")):
                print(f"FAIL: {path}: {name} is declared, but nothing assigns it")
                failed += 1
if seen < 5:
    sys.exit(f"FAIL: only {seen} declarations were found")
print(f"{seen} variables are assigned")
sys.exit(failed > 0)
CHECK
