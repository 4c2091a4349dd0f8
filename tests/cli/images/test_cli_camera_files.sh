#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Cameras of `render` that are read from files and written for other programs: frame numbers, angles, pixel aspect ratio.
# Checks the numbers; the images do not matter.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

run 0 train "$room" -o "$temporary/run" --downscale 8 --iterations 2 --quiet
model=$(find "$temporary/run" -name point_cloud.ply)

pictures() { find "$1" -name "*.$2" | sort | xargs -n 1 basename | tr '\n' ' '; }
column() { cut -f "$1" "$2" | tr '\n' ' '; }
usda_frames() { grep -oE '^        [0-9]+: \(\(|(start|end)TimeCode = [0-9]+' "$1" | tr '\n' ' ' | tr -d ':( '; }

# saved_cameras_have_the_frame_numbers_of_the_images (a .chan file may begin anywhere, be on twos or not sorted; views are in the order of the frames)
printf '1003 0 0 3 0 0 0 50\n1001 0 0 1 0 0 0 50\n1007 0 0 7 0 0 0 50\n' >"$temporary/twos.chan"
run 0 render "$model" --camera "$temporary/twos.chan" --size 16x12 --aov rgba --save-cameras json,chan,usda -o "$temporary/twos"
check names_of_twos test "$(pictures "$temporary/twos" exr)" = 'frame_01001.exr frame_01003.exr frame_01007.exr '
check chan_of_twos test "$(column 1,4 "$temporary/twos/cameras.chan" | tr '\t' :)" = '1001:1 1003:3 1007:7 '
check usda_of_twos test "$(usda_frames "$temporary/twos/cameras.usda")" = startTimeCode=1001endTimeCode=1007100110031007
check usda_samples_of_twos test "$(grep -cE '^        (1001|1003|1007): ' "$temporary/twos/cameras.usda")" = 18
json "$temporary/twos/cameras.json" 'map([.id, .img_name]) == [[0, "frame_01001"], [1, "frame_01003"], [2, "frame_01007"]]'
run 0 render "$model" --camera "$temporary/twos.chan" --size 16x12 --view frame_01007 --aov rgba --save-cameras chan -o "$temporary/one"
check chan_of_one_view test "$(column 1,4 "$temporary/one/cameras.chan" | tr '\t' :)" = '1007:7 '
run 0 render "$model" --camera "$temporary/twos/cameras.usda" --size 16x12 --aov rgba --save-cameras chan -o "$temporary/ones"
check names_of_ones test "$(pictures "$temporary/ones" exr)" = "$(printf 'frame_0100%s.exr ' 1 2 3 4 5 6 7)"
check chan_of_ones test "$(column 1,4 "$temporary/ones/cameras.chan" | tr '\t' :)" = "$(printf '100%s:%s ' 1 1 2 2 3 3 4 4 5 5 6 6 7 7)"
run 2 render "$model" --camera "$temporary/twos.chan" --size 16x12 --first-frame 7 --save-cameras chan -o "$temporary/none"
one_line
reports "--first-frame has no effect on a .chan file, which numbers its frames"

# frames_are_selected_by_their_numbers (of a .chan file, also negative ones; the names are as without --frames)
printf -- '-10 0 0 -1 0 0 0 50\n2 0 0 2 0 0 0 50\n-2 0 0 -2 0 0 0 50\n0 0 0 5 0 0 0 50\n' >"$temporary/handles.chan"
twos='frame_01001.exr frame_01003.exr frame_01007.exr ' handles='frame_-0010.exr frame_-0002.exr frame_00000.exr frame_00002.exr '
while IFS='|' read -r file range frames warning; do
    rm -rf "$temporary/ranged"
    run 0 render "$model" --camera "$temporary/$file.chan" --size 16x12 --frames "$range" --aov rgba --json -o "$temporary/ranged"
    check "$file: $range" test "$(jq -r '.files[] | split("/") | last' "$temporary/stdout" | tr '\n' ' ')" = "$frames"
    check "warnings of $range" test "$(sed -n 's/^sparegs: warning: //p' "$temporary/stderr")" = "$warning"
done <<END
twos|1001-1007|$twos|
twos|1003|frame_01003.exr |
twos|1002-1006|frame_01003.exr |
twos|1001-1007:3|frame_01001.exr frame_01007.exr |
twos|1001-1100:2|$twos|--frames: 1100 is out of range; the last frame is 1007
twos|1-1003|frame_01001.exr frame_01003.exr |--frames: 1 is out of range; the first frame is 1001
handles|-10-2|$handles|
handles|-10--2:4|frame_-0010.exr frame_-0002.exr |
handles|-2|frame_-0002.exr |
handles|0-2|frame_00000.exr frame_00002.exr |
END
while IFS='|' read -r range problem; do
    run 1 render "$model" --camera "$temporary/twos.chan" --size 16x12 --frames "$range" -o "$temporary/none"
    one_line
    reports "--frames: $problem"
