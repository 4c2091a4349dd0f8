#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Changes in the tables of a report, from results written by hand: both tables have the same means, times under different
# conditions are not compared, a damaged file of regions is a warning.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
out=$temporary/out
mkdir "$out"

# report CHANGE: of three scenes, each with variants off, on and t; on and t are equal.
#   a: 10 -> 5 s (-50 %), 100 -> 80 primitives (-20 %)    b: 100 -> 90 s (-10 %), 1000 -> 900 (-10 %)
#   c: 50 -> 60 s (+20 %), 50 -> 25 (-50 %)
report() {
    jq -n '{plan: {pipelines: ["3dgs"], variants: [{name: "off"}, {name: "on"}, {name: "t"}],
            scenes: [{name: "a"}, {name: "b"}, {name: "c"}]},
        runs: [["a", 10, 5, 100, 80], ["b", 100, 90, 1000, 900], ["c", 50, 60, 50, 25] | . as $r | ("off", "on", "t") |
            {scene: $r[0], pipeline: "3dgs", variant: ., seed: 0, folder: "run",
             summary: {threads: 2, ranks: 1, isa: "avx2", commit: "abc", test: {psnr: 30, ssim: 0.9, flip: 0.1, sharpness: 1},
                 train_seconds: (if . == "off" then $r[1] else $r[2] end), gaussians: (if . == "off" then $r[3] else $r[4] end)}}]} | '"$1" \
        >"$out/results.json"
    run 0 report "$out" --pictures 0
}
row() { check "row: $1" grep -qE "$1" "$out/report.md"; }
note() { # TEXT COUNT: in COUNT tables
    check "note: $1" test "$(grep -cF "$1" "$out/report.md")" = "$2"
}

# both_tables_have_the_mean_of_the_changes_of_the_scenes: (-50 - 10 + 20) / 3 = -13.3, (-20 - 10 - 50) / 3 = -26.7
report .
row '^\| 3dgs \| mean \|.*\| -13\.3 % \| -26\.7 % \| \+0\.00 '
row '^\| on \| .*\| -26\.7 % \| -13\.3 % \| \+0\.00 '
row '^\| t \| .*\| -26\.7 % \| -13\.3 % \| \+0\.00 '
row '^\| off \| .*\| \+0\.0 % \| \+0\.0 % \| \+0\.00 '
note 'Δ time is' 0

# so do_they_with_data_sets: x has 110 -> 95 s (-13.6 %) and 1100 -> 980 (-10.9 %), y is c;
# (2 * -13.64 + 20) / 3 = -2.4, (2 * -10.91 - 50) / 3 = -23.9
report '.plan.scenes[].data_set = "x" | .plan.scenes[2].data_set = "y"'
row '^\| 3dgs \| x \|.*\| -13\.6 % \| -10\.9 % \| \+0\.00 '
row '^\| 3dgs \| scene-weighted mean \|.*\| -2\.4 % \| -23\.9 % \| \+0\.00 '
row '^\| t \| .*\| -23\.9 % \| -2\.4 % \| \+0\.00 '

# times_under_other_conditions_are_not_compared: not in the scene, nor in a mean that contains it
for change in 'threads = 1' 'ranks = 4' 'isa = "avx512"' 'commit = "def"'; do
    report "(.runs[] | select(.scene == \"b\" and .variant == \"on\")).summary.$change"
    row '^\| 3dgs \| a \|.*\| -50\.0 % \| -20\.0 % \| '
    row '^\| 3dgs \| b \|.*\| - \| -10\.0 % \| '
    row '^\| 3dgs \| mean \|.*\| - \| -26\.7 % \| '
    row '^\| average \|.*\| - \| -26\.7 % \| '
    row '^\| on \| .*\| -26\.7 % \| - \| '
    row '^\| t \| .*\| -26\.7 % \| -13\.3 % \| '
    note "Δ time is \"-\" where the compared runs differ in: ${change%% *}." 2
done
# The runs of a scene may have other conditions than those of another scene.
report '(.runs[] | select(.scene == "b")).summary.threads = 8'
row '^\| 3dgs \| mean \|.*\| -13\.3 % \| -26\.7 % \| '
note 'Δ time is' 0
# Several differ; a run that continued under others has no comparable time either; a data set contains such a scene.
report '.plan.scenes[].data_set = "x" | .runs[0].summary += {threads: 1, commit: "def"}'
row '^\| 3dgs \| a \|.*\| - \| -20\.0 % \| '
row '^\| 3dgs \| x \|.*\| - \| -12\.6 % \| '
row '^\| t \| .*\| -12\.6 % \| - \| '
note 'Δ time is "-" where the compared runs differ in: threads, commit.' 2
report '.runs[0].sessions = [{threads: 1, isa: "avx2", commit: "abc"}, {threads: 2, isa: "avx2", commit: "abc"}]'
row '^\| 3dgs \| a \|.*\| - \| -20\.0 % \| '
row '^\| 3dgs \| b \|.*\| -10\.0 % \| -10\.0 % \| '
note 'differ in: threads.' 2

# So are those of steps after the training: 4 -> 2 s in a, 40 -> 20 s in b.
steps='.runs[] |= (.post = [{step: "s", kind: "prune", point: "0.5", bytes: 1048576, threads: 2, isa: "avx2", commit: "abc",
    seconds: ((if .scene == "b" then 10 else 1 end) * (if .variant == "off" then 4 else 2 end)), test: {psnr: 30}}])'
report "$steps"
row '^\| 3dgs \| s \| a \| all \|.*\| -50\.0 % \| '
row '^\| 3dgs \| s \| mean \| all \|.*\| -50\.0 % \| '
note 'Δ time is' 0
report "$steps | .runs[0].post[0].threads = 1"
row '^\| 3dgs \| s \| a \| all \|.*\| - \| N/A '
row '^\| 3dgs \| s \| b \| all \|.*\| -50\.0 % \| '
row '^\| 3dgs \| s \| mean \| all \|.*\| - \| N/A '
note 'differ in: threads.' 1

# changes_that_depend_on_rounding_are_reported as by bd: here from one point of 30.0005 dB and one of 30 dB
report '.runs |= map(select(.scene == "a")) | .runs[] |= (. as $run | .post = [0, 5, 10 | {step: "s", kind: "prune", point: "\(.)",
    bytes: (1048576 * (1 + .)), seconds: 1, test: {psnr: (. + (if $run.variant == "off" then 20.0005 else 30 end))}}])'
narrow='3dgs, s, a: the PSNR ranges of the curves overlap by 0.0005 dB only; BD-rate depends on the rounding of the points'
reports "warning: $narrow"
note "$narrow." 1
report '.runs |= map(select(.scene == "a")) | .runs[] |= (. as $run | .post = [0, 5, 10 | {step: "s", kind: "prune", point: "\(.)",
    bytes: (1048576 * (1 + .)), seconds: 1, test: {psnr: (. + (if $run.variant == "off" then 20.1 else 30 end))}}])'
check no_warning_of_a_wider_range test ! -s "$temporary/stderr"
note 'overlap' 0

# a_damaged_file_of_regions_is_a_warning
mkdir "$out/run"
head -c 200 /dev/zero | tr '\0' x >"$out/run/regions.bin"
report '.runs |= .[:1]'
check a_warning grep -qE "^sparegs: warning: $out/run/regions.bin: byte [0-9]+: invalid region record; .*; its region maps are omitted$" "$temporary/stderr"
check nothing_else_is_printed test "$(wc -l <"$temporary/stderr")" = 1
finish
