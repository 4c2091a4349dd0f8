#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# installed_program_finds_its_plugin: ranks of the program in an installed tree, also through a link. SPAREGS_MPI=OFF builds
# no plug-in, ON without an MPI library is refused, and the program itself is linked with none.
set -euo pipefail
temporary=$(mktemp -d)
trap 'rm -rf "$temporary"' EXIT
if [ ! -e "$SPAREGS_BUILD/ranks-openmpi.so" ] || ! mpirun --version 2>&1 | grep -q "Open MPI"; then
    echo "skipped: Open MPI or its plug-in is missing"
    exit 77
fi
if grep -qE "^SPAREGS_SANITIZE:[A-Z]*=." "$SPAREGS_BUILD/CMakeCache.txt"; then
    echo "skipped: the MPI library is not built with a sanitizer"
    exit 77
fi
case $SPAREGS_PLUGIN_DIR in
/*)
    echo "skipped: this build is installed into absolute folders"
    exit 77
    ;;
esac
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fail() {
    echo "FAIL: $1"
    cat "$temporary/log"
    exit 1
}

prefix=$temporary/prefix
cmake --install "$SPAREGS_BUILD" --prefix "$prefix" >"$temporary/log" || fail "installation"
[ -e "$prefix/bin/$SPAREGS_PLUGIN_DIR/ranks-openmpi.so" ] || fail "no plug-in in $SPAREGS_PLUGIN_DIR"
if ldd "$prefix/bin/sparegs" | grep -iE "libmpi|libmpich|pmix|open-rte"; then fail "the program is linked with an MPI library"; fi
mkdir "$temporary/bin"
ln -s "$prefix/bin/sparegs" "$temporary/bin/sparegs"
for program in "$prefix/bin/sparegs" "$temporary/bin/sparegs"; do
    mpirun --oversubscribe --bind-to none -n 2 "$program" train "$SPAREGS_SOURCE/tests/data/room" --downscale 8 --iterations 5 \
        --threads 1 --quiet --overwrite -o "$temporary/out" >"$temporary/log" 2>&1 || fail "ranks of $program"
    grep -q '"ranks": 2' "$temporary/out/summary.json" || fail "ranks of $program: summary.json"
done

configure() { cmake -S "$SPAREGS_SOURCE" -B "$temporary/$1" -DSPAREGS_MPI="$1" -DSPAREGS_TESTS=OFF "${@:2}" >"$temporary/log" 2>&1; }
configure OFF || fail "SPAREGS_MPI=OFF"
if cmake --build "$temporary/OFF" --target help | grep ranks-; then fail "SPAREGS_MPI=OFF builds a plug-in"; fi
configure off || fail "SPAREGS_MPI=off"
if cmake --build "$temporary/off" --target help | grep ranks-; then fail "SPAREGS_MPI=off builds a plug-in"; fi
if configure none; then fail "SPAREGS_MPI=none is accepted"; fi
grep -q "SPAREGS_MPI is 'none'; it must be AUTO, ON or OFF" "$temporary/log" || fail "message of SPAREGS_MPI=none"
# A pkg-config that knows no MPI library.
real=$(command -v pkg-config)
cat >"$temporary/pkg-config" <<END
#!/bin/sh
case " \$* " in *ompi* | *mpich*) exit 1 ;; esac
exec "$real" "\$@"
END
chmod +x "$temporary/pkg-config"
if configure ON -DPKG_CONFIG_EXECUTABLE="$temporary/pkg-config"; then fail "SPAREGS_MPI=ON without an MPI library"; fi
grep -q "neither Open MPI nor MPICH was found; install libopenmpi-dev or libmpich-dev" <(tr -s '\n ' ' ' <"$temporary/log") ||
    fail "message of SPAREGS_MPI=ON"
configure AUTO -DPKG_CONFIG_EXECUTABLE="$temporary/pkg-config" || fail "SPAREGS_MPI=AUTO without an MPI library"
if cmake --build "$temporary/AUTO" --target help | grep ranks-; then fail "SPAREGS_MPI=AUTO builds a plug-in without a library"; fi
echo "passed"
