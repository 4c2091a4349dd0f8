#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# eval, render and info with a briefly trained model: their numbers agree, and other programs read their files.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
model=$temporary/model
run 0 train "$room" -o "$model" --downscale 4 --eval --iterations 40 --spare off --quiet

# eval_agrees_with_the_training_summary
run 0 eval "$model" "$room" --json
json "$temporary/stdout" '.seconds_per_image > 0 and .seconds_per_image < 60 and .gaussians > 0'
scores() { jq -S 'del(.seconds_per_image)' "$temporary/stdout"; }
scores >"$temporary/eval.json"
json "$model/summary.json" '[.test, .train] | map(.seconds_per_image > 0 and .seconds_per_image < 60) | all'
json "$temporary/eval.json" '(.images | length) == 5 and .mean.lpips == null'
json "$temporary/eval.json" '.images[0].name == "0001.jpg" and .images[0].psnr > 5 and .images[0].ssim > 0'
check the_mean_equals_the_summary jq -es '(.[0].mean.psnr - .[1].test.psnr | fabs) < 1e-6 and
    (.[0].mean.ssim - .[1].test.ssim | fabs) < 1e-6' "$temporary/eval.json" "$model/summary.json"
run 0 eval "$model" "$room" --split all --json
json "$temporary/stdout" '.images | length == 35'
# the_folder_of_an_iteration_has_the_options_of_its_run
run 0 eval "$model/point_cloud/iteration_40" "$room" --json
check the_scores_are_those_of_the_run cmp <(scores) "$temporary/eval.json"
ln -s "$model/point_cloud/iteration_40" "$temporary/linked"
run 0 eval "$temporary/linked" "$room" --json
check the_scores_are_those_of_the_run cmp <(scores) "$temporary/eval.json"
cp -r "$model" "$temporary/bare"
echo '{}' >"$temporary/bare/config.json"
run 0 info "$temporary/bare/point_cloud/iteration_40"
reports "warning: $temporary/bare/config.json: contains no options of a run"
run 0 eval "$model/point_cloud/iteration_40/point_cloud.ply" "$room" --downscale 4 --test-images 0002.jpg,0003.jpg --json
json "$temporary/stdout" '[.images[].name] == ["0002.jpg", "0003.jpg"]'

# missing_and_damaged_colour_maps_are_reported
run 0 train "$room" -o "$temporary/exposed" --downscale 16 --exposure --iterations 5 --quiet
maps=$temporary/exposed/point_cloud/iteration_5/exposure.json
for damage in '.["0009.jpg"] = [[1, 2]]' '.["0009.jpg"][2][3] = "0"' '[.]'; do
    mv "$maps" "$temporary/maps.json"
    jq "$damage" "$temporary/maps.json" >"$maps"
    run 1 eval "$temporary/exposed" "$room" --quiet
    one_line
    reports "exposure.json: file is damaged"
    mv "$temporary/maps.json" "$maps"
done
run 0 eval "$temporary/exposed" "$room" --quiet
check no_warning test ! -s "$temporary/stderr"
echo '[]' >"$temporary/exposed/exposure.json" # is for models without a file of their own
run 0 eval "$temporary/exposed/point_cloud/iteration_5" "$room" --quiet
check no_warning test ! -s "$temporary/stderr"
rm "$maps" "$temporary/exposed/exposure.json"
run 0 eval "$temporary/exposed" "$room" --quiet
reports "exposure.json: does not exist; the colour maps of the run are not used"

# eval_saves_renders_and_photos
run 0 eval "$model" "$room" --save "$temporary/saved"
prints "mean"
prints "PSNR "
oiiotool --info "$temporary"/saved/{0001,0001_photo,0009,0009_photo}.png >"$temporary/info"
check pictures_have_the_size_of_the_view test "$(grep -cE '120 x +67|120 x +68' "$temporary/info")" = 4

# render_writes_exr_layers
run 0 render "$model" "$room" --view 0009.jpg --aov rgba,depth,depth_first,depth_median,transmittance,hits -o "$temporary/exr"
prints "$temporary/exr/0009.exr"
# Starting oiiotool takes longer than its work: one call reads these files.
run 0 render "$model" "$room" --view 0009.jpg --aov all -o "$temporary/all"
run 0 render "$model" "$room" --view 0009.jpg --aov all --depth z --compression piz -o "$temporary/axis"
run 0 render "$model" "$room" --view 0009.jpg --aov all --compression dwaa -o "$temporary/dwaa"
run 0 render "$model" "$room" --view 0009.jpg --aov all --half -o "$temporary/half"
check oiiotool_reads_them bash -c "oiiotool --info -v '$temporary'/{exr,all,axis,dwaa,half}/0009.exr >'$temporary/infos'"
info_of() { awk -v name="$temporary/$1/0009.exr " '/^[^ ]/ { inside = index($0, name) == 1 } inside' "$temporary/infos" >"$temporary/info"; }
info_of exr
check rgba_come_first grep -qE 'channel list: R[^,]*, G[^,]*, B[^,]*, A' "$temporary/info"
for text in depth.Z depth_first.Z depth_median.Z transmittance.T hits.count; do
    check "channel $text" grep -qF "$text" "$temporary/info"
done
check matrices_are_in_the_header grep -qi 'worldToCamera' "$temporary/info"
check depth_is_defined_in_the_header grep -q 'depthDefinition' "$temporary/info"

# render_writes_every_aov
info_of all
for text in 'R (float)' 'A (float)' 'depth.Z (float)' 'N.X (float)' 'N.Z (float)' 'P.Y (float)' 'primitive.id (uint)' \
    'hits.count (uint)' 'transmittance.T (float)' 'chromaticities: 0.64' 'compression: "zip"' 'along the unit ray'; do
    check "all has $text" grep -qF "$text" "$temporary/info"
