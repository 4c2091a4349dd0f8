#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# sparegs convert: formats, marks, filters, transforms, JSON; models of all formats as MODEL of other commands.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

# some NAME... [-- NAME...]: the names; those after -- in test_cli_parts_long only.
some() {
    for name in "$@"; do
        if [ "$name" != -- ]; then echo "$name"; elif ! is_long; then return; fi
    done
}

out=$temporary/run
run 0 train "$room" -o "$out" --iterations 60 --downscale 8 --quiet
ply=$out/point_cloud/iteration_60/point_cloud.ply
count() { "$program" info "$1" --json | jq .gaussians; }
value() { jq -r "$1" "$temporary/stdout"; }
all=$(count "$ply")

# convert_writes_each_format_that_info_and_eval_read
run 0 eval "$out" "$room" --downscale 8 --json --quiet
reference=$(value .mean.psnr)
for name in a.ply a.compressed.ply a.splat a.spz a.ksplat a.glb a.sog a.usda folder/meta.json lod/lod-meta.json; do
    run 0 convert "$out" "$temporary/$name" --json
    check counts_are_reported test "$(value '"\(.input) \(.output)"')" = "$all $all"
    case $name in
        *compressed.ply | *.sog | *.json) order=morton ;;
        *.splat) order=importance ;;
        *.ksplat) order=buckets ;;
        *) order=kept ;;
    esac
    check order_is_reported test "$(value .order)" = $order
    check file_is_reported test "$(value .file)" = "$temporary/$name"
    check info_reads_it test "$(count "$temporary/$name")" = "$all"
done
for name in $(some a.spz a.usda lod/lod-meta.json -- a.ply a.compressed.ply a.splat a.ksplat a.glb a.sog folder/meta.json); do
    run 0 eval "$temporary/$name" "$room" --downscale 8 --json --quiet
    check the_image_is_the_same test "$(jq -n "($(value .mean.psnr) - $reference) | fabs < 1.5")" = true
done
check bytes_are_those_of_the_file test "$(run 0 convert "$ply" "$temporary/b.spz" --json && value .bytes)" = "$(stat -c %s "$temporary/b.spz")"
run 0 convert "$temporary/lod" "$temporary/half.ply" --lod 1 --json
check a_level_has_half_of_the_primitives test "$(value .output)" = $((all / 2))
run 0 convert "$temporary/folder" "$temporary/from_folder.ply"
check convert_prints_the_file grep -qx "$temporary/from_folder.ply" "$temporary/stdout"
run 0 train "$room" -o "$temporary/again" --init "$temporary/a.sog" --iterations 5 --downscale 8 --quiet
run 0 bench "$temporary/a.spz" "$room" --downscale 8 --repeat 1 --views 1 --quiet
run 0 render "$temporary/a.compressed.ply" "$room" --view 0001 --downscale 8 --format png -o "$temporary/png" --quiet

# a_scaled_model_is_not_cut_away: without data set and config, the size of the model sets the near distance
run 0 convert "$ply" "$temporary/scaled.ply" --scale 0.02
jq '[.[3] | .position |= map(. * 0.02)]' "$out/cameras.json" >"$temporary/scaled.json"
jq '[.[3]]' "$out/cameras.json" >"$temporary/camera.json"
run 0 render "$ply" --camera "$temporary/camera.json" --format png -o "$temporary/full_size" --quiet
image() { ls "$temporary/$1"/0004.png; }
for near in "" "--near 0.004"; do
    run 0 render "$temporary/scaled.ply" --camera "$temporary/scaled.json" --format png -o "$temporary/scaled" $near --quiet
    check the_image_is_the_same idiff -fail 0.06 -failpercent 1 "$(image full_size)" "$(image scaled)"
    rm -r "$temporary/scaled"
done
run 0 render "$temporary/scaled.ply" --camera "$temporary/scaled.json" --format png -o "$temporary/scaled" --near 0.2 --quiet
check a_far_limit_cuts bash -c "! idiff -fail 0.06 -failpercent 1 '$(image full_size)' '$(image scaled)'"

