#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# No output replaces a file of the scene that the command reads, a part of a multi-file model, another output, or a file
# that is no report. Scenes are copies, so that a failure damages no test data.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
cp -r "$room" "$temporary/room"
scene=$temporary/room model=$temporary/model
small=(--downscale 16 --quiet)
run 0 train "$scene" -o "$model" "${small[@]}" --eval --iterations 5
ply=$model/point_cloud/iteration_5/point_cloud.ply
mkdir -p "$temporary/pngs/images" "$temporary/pngs/masks"
oiiotool --pattern constant:color=1 60x34 1 -d uint8 -o "$temporary/pngs/masks/0001.png" \
    "$room/images/0001.jpg" --resize 60x34 -o "$temporary/pngs/images/0001.png" \
    "$room/images/0002.jpg" --resize 60x34 -o "$temporary/pngs/images/0002.png" \
    "$room/images/0009.jpg" --resize 60x34 -o "$temporary/pngs/images/0009.png"
for view in 0002 0009; do cp "$temporary/pngs/masks/0001.png" "$temporary/pngs/masks/$view.png"; done
printf 'ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n0 0 -3 9 9 9\n' \
    >"$temporary/pngs/cloud.ply"
jq -n '{fl_x: 40, ply_file_path: "cloud.ply", frames: [("0001", "0002", "0009") as $name |
    {file_path: "images/\($name).png", transform_matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}' \
    >"$temporary/pngs/transforms.json"
pngs=$temporary/pngs
ln "$scene/images/0004.jpg" "$temporary/hard.json"
digests() { (cd "$temporary" && find room pngs model -type f ! -name .lock -exec sha256sum {} + | LC_ALL=C sort); }
before=$(digests)

# outputs_that_are_files_of_the_scene_are_refused
photo="is a photo or a mask of the scene; choose another file"
input="is an input of this command; choose another file"
spared() { # PATH MESSAGE ARGUMENTS...: the command fails with one line and leaves every file as it was
    run 1 "${@:3}"
    one_line
    reports "$1: $2"
    check "no_file_has_changed: $1" test "$before" = "$(digests)"
}
train=(train "$scene" -o "$temporary/traced" --iterations 1 "${small[@]}")
spared "$scene/images/0001.jpg" "$photo" "${train[@]}" --trace "$scene/images/0001.jpg"
spared "$temporary/hard.json" "$photo" "${train[@]}" --trace "$temporary/hard.json"
spared "$scene/sparse/0/points3D.bin" "$input" "${train[@]}" --trace "$scene/sparse/0/points3D.bin"
check no_run_was_started test ! -e "$temporary/traced"
refine=(prune "$ply" "$scene" "${small[@]}" --method refine --ratio 0.5)
spared "$scene/images/0002.jpg" "$photo" "${refine[@]}" -o "$temporary/half.ply" --scores "$scene/images/0002.jpg"
ln -s "$scene/images/0005.jpg" "$temporary/linked.ply"
spared "$temporary/linked.ply" "$photo" "${refine[@]}" -o "$temporary/linked.ply"
mkdir "$temporary/ratios"
ln -s "$scene/images/0005.jpg" "$temporary/ratios/prune_0.3.ply"
spared "$temporary/ratios/prune_0.3.ply" "is a photo or a mask of the scene; choose another folder" \
    prune "$ply" "$scene" "${small[@]}" --method refine --ratio 0.2,0.3 -o "$temporary/ratios"
run 1 compress "$model" "$scene" --quiet -o "$scene/sparse/0/cameras.bin" --method fcgs-like # after a warning: it reads no scene
reports "$scene/sparse/0/cameras.bin: $input"
check no_file_has_changed test "$before" = "$(digests)"
spared "$scene/sparse/0/cameras.bin" "$input" compress "$model" "$scene" --quiet -o "$scene/sparse/0/cameras.bin" --method mesongs
spared "$scene/sparse/0/cameras.bin" "$input" profile "$model" "$scene" --quiet --trace "$scene/sparse/0/cameras.bin"
spared "$temporary/linked.ply" "$photo" convert "$ply" "$temporary/linked.ply" "$scene" --filter-unseen
spared "$pngs/cloud.ply" "$input" convert "$ply" "$pngs/cloud.ply" "$pngs" --filter-unseen
for name in images masks; do
    spared "$pngs/$name/0002.png" "$photo" render "$ply" "$pngs" --frames 0-0 --split all --video "$pngs/$name/0002.png"