done <<'END'
0-2|2 is out of range; choose from the frames 1001 to 1007
1008-2000|1008 is out of range; choose from the frames 1001 to 1007
1004-1006|no frame is selected; of the frames 1001 to 1007, the first one from 1004 on is 1007
0-1100:1000|no frame is selected; of the frames 1001 to 1007, the first one from 0 on is 1001
END
for bad in 2--10 -2--10 1003-1001 - -- 1-- 1-2:-1 20000000; do
    run 2 render "$model" --camera "$temporary/twos.chan" --size 16x12 --frames "$bad" -o "$temporary/none"
    reports "--frames: '$bad' is not FIRST-LAST or FIRST-LAST:STEP with frame numbers"
done
# those of other cameras count from --first-frame; camera files have all frames
run 1 render "$model" "$room" --orbit 4 --first-frame 11 --frames 3 --size 16x12 -o "$temporary/none"
reports "--frames: 3 is out of range; choose from the frames 11 to 14"
run 0 render "$model" "$room" --split all --first-frame 101 --frames 102-103 --size 16x12 --aov rgba -o "$temporary/numbered"
check the_second_and_third_view test "$(pictures "$temporary/numbered" exr)" = '0002.exr 0003.exr '
rm -rf "$temporary/ranged"
run 0 render "$model" --camera "$temporary/handles.chan" --size 16x12 --frames -2 --aov rgba --save-cameras json,chan,usda -o "$temporary/ranged"
check chan_of_handles test "$(column 1,4 "$temporary/ranged/cameras.chan" | tr '\t' :)" = '-10:-1 -2:-2 0:5 2:2 '
check usda_of_handles grep -qE '^        -10: \(\(' "$temporary/ranged/cameras.usda"
run 0 render "$model" --camera "$temporary/ranged/cameras.chan" --size 16x12 --skip-existing --aov rgba --json -o "$temporary/ranged"
json "$temporary/stdout" '.skipped == 1 and ([.files[] | split("/") | last] == ["frame_-0010.exr", "frame_00000.exr", "frame_00002.exr"])'

# usda_cameras_fit_usda_models: a primitive 0.7 right of, 0.4 above and 5 in front of a camera with f 80 x 100 and the
# principal point 30, 26 is at 30 + 80 0.7 / 5 = 41.2, 26 - 100 0.4 / 5 = 18 in its image
cat >"$temporary/seen.usda" <<'END'
#usda 1.0
def ParticleField3DGaussianSplat "P"
{
    point3f[] positions = [(-0.984, -0.68, -4.312)]
    quatf[] orientations = [(1, 0, 0, 0)]
    float3[] scales = [(0.1, 0.1, 0.1)]
    float[] opacities = [0.9]
    uniform int radiance:sphericalHarmonicsDegree = 0
    float3[] radiance:sphericalHarmonicsCoefficients = [(1, 1, 1)]
}
END
echo '[{"id": 0, "img_name": "a", "width": 64, "height": 48, "position": [1, -2, 0.5], "fx": 80, "fy": 100, "cx": 30, "cy": 26,
    "rotation": [[0.8, 0.36, -0.48], [0, 0.8, 0.6], [0.6, -0.48, 0.64]]}]' >"$temporary/seen.json"
run 0 convert "$temporary/seen.usda" "$temporary/seen.ply" # y down
run 0 convert "$temporary/seen.ply" "$temporary/model.usda"
run 0 render "$temporary/seen.ply" --camera "$temporary/seen.json" --aov rgba --save-cameras usda -o "$temporary/seen"
oiiotool "$temporary/seen/a.exr" --ch A -o "$temporary/alpha.exr"
oiiotool --dumpdata "$temporary/alpha.exr" | sed -n 's/.*Pixel (\([0-9]*\), \([0-9]*\)): /\1 \2 /p' |
    awk '{ a += $3; x += $3 * ($1 + 0.5); y += $3 * ($2 + 0.5) } END { print x / a, y / a }' >"$temporary/pixel"
check the_pixel_by_hand awk '{ exit !(($1 - 41.2) ^ 2 + ($2 - 18) ^ 2 < 0.01) }' "$temporary/pixel"
camera="$temporary/seen/cameras.usda"
check both_are_y_up test "$(grep -hc 'upAxis = "Y"' "$camera" "$temporary/model.usda" | tr -d '\n')" = 11
check no_other_transforms test "$(cat "$camera" "$temporary/model.usda" | grep -o 'xformOp:[a-z]*' | tr '\n' ' ')" = \
    'xformOp:transform xformOp:transform '
value() { sed -n "/ $1.timeSamples/,/}/s/^ *0: *//p" "$camera" | tr -d '(),\n'; echo; }
for name in focalLength horizontalAperture verticalAperture horizontalApertureOffset verticalApertureOffset xformOp:transform; do
    value "$name"
