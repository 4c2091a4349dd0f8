#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Plans of experiments and their results without any training: the plans in tools/experiments are valid, wrong types,
# repeated seeds and pipelines and too many runs are refused, and so is a results.json that lacks members of the report.
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"
plan=$temporary/plan.json
base="{\"scenes\": [{\"name\": \"room\", \"path\": \"$room\"}], \"pipelines\": [\"3dgs\"], \"options\": {\"iterations\": 70, \"eval\": true}}"

# plans_of_the_repository_are_valid (their scenes are not part of the repository)
for file in "$SPAREGS_SOURCE"/tools/experiments/*.json; do
    jq --arg room "$room" '.scenes[].path = $room | del(.scenes[].options.images)' "$file" >"$plan"
    run 0 experiment "$plan" --check
    check "${file##*/} has all runs" test "$(wc -l <"$temporary/stdout")" -eq "$(jq \
        '(.scenes | length) * (.pipelines | length) * ((.variants // [1, 2]) | length) * (.seeds | length)' "$file")"
done

# seeds_are_used_as_given
jq '.seeds = [7, 0, 2147483647]' <<<"$base" >"$plan"
run 0 experiment "$plan" -o "$temporary/out" --check
for seed in 7 0 2147483647; do prints "/on/seed_$seed"; done

refused() { # MESSAGE CHANGE
    jq -c "$2" <<<"$base" >"$plan"
    run 1 experiment "$plan" --check
    one_line
    reports "plan.json: $1"
}
seeds='"seeds" must be a list of distinct integers from 0 to 2147483647'
refused "$seeds" '.seeds = ["1", "2", "3"]'
refused "$seeds" '.seeds = [1.5]'
refused "$seeds" '.seeds = [4294967297]'
refused "$seeds" '.seeds = [0, 1, 0]'
refused "$seeds" '.seeds = 3'
refused '"options" must be an object' '.options = ["--iterations", "100"]'
refused 'scene room: "options" must be an object' '.scenes[0].options = ["--iterations", "100"]'
refused 'variant on: "options" must be an object' '.variants = [{name: "on", options: "--iterations"}]'
refused "unknown key 'option' (did you mean 'options'?)" '.variants = [{name: "tau", option: {spare_tau_alpha: 0.1}}]'
refused '"variants" must be a non-empty list' '.variants = {name: "on"}'
refused '"pipelines" must be a list of distinct names' '.pipelines = ["3dgs", "mip", "3dgs"]'
refused '"pipelines" must be a list of distinct names' '.pipelines = ["3dgs", 1]'
refused '"pipelines" of variant on must be a list of distinct names' '.variants = [{name: "on", pipelines: "3dgs"}]'
refused 'the plan contains no runs' '.variants = [{name: "on", pipelines: ["mip"]}]'
refused 'the plan has more than 10000 runs; divide it' '.seeds = [range(5001)]'
refused '"seeds" has 10001 entries; the limit is 10000' '.seeds = [range(10001)]'

# control_characters_of_a_plan_do_not_reach_the_terminal
refused "scene room, pipeline 3dgs, variant off: --spare: invalid value 'a?b?[31m'" '.options.spare = "a\nb\u001b[31m" | .variants = [{name: "off"}]'
# null_is_no_value
refused "expected a number, string, list or boolean for option 'iterations'" '.options.iterations = null'
refused "expected a number, string, list or boolean for option 'spare_grid'" '.variants = [{name: "on", options: {spare_grid: null}}]'
refused "expected true or false for option 'eval'" '.options.eval = null'
refused "expected true or false for option 'eval'" '.scenes[0].options = {eval: null}'

# '-' and '_' in the name of an option are the same
refused "\"options\" names an option twice, with '-' and with '_'" '.options += {spare_grid: 8, "spare-grid": 16}'
refused "variant on: \"options\" names an option twice" '.variants = [{name: "on", options: {"sh-degree": 1, sh_degree: 2}}]'

# options_without_effect_on_results_may_change, and a spelling; numbers are compared as they are stored
settings=$temporary/settings/runs/room/3dgs/on/seed_0
mkdir -p "$settings"
changed() { # STATUS STORED-OPTIONS OPTIONS
    jq -n "{scene: \"$room\", pipeline: \"3dgs\", seed: 0, options: ({iterations: 70, eval: true} + $2)}" >"$settings/experiment.json"
    jq ".variants = [{name: \"on\"}] | .options += $3" <<<"$base" >"$plan"
    run "$1" experiment "$plan" -o "$temporary/settings" --check
}
changed 0 '{max_memory: "2G", time_limit: "1h"}' '{max_memory: "3G"}'
changed 0 '{"max-memory": "2G", "sh-degree": 1}' '{max_memory: "3G", sh_degree: 1}'
changed 0 '{spare_tau_alpha: 0.0500000001}' '{spare_tau_alpha: 0.05000000012}'
changed 1 '{spare_tau_alpha: 0.05}' '{"spare-tau-alpha": 0.06}'
reports "was trained with spare_tau_alpha 0.05"

