#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Steps of an experiment after training: bad steps are refused before the first run, results are those of the commands
# they call, complete points are not repeated, tables and page contain them, BD figures are those of `sparegs bd`.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
plan=$temporary/plan.json out=$temporary/out

write_plan() { # POST
    cat >"$plan" <<PLAN
{"title": "Post", "scenes": [{"name": "room", "path": "$room"}], "pipelines": ["3dgs"],
 "options": {"iterations": 50, "downscale": 8, "eval": true, "threads": 2}, "post": $1}
PLAN
}
refused() { # MESSAGE POST
    write_plan "$2"
    run 1 experiment "$plan" -o "$out"
    reports "plan.json: $1"
    check a_single_line test "$(wc -l <"$temporary/stderr")" = 1
    check nothing_ran test ! -e "$out/runs"
}
refused '"post" must be a list of steps' '{}'
refused 'post: the name of step 1 must be a text' '[{"name": 5, "prune": {"method": "refine"}}]'
refused 'post: each step is an object with either "prune" or "compress"' '[{"name": "x"}]'
refused 'post: each step is an object with either "prune" or "compress"' '[{"prune": {"method": "refine"}, "compress": {"method": "sog"}}]'
refused 'post: prune: method: is missing' '[{"prune": {}}]'
refused 'post: prune: method: unknown word' '[{"prune": {"method": "refined"}}]'
refused 'post: prune: ratios: unknown option' '[{"prune": {"method": "refine", "ratios": 0.5}}]'
refused 'post: prune: ratio: expected shares from 0 to less than 1' '[{"prune": {"method": "refine", "ratio": [0.5, 1]}}]'
refused 'post: prune: ratio: the list is empty' '[{"prune": {"method": "refine", "ratio": []}}]'
refused 'post: prune: ratio: two points of the list are the same' '[{"prune": {"method": "refine", "ratio": [0.5, 0.7, 0.5]}}]'
refused 'post: prune: output: is set by the experiment' '[{"prune": {"method": "refine", "output": "x"}}]'
refused 'post: prune: finetune: out of range' '[{"prune": {"method": "refine", "finetune": -1}}]'
refused 'post: prune: fisher_downscale: has no effect with this method' '[{"prune": {"method": "refine", "fisher_downscale": 2}}]'
refused 'post: prune: images: expected a number or a string' '[{"prune": {"method": "refine", "images": true}}]'
refused 'post: prune: weights: rap requires the file of its authors' '[{"prune": {"method": "rap"}}]'
refused 'post: prune: variants: unknown variant' '[{"prune": {"method": "refine"}, "variants": ["onn"]}]'
refused 'post: prune: varaints: unknown key' '[{"prune": {"method": "refine"}, "varaints": ["on"]}]'
refused 'post: compress: preset: unknown word' '[{"compress": {"method": "ghap", "preset": "spare-4"}}]'
refused 'post: compress: keep: makes all presets equal; set "preset" to one of them' '[{"compress": {"method": "ghap", "keep": 0.5}}]'
refused 'post: compress: vq-ratio: makes all presets equal' '[{"compress": {"method": "lightgaussian", "vq-ratio": 0.5, "preset": ["spare-1", "spare-2"]}}]'
refused "post: step 'prune-refine' is for the variants 'off' and 'on', which the plan does not have" \
    '[{"prune": {"method": "refine"}}], "variants": [{"name": "a"}, {"name": "b"}]'
refused "post: step 'prune-refine' has no run: its variants have no pipeline of the plan; set \"variants\" of the step, or remove it" \
    '[{"prune": {"method": "refine"}, "variants": ["x"]}], "variants": [{"name": "on"}, {"name": "x", "pipelines": ["mip"]}]'
