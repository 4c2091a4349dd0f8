#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# bench: names and structure of the output, and relations between its numbers that hold on any machine.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

run 0 bench --list
for name in sparse-32k dense-500k dense-2m dense-1m-1.3mp dense-1m-8mp dense-2m-8mp dense-5m dense-5m-8mp; do
    prints "$name"
done
run 0 bench --list --json
json "$temporary/stdout" '.scenes | map(.name) == ["sparse-32k", "dense-500k", "dense-2m", "dense-1m-1.3mp", "dense-1m-8mp", "dense-2m-8mp", "dense-5m",
    "dense-5m-8mp"]'
run 2 bench dense-500
one_line
reports "did you mean 'dense-500k'?"
run 2 bench "$room/images/0001.jpg"
one_line
run 2 bench sparse-32k --json --csv
one_line

# two_settings_of_a_built_in_scene
run 0 bench sparse-32k --threads 1,2 --repeat 1 --json --quiet
result=$temporary/bench.json
cp "$temporary/stdout" "$result"
json "$result" '.limits | .fma_gflops > 0 and .l2_gbs > 0 and .memory_gbs > 0 and .tsc_ghz >= 0'
json "$result" '[.benches[] | [.name, .threads]] == [["sparse-32k", 1], ["sparse-32k", 2]]'
json "$result" 'all(.benches[]; .primitives == 32768 and .pixels == 800 * 608)'
json "$result" 'all(.benches[]; [.seconds | .build, .refit, .loss, .optimizer, .iteration] | all(. > 0))'
json "$result" 'all(.benches[]; .core_seconds_per_mp.total > 0 and .lane_use > 0 and .lane_use <= 1)'
# the_total_is_the_sum_of_its_phases
json "$result" 'all(.benches[].ns_per_hit; ((.gather + .forward + .backward) / .total - 1 | fabs) < 1e-6)'
json "$result" 'all(.benches[]; .seconds | .iteration > .gather + .forward + .backward + .loss + .optimizer + .refit - 1e-9 )'
# every_phase_is_reported_in_every_unit, with the share of a limit
json "$result" 'all(.benches[]; (.seconds | keys) as $phases | [.cycles_per_hit, .ns_per_hit, .core_seconds_per_mp] | all(keys == $phases))'
json "$result" 'all(.benches[]; ((.share_of_fma + .share_of_memory) | keys) == (.seconds | keys))'
json "$result" 'all(.benches[]; [.share_of_fma, .share_of_l2, .share_of_memory | .[]] | all(. > 0))'
json "$result" 'all(.benches[]; .share_of_l2 | keys == ["backward", "forward", "total"] and all(.[]; . < 1.2))'
json "$result" '.limits.tsc_ghz as $ghz | all(.benches[]; (.cycles_per_hit.total - .ns_per_hit.total * $ghz | fabs) < 0.01 * .ns_per_hit.total)'
json "$result" 'all(.benches[]; .serial_share >= 0 and .serial_share < 1 and .waiting_share >= 0 and .waiting_share < 1)'
json "$result" 'all(.benches[]; .bytes | (.iteration / (.total + .loss + .optimizer + .refit) - 1 | fabs) < 1e-6)'
json "$result" 'all(.benches[].predicted_speedup[]; .speedup > 1 and .speedup <= .cores)'
# the_optimizer_moves_its_arrays: three arrays of 59 floats in and out, at most for all rows
json "$result" 'all(.benches[]; .bytes.optimizer > 0.2 * 6 * 59 * 4 * .primitives and .bytes.optimizer < 6 * 64 * 4 * .primitives)'
json "$result" '[.limits.by_threads[].threads] | length == (unique | length)'
# counts_do_not_depend_on_threads
json "$result" '[.benches[] | [.hits_per_ray, .evaluations_per_block, .block_hits_per_block]] | .[0] == .[1]'
# (the number of callbacks depends on the tree)
json "$result" '[.benches[].candidates_per_tile] | .[0] / .[1] - 1 | fabs < 0.01'
json "$result" 'all(.benches[]; .block_hits_per_block <= .evaluations_per_block and .hits_per_ray <= .block_hits_per_block)'

# a_model_and_a_scene_of_the_user
run 0 train "$room" -o "$temporary/model" --downscale 4 --iterations 5 --spare off --quiet
json "$temporary/model/summary.json" '.serial_seconds >= 0 and .serial_seconds + .waiting_seconds < .train_seconds'
json "$temporary/model/summary.json" '(.bytes | add) / .bytes_per_iteration - 1 | fabs < 1e-6'
json "$temporary/model/summary.json" '[.predicted_speedup[] | .cores] == [8, 32, 64] and all(.predicted_speedup[]; .speedup >= 1)'
run 0 bench "$temporary/model" "$room" --views 2 --repeat 2 --threads 1 --csv --quiet
check a_header_and_a_row test "$(wc -l <"$temporary/stdout")" = 2
check as_many_columns_as_names bash -c "awk -F, 'NR == 1 { n = NF } NF != n { exit 1 }' '$temporary/stdout'"
cp "$temporary/model/point_cloud/iteration_5/point_cloud.ply" "$temporary/a, \"b\".ply"
run 0 bench "$temporary/a, \"b\".ply" "$room" --downscale 8 --views 1 --repeat 1 --threads 1 --csv --quiet
check names_are_quoted grep -qF ', ""b"".ply",' "$temporary/stdout"
# empty_models_and_unknown_names_are_errors
LC_ALL=C sed '/^end_header$/q; s/^element vertex .*/element vertex 0/' "$temporary/model/point_cloud/iteration_5/point_cloud.ply" >"$temporary/none.ply"
for command in bench profile; do
    run 1 "$command" "$temporary/none.ply" "$room"
    one_line
    reports "none.ply: contains no primitives"
