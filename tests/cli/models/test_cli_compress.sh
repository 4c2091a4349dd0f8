#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# compress and decompress: each method end to end on a trained model, JSON figures that match the files, usage errors, and
# failures that leave an existing file unchanged.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

model=$temporary/model
run 0 train "$room" -o "$model" --iterations 60 --downscale 8 --quiet
primitives=$(jq .gaussians "$model/summary.json")

for method in lightgaussian sog mesongs ghap fcgs-like; do
    case $method in # short training runs
        lightgaussian) extra=(--codebook 256 --vq-steps 20) ;;
        sog | fcgs-like) extra=() ;;
        mesongs) extra=(--codebook 128 --vq-steps 20 --finetune 20) ;;
        *) extra=(--finetune 20) ;;
    esac
    for preset in 1 3; do
        file=$temporary/$method.$preset
        run 0 compress "$model" "$room" --downscale 8 -o "$file" --method $method --preset spare-$preset "${extra[@]}" --json
        cp "$temporary/stdout" "$temporary/$method.json"
        case $method in # a_scene_without_effect_is_named
            sog | fcgs-like)
                reports "SCENE has no effect on --method $method"
                reports "--downscale has no effect on --method $method"
                ;;
            *) check no_option_is_idle bash -c "! grep 'has no effect' '$temporary/stderr'" ;;
        esac
        json "$temporary/$method.json" ".method == \"$method\" and .input == $primitives and .gaussians <= .input"
        json "$temporary/$method.json" ".bytes == $(stat -c %s "$file") and (.bytes_per_gaussian * .gaussians - .bytes | fabs) < 1"
        json "$temporary/$method.json" "(.bytes_per_input_gaussian * $primitives - .bytes | fabs) < 1"
        run 0 decompress "$file" -o "$temporary/1.ply" --threads 1 --json
        json "$temporary/stdout" ".gaussians == $(jq .gaussians "$temporary/$method.json") and .method == \"$method\""
        json "$temporary/stdout" ".file == \"$temporary/1.ply\" and .bytes == $(stat -c %s "$temporary/1.ply") and .input_bytes == $(stat -c %s "$file")"
        json "$temporary/stdout" '(.bytes_per_gaussian * .gaussians - .bytes | fabs) < 1'
        run 0 decompress "$file" -o "$temporary/2.ply" --threads 2 --isa baseline
        check decodes_to_the_same_bytes cmp "$temporary/1.ply" "$temporary/2.ply"
        run 0 info "$temporary/1.ply" --json
    done
    check presets_shrink_the_file test "$(stat -c %s "$temporary/$method.1")" -gt "$(stat -c %s "$temporary/$method.3")"
done

# decompress_writes_the_format_of_the_name
run 0 decompress "$temporary/ghap.1" -o "$temporary/ghap.spz"
check it_is_not_a_ply gzip -t <"$temporary/ghap.spz"

# codecs_decode_to_the_same_bytes
for codec in jxl webp exr; do
    file=$temporary/sog.$codec
    run 0 compress "$model" -o "$file" --method sog --codec $codec --json
    json "$temporary/stdout" ".bytes == $(stat -c %s "$file")"
    for threads in 1 2; do
        run 0 decompress "$file" -o "$file.$threads.ply" --threads $threads
        check "${codec}_decodes_to_the_same_bytes" cmp "$file.$threads.ply" "$temporary/sog.jxl.1.ply"
    done
done
run 2 compress "$model" -o "$temporary/none" --codec png
reports "choose from jxl|webp|exr"
one_line
run 2 compress "$model" -o "$temporary/none" --method ghap --codec exr
reports "--codec requires --method sog"
one_line

# fine_tuning_improves_the_model
run 0 compress "$model" "$room" --downscale 8 -o "$temporary/tuned" --method ghap --preset spare-3 --finetune 100 --seed 2
check the_seed_is_used bash -c "! grep 'has no effect' '$temporary/stderr'"
run 0 compress "$model" "$room" --downscale 8 -o "$temporary/plain" --method ghap --preset spare-3 --finetune 0
reports "SCENE has no effect with --finetune 0"
for file in tuned plain; do
    run 0 decompress "$temporary/$file" -o "$temporary/$file.ply"
    run 0 eval "$temporary/$file.ply" "$room" --downscale 8 --split train --json
    cp "$temporary/stdout" "$temporary/$file.json"
done
check fine_tuning_gains_3_dB jq -ne --slurpfile a "$temporary/tuned.json" --slurpfile b "$temporary/plain.json" \
    '$a[0].mean.psnr > $b[0].mean.psnr + 3'
