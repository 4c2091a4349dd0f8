#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# `sparegs reconstruct` with a replacement for COLMAP that records its arguments and writes the same files: stages and
# arguments, names with blanks and quotes, resuming, choice of the largest model, and failures. test_reconstruct_long.sh
# runs COLMAP itself.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

bin=$temporary/bin
mkdir -p "$bin"
cat >"$bin/colmap" <<'STANDIN'
#!/usr/bin/env bash
set -euo pipefail
command=$1
if [ "${2:-}" = --help ]; then
    case $command in
    feature_extractor) echo "  --${FEATURE:-Sift}Extraction.use_gpu arg (=1)" ;;
    *) echo "  --${FEATURE:-Sift}Matching.use_gpu arg (=1)" ;;
    esac
    exit 0
fi
printf '%s\n' "--- $QT_QPA_PLATFORM" "$@" >>"$CALLS"
value() { while [ "$1" != "$2" ]; do set -- "$1" "${@:3}"; done; echo "$3"; }
case $command in
feature_extractor) echo "Processed file [1/3]"; echo x >"$(value --database_path "$@")" ;;
mapper)
    out=$(value --output_path "$@")
    [ -z "${APART:-}" ] || { printf '  => No good initial image pair found.\n\nElapsed time: 0.370 [minutes]\nERROR: failed to create sparse model\n'; exit 1; }
    [ -z "${FAIL:-}" ] || { echo "loading"; echo "ERROR: the database is empty" >&2; exit 7; }
    [ -z "${SLOW:-}" ] || { echo $$ >"$CALLS.pid"; exec sleep 60; }
    [ -z "${NONE:-}" ] || exit 0
    for k in 0 1; do
        mkdir -p "$out/$k"
        cp "$ROOM"/sparse/0/*.bin "$out/$k/"
    done
    printf '\2' | dd of="$out/0/images.bin" bs=1 conv=notrunc status=none ;; # a smaller model comes first
model_analyzer) echo "Points: 321"; echo "Mean reprojection error: 0.4321px" ;;
esac
STANDIN
chmod +x "$bin/colmap"
export CALLS=$temporary/calls ROOM=$room
photos="$temporary/my photos; \$(touch hacked) 'x'"
cp -r "$room/images" "$photos"
scene=$temporary/scene
with_standin() { PATH=$bin:$PATH "$@"; }
calls() { check "calls_hold: $1" grep -qxF -- "$1" "$CALLS"; }

# stages_run_in_order_without_display_gpu_or_shell
with_standin run 0 reconstruct "$photos" -o "$scene" --threads 1
for word in "--- offscreen" feature_extractor exhaustive_matcher mapper model_analyzer "$(realpath "$photos")" --SiftExtraction.use_gpu \
    --SiftMatching.use_gpu OPENCV; do
    calls "$word"
done
check nothing_was_run_by_a_shell test ! -e hacked
prints "35 of 35 photos registered, 321 points, mean reprojection error 0.432 px"
check the_largest_model_is_kept cmp "$scene/sparse/0/images.bin" "$room/sparse/0/images.bin"
check one_camera_for_photos_of_one_size sh -c "grep -A1 single_camera '$CALLS' | grep -qx 1"
run 0 info "$scene" --json
json "$temporary/stdout" '.views == 35 and .images_missing == 0'

# finished_stages_are_not_repeated
: >"$CALLS"
with_standin run 0 reconstruct "$photos" -o "$scene" --json
check only_the_analysis_ran test "$(grep -c '^---' "$CALLS")" = 1
json "$temporary/stdout" '.registered == 35 and .photos == 35 and .models == 2 and .mean_reprojection_error == 0.4321'
: >"$CALLS"
with_standin run 0 reconstruct "$photos" -o "$scene" --matcher sequential
calls sequential_matcher
calls feature_extractor
reports "the photos or the options have changed, so that all stages start again; the earlier features and matches are in $scene/colmap/database.previous.db"
check the_earlier_database_is_kept test -s "$scene/colmap/database.previous.db"
: >"$CALLS"
with_standin run 0 reconstruct "$photos" -o "$temporary/effective" --quiet
with_standin run 0 reconstruct "$photos" -o "$temporary/effective" --matcher exhaustive --quiet
check the_effective_matcher_counts test "$(grep -cx exhaustive_matcher "$CALLS")" = 1

# options_have_the_names_of_the_installed_version
: >"$CALLS"
FEATURE=Feature with_standin run 0 reconstruct "$photos" -o "$temporary/renamed" --threads 1
for stage in Extraction Matching; do
    check "the_gpu_is_off: $stage" sh -c "grep -xA1 -- --Feature$stage.use_gpu '$CALLS' | grep -qx 0"
    check "the_threads_are_given: $stage" sh -c "grep -xA1 -- --Feature$stage.num_threads '$CALLS' | grep -qx 1"
done
check no_earlier_name_is_given sh -c "! grep -q -- --Sift '$CALLS'"

# files_of_the_user_are_refused_before_the_work
foreign() { # MESSAGE SCENE
    : >"$CALLS"
    with_standin run 1 reconstruct "$photos" -o "$2" --quiet
    one_line
    reports "$1; move it away, or choose another folder with -o"
    check nothing_was_run test ! -s "$CALLS"
}
mkdir -p "$temporary/own/sparse/0" "$temporary/file"
echo mine >"$temporary/own/sparse/0/cameras.txt"
foreign "own/sparse/0/cameras.txt: was not written by reconstruct" "$temporary/own"
check the_scene_is_as_before test "$(cd "$temporary/own" && find . -type f)" = ./sparse/0/cameras.txt
echo mine >"$temporary/file/images"
mkdir -p "$temporary/studio/colmap"
echo mine >"$temporary/studio/colmap/database.db"
foreign "studio/colmap/database.db: was not written by reconstruct" "$temporary/studio"
check the_database_is_kept grep -qx mine "$temporary/studio/colmap/database.db"
foreign "file/images: is not a link to photos" "$temporary/file"
check the_file_is_kept grep -qx mine "$temporary/file/images"
echo >>"$scene/sparse/0/images.bin"
foreign "scene/sparse/0: was not written by reconstruct, or was changed later" "$scene"
rm -r "$scene/sparse/0"
# A model that cannot be written leaves the scene without it and without other files; a link is replaced.
ln -sfn "$temporary/own" "$scene/images"
last_command="sparegs reconstruct with a limit"
check a_full_disk_is_an_error bash -c 'trap "" XFSZ; ulimit -f 100; status=0
    PATH=$0:$PATH "$@" 2>/dev/null || status=$?; test $status = 1' "$bin" "$program" reconstruct "$photos" -o "$scene" --matcher sequential --quiet
check nothing_is_left test -z "$(ls -A "$scene/sparse")"
with_standin run 0 reconstruct "$photos" -o "$scene" --matcher sequential --quiet
check the_model_is_there cmp "$scene/sparse/0/points3D.bin" "$room/sparse/0/points3D.bin"
check no_other_model_is_there test "$(ls -A "$scene/sparse")" = 0
check the_link_is_that_of_the_photos test "$scene/images" -ef "$photos"

# only_photos_are_given_to_colmap (not masks next to them, hidden files, and raw files next to their JPEG)
mkdir "$temporary/mixed"
cp "$photos/0001.jpg" "$temporary/mixed/a b.JPG"
cp "$photos/0002.jpg" "$temporary/mixed/b.jpg"
cp "$photos/0003.jpg" "$temporary/mixed/._b.jpg"
for mask in b_mask dynamic_mask_b; do cp "$photos/0003.jpg" "$temporary/mixed/$mask.png"; done
cp "$photos/0004.jpg" "$temporary/mixed/"$'two\nlines.jpg'
cp "$photos/0005.jpg" "$temporary/mixed/y.jpe"
cp "$photos/0006.jpg" "$temporary/mixed/z.jfif"
for name in b.DNG c.HEIC d.heic e.psd f.hdr g.dpx h.jxl; do echo raw >"$temporary/mixed/$name"; done
: >"$CALLS"
with_standin run 0 reconstruct "$temporary/mixed" -o "$temporary/mixed_scene"
check the_list_is_given grep -qxF "$temporary/mixed_scene/colmap/photos.txt" "$CALLS"
check the_list_has_the_photos test "$(cat "$temporary/mixed_scene/colmap/photos.txt")" = $'a b.JPG\nb.jpg\ny.jpe\nz.jfif'
reports "lines.jpg: the name contains a line break; COLMAP will not use it"
reports "mixed: 6 photo(s) in other formats are not used, first 'c.HEIC'; convert them to JPEG, PNG or TIFF"

# links_to_folders_are_not_followed
cp -r "$photos" "$temporary/linked"
mkdir "$temporary/linked/.kept"
mv "$temporary/linked/0001.jpg" "$temporary/linked/.kept"
ln -s .kept/0001.jpg "$temporary/linked/0001.jpg"
for name in a b; do ln -s . "$temporary/linked/$name"; done
with_standin run 0 reconstruct "$temporary/linked" -o "$temporary/unlinked" --json
json "$temporary/stdout" '.photos == 35'
check one_warning_per_link test "$(grep -c "is a link to a folder, which COLMAP does not follow" "$temporary/stderr")" = 2

# links_to_photos_elsewhere_are_refused_before_colmap_runs (training does not read them)
mv "$temporary/linked/.kept/0001.jpg" "$temporary"
ln -sfn ../0001.jpg "$temporary/linked/0001.jpg"
: >"$CALLS"
with_standin run 1 reconstruct "$temporary/linked" -o "$temporary/elsewhere" --quiet
reports "linked/0001.jpg: symbolic link points outside the folder of the photos, to "
one_line
check colmap_did_not_run test ! -s "$CALLS"
with_standin run 0 reconstruct "$temporary/linked" -o "$temporary" --quiet # training reads links within SCENE

# a_changed_photo_is_noticed (also if its name is not UTF-8)
for name in a.jpg $'\xe9.jpg'; do
    cp -r "$photos" "$temporary/changed"
    cp "$photos/0001.jpg" "$temporary/changed/$name"
    with_standin run 0 reconstruct "$temporary/changed" -o "$temporary/changed_scene" --quiet
    cp "$photos/0002.jpg" "$temporary/changed/$name"
    : >"$CALLS"
    with_standin run 0 reconstruct "$temporary/changed" -o "$temporary/changed_scene" --quiet
    calls feature_extractor
    rm -r "$temporary/changed" "$temporary/changed_scene"
done

# a_failure_reports_colmaps_last_lines_and_is_resumed
FAIL=1 with_standin run 1 reconstruct "$photos" -o "$temporary/second" --quiet
one_line
reports "second/colmap/mapper.log: colmap mapper failed with status 7: loading | ERROR: the database is empty"
: >"$CALLS"
with_standin run 0 reconstruct "$photos" -o "$temporary/second" --quiet
check features_and_matches_were_kept test "$(grep -c '^---' "$CALLS")" = 2

# photos_without_overlap_are_explained (the last lines of COLMAP 3.8)
APART=1 with_standin run 1 reconstruct "$photos" -o "$temporary/apart" --quiet
one_line
reports "=> No good initial image pair found. | Elapsed time: 0.370 [minutes] | ERROR: failed to create sparse model; take photos with more overlap, or try --matcher exhaustive or another --camera-model"

# a_damaged_state_is_an_error_that_keeps_features_and_matches
state=$temporary/second/colmap/state.json
cp "$state" "$temporary/state"
damaged() { # MESSAGE
    with_standin run 1 reconstruct "$photos" -o "$temporary/second" --quiet
    one_line
    reports "second/colmap/state.json: $1; repair it, or move its folder away to start again"
    check the_database_is_kept test -s "$temporary/second/colmap/database.db"
}
head -n 3 "$temporary/state" >"$state"
cp "$state" "$temporary/damaged"
damaged "line 4: ']' expected near end of file"
check the_state_is_kept cmp "$state" "$temporary/damaged"
jq 'del(.stages)' "$temporary/state" >"$state"
damaged '"made_from" and "stages" must be lists'
echo '[]' >"$state"
damaged '"made_from" and "stages" must be lists'
cp "$temporary/state" "$state"
: >"$CALLS"
with_standin run 0 reconstruct "$photos" -o "$temporary/second" --quiet
check all_stages_were_kept test "$(grep -c '^---' "$CALLS")" = 1

# stages_whose_files_were_removed_are_repeated
repeated() { # STAGES
    : >"$CALLS"
    with_standin run 0 reconstruct "$photos" -o "$temporary/second" --quiet
    check "stages and the analysis: $1" test "$(grep -c '^---' "$CALLS")" = $(($1 + 1))
}
rm -r "$temporary/second/colmap/models"
repeated 1
rm "$temporary/second/colmap/database.db"
repeated 0
rm -r "$temporary/second/colmap/models"
repeated 3
repeated 0

# error_messages
NONE=1 with_standin run 1 reconstruct "$photos" -o "$temporary/third" --quiet
one_line
reports "COLMAP registered none of the 35 photos"
run 1 reconstruct "$photos" -o "$temporary/fourth" --colmap no-such-colmap --quiet
one_line
reports "no-such-colmap: program not found; install COLMAP"
mkdir "$temporary/empty"
with_standin run 1 reconstruct "$temporary/empty" -o "$temporary/fifth"
one_line
reports "contains 0 photo(s)"
with_standin run 1 reconstruct "$temporary/absent" -o "$temporary/fifth"
one_line
run 2 reconstruct "$photos"
reports "-o SCENE"
run 2 reconstruct "$photos" -o "$temporary/x" --camera-model OPENCVV
reports "not a COLMAP camera model"

# a_signal_ends_colmap_too, also one that only the parent gets; a second run on the same scene is refused until then
starts() { # a run on $temporary/sixth whose mapper sleeps
    rm -f "$CALLS.pid"
    SLOW=1 PATH=$bin:$PATH "$program" reconstruct "$photos" -o "$temporary/sixth" --quiet 2>"$temporary/stderr" &
    child=$!
    for _ in $(seq 100); do
        [ -s "$CALLS.pid" ] && break
        sleep 0.1
    done
    check colmap_runs kill -0 "$(cat "$CALLS.pid")"
}
ends() { # SIGNAL STATUS
    kill "-$1" "$child"
    status=0
    wait "$child" 2>/dev/null || status=$?
    last_command="reconstruct, then $1"
    check "stopped_by_the_signal: $1" test "$status" = "$2"
    for _ in $(seq 50); do
        kill -0 "$(cat "$CALLS.pid")" 2>/dev/null || break
        sleep 0.1
    done
    check "colmap_has_ended: $1" bash -c '! kill -0 "$0"' "$(cat "$CALLS.pid")"
}
starts
cp "$temporary/sixth/colmap/state.json" "$temporary/state"
: >"$CALLS"
with_standin run 1 reconstruct "$photos" -o "$temporary/sixth" --matcher sequential --quiet
one_line
reports "sixth: in use by another run; wait until it ends or choose another folder"
check nothing_was_run test ! -s "$CALLS"
check the_state_is_that_of_the_first_run cmp "$temporary/sixth/colmap/state.json" "$temporary/state"
ends TERM 143
starts
ends KILL 137
with_standin run 0 reconstruct "$photos" -o "$temporary/sixth" --quiet
finish
