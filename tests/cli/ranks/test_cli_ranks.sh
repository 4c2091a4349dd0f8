#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Several ranks under mpirun: the model of one process at any number of ranks, resuming with another number and without
# MPI, refusals, signals, and a rank that dies. Skipped without mpirun or without a plug-in.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"

find_mpirun
if is_sanitized; then
    echo "skipped: the MPI library is not built with a sanitizer"
    exit 77
fi
# shellcheck disable=SC2016 # run by each rank
on_rank_1='[ "${OMPI_COMM_WORLD_RANK:-${PMI_RANK:-0}}" = 1 ]'
# shellcheck disable=SC2016
on_rank_0='[ "${OMPI_COMM_WORLD_RANK:-${PMI_RANK:-0}}" = 0 ]'

ranks_seconds=300
hash_of() { jq -r .model_hash "$temporary/$1/summary.json"; }
same_hash() { check "same_hash: $1 $2" test "$(hash_of "$1")" = "$(hash_of "$2")"; }

common=("$room" --downscale 4 --eval --iterations 90 --threads 1 --quiet)

# ---- Memory: the ranks of a machine share it ----
mkdir "$temporary/empty"
cp -r "$room/images" "$room/sparse" "$temporary/empty/"
rm "$temporary"/empty/sparse/0/points3D.*
if [ "$(awk '/^(Mem|Swap)Total/ { sum += $2 } END { print sum }' /proc/meminfo)" -lt 100000000 ]; then
    limit_of() { sed -nE 's/.*more than the memory of the machine.* \(([0-9.]+) GiB\).*/\1/p' "$temporary/stderr"; }
    huge=("$temporary/empty" --downscale 8 --random-points 100000000 --iterations 1 --quiet -o "$temporary/refused")
    run 1 train "${huge[@]}"
    whole=$(limit_of)
    ranks 1 2 train "${huge[@]}"
    reports "more than the memory of the machine divided by 2 ranks"
    one_voice
    check half_for_each_rank awk -v a="$whole" -v b="$(limit_of)" 'BEGIN { exit !(a > 0 && b > 0.49 * a && b < 0.51 * a) }'
fi

# ---- The same bits ----
run 0 train "${common[@]}" --exposure -o "$temporary/one"
json "$temporary/one/summary.json" '.ranks == 1'
counts=(3)
if is_long; then counts=(1 2 3); fi
scores='[.test, .train] | map(del(.seconds_per_image))'
for count in "${counts[@]}"; do
    ranks 0 "$count" train "${common[@]}" --exposure -o "$temporary/ranks$count"
    same_hash one "ranks$count"
    json "$temporary/ranks$count/summary.json" ".ranks == $count"
    check same_scores test "$(jq -c "$scores" "$temporary/one/summary.json")" = "$(jq -c "$scores" "$temporary/ranks$count/summary.json")"
done
check same_exposures cmp "$temporary/one/exposure.json" "$temporary/ranks3/exposure.json"
json "$temporary/ranks3/summary.json" '.traffic.records.bytes > 0 and .traffic.image.messages > 0'
json "$temporary/ranks3/summary.json" '.per_rank | length == 3 and all(.[]; .peak_rss_bytes > 1e7 and
    .waiting.sums > 0 and .moving.records > 0 and (.waiting | add) + (.moving | add) < .train_seconds and
    .waiting_share > 0 and .moving_share > 0 and .waiting_share + .moving_share < 1)'
json "$temporary/one/summary.json" '.per_rank == null'
check the_estimate_is_that_of_a_rank test "$(jq .memory_estimate_bytes "$temporary/ranks3/summary.json")" -lt \
    "$(jq .memory_estimate_bytes "$temporary/one/summary.json")"
if is_long && [ "${#launcher[@]}" -gt 1 ]; then
    shared=("${launcher[@]}")
    launcher+=(--mca btl tcp,self)
    ranks 0 2 train "${common[@]}" --exposure -o "$temporary/tcp"
    same_hash one tcp
    launcher=("${shared[@]}")
fi

# Open MPI's binding: one line on how to bind if a rank has more threads than cores, or unbound ranks share cores.
if [ "${#launcher[@]}" -gt 1 ] && [ "$(nproc)" -gt 1 ]; then
    shared=("${launcher[@]}")
    launcher=(mpirun --oversubscribe --bind-to core)
    ranks 0 2 train "$room" --downscale 16 --iterations 1 --threads 2 --quiet -o "$temporary/bound"
    check one_line test "$(grep -c 'each rank may use 1 of .* and has 2 threads; start mpirun with' "$temporary/stderr")" = 1
    launcher=("${shared[@]}")
    ranks 0 2 train "$room" --downscale 16 --iterations 1 --threads "$(getconf _NPROCESSORS_ONLN)" --quiet -o "$temporary/unbound"
    check one_line test "$(grep -cE 'each oversubscribe the .* cores of their machine; start|each rank may use' "$temporary/stderr")" = 1
    ranks 0 2 train "$room" --downscale 16 --iterations 1 --threads 1 --quiet -o "$temporary/alone"
    check no_line test "$(grep -cE 'oversubscribe|each rank may use' "$temporary/stderr")" = 0
