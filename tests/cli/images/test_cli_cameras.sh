#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Cameras of `render`: paths around a scene, camera files, sizes and projections; several samples per pixel; videos.
# Checks which images are written and how they are related; the quality of the model does not matter.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

model=$temporary/model
run 0 train "$room" -o "$model" --downscale 8 --iterations 10 --eval --quiet

pictures() { find "$1" -name "*.$2" | sort | xargs -n 1 basename | tr '\n' ' '; }
# Starting oiiotool takes longer than its work: two calls at the end compare all pictures, which stay as they are until then.
# alike OPTIONS PICTURES: the second is near the first. differ OPTIONS PICTURES: it is not.
pairs=() differing=() differences=0
alike() { pairs+=(--failpercent 0 --hardfail 1e30 "$@" --diff); }
differ() {
    differing+=("$@" --diff)
    differences=$((differences + 1))
}

# paths_have_their_frames
run 0 render "$model" "$room" --orbit 4 --aov rgba -o "$temporary/orbit"
check four_frames test "$(pictures "$temporary/orbit" exr)" = \
    'orbit_00000.exr orbit_00001.exr orbit_00002.exr orbit_00003.exr '
differ --fail 0.01 "$temporary/orbit/orbit_00000.exr" "$temporary/orbit/orbit_00002.exr"
run 0 render "$model" "$room" --orbit 4 --frames 1-3:2 --aov rgba --save-cameras chan,usda -o "$temporary/some"
check every_second test "$(pictures "$temporary/some" exr)" = 'orbit_00001.exr orbit_00003.exr '
check a_pinhole_has_no_distortion bash -c "! grep distortion '$temporary/stderr'"
check chan_has_frame_numbers test "$(cut -f 1 "$temporary/some/cameras.chan" | tr '\n' ' ')" = '0 1 2 3 '
check usda_has_frame_numbers test "$(grep -oE '^        [0-9]+: \(\(|(start|end)TimeCode = [0-9]+' "$temporary/some/cameras.usda" |
    tr -d ':( \n')" = startTimeCode=0endTimeCode=30123
# parts_of_a_sequence_write_the_same_cameras (those of the whole path, with their own numbers)
mkdir "$temporary/whole"
for frames in 0-3 0-1 2-3; do
    run 0 render "$model" "$room" --orbit 4 --frames $frames --size 32x20 --aov rgba --save-cameras json,chan,usda -o "$temporary/parts"
    cp -n "$temporary/parts"/cameras.* "$temporary/whole"
    for kind in json chan usda; do
        check "cameras.$kind of $frames" cmp "$temporary/whole/cameras.$kind" "$temporary/parts/cameras.$kind"
    done
done
json "$temporary/parts/cameras.json" 'map([.id, .img_name]) == [range(4) | [., "orbit_0000\(.)"]]'
alike --fail 0 "$temporary/orbit/orbit_00003.exr" "$temporary/some/orbit_00003.exr"
# the_first_frame_has_the_given_number (in names, .chan, .usda and --frames; ids count from 0)
run 0 render "$model" "$room" --orbit 4 --first-frame 1001 --frames 1002-1003 --aov rgba --save-cameras json,chan,usda -o "$temporary/shot"
check frames_from_1001 test "$(pictures "$temporary/shot" exr)" = 'orbit_01002.exr orbit_01003.exr '
alike --fail 0 "$temporary/orbit/orbit_00001.exr" "$temporary/shot/orbit_01002.exr"
json "$temporary/shot/cameras.json" 'map([.id, .img_name]) == [range(4) | [., "orbit_0\(. + 1001)"]]'
check chan_from_1001 test "$(cut -f 1 "$temporary/shot/cameras.chan" | tr '\n' ' ')" = '1001 1002 1003 1004 '
check usda_from_1001 test "$(grep -oE '(start|end)TimeCode = [0-9]+' "$temporary/shot/cameras.usda" | tr '\n' ' ')" = \
    'startTimeCode = 1001 endTimeCode = 1004 '
check every_usda_sample_from_1001 test "$(grep -oE '^        [0-9]+:' "$temporary/shot/cameras.usda" | sort | uniq -c | tr -d ' :\n')" = \
    61001610026100361004
run 0 render "$model" "$room" --spiral 2 --first-frame 7 --size 32x20 --aov rgba -o "$temporary/shot_spiral"
check frames_from_7 test "$(pictures "$temporary/shot_spiral" exr)" = 'spiral_00007.exr spiral_00008.exr '
run 2 render "$model" "$room" --first-frame 7 -o "$temporary/none"
reports "--first-frame requires --orbit"
run 1 render "$model" --camera "$temporary/shot/cameras.json" --first-frame 7 -o "$temporary/none"
reports "shot/cameras.json: --first-frame has no effect on cameras with names"
one_line
jq 'map(del(.img_name))' "$temporary/shot/cameras.json" >"$temporary/nameless.json"
run 0 render "$model" --camera "$temporary/nameless.json" --first-frame 7 --frames 10 --size 32x20 --aov rgba -o "$temporary/shot_nameless"
check frame_10 test "$(pictures "$temporary/shot_nameless" exr)" = 'camera_10.exr '
run 0 render "$model" --camera "$temporary/shot/cameras.json" --first-frame 7 --frames 7 --size 32x20 --aov rgba --save-cameras chan \
    -o "$temporary/shot_named"
check names_are_kept test "$(pictures "$temporary/shot_named" exr)" = 'orbit_01001.exr '
check chan_from_7 test "$(cut -f 1 "$temporary/shot_named/cameras.chan" | tr '\n' ' ')" = '7 8 9 10 '
run 0 render "$model" "$room" --spiral 3 --frames 2 --size 50x40 --aov rgba -o "$temporary/spiral"
check one_frame test "$(pictures "$temporary/spiral" exr)" = 'spiral_00002.exr '
check size_is_as_requested test "$(exr_size "$temporary/spiral/spiral_00002.exr")" = 50x40
run 1 render "$model" "$room" --orbit 4 --frames 4-9 -o "$temporary/none"
one_line
reports "choose from the frames 0 to 3"
for bad in '--frames 3-1' '--frames x' '--frames 1:' '--frames 1-2:0' '--size 10' '--size 0x5' '--size 5x70000' '--orbit 0' \
    '--spiral -1' '--first-frame -1' '--first-frame 1.5' '--spp 0' '--spp 5000' '--aperture -1' '--focus -2' '--fps 0' '--projection flat'; do
    # shellcheck disable=SC2086
    run 2 render "$model" "$room" $bad -o "$temporary/none"
    reports "${bad% *}"
done
run 2 render "$model" "$room" --orbit 3 --view 0009 -o "$temporary/none"
reports "are mutually exclusive"
for idle in '--focus 2 aperture' '--deep-max 4 deep' '--deep-tolerance 0.1 deep'; do
    read -r option value needed <<<"$idle"
    run 2 render "$model" "$room" "$option" "$value" -o "$temporary/none"
    reports "$option requires --$needed"
    one_line
done
run 2 render "$model" "$room" --aperture 0 --focus 2 -o "$temporary/none"
reports "--focus has no effect with --aperture 0"

