#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The logic of the pages without a browser: see page_logic.js. Skipped without node.
set -euo pipefail
if ! command -v node >/dev/null; then
    echo "skipped: node is not installed; tools/setup.sh installs it"
    exit 77
fi
node "$SPAREGS_SOURCE/tests/viewer/page_logic.js"
