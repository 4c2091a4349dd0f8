#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# experiment, report and explain: invalid plans are refused before the first run, completed runs are not repeated, tables
# agree with the summaries, the page is one well-formed file, and the quotas of regions add up to the budget.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
room=$SPAREGS_SOURCE/tests/data/room

plan() { # SCENE PIPELINES OPTIONS
    cat >"$folder/plan.json" <<PLAN
{"title": "Small", "scenes": [{"name": "room", "path": "$1"}], "pipelines": $2,
 "variants": [{"name": "off", "options": {"spare": "off"}}, {"name": "on"},
              {"name": "tau-0.2", "pipelines": ["3dgs"], "options": {"spare_tau_alpha": 0.2}}],
 "options": {"iterations": 50, "downscale": 8, "eval": true, "threads": 1 $3}}
PLAN
}

refused() { # TEXT OF THE MESSAGE
    if "$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error"; then
        echo "FAIL: a bad plan ran"; exit 1
    fi
    grep -q -- "$1" "$folder/error" || { echo "FAIL: no '$1' in:"; cat "$folder/error"; exit 1; }
    [ "$(grep -c "^sparegs: .*plan.json\|nowhere" "$folder/error")" = 1 ] && [ "$(wc -l <"$folder/error")" = 1 ] || { echo "FAIL: no single line:"; cat "$folder/error"; exit 1; }
    [ ! -e "$folder/out/runs" ] || { echo "FAIL: something ran"; exit 1; }
}
plan "$room/nowhere" '["3dgs"]' ''; refused nowhere
plan "$room" '["3dgs", "vanila"]' ''; refused vanila
plan "$room" '["3dgs"]' ', "itterations": 3'; refused itterations
plan "$room" '["3dgs"]' ', "sh_degree": 7'; refused sh-degree
plan "$room" '["3dgs"]' ', "output": "x"'; refused output
plan "$room" '[]' ''; refused pipelines
echo '{"scenes": [' >"$folder/plan.json"; refused 'line 2'

plan "$room" '["3dgs"]' ''; sed -i 's/"name": "room",/"name": "room", "dataset": "x",/' "$folder/plan.json"; refused "unknown key 'dataset' (did you mean 'data_set'?)"
plan "$room" '["3dgs"]' ''
sed -i 's/"scenes": \[/&{"name": "a", "path": "nowhere", "data_set": "x"}, /' "$folder/plan.json"; refused "\"data_set\" is missing for scene 'room'"

plan "$room" '["3dgs", "mip"]' ', "trace": "traces/last.json"'
[ "$("$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --check | wc -l)" = 5 ]
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet
[ "$(jq '.runs | length' "$folder/out/results.json")" = 5 ]
[ "$(wc -l <"$folder/out/results.csv")" = 6 ]
[ -s "$folder/traces/last.json" ] || { echo "FAIL: the trace is not relative to the plan"; exit 1; }
[ "$(jq '[.runs[].summary.model_hash] | unique | length' "$folder/out/results.json")" = 5 ]

# --threads and --isa apply to runs whose plan does not set them; each run shows its progress on a terminal, and only there.
jq '.pipelines = ["3dgs"] | .variants = [{name: "own", options: {threads: 2, isa: "baseline"}}, {name: "given"}] |
    del(.options.threads, .options.trace) | .options.iterations = 20' "$folder/plan.json" >"$folder/threads.json"
"$SPAREGS_PROGRAM" experiment "$folder/threads.json" -o "$folder/threads" --threads 1 --isa baseline 2>"$folder/lines"
for pair in own:2 given:1; do
    [ "$(jq -r '"\(.threads) \(.isa)"' "$folder/threads/runs/room/3dgs/${pair%:*}/seed_0/summary.json")" = "${pair#*:} baseline" ] ||
        { echo "FAIL: threads of ${pair%:*}"; exit 1; }
done
if grep -q 'it/s\|loaded in' "$folder/lines"; then echo "FAIL: progress in a file"; cat "$folder/lines"; exit 1; fi
shown() { # OPTION...: what the experiment prints on a terminal
    rm -rf "$folder/threads"
    python3 - "$SPAREGS_PROGRAM" experiment "$folder/threads.json" -o "$folder/threads" "$@" >"$folder/lines" <<'PY'
import os, pty, subprocess, sys

here, there = pty.openpty()
run = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=there)
os.close(there)
try:
    while text := os.read(here, 1000):
        sys.stdout.buffer.write(text)
