#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Fifty kills, then twenty stops by SIGTERM.
set -euo pipefail
KILLS=50 ITERATIONS=300 bash "$(dirname "$0")/test_crash.sh"
SIGNAL=TERM KILLS=20 ITERATIONS=300 exec bash "$(dirname "$0")/test_crash.sh"