fi

# MPICH, where it is installed besides Open MPI.
if is_long && installed mpirun.mpich && [ -e "$SPAREGS_BUILD/ranks-mpich.so" ]; then
    default=("${launcher[@]}")
    launcher=(mpirun.mpich)
    for count in 2 3; do
        ranks 0 $count train "${common[@]}" --exposure -o "$temporary/mpich$count"
        same_hash one "mpich$count"
        json "$temporary/mpich$count/summary.json" ".ranks == $count"
    done
    launcher=("${default[@]}")
elif is_long; then
    echo "without MPICH (install libmpich-dev and mpich)"
fi

# ---- eval: the same rows, in the same order ----
run 0 eval "$temporary/one" "$room" --downscale 4 --split all --quiet
grep -v ' s per image$' "$temporary/stdout" >"$temporary/rows"
ranks 0 3 eval "$temporary/one" "$room" --downscale 4 --split all --quiet --save "$temporary/images"
check same_rows cmp "$temporary/rows" <(grep -v ' s per image$' "$temporary/stdout")
check the_time_is_printed grep -qE '^[0-9]+ primitives, [0-9.e-]+ s per image$' "$temporary/stdout"
check every_image test "$(find "$temporary/images" -name '*_flip.png' | wc -l)" = "$(find "$room/images" -name '*.jpg' | wc -l)"

# ---- render: the same files ----
run 0 render "$temporary/one" "$room" --downscale 4 --split all --aov depth --quiet -o "$temporary/frames"
ranks 0 3 render "$temporary/one" "$room" --downscale 4 --split all --aov depth --quiet -o "$temporary/shared"
check same_frames diff -r "$temporary/frames" "$temporary/shared"
check every_path_in_order cmp <(find "$temporary/shared" -name '*.exr' | sort) "$temporary/stdout"
listings=("--orbit 5 --format png --downscale 8")
if is_long; then listings+=("--format png --aov depth --split all"); fi
for options in "${listings[@]}"; do
    # shellcheck disable=SC2086 # several words
    run 0 render "$temporary/one" "$room" --downscale 4 $options --json --quiet -o "$temporary/pictures"
    cp "$temporary/stdout" "$temporary/listed"
    # shellcheck disable=SC2086
    ranks 0 3 render "$temporary/one" "$room" --downscale 4 $options --json --quiet -o "$temporary/pictures"
    check the_same_files_in_json diff <(jq -S .files "$temporary/listed") <(jq -S .files "$temporary/stdout")
    check the_same_ranges diff <(jq -S .ranges "$temporary/listed") <(jq -S .ranges "$temporary/stdout")
done

# ---- experiment: the same results ----
if is_long; then
    cat >"$temporary/plan.json" <<EOF
{"title": "ranks", "scenes": [{"name": "room", "path": "$room", "options": {"downscale": 4}}],
 "pipelines": ["3dgs", "mcmc"], "variants": [{"name": "on"}], "seeds": [0, 1],
 "options": {"iterations": 20, "eval": true, "threads": 1}}
EOF
    run 0 experiment "$temporary/plan.json" -o "$temporary/plan1" --quiet
    ranks 0 3 experiment "$temporary/plan.json" -o "$temporary/plan3" --quiet
    results='[.runs[] | [.folder, .summary.model_hash, .summary.ranks, .summary.test]]'
    check same_results test "$(jq -c "$results" "$temporary/plan1/results.json")" = "$(jq -c "$results" "$temporary/plan3/results.json")"
    json "$temporary/plan3/results.json" '.runs | length == 4'
fi

# A run that fails on another rank: its message is in the log that rank 0 names.
cat >"$temporary/failing.json" <<EOF
{"title": "log", "scenes": [{"name": "room", "path": "$room", "options": {"downscale": 8}}], "pipelines": ["3dgs"], "seeds": [0],
 "variants": [{"name": "first"}, {"name": "second", "options": {"max_memory": "20M"}}], "options": {"iterations": 2, "threads": 1}}