except OSError:  # the program has closed the terminal
    pass
sys.exit(run.wait())
PY
}
shown
for text in 'sparegs: run 1 of 2: room, 3dgs, own, seed 0' 'sparegs: run 2 of 2: room, 3dgs, given, seed 0' '20/20 .* it/s' 'loaded in'; do
    tr '\r' '\n' <"$folder/lines" | grep -q "$text" || { echo "FAIL: no '$text' on the terminal:"; cat "$folder/lines"; exit 1; }
done
shown --quiet
[ ! -s "$folder/lines" ] || { echo "FAIL: not quiet:"; cat "$folder/lines"; exit 1; }

# The same command again runs nothing; a lost run is repeated with the same bits.
lost=$folder/out/runs/room/3dgs/on/seed_0
kept=$folder/out/runs/room/mip/off/seed_0
hash=$(jq -r .model_hash "$lost/summary.json")
touch -d 2001-01-01 "$kept/summary.json"
mkdir -p "$kept/checkpoint"
echo state >"$kept/checkpoint/state.bin" # an experiment that was killed after the training has left it
rm -r "$lost"
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet
[ "$(jq -r .model_hash "$lost/summary.json")" = "$hash" ]
[ "$(date -r "$kept/summary.json" +%Y)" = 2001 ]
[ ! -e "$kept/checkpoint/state.bin" ] || { echo "FAIL: a complete run keeps its checkpoint"; exit 1; }

# Another job that works on the same plan keeps its runs: they are skipped, and repeated only when it is gone.
rm -r "$kept/summary.json" "$lost"
exec 9>"$kept/.experiment"
flock -n 9
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error"
exec 9>&-
grep -q "mip, off, seed 0: in use by another experiment, skipped" "$folder/error" || { cat "$folder/error"; exit 1; }
grep -q "other jobs took 1 of 5 runs" "$folder/error" || { cat "$folder/error"; exit 1; }
[ ! -e "$kept/summary.json" ]
[ -e "$lost/summary.json" ]
[ "$(jq '.runs | length' "$folder/out/results.json")" = 4 ]
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet
[ "$(jq '.runs | length' "$folder/out/results.json")" = 5 ]

# A training that an experiment which was killed has left, and which still saves: the run waits for it.
rm -r "$kept/summary.json"
: >"$folder/locked"
: >"$folder/error"
(
    exec 9>"$kept/.lock"
    flock -n 9
    echo locked >"$folder/locked"
    for _ in $(seq 600); do # longer than the experiment waits
        if grep -q waiting "$folder/error"; then break; fi
        sleep 0.1
    done
    sleep 0.5
) &
job=$!
until [ -s "$folder/locked" ]; do sleep 0.05; done
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error" || { echo "FAIL: did not wait"; cat "$folder/error"; exit 1; }
wait "$job"
grep -q "waiting up to 60 s for a training run left by an earlier experiment" "$folder/error" || { cat "$folder/error"; exit 1; }
[ -e "$kept/summary.json" ]
# A run whose folder is still in use after that is a failure, not a run of another job.
rm -r "$kept/summary.json"
exec 9>"$kept/.lock"
flock -n 9
status=0
SPAREGS_WAIT_SECONDS=1 "$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error" 9>&- || status=$?
[ $status = 1 ] || { echo "FAIL: status $status with an unfinished run"; cat "$folder/error"; exit 1; }
grep -q "mip/off/seed_0: a training run still uses this folder after 1 s$" "$folder/error" || { cat "$folder/error"; exit 1; }
grep -q "1 of 5 runs failed; rerun the experiment to resume or repeat them$" "$folder/error" || { cat "$folder/error"; exit 1; }
if grep -q "another experiment, skipped\|other jobs" "$folder/error"; then echo "FAIL: blames another job"; cat "$folder/error"; exit 1; fi
# A stop while it waits is neither.
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error" 9>&- &
job=$!
until grep -q "waiting up to 60 s" "$folder/error"; do kill -0 $job; sleep 0.05; done
kill -TERM $job
status=0; wait $job || status=$?
[ $status = 143 ] || { echo "FAIL: status $status after a signal"; cat "$folder/error"; exit 1; }
if grep -q "skipped\|failed\|still uses\|other jobs" "$folder/error"; then echo "FAIL: blames something else"; cat "$folder/error"; exit 1; fi
exec 9>&-
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet
[ -e "$kept/summary.json" ]

