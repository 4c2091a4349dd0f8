#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Cameras of `render` that are read from files and written for other programs: frame numbers, angles, pixel aspect ratio.
# Checks the numbers; the images do not matter.
set -u
# shellcheck source-path=SCRIPTDIR source=cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

run 0 train "$room" -o "$temporary/run" --downscale 8 --iterations 2 --quiet
model=$(find "$temporary/run" -name point_cloud.ply)

pictures() { find "$1" -name "*.$2" | sort | xargs -n 1 basename | tr '\n' ' '; }
column() { cut -f "$1" "$2" | tr '\n' ' '; }
usda_frames() { grep -oE '^        [0-9]+: \(\(|(start|end)TimeCode = [0-9]+' "$1" | tr '\n' ' ' | tr -d ':( '; }

# saved_cameras_have_the_frame_numbers_of_the_images (a .chan file may begin anywhere, be on twos or not sorted)
printf '1003 0 0 3 0 0 0 50\n1001 0 0 1 0 0 0 50\n1007 0 0 7 0 0 0 50\n' >"$temporary/twos.chan"
run 0 render "$model" --camera "$temporary/twos.chan" --size 16x12 --aov rgba --save-cameras json,chan,usda -o "$temporary/twos"
check names_of_twos test "$(pictures "$temporary/twos" exr)" = 'frame_01001.exr frame_01003.exr frame_01007.exr '
check chan_of_twos test "$(column 1,4 "$temporary/twos/cameras.chan" | tr '\t' :)" = '1001:1 1003:3 1007:7 '
check usda_of_twos test "$(usda_frames "$temporary/twos/cameras.usda")" = startTimeCode=1001endTimeCode=1007100110031007
check usda_samples_of_twos test "$(grep -cE '^        (1001|1003|1007): ' "$temporary/twos/cameras.usda")" = 18
json "$temporary/twos/cameras.json" 'map([.id, .img_name]) == [[0, "frame_01003"], [1, "frame_01001"], [2, "frame_01007"]]'
run 0 render "$model" --camera "$temporary/twos.chan" --size 16x12 --view frame_01007 --aov rgba --save-cameras chan -o "$temporary/one"
check chan_of_one_view test "$(column 1,4 "$temporary/one/cameras.chan" | tr '\t' :)" = '1007:7 '
run 2 render "$model" --camera "$temporary/twos.chan" --size 16x12 --first-frame 7 --save-cameras chan -o "$temporary/none"
one_line
reports "--first-frame has no effect on a .chan file, which numbers its frames"

finish
