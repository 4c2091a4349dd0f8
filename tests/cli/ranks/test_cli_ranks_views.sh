#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Views spread over several ranks under mpirun: `render --video` gives the frames of one process in their order; an encoder,
# a disk or a rank that fails, and a signal to one rank, end all ranks. Skipped without mpirun or without a plug-in.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"

find_mpirun
if is_sanitized; then
    echo "skipped: the MPI library is not built with a sanitizer"
    exit 77
fi
# shellcheck disable=SC2016 # run by each rank
rank='"${OMPI_COMM_WORLD_RANK:-${PMI_RANK:-0}}"'
[ "${#launcher[@]}" = 1 ] || launcher+=(--mca btl "tcp,self") # shared memory is a file, which has a limit below

ranks_seconds=120
# on_rank NUMBER COMMAND: the program executes a shell command first, on this rank.
on_rank() {
    printf '#!/usr/bin/env bash\nif [ %s = %s ]; then %s; fi\nexec "%s" "$@"\n' "$rank" "$1" "$2" "$SPAREGS_PROGRAM" >"$temporary/first"
    chmod +x "$temporary/first"
    program=$temporary/first
}
on_all_ranks() { program=$SPAREGS_PROGRAM; }
no_video() {
    check no_video test ! -e "$1"
    check no_temporary_file_is_left test -z "$(find "$temporary" -name '*.mp4.tmp.*')"
}
count_of() { find "$1" -name "$2" | wc -l; }

model=$temporary/model
run 0 train "$room" -o "$model" --downscale 4 --eval --iterations 10 --threads 1 --quiet

# ---- The frames of one process ----
# A replacement for ffmpeg keeps the frames. After ENCODES bytes it fails.
mkdir "$temporary/bin" "$temporary/empty"
cat >"$temporary/bin/ffmpeg" <<'END'
#!/usr/bin/env bash
out=${*: -1}
out=${out#file:}
if [ -z "${ENCODES:-}" ]; then exec cat >"$out"; fi
head -c "$ENCODES" >"$out"
echo 'first word' >&2
echo 'the encoder is broken' >&2
exit "${ENCODER_EXITS:-1}"
END
chmod +x "$temporary/bin/ffmpeg"
real_path=$PATH
export PATH=$temporary/bin:$PATH
path=("$model" "$room" --orbit 5 --size 60x34)
run 0 render "${path[@]}" --video "$temporary/one.mp4"
check five_frames test "$(stat -c %s "$temporary/one.mp4")" = $((5 * 60 * 34 * 3))
ranks 0 2 render "$model" "$room" --view 0001 --size 32x18 -o "$temporary/"$'odd\xe9' --quiet
prints "(a path that is not UTF-8)"
counts=(3)
if is_long; then counts+=(2 7); fi
for count in "${counts[@]}"; do
    ranks 0 "$count" render "${path[@]}" --video "$temporary/ranks$count.mp4"
    check the_same_frames cmp "$temporary/one.mp4" "$temporary/ranks$count.mp4"
    check one_path test "$(cat "$temporary/stdout")" = "$temporary/ranks$count.mp4"
    reports "5 view(s) on $count ranks"
    no_video "$temporary/none.mp4"
done
ranks 0 2 render "$model" "$room" --orbit 1 --size 60x34 --video "$temporary/frame.mp4" --threads 1
check a_single_frame test "$(stat -c %s "$temporary/frame.mp4")" = $((60 * 34 * 3))
if is_long && installed mpirun.mpich && [ -e "$SPAREGS_BUILD/ranks-mpich.so" ]; then
    openmpi=("${launcher[@]}")
    launcher=(mpirun.mpich)
    ranks 0 3 render "${path[@]}" --video "$temporary/mpich.mp4"
    check the_same_frames cmp "$temporary/one.mp4" "$temporary/mpich.mp4"
    launcher=("${openmpi[@]}")
fi

# Video and images of one command: the same files, listed in the same order.
numbers=(5)
if is_long; then numbers+=(1); fi
for views in "${numbers[@]}"; do
    images=("$model" "$room" --orbit "$views" --size 60x34 --format png --aov "rgba,depth" --video "$temporary/film.mp4" --json --quiet)
    run 0 render "${images[@]}" -o "$temporary/images$views"
    cp "$temporary/stdout" "$temporary/listed"
    cp "$temporary/film.mp4" "$temporary/film_of_one.mp4"
    cp -r "$temporary/images$views" "$temporary/images_of_one$views"
    ranks 0 3 render "${images[@]}" -o "$temporary/images$views"
    check the_same_files_in_json cmp "$temporary/listed" "$temporary/stdout"
    check the_same_frames cmp "$temporary/film_of_one.mp4" "$temporary/film.mp4"
    check the_same_images diff -r "$temporary/images_of_one$views" "$temporary/images$views"
done

# Views whose files exist are skipped; the ranks share the others.
images=("$model" "$room" --orbit 5 --size 60x34 --format png --aov "rgba,depth" --quiet)
rm "$temporary/images5/orbit_00001.png" "$temporary/images5"/orbit_00003.*png
ranks 0 3 render "${images[@]}" --skip-existing --json -o "$temporary/images5"
json "$temporary/stdout" '.skipped == 3 and ([.files[] | sub(".*/"; "")] == ["cameras.json"] + [(1, 3) | "orbit_0000\(.)" |
    (. + ".png", . + ".depth.png")])'