done
spared "$pngs/transforms.json" "$input" render "$ply" "$pngs" --frames 0-0 --split all --video "$pngs/transforms.json"
mkdir -p "$temporary/o2/images"
ln -s "$pngs/images/0001.png" "$temporary/o2/images/0009.png"
folder="is a photo or a mask of the scene; choose another folder"
spared "$temporary/o2/images/0009.png" "$folder" render "$ply" "$pngs" --split all --format png --aov rgba -o "$temporary/o2"
for source in "$pngs"; do # a data set as the source of cameras only
    run 1 render "$ply" --camera "$source" --format png --aov rgba -o "$pngs"
    one_line
    reports "images/0001.png: $folder"
    run 1 render "$ply" --camera "$source" --video "$pngs/images/0002.png"
    reports "images/0002.png: $photo"
    run 1 render "$ply" --camera "$source" --format png --aov rgba -o "$temporary/o2"
    reports "o2/images/0009.png: $folder"
    check "no_file_has_changed: $source" test "$before" = "$(digests)"
done
mv "$temporary/o2/images/0009.png" "$temporary/o2/images/0009_flip.png"
spared "$temporary/o2/images/0009_flip.png" "$folder" eval "$ply" "$pngs" --split all --save "$temporary/o2"
run 0 render "$ply" "$pngs" --split all --format png --aov rgba -o "$temporary/o2" # writes no such name
check no_file_has_changed test "$before" = "$(digests)"
# Files beside them are free, and so are those that an earlier command wrote.
for repeat in 1 2; do
    run 0 "${train[@]}" --overwrite --trace "$scene/sparse/0/trace.json"
    check "written: $repeat" test -s "$scene/sparse/0/trace.json"
    run 0 compress "$model" "$scene" --quiet -o "$scene/small.sgc" --method fcgs-like
done
rm "$scene/sparse/0/trace.json" "$scene/small.sgc"

# a_frame_and_the_video_need_two_files
cameras=(render "$ply" "$pngs" --split all --aov rgba -o "$temporary/frames")
run 1 "${cameras[@]}" --video "$temporary/frames/images/0001.exr"
one_line
reports "$temporary/frames/images/0001.exr: is a frame and the video; choose another file with --video"
mkdir "$temporary/films"
ln -s "$temporary/frames/images/0002.png" "$temporary/films/film.png"
touch "$temporary/film.png"
mkdir -p "$temporary/frames/images" && touch "$temporary/frames/images/0002.png"
run 1 "${cameras[@]}" --format png --video "$temporary/films/film.png"
reports "frames/images/0002.png: is a frame and the video"
check nothing_was_rendered test ! -s "$temporary/frames/images/0002.png" -a ! -e "$temporary/frames/images/0001.exr"

# parts_of_a_multi_file_model_are_not_replaced
run 0 convert "$ply" "$temporary/lod/lod-meta.json" --lod-levels 2 --quiet
unit=$(cd "$temporary/lod" && find . -mindepth 2 -name meta.json | head -1)
levels() { (cd "$temporary/lod" && find . -type f -exec sha256sum {} + | LC_ALL=C sort); }
kept=$(levels)
for source in "$temporary/lod" "$temporary/lod/lod-meta.json"; do
    for out in "$temporary/lod/$unit" "$temporary/lod/new/meta.json" "$temporary/frames/../lod/one.ply"; do
        run 2 convert "$source" "$out" --filter-opacity 0.5
        one_line
        reports "OUT: $out is an input of this command; choose another file"
        run 2 prune "$source" "$pngs" --method refine --ratio 0.5 -o "$out"
        reports "--output: $out is an input of this command; choose another file"
    done
done
run 2 convert "$ply" "$temporary/lod/meta.json"
one_line
reports "lod/meta.json: $temporary/lod/lod-meta.json is in the same folder, which can hold one model; choose another folder"
check the_levels_are_intact test "$kept" = "$(levels)"
run 0 convert "$ply" "$temporary/sog/meta.json" --quiet
run 2 convert "$ply" "$temporary/sog/lod-meta.json"
reports "sog/lod-meta.json: $temporary/sog/meta.json is in the same folder"
check no_second_model test ! -e "$temporary/sog/lod-meta.json"
run 0 convert "$temporary/lod" "$temporary/lod.ply" --quiet

