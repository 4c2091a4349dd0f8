#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# setup_without_apt_lists_the_packages: without dpkg and apt-get, tools/setup.sh prints the packages and succeeds, so that
# demo.sh and test.sh build with the libraries that are there.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
for tool in bash cut id; do ln -s "$(command -v $tool)" "$temporary/$tool"; done

status=0
PATH=$temporary bash "$SPAREGS_SOURCE/tools/setup.sh" >"$temporary/out" 2>"$temporary/err" || status=$?
[ "$status" -eq 0 ] || { echo "FAIL: status $status"; cat "$temporary/err"; exit 1; }
for package in cmake libembree-dev libopenimageio-dev libjansson-dev; do
    grep -q "^ *$package$" "$temporary/err" || { echo "FAIL: $package is not in the list"; cat "$temporary/err"; exit 1; }
done
# setup_for_the_long_tests_lists_more
PATH=$temporary bash "$SPAREGS_SOURCE/tools/setup.sh" --long 2>"$temporary/err"
for package in cmake clang cppcheck clang-tidy gcovr colmap; do
    grep -q "^ *$package$" "$temporary/err" || { echo "FAIL: --long does not list $package"; cat "$temporary/err"; exit 1; }
done
for script in "$SPAREGS_SOURCE"/tools/*.sh "$SPAREGS_SOURCE/.ci/run"; do
    [ -x "$script" ] || { echo "FAIL: $script is not executable"; exit 1; }
    bash -n "$script"
done