# usda_has_the_cameras_of_the_scene
run 0 convert "$ply" "$temporary/a.usda" "$room" --downscale 8
check there_is_a_camera_per_view test "$(grep -c 'def Camera' "$temporary/a.usda")" = 35
check distortion_is_mentioned grep -q 'cameras in usda have no lens distortion; that of 35' "$temporary/stderr"
odd="$temporary/a$(printf '\377').usda"
sed 's/srgb_rec709_scene/srgb_p3d65_display/' "$temporary/a.usda" >"$odd"
run 0 info "$odd" --json
json "$temporary/stdout" '.warnings | any(endswith("a?.usda: colour space \u0027srgb_p3d65_display\u0027 is read as sRGB with Rec. 709 primaries"))'

# a_page_has_the_model_and_the_cameras: its SOG files are those of the folder; nothing refers to another host
run 0 convert "$ply" "$temporary/page.html" "$room" --downscale 8 --json
check page_counts test "$(value '"\(.output) \(.order)"')" = "$all morton"
run 0 convert "$ply" "$temporary/files/meta.json"
sed -n '/<script id="model"/,/<\/script>/p' "$temporary/page.html" | sed '1d;$d' >"$temporary/page.json"
check the_page_contains_json jq -e --slurpfile run "$out/cameras.json" '(.cameras | length) == 35
    and ([.cameras[3], $run[0][3]] | map([.width, .height]) | .[0] == .[1]) and (.cameras[3].axes | length) == 3' "$temporary/page.json"