for steps in 0 150; do
    run 0 compress "$model" "$room" --downscale 8 -o "$temporary/meson" --method mesongs --preset spare-2 --codebook 64 \
        --vq-steps 50 --finetune $steps --background 0,0,0
    check idle_only_without_fine_tuning test "$(grep -c 'background has no effect without' "$temporary/stderr")" = $((steps == 0))
    run 0 decompress "$temporary/meson" -o "$temporary/meson.ply"
    run 0 eval "$temporary/meson.ply" "$room" --downscale 8 --split train --json
    cp "$temporary/stdout" "$temporary/meson_$steps.json"
done
check fine_tuning_through_the_quantiser_gains_1_dB jq -ne --slurpfile a "$temporary/meson_150.json" \
    --slurpfile b "$temporary/meson_0.json" '$a[0].mean.psnr > $b[0].mean.psnr + 1'
for method in ghap mesongs lightgaussian; do
    run 2 compress "$model" -o "$temporary/none" --method $method --finetune 5
    reports "--finetune: fine-tuning requires a scene; add the argument SCENE"
    one_line
done
run 0 compress "$model" -o "$temporary/kept" --method ghap --preset spare-2 --keep 0.5 --quiet
reports "--preset has no effect with --keep, the only value that it sets"
run 0 compress "$model" -o "$temporary/kept" --method ghap --keep 0.5 --quiet --json
json "$temporary/stdout" '.gaussians < .input and .bytes_per_gaussian > 1.5 * .bytes_per_input_gaussian'
for method in lightgaussian mesongs; do
    run 2 compress "$model" -o "$temporary/none" --method $method --keep 0.5
    reports "--keep: the importance of primitives requires a scene; add the argument SCENE"
    one_line
done
cp "$temporary/kept" "$temporary/kept.ply"
run 2 decompress "$temporary/kept.ply" -o "$temporary/kept.ply"
check the_input_is_kept cmp "$temporary/kept" "$temporary/kept.ply"
run 2 compress "$model" "$room" -o "$temporary/none" --method lightgaussian --finetune 5
reports "--finetune has no effect on lightgaussian without --keep below 1"
one_line
run 2 compress "$model" -o "$temporary/none" --downscale 8
reports "--downscale has no effect without SCENE"
one_line

# distillation_learns_the_renders_of_the_model
for steps in 1 120; do
    run 0 compress "$model" "$room" --downscale 8 -o "$temporary/light" --method lightgaussian --vq-ratio 0.001 --codebook 4 \
        --vq-steps 1 --distill $steps
    run 0 decompress "$temporary/light" -o "$temporary/light.ply"
    prints "SH degree 2"
    run 0 eval "$temporary/light.ply" "$room" --downscale 8 --split train --json
    cp "$temporary/stdout" "$temporary/light_$steps.json"
done
check distillation_does_not_lose_quality jq -ne --slurpfile a "$temporary/light_120.json" \
    --slurpfile b "$temporary/light_1.json" '$a[0].mean.psnr > $b[0].mean.psnr - 0.05'
run 2 compress "$model" -o "$temporary/none" --method lightgaussian --distill 5
reports "--distill: the distillation requires a scene"
one_line

# photos_are_loaded_for_fine_tuning_only (the mask of one of them excludes every pixel)
cp -r "$room" "$temporary/masked"
mkdir "$temporary/masked/masks"
oiiotool --create 480x270 3 -d uint8 -o "$temporary/masked/masks/0002.png"
light=(--method lightgaussian --codebook 4 --vq-steps 1)
noticed() { # COUNT ARGUMENT...: of warnings about the mask
    local count=$1
    shift
    run 0 compress "$model" "$temporary/masked" --downscale 8 -o "$temporary/none" "$@"
    check the_mask_is_noticed_with_fine_tuning test "$(grep -c '0002.png: mask excludes every pixel' "$temporary/stderr")" = "$count"
}
noticed 0 "${light[@]}"
noticed 0 "${light[@]}" --distill 1
noticed 1 "${light[@]}" --keep 0.9 --finetune 1
noticed 1 --method mesongs --codebook 4 --vq-steps 1 --finetune 1
run 0 compress "$model" "$room" --downscale 8 -o "$temporary/none" "${light[@]}" --distill 1 --image-cache 1GiB --background 0,0,0
reports "--image-cache has no effect without fine-tuning"
one_line
run 0 compress "$temporary/light.ply" "$room" --downscale 8 -o "$temporary/none" "${light[@]}" --distill 1
reports "--distill has no effect: the SH degree is already 2"
rm "$temporary/none"

# distillation_does_not_require_photos (the camera has twice their size)
cp -r "$room" "$temporary/without_photos"
rm "$temporary/without_photos/images/"*
run 0 compress "$model" "$room" --downscale 8 -o "$temporary/with_photos.light" "${light[@]}" --distill 20
run 0 compress "$model" "$temporary/without_photos" --downscale 16 -o "$temporary/without_photos.light" "${light[@]}" --distill 20
reports "without_photos: no images found; using the image sizes of the cameras"
check photos_do_not_matter cmp "$temporary/with_photos.light" "$temporary/without_photos.light"
run 1 compress "$model" "$temporary/without_photos" -o "$temporary/none" --method ghap --finetune 1
reports "none of the 35 registered images can be read"