# Two jobs do not write the results at the same time: the second waits, then reads the runs of both.
rm "$folder/out/results.json"
exec 9>"$folder/out/.results"
flock -n 9
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet 9>&- &
job=$!
sleep 1.5
[ ! -e "$folder/out/results.json" ] && kill -0 "$job" || { echo "FAIL: results were written by two jobs"; exit 1; }
exec 9>&-
wait "$job"
[ "$(jq '.runs | length' "$folder/out/results.json")" = 5 ]
# A signal ends the wait.
exec 9>"$folder/out/.results"
flock -n 9
"$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error" 9>&- &
job=$!
until grep -q "run 1 of 5.*already complete" "$folder/error"; do kill -0 $job; sleep 0.05; done
sleep 0.5
kill -TERM $job
for _ in $(seq 100); do kill -0 $job 2>/dev/null || break; sleep 0.1; done
if kill -0 $job 2>/dev/null; then echo "FAIL: waits in spite of a signal"; kill -KILL $job; exit 1; fi
status=0; wait $job || status=$?
[ $status = 143 ] || { echo "FAIL: status $status after a signal"; cat "$folder/error"; exit 1; }
exec 9>&-
[ "$(jq '.runs | length' "$folder/out/results.json")" = 5 ]

# Another plan in the same folder is refused before the first run, unless the difference does not affect results.
cp "$folder/plan.json" "$folder/same.json"
sed -i 's/"iterations": 50/"iterations": 51/' "$folder/plan.json"
if "$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" 2>"$folder/error"; then echo "FAIL: took the runs of another plan"; exit 1; fi
grep -q "seed_0: was trained with iterations 50, but the plan has 51" "$folder/error" || { cat "$folder/error"; exit 1; }
sed 's/"iterations": 50/"iterations": 50, "save-at": 10/' "$folder/same.json" >"$folder/plan.json"
[ "$("$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --quiet --json | jq '.runs | length')" = 5 ]
[ "$("$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/out" --check --json | jq '.runs | length')" = 5 ]
# So is a plan that another experiment begins in the folder after the check at the start: here during the first run.
jq '.options.iterations = 100 | .pipelines = ["3dgs"] | .variants = [{name: "first"}, {name: "second"}] | del(.options.trace)' \
    "$folder/same.json" >"$folder/pair.json"
mkdir -p "$folder/pair/runs/room/3dgs/second/seed_0"
"$SPAREGS_PROGRAM" experiment "$folder/pair.json" -o "$folder/pair" 2>"$folder/error" &
job=$!
until [ -e "$folder/pair/runs/room/3dgs/first/seed_0/config.json" ]; do kill -0 "$job"; sleep 0.05; done
echo '{"options": {"iterations": 21}}' >"$folder/pair/runs/room/3dgs/second/seed_0/experiment.json"
status=0; wait "$job" || status=$?
[ $status = 1 ] || { echo "FAIL: mixed two plans"; exit 1; }
grep -q "second/seed_0: was trained with .*, but the plan has" "$folder/error" || { cat "$folder/error"; exit 1; }
[ "$(grep -c "was trained with" "$folder/error")" = 1 ] || { echo "FAIL: not one line:"; cat "$folder/error"; exit 1; }
[ ! -e "$folder/pair/runs/room/3dgs/second/seed_0/config.json" ] || { echo "FAIL: trained over another plan"; exit 1; }
# A type error names the key.
sed 's/"eval": true/"eval": "yes"/' "$folder/same.json" >"$folder/typed.json"
if "$SPAREGS_PROGRAM" experiment "$folder/typed.json" -o "$folder/out" --check 2>"$folder/error"; then echo "FAIL: took a string for a flag"; exit 1; fi
grep -qF "typed.json: expected true or false for option 'eval'" "$folder/error" || { cat "$folder/error"; exit 1; }

