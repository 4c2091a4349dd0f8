#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# What the program says about a data set: masks and colours, the white level, names that JSON cannot hold, and test images
# whose names have commas.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

# a scene of three photos
scene=$temporary/scene
mkdir -p "$scene/images"
frames=
frames_comma=
for k in 1 2 3; do
    cp "$room/images/000$k.jpg" "$scene/images/view, $k.jpg"
    frames+="$frames_comma{\"file_path\": \"images/view, $k.jpg\", \"transform_matrix\": [[1,0,0,$k],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"
    frames_comma=,
done
echo "{\"w\": 480, \"h\": 270, \"fl_x\": 226, \"frames\": [$frames]}" >"$scene/transforms.json"

# info_shows_masks_and_colours
run 0 info "$scene" --json
json "$temporary/stdout" '.masks == 0 and .linear_images == 0 and .color_spaces == ["sRGB"]'
mkdir "$scene/masks"
cp "$scene/images/view, 1.jpg" "$scene/masks"
run 0 info "$scene"
prints "masks: 1"
prints "linear_images: 0"
prints "color_spaces: sRGB"
run 0 info "$scene" --masks none --input-colorspace linear --json
json "$temporary/stdout" '.masks == 0 and .linear_images == 3 and .color_spaces == ["linear"] and .warnings == []'
check options_that_count_are_used test ! -s "$temporary/stderr"
rm -r "$scene/masks"

# a_comma_in_a_name_does_not_end_it
for names in "view, 1.jpg" "view, 1.jpg,view, 3"; do
    run 0 info "$scene" --test-images "$names" --json
    json "$temporary/stdout" ".test_views == $(grep -o view <<<"$names" | wc -l)"
done
run 1 info "$scene" --test-images "view 1.jpg"
one_line
reports "no view named 'view 1.jpg' to hold out; the nearest names are 'images/view, 1.jpg', "

# train_notes_the_white_level
run 0 train "$scene" --downscale 16 -o "$temporary/light" --iterations 1 --input-colorspace linear --white 0.5
reports "white level 0.5 for 3 scene-linear images"
run 0 train "$scene" --downscale 16 -o "$temporary/display" --iterations 1
check no_white_level_of_display_images bash -c '! grep -q "white level" "$0"' "$temporary/stderr"

# a_mixed_data_set_is_reported
if installed oiiotool; then
    oiiotool "$scene/images/view, 2.jpg" -d half -o "$scene/images/view, 2.exr"
    rm "$scene/images/view, 2.jpg"
    run 0 info "$scene" --json
    json "$temporary/stdout" '.linear_images == 1 and .color_spaces == ["sRGB", "linear"]'
    reports "1 of 3 images are scene-linear (first $scene/images/view, 2.exr) and use the white level"
    reports "or name the colour space of all with --input-colorspace"
fi

# cameras_whose_names_json_cannot_hold_are_those_of_the_run
latin=$temporary/latin
cp -r "$room" "$latin"
for photo in "$latin"/images/0*.jpg; do mv "$photo" "$latin/images/"$'\xe9'"${photo##*/0}"; done
LC_ALL=C sed -i 's/0\([0-9]\{3\}\.jpg\)/\xe9\1/g' "$latin/sparse/0/images.bin"
run 0 train "$latin" --downscale 16 -o "$temporary/named" --iterations 1 --quiet
run 0 eval "$temporary/named" "$latin"
check the_cameras_match bash -c '! grep -q "cameras match" "$0"' "$temporary/stderr"
jq 'map(.position[0] += 1000)' "$temporary/named/cameras.json" >"$temporary/moved"
cp "$temporary/moved" "$temporary/named/cameras.json"
run 0 eval "$temporary/named" "$latin"
reports "0 of 35 cameras match those of the run"

finish
