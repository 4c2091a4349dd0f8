#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Fifty kills.
set -euo pipefail
KILLS=50 ITERATIONS=300 exec bash "$(dirname "$0")/test_crash.sh"
