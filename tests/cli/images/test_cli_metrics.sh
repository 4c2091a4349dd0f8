#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The figures of eval: equal to those of the library for the saved images, equal in summary.json, independent of masked
# pixels, and undefined where the photo is flat. Images beyond the image cache are decoded ahead.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
model=$temporary/model
run 0 train "$room" -o "$model" --downscale 4 --eval --iterations 40 --spare off --quiet
run 0 eval "$model" "$room" --json --save "$temporary/saved"
cp "$temporary/stdout" "$temporary/eval.json"

# equal VALUE OTHER TOLERANCE
equal() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN { exit !(a - b <= t && b - a <= t) }'; }
# figure IMAGE NAME: from the JSON result.
figure() { jq -r --arg image "$1" --arg name "$2" '.images[] | select(.name == $image) | .[$name]' "$temporary/eval.json"; }

# eval_prints_the_figures_of_the_saved_images
for image in 0001 0017 0033; do
    read -r psnr ssim flip sharpness < <("$SPAREGS_BUILD/tests/test_flip" "$temporary/saved/$image.png" "$temporary/saved/${image}_photo.png")
    for name in psnr ssim flip sharpness; do
        check "${name}_of_$image" equal "$(figure $image.jpg $name)" "${!name}" 2e-7
    done
done
# eval_saves_error_maps
for image in 0001 0009 0017 0025 0033; do
    check "error_map_of_$image" "$SPAREGS_BUILD/tests/test_flip" "$temporary/saved/$image.png" "$temporary/saved/${image}_photo.png" \
        "$temporary/saved/${image}_flip.png"
    check "error_map_of_$image is not another image's" bash -c \
        "! '$SPAREGS_BUILD/tests/test_flip' '$temporary/saved/$image.png' '$temporary/saved/${image}_photo.png' '$temporary/saved/0001_photo.png'"
done
# sharpness_agrees_with_another_program
# Mean squares of the Laplacian of the lumas, without the border.
laplacian=(-d float --chsum:weight=0.299,0.587,0.114 --laplacian --cut "{TOP.width-2}x{TOP.height-2}+1+1" --dup --mul --printstats)
other=$(oiiotool "$temporary/saved/0001.png" "${laplacian[@]}" "$temporary/saved/0001_photo.png" "${laplacian[@]}" |
    awk '/Stats Avg/ { mean[++n] = $3 } END { if (n == 2) print mean[1] / mean[2] }')
check "sharpness is $other" equal "$(figure 0001.jpg sharpness)" "$other" 1e-3

# the_means_are_those_of_the_images_and_of_the_summary
for name in ssim flip sharpness; do
    json "$temporary/eval.json" "(([.images[].$name] | add / length) - .mean.$name | fabs) < 1e-7"
done
check the_means_are_those_of_the_summary jq -es '.[0].mean as $m | .[1].test as $t |
    ([["psnr", "ssim", "flip", "sharpness"][] | ($m[.] - $t[.] | fabs) < 1e-7] | all)' "$temporary/eval.json" "$model/summary.json"
json "$model/summary.json" '.train.flip > 0 and .train.flip < 1 and .train.sharpness > 0'
# 40 iterations are blurred: a low sharpness next to a fair PSNR.
json "$temporary/eval.json" '.mean.psnr > 15 and .mean.sharpness < 0.5 and .mean.flip > 0.1'

# the_table_has_a_column_for_each
run 0 eval "$model" "$room"
check the_header_names_them grep -qE '^image +PSNR +SSIM +FLIP +sharpness$' "$temporary/stdout"
check the_rows_have_them awk -v flip="$(figure 0001.jpg flip)" -v sharpness="$(figure 0001.jpg sharpness)" \
    '$1 == "0001.jpg" { found = 1; bad = $5 - flip > 1e-5 || flip - $5 > 1e-5 || $6 - sharpness > 1e-4 || sharpness - $6 > 1e-4 }
     END { exit !found || bad }' "$temporary/stdout"
prints "FLIP 0."

# eval_gives_the_same_figures_on_any_number_of_threads
for threads in 1 3; do
    run 0 eval "$model" "$room" --json --threads $threads
    cp "$temporary/stdout" "$temporary/threads_$threads.json"
done
check the_figures_are_the_same test "$(jq -c .images "$temporary/threads_1.json")" = "$(jq -c .images "$temporary/threads_3.json")"

