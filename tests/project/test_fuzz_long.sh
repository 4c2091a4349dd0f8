#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Five minutes of fuzzing per reader, if clang and its sanitizers are installed.
set -euo pipefail
if ! command -v clang >/dev/null || [ ! -e "$(clang -print-file-name=libclang_rt.fuzzer-x86_64.a)" ]; then
    echo "skipped: clang with libFuzzer is not installed: tools/setup.sh --long installs it"
    exit 77
fi
exec "$SPAREGS_SOURCE/tools/scripts/fuzz.sh" "${FUZZ_SECONDS:-300}"