# orbits_are_level (up is most perpendicular to the right vectors of the cameras, computed here by power iteration on the
# inverse; the mean up vector of this hand-held capture is tilted)
run 0 render "$model" "$room" --orbit 5 --size 60x40 --aov rgba,position --save-cameras json,chan,usda -o "$temporary/level"
check an_arc_is_reported grep -q 'orbit: arc of' "$temporary/stderr"
right='[.[] | [.rotation[0][0], .rotation[1][0], .rotation[2][0]]]' # columns of rotation are camera axes in the world
jq -c "$right | .[]" "$model/cameras.json" | tr -d '[]' | awk -F, '
    { for (i = 1; i <= 3; ++i) for (j = 1; j <= 3; ++j) m[i, j] += $i * $j }
    END { # adjugate of m, whose dominant eigenvector is the wanted one
        for (i = 1; i <= 3; ++i) for (j = 1; j <= 3; ++j) {
            a = i % 3 + 1; b = (i + 1) % 3 + 1; c = j % 3 + 1; d = (j + 1) % 3 + 1
            adj[j, i] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
        }
        u[1] = u[2] = u[3] = 1
        for (k = 0; k < 200; ++k) {
            n = 0
            for (i = 1; i <= 3; ++i) { w[i] = adj[i, 1] * u[1] + adj[i, 2] * u[2] + adj[i, 3] * u[3]; n += w[i] * w[i] }
            for (i = 1; i <= 3; ++i) u[i] = w[i] / sqrt(n)
        }
        print u[1], u[2], u[3]
    }' >"$temporary/up"
jq -c "$right | .[]" "$temporary/level/cameras.json" | tr -d '[]' | awk -F, -v up="$(cat "$temporary/up")" '
    BEGIN { split(up, u, " ") }
    { s = $1 * u[1] + $2 * u[2] + $3 * u[3]; if (s < 0) s = -s; if (s > worst) worst = s }
    END { print "sine of the worst roll:", worst; exit !(NR == 5 && worst < 0.0349) }' >"$temporary/roll"
check level_within_2_degrees test $? -eq 0
# orbits_of_photos_held_upright_are_level: the same cameras, turned by 90 degrees as their Exif orientation says
mkdir -p "$temporary/turned/images"
oiiotool --create 27x48 3 --attrib Orientation 6 -o "$temporary/turned/upright.jpg"
jq '{fl_x: 200, w: 270, h: 480, frames: map({file_path: "images/\(.img_name)", transform_matrix:
    [range(3) as $i | [.rotation[$i][1], .rotation[$i][0], -.rotation[$i][2], .position[$i]]]})}' \
    "$model/cameras.json" >"$temporary/turned/transforms.json"
jq -r '.frames[].file_path' "$temporary/turned/transforms.json" | while read -r name; do
    cp "$temporary/turned/upright.jpg" "$temporary/turned/$name"
done
run 0 render "$model/point_cloud/iteration_10/point_cloud.ply" "$temporary/turned" --orbit 5 --size 60x40 --aov rgba -o "$temporary/upright"
axes='.[].rotation | [.[0][0], .[1][0], .[2][0], .[0][1], .[1][1], .[2][1]] | @tsv' # right, down
jq -r "$axes" "$temporary/upright/cameras.json" | paste - <(jq -r "$axes" "$temporary/level/cameras.json") >"$temporary/axes"
check upright_within_2_degrees awk 'NR == FNR { split($0, u, " "); next }
    { r = $1 * u[1] + $2 * u[2] + $3 * u[3] # the other down vectors are those of the photos that are not turned
      if (!(r * r < 0.00122 && ($4 * u[1] + $5 * u[2] + $6 * u[3]) * ($10 * u[1] + $11 * u[2] + $12 * u[3]) > 0)) bad = 1 }
    END { exit bad || FNR != 5 }' "$temporary/up" "$temporary/axes"

# pages_orbit_about_the_up_axis, which turns with the model; the mean up vector is off by more than 8 degrees
up_is() { # PAGE X Y Z [side]: the up axis of the page, within 0.3 degrees, opposite to axis 1 (down) or 0 (right) of the first camera
    sed -n '/<script id="model"/,/<\/script>/p' "$1" | sed '1d;$d' | jq -e --argjson u "[$2, $3, $4]" --argjson k "$((5 - $#))" '
        def dot($a; $b): [range(3) as $k | $a[$k] * $b[$k]] | add;
        (dot(.up; $u) | fabs) > 0.99999 * (dot(.up; .up) * dot($u; $u) | sqrt) and dot(.up; .cameras[0].axes[$k]) < 0'
}
read -r u1 u2 u3 <"$temporary/up"
run 0 view "$model" --export "$temporary/level.html"
check a_page_of_a_run_is_level up_is "$temporary/level.html" "$u1" "$u2" "$u3"
run 0 convert "$model" "$temporary/converted.html" "$room" --downscale 8 --scale 2 --rotate 90,0,0
check a_turned_page_is_level up_is "$temporary/converted.html" "$u1" "$(awk -v x="$u3" 'BEGIN { print -x }')" "$u2"
# a_run_records_the_orientations: its page has the same axis as a page of the scene. cameras.json has them, and another
# value is refused.
ply=$model/point_cloud/iteration_10/point_cloud.ply
run 0 view "$ply" "$temporary/turned" --export "$temporary/scene.html"
check a_page_of_turned_photos_is_level up_is "$temporary/scene.html" "$u1" "$u2" "$u3" side
run 0 convert "$ply" "$temporary/scene.html" "$temporary/turned"
check a_converted_page_of_turned_photos_is_level up_is "$temporary/scene.html" "$u1" "$u2" "$u3" side
cp -r "$model" "$temporary/held"
run 0 render "$ply" "$temporary/turned" --split all --size 6x10 --aov rgba --save-cameras json -o "$temporary/cameras"
check orientations_are_written jq -e 'length > 30 and all(.exif_orientation == 6)' "$temporary/cameras/cameras.json"
cp "$temporary/cameras/cameras.json" "$temporary/held/"
run 0 view "$temporary/held" --export "$temporary/held.html"
check a_page_of_a_run_with_turned_photos_is_level up_is "$temporary/held.html" "$u1" "$u2" "$u3" side
jq '.[2].exif_orientation = 9' "$temporary/cameras/cameras.json" >"$temporary/held/cameras.json"
run 1 view "$temporary/held" --export "$temporary/held.html"
one_line
reports "cameras.json: camera 2: exif_orientation must be an integer from 1 to 8"

# exported_cameras_agree: .chan by its angles, .usda by its matrices, cameras.json by rendering with it
run 0 render "$model" --camera "$temporary/level/cameras.json" --aov rgba,position -o "$temporary/again"
alike --fail 1e-4 "$temporary/level/orbit_00003.exr" "$temporary/again/orbit_00003.exr"
jq -r '.[] | [.rotation[0][2], .rotation[1][2], .rotation[2][2], .rotation[0][1], .rotation[1][1], .rotation[2][1], .fy, .height] | @tsv' \
    "$temporary/level/cameras.json" | paste - "$temporary/level/cameras.chan" | awk '
    function off(x) { return x < 0 ? -x : x }
    { r = 3.14159265358979 / 180; x = $13 * r; y = $14 * r; z = $15 * r
      # R = Ry Rx Rz; the camera looks along -z, its y axis is up
      error = off(sin(y) * cos(x) + $1) + off(-sin(x) + $2) + off(cos(y) * cos(x) + $3)
      error += off(-cos(y) * sin(z) + sin(y) * sin(x) * cos(z) + $4) + off(cos(x) * cos(z) + $5)
      error += off($16 - 2 * atan2($8 / 2, $7) / r)
      if (error > worst) worst = error }
    END { exit !(NR == 5 && worst < 1e-4) }'
check chan_has_the_same_cameras test $? -eq 0
# positions_project_to_their_pixels: P of frame 3 by the line of the .chan, and with y up by the samples of the .usda
oiiotool --dumpdata "$temporary/level/orbit_00003.exr" | sed -n 's/.*Pixel (\([0-9]*\), \([0-9]*\)): /\1 \2 /p' |
    awk '$6 > 0.3 { print $1, $2, $6, $7, $8, $9 }' >"$temporary/points" # X Y R G B A P.X P.Y P.Z