done
info_of axis
check axis_depth_is_defined grep -qF "camera-space Z (distance from the camera plane, not along the ray), weighted" "$temporary/info"
check compression_is_chosen grep -q 'compression: "piz"' "$temporary/info"
info_of dwaa
for text in 'compression: "dwaa"' 'primitive.id (uint)' 'N.X (float)' 'chromaticities: 0.64' worldToNDC sparegs:depthDefinition; do
    check "dwaa has $text" grep -qF "$text" "$temporary/info"
done
# Of each channel but R, G, B. DWA takes channels named Y for luma, here they are axes.
exrheader "$temporary/all/0009.exr" | sed -n 's/^    \([A-Za-z_.]*\), .*sampling.*/\1/p' | grep -vx '[RGB]' >"$temporary/data"
check there_are_data grep -qx 'N.Y' "$temporary/data"
data=$(paste -sd, "$temporary/data")
check channels_are_alike bash -c "diff <(exrheader '$temporary/all/0009.exr' | sed 's/^file.*//;/^compression/d') \
    <(exrheader '$temporary/dwaa/0009.exr' | sed 's/^file.*//;/^compression/d')"
# half_floats_for_colours_and_normals_only
info_of half
for text in 'R (half)' 'G (half)' 'B (half)' 'A (half)' 'N.X (half)' 'N.Z (half)' 'transmittance.T (half)' 'depth.Z (float)' \
    'depth_median.Z (float)' 'P.Y (float)' 'primitive.id (uint)' 'chromaticities: 0.64' worldToNDC; do
    check "half has $text" grep -qF "$text" "$temporary/info"
done
others=$(grep -vxE '(A|N\..|transmittance\.T)' "$temporary/data" | paste -sd,)
# Rounding a value up to 1 changes it by at most 2^-12.
against_all() { # OPTION CHANNELS FILE...: the arguments of a comparison of channels with those of `all`, for oiiotool
    local option=$1 channels=$2 name
    for name in "${@:3}"; do
        compared+=("${option% *}" "${option#* }" "$temporary/all/0009.exr" --ch "$channels" "$temporary/$name/0009.exr" --ch "$channels" --diff)
    done
}
compared=()
against_all "--fail 0" R,G,B,A,depth.Z,hits.count exr # more AOVs change no other
against_all "--fail 0" "$data" dwaa                   # data are exact
against_all "--fail 0" "$others" half
against_all "--fail 0.00025" R,G,B,A,N.X,N.Y,N.Z,transmittance.T half
compared+=(--failpercent 1)
against_all "--fail 0.02" R,G,B,A dwaa # colours are near
check channels_of_all_files_agree oiiotool "${compared[@]}"
run 0 render "$model" "$room" --view 0009.jpg --downscale 8 --aov rgba --half --white 1e6 --deep -o "$temporary/half_bright"
oiiotool --stats "$temporary/half_bright/0009.exr" >"$temporary/info"
check large_values_stay_finite grep -qE 'Stats Max: 65504.* 65504.* 65504' "$temporary/info"
# Each sample of a deep file is limited to 65504 as well.
oiiotool --stats "$temporary/half_bright/0009.deep.exr" >"$temporary/info"
check large_values_of_samples_stay_finite grep -qE 'Stats Max: 65504.* 65504.* 65504' "$temporary/info"