done | tr '\n' ' ' >"$temporary/film"
sed -n '/ positions = /{n;p}' "$temporary/model.usda" | tr -d '(),' >"$temporary/center"
check the_pixel_by_the_files awk '
    FILENAME ~ /film$/ { for (k = 1; k <= NF; ++k) c[k] = $k } # focal length, apertures, offsets, rows of the matrix
    FILENAME ~ /center$/ {
        for (k = 0; k < 3; ++k)
            p[k] = ($1 - c[18]) * c[6 + 4 * k] + ($2 - c[19]) * c[7 + 4 * k] + ($3 - c[20]) * c[8 + 4 * k]
        u = 64 * (0.5 + (c[1] * p[0] / -p[2] - c[4]) / c[2]) # looks along -z, y is up
        v = 48 * (0.5 - (c[1] * p[1] / -p[2] - c[5]) / c[3])
    }
    FILENAME ~ /pixel$/ { print u, v, $0; exit !(-p[2] > 4.9 && ($1 - u) ^ 2 + ($2 - v) ^ 2 < 0.01) }' \
    "$temporary/film" "$temporary/center" "$temporary/pixel"
# the_files_render_the_same_image, of pixels that are 1.25 times as wide as high; of images in another shape with a warning
alike() { check "alike $2" oiiotool --failpercent 0 --hardfail 1e30 --fail 1e-3 "$1" "$2" --diff; }
run 0 render "$temporary/model.usda" --camera "$camera" --size 64x48 --aov rgba -o "$temporary/seen_usda"
check no_warning bash -c "! grep -q warning '$temporary/stderr'"
alike "$temporary/seen/a.exr" "$temporary/seen_usda/frame_00000.exr"
run 0 render "$temporary/model.usda" --camera "$camera" --size 80x48 --aov rgba --save-cameras json -o "$temporary/seen_usda"
reports "the film of camera 'camera' has the aspect ratio 1.333, the images 1.667: the vertical field of view is kept; images of 64x48 pixels"
json "$temporary/seen_usda/cameras.json" '.[0] | [.fx - 80, .fy - 100, .cx - 38, .cy - 26] | all(.[]; fabs < 1e-6)'

# chan_angles_are_continuous: pitch beyond straight up, yaw over 180 degrees, roll by more than a full turn
printf '%s 0 0 0 %s %s %s 50\n' 1 70 150 0 2 80 165 40 3 91 180 80 4 100 195 120 5 110 210 160 6 120 225 200 7 130 240 240 \
    8 140 255 280 9 150 270 320 10 160 285 360 11 170 300 400 12 180 315 440 >"$temporary/turns.chan"
run 0 render "$model" --camera "$temporary/turns.chan" --size 8x6 --frames 1 --aov rgba --save-cameras chan -o "$temporary/turns"
check the_angles_of_the_input awk 'NR == FNR { for (k = 5; k <= 7; ++k) a[$1, k] = $k; next }
    { for (k = 5; k <= 7; ++k) { d = a[$1, k] - $k; if (!(d * d < 1e-10)) { print $1, k, a[$1, k], $k; bad = 1 } } }
    END { exit bad || FNR != 12 }' "$temporary/turns.chan" "$temporary/turns/cameras.chan"
# straight up, only the difference of yaw and roll is defined: the roll stays
sed 's/^3 .*/3 0 0 0 90 180 80 50/' "$temporary/turns.chan" >"$temporary/pole.chan"
run 0 render "$model" --camera "$temporary/pole.chan" --size 8x6 --frames 1 --aov rgba --save-cameras chan -o "$temporary/pole"
check the_roll_stays awk '{ d = $5 - 90; e = $6 - 140; f = $7 - 40 } NR == 3 { exit !(d * d + e * e + f * f < 1e-10) }' \
    "$temporary/pole/cameras.chan"
check others_are_as_before test "$(sed 3d "$temporary/pole/cameras.chan")" = "$(sed 3d "$temporary/turns/cameras.chan")"
# of an orbit of cameras that count y downwards; the first angles are the smallest
run 0 render "$model" "$room" --orbit 36 --arc 360 --size 8x6 --frames 0 --aov rgba --save-cameras chan -o "$temporary/orbit"
check steps_of_an_orbit awk 'function off(x) { return x < 0 ? -x : x }
    NR == 1 && !(off($5) + off($6) + off($7) <= 270) { bad = 1 }
    NR > 1 && !(off($5 - x) < 20 && off($6 - y) < 20 && off($7 - z) < 20) { print; bad = 1 }
    { x = $5; y = $6; z = $7 }
    END { exit bad || NR != 36 }' "$temporary/orbit/cameras.chan"
# each frame alone, without a neighbour, has the smaller of its two sums, and the same camera
printf '5 1 2 3 10 170 -175 50\n' >"$temporary/alone.chan"
run 0 render "$model" --camera "$temporary/alone.chan" --size 8x6 --aov rgba --save-cameras chan,json -o "$temporary/alone"
check the_smaller_angles awk '{ a = $5 - 170; b = $6 + 10; c = $7 - 5; exit !(a * a + b * b + c * c < 1e-10) }' "$temporary/alone/cameras.chan"