sample() { sed -n "/ $1.timeSamples/,/}/s/^ *3: *//p" "$temporary/level/cameras.usda" | tr -d '(),'; }
echo "$(sed -n 4p "$temporary/level/cameras.chan") $(sample focalLength) $(sample horizontalAperture) $(sample verticalAperture) \
$(sample xformOp:transform)" | tr '\n' ' ' >"$temporary/camera"
check positions_project_to_their_pixels awk -v w=60 -v h=40 '
    function off(x) { return x < 0 ? -x : x }
    NR == FNR { for (i = 1; i <= NF; ++i) c[i] = $i; next } # frame, translation, angles, fov; focal, apertures, matrix by rows
    {
        r = atan2(0, -1) / 180
        # Undo the rotations in the order y, x, z: they were applied z first.
        x = $4 - c[2]; y = $5 - c[3]; z = $6 - c[4]
        t = x * cos(c[6] * r) - z * sin(c[6] * r); z = x * sin(c[6] * r) + z * cos(c[6] * r); x = t
        t = y * cos(c[5] * r) + z * sin(c[5] * r); z = -y * sin(c[5] * r) + z * cos(c[5] * r); y = t
        t = x * cos(c[7] * r) + y * sin(c[7] * r); y = -x * sin(c[7] * r) + y * cos(c[7] * r); x = t
        f = h / 2 * cos(c[8] * r / 2) / sin(c[8] * r / 2)
        error = off(w / 2 - f * x / z - $1 - 0.5) + off(h / 2 + f * y / z - $2 - 0.5)
        for (k = 0; k < 3; ++k)
            p[k] = ($4 - c[24]) * c[12 + 4 * k] + (-$5 - c[25]) * c[13 + 4 * k] + (-$6 - c[26]) * c[14 + 4 * k]
        error += off(w * (0.5 - p[0] / p[2] * c[9] / c[10]) - $1 - 0.5) + off(h * (0.5 + p[1] / p[2] * c[9] / c[11]) - $2 - 0.5)
        if (!(error < 1e-3)) ++bad
        ++n
    }
    END { print n, "points,", bad + 0, "off"; exit !(n > 500 && !bad) }' "$temporary/camera" "$temporary/points"

# headers_have_the_film_back: 36 mm wide, by the camera's focal length
jq -r '.[2] | 36 * .fx / .width' "$temporary/level/cameras.json" >"$temporary/focal"
exrheader "$temporary/level/orbit_00002.exr" | sed -n 's/^pinholeFocalLength (type float): //p' >"$temporary/pinhole"
check focal_length_in_mm awk 'NR == FNR { a = $1; next } { exit !(a > 1 && (a - $1) * (a - $1) < 1e-6 * a * a) }' "$temporary/focal" "$temporary/pinhole"
check film_back_in_mm bash -c "exrheader '$temporary/level/orbit_00002.exr' | grep -qE '^sensorOverallDimensions .type v2f.: .36 2[34]'"
# chan_omits_an_off_centre_principal_point
jq '.[:3] | map(del(.camera_model, .params) | .cx = .width / 2 | .cy = .height / 2) | .[1].cx += 0.4 | .[2].cy += 0.6' \
    "$model/cameras.json" >"$temporary/shifted.json"
run 0 render "$model" --camera "$temporary/shifted.json" --frames 0 --aov rgba --save-cameras chan -o "$temporary/shifted"
reports "cameras in chan have the principal point in the image centre; that of 1 camera(s) is moved by more than half a pixel"
run 0 render "$model" --camera "$temporary/shifted.json" --frames 0 --aov rgba --save-cameras usda -o "$temporary/shifted"
check usda_has_the_shift bash -c "! grep -q warning '$temporary/stderr'"
# pixels of a 2:1 anamorphic lens are half as wide as high; calibrations of square ones differ slightly
jq '.[:2] | map(del(.camera_model, .params) | .fy = .fx / 2) | .[1].fy = 1.005 * .[1].fx' "$model/cameras.json" >"$temporary/squeezed.json"
run 0 render "$model" --camera "$temporary/squeezed.json" --size 40x30 --aov rgba --deep -o "$temporary/squeezed"
exrheader "$temporary"/squeezed/*.exr | sed -n 's/^pixelAspectRatio (type float): //p' >"$temporary/pixel_aspects"
check pixel_aspect test "$(tr '\n' ' ' <"$temporary/pixel_aspects")" = '0.5 0.5 1 1 '
check usda_has_five_samples test "$(grep -c '^        [0-4]: ((' "$temporary/level/cameras.usda")" = 5
run 1 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --save-cameras chan -o "$temporary/around"
one_line
reports "is not perspective"
run 2 render "$model" "$room" --arc 90 -o "$temporary/none"
reports "--orbit"
run 0 render "$model" "$room" --orbit 2 --size 40x20 --path-lens view --save-cameras usda --aov rgba -o "$temporary/lens"
check no_json_unasked test ! -e "$temporary/lens/cameras.json"
reports "cameras in usda have no lens distortion; that of 2 camera(s) is omitted"

# frame_rates
run 0 render "$model" "$room" --orbit 2 --size 32x20 --aov rgba --deep --fps 23.976 --save-cameras usda -o "$temporary/rate"
for line in timeCodesPerSecond framesPerSecond; do
    check "rate_of_usda: $line" grep -qx "    $line = 23.976" "$temporary/rate/cameras.usda"
done
for name in orbit_00000.exr orbit_00001.deep.exr; do
    check "rate_of $name" bash -c "exrheader '$temporary/rate/$name' | grep -q '^framesPerSecond (type rational): 24000/1001'"
done
check no_rate_unasked bash -c "! exrheader '$temporary/level/orbit_00002.exr' | grep -q framesPerSecond"
run 0 render "$model" "$room" --orbit 2 --frames 0 --size 32x20 --aov rgba --fps 24 -o "$temporary/rate_of_exr"
check rate_without_a_video bash -c "exrheader '$temporary/rate_of_exr/orbit_00000.exr' | grep -q '^framesPerSecond (type rational): 24/1'"
run 2 render "$model" "$room" --orbit 2 --fps 24 --format png --save-cameras json -o "$temporary/none"
reports "--fps requires --video"
run 2 render "$model" "$room" --view 0001 --fps 24 -o "$temporary/none"
reports "--fps has no effect on --view, a still image"

# existing_frames_are_skipped (a frame with a missing or an empty file is rendered; the ranges of the PNGs are those of all)
frames=("$model" "$room" --orbit 4 --size 32x20 --json)
deep=(--aov "rgba,depth" --deep --save-cameras "json,chan,usda") png=(--aov "rgba,depth" --format png)
for kind in deep png; do
    declare -n these=$kind
    run 0 render "${frames[@]}" "${these[@]}" -o "$temporary/all_$kind"
    json "$temporary/stdout" 'has("skipped") | not'
    cp -r "$temporary/all_$kind" "$temporary/part_$kind"
    cp "$temporary/stdout" "$temporary/all_$kind.json"
done
rm "$temporary/part_deep/orbit_00001.deep.exr" "$temporary/part_deep"/cameras.* "$temporary/part_png/orbit_00002.depth.png"
: >"$temporary/part_deep/orbit_00003.exr"
: >"$temporary/part_png/orbit_00000.png"
echo kept >"$temporary/part_deep/orbit_00002.exr"
cp "$temporary/part_deep/orbit_00002.exr" "$temporary/all_deep/orbit_00002.exr"
run 0 render "${frames[@]}" "${deep[@]}" --skip-existing -o "$temporary/part_deep"
json "$temporary/stdout" '.skipped == 2 and ([.files[] | sub(".*/"; "")] == ["cameras.json", "cameras.chan", "cameras.usda"] +
    [(1, 3) | "orbit_0000\(.)" | (. + ".deep.exr", . + ".exr")])'