# half_samples_keep_32_bits_of_depth (also next to PNG files), and_flatten_to_the_flat_image (whose bound is in the manual)
view=("$model" "$room" --view 0009 --downscale 8 --deep --aov rgba --depth z)
for name in 'float --compression auto' 'half --half' 'pngs --half --format png' 'srgb --exr-encoding srgb' 'srgb_half --half --exr-encoding srgb'; do
    # shellcheck disable=SC2086
    run 0 render "${view[@]}" ${name#* } -o "$temporary/deep_${name%% *}"
done
exrheader "$temporary/deep_half/0009.deep.exr" | sed -n 's/^    \([A-Za-z]*, [0-9]*-bit\).*/\1/p' | tr '\n' ' ' >"$temporary/info"
check types_of_the_channels grep -qx 'A, 16-bit B, 16-bit G, 16-bit R, 16-bit Z, 32-bit ZBack, 32-bit ' "$temporary/info"
check no_flat_file_is_required cmp "$temporary/deep_half/0009.deep.exr" "$temporary/deep_pngs/0009.deep.exr"
check half_files_are_smaller test $((4 * $(stat -c %s "$temporary/deep_half/0009.deep.exr"))) -lt $((3 * $(stat -c %s "$temporary/deep_float/0009.deep.exr")))
for pair in 'float half' 'srgb srgb_half'; do
    read -r flat deep <<<"$pair"
    # The brightest sample, colour / alpha, by which the bound is scaled.
    oiiotool --dumpdata "$temporary/deep_$flat/0009.deep.exr" | grep -o 'R=[^Z]*' | tr -c '0-9.e\n-' ' ' |
        awk '{ for (c = 1; c <= 3; ++c) if ($c > m * $4) m = $c / $4 } END { print m }' >"$temporary/brightest"
    bound=$(awk '{ print $1 / 1024 + 1e-5 }' "$temporary/brightest")
    check the_bound_is_not_loose awk '{ exit !($1 > 0.5 && $1 < 4) }' "$temporary/brightest"
    check "half_flattens_to_flat $flat" oiiotool --fail "$bound" "$temporary/deep_$flat/0009.exr" --ch R,G,B \
        "$temporary/deep_$deep/0009.deep.exr" --flatten --ch R,G,B --diff \
        --fail 0.00048829 "$temporary/deep_$flat/0009.exr" --ch A "$temporary/deep_$deep/0009.deep.exr" --flatten --ch A --diff
done
check depths_are_exact bash -c "diff <(oiiotool --dumpdata '$temporary/deep_float/0009.deep.exr' | grep -o ' Z=[^/]*') \
    <(oiiotool --dumpdata '$temporary/deep_half/0009.deep.exr' | grep -o ' Z=[^/]*')"
run 2 render "$model" "$room" --view 0009 --format png --half -o "$temporary/none"
reports "--half requires --format exr or --deep"
# overscan_extends_the_data_window (the photo's lens; the pixels inside are those of a render without it)
run 0 render "$model" "$room" --view 0009.jpg --aov rgba,depth,normal --deep -o "$temporary/plain"
run 0 render "$model" "$room" --view 0009.jpg --aov rgba,depth,normal --deep --overscan 24 -o "$temporary/over"
for name in 0009.exr 0009.deep.exr; do
    check "only_the_data_window_differs: $name" bash -c "diff <(exrheader '$temporary/plain/$name' | sed 's/^file.*//') \
        <(exrheader '$temporary/over/$name' | sed 's/^file.*//') >'$temporary/differs'; grep -qx '< dataWindow .*' '$temporary/differs' &&
        ! grep -vE '^([<>] (dataWindow|chunkCount|maxSamplesPerPixel)|---|[0-9])' '$temporary/differs'"
done
check the_data_window_begins_outside bash -c "exrheader '$temporary/over/0009.exr' | grep -q '^dataWindow .*: (-24 -24)'"
size=$(exr_size "$temporary/plain/0009.exr")
check the_inside_is_the_plain_view oiiotool --fail 0.004 --failpercent 0.1 --hardfail 0.5 "$temporary/over/0009.exr" --crop "$size+0+0" \
    --ch R,G,B,A "$temporary/plain/0009.exr" --ch R,G,B,A --diff
check the_border_has_alpha bash -c "oiiotool '$temporary/over/0009.exr' --ch A --crop 24x100-24+0 --printstats |
    awk '/Stats Avg/ { found = 1; mean = \$3 } END { exit !(found && mean > 0.5) }'"
# Zip is the default; another path writes DWA.
run 0 render "$model" "$room" --view 0009.jpg --aov rgba,depth,normal --overscan 24 --compression dwaa -o "$temporary/coded"
check flattened_with_overscan_is_flat_and_dwaa_has_the_window oiiotool --fail 0.001 "$temporary/over/0009.exr" --ch R,G,B,A \
    "$temporary/over/0009.deep.exr" --flatten --ch R,G,B,A --diff \
    --fail 0.03 --failpercent 1 "$temporary/over/0009.exr" --ch R,G,B,A "$temporary/coded/0009.exr" --ch R,G,B,A --diff
if installed exrcheck; then
    check exrcheck_accepts_it exrcheck "$temporary/coded/0009.exr" "$temporary/over/0009.exr" "$temporary/over/0009.deep.exr"
fi
run 2 render "$model" "$room" --orbit 2 --overscan 4 --video "$temporary/v.mp4" -o "$temporary/over"
reports "--overscan and --video are mutually exclusive"
run 2 render "$model" "$room" --view 0009 --overscan 4 --projection equirectangular -o "$temporary/over"
reports "--overscan and --projection equirectangular are mutually exclusive"
# The distance along the axis is at most that along the ray.
check axis_depth_is_shorter bash -c "oiiotool '$temporary/all/0009.exr' --ch depth.Z '$temporary/axis/0009.exr' --ch depth.Z --sub --printstats |
    awk '/Stats Min/ { found = 1; least = \$3 } /Stats Max/ { most = \$3 } END { exit !(found && least > -1e-4 && most > 0.01) }'"
run 0 render "$model" "$room" --view 0009 --aov all --format png -o "$temporary/all"

# flattened_deep_files_equal_the_flat_ones
for depth in ray z; do
    run 0 render "$model" "$room" --view 0009 --downscale 8 --aov rgba,depth_first,hits --depth $depth --deep -o "$temporary/deep"
    prints "$temporary/deep/0009.deep.exr"
    oiiotool --dumpdata "$temporary/deep/0009.deep.exr" "$temporary/deep/0009.exr" >"$temporary/pixels"
    check it_is_deep grep -q '0009.deep.exr .*deep float' "$temporary/pixels"
    check its_state_is_written bash -c "exrheader '$temporary/deep/0009.deep.exr' | grep -q 'deepImageState (type deepImageState)'"
    check flattened_is_flat oiiotool --fail 0.001 "$temporary/deep/0009.exr" --ch R,G,B,A "$temporary/deep/0009.deep.exr" --flatten \
        --ch R,G,B,A --diff
    # Pixel (X, Y): N samples : R= G= B= A= Z= ..., and Pixel (X, Y): R G B A FIRST HITS
    awk -v samples="$temporary/first_samples" -v hits="$temporary/first_hits" '$1 == "Pixel" {
        if ($5 ~ /^samples?$/) { if ($4 > 0) print $2 $3, substr($11, 3) >samples }
        else if ($8 > 0) print $2 $3, $8 >hits }' "$temporary/pixels"
    check first_sample_is_first_hit bash -c "join '$temporary/first_samples' '$temporary/first_hits' -j 1 --nocheck-order |
        awk '{ d = \$2 - \$3; if (d < 0) d = -d; if (d > 1e-5 * \$3) bad = 1; ++n } END { exit !(n > 1000 && !bad) }'"
done
# deep_files_without_a_chosen_depth_have_a_note (perspective lenses only; the default stays the distance along the ray)
deep=("$model" "$room" --view 0009 --size 48x27 --aov rgba --deep)
note="compositing programs usually merge deep images by the depth along the camera axis, which --depth z writes"
run 0 render "${deep[@]}" -o "$temporary/deep_unchosen"
check there_is_one_note test "$(grep -cF -- "$note" "$temporary/stderr")" = 1
for silent in "--depth ray" "--depth z" --quiet "--projection equirectangular"; do
    # shellcheck disable=SC2086
    run 0 render "${deep[@]}" $silent -o "$temporary/deep_${silent##* }"
    check "no_note: $silent" test "$(grep -cF -- "$note" "$temporary/stderr")" = 0
