#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Line coverage of the default tests by gcov and gcovr (installed by tools/setup.sh --long): a table for the readers, the
# checkpoint and spare/, and one line in total. Annotated sources are in build/coverage/html.
#     tools/scripts/coverage.sh [PERCENT]        fails if readers, checkpoint and spare/ are below PERCENT (default 90)
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
minimum=${1:-90}
build=$root/build/coverage
mkdir -p "$build"
cmake -S "$root" -B "$build" -DCMAKE_BUILD_TYPE=Coverage -DCMAKE_C_FLAGS="-O1 --coverage" \
    -DCMAKE_CXX_FLAGS="-O1 --coverage" >"$build/cmake.log"
cmake --build "$build" -j "$(nproc)" >"$build/build.log" 2>&1 || { tail "$build/build.log"; exit 1; }
find "$build" -name '*.gcda' -delete
ctest --test-dir "$build" -j "$(nproc)" -E 'test_package|test_setup|test_headers|test_layout' \
    >"$build/test.log" 2>&1 || { tail -n 20 "$build/test.log"; exit 1; }

cd "$root"
mkdir -p "$build/html"
report() { gcovr --root . --object-directory "$build" --gcov-ignore-parse-errors "$@" "$build" 2>"$build/gcovr.log"; }
echo "everything:"
report --filter 'src/|bvh/|spare/|tools/' --print-summary --html-details "$build/html/index.html" |
    grep -E '^lines'
echo "readers, checkpoint, spare/:"
report --filter 'src/(scene|storage|ply|sog|usd|web_page|formats)/' --filter 'src/image/(image|image_oiio|oiio_color|photo|mask)\.(c|cpp)$' \
    --filter 'src/.*/(sections|checkpoint|checkpoint_options)\.c$' --filter 'spare/.*\.c$' --filter 'tools/cameras/camera_file\.c$' --fail-under-line "$minimum"
