#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The program loads OpenImageIO as a plug-in: commands that read no image start without its libraries, and an image that
# cannot be read without the plug-in is reported with the reason.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

if [ ! -e "$SPAREGS_BUILD/images.so" ]; then
    echo "skipped: the program of this build uses the shared library"
    exit 77
fi
# shellcheck disable=SC2119 # any sanitizer
is_sanitized && sanitized=1 || sanitized=0

# the_program_does_not_need_openimageio
last_command="ldd $program"
check reads_libraries grep -q libembree < <(ldd "$program")
check without_openimageio test -z "$(ldd "$program" | grep OpenImageIO || true)"
check with_openimageio grep -q OpenImageIO < <(ldd "$SPAREGS_BUILD/images.so")

# a_copy_without_the_plugin_says_so
alone=$temporary/alone/bin
mkdir -p "$alone"
cp "$program" "$alone/sparegs"
train=(train "$room" -o "$temporary/out" --iterations 1 --downscale 8 --quiet)
fails() { # TEXT
    run 1 "${train[@]}"
    reports "$1"
    one_line
}
program=$alone/sparegs
run 0 --version
run 0 help train
fails "0001.jpg: the image plug-in images.so cannot be loaded: it is neither next to the program nor in $SPAREGS_PLUGIN_DIR"
check nothing_is_left test ! -e "$temporary/out"

# a_broken_plugin_names_the_reason: of another version, without the entry, and not a library.
if [ $sanitized = 0 ]; then
    printf 'int sgsi_image_plugin_open(void *a, void *b) { (void)a, (void)b; return 0; }\n' >"$temporary/old.c"
    "$CC" -shared -fPIC "$temporary/old.c" -o "$alone/images.so"
    fails "images.so cannot be loaded: it belongs to another version of sparegs"
    printf 'int other;\n' >"$temporary/other.c"
    "$CC" -shared -fPIC "$temporary/other.c" -o "$alone/images.so"
    fails "undefined symbol: sgsi_image_plugin_open"
fi
echo text >"$alone/images.so"
fails "images.so cannot be loaded: $alone/images.so: file too short"

# it_is_found_in_its_folder (an absolute one is that of the installation)
rm "$alone/images.so"
if [ "${SPAREGS_PLUGIN_DIR#/}" = "$SPAREGS_PLUGIN_DIR" ]; then
    mkdir -p "$alone/$SPAREGS_PLUGIN_DIR"
    cp "$SPAREGS_BUILD/images.so" "$alone/$SPAREGS_PLUGIN_DIR/"
    run 0 "${train[@]}"
fi

finish