check the_same_images diff -r "$temporary/images_of_one5" "$temporary/images5"
ranks 0 2 render "${images[@]}" --skip-existing --json -o "$temporary/images5"
json "$temporary/stdout" '.skipped == 5 and (.files | length) == 1'

# ---- Failures end all ranks in the same round ----
long=("$model" "$room" --orbit 60 --size 168x96 --quiet)
export ENCODES=100000
exits=(0)
if is_long; then exits+=(1); fi
for ENCODER_EXITS in "${exits[@]}"; do
    export ENCODER_EXITS
    rm -rf "$temporary/some"
    ranks 1 3 render "${long[@]}" --video "$temporary/bad.mp4" -o "$temporary/some" --format png --aov rgba
    one_voice
    reports "bad.mp4: ffmpeg failed: the encoder is broken"
    no_video "$temporary/bad.mp4"
    written=$(count_of "$temporary/some" '*.png')
    check the_same_round test "$written" -lt 60 -a $((written % 3)) = 2 # rank 0 stopped before its own image
done
unset ENCODES ENCODER_EXITS
on_rank 0 'ulimit -f 100'
ranks 1 2 render "${long[@]}" --video "$temporary/bad.mp4"
one_voice
reports "bad.mp4: ffmpeg failed: cat: "
no_video "$temporary/bad.mp4"
on_rank 1 'ulimit -f 10'
rm -rf "$temporary/some"
ranks 1 3 render "${long[@]}" --video "$temporary/bad.mp4" -o "$temporary/some" --aov rgba
one_voice
reports "sparegs: rank 1 ("
reports "orbit_00001.exr: cannot be written: File too large"
no_video "$temporary/bad.mp4"
check one_round test "$(count_of "$temporary/some" '*.exr')" = 2
rm -rf "$temporary/some"
echo "an earlier video" >"$temporary/kept.mp4" # is replaced when the images of the last round are written
ranks 1 3 render "$model" "$room" --orbit 3 --size 168x96 --quiet --video "$temporary/kept.mp4" -o "$temporary/some" --aov rgba
one_voice
reports "orbit_00001.exr: cannot be written: File too large"
check the_earlier_video grep -qx "an earlier video" "$temporary/kept.mp4"
check other_images test "$(count_of "$temporary/some" '*.exr')" = 2
on_rank 0 "PATH=$temporary/empty"
sed -i '1s|.*|#!/bin/bash|' "$program"
ranks 1 2 render "${path[@]}" --video "$temporary/bad.mp4" --quiet
one_voice
reports "ffmpeg, which is not installed"
on_rank 1 "PATH=$temporary/empty" # only rank 0 encodes
sed -i '1s|.*|#!/bin/bash|' "$program"
ranks 0 2 render "${path[@]}" --video "$temporary/encoded.mp4" --quiet
check the_same_frames cmp "$temporary/one.mp4" "$temporary/encoded.mp4"
on_all_ranks

