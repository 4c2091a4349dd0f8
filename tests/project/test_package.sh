#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# package_is_usable: installs into a temporary folder, then builds and runs the consumer project against it with
# find_package and with pkg-config.
set -euo pipefail

temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
prefix=$temporary/prefix

cmake --install "$SPAREGS_BUILD" --prefix "$prefix" >"$temporary/install.log" || { cat "$temporary/install.log"; exit 1; }
for file in bin/sparegs include/sparegs/trainer.h; do
    [ -e "$prefix/$file" ] || { echo "FAIL: $file is not installed"; exit 1; }
done
"$prefix/bin/sparegs" --version

build_consumer() {
    cmake -S "$SPAREGS_SOURCE/tests/project/consumer" -B "$temporary/build" -DCMAKE_PREFIX_PATH="$prefix" \
        -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX"
    cmake --build "$temporary/build"
}
build_consumer >"$temporary/log" 2>&1 || { cat "$temporary/log"; exit 1; }
"$temporary/build/consumer_c"
"$temporary/build/consumer_cpp"

export PKG_CONFIG_PATH
PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name sparegs.pc)")
read -ra flags <<<"$(pkg-config --static --cflags --libs sparegs)"
run_paths=()
for flag in "${flags[@]}"; do
    case $flag in -L*) run_paths+=("-Wl,-rpath,${flag#-L}") ;; esac
done
"$CC" -std=c17 "$SPAREGS_SOURCE/tests/project/consumer/consumer.c" "${flags[@]}" "${run_paths[@]}" -o "$temporary/by_pkg_config"
"$temporary/by_pkg_config"