# colmap_model FOLDER CAMERA: three views from a distance of 4 around the origin, without photos.
colmap_model() {
    mkdir -p "$1/sparse/0"
    echo "1 $2" >"$1/sparse/0/cameras.txt"
    for view in '1 0.9961947 0 -0.0871557' '2 1 0 0' '3 0.9961947 0 0.0871557'; do
        printf '%s 0 0 0 4 1 %s.jpg\n\n' "$view" "${view%% *}"
    done >"$1/sparse/0/images.txt"
    printf '%s 9 9 9 0.5\n' '1 0 0 0' '2 1 0 0' '3 0 1 0' '4 0 0 1' >"$1/sparse/0/points3D.txt"
}
exr_value() { exrheader "$2" | sed -n "s/^$1 (type [a-z0-9]*): //p"; }

# paths_have_the_focal_length_of_the_view: that of COLMAP's FOV lens on its axis, fx 2 tan(omega / 2) / omega
colmap_model "$temporary/fov" "FOV 480 270 200 200 240 135 0.9"
run 0 render "$model" --camera "$temporary/fov" --view 1 --aov rgba -o "$temporary/fov_view"
check focal_of_the_view test "$(exr_value pinholeFocalLength "$temporary/fov_view/1.exr")" = 16.1018
for path in orbit spiral; do
    run 0 render "$model" "$temporary/fov" --$path 3 --frames 1 --aov rgba -o "$temporary/fov_path"
    check "focal_of_the_$path" test "$(exr_value pinholeFocalLength "$temporary/fov_path/${path}_00001.exr")" = 16.1018
done

# paths_keep_the_pixel_aspect_ratio (of an anamorphic lens; calibrations of square pixels differ by less than 1 %,
# and downscaled images by the rounding of their size)
colmap_model "$temporary/squeezed" "PINHOLE 480 270 400 200 240 135"
run 0 render "$model" --camera "$temporary/squeezed" --view 2 --aov rgba -o "$temporary/squeezed_view"
for path in orbit spiral; do
    run 0 render "$model" "$temporary/squeezed" --$path 3 --size 96x54 --aov rgba -o "$temporary/squeezed_$path"
    json "$temporary/squeezed_$path/cameras.json" 'all(.[]; .fx == 80 and .fy == 40)'
    check "aspect_of_the_$path" test "$(exr_value pixelAspectRatio "$temporary/squeezed_$path/${path}_00001.exr")" = \
        "$(exr_value pixelAspectRatio "$temporary/squeezed_view/2.exr")"
done
colmap_model "$temporary/square" "PINHOLE 480 270 201 200 240 135"
run 0 render "$model" "$temporary/square" --orbit 3 --frames 1 --aov rgba -o "$temporary/square_orbit"
json "$temporary/square_orbit/cameras.json" 'all(.[]; .fx == 200 and .fy == 200)'
colmap_model "$temporary/rounded" "PINHOLE 60 33 28.2 27.6 30 16.5"
run 0 render "$model" "$temporary/rounded" --orbit 3 --frames 1 --aov rgba -o "$temporary/rounded_orbit"
json "$temporary/rounded_orbit/cameras.json" 'all(.[]; .fx == .fy)'

# sizes_of_the_photo_show_the_photo: 60 x 41 pixels with f 45 at 31, 20, reduced by 4 and rounded to 15 x 10; every size of
# this shape scales each axis by its own ratio, others keep the height. camera_is FILE FX FY CX CY
colmap_model "$temporary/odd" "PINHOLE 60 41 45 45 31 20"
mkdir "$temporary/odd/images"
for view in 1 2 3; do oiiotool --create 60x41 3 -o "$temporary/odd/images/$view.jpg"; done
camera_is() {
    json "$1" ".[0] | [(.fx, .fy, .cx, .cy), .params[]] as \$k | [\$k[:4], \$k[4:]] | all(.[]; [., [$2, $3, $4, $5]] | transpose |
        all(.[]; (.[0] - .[1] | fabs) <= 1e-12 * .[1]))"
}
odd() { run 0 render "$model" "$@" --view 2 --aov rgba --save-cameras json,usda -o "$temporary/odd_view"; }
saved=$temporary/odd_view/cameras.json
odd "$temporary/odd" --downscale 4
camera_is "$saved" 45*15/60 45*10/41 31*15/60 20*10/41
cp "$saved" "$temporary/reduced.json"
for size in 15x10 15x11 30x20 60x41 90x61 120x82; do
    odd "$temporary/odd" --downscale 4 --size $size
    camera_is "$saved" "45*${size%x*}/60" "45*${size#*x}/41" "31*${size%x*}/60" "20*${size#*x}/41"