# report_replaces_reports_only
mkdir "$temporary/ex"
jq -n '{plan: {pipelines: ["3dgs"]}, runs: [{scene: "a", pipeline: "3dgs", variant: "on", seed: 0, folder: "run",
    summary: {gaussians: 10, train_seconds: 1}}]}' >"$temporary/ex/results.json"
cp -r "$model" "$temporary/ex/run"
printf 'iteration,a,b,gaussians\n100,1,2,30\n200,1,2,40\n300,1' >"$temporary/ex/run/train.csv" # the last row is being written
tables=(report "$temporary/ex" --pictures 0 --maps 0)
for repeat in 1 2; do
    run 0 "${tables[@]}"
    check "both_exist: $repeat" test -s "$temporary/ex/report.md" -a -s "$temporary/ex/report.html"
    check "no_warning: $repeat" test ! -s "$temporary/stderr"
done
printf '# My notes\n\nNothing completed.\n' >"$temporary/notes.md"
printf '<!DOCTYPE html>\n<html lang="en">\n<title>mine</title>\n' >"$temporary/page.html"
for option in --markdown --html; do
    for file in "$scene/sparse/0/cameras.bin" "$temporary/linked.ply" "$temporary/notes.md" "$temporary/page.html"; do
        spared "$file" "is not a report and would be replaced; choose another file" "${tables[@]}" "$option" "$file"
    done
done
cp "$temporary/ex/report.md" "$temporary/tables.md"
run 2 "${tables[@]}" --html "$temporary/ex/./report.md"
one_line
reports "the tables and the page are both $temporary/ex/./report.md; choose different files with --markdown and --html"
run 2 "${tables[@]}" --json --markdown "$temporary/ex/report.html"
reports "the tables and the page are both"
check the_tables_are_intact cmp "$temporary/ex/report.md" "$temporary/tables.md"

# damaged_tables_of_a_run_are_reported
page() { sed -n 's/.*<script type="application\/json" id="data">\(.*\)<\/script>$/\1/p' "$temporary/ex/report.html"; }
curves() { check "rows: $1" test "$(page | jq -c '[.runs[0].train[] | .[3]]')" = "$1"; }
curves '[30,40]'
damaged() { # REASON
    run 0 "${tables[@]}"
    reports "warning: $temporary/ex/run/train.csv: $1; its curves are omitted"
    curves '[]'
}
printf 'iteration,a,b,gaussians\n100,1,2,30\n200,1,x,40\n' >"$temporary/ex/run/train.csv"
damaged "line 3: is not 4 numbers"
printf 'iteration,a,b,gaussians\n100,1,2\n' >"$temporary/ex/run/train.csv"
damaged "line 2: is not 4 numbers"
head -c 3000 "$scene/images/0001.jpg" >"$temporary/ex/run/train.csv"
damaged "line 1: is not the header of a table"
: >"$temporary/ex/run/train.csv"
damaged "has no header"
rm "$temporary/ex/run/train.csv"
run 0 "${tables[@]}"
check a_missing_table_is_no_damage test ! -s "$temporary/stderr"
mkdir "$temporary/ex/run/train.csv"
damaged "cannot be read: Is a directory"

# experiment_keeps_foreign_files_and_other_results
plan() { # SEEDS POST
    jq -n --arg room "$scene" --argjson seeds "$1" --argjson post "$2" '{scenes: [{name: "room", path: $room}], pipelines: ["3dgs"],
        variants: [{name: "off", options: {spare: "off"}}], seeds: $seeds, post: $post,
        options: {iterations: 3, downscale: 16, eval: true, threads: 1}}' >"$temporary/plan.json"
}
experiment=(experiment "$temporary/plan.json" -o "$temporary/out" --quiet)
foreign="is not a file of an experiment and would be replaced; move it away, or choose another folder with -o"
post='[{"prune": {"method": "refine", "ratio": 0.5}}]'
plan '[0, 1]' "$post"
for case in 'results.json [1, 2]' 'results.json {"plan": "mine", "runs": []}' 'results.json no JSON' 'results.csv name,score' 'post.csv mail,to'; do
    mkdir "$temporary/out"
    echo "${case#* }" >"$temporary/out/${case%% *}"
    run 1 "${experiment[@]}"
    one_line
    reports "out/${case%% *}: $foreign"
    check "it_stays: $case" grep -qxF -- "${case#* }" "$temporary/out/${case%% *}"
    check "nothing_ran: $case" test ! -e "$temporary/out/runs"
    rm -r "$temporary/out"
