#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# clang-format over everything, clang-tidy (checks in .clang-tidy) and cppcheck (exceptions in .cppcheck) over all
# sources, or over the FILEs given:
#     tools/scripts/lint.sh [FILE...]
# Fails if any of them reports a finding.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
cd "$root"
build=$root/build/lint
mkdir -p "$build"
cmake -S . -B "$build" -DCMAKE_BUILD_TYPE=Release >"$build/cmake.log"

files=("$@")
if [ $# = 0 ]; then
    files=(src/*/*.c src/*/*.cpp bvh/*.c spare/*.c tools/*/*.c tests/*/*.c)
fi
failed=0
git ls-files '*.c' '*.h' '*.cpp' '*.inl' | xargs clang-format --dry-run -Werror || failed=1
# One process per file: clang-analyzer 14 confuses the va_lists of several files.
printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 1 clang-tidy -p "$build" --quiet 2>"$build/clang-tidy.log" || failed=1
cppcheck --quiet --enable=warning,performance,portability --error-exitcode=1 --inline-suppr --suppressions-list=.cppcheck \
    --std=c17 --library=posix -j "$(nproc)" -I include -I src -I . -I tools -I tests -I tests/fuzz -D_GNU_SOURCE -DSGSI_AVX_KERNELS=1 \
    -DSGSI_EMBREE_MAJOR=3 "${files[@]}" || failed=1
[ "$failed" = 0 ] && echo "lint: ${#files[@]} files, no findings"
exit "$failed"