# lpips_takes_the_weights_of_the_user
json "$temporary/eval.json" '.mean.lpips == null and .images[0].lpips == null and (has("lpips_network") | not)'
"$SPAREGS_BUILD/tests/test_lpips" alex "$temporary/alex.bin"
run 0 eval "$model" "$room" --lpips "$temporary/alex.bin" --json
json "$temporary/stdout" '.lpips_network == "alex" and .lpips_input == "unit" and ([.images[].lpips > 0] | all)'
json "$temporary/stdout" '([.images[].lpips] | add / length) - .mean.lpips | . < 1e-7 and . > -1e-7'
unit=$(jq .mean.lpips "$temporary/stdout")
run 0 eval "$model" "$room" --lpips "$temporary/alex.bin" --lpips-input signed
prints "sharpness  LPIPS"
prints "(alex) over 5 images"
check the_inputs_differ awk -v unit="$unit" '$1 == "mean" { found = $7 > 1.5 * unit } END { exit !found }' "$temporary/stdout"
# bad weights: one line, before anything is rendered
head -c 100000 "$temporary/alex.bin" >"$temporary/cut.bin"
run 1 eval "$model" "$room" --lpips "$temporary/cut.bin"
one_line
reports "cut.bin: 100000 bytes and 15 tensors; weights of alex have 9883656 bytes and 15 tensors; the file is truncated"
run 1 eval "$model" "$room" --lpips "$SPAREGS_SOURCE/README.md"
one_line
reports "README.md: not a file of LPIPS weights; create one from the published .pth files with lpips_weights.py"
run 1 eval "$model" "$room" --lpips "$temporary/missing.bin"
one_line
reports "missing.bin"
# train: as eval of its model; wrong weights and small images end it before the first iteration
run 0 train "$room" -o "$temporary/trained" --iterations 30 --downscale 8 --eval --lpips "$temporary/alex.bin"
prints "LPIPS 0."
json "$temporary/trained/summary.json" '.test.lpips > 0 and .train.lpips > 0'
trained=$(jq .test.lpips "$temporary/trained/summary.json")
run 0 eval "$temporary/trained" "$room" --lpips "$temporary/alex.bin" --json
json "$temporary/stdout" ".mean.lpips - $trained | . < 1e-6 and . > -1e-6"
run 1 train "$room" -o "$temporary/untrained" --iterations 30 --downscale 8 --quiet --lpips "$temporary/cut.bin"
one_line
run 1 train "$room" -o "$temporary/untrained" --iterations 30 --downscale 16 --quiet --lpips "$temporary/alex.bin"
one_line
reports "--lpips with the network alex requires at least"
run 2 eval "$model" "$room" --lpips-input signed
reports "--lpips-input requires --lpips"
run 2 eval "$model" "$room" --lpips "$temporary/alex.bin" --lpips-input byte
reports "--lpips-input: invalid value 'byte'"
run 1 eval "$model" "$room" --downscale 16 --lpips "$temporary/alex.bin"
one_line
reports "LPIPS: the image has 30 x 16 pixels; the network alex requires at least 31"

# masked_pixels_have_no_influence, a_flat_photo_has_no_sharpness
for kind in whole painted flat; do
    cp -r "$room" "$temporary/$kind"
done
mkdir "$temporary/masks"
drawn=() # by one call, because starting oiiotool takes longer than its work
for image in 0001 0009; do
    drawn+=("$room/images/$image.jpg" -o "$temporary/$image.png" --fill:color=1,0,1 200x100+120+80 -o "$temporary/painted_$image.png"
        --create 480x270 1 --fill:color=1 480x270+0+0 --fill:color=0 200x100+120+80 -o "$temporary/masks/$image.png")
done
oiiotool "${drawn[@]}" --create 480x270 3 --fill:color=0.5,0.5,0.5 480x270+0+0 --quality 100 -o "$temporary/flat/images/0009.jpg"
for image in 0001 0009; do # lossless; read by content
    cp "$temporary/$image.png" "$temporary/whole/images/$image.jpg"
    cp "$temporary/painted_$image.png" "$temporary/painted/images/$image.jpg"
done
for kind in whole painted; do
    run 0 eval "$model" "$temporary/$kind" --masks "$temporary/masks" --test-images 0001.jpg,0009.jpg --json --save "$temporary/masked_$kind"
    jq -c '[.images[] | [.psnr, .ssim, .flip, .sharpness]]' "$temporary/stdout" >"$temporary/$kind.json"
done
check masked_pixels_have_no_error cmp "$temporary/masked_whole/0001_flip.png" "$temporary/masked_painted/0001_flip.png"
check masked_pixels_are_black bash -c "oiiotool '$temporary/masked_painted/0001_flip.png' --cut 40x20+35+22 --mulc 255 --printstats |
    awk '/Stats Max/ { found = \$3 < 0.5 && \$4 < 1.5 && \$5 > 2.5 && \$5 < 5.5 } END { exit !found }'"
check masked_pixels_have_no_influence cmp "$temporary/whole.json" "$temporary/painted.json"
run 0 eval "$model" "$temporary/painted" --test-images 0001.jpg,0009.jpg --masks none --json
json "$temporary/stdout" ".images[0].flip > $(jq '.[0][2]' "$temporary/whole.json")"
run 0 eval "$model" "$temporary/flat" --test-images 0001.jpg,0009.jpg --json
json "$temporary/stdout" '.images[1].sharpness == null and .images[1].flip > 0 and .mean.sharpness == .images[0].sharpness'
run 0 eval "$model" "$temporary/flat" --test-images 0009.jpg --json
json "$temporary/stdout" '.mean.sharpness == null and .mean.psnr > 0'
run 0 eval "$model" "$temporary/flat" --test-images 0009.jpg
check a_flat_photo_has_no_sharpness grep -qE '^PSNR .*, sharpness - over 1 images' "$temporary/stdout"
check its_row_has_none grep -qE '^0009.* -$' "$temporary/stdout"

# eval_decodes_images_ahead (a cache of about three of the 35 images)
if [ "$(uname)" = Linux ]; then
    mkdir "$temporary/ahead"
    last_command="sparegs eval --image-cache 100000"
    check images_are_opened_ahead python3 "$SPAREGS_SOURCE/tests/cli/images/opened_ahead.py" "$room/images" "$temporary/ahead" \
        "$program" eval "$model" "$room" --split all --save "$temporary/ahead" --image-cache 100000 --threads 2 --quiet
fi

finish