reports "2 view(s) skipped: their files exist"
check the_same_files diff -r "$temporary/all_deep" "$temporary/part_deep"
run 0 render "${frames[@]}" "${png[@]}" --skip-existing -o "$temporary/part_png"
json "$temporary/stdout" ".skipped == 2 and .ranges == $(jq -c .ranges "$temporary/all_png.json")"
check the_same_files diff -r "$temporary/all_png" "$temporary/part_png"
run 0 render "${frames[@]}" "${png[@]}" --skip-existing -o "$temporary/part_png"
json "$temporary/stdout" '.skipped == 4'
check the_same_files diff -r "$temporary/all_png" "$temporary/part_png"
run 0 render "${frames[@]}" "${png[@]}" --skip-existing -o "$temporary/new_png" # nothing exists
json "$temporary/stdout" '.skipped == 0'
check the_same_files diff -r "$temporary/all_png" "$temporary/new_png"
run 2 render "${frames[@]}" --skip-existing --video "$temporary/film.mp4" -o "$temporary/part_png"
reports "--skip-existing and --video are mutually exclusive"
# a_stopped_render_continues (the next command skips all frames that it wrote, and renders three more)
frames=("$model" "$room" --orbit 5000 --size 168x96 --format png --aov rgba --skip-existing -o "$temporary/preempted" --json)
last_command="SIGTERM to render ${frames[*]}"
"$program" render "${frames[@]}" >"$temporary/stdout" 2>"$temporary/stderr" &
job=$!
for ((i = 0; i < 600; ++i)); do
    if [ -e "$temporary/preempted/orbit_00003.png" ]; then break; fi
    sleep 0.1
done
kill -TERM $job
status=0
wait $job || status=$?
check status_of_the_signal test "$status" = 143
written=$(find "$temporary/preempted" -name '*.png' | wc -l)
check some_frames_are_written test "$written" -gt 3 -a "$written" -lt 5000
run 0 render "${frames[@]}" --frames "0-$((written + 2))"
json "$temporary/stdout" ".skipped == $written and ([.files[] | select(endswith(\".png\"))] | length) == 3"

# size_keeps_the_vertical_field_of_view: the centre of a wide image equals the narrow one
run 0 render "$model" "$room" --view 0009 --size 80x40 --aov rgba -o "$temporary/wide"
run 0 render "$model" "$room" --view 0009 --size 40x40 --aov rgba -o "$temporary/narrow"
alike --fail 1e-3 --failpercent 2 "$temporary/wide/0009.exr" --cut 40x40+20+0 "$temporary/narrow/0009.exr"

# inputs_are_not_replaced (the cameras of a run, those of --camera, the photos)
run 1 render "$model" "$room" --orbit 2 --size 20x15 --aov rgba -o "$model"
one_line
reports "is the folder of a run, whose cameras.json would be replaced"
check nothing_was_rendered test ! -e "$model/orbit_00000.exr"
cp "$model/cameras.json" "$temporary/parts/cameras.json"
run 1 render "$model" --camera "$temporary/parts/cameras.json" --save-cameras json --size 20x15 --aov rgba -o "$temporary/parts"
reports "is the input of --camera and would be replaced"
mkdir -p "$temporary/pngs/images"
oiiotool "$room/images/0001.jpg" --resize 60x34 -o "$temporary/pngs/images/0001.png" \
    "$room/images/0002.jpg" --resize 60x34 -o "$temporary/pngs/images/0002.png" \
    "$room/images/0009.jpg" --resize 60x34 -o "$temporary/pngs/images/0009.png"
jq -n '{fl_x: 400, frames: [("0001", "0002", "0009") as $name |
    {file_path: "images/\($name).png", transform_matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}' \
    >"$temporary/pngs/transforms.json"
cp "$temporary/pngs/images/0002.png" "$temporary/photo.png"
run 1 render "$model" "$temporary/pngs" --split all --format png --aov rgba -o "$temporary/pngs"
one_line
reports "images/0001.png: is a photo or a mask of the scene; choose another folder"
run 1 eval "$model/point_cloud/iteration_10/point_cloud.ply" "$temporary/pngs" --split all --save "$temporary/pngs"
reports ".png: is a photo or a mask of the scene; choose another folder"
check the_photo_is_as_before cmp "$temporary/photo.png" "$temporary/pngs/images/0002.png"
# Names of other outputs: a view 0001 and one that is named like a copy of its photo or its depth.
for other in 0001_photo 0001.depth; do
    mkdir "$temporary/alike"
    cp "$room/images/0001.jpg" "$temporary/alike/"
    cp "$temporary/photo.png" "$temporary/alike/$other.png"
    jq --arg other "$other.png" '.frames |= .[:2] | .frames[0].file_path = "0001.jpg" | .frames[1].file_path = $other' "$temporary/pngs/transforms.json" >"$temporary/alike/transforms.json"
    run 1 eval "$model/point_cloud/iteration_10/point_cloud.ply" "$temporary/alike" --split all --save "$temporary/alike"
    reports "alike/$other.png: is a photo or a mask of the scene; choose another folder"
    run 1 render "$model" "$temporary/alike" --split all --format png --aov rgba,depth -o "$temporary/alike"
    reports "alike/$other.png: is a photo or a mask of the scene; choose another folder"
    check the_photo_is_as_before cmp "$temporary/photo.png" "$temporary/alike/$other.png"
    rm -r "$temporary/alike"
done
run 0 render "$model" "$temporary/pngs" --split all --format png --aov rgba -o "$temporary/pngs/images"

# views_do_not_overwrite_each_other (equal stems keep their extension, equal names are numbered, no name leaves the folder)
jq '.[0] as $camera | ["a.jpg", "a.png", "b.jpg", "c", "c", "c_2", "..", "../up.png", "in/a.jpg", ".hidden", "d.png", "d.deep.png", "d_flip.png"] |
    map($camera + {img_name: .})' "$model/cameras.json" >"$temporary/names.json"
run 0 render "$model" --camera "$temporary/names.json" --size 20x15 --aov rgba -o "$temporary/names/inner"
(cd "$temporary/names" && find . -type f | LC_ALL=C sort | tr '\n' ' ') >"$temporary/names.txt"
check each_view_has_a_file test "$(cat "$temporary/names.txt")" = './inner/.hidden.exr ./inner/a.jpg.exr ./inner/a.png.exr ./inner/b.exr ./inner/c.exr ./inner/c_2.exr ./inner/c_2_2.exr ./inner/d.deep.png.exr ./inner/d.exr ./inner/d_flip.png.exr ./inner/in/a.exr ./inner/up.exr ./inner/view.exr '

run 0 render "$model" --camera "$temporary/names.json" --frames 1-2 --size 20x15 --aov rgba -o "$temporary/part_of_names"
check parts_have_the_names_of_the_whole test "$(pictures "$temporary/part_of_names" exr)" = 'a.png.exr b.exr '
run 0 render "$model" --camera "$temporary/names.json" --view a.png --size 20x15 --aov rgba -o "$temporary/one_of_names"
check a_view_has_its_name_of_the_whole test "$(pictures "$temporary/one_of_names" exr)" = 'a.png.exr '
mkdir -p "$temporary/two_names/images"
cp "$room/images/0001.jpg" "$temporary/two_names/images/a.jpg"
cp "$temporary/photo.png" "$temporary/two_names/images/a.png"
jq -n '{fl_x: 400, frames: [("a.jpg", "a.png") as $name |
    {file_path: "images/\($name)", transform_matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}' \
    >"$temporary/two_names/transforms.json"
run 0 render "$model" "$temporary/two_names" --test-images a.png --split test --aov rgba -o "$temporary/a_split"
check a_split_has_the_names_of_the_scene test "$(pictures "$temporary/a_split" exr)" = 'a.png.exr '