EOF
ranks 1 2 experiment "$temporary/failing.json" -o "$temporary/failing" --quiet
log=$temporary/failing/runs/room/3dgs/second/seed_0/log.txt
reports "1 of 2 runs failed, see $log; rerun the experiment to resume or repeat them"
check the_log_has_the_reason grep -q "more than --max-memory" "$log"
check only_the_failed_run_has_a_log test ! -e "$temporary/failing/runs/room/3dgs/first/seed_0/log.txt"

# ---- Resuming on another number of ranks, and without MPI ----
# Rank 0 cannot create the folder of the model, where a dangling link is: the others wait for it, the checkpoint is whole.
mkdir -p "$temporary/obstructed/point_cloud"
ln -s nowhere/else "$temporary/obstructed/point_cloud/iteration_90"
ranks 1 3 train "${common[@]}" --exposure --checkpoint-every 40 -o "$temporary/obstructed"
one_voice
reports "obstructed/point_cloud/iteration_90: cannot be created: No such file or directory; choose another folder, or check the permissions"
rm "$temporary/obstructed/point_cloud/iteration_90"
cp -r "$temporary/obstructed" "$temporary/part"
ranks 0 2 train "${common[@]}" --exposure --checkpoint-every 40 --resume -o "$temporary/obstructed"
same_hash one obstructed
check same_model cmp "$temporary"/{one,obstructed}/point_cloud/iteration_90/point_cloud.ply
# As if it had been killed after the checkpoint of iteration 80.
mv "$temporary/part/checkpoint/state.previous.bin" "$temporary/part/checkpoint/state.bin"
ranks 0 2 train "$room" --resume --checkpoint-every 40 -o "$temporary/part" # options: those of the run
reports "resuming at iteration 80"
same_hash one part

# A rank is killed: the launcher ends the job; the checkpoint is whole.
status=0
timeout 300 "${launcher[@]}" -n 2 "$program" train "${common[@]}" --iterations 100000 --checkpoint-every 20 -o "$temporary/killed" \
    >"$temporary/stdout" 2>"$temporary/stderr" &
job=$!
for ((i = 0; i < 600; ++i)); do
    [ ! -f "$temporary/killed/checkpoint/state.bin" ] || break
    sleep 0.1
done
mpi=$(pgrep -P "$job" | head -1) # of timeout
kill -KILL "$(pgrep -P "$mpi" | tail -1)"
wait "$job" || status=$?
last_command="kill -KILL of a rank"
check the_job_ends test "$status" -ne 0
for ((i = 0; i < 300; ++i)); do # the launcher does not wait for the end of the ranks that it kills
    pgrep -f "$temporary/killed" >/dev/null || break
    sleep 0.1
done
check no_rank_is_left test "$i" -lt 300
rows=$(wc -l <"$temporary/killed/train.csv")
"$program" train "$room" --downscale 4 --eval --threads 1 --quiet --iterations 100000 --resume -o "$temporary/killed" \
    >"$temporary/stdout" 2>"$temporary/stderr" &
training=$!
last_command="train --resume after the kill"
while kill -0 "$training" 2>/dev/null && [ "$(wc -l <"$temporary/killed/train.csv")" -le "$rows" ]; do sleep 0.1; done
if kill -TERM "$training"; then :; fi
status=0
wait "$training" || status=$?
check stopped_by_the_signal test "$status" = 143
check continued test "$(jq .iterations "$temporary/killed/summary.json")" -gt 20

# USR2 ends all ranks in the same iteration and saves, although the folder of the trace was removed.
timeout 300 "${launcher[@]}" -n 2 "$program" train "${common[@]}" --downscale 8 --iterations 100000 -o "$temporary/usr2" \
    --trace "$temporary/traces/trace.json" >"$temporary/stdout" 2>"$temporary/stderr" &
job=$!
for ((i = 0; i < 600; ++i)); do
    [ ! -s "$temporary/usr2/train.csv" ] || [ "$(wc -l <"$temporary/usr2/train.csv")" -lt 2 ] || break
    sleep 0.1
done
rm -r "$temporary/traces"
kill -USR2 "$(pgrep -P "$job" | head -1)" # mpirun forwards it
status=0
wait "$job" || status=$?
last_command="kill -USR2 of mpirun"
check the_lost_trace_is_an_error test "$status" = 1
check it_is_printed_once test "$(grep '^sparegs: ' "$temporary/stderr" | grep -vc warning)" = 1
reports "traces/trace.json: cannot be written: No such file or directory"
json "$temporary/usr2/summary.json" '.stop_reason == "signal"'
check checkpoint_saved test -f "$temporary/usr2/checkpoint/state.bin"

