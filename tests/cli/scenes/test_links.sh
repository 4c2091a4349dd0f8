#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Names and links in a data set cannot lead outside of the folders that the user named.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
set_up=$temporary/set
secret=$temporary/secret
mkdir -p "$set_up/sparse/0" "$set_up/images" "$secret"
cp "$room/images/0001.jpg" "$secret/inside.jpg"
cp "$room/images/0001.jpg" "$set_up/images/a.jpg"

# model NAME...: a text model with an image per name.
model() {
    local id=0 name
    echo "1 PINHOLE 1280 720 500 500 640 360" >"$set_up/sparse/0/cameras.txt"
    : >"$set_up/sparse/0/images.txt"
    for name in "$@"; do
        id=$((id + 1))
        printf '%d 1 0 0 0 %d 0 0 1 %s\n\n' "$id" "$id" "$name" >>"$set_up/sparse/0/images.txt"
    done
    echo "1 0 0 1 255 0 0 0.5" >"$set_up/sparse/0/points3D.txt"
}

# names_that_leave_the_folder_are_refused
for name in ../secret/inside.jpg images/../../secret/inside.jpg "$secret/inside.jpg" '..\secret\inside.jpg' C:/inside.jpg ./../x.jpg; do
    model a.jpg "$name"
    run 1 info "$set_up"
    one_line
    reports "images.txt: line 3"
done

# inner_links_are_followed, outer_links_are_refused
ln -s a.jpg "$set_up/images/b.jpg"
ln -s ../../secret/inside.jpg "$set_up/images/out.jpg"
ln -s "$secret" "$set_up/images/folder"
model a.jpg b.jpg
run 0 info "$set_up" --json
json "$temporary/stdout" '[.. | objects | select(has("images_missing")) | .images_missing] | all(. == 0)'
for name in out.jpg folder/inside.jpg; do
    model a.jpg "$name"
    run 0 info "$set_up"
    reports "symbolic link points outside the data set"
    reports "secret/inside.jpg; replace it with the file, link the whole folder, or give the folder of its target with --images; the"
    model "$name"
    run 1 info "$set_up"
    reports "symbolic link points outside the data set"
done

# the_folder_of_the_target_may_be_given
model inside.jpg
ln -s "$secret/inside.jpg" "$set_up/images/inside.jpg"
run 0 info "$set_up" --images "$secret" --json
json "$temporary/stdout" '.views == 1 and .images_missing == 0'

# the_image_folder_may_be_a_link
mv "$set_up/images" "$temporary/elsewhere"
ln -s "$temporary/elsewhere" "$set_up/images"
model a.jpg
run 0 info "$set_up"
check nothing_is_skipped bash -c '! grep -q skipped "$0"' "$temporary/stderr"

# masks_are_next_to_the_link, not_next_to_its_target
mkdir "$set_up/masks" "$temporary/masks"
ln -s "$secret/inside.jpg" "$temporary/masks/a.png"
run 0 info "$set_up"
mv "$temporary/masks/a.png" "$set_up/masks"
run 1 info "$set_up"
reports "$set_up/masks/a.png: symbolic link points outside the data set"
reports "link the whole folder, or give the folder of its target with --masks"
rm -r "$set_up/masks" "$temporary/masks"

# the_same_for_transforms, its_cloud_and_its_masks
nerf=$temporary/nerf
mkdir -p "$nerf/images"
cp "$room/images/0001.jpg" "$nerf/images/a.jpg"
ln -s "$secret/inside.jpg" "$nerf/images/out.jpg"
printf 'ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n' >"$secret/cloud.ply"
ln -s "$secret/cloud.ply" "$nerf/cloud.ply"
transforms() {
    printf '{"w": 1280, "h": 720, "fl_x": 500, "ply_file_path": "%s", "frames": [{"file_path": "images/a.jpg", "transform_matrix":
        [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}, {"file_path": "%s", "transform_matrix":
        [[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}' "$2" "$1" >"$nerf/transforms.json"
}
transforms images/out.jpg cloud.ply
run 0 info "$nerf"
reports "out.jpg: symbolic link points outside the data set"
reports "cloud.ply: symbolic link points outside the data set"
check no_option_selects_a_cloud bash -c '! grep "cloud.ply: symbolic" "$0" | grep -q -- --images' "$temporary/stderr"
transforms ../secret/inside.jpg ../secret/cloud.ply
run 1 info "$nerf"
reports "leaves the image folder"
cp "$nerf/images/a.jpg" "$nerf/images/b.jpg"
transforms images/b.jpg none.ply
mv "$nerf/images" "$temporary/photos"
ln -s "$temporary/photos" "$nerf/images"
run 0 info "$nerf"
check a_linked_image_folder_is_fine bash -c '! grep -q skipped "$0"' "$temporary/stderr"
ln -s "$secret" "$temporary/photos/deeper"
transforms images/deeper/inside.jpg none.ply
run 0 info "$nerf"
reports "inside.jpg: symbolic link points outside the data set"
rm "$nerf/images"
mv "$temporary/photos" "$nerf/images"
mkdir "$nerf/masks"
ln -s "$secret/inside.jpg" "$nerf/masks/a.png"
printf '{"w": 1280, "h": 720, "fl_x": 500, "frames": [{"file_path": "images/a.jpg", "transform_matrix":
    [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}' >"$nerf/transforms.json"
run 1 info "$nerf"
reports "masks/a.png: symbolic link points outside the data set"

# any_number_of_linked_folders
many=$temporary/many
mkdir -p "$many" "$temporary/far/masks"
for k in $(seq 20); do
    mkdir "$temporary/far/cam$k"
    cp "$room/images/0001.jpg" "$temporary/far/cam$k/"
    ln -s "$temporary/far/cam$k" "$many/cam$k"
done
jq -n '{w: 1280, h: 720, fl_x: 500, frames: [range(1; 21) |
    {file_path: "cam\(.)/0001.jpg", transform_matrix: [[1, 0, 0, .], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}' >"$many/transforms.json"
ln -s "$temporary/far/masks" "$many/masks"
run 0 info "$many" --json
json "$temporary/stdout" '.views == 20 and .images_missing == 0'
check nothing_is_skipped bash -c '! grep -q "points outside" "$0"' "$temporary/stderr"

finish
