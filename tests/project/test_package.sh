#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# package_is_usable: installs into a temporary folder, then builds and runs the consumer project against it with
# find_package and with pkg-config, also as a plug-in. Absolute folders in sparegs.pc and in the run path.
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

# a_plug_in_may_be_unloaded_while_threads_remain
"$temporary/build/plugin_host" "$temporary/build/plugin.so" || { echo "FAIL: unloading a plug-in"; exit 1; }

export PKG_CONFIG_PATH
PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name sparegs.pc)")
read -ra flags <<<"$(pkg-config --static --cflags --libs sparegs)"
run_paths=()
for flag in "${flags[@]}"; do
    case $flag in -L*) run_paths+=("-Wl,-rpath,${flag#-L}") ;; esac
done
"$CC" -std=c17 "$SPAREGS_SOURCE/tests/project/consumer/consumer.c" "${flags[@]}" "${run_paths[@]}" -o "$temporary/by_pkg_config"
"$temporary/by_pkg_config"

# absolute_folders_remain_as_they_are
cmake -S "$SPAREGS_SOURCE" -B "$temporary/absolute" -DSPAREGS_TESTS=OFF -DBUILD_SHARED_LIBS=ON -DCMAKE_INSTALL_PREFIX="$temporary/a" \
    -DCMAKE_INSTALL_LIBDIR="$temporary/b/lib" -DCMAKE_INSTALL_INCLUDEDIR="$temporary/c/include" >"$temporary/log" 2>&1 ||
    { cat "$temporary/log"; exit 1; }
for expected in "libdir $temporary/b/lib" "includedir $temporary/c/include" "prefix $temporary/a"; do
    found=$(pkg-config --variable="${expected%% *}" "$temporary/absolute/sparegs.pc")
    [ "$found" = "${expected#* }" ] || { echo "FAIL: ${expected%% *} of sparegs.pc is $found"; exit 1; }
done
grep -qF "RPATH \"$temporary/b/lib\"" "$temporary/absolute/cmake_install.cmake" || { echo "FAIL: the run path of the program"; exit 1; }

# plug_ins_go_where_an_absolute_program_looks_for_them, whatever the prefix of the installation
cmake -S "$SPAREGS_SOURCE" -B "$temporary/split" -DSPAREGS_TESTS=OFF -DCMAKE_INSTALL_PREFIX="$temporary/a" -DCMAKE_INSTALL_LIBDIR=lib \
    -DCMAKE_INSTALL_BINDIR="$temporary/d/bin" >"$temporary/log" 2>&1 || { cat "$temporary/log"; exit 1; }
grep -qF "DESTINATION \"$temporary/a/lib/sparegs\" TYPE MODULE" "$temporary/split/cmake_install.cmake" ||
    { echo "FAIL: the folder of the plug-ins"; exit 1; }