done
check the_default_is_ray cmp "$temporary/deep_unchosen/0009.deep.exr" "$temporary/deep_ray/0009.deep.exr"
check z_differs bash -c "! cmp -s '$temporary/deep_unchosen/0009.deep.exr' '$temporary/deep_z/0009.deep.exr'"
run 0 render "$model" "$room" --view 0009 --size 48x27 --aov rgba,depth -o "$temporary/deep_none"
check "no_note: flat files" test "$(grep -cF -- "$note" "$temporary/stderr")" = 0
if installed exrcheck; then
    check exrcheck_accepts_it exrcheck "$temporary/deep/0009.deep.exr" "$temporary/deep/0009.exr" "$temporary/all/0009.exr"
fi
check exrheader_reads_it exrheader "$temporary/deep/0009.deep.exr"
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov rgba --deep --deep-max 2 --deep-tolerance 0 -o "$temporary/deep"
check never_more_samples bash -c "! oiiotool --dumpdata '$temporary/deep/0009.deep.exr' | grep -vE 'Pixel .*: [012] samples' | grep -q samples"
# exr_options_apply_to_deep_files_next_to_pngs
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov rgba --deep --exr-encoding srgb --compression none -o "$temporary/deep_exr"
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov rgba --format png --deep --exr-encoding srgb --compression none -o "$temporary/deep_png"
check same_deep_file cmp "$temporary/deep_exr/0009.deep.exr" "$temporary/deep_png/0009.deep.exr"
check no_flat_file test ! -e "$temporary/deep_png/0009.exr"
check deep_compression_is_none bash -c "exrheader '$temporary/deep_png/0009.deep.exr' | grep -q 'compression (type compression): none'"
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov depth --format png --deep --white 2 --compression zips -o "$temporary/deep_white"
check white_is_in_effect bash -c "! grep -q 'white has no effect' '$temporary/stderr'"
check deep_compression_is_zips bash -c "exrheader '$temporary/deep_white/0009.deep.exr' | grep -q 'compression (type compression): zip, individual scanlines'"
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov depth --format png --deep -o "$temporary/deep_one"
check white_scales_deep_colours oiiotool --fail 1e-5 "$temporary/deep_white/0009.deep.exr" --flatten --ch R,G,B \
    "$temporary/deep_one/0009.deep.exr" --flatten --ch R,G,B --mulc 2 --diff
for compression in zip piz dwaa; do # of flat files only
    run 2 render "$model" "$room" --view 0009 --aov depth --format png --deep --compression $compression -o "$temporary/none"
    one_line
    reports "--compression zip, piz and dwaa require --format exr; deep files have zips, or none"
done
check nothing_was_written test ! -e "$temporary/none"
for idle in '--exr-encoding srgb' '--compression zip'; do
    read -r option value <<<"$idle"
    run 2 render "$model" "$room" --format png "$option" "$value" -o "$temporary/none"
    reports "$option requires --format exr or --deep"
done
for bad in '--deep-tolerance -1' '--deep-tolerance 1.5' '--deep-tolerance x' '--deep-max 0' '--deep-max 257'; do
    # shellcheck disable=SC2086
    run 2 render "$model" "$room" --deep $bad -o "$temporary/deep"
    reports "${bad% *}"
done
run 2 render "$model" "$room" --deep --reference -o "$temporary/deep"
reports "--deep and --reference are mutually exclusive"
run 2 render "$model" "$room" --aov rgba,dept -o "$temporary/all"
reports "--aov: invalid value 'dept' (did you mean 'depth'?); choose from all|rgba"
run 2 render "$model" "$room" --depth y -o "$temporary/all"
reports "--depth: invalid value 'y'; choose from ray|z"
run 2 render "$model" "$room" --compression lzma -o "$temporary/all"
reports "--compression"

# render_by_name_without_extension_and_by_split
run 0 render "$model" "$room" --view 0009 -o "$temporary/exr2" --aov rgba
check "same_picture_by_either_name" oiiotool --fail 0 "$temporary/exr/0009.exr" --ch R,G,B,A "$temporary/exr2/0009.exr" --diff
run 0 render "$model" "$room" -o "$temporary/split"
check five_held_out_views test "$(find "$temporary/split" -name '*.exr' | wc -l)" = 5
run 1 render "$model" "$room" --view 009.jpg -o "$temporary/exr"
one_line
reports "did you mean '0009.jpg'?"

# exr_colours_are_linear_by_default
run 0 render "$model" "$room" --view 0009 -o "$temporary/srgb" --aov rgba --exr-encoding srgb
check linear_differs_from_srgb bash -c "! oiiotool --fail 0.01 '$temporary/exr2/0009.exr' '$temporary/srgb/0009.exr' --diff"

