#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# formats_agree_with_other_programs: see tools/scripts/compare_formats.sh. Skipped without node, python3 or the packages.
set -euo pipefail
for tool in node npm python3; do
    command -v "$tool" >/dev/null || { echo "skipped: $tool is not installed"; exit 77; }
done
exec "$SPAREGS_SOURCE/tools/scripts/compare_formats.sh"