run 0 render "$model" "$room" --orbit 2 --size 20x15 --aov rgba --json -o "$temporary/listed"
json "$temporary/stdout" '.files | length == 3 and (.[0] | endswith("cameras.json")) and all(.[1:][]; endswith(".exr"))'

# near_distance_is_that_of_the_run (recorded in OUT, also used without a scene)
json "$model/config.json" '.near_distance == 0.2'
cp -r "$model" "$temporary/short_sighted"
jq '.near_distance = 1000' "$model/config.json" >"$temporary/short_sighted/config.json"
run 0 render "$temporary/short_sighted" --camera "$model/cameras.json" --frames 0 --aov rgba -o "$temporary/nothing"
check nothing_is_drawn bash -c 'oiiotool --stats "$0" | grep -q "Constant Color: 0.000000 0.000000 0.000000 0.000000"' "$(find "$temporary/nothing" -name '*.exr')"

# panoramas (the centre looks in the direction of the view)
run 0 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --aov rgba,depth -o "$temporary/around"
check panorama_is_marked bash -c "exrheader '$temporary/around/0009.exr' | grep -q 'envmap (type envmap): latitude-longitude map'"
run 0 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --aov rgba --compression dwaa -o "$temporary/dwaa"
check panorama_is_marked_with_dwaa bash -c "exrheader '$temporary/dwaa/0009.exr' | grep -q 'envmap (type envmap): latitude-longitude map'"
check twice_as_wide test "$(exr_size "$temporary/around/0009.exr")" = 96x48
run 0 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --aov rgba,depth --reference -o "$temporary/exact"
alike --fail 0.002 --hardfail 0.1 --failpercent 1 "$temporary/around/0009.exr" --ch R,G,B,A "$temporary/exact/0009.exr" --ch R,G,B,A
run 1 render "$model" "$room" --view 0009 --projection equirectangular --depth z -o "$temporary/none"
one_line
reports "--depth z is not defined for rays 90 degrees or more from the camera axis; measure along the ray"
run 1 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --depth z --reference -o "$temporary/none"
one_line
reports "--depth z is not defined"
run 1 render "$model" "$room" --view 0009 --projection equirectangular --aperture 1 -o "$temporary/none"
one_line
reports "--aperture requires a perspective lens"

# cameras_json_keeps_the_lens: of a data set, of a path, and of a panorama
lens() { jq -r '.[0] | "\(.camera_model) \(.params | length)"' "$1"; }
run 0 render "$model" "$room" --view 0009 --aov rgba -o "$temporary/lens"
run 0 render "$model" --camera "$model/cameras.json" --view 0009.jpg --aov rgba -o "$temporary/lens_again"
alike --fail 0.0001 "$temporary/lens/0009.exr" "$temporary/lens_again/0009.exr"
check it_is_not_a_pinhole bash -c "! jq -e '.[0].camera_model == \"PINHOLE\"' '$model/cameras.json'"
jq '[.[0] | .camera_model = "OPENCV_FISHEYE" | .fx /= 3 | .fy /= 3 |
    .params = [.fx, .fy, .cx, .cy, 0.02, -0.01, 0.003, -0.001]]' \
    "$model/cameras.json" >"$temporary/bent.json"