done
odd "$temporary/odd" --downscale 4 --size 60x41
json "$saved" '.[0] | [.fx, .fy, .cx, .cy, .width, .height] == [45, 45, 31, 20, 60, 41]'
check plate_focal_length test "$(exr_value pinholeFocalLength "$temporary/odd_view/2.exr")" = 27
check plate_film_back test "$(exr_value sensorOverallDimensions "$temporary/odd_view/2.exr")" = '(36 24.6)'
check plate_pixels test "$(exr_value pixelAspectRatio "$temporary/odd_view/2.exr")" = 1
check plate_film_back_of_usda test "$(sed -n '/ verticalAperture.timeSamples/,/}/s/^ *0: //p' "$temporary/odd_view/cameras.usda")" = 24.6,
odd --camera "$temporary/reduced.json" --size 60x41
camera_is "$saved" 45 45 31 20
odd "$temporary/odd" --downscale 4 --size 80x41
camera_is "$saved" 45 45 41 20
odd "$temporary/odd" --downscale 4 --size 60x82
camera_is "$saved" 90 90 32 40

# a_model_and_its_cameras_are_one_file
run 0 convert "$model" "$temporary/odd.usda" "$temporary/odd"
run 0 render "$model" "$temporary/odd" --view 2 --near 0.1 --aov rgba -o "$temporary/odd_direct"
run 0 render "$temporary/odd.usda" --camera "$temporary/odd.usda" --view camera_1 --size 60x41 --near 0.1 --aov rgba -o "$temporary/odd_usda"
check one_camera test "$(pictures "$temporary/odd_usda" exr)" = 'camera_1.exr '
alike "$temporary/odd_direct/2.exr" "$temporary/odd_usda/camera_1.exr"

# a_view_without_distortion_fits_its_cameras: focal lengths and principal point of the photo, and positions that project to
# their pixels by cameras.json and by worldToNDC, whose last row is the depth
run 0 render "$model" "$room" --downscale 8 --view 0009 --aov rgba --save-cameras json -o "$temporary/lens"
json "$temporary/lens/cameras.json" '.[0].camera_model as $model | .[0].params[4:] | any(. != 0) and ($model != "PINHOLE")'
run 0 render "$model" "$room" --downscale 8 --view 0009 --path-lens pinhole --aov rgba,position --save-cameras json,usda \
    -o "$temporary/pinhole"
check no_distortion_is_omitted bash -c "! grep distortion '$temporary/stderr'"
json "$temporary/pinhole/cameras.json" ".[0] | .camera_model == \"PINHOLE\" and [(.fx, .fy, .cx, .cy, .width, .height), .position] ==
    $(jq -c '.[0] | [(.fx, .fy, .cx, .cy, .width, .height), .position]' "$temporary/lens/cameras.json")"
jq -r '.[0] | [.fx, .fy, .cx, .cy, .width, .height, .position[], .rotation[][]] | @tsv' "$temporary/pinhole/cameras.json" >"$temporary/sheet"
oiiotool --info -v "$temporary/pinhole/0009.exr" | sed -n 's/.*worldToNDC: //p' | tr ',' ' ' >>"$temporary/sheet"
oiiotool --dumpdata "$temporary/pinhole/0009.exr" | sed -n 's/.*Pixel (\([0-9]*\), \([0-9]*\)): /\1 \2 /p' |
    awk '$6 > 0.3 { print $1, $2, $7, $8, $9 }' >"$temporary/points"
check positions_project_to_their_pixels awk '
    function off(x) { return x < 0 ? -x : x }
    FNR == NR && FNR == 1 { for (i = 1; i <= NF; ++i) c[i] = $i; next }
    FNR == NR { for (i = 1; i <= NF; ++i) m[i] = $i; next }
    {
        for (k = 0; k < 3; ++k) p[k] = ($3 - c[7]) * c[10 + k] + ($4 - c[8]) * c[13 + k] + ($5 - c[9]) * c[16 + k]
        for (k = 1; k <= 4; ++k) q[k] = $3 * m[k] + $4 * m[4 + k] + $5 * m[8 + k] + m[12 + k]
        error = off(c[1] * p[0] / p[2] + c[3] - $1 - 0.5) + off(c[2] * p[1] / p[2] + c[4] - $2 - 0.5)
        error += off(c[5] * q[1] / q[4] - $1 - 0.5) + off(c[6] * q[2] / q[4] - $2 - 0.5)
        if (!(error < 2e-3)) ++bad
        ++n
    }
    END { print n, "points,", bad + 0, "off"; exit !(n > 500 && !bad) }' "$temporary/sheet" "$temporary/points"

