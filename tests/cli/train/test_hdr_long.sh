#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The bundled scene as linear EXR files eight times as bright, written by oiiotool: it trains as well as the 8-bit scene, in
# display-encoded and in linear space, and `eval` gives the same scores.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

# Both scenes have the size that is trained, so that the comparison excludes down-scaling.
for scene in ldr hdr; do
    mkdir -p "$temporary/$scene/images"
    cp -r "$room/sparse" "$temporary/$scene/"
done
hdr=$temporary/hdr
for photo in "$room"/images/*.jpg; do
    # The model names .jpg files: PNG and EXR files are found under the same stem.
    name=$(basename "${photo%.jpg}")
    oiiotool "$photo" --resize 120x68 -o "$temporary/ldr/images/$name.png"
    oiiotool "$temporary/ldr/images/$name.png" --colorconvert sRGB linear --mulc 8 -d half -o "$hdr/images/$name.exr"
done

short=(--iterations 300 --eval --json --quiet --checkpoint-every 0 --overwrite)
# trained NAME ARGUMENT...: sets `psnr` to that of the held-out images. trained_4: to the mean of four seeds, because single
# runs of this length vary by 0.3 dB.
trained() {
    local name=$1
    shift
    run 0 train "$@" -o "$temporary/$name" "${short[@]}"
    psnr=$(jq .test.psnr "$temporary/stdout")
}
trained_4() {
    local seed sum=0
    for seed in 0 1 2 3; do
        trained "$@" --seed $seed
        sum=$(awk -v a="$sum" -v b="$psnr" 'BEGIN { print a + b }')
    done
    psnr=$(awk -v a="$sum" 'BEGIN { print a / 4 }')
}
near() { awk -v a="$1" -v b="$2" -v d="$3" 'BEGIN { exit !(a - b < d && b - a < d) }'; }

trained_4 ldr_model "$temporary/ldr"
ldr=$psnr
trained_4 bright_model "$hdr" --white 8
bright=$psnr
trained linear_model "$hdr" --train-space linear
linear=$psnr
echo "held-out PSNR: $ldr dB 8-bit, $bright dB from EXR times 8, $linear dB compared in linear light"
check an_exr_scene_times_8_trains_like_its_8_bit_twin near "$ldr" "$bright" 0.3
# A single run: the bound is ten times as wide.
check linear_light_trains_too near "$ldr" "$linear" 3
json "$temporary/linear_model/config.json" '.options.white > 4 and .options.white < 8.5 and .options.train_space == "linear"'

# eval takes white and space from the run
run 0 eval "$temporary/linear_model" "$hdr" --json
again=$(jq .mean.psnr "$temporary/stdout")
check eval_agrees_with_the_training near "$again" "$linear" 0.0001

# and the file of the model alone records both; so do other formats
cp "$temporary"/linear_model/point_cloud/iteration_300/point_cloud.ply "$temporary/bare.ply"
for name in bare.ply bare.usda bare.glb; do
    [ $name = bare.ply ] || run 0 convert "$temporary/bare.ply" "$temporary/$name"
    run 0 eval "$temporary/$name" "$hdr" --eval --json
    check "$name is evaluated as the run" near "$(jq .mean.psnr "$temporary/stdout")" "$linear" 0.001
done

# photos with the primaries of ACEScg, converted by oiiotool, are the same photos
mkdir -p "$temporary/ap1/images"
cp -r "$room/sparse" "$temporary/ap1/"
for photo in "$hdr"/images/*.exr; do
    # From Rec. 709 with D65 to AP1 with D60 (Bradford), as row vectors.
    oiiotool "$photo" --ccmatrix:transpose=1 0.613097,0.339523,0.047379,0.070194,0.916354,0.013452,0.020616,0.109570,0.869815 \
        --attrib:type="float[8]" chromaticities 0.713,0.293,0.165,0.83,0.128,0.044,0.32168,0.33767 \
        -d half -o "$temporary/ap1/images/$(basename "$photo")"
done
run 0 eval "$temporary/bright_model" "$hdr" --json
reference=$(jq .mean.psnr "$temporary/stdout")
run 0 eval "$temporary/bright_model" "$temporary/ap1" --json
check primaries_are_converted near "$(jq .mean.psnr "$temporary/stdout")" "$reference" 0.02
run 0 eval "$temporary/bright_model" "$temporary/ap1" --json --input-colorspace lin_rec709
check the_colour_space_replaces_them awk -v a="$(jq .mean.psnr "$temporary/stdout")" -v b="$reference" 'BEGIN { exit !(a < b - 0.5) }'

# error messages
run 1 train "$hdr" -o "$temporary/x" --input-colorspace sepia --quiet
one_line
reports "unknown colour space 'sepia'"
run 2 train "$hdr" -o "$temporary/x" --train-space lnear
reports "srgb|linear"
finish