# exr_files_record_their_encoding (as images of a scene, files of both encodings equal the renders)
check linear_is_recorded bash -c "exrheader '$temporary/exr2/0009.exr' | grep -q 'colorInteropID.*lin_rec709_scene'"
check srgb_is_recorded bash -c "exrheader '$temporary/srgb/0009.exr' | grep -q 'colorInteropID.*srgb_rec709_scene'"
cp -r "$room" "$temporary/encoded"
rm "$temporary/encoded/images"/*
for encoding in linear srgb; do
    run 0 render "$model" "$room" --split all --downscale 4 -o "$temporary/encoded/images" --aov rgba --exr-encoding "$encoding" --quiet
    run 0 eval "$model" "$temporary/encoded" --downscale 1 --white 1 --json
    json "$temporary/stdout" '(.images | length) == 5 and .mean.psnr > 50'
done

# linear_models_are_encoded_as_srgb (against OpenImageIO's curve; flat and deep files agree)
linear=(render "$model" "$room" --view 0009 --downscale 8 --aov rgba --deep --train-space linear --compression none)
run 0 "${linear[@]}" -o "$temporary/light"
run 0 "${linear[@]}" --exr-encoding srgb -o "$temporary/display"
check srgb_of_light_is_recorded bash -c "exrheader '$temporary/display/0009.exr' | grep -q 'colorInteropID.*srgb_rec709_scene'"
check it_is_encoded bash -c "! oiiotool --fail 0.05 '$temporary/light/0009.exr' '$temporary/display/0009.exr' --diff >/dev/null"
check it_is_srgb_and_deep_is_flat oiiotool --fail 0.0001 "$temporary/light/0009.exr" \
    "$temporary/display/0009.exr" --unpremult --colorconvert sRGB linear --premult --diff \
    --fail 0.001 "$temporary/light/0009.exr" "$temporary/light/0009.deep.exr" --flatten --ch R,G,B,A --diff \
    "$temporary/display/0009.exr" "$temporary/display/0009.deep.exr" --flatten --ch R,G,B,A --diff

# data_windows_are_placed_in_the_display_window (moved, and cropped; as oiiotool --croptofull does)
size=$(exr_size "$temporary/encoded/images/0009.exr")+0+0
cp "$temporary/encoded/images/0009.exr" "$temporary/whole.exr"
for change in '--origin +10-3' '--crop 40x30+20+10'; do
    # shellcheck disable=SC2086
    oiiotool "$temporary/whole.exr" $change --fullsize "$size" -o "$temporary/encoded/images/0009.exr" --croptofull -o "$temporary/full.exr"
    run 0 eval "$model" "$temporary/encoded" --downscale 1 --white 1 --json
    jq '.images[] | select(.name == "0009.jpg") | [.psnr, .ssim]' "$temporary/stdout" >"$temporary/placed.json"
    check is_evaluated test -s "$temporary/placed.json"
    mv "$temporary/full.exr" "$temporary/encoded/images/0009.exr"
    run 0 eval "$model" "$temporary/encoded" --downscale 1 --white 1 --json
    check equal_scores cmp "$temporary/placed.json" <(jq '.images[] | select(.name == "0009.jpg") | [.psnr, .ssim]' \
        "$temporary/stdout")
done

# render_and_eval_write_the_same_png
run 0 render "$model" "$room" --view 0009 -o "$temporary/png" --format png --aov rgba,depth,transmittance,hits
check pictures_open oiiotool "$temporary"/png/0009.{,depth.,transmittance.,hits.}png "$temporary"/all/0009.{normal,position,primitive}.png
check render_and_eval_draw_the_same cmp "$temporary/png/0009.png" "$temporary/saved/0009.png"

# png_depth_has_one_range (a frame and its crop, whose own quantiles differ: equal depths have equal colours)
jq '[.[8], (.[8] | .width -= 60 | .cx -= 30 | .img_name = "crop.jpg"), (.[20] | .img_name = "other.jpg")]' \
    "$model/cameras.json" >"$temporary/crop.json"
run 0 render "$model" --camera "$temporary/crop.json" --format png --aov depth,depth_first,hits,position --json -o "$temporary/ranges"
whole=$(jq -r '.[0].img_name | sub("[.][^.]*$"; "")' "$temporary/crop.json")
width=$(jq '.[1].width' "$temporary/crop.json") height=$(jq '.[1].height' "$temporary/crop.json")
cp "$temporary/stdout" "$temporary/ranges.json"
json "$temporary/ranges.json" '.ranges | .depth[0] > 0 and .depth[0] < .depth[1] and .depth == .depth_first and .hits[1] > 1 and
    (.position | length == 3)'
compared=()
for name in depth depth_first hits position; do
    compared+=("$temporary/ranges/$whole.$name.png" --cut "${width}x$height+30+0" "$temporary/ranges/crop.$name.png" --diff)
done
check equal_values_have_equal_colours oiiotool --fail 0.005 --failpercent 1 "${compared[@]}"
near_far=$(jq -r '.ranges.depth | map(tostring) | join(":")' "$temporary/ranges.json")
check the_range_is_in_the_file bash -c "oiiotool --info -v '$temporary/ranges/crop.depth.png' | grep -q 'ImageDescription.*represent ${near_far/:/ to }'"
# Tiles of a preview would be larger: the range is measured at full size, so that it has a brightest pixel.
run 0 render "$model" --camera "$temporary/crop.json" --frames 0 --size 1920x1080 --format png --aov candidates -o "$temporary/tiles"
brightest() { oiiotool --stats "$1" | awk '/Stats Max/ { print $3 }'; }
check the_range_of_candidates_is_that_of_the_frame test "$(brightest "$temporary/tiles/$whole.candidates.png")" -gt 200
# The option gives the range of another call, and of all rows of depth.
run 0 render "$model" --camera "$temporary/crop.json" --frames 1 --format png --aov depth,depth_first --depth-range "$near_far" \
    -o "$temporary/given"
for name in depth depth_first; do
    check "the_given_range_is_used for $name" cmp "$temporary/given/crop.$name.png" "$temporary/ranges/crop.$name.png"
done
run 0 render "$model" --camera "$temporary/crop.json" --frames 1 --format png --aov depth --depth-range 0:1000 -o "$temporary/given"
run 1 render "$model" --camera "$model/cameras.json" --frames 99 --aov rgba -o "$temporary/none"
reports "--frames: 99 is out of range; choose from the frames 0 to 34"
run 0 render "$model" --camera "$model/cameras.json" --frames 34-99 --aov rgba -o "$temporary/given"
reports "--frames: 99 is out of range; the last frame is 34"
check another_range_differs bash -c "! cmp -s '$temporary/given/crop.depth.png' '$temporary/ranges/crop.depth.png'"
for bad in 1 2:1 1:1 : 1: :1 -1:2 1:inf 1:2x; do
    run 2 render "$model" "$room" --format png --depth-range "$bad" -o "$temporary/none"
    reports "--depth-range: '$bad' is not NEAR:FAR"
done
run 2 render "$model" "$room" --depth-range 1:2 -o "$temporary/none"
reports "--depth-range requires --format png"
run 2 render "$model" "$room" --depth-range 1:2 --format png --aov rgba -o "$temporary/none"
reports "--depth-range requires --aov depth"

# options_of_colours_require_colours (spp and aperture average alpha, too)
for idle in 'depth --spp 4' 'depth,position --aperture 0.1' 'depth_median --exr-encoding srgb' 'transmittance --exr-encoding srgb'; do
    read -r aov option value <<<"$idle"
    run 2 render "$model" "$room" --view 0009 --aov "$aov" "$option" "$value" -o "$temporary/none"
    one_line
    reports "$option requires --aov rgba"
done
for samples in 1 4; do
    run 0 render "$model" "$room" --view 0009 --downscale 8 --spp $samples -o "$temporary/spp$samples" \
        --aov rgba,transmittance,depth,depth_median,depth_first,hits,normal,position,primitive,candidates
done
channels=$(exrheader "$temporary/spp1/0009.exr" | sed -n 's/^    \([A-Za-z_.]*\), .*sampling.*/\1/p' | grep -vx '[RGBA]\|transmittance.T' | paste -sd,)
check "spp_leaves_data: $channels" oiiotool --fail 0 "$temporary/spp1/0009.exr" --ch "$channels" "$temporary/spp4/0009.exr" --ch "$channels" --diff
oiiotool --fail 0 "$temporary/spp1/0009.exr" --ch transmittance.T "$temporary/spp4/0009.exr" --ch transmittance.T --diff >"$temporary/compared" || true
check spp_averages_transmittance grep -q FAILURE "$temporary/compared"
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov transmittance --spp 4 -o "$temporary/spp"
check spp_without_rgba oiiotool --fail 0 "$temporary/spp4/0009.exr" --ch transmittance.T "$temporary/spp/0009.exr" --diff
run 0 render "$model" "$room" --view 0009 --downscale 8 --aov depth --format png --white 2 --background 1,1,1 -o "$temporary/spp"
reports "--white has no effect without --aov rgba"
reports "--background has no effect without --aov rgba"