# coarse_positions_cause_a_warning: the option that refines them, if it can
run 0 compress "$model" -o "$temporary/coarse" --method sog --position-bits 2
reports "; increase --position-bits, or remove the primitives that are far from the others"
one_line

# a_compressed_file_is_a_model: as the file that decompress writes
run 0 compress "$model" -o "$temporary/packed" --method fcgs-like --quiet
run 0 decompress "$temporary/packed" -o "$temporary/unpacked.ply" --quiet
same_result() { # COMMAND ARGUMENT...: of the compressed file and of the PLY file, PACKED in the arguments
    run 0 "${@//PACKED/$temporary/packed}"
    cp "$temporary/stdout" "$temporary/of_packed"
    run 0 "${@//PACKED/$temporary/unpacked.ply}"
}
same_result eval PACKED "$room" --downscale 16 --json
check same_scores cmp <(jq .images "$temporary/of_packed") <(jq .images "$temporary/stdout")
json "$temporary/of_packed" ".bytes == $(stat -c %s "$temporary/packed")"
json "$temporary/stdout" ".bytes == $(stat -c %s "$temporary/unpacked.ply") and .gaussians > 0"
same_result info PACKED --json
check same_primitives cmp <(jq .model_hash "$temporary/of_packed") <(jq .model_hash "$temporary/stdout")
json "$temporary/of_packed" '.format == "compressed"'
run 0 render "$temporary/packed" "$room" --view 0001 --downscale 16 --format png -o "$temporary/picture_a"
run 0 render "$temporary/unpacked.ply" "$room" --view 0001 --downscale 16 --format png -o "$temporary/picture_b"
check same_picture cmp "$temporary/picture_a/0001.png" "$temporary/picture_b/0001.png"
run 0 convert "$temporary/packed" "$temporary/from_packed.ply" --json
json "$temporary/stdout" '.input_format == "compressed"'
check same_file cmp "$temporary/from_packed.ply" "$temporary/unpacked.ply"
run 0 view "$temporary/packed" --export "$temporary/packed.html"
head -c 1000 "$temporary/packed" >"$temporary/cut"
run 1 eval "$temporary/cut" "$room" --quiet
one_line
reports "cut: "

# mistakes_are_named
run 2 compress "$model"
reports "compress requires -o FILE"
one_line
run 2 decompress "$temporary/ghap.1"
reports "decompress requires -o OUT.ply"
one_line
run 2 compress "$temporary/nowhere" -o "$temporary/none" --method fcgs # before MODEL is read
reports "--method fcgs: FCGS requires its trained network, which sparegs does not contain; use --method fcgs-like"
one_line
run 0 compress --help --json
json "$temporary/stdout" '.options[] | select(.name == "method") | .argument == "lightgaussian|sog|mesongs|ghap|fcgs-like"'
run 0 compress --help
check the_help_does_not_offer_it bash -c "! grep -qE 'fcgs([^-]|\$)' '$temporary/stdout'"
check nothing_is_written test ! -e "$temporary/none"
run 1 compress "$temporary/nowhere" -o "$temporary/none"
one_line
run 1 compress "$temporary/nowhere" -o /proc/none # the output is checked before the work
reports "/proc/none: cannot be written: /proc: "
one_line
run 1 decompress "$temporary/nowhere" -o /proc/none.ply
reports "/proc/none.ply: cannot be written: /proc: "
one_line
run 2 decompress "$temporary/ghap.1" -o "$temporary/none.xyz"
reports "none.xyz: the name has no known extension; use .ply,"
one_line
run 1 decompress "$temporary/nowhere" -o "$temporary/none.ply"
reports "nowhere"
one_line
run 1 decompress "$model/point_cloud/iteration_60/point_cloud.ply" -o "$temporary/none.ply"
reports "not a compressed model of sparegs"
one_line

# a_damaged_file_leaves_the_output_alone
head -c 1000 "$temporary/ghap.1" >"$temporary/cut"
echo old >"$temporary/out.ply"
run 1 decompress "$temporary/cut" -o "$temporary/out.ply"
reports "the file has 1000 bytes instead of"
one_line
check the_old_file_stays grep -q old "$temporary/out.ply"

# a_compressed_model_is_recognised_whatever_its_name
for name in model.sog model.splat model.ksplat model.ply model.ghap; do
    run 0 compress "$model" -o "$temporary/$name" --method fcgs-like
    case $name in
        *.ghap) check no_warning bash -c "! grep 'will be a compressed model' '$temporary/stderr'" ;;
        *) reports "$name: compress writes sparegs's own container, not .${name#*.}; use 'sparegs convert' for .${name#*.}" ;;
    esac
    run 0 info "$temporary/$name" --json
    json "$temporary/stdout" '.format == "compressed"'
done

finish