# models_have_perspective_cameras_only: view 2 is a pinhole, the others are a fisheye lens and a panorama
colmap_model "$temporary/mixed" "OPENCV_FISHEYE 60 40 30 30 30 20 0 0 0 0"
printf '2 PINHOLE 60 40 45 45 30 20\n3 EQUIRECTANGULAR 60 30 60 30\n' >>"$temporary/mixed/sparse/0/cameras.txt"
sed -i 's/ 1 \([23]\).jpg/ \1 \1.jpg/' "$temporary/mixed/sparse/0/images.txt"
mkdir "$temporary/mixed/images"
for view in 1:60x40 2:60x40 3:60x30; do oiiotool --create ${view#*:} 3 -o "$temporary/mixed/images/${view%:*}.jpg"; done
run 0 convert "$model" "$temporary/mixed.usda" "$temporary/mixed"
reports "cameras in usda are perspective; 2 camera(s) with a fisheye lens or a panorama are omitted"
check a_camera_is_left test "$(grep -c 'def Camera' "$temporary/mixed.usda")" = 1
check the_pinhole_is_left grep -q 'focalLength = 27$' "$temporary/mixed.usda"
page_views() { sed -n '/<script id="model"/,/<\/script>/p' "$1" | sed '1d;$d' | jq -r '[.cameras[] | "\(.name) \(.fx)"] | join(",")'; }
run 0 convert "$model" "$temporary/mixed.html" "$temporary/mixed"
reports "2 camera(s) with a fisheye lens or a panorama are omitted, and the page begins with another one"
check the_page_has_the_pinhole test "$(page_views "$temporary/mixed.html")" = '2.jpg 45'
run 0 view "$model" "$temporary/mixed" --export "$temporary/mixed.html"
check the_page_of_view_has_the_pinhole test "$(page_views "$temporary/mixed.html")" = '2.jpg 45'
for view in 1 2; do
    run 0 render "$model" "$temporary/mixed" --view $view --path-lens pinhole --aov rgba --save-cameras chan,json -o "$temporary/flat"
    json "$temporary/flat/cameras.json" '.[0].camera_model == "PINHOLE"'
done
run 1 render "$model" "$temporary/mixed" --view 3 --path-lens pinhole --aov rgba -o "$temporary/none"
reports "3.jpg: is a panorama, which --path-lens pinhole cannot show; omit the option"
one_line
sed -i '/PINHOLE/d' "$temporary/mixed/sparse/0/cameras.txt" && sed -i 's/ 2 2.jpg/ 1 2.jpg/' "$temporary/mixed/sparse/0/images.txt"
run 0 convert "$model" "$temporary/mixed.html" "$temporary/mixed"
reports "3 camera(s) with a fisheye lens or a panorama are omitted, and the page begins in front of the model"
check the_page_has_no_camera test "$(page_views "$temporary/mixed.html")" = ''
run 0 convert "$model" "$temporary/mixed.usda" "$temporary/mixed"
check no_camera_is_left bash -c "! grep -q 'def Camera' '$temporary/mixed.usda'"

# chan_omits_the_pixel_aspect_ratio
run 0 render "$model" "$temporary/squeezed" --orbit 3 --size 96x54 --frames 0 --aov rgba --save-cameras chan -o "$temporary/squeezed_chan"
reports "cameras in chan have square pixels; the width of the pixels of 3 camera(s) is omitted"
run 0 render "$model" "$temporary/squeezed" --orbit 3 --size 96x54 --frames 0 --aov rgba --save-cameras usda -o "$temporary/squeezed_chan"
check usda_has_it bash -c "! grep -q warning '$temporary/stderr'"
run 0 render "$model" "$temporary/square" --orbit 3 --frames 0 --aov rgba --save-cameras chan -o "$temporary/square_chan"
check square_pixels bash -c "! grep -q warning '$temporary/stderr'"

# videos_record_the_pixel_aspect_ratio (a replacement for ffmpeg stores arguments and frames; then the real one, where it is)
mkdir "$temporary/bin"
printf '#!/bin/bash\nprintf "%%s\\n" "$@" >%s\nfilm=${*: -1}\nexec cat >"${film#file:}"\n' "$temporary/arguments" >"$temporary/bin/ffmpeg"
chmod +x "$temporary/bin/ffmpeg"
filters() { PATH=$temporary/bin:$PATH run 0 render "$model" "$1" --orbit 2 --size 32x18 --video "$temporary/film.$2" &&
    grep -xA1 -- -vf "$temporary/arguments" | tail -n 1; }
check aspect_of_mp4 test "$(filters "$temporary/squeezed" mp4 | grep -o 'tv,.*')" = tv,setsar=r=0.5:max=1000
check aspect_of_avi test "$(filters "$temporary/squeezed" avi | grep -o '2,set.*')" = 2,setsar=r=0.5:max=1000
check square_pixels bash -c "! grep -q setsar <<<'$(filters "$temporary/square" mp4)'"
# videos_have_the_order_of_the_frame_numbers
tac "$temporary/orbit/cameras.chan" >"$temporary/backwards.chan"
for name in orbit/cameras backwards; do
    PATH=$temporary/bin:$PATH run 0 render "$model" --camera "$temporary/$name.chan" --frames 8-20:4 --size 32x18 --video "$temporary/${name%/*}.mp4"
done
check four_frames test "$(stat -c %s "$temporary/orbit.mp4")" = $((4 * 32 * 18 * 3))
check which_differ test "$(split -b $((32 * 18 * 3)) --filter=md5sum "$temporary/orbit.mp4" | sort -u | wc -l)" = 4
check the_same_order cmp "$temporary/orbit.mp4" "$temporary/backwards.mp4"
if installed ffprobe; then
    run 0 render "$model" "$temporary/squeezed" --orbit 2 --size 32x18 --video "$temporary/real.mp4"
    check aspect_of_the_video test "$(ffprobe -v error -show_entries stream=sample_aspect_ratio -of csv=p=0 "$temporary/real.mp4")" = 1:2
fi

# other_files_are_named_with_the_accepted_ones (text, binary and empty; and the files of a COLMAP model)
printf 'Ogawa\377\0\0' >"$temporary/shot.abc"
printf 'PXR-USDC' >"$temporary/shot.usdc"
printf 'Kaydara FBX Binary' >"$temporary/shot.FBX"
printf '<?xml version="1.0"?>\n<document/>\n' >"$temporary/cameras.xml"
printf '# Bundle file v0.3\n1 1\n' >"$temporary/bundle.out"
printf 'name,x,y\n' >"$temporary/cameras.csv"
printf ' \n' >"$temporary/empty"
for file in shot.abc shot.FBX cameras.xml bundle.out cameras.csv empty; do
    run 1 render "$model" --camera "$temporary/$file" --aov rgba -o "$temporary/none"
    one_line
    reports "/$file: contains no cameras of a known format; cameras are read from cameras.json, transforms.json, .chan, .usda,"
    [[ $file != shot.* ]] || reports "; export the camera as a .usda or .chan file"
done
for file in shot.usdc missing.usd; do
    run 1 render "$model" --camera "$temporary/$file" --size 32x18 --aov rgba -o "$temporary/none"
    one_line
    reports "/$file: "
    [[ $file != shot.* ]] || reports "shot.usdc: is binary OpenUSD, which is not read; convert it to text with 'usdcat"
done
# a camera path that was saved before its frames were made
echo '{"keyframes": [{"fov": 50}], "camera_path": [], "render_width": 64, "render_height": 48}' >"$temporary/keys.json"
run 1 render "$model" --camera "$temporary/keys.json" -o "$temporary/none"
one_line
reports "keys.json: has key frames, but no camera_path; generate the camera path in the viewer of nerfstudio and export it again"
for file in "$room"/sparse/0/{cameras,images,points3D}.bin "$temporary"/fov/sparse/0/{cameras,images}.txt; do
    run 1 render "$model" --camera "$file" --aov rgba -o "$temporary/none"
    one_line
    reports "$file: is a file of a COLMAP model; give the folder of the model"
done
# Its records are counted in the first byte: 91 is the code of '['.
mkdir -p "$temporary/brackets" && printf '[\0\0\0\0\0\0\0' >"$temporary/brackets/images.bin"
run 1 render "$model" --camera "$temporary/brackets/images.bin" --aov rgba -o "$temporary/none"
one_line
reports "images.bin: is a file of a COLMAP model; give the folder of the model"
# a frame number that occurs twice
printf '7 0 0 -3 180 0 0 40\n8 0 0 -3 180 0 0 40\n7 0 0 -2 180 0 0 40\n' >"$temporary/again.chan"
run 1 render "$model" --camera "$temporary/again.chan" --size 32x18 -o "$temporary/none"
one_line
reports "again.chan: contains frame 7 more than once"
# errors of JSON files have the place
printf 'x' >"$temporary/bad.json"
run 1 render "$model" --camera "$temporary/bad.json" --aov rgba -o "$temporary/none"
one_line
reports "bad.json: line 1:"
run 1 render "$model" --camera "$temporary/missing.abc" --aov rgba -o "$temporary/none"
one_line
reports "missing.abc: cannot be read"
{ printf '\357\273\277 \n' && cat "$temporary/square_orbit/cameras.json"; } >"$temporary/cameras_without_ending"
run 0 render "$model" --camera "$temporary/cameras_without_ending" --frames 0 --size 16x9 --aov rgba -o "$temporary/marked"

# usd_cameras_are_views: the frames of one camera, or several cameras by their names. Two move one unit along z per frame.
usd_camera() { # NAME METADATA ATTRIBUTES
    printf 'def Camera "%s"%s\n{\n    float focalLength = 24\n    float horizontalAperture = 32\n    float verticalAperture = 24\n%s\n}\n' "$@"
}
moving='    double3 xformOp:translate.timeSamples = { 1001: (0, 0, 1), 1003: (0, 0, 3) }
    uniform token[] xformOpOrder = ["xformOp:translate"]'
header='#usda 1.0\n(\n    startTimeCode = 1001\n    endTimeCode = 1003\n    timeCodesPerSecond = 25\n    upAxis = "Y"\n)\n'
{ printf "$header" && usd_camera shot '' "$moving"; } >"$temporary/shot.usda"
{ printf "$header" && usd_camera shot '' "$moving" && usd_camera other '' "$moving" && usd_camera still '' '' &&
    printf 'def Xform "rig"\n{\n' && usd_camera still '' '' && usd_camera off ' (\n    active = false\n)' '' && echo '}'; } >"$temporary/shots"
usd() { run "$1" render "$model" --camera "$temporary/$2" --size 32x24 --aov rgba -o "$temporary/usd" "${@:3}"; }
usd 0 shot.usda --save-cameras chan,usda
check frames_of_the_shot test "$(pictures "$temporary/usd" exr)" = 'frame_01001.exr frame_01002.exr frame_01003.exr '
check rate_of_the_shot test "$(exr_value framesPerSecond "$temporary/usd/frame_01002.exr")" = '25/1 (25)'
check usda_rate_of_the_shot grep -q 'timeCodesPerSecond = 25$' "$temporary/usd/cameras.usda"
check chan_of_the_shot test "$(column 1,4,8 "$temporary/usd/cameras.chan" | tr '\t' : | tr -d -)" = \
    '1001:1:53.1301024 1002:2:53.1301024 1003:3:53.1301024 '
usd 1 shot.usda --first-frame 7 --save-cameras chan
one_line
reports "shot.usda: --first-frame has no effect: the time samples have frame numbers; omit it"
usd 1 shot.usda --frames 0-2
one_line
reports "--frames: 2 is out of range; choose from the frames 1001 to 1003"
rm -r "$temporary/usd"
usd 0 shot.usda --frames 1002-1003
check time_codes_select_frames test "$(pictures "$temporary/usd" exr)" = 'frame_01002.exr frame_01003.exr '
rm -r "$temporary/usd"
usd 0 shots
check names_of_the_shots test "$(cd "$temporary/usd" && find . -type f | LC_ALL=C sort | tr '\n' ' ')" = "./other_01001.exr ./other_01002.exr \
./other_01003.exr ./rig/still.exr ./shot_01001.exr ./shot_01002.exr ./shot_01003.exr ./still.exr "
usd 1 shots --frames 1001-1002
one_line
reports "--frames: the file has several cameras; choose one with --view, such as 'shot'"
usd 0 shots --view shot --frames 1003
check a_frame_of_one_of_them test -s "$temporary/usd/shot_01003.exr"
for view in other:other_01001.exr,other_01002.exr,other_01003.exr shot_01002:shot_01002.exr still:still.exr; do
    rm -r "$temporary/usd"
    usd 0 shots --view "${view%:*}" --save-cameras chan
    check "pictures of $view" test "$(pictures "$temporary/usd" exr | tr ' ' ,)" = "${view#*:},"
    check "numbers of $view" test "$(column 1 "$temporary/usd/cameras.chan" | tr ' ' ,)" = "$(case $view in
        other:*) echo 1001,1002,1003, ;; shot*) echo 1002, ;; *) echo 0, ;; esac)"
