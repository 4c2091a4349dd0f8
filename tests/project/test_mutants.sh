#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# each_fault_can_be_planted: the lines that tools/scripts/mutants.sh changes are in the sources.
set -euo pipefail
"$SPAREGS_SOURCE/tools/scripts/mutants.sh" --check