done
run 1 train "$room" --init "$temporary/none.ply" -o "$temporary/started"
reports "none.ply: contains no primitives"

# a_full_disk_behind_a_redirection_is_a_failure
formats=(--json)
if is_long; then formats+=(--csv --quiet); fi
for how in "${formats[@]}"; do
    check "a_full_disk_fails $how" bash -c '! "$0" bench sparse-32k --repeat 1 "$1" >/dev/full 2>"$2"' \
        "$program" "$how" "$temporary/stderr"
    reports "standard output: cannot be written"
done
# ranks: messages, balance and speed-up are predicted for the first setting
run 0 bench sparse-32k --ranks 2,4 --repeat 5 --threads 1,2 --json --quiet
cp "$temporary/stdout" "$result"
json "$result" '[.benches[] | has("ranks")] == [true, false]'
json "$result" '.benches[0].ranks | map(.ranks) == [2, 4]'
json "$result" 'all(.benches[0].ranks[]; .balance > 0.5 and .balance <= 1)'
json "$result" '.benches[0] | .primitives as $all | all(.ranks[]; .primitives > $all / .ranks and .primitives <= $all)'
json "$result" '.benches[0].ranks[0].calls | keys == ["gradients", "image", "records", "status", "sums"]'
# (every rank sends to every other one; a gradient record has 68 bytes, a projected one 88, padded to 64)
json "$result" 'all(.benches[0].ranks[]; .ranks as $r | .calls | .gradients.messages == $r * ($r - 1) and .status.messages == 8 * $r * ($r - 1))'
json "$result" '.benches[0] | .seconds.build as $build | all(.ranks[]; .build_seconds > 0 and .build_seconds < $build)'
json "$result" 'all(.benches[0].ranks[].calls[]; .most_bytes <= .bytes and .bytes > 0)'
json "$result" '.benches[0].ranks | .[1].calls.records.bytes > .[0].calls.records.bytes'
json "$result" 'all(.benches[0].ranks[].networks; map(.bandwidth) as $b | map(.seconds) as $s | $b == ($b | sort) and $s == ($s | sort | reverse))'
json "$result" 'all(.benches[0].ranks[]; .ranks as $r | all(.networks[]; .speedup > 0 and .speedup < $r and .speedup_64_cores < .speedup))'
run 0 bench sparse-32k --ranks 3 --repeat 1 --quiet
prints "  3 ranks: balance "
prints "predicted speed-up over one machine"
for ranks in 1 1025 x; do
    run 2 bench sparse-32k --ranks $ranks
    reports "--ranks"
    one_line
done
run 2 bench sparse-32k --ranks 2 --csv
reports "--ranks and --csv are mutually exclusive; use --json"
one_line

# wrong_paths_are_reported_before_measuring
run 1 bench sparse-32k "$temporary/model" "$temporary/nowhere" --json
one_line
reports "nowhere"
json "$temporary/stdout" '.error.file != null and (has("benches") | not)'
mkdir "$temporary/empty"
for where in "$temporary/model $temporary/empty" "$temporary/model $room $temporary/model $temporary/empty"; do
    # shellcheck disable=SC2086 # two or four operands
    run 1 bench sparse-32k $where --json --quiet
    one_line
    reports "empty: no scene found"
    json "$temporary/stdout" '.error.file != null and (has("benches") | not)'
done
run 2 bench "$temporary/model"
one_line
reports "requires a SCENE"

# an_error_keeps_the_finished_measurements, in every format
run 1 bench sparse-32k "$temporary/none.ply" "$room" --repeat 1 --json --quiet
one_line
json "$temporary/stdout" '[.benches[].name] == ["sparse-32k"] and .benches[0].seconds.iteration > 0'
json "$temporary/stdout" '.error.code == "failed" and (.error.message | contains("no primitives"))'
if is_long; then
    run 1 bench sparse-32k "$temporary/none.ply" "$room" --repeat 1 --csv --quiet
    check a_header_and_a_row test "$(wc -l <"$temporary/stdout")" = 2
    run 1 bench sparse-32k "$temporary/none.ply" "$room" --repeat 1 --quiet
    prints "sparse-32k"
fi
run 1 bench "$temporary/none.ply" "$room" sparse-32k --repeat 1 --quiet
check nothing_was_measured test ! -s "$temporary/stdout"

# a_signal_keeps_the_finished_measurements: SIGINT when the second scene is announced on the terminal
status=0
last_command="bench sparse-32k dense-500k --json, interrupted"
python3 - "$program" "$temporary/stdout" 2>"$temporary/stderr" <<'PY' || status=$?
import os, pty, signal, subprocess, sys

signal.signal(signal.SIGINT, signal.SIG_DFL)
here, there = pty.openpty()
with open(sys.argv[2], "wb") as result:
    bench = subprocess.Popen([sys.argv[1], "bench", "sparse-32k", "dense-500k", "--repeat", "3", "--json"], stdout=result, stderr=there)
os.close(there)
seen = b""
while b"dense-500k 1/3" not in seen:
    seen += os.read(here, 1000)
bench.send_signal(signal.SIGINT)
try:
    while os.read(here, 1000):
        pass
except OSError:  # the program has closed the terminal
    pass
sys.exit(bench.wait())
PY
check exit_status_130 test "$status" = 130
json "$temporary/stdout" '[.benches[].name] == ["sparse-32k"] and .benches[0].seconds.iteration > 0 and .error.code == "interrupted"'

finish