# A page pauses two ranks: it shows the model of the iteration at which they stand.
timeout 300 "${launcher[@]}" -n 2 "$program" train "$room" --downscale 8 --iterations 100000 --threads 1 --quiet --view 0 \
    -o "$temporary/viewed" >"$temporary/stdout" 2>"$temporary/stderr" &
job=$!
for ((i = 0; i < 600; ++i)); do
    ! grep -qs http "$temporary/stdout" || break
    sleep 0.1
done
status=0
python3 "$SPAREGS_SOURCE/tests/cli/pages/view_client.py" "$(head -1 "$temporary/stdout")" paused >"$temporary/page" || status=$?
wait "$job" || true
last_command="a page that pauses two ranks"
grep '^FAIL' "$temporary/page" || true
check the_paused_model_is_shown test "$status" = 0
json "$temporary/viewed/summary.json" '.stop_reason == "signal" and .ranks == 2'

# A full disk on rank 0, here a limit on the size of files: later checkpoints are too large. The others continue, only rank 0
# reports it, and the run continues from the checkpoint before.
if is_long; then
    run 0 train "${common[@]}" --iterations 200 -o "$temporary/long"
    check the_model_grows test -s "$temporary/long/checkpoint/state.bin"
    cat >"$temporary/full" <<EOF
#!/usr/bin/env bash
if $on_rank_0; then ulimit -f $(($(stat -c %s "$temporary/long/checkpoint/state.bin") * 3 / 4 / 1024)); fi
exec "$program" "\$@"
EOF
    chmod +x "$temporary/full"
    real=$program
    shared=("${launcher[@]}")
    program=$temporary/full
    [ "${#launcher[@]}" = 1 ] || launcher+=(--mca btl "tcp,self") # shared memory is a file, too
    ranks 1 3 train "${common[@]}" --iterations 200 --checkpoint-every 20 -o "$temporary/disk"
    program=$real
    launcher=("${shared[@]}")
    reports "the checkpoint of iteration 180 was not saved; training continues"
    check an_error_and_a_warning_for_each test "$(grep -c '^sparegs: ' "$temporary/stderr")" = \
        $((2 * $(grep -c 'was not saved' "$temporary/stderr") + 1))
    check an_earlier_checkpoint_is_kept test -s "$temporary/disk/checkpoint/state.bin"
    check no_temporary_file_is_left test -z "$(find "$temporary/disk" -name '*.tmp*')"
    ranks 0 2 train "${common[@]}" --iterations 200 --resume --checkpoint-every 20 -o "$temporary/disk"
    same_hash long disk
fi

# ---- Refused ----
cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$program" "\$@" --seed 5
exec "$program" "\$@"
EOF
chmod +x "$temporary/differs"
real=$program
program=$temporary/differs
ranks 1 2 train "${common[@]}" -o "$temporary/refused"
one_voice
reports "sparegs: rank 1 ("
reports "seed is 5, but 0 on rank 0"
check nothing_written test ! -e "$temporary/refused"
differing=(resume) # the ranks would wait for each other
if is_long; then differing+=(checkpoint-every=10 save-at=10); fi
for option in "${differing[@]}"; do
    cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$real" "\$@" --$option
exec "$real" "\$@"
EOF
    ranks 1 2 train "${common[@]}" -o "$temporary/refused"
    one_voice
    reports "): --${option%=*} is "
    check nothing_written test ! -e "$temporary/refused"
done
cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$real" "\$@" --isa baseline
exec "$real" "\$@"
EOF
ranks 1 2 train "${common[@]}" -o "$temporary/refused"
if grep -q "avx" <("$real" --version); then
    reports "instruction set is x86-64 without fused multiply-add, but with fused multiply-add on rank 0"
    one_voice