[ "$("$SPAREGS_PROGRAM" report "$folder/out" --json | jq '.files | length')" = 2 ]
"$SPAREGS_PROGRAM" report "$folder/out" --pictures 1 >/dev/null
base=$(jq '.runs[] | select(.pipeline == "mip" and .variant == "off") | .summary.gaussians' "$folder/out/results.json")
ours=$(jq '.runs[] | select(.pipeline == "mip" and .variant == "on") | .summary.gaussians' "$folder/out/results.json")
change=$(awk "BEGIN { printf \"%+.1f %%\", 100 * ($ours / $base - 1) }")
grep -F "| mip | room |" "$folder/out/report.md" | grep -qF "| $change |" || { echo "FAIL: no change of $change:"; cat "$folder/out/report.md"; exit 1; }
grep -q "Variants of 3dgs" "$folder/out/report.md"
# SPARE-GS's share of the structural updates, from the seconds of the summary.
share=$(jq -r '.seconds | 100 * .spare / (.spare + .density + .bvh_build)' "$folder/out/runs/room/mip/on/seed_0/summary.json")
grep -E '^\| mip \| on \|' "$folder/out/report.md" | grep -qF "| $(printf '%.2f' "$share") % |" || { echo "FAIL: share of $share:"; grep '^| mip' "$folder/out/report.md"; exit 1; }

# A scene overrides the plan and a variant both, with either spelling of an option.
jq '.options += {iterations: 20, downscale: 16, spare_grid: 16} | .scenes[0].options["spare-grid"] = 8 | .pipelines = ["3dgs"] |
    .variants = [{name: "on"}, {name: "four", options: {spare_grid: 4}}]' "$folder/same.json" >"$folder/spelled.json"
"$SPAREGS_PROGRAM" experiment "$folder/spelled.json" -o "$folder/spelled" --quiet
[ "$(jq .options.spare_grid "$folder"/spelled/runs/room/3dgs/{on,four}/seed_0/config.json | xargs)" = "8 4" ]

# Data sets: the changes of their means, weighted by their scenes, as in Table I. Figures by hand: x has 100 -> 80 and
# 300 -> 200 primitives (-30 %), y 50 -> 45 (-10 %); (2 * -30 - 10) / 3 = -23.3 %.
mkdir -p "$folder/sets"
jq -n '{plan: {title: "Sets", pipelines: ["3dgs"], variants: [{name: "off"}, {name: "on"}],
        scenes: [{name: "a", data_set: "x"}, {name: "c", data_set: "y"}, {name: "b", data_set: "x"}]},
    runs: [["a", 100, 80, 30, 31], ["b", 300, 200, 20, 20.5], ["c", 50, 45, 25, 24] | . as $r | ("off", "on") |
        {scene: $r[0], pipeline: "3dgs", variant: ., seed: 0, folder: "none",
         summary: {gaussians: (if . == "off" then $r[1] else $r[2] end), train_seconds: 10,
                   test: {psnr: (if . == "off" then $r[3] else $r[4] end)}}}]}' >"$folder/sets/results.json"
"$SPAREGS_PROGRAM" report "$folder/sets" --pictures 0 --maps 0 >/dev/null
expect() { grep -qE "$1" "$folder/sets/report.md" || { echo "FAIL: no $1 in:"; cat "$folder/sets/report.md"; exit 1; }; }
expect '^\| 3dgs \| x \| 10.0 \| 200 \| 25.00 .*\| -30.0 % \| \+0.75 '
expect '^\| 3dgs \| y \| 10.0 \| 50 .*\| -10.0 % \| -1.00 '
expect '^\| 3dgs \| scene-weighted mean .*\| \+0.0 % \| -23.3 % \| \+0.17 '
expect '^\| average .*\| -23.3 % '
if grep -q LPIPS "$folder/sets/report.md"; then echo "FAIL: LPIPS without weights"; exit 1; fi
# Variants that are not off and on are in the tables too.
mkdir "$folder/one"
jq '.plan.variants = [{name: "x"}] | .runs = [.runs[] | select(.variant == "on") | .variant = "x" | .summary.seconds = {spare: 1}]' \
    "$folder/sets/results.json" >"$folder/one/results.json"
"$SPAREGS_PROGRAM" report "$folder/one" --pictures 0 --maps 0 >/dev/null
for row in '^\| x \| 108 \| 10.0 ' '^\| 3dgs \| x \|.* 10.00 '; do
    grep -qE "$row" "$folder/one/report.md" || { echo "FAIL: no $row in:"; cat "$folder/one/report.md"; exit 1; }
