#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Every lens against COLMAP's image_undistorter. A model is rendered through the lens, COLMAP undistorts the images and
# writes their pinhole cameras, and rendering with those cameras must give the same images up to COLMAP's bilinear
# resampling. Skipped without COLMAP.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

if ! command -v colmap >/dev/null; then
    echo "skipped: COLMAP is not installed; tools/setup.sh --long installs it"
    exit 77
fi
export QT_QPA_PLATFORM=offscreen

run 0 train "$room" -o "$temporary/model" --iterations 1000 --quiet
mkdir "$temporary/text"
colmap model_converter --input_path "$room/sparse/0" --output_path "$temporary/text" --output_type TXT >/dev/null
# Two views, named like the images of `render`.
grep -v '^#' "$temporary/text/images.txt" | awk 'NR % 2 { sub(/\.jpg$/, ".png"); if (/ 00(09|25)\.png$/) print $0 "\n" }' >"$temporary/images.txt"
check two_views test "$(grep -c png "$temporary/images.txt")" = 2

# lens FOLDER MODEL PARAMETERS: a COLMAP model of the two views through a lens of 480 x 270 pixels.
lens() {
    mkdir -p "$1"
    cp "$temporary/images.txt" "$1/images.txt"
    : >"$1/points3D.txt"
    echo "1 $2 480 270 $3" >"$1/cameras.txt"
}
# undistorted LENS PICTURES: sets `psnr` between COLMAP's pinhole images and renders with their cameras.
undistorted() {
    rm -rf "$temporary/flat" "$temporary/drawn"
    colmap image_undistorter --image_path "$2" --input_path "$1" --output_path "$temporary/flat" >"$temporary/colmap.log" 2>&1
    run 0 render "$temporary/model" --camera "$temporary/flat/sparse" --aov rgba --format png -o "$temporary/drawn" --quiet
    psnr=99
    for picture in "$temporary"/drawn/*.png; do
        local own
        own=$(oiiotool --fail 1 --diff "$picture" "$temporary/flat/images/$(basename "$picture")" | sed -n 's/.*Peak SNR = //p')
        psnr=$(awk -v a="$psnr" -v b="${own:-99}" 'BEGIN { print a < b ? a : b }')
    done
}
above() { awk -v a="$1" -v b="$2" 'BEGIN { exit !(a > b) }'; }

while read -r name parameters; do
    lens "$temporary/lens" "$name" "$parameters"
    rm -rf "$temporary/pictures"
    run 0 render "$temporary/model" --camera "$temporary/lens" --aov rgba --format png -o "$temporary/pictures" --quiet
    undistorted "$temporary/lens" "$temporary/pictures"
    echo "$name: $psnr dB"
    check "$name is COLMAP's" above "$psnr" 33
done <<'LENSES'
SIMPLE_PINHOLE 230 238 137
PINHOLE 230 226 238 137
SIMPLE_RADIAL 230 238 137 -0.08
RADIAL 230 238 137 -0.1 0.03
OPENCV 230 226 238 137 -0.1 0.03 0.004 -0.006
FULL_OPENCV 230 226 238 137 0.1 0.02 0.004 -0.006 0.01 0.2 0.01 0.002
OPENCV_FISHEYE 230 226 238 137 0.03 -0.012 0.004 -0.001
SIMPLE_RADIAL_FISHEYE 230 238 137 0.04
RADIAL_FISHEYE 230 238 137 0.04 -0.01
FOV 230 226 238 137 0.7
THIN_PRISM_FISHEYE 230 226 238 137 0.03 -0.012 0.002 -0.003 0.004 -0.001 0.002 0.003
LENSES

# A wrong lens is detected.
lens "$temporary/wrong" SIMPLE_RADIAL_FISHEYE "230 238 137 -0.04"
lens "$temporary/lens" SIMPLE_RADIAL_FISHEYE "230 238 137 0.04"
rm -rf "$temporary/pictures"
run 0 render "$temporary/model" --camera "$temporary/lens" --aov rgba --format png -o "$temporary/pictures" --quiet
undistorted "$temporary/wrong" "$temporary/pictures"
echo "with the wrong sign: $psnr dB"
check a_wrong_lens_shows above 30 "$psnr"

finish