# the_reference_renders_the_same (the room at 60 x 33 pixels)
run 0 render "$model" "$room" --view 0009 --downscale 8 -o "$temporary/fast" --aov rgba,depth,position
run 0 render "$model" "$room" --view 0009 --downscale 8 -o "$temporary/slow" --aov rgba,depth,position --reference
names=R,G,B,A,P.X,P.Y,P.Z,depth.Z
check reference_and_tracer_agree oiiotool --fail 0.002 --hardfail 0.05 --failpercent 1 \
    "$temporary/fast/0009.exr" --ch $names "$temporary/slow/0009.exr" --ch $names --diff

# render_takes_cameras_json
run 0 render "$model" --camera "$model/cameras.json" --view "$(jq -r '.[8].img_name' "$model/cameras.json")" -o "$temporary/camera"
check one_picture test "$(find "$temporary/camera" -name '*.exr' | wc -l)" = 1
echo '[{"width": 10, "height": 10, "fx": 10, "fy": 10, "position": [0, 0, 0], "rotation": [[2,0,0],[0,1,0],[0,0,1]]}]' \
    >"$temporary/sheared.json"
run 1 render "$model" --camera "$temporary/sheared.json" -o "$temporary/camera"
one_line
reports "not a rotation"

# info_describes_models_and_scenes
run 0 info "$model" --json
json "$temporary/stdout" '.type == "model" and .iteration == 40 and .gaussians > 0 and .sh_degree == 3 and .opacity.median > 0'
check same_hash jq -es '.[0].model_hash == .[1].model_hash' "$temporary/stdout" "$model/summary.json"
cp "$temporary/stdout" "$temporary/of_run"
run 0 info "$model"/point_cloud/iteration_* --json
check the_folder_of_an_iteration_is_a_model test "$(jq .model_hash "$temporary/stdout")" = "$(jq .model_hash "$temporary/of_run")"
run 0 info "$model"
prints "gaussians:"
run 0 info "$room" --eval --json
json "$temporary/stdout" '.type == "scene" and .views == 35 and .test_views == 5 and .points > 0 and .warnings == []'
json "$temporary/stdout" '.cameras | length == 1 and .[0].model == "OPENCV" and .[0].width == 480'
# similar_cameras_are_grouped: one camera per image, each with another focal length
mkdir -p "$temporary/alike/sparse/0"
mkdir "$temporary/alike/images"
for i in 1 2 3 4 5; do
    name=$i.jpg
    if [ $i = 5 ]; then name=$'5\xe9.jpg'; fi # not UTF-8
    echo "$i SIMPLE_PINHOLE 480 270 $((399 + i)) 240 135" >&3
    printf '%s 1 0 0 0 0 0 %s %s %s\n\n' "$i" "$i" "$i" "$name" >&4
    cp "$room/images/0009.jpg" "$temporary/alike/images/$name"
done 3>"$temporary/alike/sparse/0/cameras.txt" 4>"$temporary/alike/sparse/0/images.txt"
run 0 info "$temporary/alike"
check one_group test "$(grep -c 'model: SIMPLE_PINHOLE' "$temporary/stdout")" = 1
prints "cameras: 5"
prints "params_minimum: 400 240 135"
prints "params_maximum: 404 240 135"
run 0 info "$temporary/alike" --json
json "$temporary/stdout" '.cameras | length == 5'
# names_that_are_not_utf_8_are_null
run 0 eval "$model/point_cloud/iteration_40/point_cloud.ply" "$temporary/alike" --downscale 16 --json
json "$temporary/stdout" '[.images[].name] == ["1.jpg", "2.jpg", "3.jpg", "4.jpg", null] and (.images | all(has("name")))'
odd=$temporary/$'odd\xe9.ply'
run 0 convert "$model" "$odd" --json
json "$temporary/stdout" 'has("file") and .file == null'
run 0 info "$odd" --json
json "$temporary/stdout" 'has("file") and .file == null'
run 0 compress "$odd" -o "$odd.pack" --method fcgs-like --json
json "$temporary/stdout" 'has("file") and .file == null'
run 0 decompress "$odd.pack" -o "$odd" --json
json "$temporary/stdout" 'has("file") and .file == null'
cp -r "$room" "$temporary/pointless"
rm -f "$temporary/pointless"/sparse/0/points3D.*
run 0 info "$temporary/pointless" --json
json "$temporary/stdout" '.points == 0 and has("bounds") and .bounds == null'
run 0 info "$temporary/pointless"
prints "bounds: none"
# info_and_init_accept_infinite_logits
x=0
{
    printf 'ply\nformat ascii 1.0\nelement vertex 4\n'
    printf 'property float %s\n' x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3
    printf 'end_header\n'
    for logit in 1.0 inf -inf nan; do echo "$((++x)) 0 3 0 0 0 $logit -3 -3 -3 1 0 0 0"; done
} >"$temporary/opaque.ply"
run 0 info "$temporary/opaque.ply" --json
json "$temporary/stdout" '.gaussians == 3 and .opacity.maximum > 0.9999 and .opacity.minimum < 0.0001'
reports "1 of 4 primitives are not finite and were dropped"
run 0 train "$room" --downscale 16 --init "$temporary/opaque.ply" --iterations 3 --spare off -o "$temporary/opaque" --quiet
json "$temporary/opaque/summary.json" '.gaussians == 3 and .skipped.gradients == 0'