done
if grep -q "Base pipelines" "$folder/one/report.md"; then echo "FAIL: a table of off and on"; exit 1; fi
# Several seeds: mean and standard deviation (n - 1). Figures by hand: 28.1, 28.4 and 29.3 have the mean 28.6 and the
# deviation sqrt((0.25 + 0.04 + 0.49) / 2) = 0.62; 10 and 13 have 11.5 and 2.1. The means over the scenes of variant x,
# 19.05, 19.7 and 20.15, have 19.63 and 0.55.
mkdir "$folder/seeds"
jq -n '{plan: {pipelines: ["3dgs"], variants: [{name: "off"}, {name: "on"}, {name: "x"}], seeds: [0, 3, 4], scenes: [{name: "a"}, {name: "b"}]},
    runs: [["off", "a", 0, 28.1, 10], ["off", "a", 3, 28.4, 10], ["off", "a", 4, 29.3, 10], ["on", "a", 4, 29, 10], ["on", "a", 0, 29, 13], ["off", "b", 0, 10, 7],
        ["x", "a", 0, 28.1, 10], ["x", "a", 3, 28.4, 10], ["x", "a", 4, 29.3, 10], ["x", "b", 0, 10, 7], ["x", "b", 3, 11, 7], ["x", "b", 4, 11, 7] | . as $r |
        {scene: $r[1], pipeline: "3dgs", variant: $r[0], seed: $r[2], folder: "none",
         summary: {gaussians: 100, train_seconds: $r[4], test: {psnr: $r[3]}}}]}' >"$folder/seeds/results.json"
"$SPAREGS_PROGRAM" report "$folder/seeds" --pictures 0 --maps 0 >/dev/null
for row in '^\| pipeline \| scene \| seeds \| base s ' '^\| 3dgs \| a \| 3, 2 \| 10.0 ± 0.0 \| 100 ± 0 \| 28.60 ± 0.62 \|.*\| 11.5 ± 2.1 \| 100 ± 0 \| 29.00 ± 0.00 \|.*\| \+15.0 % \| \+0.0 % \| \+0.40 ' \
    '^\| 3dgs \| b \| 1, 0 \| 7.0 \| 100 \| 10.00 ' '^\| 3dgs \| mean \|  \|.*\| \+15.0 % ' '^\| variant \| seeds \| N ' \
    '^\| x \| 3 \| 100 ± 0 \| 8.5 ± 0.0 \| - \| 19.63 ± 0.55 ' '^\| off \| 3 \| 100 \| 9.2 \| - \| 23.95 '; do
    grep -qE "$row" "$folder/seeds/report.md" || { echo "FAIL: no $row in:"; cat "$folder/seeds/report.md"; exit 1; }
done
if grep -q '±' "$folder/sets/report.md"; then echo "FAIL: a deviation of one seed"; exit 1; fi
# LPIPS where the runs have it: +0.05 on x, 0 on y.
jq '.runs[].summary.test.lpips = 0.2 | (.runs[] | select(.scene != "c" and .variant == "on")).summary.test.lpips = 0.25 |
    .plan.variants += [{name: "t"}] | .runs += [.runs[] | select(.variant == "on") | .variant = "t"]' "$folder/sets/results.json" >"$folder/sets/lpips.json"
mv "$folder/sets/lpips.json" "$folder/sets/results.json"
"$SPAREGS_PROGRAM" report "$folder/sets" --pictures 0 --maps 0 >/dev/null
expect '^\| pipeline .*\| base sharpness \| base LPIPS \|.*\| ours LPIPS \|.*\| Δ LPIPS \|$'
expect '^\| 3dgs \| x \|.*\| 0.2000 \|.*\| 0.2500 \|.*\| \+0.0500 \|$'
expect '^\| 3dgs \| scene-weighted mean .*\| \+0.0333 \|$'
expect '^\| variant .*\| sharpness \| LPIPS \|.*\| Δ LPIPS \|$'
expect '^\| t .*\| 0.2333 \|.*\| \+0.0333 \|$'
grep -q 'new Option(.LPIPS' "$folder/sets/report.html"
# FLIP and sharpness: in the tables, in the CSV and on the page, as in the summaries.
summary=$folder/out/runs/room/mip/on/seed_0/summary.json
flip=$(jq .test.flip "$summary"); sharpness=$(jq .test.sharpness "$summary")
grep -qF "| base FLIP | base sharpness |" "$folder/out/report.md"
grep -F "| mip | room |" "$folder/out/report.md" | grep -qF "$(printf '| %.4f | %.3f | ' "$flip" "$sharpness")" ||
    { echo "FAIL: no FLIP of $flip and sharpness of $sharpness:"; cat "$folder/out/report.md"; exit 1; }