run 0 render "$model" --camera "$temporary/bent.json" --aov rgba --save-cameras json -o "$temporary/bent"
check the_lens_is_written test "$(lens "$temporary/bent/cameras.json")" = "OPENCV_FISHEYE 8"
run 0 render "$model" --camera "$temporary/bent/cameras.json" --aov rgba -o "$temporary/bent_again"
alike --fail 0.0001 "$temporary/bent"/*.exr "$temporary/bent_again"/*.exr
run 0 render "$model" "$room" --view 0009 --projection equirectangular --size 96x48 --aov rgba --save-cameras json -o "$temporary/globe"
check a_panorama_is_written test "$(lens "$temporary/globe/cameras.json")" = "EQUIRECTANGULAR 4"
run 0 render "$model" --camera "$temporary/globe/cameras.json" --aov rgba -o "$temporary/globe_again"
alike --fail 0.0001 "$temporary/globe/0009.exr" "$temporary/globe_again/0009.exr"
run 1 render "$model" --camera "$temporary/globe/cameras.json" --aov rgba --overscan 4 -o "$temporary/none"
reports "0009.jpg: --overscan has no effect on a panorama"
one_line
run 0 render "$model" --camera "$temporary/globe/cameras.json" --size 48x48 --aov rgba -o "$temporary/globe_sized"
is_latlong() { exrheader "$1" | grep -q '^envmap (type envmap): latitude-longitude map'; }
check a_panorama_of_another_size_is_whole is_latlong "$temporary/globe_sized/0009.exr"
jq '.[0].cx += 3' "$temporary/globe/cameras.json" >"$temporary/part.json"
run 0 render "$model" --camera "$temporary/part.json" --aov rgba -o "$temporary/part"
check a_shifted_panorama_is_no_environment bash -c "exrheader '$temporary/part/0009.exr' >'$temporary/info' && ! grep -qi 'envmap\|latlong' '$temporary/info'"
run 2 render "$model" "$room" --orbit 3 --projection equirectangular --path-lens view -o "$temporary/none"
reports "--path-lens has no effect with --projection equirectangular"
# cx and cy of a lens are those of params where they are missing
jq '.[0] |= (.params[2] += 5 | .cx = .params[2])' "$temporary/bent.json" >"$temporary/given.json"
jq '.[0] |= del(.cx, .cy)' "$temporary/given.json" >"$temporary/missing.json"
for name in given missing; do run 0 render "$model" --camera "$temporary/$name.json" --aov rgba -o "$temporary/centre_$name"; done
alike --fail 0 "$temporary/centre_given"/*.exr "$temporary/centre_missing"/*.exr
for broken in '.camera_model = 5' '.camera_model = "LENS"' '.params = [1]' 'del(.params)' '.params[7] = "x"' '.fx *= 2'; do
    jq ".[0] |= ($broken)" "$temporary/bent.json" >"$temporary/wrong.json"
    run 1 render "$model" --camera "$temporary/wrong.json" -o "$temporary/none"
    one_line
    reports "wrong.json: camera 0: "
done

# samples_are_averaged (with a pinhole, 16 samples are near the mean of the larger image)
run 0 render "$model" "$room" --view 0009 --aov rgba,depth -o "$temporary/one"
run 0 render "$model" "$room" --view 0009 --aov rgba,depth --spp 16 -o "$temporary/many"
alike --fail 0 "$temporary/one/0009.exr" --ch depth.Z "$temporary/many/0009.exr" --ch depth.Z
alike --fail 0.1 --failpercent 5 "$temporary/one/0009.exr" --ch R,G,B,A "$temporary/many/0009.exr" --ch R,G,B,A
differ --fail 0.0001 "$temporary/one/0009.exr" --ch R "$temporary/many/0009.exr" --ch R
width=$(exr_size "$temporary/one/0009.exr")
run 0 render "$model" "$room" --view 0009 --aov rgba --size $((8 * ${width%x*}))x$((8 * ${width#*x})) --filter none -o "$temporary/fine"
run 0 render "$model" "$room" --view 0009 --aov rgba --spp 64 --filter none -o "$temporary/mean"
alike --fail 0.02 --failpercent 2 "$temporary/mean/0009.exr" "$temporary/fine/0009.exr" --resize:filter=box "$width"
run 0 render "$model" "$room" --view 0009 --aov rgba --aperture 0.5 --spp 16 -o "$temporary/blurred"
differ --fail 0.01 "$temporary/one/0009.exr" --ch R "$temporary/blurred/0009.exr" --ch R
run 0 render "$model" "$room" --view 0009 --aov rgba --aperture 0.000001 --focus 3 --spp 16 -o "$temporary/pin"
alike --fail 0.001 --hardfail 0.05 "$temporary/pin/0009.exr" "$temporary/many/0009.exr" --ch R,G,B,A
run 2 render "$model" "$room" --view 0009 --deep --spp 4 -o "$temporary/none"
reports "--deep and --spp are mutually exclusive"

# nerfstudio_paths (the same camera as in cameras.json)
first=$(jq '.[0]' "$model/cameras.json")
echo "$first" | jq '[.]' >"$temporary/first.json"
echo "$first" | jq '{camera_type: "perspective", render_width: .width, render_height: .height, fps: 12, camera_path: [{
    fov: (2 * (((.height / 2) / .fy) | atan) * 180 / 3.141592653589793),
    camera_to_world: [.rotation[0][0], -.rotation[0][1], -.rotation[0][2], .position[0],
                      .rotation[1][0], -.rotation[1][1], -.rotation[1][2], .position[1],
                      .rotation[2][0], -.rotation[2][1], -.rotation[2][2], .position[2], 0, 0, 0, 1]}]}' >"$temporary/path.json"
jq '.[0] |= (.fx = .fy | del(.cx, .cy, .camera_model, .params) | .img_name = "frame_00000")' "$temporary/first.json" >"$temporary/same.json"
run 0 render "$model" --camera "$temporary/path.json" --aov rgba -o "$temporary/path"
run 0 render "$model" --camera "$temporary/same.json" --aov rgba -o "$temporary/same"
alike --fail 0.001 "$temporary/path/frame_00000.exr" "$temporary/same/frame_00000.exr"
run 0 render "$model" --camera "$temporary/path.json" --first-frame 1001 --size 32x20 --aov rgba -o "$temporary/shot_path"
check path_from_1001 test "$(pictures "$temporary/shot_path" exr)" = 'frame_01001.exr '
jq '.camera_type = "equirectangular"' "$temporary/path.json" >"$temporary/around.json"
run 0 render "$model" --camera "$temporary/around.json" --size 64x32 --aov rgba -o "$temporary/path_around"
for broken in '.camera_path[0].fov = 180' '.camera_path[0].camera_to_world[0] = 7' '.camera_path[0].camera_to_world = [1]' \
    '.render_width = 0' '.fps = 1e7' '.fps = 0.001' '.camera_type = "orthographic"' '.camera_path = []' '.camera_path = 5'; do
    jq "$broken" "$temporary/path.json" >"$temporary/broken.json"
    run 1 render "$model" --camera "$temporary/broken.json" -o "$temporary/none"
    one_line
    reports broken.json
done

# byte_order_marks_are_skipped
{ printf '\357\273\277' && cat "$temporary/path.json"; } >"$temporary/marked.json"
run 0 render "$model" --camera "$temporary/marked.json" --size 64x32 --aov rgba -o "$temporary/path_marked"

# other_camera_paths_are_named (that of instant-ngp)
printf '{"path": [{"R": [0, 0, 0, 1], "T": [0, 0, 0], "fov": 50}], "time": 0}' >"$temporary/other.json"
run 1 render "$model" --camera "$temporary/other.json" -o "$temporary/none"
one_line
reports 'other.json: contains no cameras of a known format; cameras are read from cameras.json, transforms.json, .chan,'

# a_transforms_json_is_a_camera_file
jq '{w: .[0].width, h: .[0].height, fl_x: .[0].fx, fl_y: .[0].fy, cx: .[0].cx, cy: .[0].cy,
    camera_model: .[0].camera_model, k1: .[0].params[4], k2: .[0].params[5], p1: .[0].params[6], p2: .[0].params[7], frames: [.[] | {
    file_path: .img_name, transform_matrix: [
        [.rotation[0][0], -.rotation[0][1], -.rotation[0][2], .position[0]],
        [.rotation[1][0], -.rotation[1][1], -.rotation[1][2], .position[1]],
        [.rotation[2][0], -.rotation[2][1], -.rotation[2][2], .position[2]], [0, 0, 0, 1]]}]}' "$temporary/first.json" >"$temporary/transforms.json"
run 0 render "$model" --camera "$temporary/transforms.json" --aov rgba -o "$temporary/from_transforms"
run 0 render "$model" --camera "$temporary/first.json" --aov rgba -o "$temporary/from_cameras"
alike --fail 0.001 "$temporary/from_transforms/$(pictures "$temporary/from_transforms" exr | tr -d ' ')" \
    "$temporary/from_cameras/$(pictures "$temporary/from_cameras" exr | tr -d ' ')"
jq '.frames = []' "$temporary/transforms.json" >"$temporary/no_frames.json"
run 1 render "$model" --camera "$temporary/no_frames.json" -o "$temporary/none"
one_line

# a_spiral_around_one_view_moves (its size is that of the points)
mkdir "$temporary/one"
cp "$model/input.ply" "$temporary/one/"
jq '.ply_file_path = "input.ply"' "$temporary/transforms.json" >"$temporary/one/transforms.json"
run 0 render "$(find "$model/point_cloud" -name point_cloud.ply)" "$temporary/one" --spiral 3 --size 60x33 --aov rgba -o "$temporary/one_spiral"
json "$temporary/one_spiral/cameras.json" '[.[].position] | (.[0][0] - .[1][0] | fabs) + (.[0][1] - .[1][1] | fabs) > 0.1'

# a_colmap_model_is_a_camera_file (of the bundled scene, without photos)
mkdir -p "$temporary/colmap/sparse"
cp -r "$room/sparse/0" "$temporary/colmap/sparse/0"
run 0 render "$model" --camera "$temporary/colmap" --view 0009.jpg --size 60x33 --aov rgba -o "$temporary/colmap_views"
run 0 render "$model" "$room" --view 0009.jpg --downscale 1 --size 60x33 --aov rgba -o "$temporary/scene_views"
alike --fail 0 "$temporary/colmap_views/0009.exr" "$temporary/scene_views/0009.exr"
run 0 render "$model" --camera "$temporary/colmap" --frames 0-30:10 --size 30x17 --aov rgba -o "$temporary/colmap_some"
check four_views test "$(find "$temporary/colmap_some" -name '*.exr' | wc -l)" = 4
run 1 render "$model" --camera "$temporary/bin_that_is_not_there" -o "$temporary/none"
one_line
reports bin_that_is_not_there
run 1 render "$model" --camera "$temporary/orbit" -o "$temporary/none"
one_line

# views_of_a_camera_file_have_short_names (like those of a scene)
jq '.[0:3] | .[0].img_name = "left/IMG_1.jpg" | .[1].img_name = "IMG_1" | .[2].img_name = "left/IMG_2.jpg"' \
    "$model/cameras.json" >"$temporary/named.json"
for pair in 'IMG_2 left/IMG_2' 'IMG_2.jpg left/IMG_2' 'left/IMG_2.jpg left/IMG_2' 'IMG_1 IMG_1' 'IMG_1.jpg left/IMG_1'; do
    rm -rf "$temporary/by_name"
    run 0 render "$model" --camera "$temporary/named.json" --view "${pair% *}" --size 20x15 --aov rgba -o "$temporary/by_name"
    check "one_view_named ${pair% *}" test "$(cd "$temporary/by_name" && find . -type f)" = "./${pair#* }.exr"
done
run 1 render "$model" --camera "$temporary/named.json" --view IMG_3 -o "$temporary/none"
one_line
reports "named.json: no view named 'IMG_3' (did you mean 'IMG_1'?)"
run 1 render "$model" --camera "$temporary/named.json" --view picture.png -o "$temporary/none"
one_line
reports "named.json: no view named 'picture.png'; its $(jq length "$temporary/named.json") views begin with 'left/IMG_1.jpg'"

# chan_cameras_are_read (all angles differ from 0; frame numbers become names)
jq 'map(del(.camera_model, .params, .cx, .cy) | .fy = .fx)' "$model/cameras.json" >"$temporary/hand_held.json"
run 0 render "$model" --camera "$temporary/hand_held.json" --first-frame 1001 --size 60x40 --aov rgba --save-cameras json,chan,usda \
    -o "$temporary/hand_held"
run 0 render "$model" --camera "$temporary/hand_held/cameras.chan" --size 60x40 --aov rgba --save-cameras json,chan -o "$temporary/from_chan"
check chan_round_trip cmp "$temporary/hand_held/cameras.chan" "$temporary/from_chan/cameras.chan"
check chan_names test "$(jq -r '.[1].img_name' "$temporary/from_chan/cameras.json")" = frame_01002
second=$(jq -r '.[1].img_name' "$temporary/hand_held.json")
alike --fail 1e-3 "$temporary/hand_held/${second%.*}.exr" "$temporary/from_chan/frame_01002.exr"
# usda_cameras_are_read (the same frames)
run 0 render "$model" --camera "$temporary/hand_held/cameras.usda" --size 60x40 --aov rgba --save-cameras json,chan -o "$temporary/from_usda"
check usda_names test "$(jq -r '.[1].img_name' "$temporary/from_usda/cameras.json")" = frame_01002
alike --fail 1e-3 "$temporary/hand_held/${second%.*}.exr" "$temporary/from_usda/frame_01002.exr"
json "$temporary/from_usda/cameras.json" "[., $(jq -c . "$temporary/hand_held/cameras.json")] | transpose | length == 35 and
    all(.[]; map([.fx, .fy, .cx, .cy, .position[], .rotation[][]]) | transpose |
        all(.[]; (.[0] - .[1] | fabs) <= 1e-9 * ((.[1] | fabs) + 1)))"
check chan_from_usda awk 'NR == FNR { for (k = 1; k <= 8; ++k) a[FNR, k] = $k; n = FNR; next }
    { for (k = 1; k <= 8; ++k) { d = a[FNR, k] - $k; if (!(d * d < 1e-12)) { print FNR, k, a[FNR, k], $k; bad = 1 } } }
    END { exit bad || !n || FNR != n }' "$temporary/hand_held/cameras.chan" "$temporary/from_usda/cameras.chan"
# one angle at a time: the camera looks along -z; yaw turns it to -x, pitch up, roll turns its x axis up
printf '# Nuke\n\n7 1 2 3 0 0 0 90\r\n9 0 0 0 0 90 0 60\n10\t0 0 0 30 0 0 60\n11 0 0 0 0 0 30 60\n' >"$temporary/angles.chan"
run 0 render "$model" --camera "$temporary/angles.chan" --size 64x48 --aov rgba --save-cameras json -o "$temporary/angles"
json "$temporary/angles/cameras.json" 'def near(x): . as $l | [range(length) | ($l[.] - x[.]) | fabs < 1e-6] | all;
    def look: [.rotation[][2]]; def right: [.rotation[][0]];
    (map(.img_name) == ["frame_00007", "frame_00009", "frame_00010", "frame_00011"]) and
    (.[0].position | near([1, 2, 3])) and (.[0] | look | near([0, 0, -1])) and ([.[0].fx, .[0].fy] | near([24, 24])) and
    (.[1] | look | near([-1, 0, 0])) and (.[2] | look | near([0, 0.5, -0.8660254])) and
    (.[3] | right | near([0.8660254, 0.5, 0]))'
run 0 render "$model" --camera "$temporary/angles.chan" --size 64x48 --view frame_00009 --aov rgba -o "$temporary/one_angle"
check one_frame_of_a_chan test "$(pictures "$temporary/one_angle" exr)" = 'frame_00009.exr '
run 1 render "$model" --camera "$temporary/angles.chan" --aov rgba -o "$temporary/none"
one_line
reports "angles.chan: a .chan file has no image size; give it with --size"
run 1 render "$model" --camera "$temporary/from_chan/cameras.chan" --save-cameras chan --size 20x15 -o "$temporary/from_chan"
one_line
reports "from_chan/cameras.chan: is the input of --camera and would be replaced"
while IFS='|' read -r text problem; do
    printf "$text" >"$temporary/bad.chan"
    run 1 render "$model" --camera "$temporary/bad.chan" --size 64x48 -o "$temporary/none"
    one_line
    reports "bad.chan: $problem"
done <<'END'
|contains no cameras
# only a comment\n|contains no cameras
1 0 0 0 0 0 0 50\n2 0 0 0 0 0 0\n|line 2: has no field of view
1 0 0 0 0 0 0 50 9\n|line 1: must be eight numbers
1 0 0 0 0 nan 0 50\n|line 1: must be eight numbers
1 0 0 0 0 0x 0 50\n|line 1: must be eight numbers
1.5 0 0 0 0 0 0 50\n|line 1: must begin with a frame number
2000000 0 0 0 0 0 0 50\n|line 1: must begin with a frame number from -1000000 to 1000000
1 0 0 0 0 0 0 179\n|line 1: must end with a field of view between 0 and 179 degrees
%0600d\n|line 1: is too long
END

# cameras_without_a_size (NeRF synthetic: a horizontal angle only; here 2 atan(1/2))
jq '{camera_angle_x: 0.9272952180016122, frames: [.frames[] | {file_path: "./train/r_0", transform_matrix}]}' \
    "$temporary/transforms.json" >"$temporary/sizeless.json"
run 0 render "$model" --camera "$temporary/sizeless.json" --size 64x48 --aov rgba --save-cameras json -o "$temporary/sized"
json "$temporary/sized/cameras.json" '.[0] | .width == 64 and .height == 48 and .cx == 32 and .cy == 24 and
    ([.fx, .fy] | all(. - 64 | fabs < 1e-4))'
run 1 render "$model" --camera "$temporary/sizeless.json" --aov rgba -o "$temporary/none"
one_line
reports "sizeless.json: no image size"
reports "add 'w' and 'h', or give it with --size"

# paths_need_no_photos
run 0 render "$model" "$temporary/colmap" --orbit 3 --frames 1 --size 40x30 --aov rgba -o "$temporary/no_photos"
run 0 render "$model" "$room" --orbit 3 --frames 1 --size 40x30 --aov rgba -o "$temporary/with_photos"
check same_path cmp "$temporary/no_photos/cameras.json" "$temporary/with_photos/cameras.json"
alike --fail 0 "$temporary/no_photos/orbit_00001.exr" "$temporary/with_photos/orbit_00001.exr"
run 0 render "$model" "$temporary/colmap" --spiral 2 --frames 0 --size 40x30 --aov rgba -o "$temporary/no_photos"
run 1 render "$model" "$temporary/colmap" --orbit 3 --images images -o "$temporary/none"
one_line
reports "no image folder 'images'"
run 1 render "$model" "$temporary/nowhere" --orbit 3 -o "$temporary/none"
one_line
reports nowhere

# videos (a replacement for ffmpeg counts its input)
mkdir "$temporary/bin"
cat >"$temporary/bin/ffmpeg" <<'EOF'
#!/usr/bin/env bash
printf '%s\n' "$@" >"$FFMPEG_SAYS"
[ -z "${FFMPEG_FAILS:-}" ] || { echo 'first word' >&2; echo 'no such encoder' >&2; exit 1; }
out=${*: -1}
out=${out#file:}
[ -z "${FFMPEG_ENDS:-}" ] || { head -c 1000 >"$out"; exit 0; }
exec wc -c >"$out"
EOF
chmod +x "$temporary/bin/ffmpeg"
export FFMPEG_SAYS=$temporary/arguments
real_path=$PATH
PATH=$temporary/bin:$PATH
run 0 render "$model" "$room" --orbit 3 --size 33x20 --video "$temporary/film;x.mp4" --fps 24
prints "$temporary/film;x.mp4"
reports "film;x.mp4: the sizes of videos are even: frames of 33 x 20 pixels are padded with black to 34 x 20"
check padded grep -q '^pad=' "$temporary/arguments"
check three_frames_of_bytes test "$(tr -d ' ' <"$temporary/film;x.mp4")" = $((3 * 33 * 20 * 3))
check threads_of_the_encoder_are_fixed test "$(grep -xA1 -- -threads "$temporary/arguments" | tail -n 1)" = 16
check size_and_rate bash -c "grep -qx 33x20 '$temporary/arguments' && grep -qx 24/1 '$temporary/arguments'"
check colours_of_bt709 bash -c "grep -q ',scale=out_color_matrix=bt709:out_range=tv$' '$temporary/arguments' &&
    grep -xA1 -- -colorspace '$temporary/arguments' | grep -qx bt709"
check no_leftover test "$(find "$temporary" -maxdepth 1 '(' -name '.*' -type f -o -name '*.tmp.*' ')' | wc -l)" = 0
check names_with_colons_are_no_protocols grep -qxE "file:.*film;x\.mp4\.tmp\.[0-9]+\.mp4" "$temporary/arguments"
run 0 render "$model" "$room" --orbit 2 --size 33x20 --video "$temporary/ntsc.mp4" --fps 23.976
check rate_of_the_exr_files grep -qx 24000/1001 "$temporary/arguments"
run 0 render "$model" "$room" --orbit 2 --size 33x21 --video "$temporary/odd.gif"
check gif_is_not_padded bash -c "! grep -q 'pad=' '$temporary/arguments' && ! grep -q even '$temporary/stderr'"
run 0 render "$model" "$room" --orbit 2 --size 34x20 --video "$temporary/even.mp4"
check even_sizes_need_no_note bash -c "! grep -q even '$temporary/stderr'"
run 0 render "$model" "$room" --orbit 2 --size 33x20 --aov rgba --video "$temporary/near.mp4" --fps 24.0004 -o "$temporary/near"
check rate_of_the_video_is_rounded grep -qx 24/1 "$temporary/arguments"
check rate_of_the_exr_files bash -c "exrheader '$temporary/near/orbit_00000.exr' | grep -q '^framesPerSecond (type rational): 24/1'"
run 0 render "$model" --camera "$temporary/path.json" --video "$temporary/path.mp4" -o "$temporary/both" --format png --aov rgba
check rate_of_the_path grep -qx 12/1 "$temporary/arguments"
check rate_of_the_path_in_exr bash -c "exrheader '$temporary/path/frame_00000.exr' | grep -q '^framesPerSecond (type rational): 12/1'"
check frames_too test "$(pictures "$temporary/both" png)" = 'frame_00000.png '
FFMPEG_FAILS=1 run 1 render "$model" "$room" --orbit 2 --size 34x20 --video "$temporary/bad.mp4"
one_line
reports "bad.mp4: ffmpeg failed: no such encoder"
check no_video test ! -e "$temporary/bad.mp4"
FFMPEG_ENDS=1 run 1 render "$model" "$room" --orbit 2 --size 400x300 --video "$temporary/bad.mp4"
one_line
reports "bad.mp4: ffmpeg failed: it ended early, without an error message"
check no_video test ! -e "$temporary/bad.mp4"
jq '[.[0], (.[0] | .width += 2)]' "$model/cameras.json" >"$temporary/sizes.json"
run 1 render "$model" --camera "$temporary/sizes.json" --video "$temporary/bad.mp4" -o "$temporary/no_frames"
one_line
reports "all frames of a video must have the same size"
check before_the_first_frame test "$(find "$temporary/no_frames" -name '*.exr' | wc -l)" = 0
# a request to stop discards the video
status=0
last_command="SIGTERM to render --video"
timeout --foreground 120 "$program" render "$model" "$room" --orbit 20000 --size 33x20 --video "$temporary/stopped.mp4" \
    >"$temporary/stdout" 2>"$temporary/stderr" &
job=$!
for ((i = 0; i < 600; ++i)); do
    if grep -q stopped.mp4 "$temporary/arguments"; then break; fi
    sleep 0.1
done
kill -TERM "$(pgrep -P $job)" || true
wait $job || status=$?
check status_of_the_signal test "$status" = 143
reports "stopped.mp4: stopped; no video was written"
check no_leftover test -z "$(find "$temporary" -name '*stopped*')"
mkdir "$temporary/empty"
PATH=$temporary/empty run 1 render "$model" "$room" --orbit 2 --video "$temporary/none.mp4"
PATH=$real_path
one_line
reports "ffmpeg, which is not installed"
for film in "$temporary/video" "$temporary/" "$temporary/video." .mp4; do
    run 2 render "$model" "$room" --orbit 2 --video "$film"
    reports "has no extension, which selects the format"
done
run 2 render "$model" "$room" --orbit 2
reports "or --video FILE"
if installed ffprobe; then # the real one, where it is
    run 0 render "$model" "$room" --orbit 3 --size 33x21 --video "$temporary/real.mp4"
    check a_video bash -c "ffprobe -v error -count_frames -show_entries stream=nb_read_frames,width,height -of csv '$temporary/real.mp4' |
        grep -q '34,22,3'"
    check marked_colours test "$(ffprobe -v error -show_entries stream=color_range,color_space,color_transfer,color_primaries \
        -of csv=p=0 "$temporary/real.mp4")" = tv,bt709,iec61966-2-1,bt709
fi

# a_view_name_that_denotes_several_views_is_refused
jq '.[0].img_name = "l/y.jpg" | .[1].img_name = "r/y.jpg" | .[2].img_name = "r/x.jpg" | .[3].img_name = "r/x.png"' \
    "$model/cameras.json" >"$temporary/names.json"
for view in y y.jpg; do
    run 1 render "$model" --camera "$temporary/names.json" --view $view --aov rgba -o "$temporary/named"
    reports "names.json: --view '$view' is ambiguous: 'l/y.jpg' or 'r/y.jpg'; give the full name"
    one_line
done
run 1 render "$model" --camera "$temporary/names.json" --view x --aov rgba -o "$temporary/named"
reports "'r/x.jpg' or 'r/x.png'"
for view in r/y.jpg r/y x.png; do
    run 0 render "$model" --camera "$temporary/names.json" --view $view --aov rgba -o "$temporary/named"
done

# chan_keeps_the_roll_of_vertical_cameras: straight down and up, with the right axis (0.6, 0, 0.8)
jq '.[0].rotation = [[0.6, -0.8, 0], [0, 0, -1], [0.8, 0.6, 0]] | .[1].rotation = [[0.6, 0.8, 0], [0, 0, 1], [0.8, -0.6, 0]] |
    .[:2] | map(.img_name = "v\(.id)" | .cx = .width / 2 | .cy = .height / 2)' "$model/cameras.json" >"$temporary/vertical.json"
run 0 render "$model" --camera "$temporary/vertical.json" --aov rgba --save-cameras chan -o "$temporary/vertical"
check vertical_cameras_in_chan awk '
    { r = atan2(0, -1) / 180; x = $5 * r; y = $6 * r; z = $7 * r # the right axis of Ry Rx Rz
      error += (cos(y) * cos(z) + sin(y) * sin(x) * sin(z) - 0.6) ^ 2 + (cos(x) * sin(z)) ^ 2
      error += (-sin(y) * cos(z) + cos(y) * sin(x) * sin(z) - 0.8) ^ 2 + (sin(x) - (NR == 1 ? -1 : 1)) ^ 2 }
    END { exit !(NR == 2 && error < 1e-12) }' "$temporary/vertical/cameras.chan"

last_command="all renders"
check pictures_are_alike oiiotool "${pairs[@]}"
oiiotool "${differing[@]}" >"$temporary/differences" || true
check pictures_differ test "$(grep -cx FAILURE "$temporary/differences")" = "$differences"

finish