# Without a video, the ranks learn of a failure after a few of their views.
on_rank 1 'ulimit -f 10'
rm -rf "$temporary/some"
ranks 1 3 render "${long[@]}" -o "$temporary/some" --aov rgba
one_voice
reports "orbit_00001.exr: cannot be written: File too large"
check some_views test "$(count_of "$temporary/some" '*.exr')" -lt 40
rm -rf "$temporary/some"
ranks 1 3 eval "$model" "$room" --downscale 4 --split all --save "$temporary/some" --quiet
one_voice
reports "cannot be written"
check some_views test "$(count_of "$temporary/some" '*_flip.png')" -lt "$(count_of "$room/images" '*.jpg')"
on_all_ranks

# ---- Ranks that differ from rank 0 are refused ----
# differs COMMAND TEXT ARGUMENT...: rank 1 executes a shell command, which changes its arguments; rank 0 names the difference.
differs() {
    local command=$1 text=$2
    shift 2
    on_rank 1 "$command"
    ranks 1 2 "$@" --quiet
    one_voice
    reports "sparegs: rank 1 ("
    reports "$text"
    check nothing_is_printed test ! -s "$temporary/stdout"
    check nothing_is_written test -z "$(find "$temporary" -path "$temporary/refused*" -type f)"
    on_all_ranks
}
# differs_too ARGUMENT...: as differs, in test_cli_parts_long only.
differs_too() { ! is_long || differs "$@"; }
other=$temporary/other
run 0 train "$room" -o "$other" --downscale 4 --eval --iterations 2 --threads 1 --quiet
cp -r "$room" "$temporary/scene"
held_out=$("$program" eval "$model" "$room" --quiet --json | jq -r '.images[-1].name')
cp "$(find "$room/images" -name '*.jpg' | sort | sed -n 2p)" "$temporary/scene/images/$held_out"
plan() {
    jq -n --arg room "$room" "{title: \"ranks\", scenes: [{name: \"room\", path: \$room, options: {downscale: 8}}], pipelines: [\"3dgs\"],
        variants: [{name: \"on\"}], seeds: [0, 1], options: {iterations: $1, eval: true, threads: 1}}" >"$temporary/plan$1.json"
}
plan 10
plan 11
differs "set -- eval $other \"\${@:3}\"" "model is " eval "$model" "$room"
if is_long; then
    run 0 train "$room" -o "$temporary/exposed" --downscale 4 --eval --iterations 20 --threads 1 --exposure --quiet
    cp -r "$temporary/exposed" "$temporary/unexposed"
    rm "$temporary/unexposed/exposure.json"
fi
differs_too "set -- eval $temporary/unexposed \"\${@:3}\"" "has 'exposure: none', but rank 0 has 'exposure." eval "$temporary/exposed" "$room"
differs "set -- eval $model $temporary/scene \"\${@:4}\"" "photo $held_out is " eval "$model" "$room"
# Other training images, but the held-out images of the run: one less, or another one is missing.
for missing in 0002 0010; do
    cp -r "$room" "$temporary/without$missing"
    rm "$temporary/without$missing/images/$missing.jpg"
done
differs_too "set -- eval $model $temporary/without0002 \"\${@:4}\"" "number of images is 34, but 35 on rank 0" eval "$model" "$room"
on_rank 1 "set -- eval $model $temporary/without0002 \"\${@:4}\""
ranks 1 2 eval "$model" "$temporary/without0010" --quiet
reports "index of 0009.jpg is 7, but 8 on rank 0"
check nothing_is_printed test ! -s "$temporary/stdout"
differs_too "set -- \"\$@\" --split all" "--split is all, but test on rank 0" eval "$model" "$room"
differs_too "set -- \"\$@\" --isa baseline --compact-box 0.5" " on rank 0" eval "$model" "$room"
differs_too "set -- render $other \"\${@:3}\"" "model is " render "$model" "$room" -o "$temporary/refused"
differs_too "set -- render $temporary/missing \"\${@:3}\"" "missing: no such model" render "$model" "$room" -o "$temporary/refused"
differs "set -- render $model $temporary/missing \"\${@:4}\"" "missing: no such folder" render "$model" "$room" -o "$temporary/refused"
differs_too "set -- \"\$@\" --background 1,0,0.5" "--background is 1,0,0.5, but 0,0,0 on rank 0" render "$model" "$room" -o "$temporary/refused" --format png
differs_too "set -- \"\$@\" --aov depth,normal" "--aov is depth,normal, but rgba on rank 0" render "$model" "$room" -o "$temporary/refused" --aov rgba
differs_too "set -- \"\$@\" --size 64x34" "--size is 64x34, but 60x34 on rank 0" render "${path[@]}" --video "$temporary/refused.mp4"
differs "set -- \"\$@\" --orbit 6" "--orbit is 6, but 5 on rank 0" render "${path[@]}" --video "$temporary/refused.mp4"
differs_too "set -- experiment $temporary/plan11.json \"\${@:3}\"" "seed_0, plan.options.iterations is 11, but 10 on rank 0" \
    experiment "$temporary/plan10.json" -o "$temporary/refused"
differs_too "set -- experiment $temporary/missing.json \"\${@:3}\"" "missing.json" experiment "$temporary/plan10.json" -o "$temporary/refused"
on_rank 1 'set -- "$@" --threads 1 --quiet' # no result depends on these
ranks 0 2 eval "$model" "$room"
check five_images test "$(wc -l <"$temporary/stdout")" -gt 3
on_rank 1 'set -- "$@" --nonsense'
last_command="mpirun -n 2 sparegs eval, with --nonsense on rank 1"
status=0 # 1 of rank 0 or 2 of rank 1, whichever ends first
timeout 120 "${launcher[@]}" -n 2 "$program" eval "$model" "$room" --quiet >"$temporary/stdout" 2>"$temporary/stderr" || status=$?
check a_failure test "$status" = 1 -o "$status" = 2
one_voice
reports "unknown option '--nonsense'"
on_all_ranks

# ---- One voice, also where no command runs ----
ranks 2 2 evall "$model" "$room"
one_voice
reports "unknown command 'evall'"
ranks 0 3 --version
check one_version test "$(grep -c '^sparegs ' "$temporary/stdout")" = 1
ranks 0 3 help render
check one_usage test "$(grep -c '^Usage' "$temporary/stdout")" = 1
touch "$temporary/file"
ranks 1 2 eval "$model" "$room" --save "$temporary/file" --quiet
one_voice
reports "file: is not a folder"
check before_the_table test ! -s "$temporary/stdout"

# ---- A signal to one rank ----
# stop RANK FILE ARGUMENT...: sends a signal to a rank when the file exists; all ranks end with its status.
signal=TERM
stop() {
    local number=$1 file=$2 status=0 job
    shift 2
    last_command="kill -$signal of rank $number: mpirun -n ${stopped_ranks:-3} sparegs $*"
    rm -f "$temporary"/ended.*
    # The other ranks record their status.
    on_rank "$number" "echo \$\$ >$temporary/pid; else trap '' TERM; $SPAREGS_PROGRAM \"\$@\" && status=0 || status=\$?; echo \$status >$temporary/ended.$rank; exit \$status"
    timeout 120 "${launcher[@]}" -n "${stopped_ranks:-3}" "$program" "$@" >"$temporary/stdout" 2>"$temporary/stderr" &
    job=$!
    for ((i = 0; i < 600; ++i)); do
        # shellcheck disable=SC2086 # a pattern
        if compgen -G $file >/dev/null; then break; fi
        sleep 0.1
    done
    kill "-$signal" "$(cat "$temporary/pid")"
    wait "$job" || status=$?
    check status_of_a_signal test "$status" -eq $((128 + $(kill -l "$signal")))
    check no_other_status test "$(cat "$temporary"/ended.* | sort -u)" = "$status"
    on_all_ranks
}
# While it loads the scene: the signal is sent as soon as the program catches it.
# shellcheck disable=SC2016 # run by each rank
on_rank 1 '(until (($(sed -n "s/SigCgt:\t*/0x/p" /proc/$$/status) >> 14 & 1)); do :; done; kill -TERM $$) & disown'
ranks 143 3 eval "$model" "$room" --split all --threads 1 --quiet
check no_empty_message bash -c "! grep -qE '^sparegs: .*: *$' '$temporary/stderr'"
on_all_ranks
signalled=(2)
if is_long; then signalled+=(0); fi
for number in "${signalled[@]}"; do
    stop $number "$temporary/stopped.mp4.tmp.*.mp4" render "$model" "$room" --orbit 5000 --size 168x96 --video "$temporary/stopped.mp4"
    reports "stopped.mp4: stopped; no video was written"
    check one_note test "$(grep -c 'no video was written' "$temporary/stderr")" = 1
    no_video "$temporary/stopped.mp4"
    rm -rf "$temporary/cut"
    stop $number "$temporary/cut/*3.png" render "$model" "$room" --orbit 5000 --size 168x96 -o "$temporary/cut" --format png --aov rgba
    check the_files_are_listed diff <(find "$temporary/cut" -type f | sort) <(sort "$temporary/stdout")
    signal=INT
done
signal=HUP
stopped_ranks=5 # each has fewer views than the ranks draw between two meetings
stop 1 "$temporary/scored/*_flip.png" eval "$model" "$room" --downscale 1 --split all --threads 1 --save "$temporary/scored"
check not_all_images test "$(count_of "$temporary/scored" '*_flip.png')" -lt "$(count_of "$room/images" '*.jpg')"
check no_mean test "$(grep -cE '^(mean|PSNR)' "$temporary/stdout")" = 0
stopped_ranks=3
signal=TERM
stop 1 "$temporary/trained/train.csv" train "$room" --downscale 4 --iterations 100000 --threads 1 --quiet -o "$temporary/trained"
json "$temporary/trained/summary.json" '.stop_reason == "signal"'

# The runs of other ranks are complete; a rank that is signalled leaves its own.
plan 150
stopped_ranks=2
stop 1 "$temporary/stopped/runs/*/*/*/seed_1/train.csv" experiment "$temporary/plan150.json" -o "$temporary/stopped"
json "$temporary/stopped/results.json" '[.runs[].seed] == [0]'
on_rank 1 "set -- experiment $temporary/plan10.json -o $temporary/elsewhere" # another path
ranks 1 2 experiment "$temporary/plan10.json" -o "$temporary/apart" --quiet
reports "--output is $temporary/elsewhere, but $temporary/apart on rank 0"
check no_run_started test ! -e "$temporary/apart"
mkdir "$temporary/here" "$temporary/there"
on_rank 1 "cd $temporary/there" # the same path, another folder
cd "$temporary/here"
ranks 1 2 experiment "$temporary/plan10.json" -o apart --quiet
cd "$OLDPWD"
one_voice
reports "apart: not the same folder as on rank 0"
check no_run_started test -z "$(find "$temporary/here" "$temporary/there" -type f)"
on_all_ranks

# ---- The real encoder, where it is: the same file ----
export PATH=$real_path
if installed ffmpeg; then
    encoded=("$model" "$room" --orbit 9 --size 168x94 --threads 1 --quiet)
    run 0 render "${encoded[@]}" --video "$temporary/real.mp4"
    ranks 0 4 render "${encoded[@]}" --video "$temporary/real4.mp4"
    check the_same_file cmp "$temporary/real.mp4" "$temporary/real4.mp4"
    on_rank 0 "taskset -pc 0 \$\$ >/dev/null" # on any number of cores
    ranks 0 2 render "${encoded[@]}" --video "$temporary/core.mp4"
    check the_same_file cmp "$temporary/real.mp4" "$temporary/core.mp4"
    on_all_ranks
else
    echo "without ffmpeg (install ffmpeg)"
fi
finish