grep -qE '^\| variant \|.* FLIP \| sharpness \|.* Δ FLIP \| Δ sharpness \|$' "$folder/out/report.md"
awk -F, -v flip="$flip" -v sharpness="$sharpness" 'NR == 1 { for (i = 1; i <= NF; ++i) at[$i] = i }
    $2 == "mip" && $3 == "on" { found = ($at["test_flip"] - flip) ^ 2 + ($at["test_sharpness"] - sharpness) ^ 2 < 1e-11 && $at["train_flip"] > 0 }
    END { exit !found }' "$folder/out/results.csv" || { echo "FAIL: results.csv"; cat "$folder/out/results.csv"; exit 1; }
# The page contains its data as JSON and loads nothing from the network.
sed -n 's/.*<script type="application\/json" id="data">\(.*\)<\/script>$/\1/p' "$folder/out/report.html" >"$folder/data.json"
[ "$(jq '.runs | length' "$folder/data.json")" = 5 ]
[ "$(jq '[.runs[] | select(.variant == "on") | .regions[0].cells | length > 10] | all' "$folder/data.json")" = true ]
jq -r '.pictures[0].photo' "$folder/data.json" | sed 's/^data:image.png;base64,//' | base64 -d | head -c 4 | grep -q PNG
jq -e --argjson flip "$flip" '.runs[] | select(.pipeline == "mip" and .variant == "on") | (.test.flip - $flip | . < 1e-5 and . > -1e-5) and .test.sharpness > 0' \
    "$folder/data.json" >/dev/null
jq -e '.pictures[0] | .flip > 0 and .flip < 1 and .sharpness > 0 and .identical == false' "$folder/data.json" >/dev/null
if grep -oE '(src|href)="?https?://[^" ]*' "$folder/out/report.html"; then echo "FAIL: the page uses the network"; exit 1; fi

# The regions of an update hold all primitives, and their quotas add up to the budget.
"$SPAREGS_PROGRAM" explain "$lost" --top 100000 --json >"$folder/explain.json"
jq -e '([.regions[].count] | add) as $n | ([.regions[].quota] | add) as $q | $n > 100 and ($q / $n - 1 | fabs) < 1e-3' "$folder/explain.json" >/dev/null
point=$(jq -r '.regions[0].center | map(tostring) | join(",")' "$folder/explain.json")
"$SPAREGS_PROGRAM" explain "$lost" --region="$point" | grep -q 'over quota\|under quota'
if "$SPAREGS_PROGRAM" explain "$folder/out/runs/room/3dgs/off/seed_0" 2>"$folder/error"; then echo "FAIL: explained nothing"; exit 1; fi
grep -q -- "--spare on" "$folder/error"
if "$SPAREGS_PROGRAM" explain "$folder" 2>/dev/null; then echo "FAIL: explained a folder"; exit 1; fi

# A signal to the experiment, or its death, ends the training that it started, with the state saved.
plan "$room" '["3dgs"]' ', "iterations": 200000'
sed -i 's/"iterations": 50, //' "$folder/plan.json"
training=$folder/ended/runs/room/3dgs/off/seed_0
for signal in TERM KILL BOTH; do
    "$SPAREGS_PROGRAM" experiment "$folder/plan.json" -o "$folder/ended" --quiet &
    experiment=$!
    until grep -q "^100," "$training/train.csv" 2>/dev/null; do kill -0 $experiment; sleep 0.1; done
    if [ $signal = BOTH ]; then # as batch systems do
        pkill -TERM -f "$folder/ended"
    else
        kill -$signal $experiment
    fi
    status=0; wait $experiment 2>/dev/null || status=$?
    [ $status = $((128 + $(kill -l ${signal/BOTH/TERM}))) ] || { echo "FAIL: status $status after $signal"; exit 1; }
    while pgrep -f "$training" >/dev/null; do sleep 0.1; done
    [ -s "$training/checkpoint/state.bin" ] && [ "$(jq -r .stop_reason "$training/summary.json")" = signal ] ||
        { echo "FAIL: no checkpoint after $signal"; exit 1; }
    rm -r "$folder/ended"
done
echo "experiment, report and explain hold"