# options_of_other_pipelines_do_not_belong_to_a_run: a pipeline is added with its option; old files name the option too
jq -n "{scene: \"$room\", pipeline: \"3dgs\", seed: 0, options: {iterations: 70, eval: true}}" >"$settings/experiment.json"
jq '.variants = [{name: "on"}] | .pipelines += ["mcmc"] | .options["mcmc-noise"] = 1e5' <<<"$base" >"$plan"
run 0 experiment "$plan" -o "$temporary/settings" --check
jq '.options.mcmc_noise = 2e5' "$settings/experiment.json" >"$temporary/old.json" && mv "$temporary/old.json" "$settings/experiment.json"
run 0 experiment "$plan" -o "$temporary/settings" --check
refused 'an option of a scene has no effect on any of its runs; remove' '.scenes[0].options = {mcmc_noise: 1e5}'

# the_folder_of_photos_can_be_an_option_of_the_plan_or_of_a_variant
mkdir "$temporary/small"
cp -r "$room/sparse" "$temporary/small/"
cp -r "$room/images" "$temporary/small/images_4"
refused_folder() {
    jq ".scenes[0].path = \"$temporary/small\" | $1" <<<"$base" >"$plan"
    run 1 experiment "$plan" --check
    reports "images"
}
refused_folder .
refused_folder '.options.images = "images_2"'
for change in '.options.images = "images_4"' '.variants = [{name: "on", options: {images: "images_4"}}]'; do
    jq ".scenes[0].path = \"$temporary/small\" | $change" <<<"$base" >"$plan"
    run 0 experiment "$plan" --check
done

# runs_that_write_one_trace
jq '.options.trace = "t.json" | .seeds = [0, 1]' <<<"$base" >"$plan"
run 0 experiment "$plan" --check
reports "several runs write the trace '$temporary/t.json'; the last one remains"

# paths_are_relative_to_the_plan and input files exist
missing() { # OPTION PATH CHANGE
    refused "option '$1': $temporary/$2 does not exist; paths are relative to the plan" "$3"
}
missing init models/a.ply '.options.init = "models/a.ply"'
missing lpips vgg.bin '.variants = [{name: "on", options: {lpips: "vgg.bin"}}]'
missing region blocks.json ".options += {init: \"$room\", region: \"blocks.json:1\"}"
missing weights net.pth '.post = [{prune: {method: "rap", weights: "net.pth"}}]'
mkdir "$temporary/models"
touch "$temporary/models/a.ply" "$temporary/vgg.bin"
jq '.options += {init: "models/a.ply", lpips: "vgg.bin", region: "-1,-1,-1,1,1,1"}' <<<"$base" >"$plan"
run 0 experiment "$plan" --check

# the_report_names_the_member
mkdir "$temporary/results"
results='{"plan": {"pipelines": ["3dgs"]}, "runs": [{"scene": "a", "pipeline": "3dgs", "variant": "on", "seed": 0, "folder": "none", "summary": {}}]}'
report() { # STATUS CHANGE
    jq "$2" <<<"$results" >"$temporary/results/results.json"
    run "$1" report "$temporary/results" --pictures 1 "${@:3}"
}
# A picture that fails is a warning, the folders of the files are created, and a title cannot end or extend the script.
report 0 '.plan.title = "</script><!--<script>"' --markdown "$temporary/sub/text/x.md" --html "$temporary/sub/page/x.html"
reports "warning: $temporary/results/none: no picture of this run: $temporary/results/none: no such model;"
reports "; --pictures 0 omits the pictures"
check no_error_is_printed bash -c "! grep -v '^sparegs: warning: ' '$temporary/stderr'"
check the_tables_are_there test -s "$temporary/sub/text/x.md"
sed -n 's/.*<script type="application\/json" id="data">\(.*\)<\/script>$/\1/p' "$temporary/sub/page/x.html" >"$temporary/data.json"
check the_data_have_no_tag bash -c "! grep -F '<' '$temporary/data.json'"
json "$temporary/data.json" '.title == "</script><!--<script>"'
# the_names_of_folders_are_refused
for option in --markdown --html; do
    report 1 . "$option" "$temporary/folder/"
    one_line
    reports "folder/: is the name of a folder; specify the name of a file"
    check no_file_is_written test ! -e "$temporary/folder" -a ! -e "$temporary/results/report.md"
done
# a_relative_scene_is_in_the_folder_of_the_experiment
mkdir -p "$temporary/results/moved/point_cloud/iteration_1"
touch "$temporary/results/moved/point_cloud/iteration_1/point_cloud.ply"
echo '{"scene": "scenes/a", "options": {}}' >"$temporary/results/moved/config.json"
report 0 '.runs[0].folder = "moved"'
reports "results/moved: no picture of this run: scenes/a: no such folder; run the report in the folder in which the experiment ran;"
for case in 'plan.pipelines[0] must be a string:.plan.pipelines = [1]' 'plan.pipelines must be a list:.plan.pipelines = "3dgs"' \
    'runs[0].scene must be a string:.runs = [{}]' 'runs[1].scene must be a string:.runs[1] = 5' \
    'runs[0].pipeline must be a string:.runs[0].pipeline = null' 'runs[0].variant must be a string:del(.runs[0].variant)' \
    'runs[0].folder must be a string:.runs[0].folder = 1' 'runs[0].summary must be an object:.runs[0].summary = []'; do
    report 1 "${case#*:}"
    one_line
    reports "results/results.json: ${case%%:*}"
done
report 1 '.runs = []'
reports "results.json: no run is complete yet"
printf '{\n"plan": {' >"$temporary/results/results.json"
run 1 report "$temporary/results"
one_line
reports "results/results.json: line 2: "
run 1 report "$temporary"
one_line
reports "results.json: cannot be read: No such file or directory; DIR must be the folder of an experiment"
finish
