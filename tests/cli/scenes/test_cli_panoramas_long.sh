#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Training from equirectangular images of a COLMAP scene: panoramas rendered at the cameras of room, with COLMAP's poses
# of room and a camera of model 17, EQUIRECTANGULAR.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

sphere=$temporary/sphere
mkdir -p "$sphere/images" "$sphere/sparse/0"
run 0 train "$room" -o "$temporary/run" --downscale 8 --iterations 60 --quiet
run 0 render "$temporary/run" "$room" --projection equirectangular --size 128x64 --split all --aov rgba --format png \
    -o "$temporary/panoramas"
for picture in "$temporary"/panoramas/*.png; do
    stem=${picture##*/}
    oiiotool "$picture" --ch R,G,B --quality 98 -o "$sphere/images/${stem%.png}.jpg"
done
cp "$room"/sparse/0/{images,points3D}.bin "$sphere/sparse/0"
# one camera: id 1, model 17, 128 x 64, parameters 128 and 64
printf '\1\0\0\0\0\0\0\0\1\0\0\0\x11\0\0\0\x80\0\0\0\0\0\0\0\x40\0\0\0\0\0\0\0\0\0\0\0\0\0\x60\x40\0\0\0\0\0\0\x50\x40' \
    >"$sphere/sparse/0/cameras.bin"

run 0 info "$sphere" --json
check the_lens_is_known grep -q EQUIRECTANGULAR "$temporary/stdout"
run 0 train "$sphere" -o "$temporary/out" --iterations 120 --quiet
run 0 eval "$temporary/out" "$sphere" --split all --json
cp "$temporary/stdout" "$temporary/sphere.json"
json "$temporary/sphere.json" '.mean.psnr > 30'
# the photos of room, which the training has not seen, are in place
run 0 eval "$temporary/out" "$room" --downscale 8 --split all --json
cp "$temporary/stdout" "$temporary/room.json"
json "$temporary/room.json" '.mean.psnr > 20'

finish