# an_output_that_is_a_link_replaces_the_file_that_it_points_to
ply=$model/point_cloud/iteration_40/point_cloud.ply
mkdir "$temporary/elsewhere"
for name in m.ply scores.csv trace.json pack; do
    echo earlier >"$temporary/elsewhere/$name"
    ln -s "elsewhere/$name" "$temporary/$name"
done
run 0 convert "$ply" "$temporary/m.ply" --quiet
check the_target_is_the_model cmp "$ply" "$temporary/elsewhere/m.ply"
run 0 prune "$ply" "$room" --method refine --scores "$temporary/scores.csv" --downscale 16 --quiet
check the_target_has_the_scores grep -q '^primitive,score' "$temporary/elsewhere/scores.csv"
run 0 profile "$ply" "$room" --trace "$temporary/trace.json" --views 1 --repeat 1 --samples 0 --refits 0 --downscale 16 --quiet
check the_target_is_the_trace jq -e .traceEvents "$temporary/elsewhere/trace.json"
run 0 compress "$ply" -o "$temporary/pack" --method fcgs-like --quiet
run 0 decompress "$temporary/elsewhere/pack" -o "$temporary/m.ply" --quiet
for name in m.ply scores.csv trace.json pack; do
    check the_link_remains test -L "$temporary/$name"
done
check no_other_file_remains test "$(ls -A "$temporary/elsewhere" | wc -l)" = 4
ln -s nowhere.ply "$temporary/broken.ply"
run 1 convert "$ply" "$temporary/broken.ply"
one_line
reports "broken.ply: is a symbolic link that cannot be followed: No such file or directory"

# an_output_that_is_an_input_or_another_output_is_refused
cp "$ply" "$temporary/own.ply"
ln -s own.ply "$temporary/alias.ply"
for output in "compress|--output|-o" "prune|--scores|--scores" "profile|--trace|--trace"; do
    IFS='|' read -r command name option <<<"$output"
    for path in own.ply alias.ply; do
        run 2 "$command" "$temporary/own.ply" "$room" "$option" "$temporary/$path"
        one_line
        reports "$name: $temporary/$path is an input of this command; choose another file"
    done
done
check the_model_is_intact cmp "$ply" "$temporary/own.ply"
cp "$ply" "$temporary/kept.ply"
run 2 compress "$model" -o "$ply"
reports "--output: $ply is a file of a run; choose another file"
run 2 prune "$model" "$room" --method refine --ratio 0.5 -o "$ply"
reports "--output: $ply is an input of this command; choose another file"
run 2 prune "$model" "$room" --method refine --ratio 0.5 -o "$temporary/same.ply" --scores "$ply"
reports "--scores: $ply is a file of a run; choose another file"
run 2 profile "$model" "$room" --trace "$ply"
reports "--trace: $ply is a file of a run; choose another file"
mkdir "$temporary/ratios" && cp "$ply" "$temporary/ratios/prune_0.3.ply"
run 2 prune "$temporary/ratios/prune_0.3.ply" "$room" --method refine --ratio 0.3,0.5 -o "$temporary/ratios"
reports "--output: $temporary/ratios/prune_0.3.ply is an input of this command; choose another file"
run 2 prune "$ply" "$room" --method refine --ratio 0.3,0.5 -o "$temporary/ratios" --scores "$temporary/ratios/prune_0.5.ply"
reports "--scores and --output are both $temporary/ratios/prune_0.5.ply; choose different files"
cd "$temporary" # not in a subshell, whose failed checks do not count
run 2 prune "$ply" "$room" --method refine --ratio 0.5 -o ./new.ply --scores new.ply
cd "$OLDPWD"
reports "--scores and --output are both new.ply; choose different files"
check the_model_of_the_run_is_intact cmp "$ply" "$temporary/kept.ply"
run 2 prune "$ply" "$room" --method refine --ratio 0.5 -o "$temporary/same.ply" --scores "$temporary/same.ply"
reports "--scores and --output are both $temporary/same.ply; choose different files"
run 2 report "$temporary" --html "$temporary/same" --markdown "$temporary/same"
reports "--markdown and --html are both $temporary/same; choose different files"

# an_output_file_with_the_name_of_a_folder_is_refused_before_the_work, also if there is no such folder
names_folder() { # ARGUMENTS...: the path of the output is $absent
    for absent in "$temporary/absent/" "$temporary/absent/."; do
        run 1 "$@" "$absent" --quiet
        one_line
        reports "$absent: is the name of a folder; specify the name of a file"
        check "nothing_was_written: $1" test ! -e "$temporary/absent"
    done
}
names_folder compress "$ply" --method fcgs-like -o
names_folder prune "$ply" "$room" --method refine --downscale 16 --scores
names_folder profile "$ply" "$room" --views 1 --repeat 1 --samples 0 --refits 0 --downscale 16 --trace
names_folder train "$room" -o "$temporary/untrained" --downscale 16 --iterations 1 --trace
check no_run_was_started test ! -e "$temporary/untrained"
run 1 profile "$ply" "$room" --views 1 --repeat 1 --samples 0 --refits 0 --downscale 16 --trace "$temporary/elsewhere" --quiet
reports "elsewhere: cannot be written: Is a directory"
one_line