write_plan '[{"prune": {"method": "refine"}}]'
jq '.options.eval = false' "$plan" >"$temporary/unheld.json"
run 1 experiment "$temporary/unheld.json" --check
one_line
reports "post: scene 'room' has no held-out images to compare; set the option \"eval\": true"
jq '.variants = [{name: "on", options: {"test-every": 4}}]' "$temporary/unheld.json" >"$temporary/held.json"
run 0 experiment "$temporary/held.json" --check
refused "post: name: prune-refine: two steps have this name" '[{"prune": {"method": "refine"}}, {"prune": {"method": "refine", "finetune": 5}}]'
refused "post: name: a/b: use letters" '[{"prune": {"method": "refine"}, "name": "a/b"}]'

# all_points_of_all_steps_have_results
steps='[{"prune": {"method": "refine"}}, {"prune": {"method": "pup", "ratio": [0.2, 0.6], "fisher_downscale": 2}, "name": "pup", "variants": ["on"]},
        {"compress": {"method": "ghap", "finetune": 10}}]'
write_plan '[{"compress": {"method": "ghap", "keep": 0.5, "preset": "spare-1"}}, {"compress": {"method": "mesongs", "vq_steps": 9}}]'
run 0 experiment "$plan" --check
write_plan "$steps"
run 0 experiment "$plan" -o "$out" --quiet
json "$out/results.json" '[.runs[].post | length] == [6, 8]'
json "$out/results.json" '[.runs[0].post[] | .step + " " + .point] == ["prune-refine 0.3", "prune-refine 0.5", "prune-refine 0.7",
    "compress-ghap spare-1", "compress-ghap spare-2", "compress-ghap spare-3"]'
check post_csv_has_a_row_for_each test "$(wc -l <"$out/post.csv")" -eq 15

# results_are_those_of_the_commands
model=$out/runs/room/3dgs/on/seed_0
run 0 prune "$model" "$room" -o "$temporary/by_hand.ply" --method refine --ratio 0.5 --quiet
run 0 eval "$temporary/by_hand.ply" "$room" --run "$model" --json
point=$(jq '.runs[1].post[] | select(.step == "prune-refine" and .point == "0.5")' "$out/results.json")
check same_quality test "$(jq .mean.psnr "$temporary/stdout")" = "$(jq .test.psnr <<<"$point")"
check same_size test "$(jq .bytes <<<"$point")" = "$(stat -c %s "$temporary/by_hand.ply")"
check models_are_removed test -z "$(find "$model/post" -name '*.ply')"
check compressed_files_stay test "$(find "$model/post" -name '*.bin' | wc -l)" -eq 3