done
run 0 "${experiment[@]}"
check there_are_points test "$(wc -l <"$temporary/out/post.csv")" = 3
plan '[1, 2]' "$post"
cp "$temporary/out/results.json" "$temporary/results.json"
run 1 "${experiment[@]}"
one_line
reports "out: holds results of another plan, with run runs/room/3dgs/off/seed_0; choose another folder with -o, add this run to the plan, or remove results.json"
run 1 "${experiment[@]}" --check
check the_results_stay cmp "$temporary/results.json" "$temporary/out/results.json"
check no_run_was_added test ! -e "$temporary/out/runs/room/3dgs/off/seed_2"
plan '[0, 1, 2]' "$post"
run 0 "${experiment[@]}"
json "$temporary/out/results.json" '[.runs[].seed] == [0, 1, 2]'
check points_of_all_runs test "$(wc -l <"$temporary/out/post.csv")" = 4
plan '[0, 1, 2]' '[]'
run 0 "${experiment[@]}"
check no_stale_points test ! -e "$temporary/out/post.csv"

# a_folder_that_moves_during_the_training_is_a_whole_run_again
moving=(--downscale 16 --iterations 1500 --spare off --max-gaussians 3000 --seed 1 --threads 1)
wait_for_row() { # OUT ITERATION PID
    until grep -q "^$2," "$1/train.csv" 2>/dev/null; do
        kill -0 "$3" 2>/dev/null || return 1
        sleep 0.05
    done
}
changes=(emptied)
if is_long; then changes+=(moved removed); fi
for change in "${changes[@]}"; do
    out=$temporary/$change
    "$program" train "$scene" -o "$out" "${moving[@]}" --save-at 150 >"$temporary/stdout" 2>"$temporary/stderr" &
    training=$!
    last_command="train with $out $change"
    check the_run_has_begun wait_for_row "$out" 100 $training
    cp "$out/config.json" "$out/cameras.json" "$out/input.ply" "$temporary/"
    case $change in
    moved) mv "$out" "$temporary/elsewhere" ;;
    removed) rm -r "$out" ;;
    emptied) rm -r "${out:?}"/* ;; # but .lock
    esac
    check the_run_goes_on wait_for_row "$out" 200 $training
    if kill -TERM $training; then :; fi
    status=0; wait $training || status=$?
    check stopped_by_the_signal test $status = 143
    check one_warning test "$(grep -c "warning: $out: was moved or removed during the training; it is created again" "$temporary/stderr")" = 1
    for name in config.json cameras.json input.ply; do check "$name is there again" cmp "$temporary/$name" "$out/$name"; done
    check the_folder_is_locked_again test -e "$out/.lock"
    check the_saved_model_is_there test -s "$out/point_cloud/iteration_150/point_cloud.ply"
    run 0 eval "$out" "$scene" --test-images 0001.jpg --quiet
done
if is_long; then
    run 0 train "$scene" -o "$temporary/moved" --resume --quiet
    run 0 train "$scene" -o "$temporary/straight" "${moving[@]}" --quiet
    check the_resumed_run_has_the_same_bits test "$(jq .model_hash "$temporary/moved/summary.json")" = "$(jq .model_hash "$temporary/straight/summary.json")"
fi

# a_run_in_the_place_of_another_is_not_written_to
moving[3]=300
out=$temporary/place
cp -r "$model" "$temporary/other"
"$program" train "$scene" -o "$out" "${moving[@]}" --save-at 150 >"$temporary/stdout" 2>"$temporary/stderr" &
training=$!
last_command="train with $out replaced"
check the_run_has_begun wait_for_row "$out" 100 $training
mv "$out" "$temporary/displaced"
mv "$temporary/other" "$out"
whole=$(find "$out" -type f -exec sha256sum {} + | LC_ALL=C sort)
status=0; wait $training || status=$?
check it_fails test $status = 1
reports "$out: was moved during the training, and another run is in its place"
check the_other_run_is_intact test "$whole" = "$(find "$out" -type f -exec sha256sum {} + | LC_ALL=C sort)"

finish