check the_page_has_the_meta bash -c "diff <(jq -S .meta '$temporary/page.json') <(jq -S . '$temporary/files/meta.json')"
for file in "$temporary"/files/*.webp; do
    check "the_page_has_$(basename "$file")" bash -c "jq -r '.files[\"$(basename "$file")\"]' '$temporary/page.json' | base64 -d | cmp - '$file'"
done
check nothing_from_other_hosts bash -c "! grep -oiE '(https?:)?//[a-z0-9.-]+\.[a-z]{2,}/|@import|src=' '$temporary/page.html'"
check the_page_is_small test "$(($(stat -c %s "$temporary/page.html") - $(stat -c %s "$temporary/page.json")))" -lt 100000
run 1 info "$temporary/page.html"
reports "is a page that shows a model and cannot be read"
run 0 view "$out" --export "$temporary/view/page.html"
reports "cameras in html have no lens distortion; that of 35 camera(s) is omitted"
check view_prints_the_page grep -qx "$temporary/view/page.html" "$temporary/stdout"
cp "$temporary/view/page.html" "$temporary/view/first.html"
run 0 view "$out" --export "$temporary/view/page.html" --json --quiet
json "$temporary/stdout" ". == {schema: 1, file: \"$temporary/view/page.html\"}"
check the_same_page cmp "$temporary/view/first.html" "$temporary/view/page.html"
run 1 view "$temporary/missing" --export "$temporary/view/none.html" --json --quiet
json "$temporary/stdout" '.error.code == "failed"'
check a_run_has_its_cameras grep -q '"cameras":\[{"name"' "$temporary/view/page.html"
run 2 view "$out" --export "$temporary/page.ply"
reports "does not end in .html"
run 2 view "$out" --export "$temporary/page.html" --port 8080
reports "--port has no effect with --export"
run 2 view "$out" --export "$temporary/page.html" --background 1,1,1
reports "--background has no effect with --export"
run 1 view "$out" --export /proc/none/page.html
reports "/proc/none/page.html: cannot be written: /proc: "
one_line
check no_message_of_a_server bash -c "! grep -q Ctrl-C '$temporary/stderr'"

# marks_follow_the_model
for name in $(some m.ply m.spz -- m.compressed.ply m.sog); do
    run 0 convert "$ply" "$temporary/$name" --antialiased on
    check the_mark_is_read test "$("$program" info "$temporary/$name" --json | jq .antialiased)" = true
    run 0 convert "$temporary/$name" "$temporary/copy.spz" --json
    check the_mark_is_passed_on test "$(value .antialiased)" = true
    run 0 convert "$temporary/$name" "$temporary/copy.spz" --antialiased off --json
    check the_mark_can_be_removed test "$(value .antialiased)" = false
done
# formats_without_a_mark_say_so: once, and --json states what the file holds, as info does
for name in $(some m.glb m.splat -- m.usda m.ksplat); do
    run 0 convert "$temporary/m.ply" "$temporary/$name" --json
    check one_warning_of_the_filter test "$(grep -c -- '--filter mip' "$temporary/stderr")" = 1
    reports "$temporary/$name: ${name#m.} cannot record that a model was trained with Mip-Splatting's filters"
    check the_result_is_not_marked test "$(value .antialiased)" = false
    check info_agrees test "$("$program" info "$temporary/$name" --json | jq .antialiased)" = false
    run 0 convert "$temporary/m.ply" "$temporary/$name" --antialiased off
    check off_is_silent bash -c "! grep -q -- '--filter mip' '$temporary/stderr'"
    run 2 convert "$temporary/m.ply" "$temporary/$name" --antialiased on
    reports "--antialiased on has no effect on $temporary/$name"
done
run 0 convert "$temporary/m.ply" "$temporary/m<!--<script.html" --json
check a_page_is_marked test "$(value .antialiased)" = true
check the_mark_of_a_page grep -q '"model":"antialiased"' "$temporary/m<!--<script.html"
check a_name_does_not_extend_the_script grep -qF '"name":"m\u003c!--\u003cscript.html"' "$temporary/m<!--<script.html"
run 0 convert "$temporary/m.ply" "$temporary/lod_m/lod-meta.json" --json
check levels_of_detail_are_marked test "$("$program" info "$temporary/lod_m" --json | jq .antialiased)" = true
run 0 prune "$temporary/m.ply" "$room" --downscale 8 -o "$temporary/pruned.glb" --method lightgaussian --ratio 0.5 --quiet
reports "glb cannot record that a model was trained with Mip-Splatting's filters"
run 0 render "$temporary/m.ply" "$room" --view 0001 --downscale 8 --format png -o "$temporary/marked" --quiet
run 0 render "$ply" "$room" --view 0001 --downscale 8 --filter mip --format png -o "$temporary/mip" --quiet
check marked_models_are_rendered_with_mip cmp "$temporary/marked/0001.png" "$temporary/mip/0001.png"
run 0 train "$room" -o "$temporary/mip_run" --pipeline mip --iterations 20 --downscale 8 --quiet
check train_marks_models_of_mip grep -aq '^comment SplatRenderMode: mip$' "$temporary/mip_run/point_cloud/iteration_20/point_cloud.ply"
run 0 convert "$temporary/mip_run/point_cloud/iteration_20/point_cloud_filter_3D.ply" "$temporary/fused.ply"
check filter_3D_is_fused test "$("$program" info "$temporary/fused.ply" --json | jq -r .model_hash)" = \
    "$("$program" info "$temporary/mip_run" --json | jq -r .model_hash)"

# linear_models_keep_their_space: the mark of a file replaces the options and the config of the run
run 0 train "$room" -o "$temporary/linear" --train-space linear --iterations 30 --downscale 8 --quiet
linear=$temporary/linear/point_cloud/iteration_30/point_cloud.ply
check train_marks_linear_models grep -aqx 'comment ColorSpace: linear' "$linear"
check train_marks_no_other_model bash -c "! grep -aq '^comment' '$ply'"
cp "$linear" "$temporary/bare.ply"
run 0 eval "$temporary/linear" "$room" --downscale 8 --json --quiet
linear_reference=$(value .mean.psnr)
white() { run 0 render "$1" "$room" --view 0001 --downscale 8 --aov rgba -o "$temporary/rendered" --quiet "${@:2}"; }
white "$temporary/linear" --white 4
mv "$temporary/rendered/0001.exr" "$temporary/white4.exr"
for name in $(some bare.ply n.ply n.glb -- n.compressed.ply n.usda); do
    if [ $name != bare.ply ]; then
        run 0 convert "$temporary/bare.ply" "$temporary/$name" --white 4
        check no_warning test ! -s "$temporary/stderr"
        run 0 info "$temporary/$name" --json
        json "$temporary/stdout" '.train_space == "linear" and .white == 4'
        white "$temporary/$name"
        case $name in *compressed.ply) error=0.3 ;; *) error=0.02 ;; esac # of values up to 4
        check the_white_point_is_kept oiiotool --fail $error "$temporary/white4.exr" "$temporary/rendered/0001.exr" --diff
    fi
    run 0 eval "$temporary/$name" "$room" --downscale 8 --json --quiet
    check "$name is evaluated as the run" test "$(jq -n "($(value .mean.psnr) - $linear_reference) | fabs < 0.5")" = true
done
run 0 eval "$temporary/bare.ply" "$room" --downscale 8 --json --quiet --train-space srgb
check the_option_replaces_the_mark test "$(jq -n "$linear_reference - $(value .mean.psnr) > 3")" = true
for name in $(some l.spz lod_l/lod-meta.json -- l.splat l.ksplat l.sog); do
    run 0 convert "$temporary/n.ply" "$temporary/$name"
    check one_warning_of_the_space test "$(grep -c 'cannot record linear colours' "$temporary/stderr")" = 1
    reports "render with --train-space linear --white 4"
done
run 0 eval "$temporary/l.spz" "$room" --downscale 8 --json --quiet --train-space linear --white 4
check the_advice_helps test "$(jq -n "($(value .mean.psnr) - $linear_reference) | fabs < 1.5")" = true
run 0 convert "$temporary/n.ply" "$temporary/l.html"
check the_page_encodes_them test "$(grep -c '^"linear":true,$' "$temporary/l.html")" = 1
check no_warning test ! -s "$temporary/stderr"
run 0 convert "$ply" "$temporary/s.html"
check the_page_shows_display_values test "$(grep -c '^"linear":false,$' "$temporary/s.html")" = 1
run 0 convert "$ply" "$temporary/w.spz" --white 4
reports "spz cannot record the white level; render with --white 4"
run 0 compress "$temporary/n.ply" -o "$temporary/l.sgc" --method ghap --filter mip --quiet
check no_warning test ! -s "$temporary/stderr"
run 0 decompress "$temporary/l.sgc" -o "$temporary/from_sgc.ply"
run 0 info "$temporary/from_sgc.ply" --json
json "$temporary/stdout" '.train_space == "linear" and .white == 4 and .antialiased'
run 0 train "$room" -o "$temporary/mixed" --init "$temporary/bare.ply" --iterations 2 --downscale 8 --quiet
reports "its colours are linear, those of this training are srgb"

# filters_and_transforms
run 0 convert "$ply" "$temporary/f.ply" --filter-box 0,-,-,-,-,- --json
right=$(value .output)
run 0 convert "$ply" "$temporary/f.ply" --filter-value x,lt,0 --json
check box_and_value_split_the_model test $((right + $(value .output))) = "$all"
check both_parts_exist test "$right" -gt 0 -a "$right" -lt "$all"
run 0 convert "$ply" "$temporary/f.ply" --filter-sphere 0,0,0,1e9 --filter-harmonics 1 --json
check a_large_sphere_keeps_all test "$(value .output)" = "$all"
check harmonics_are_limited test "$("$program" info "$temporary/f.ply" --json | jq .sh_degree)" = 1
run 0 convert "$ply" "$temporary/f.ply" --filter-opacity 0.5 --filter-value scale_0,gte,0,x,gt,-100 --json
check opacity_is_filtered test "$("$program" info "$temporary/f.ply" --json | jq '.opacity.minimum >= 0.499')" = true
run 0 convert "$ply" "$temporary/f.ply" --filter-floaters auto,0.05,0.02 --json
check some_floaters_are_dropped test "$(value .output)" -lt "$all"
run 0 convert "$ply" "$temporary/f.ply" "$room" --downscale 8 --filter-unseen --json
check few_primitives_are_unseen test "$(value .output)" -gt $((all / 2))
run 0 convert "$ply" "$temporary/t.ply" --scale 2 --rotate 30,-40,50 --translate 1,2,3
run 0 convert "$temporary/t.ply" "$temporary/u.ply" --translate -1,-2,-3
run 0 convert "$temporary/u.ply" "$temporary/v.ply" --rotate 0,0,-50
run 0 convert "$temporary/v.ply" "$temporary/w.ply" --rotate 0,40,0
run 0 convert "$temporary/w.ply" "$temporary/x.ply" --rotate -30,0,0 --scale 0.5
run 0 eval "$temporary/x.ply" "$room" --downscale 8 --json --quiet
check transforms_are_undone test "$(jq -n "($(value .mean.psnr) - $reference) | fabs < 0.05")" = true

# what_is_wrong_is_named
run 2 convert "$ply" "$temporary/a.usda" "$room" --test-images ,
reports "--test-images"
run 2 convert "$ply"
run 2 convert "$ply" "$temporary/a.obj"
reports "the name has no known extension"
run 2 convert "$ply" "$temporary/a.ply" --spz-version 4
reports "--spz-version has no effect unless OUT is an .spz file"
run 2 convert "$ply" "$temporary/a.ply" --input-spz-axes rdf
reports "--input-spz-axes has no effect unless IN is an .spz file"
run 2 convert "$ply" "$temporary/a.ply" --ksplat-level 2
run 2 convert "$ply" "$temporary/a.ply" --lod-levels 2
run 2 convert "$ply" "$temporary/a.ply" --sh-palette 5
run 2 convert "$ply" "$temporary/a.ply" "$room"
reports "SCENE has no effect"
run 2 convert "$ply" "$temporary/a.ply" --filter-unseen
reports "--filter-unseen has no effect without a SCENE"
for bad in --filter-box=1,2,3 --filter-box=a,b,c,d,e,f --filter-sphere=1,2,3 --filter-sphere=1,2,3,-1 --rotate=1,2 --translate=x \
    --filter-value=x,less,1 --filter-value=x,lt --filter-value=x,lt,1,y --filter-value=x,lt,nan --filter-floaters=0 --filter-floaters=auto,a --scale=0; do
    run 2 convert "$ply" "$temporary/none.ply" "$bad"
    reports "${bad%%=*}"
done
run 1 convert "$ply" "$temporary/none.ply" --filter-value colour,lt,1
reports "unknown property 'colour'"
run 1 convert "$ply" "$temporary/none.ply" --filter-sphere 1e6,0,0,1
reports "no primitive is left; nothing was written"
run 1 convert "$ply" "$temporary/none.ply" --lod 1
run 1 convert "$ply" "$temporary/none.ply" --filter-slack 0
reports "--filter-slack and --filter-region require a run folder"

# the_input_is_not_replaced
cp "$ply" "$temporary/own.ply"
ln -sf own.ply "$temporary/link.ply"
for name in own link; do
    run 2 convert "$temporary/own.ply" "$temporary/$name.ply" --filter-opacity 0.5
    reports "is an input of this command; choose another file"
done
check it_is_as_before cmp "$ply" "$temporary/own.ply"
own_run=$temporary/own_run/point_cloud/iteration_3
mkdir -p "$own_run"
cp "$ply" "$own_run/point_cloud.ply"
for name in "$temporary/own_run" "$own_run"; do
    run 2 convert "$name" "$own_run/point_cloud.ply" --filter-opacity 0.5
    reports "OUT: $own_run/point_cloud.ply is an input of this command; choose another file"
    one_line
done
check the_model_of_the_run_is_as_before cmp "$ply" "$own_run/point_cloud.ply"
run 0 convert "$ply" "$temporary/own_sog/meta.json"
for name in own_sog own_sog/meta.json; do
    run 2 convert "$temporary/$name" "$temporary/own_sog/meta.json" --filter-opacity 0.5
    reports "own_sog/meta.json is an input of this command; choose another file"
done
run 1 convert "$temporary/missing.spz" "$temporary/none.ply"
reports "no such model"
echo '#usda 1.0' >"$temporary/empty.usda"
run 1 convert "$temporary/empty.usda" "$temporary/none.ply"
reports "contains no ParticleField3DGaussianSplat"
check nothing_was_written test ! -e "$temporary/none.ply"
run 1 convert "$temporary/missing.spz" /proc/none/a.sog # the output is checked before the work
reports "/proc/none/a.sog: cannot be written: /proc: "
run 2 convert "$ply" "$temporary/room-lod-meta.json" # not a folder of this name
reports "the name has no known extension"

finish