# complete_points_are_not_repeated, a lost one is, and so is one with other options
touch -d 2001-01-01 "$model"/post/*/*.json
rm "$model/post/prune-refine/0.5.json"
write_plan "${steps/\"method\": \"ghap\"/\"method\": \"ghap\", \"preset\": [\"spare-2\"]}"
run 0 experiment "$plan" -o "$out" --quiet
check others_are_kept test "$(find "$model/post" -name '*.json' -newermt 2002-01-01 -printf '%f ')" = '0.5.json '
check lost_is_repeated test "$(jq .test.psnr "$model/post/prune-refine/0.5.json")" = "$(jq .test.psnr <<<"$point")"
write_plan "${steps/\"fisher_downscale\": 2/\"fisher_downscale\": 1}"
run 0 experiment "$plan" -o "$out" --quiet
check other_options_are_repeated test "$(find "$model/post/pup" -name '*.json' -newermt 2002-01-01 | wc -l)" -eq 2
json "$out/results.json" '[.runs[].post | length] == [6, 8]'

# a_point_of_many_digits_has_a_result and is not repeated
write_plan "${steps/\"fisher_downscale\": 2/\"fisher_downscale\": 1}"
jq '.post += [{prune: {method: "refine", ratio: 0.60000000001}, name: "digits", variants: ["on"]}]' "$plan" >"$plan.2"
for time in first second; do
    run 0 experiment "$plan.2" -o "$out"
    check "result_of_the_$time" test "$(jq '[.runs[].post[] | select(.step == "digits")] | length' "$out/results.json")" = 1
done
check the_point_is_not_repeated bash -c "! grep -F 'digits, 0.6' '$temporary/stderr'"
run 0 experiment "$plan" -o "$out" --quiet

# lpips_has_the_input_range_of_the_run: without pruning, LPIPS is that of the run; results with another range are repeated
"$SPAREGS_BUILD/tests/test_lpips" alex "$temporary/alex.bin"
write_plan '[{"prune": {"method": "refine", "ratio": 0}}]'
jq --arg file "$temporary/alex.bin" '.variants = [{name: "off"}] |
    .options += {spare: "off", iterations: 20, lpips: $file, lpips_input: "signed"}' "$plan" >"$plan.lpips"
lpips=$temporary/lpips/runs/room/3dgs/off/seed_0
result=$lpips/post/prune-refine/0.json
for before in none same '.lpips_input = "unit"' 'del(.lpips_input)'; do
    case $before in
        none) ;;
        same) touch -d 2001-01-01 "$result" ;;
        *)
            jq "($before) | .test.lpips = 0.5" "$result" >"$temporary/other.json"
            mv "$temporary/other.json" "$result"
            ;;
    esac
    run 0 experiment "$plan.lpips" -o "$temporary/lpips" --quiet
    json "$result" ".lpips_input == \"signed\" and (.test.lpips - $(jq .test.lpips "$lpips/summary.json") | fabs) < 1e-6"
    if [ "$before" = same ]; then
        check the_same_range_is_not_repeated test ! "$result" -nt "$plan.lpips"
    fi
done
json "$temporary/lpips/results.json" '.runs[0].post[0].lpips_input == "signed"'

# tables_have_the_bd_figures
run 0 report "$out" --pictures 0 --maps 0
for k in 0 1; do
    jq -r ".runs[$k].post[] | select(.step == \"prune-refine\") | [.bytes, .test.psnr] | @csv" "$out/results.json" |
        { echo size,psnr; cat; } >"$temporary/curve_$k.csv"
done
run 0 bd "$temporary/curve_0.csv" "$temporary/curve_1.csv" --json
rate=$(jq -r 'if .bd_rate_percent == null then "N/A" else .bd_rate_percent end' "$temporary/stdout")
[ "$rate" = N/A ] || rate=$(printf '%+.2f %%' "$rate")
check table_has_the_bd_rate bash -c "grep -F '| 3dgs | prune-refine | room | all |' '$out/report.md' | grep -qF '| $rate |'"
check table_has_the_size bash -c "grep -F '| 3dgs | prune-refine | room | 0.5 |' '$out/report.md' | grep -qF \"| \$(jq -r '.runs[1].post[] | select(.step == \"prune-refine\" and .point == \"0.5\") | .bytes / 1048576 | . * 100 | round / 100' '$out/results.json')\""
check compression_has_a_table grep -q '^## Compression of models without and with SPARE-GS' "$out/report.md"
sed -n 's/.*<script type="application\/json" id="data">\(.*\)<\/script>$/\1/p' "$out/report.html" >"$temporary/data.json"
json "$temporary/data.json" '[.runs[].post | length] == [6, 8]'

# Data sets by hand: two scenes, sizes halved at equal quality: BD-rate -50 %.
mkdir "$temporary/hand"
jq -n '{plan: {pipelines: ["3dgs"], variants: [{name: "off"}, {name: "on"}],
        scenes: [{name: "a", data_set: "x"}, {name: "b", data_set: "x"}]},
    runs: [("a", "b") as $scene | ("off", "on") as $variant | (if $variant == "on" then 0.5 else 1 end) as $f |
        {scene: $scene, pipeline: "3dgs", variant: $variant, seed: 0, folder: "none", summary: {gaussians: 1, train_seconds: 1},
         post: [["0.3", 4, 30], ["0.5", 2, 28], ["0.7", 1, 24] | . as $p | {step: "prune-refine", kind: "prune", point: $p[0],
             bytes: ($p[1] * $f * 1048576), seconds: ($p[1] * $f), test: {psnr: $p[2], ssim: 0.9, flip: 0.2, lpips: 0.3}}]}]}' \
    >"$temporary/hand/results.json"
run 0 report "$temporary/hand" --pictures 0 --maps 0
check figures_by_hand grep -qF '| 3dgs | prune-refine | x | all |  |  |  |  |  |  |  |  |  |  | -50.0 % | -50.00 % |' "$temporary/hand/report.md"
# 100 points of a step: a row for each, all in the last one (seconds 2 to 101 for variant off, half for on).
mkdir "$temporary/many"
jq '.runs[].post |= (.[0] as $first | [range(1; 101) | $first + {point: "\(.)", bytes: ($first.bytes * .), seconds: ($first.seconds / 4 * (. + 1)),
    test: ($first.test + {psnr: (20 + . / 10)})}])' "$temporary/hand/results.json" >"$temporary/many/results.json"
run 0 report "$temporary/many" --pictures 0 --maps 0
check a_row_for_each_point test "$(grep -cE '^\| 3dgs \| prune-refine \| x \| [0-9]+ \|' "$temporary/many/report.md")" = 100
check all_points_count grep -qF '| 3dgs | prune-refine | x | all |  |  |  |  |  |  |  |  |  |  | -50.0 % | -50.00 % |' "$temporary/many/report.md"
# A scene without a result at one point does not count: with b at other points the means form no curve.
jq '(.runs[] | select(.scene == "b")) |= (.post |= map(select(.point != "0.5")) | .post[].bytes *= 100 | .post[].test.psnr += 3)' \
    "$temporary/hand/results.json" >"$temporary/hand/partial.json"
mv "$temporary/hand/partial.json" "$temporary/hand/results.json"
run 0 report "$temporary/hand" --pictures 0 --maps 0
check only_a_counts grep -qF '| 3dgs | prune-refine | x | 0.3 | 4.00 | 4.00 | 30.00 |' "$temporary/hand/report.md"
check bd_of_a_alone grep -qF '| 3dgs | prune-refine | x | all |  |  |  |  |  |  |  |  |  |  | -50.0 % | -50.00 % |' "$temporary/hand/report.md"
# A variant that one of two scenes has is compared with variant off of this scene.
jq '.plan.variants += [{name: "t"}] | .runs[].summary.gaussians = 100 | (.runs[] | select(.scene == "b")).summary.gaussians = 1000 |
    .runs += [.runs[0] | .variant = "t" | .summary.gaussians = 80]' "$temporary/hand/results.json" >"$temporary/hand/variant.json"
mv "$temporary/hand/variant.json" "$temporary/hand/results.json"
run 0 report "$temporary/hand" --pictures 0 --maps 0
check variant_of_one_scene grep -qE '^\| t \| 80 \| .*\| -20.0 % \| \+0.0 % \|' "$temporary/hand/report.md"
check lpips_replaces_flip grep -qF '| base SSIM | base LPIPS |' "$temporary/hand/report.md"
# Results without a counterpart have a table: those of variant t, and those of variant on if off has none.
check single_variant_has_rows grep -qF '| 3dgs | t | prune-refine | a | 0.5 | 2.00 | 2.00 | 28.00 | 0.9000 | 0.3000 |' "$temporary/hand/report.md"
check pairs_are_not_repeated bash -c "! grep -qE '^[|] 3dgs [|] o(n|ff) [|] prune-refine' '$temporary/hand/report.md'"
jq '(.runs[] | select(.variant == "off")).post = []' "$temporary/hand/results.json" >"$temporary/hand/single.json"
mv "$temporary/hand/single.json" "$temporary/hand/results.json"
run 0 report "$temporary/hand" --pictures 0 --maps 0
check step_of_one_variant grep -qF '| 3dgs | on | prune-refine | a | 0.3 | 2.00 | 2.00 | 30.00 |' "$temporary/hand/report.md"

finish