done
usd 0 shots --view other --fps 12
check rate_of_a_view test "$(exr_value framesPerSecond "$temporary/usd/other_01002.exr")" = '12/1 (12)'
usd 1 shots --view shut
one_line
reports "shots: no view named 'shut'"
usd 1 shots --first-frame 7
one_line
reports "shots: --first-frame has no effect on cameras with names"
run 1 render "$model" --camera "$temporary/shot.usda" --aov rgba -o "$temporary/none"
one_line
reports "shot.usda: cameras of OpenUSD have no image size; give it with --size"
cp "$temporary/shot.usda" "$temporary/usd/cameras.usda"
usd 1 usd/cameras.usda --save-cameras usda
one_line
reports "usd/cameras.usda: is the input of --camera and would be replaced; choose another folder"
{ printf '#usda 1.0\n' && usd_camera top '' '    token projection = "orthographic"'; } >"$temporary/top.usda"
usd 1 top.usda
one_line
reports "top.usda: camera 'top' is orthographic; only perspective cameras are read"
sed 's/1003: (0, 0, 3)/1003: (0, 0, nan)/' "$temporary/shot.usda" >"$temporary/nan.usd"
usd 1 nan.usd
one_line
reports "nan.usd: camera 'shot', time code 1002: its transform is not finite, or has a scale of 0"
sed 's/endTimeCode = 1003/endTimeCode = 1e9/' "$temporary/shot.usda" >"$temporary/long.usda"
usd 1 long.usda
one_line
reports "long.usda: camera 'shot' has the time codes 1001 to 1e+09; frames are numbered from -1000000 to 1000000: set startTimeCode and endTimeCode"

# a_scene_excludes_a_camera_file
run 2 render "$model" "$room" --camera "$temporary/twos.chan" -o "$temporary/none"
one_line
reports "SCENE and --camera are mutually exclusive; omit one"
run 2 render "$model" -o "$temporary/none"
one_line
reports "render requires a SCENE or --camera FILE; usage: sparegs render"

finish