# an_output_that_is_a_file_of_a_run_or_an_experiment_is_refused
cp -r "$model" "$temporary/guarded"
mkdir "$temporary/plan"
echo '{"plan": {"pipelines": []}, "runs": []}' >"$temporary/plan/results.json"
echo own >"$temporary/plan/results.csv"
ln -s guarded "$temporary/linked_run"
ln -s guarded/config.json "$temporary/linked.json"
digests() { (cd "$temporary" && find guarded plan -type f -exec sha256sum {} + | LC_ALL=C sort); }
before=$(digests)
refuses_file() { # NAME PATH ARGUMENTS...: the output NAME at PATH
    run 2 "${@:3}" "$2"
    one_line
    reports "$1: $2 is a file of ${owner:-a run}; choose another file"
}
run_folder=$temporary/guarded
refuses_file --output "$run_folder/config.json" compress "$run_folder" -o
refuses_file --output "$run_folder/checkpoint/state.bin" compress "$temporary/own.ply" -o
refuses_file --output "$temporary/linked_run/regions.bin" decompress "$temporary/pack" -o
refuses_file --output "$temporary/linked.json" compress "$temporary/own.ply" -o
refuses_file --output "$run_folder/input.ply" prune "$ply" "$room" --method refine --ratio 0.5 -o
refuses_file --scores "$run_folder/cameras.json" prune "$run_folder" "$room" --method refine --scores
refuses_file --trace "$run_folder/summary.json" train "$room" -o "$temporary/traced" --iterations 1 --trace
refuses_file --trace "$temporary/traced/train.csv" train "$room" -o "$temporary/traced" --iterations 1 --trace
refuses_file --trace "$temporary/./traced/checkpoint/x" train "$room" -o "$temporary/traced/" --iterations 1 --trace
refuses_file OUT "$run_folder/input.ply" convert "$ply"
refuses_file OUT "$run_folder/point_cloud/iteration_40/point_cloud.ply" convert "$temporary/own.ply"
owner="an experiment" refuses_file --markdown "$temporary/plan/results.json" report "$temporary/plan" --markdown
owner="an experiment" refuses_file --html "$temporary/plan/results.csv" report "$temporary/plan" --html
check no_file_has_changed test "$before" = "$(digests)"
check no_run_was_started test ! -e "$temporary/traced"
run 0 convert "$ply" "$run_folder/smaller.ply" --filter-opacity 0.5 # other names are free
run 0 convert "$ply" "$run_folder/point_cloud/iteration_40/point_cloud.spz"
mkdir "$temporary/no_run"
echo '{"model": "other"}' >"$temporary/no_run/config.json"
run 0 convert "$ply" "$temporary/no_run/input.ply"

run 2 eval "$ply" "$room" --test-images ,
reports "--test-images: ',' contains no name"
run 2 convert "$ply" ""
one_line
reports "argument 2 must not be empty; usage: sparegs convert IN OUT"

# damaged_options_of_a_run_are_reported
cp -r "$model" "$temporary/damaged"
jq '.options.downscale = "4" | .options.filter = "gauss" | .options.background = [0, 0] | .options.invert_masks = 1 |
    .options.compact_box = 7 | .options.images = {} | .near_distance = 1e300 | .test_images = ["0001.jpg", 3]' \
    "$model/config.json" >"$temporary/damaged/config.json"
run 0 render "$temporary/damaged" "$room" --view 0001.jpg --size 40x30 -o "$temporary/drawn" --quiet
for name in downscale filter background invert_masks compact_box images near_distance; do
    reports "damaged/config.json: '$name' has an unknown value, which is ignored; correct it, or specify the option"
done
reports "damaged/config.json: 'test_images' is not a list of names, and is ignored; correct it, or specify --test-images, --test-every or --eval"
echo '{"options": []}' >"$temporary/damaged/config.json"
run 0 render "$temporary/damaged" "$room" --view 0001.jpg --size 40x30 -o "$temporary/drawn" --quiet
reports "damaged/config.json: contains no options of a run; the defaults are used"

head -c 5000 "$model/point_cloud/iteration_40/point_cloud.ply" >"$temporary/cut.ply"
run 1 info "$temporary/cut.ply"
one_line
reports "cut.ply"

# frames_beyond_the_memory_are_refused: two frames of all AOVs have 128 bytes per pixel, their rays 21 and the planes of the
# file 12. One frame with its rays would fit. If it is not refused, the limit of the address space ends the program.
if ! is_sanitized; then
    printf '#!/bin/sh\nulimit -v 4000000\nexec "%s" "$@"\n' "$program" >"$temporary/limited"
    chmod +x "$temporary/limited"
    whole_program=$program
    program=$temporary/limited
    run 1 render "$model" "$room" --view 0001.jpg --size 65536x65536 --aov all -o "$temporary/huge"
    memory=$(sed -n 's/.*but the machine has \([0-9.]*\) GiB.*/\1/p' "$temporary/stderr")
    rows=$(awk -v memory="${memory:-0}" 'BEGIN { printf "%d", memory * 1024 ^ 3 / 125 / 32768 }')
    if [ "$rows" -gt 0 ] && [ "$rows" -le 65536 ]; then
        run 1 render "$model" "$room" --size "32768x$rows" --aov all -o "$temporary/huge"
        reports "0001.jpg: a frame of 32768x$rows pixels requires more than"
        reports "but the machine has $memory GiB; use a smaller size or fewer AOVs"
    else
        echo "skipped: the memory of this machine holds the largest frame ($memory GiB)"
    fi
    program=$whole_program
fi

finish