fi
cp -r "$room" "$temporary/other"
photo=$(find "$temporary/other/images" -name '*.jpg' | sort | tail -1)
cp "$(find "$temporary/other/images" -name '*.jpg' | sort | head -1)" "$photo"
cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$real" train "$temporary/other" "\$@"
exec "$real" train "$room" "\$@"
EOF
ranks 1 2 --downscale 4 --iterations 90 --quiet -o "$temporary/refused"
reports "photo $(basename "$photo") is "
one_voice
# Held-out images are scored on one rank each: another photo, or none, is found before the training.
rm -r "$temporary/other"
cp -r "$room" "$temporary/other"
photo=$(find "$temporary/other/images" -name '*.jpg' | sort | head -1) # the first image is held out
cp "$(find "$temporary/other/images" -name '*.jpg' | sort | tail -1)" "$photo"
ranks 1 2 --downscale 4 --eval --iterations 90 --quiet -o "$temporary/refused"
reports "photo $(basename "$photo") is "
one_voice
# The last of 33 images is held out, too.
rm -r "$temporary/other"
cp -r "$room" "$temporary/some_images"
find "$temporary/some_images/images" -name '*.jpg' | sort | tail -2 | xargs rm
cp -r "$temporary/some_images" "$temporary/other"
find "$temporary/other/images" -name '*.jpg' | sort | tail -1 | xargs rm
sed -i "s|train \"$room\"|train \"$temporary/some_images\"|" "$temporary/differs"
ranks 1 2 --downscale 4 --eval --iterations 90 --quiet -o "$temporary/refused"
reports "number of held-out views is 4, but 5 on rank 0"
check nothing_written test ! -e "$temporary/refused"
"$SPAREGS_BUILD/tests/test_lpips" alex "$temporary/alex.bin"
"$SPAREGS_BUILD/tests/test_lpips" vgg "$temporary/vgg.bin"
cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$real" "\$@" --lpips "$temporary/vgg.bin"
exec "$real" "\$@" --lpips "$temporary/alex.bin"
EOF
ranks 1 2 train "${common[@]}" -o "$temporary/refused"
reports "content of the file of --lpips is "
one_voice
check nothing_written test ! -e "$temporary/refused"
program=$real

# Another build: the same program with another commit in it.
commit=$("$real" --version | sed -n '1s/.*(\(.*\)).*/\1/p')
if is_long && [ "${#commit}" -ge 7 ]; then
    LC_ALL=C sed "s/$commit/${commit//?/z}/g" "$real" >"$temporary/other_build"
    chmod +x "$temporary/other_build"
    ln -s "$SPAREGS_BUILD"/ranks-*.so "$temporary/"
    cat >"$temporary/differs" <<EOF
#!/bin/sh
$on_rank_1 && exec "$temporary/other_build" "\$@"
exec "$real" "\$@"
EOF
    program=$temporary/differs
    ranks 1 2 train "${common[@]}" -o "$temporary/refused"
    reports "version is "
    reports "(${commit//?/z})"
    one_voice
    check nothing_written test ! -e "$temporary/refused"
    program=$real
fi

# Without the plug-in, and a command for one process.
mkdir "$temporary/bin"
cp "$program" "$temporary/bin/sparegs"
program=$temporary/bin/sparegs
ranks 1 2 train "${common[@]}" -o "$temporary/refused"
reports "the MPI plug-in ranks-"
one_voice
program=$temporary/some
printf '#!/bin/bash\nif %s; then exec "%s" "$@"; fi\nexec "%s" "$@"\n' "$on_rank_1" "$temporary/bin/sparegs" "$real" >"$program"
chmod +x "$program"
ranks 1 2 train "${common[@]}" -o "$temporary/refused"
check rank_1_alone_has_none grep -qE '^sparegs: rank 1 \(.*\): .*the MPI plug-in ranks-' "$temporary/stderr"
program=$real
# srun without PMIx: each process is alone, although Slurm announces two. Nothing is trained several times. With
# --mpi=pmi2, srun sets the variables of MPICH, which may not be installed.
if [ "${#launcher[@]}" -gt 1 ]; then
    mkdir "$temporary/openmpi"
    cp "$program" "$SPAREGS_BUILD/ranks-openmpi.so" "$temporary/openmpi/"
    program=$temporary/openmpi/sparegs
    for announced in "SLURM_STEP_NUM_TASKS=2 SLURM_PROCID=0" "SLURM_STEP_ID=0 PMI_SIZE=2 PMI_RANK=0"; do
        # shellcheck disable=SC2086 # several variables
        export $announced
        run 1 train "${common[@]}" -o "$temporary/refused"
        reports "2 processes were launched, but MPI connects 1 of them"
        reports "select another MPI type of srun, of those that 'srun --mpi=list' prints"
        one_line
        check nothing_written test ! -e "$temporary/refused"
        unset SLURM_STEP_NUM_TASKS SLURM_PROCID SLURM_STEP_ID PMI_SIZE PMI_RANK
    done
    PMI_SIZE=2 PMI_RANK=0 run 1 train "${common[@]}" -o "$temporary/refused" # of MPICH's own launcher
    reports "the MPI plug-in ranks-mpich.so cannot be loaded"
    program=$real
fi
# The launcher ends the job with the first rank that fails; the message of rank 0 must not be lost.
attempts=1
if is_long; then attempts=5; fi
for ((i = 0; i < attempts; ++i)); do
    ranks 2 4 info "$room"
    reports "info runs in one process"
    one_voice
done
ranks 2 4 trian "$room"
reports "trian"
one_voice
finish
