#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# A walk over the option tables of all commands (help --json). An option with conditions is refused by name if one of them is
# not met, and accepted if all are. Any other option must be in the list below: a new option needs a condition or an entry.
set -u
# shellcheck source-path=SCRIPTDIR source=../cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"

run 0 help --json
cp "$temporary/stdout" "$temporary/tables.json"
json "$temporary/tables.json" '[.commands[].options[].kind] | all(type == "string")'

# One line per case: command, option, index of the condition that is not met (-1: all are met), arguments.
jq -r '
    def words: split("|") | map(split(",")) | add | map(select(. != "on" and . != "all"));
    def value:
        if .kind == "choice" or .kind == "set" then (.argument | words | map(select(. != "off"))[0])
        elif .minimum != null then (if .minimum <= 1 and .maximum >= 1 then 1 else .minimum end)
        elif .argument == "NEAR:FAR" then "1:2"
        else "x" end | tostring;
    def given: if .kind == "flag" then ["--" + .name] else ["--" + .name, value] end;
    def met($rows): split("|")[0] | split("=") as $at | if ($at | length) == 2 then ["--" + $at[0], $at[1]]
        else $rows[] | select(.name == $at[0]) | given end;
    def unmet($rows): split("|") | map(split("=")) | map(select(length == 2)) as $pairs
        | [$pairs[][0]] | unique | map(. as $name | ($rows[] | select(.name == $name) | .argument | words)
            - [$pairs[] | select(.[0] == $name) | .[1]] | ["--" + $name, .[0]]) | add // [];
    .commands[] | .command as $command | .options as $rows | $rows[] | select(.needs) | . as $option
    | (.needs | split("&")) as $parts | range(-1; $parts | length) as $skipped
    | ($option | given) + ([range($parts | length) as $k | $parts[$k] | if $k == $skipped then unmet($rows) else met($rows) end]
        | add) | [$command, $option.name, $skipped] + . | @tsv' "$temporary/tables.json" >"$temporary/cases"
cases=0
while IFS=$'\t' read -r -a case; do
    operands=(nowhere)
    if [ "${case[0]}" != train ]; then operands=(nowhere nowhere_else); fi
    last_command="sparegs ${case[0]} ${operands[*]} ${case[*]:3}"
    status=0
    (cd "$temporary" && "$program" "${case[0]}" "${operands[@]}" "${case[@]:3}" >stdout 2>stderr </dev/null) || status=$?
    if [ "${case[2]}" = -1 ]; then
        check is_accepted bash -c "! grep -qF -- '--${case[1]} requires' '$temporary/stderr'"
    else
        check is_a_usage_error test "$status" -eq 2
        # The option of the condition may itself lack its condition.
        check is_refused_by_name grep -qE -- "^sparegs: --(${case[1]}|format|aov) requires --" "$temporary/stderr"
    fi
    cases=$((cases + 1))
done <"$temporary/cases"
check there_are_cases test "$cases" -gt 60

# no_other_option_is_new: these always have an effect, or the command warns or refuses depending on the data.
jq -r '.commands[] | .command as $c | .options[] | select(.needs == null) | "\($c) \(.name)"' "$temporary/tables.json" | LC_ALL=C sort >"$temporary/others"
grep -oE '^[a-z]+: .*' <<'LIST' | awk -F': ' '{ n = split($2, name, " "); for (i = 1; i <= n; ++i) print $1, name[i] }' | LC_ALL=C sort >"$temporary/known"
train: view output save-at checkpoint-every time-limit max-memory resume overwrite trace lpips eval-train
train: iterations schedule batch pipeline
train: filter optimizer sh-degree compact-box background max-gaussians init opaque exposure random-points spare ssim-weight ssim-sigma
train: images downscale eval test-every test-images masks invert-masks alpha image-cache input-colorspace train-space
train: white threads isa seed json quiet
split: output blocks margin share threads isa json quiet
merge: output seam-images seam-reference overwrite images downscale eval test-every test-images masks invert-masks
merge: alpha image-cache input-colorspace train-space white threads isa json quiet
eval: split save run lpips filter compact-box background near images downscale eval test-every test-images masks invert-masks
eval: alpha image-cache input-colorspace train-space white threads isa json quiet
render: output run video view split camera orbit spiral path-lens frames size projection deep reference filter
render: compact-box background near images downscale eval test-every test-images masks invert-masks alpha image-cache
render: input-colorspace train-space white threads isa json quiet
view: run port address token export filter compact-box background near images downscale eval test-every test-images masks
view: invert-masks alpha image-cache input-colorspace train-space white threads isa json quiet
info: images downscale eval test-every test-images masks invert-masks alpha image-cache input-colorspace train-space
info: white threads isa json quiet
compress: output run method preset filter compact-box background near images downscale eval test-every test-images masks
compress: invert-masks alpha image-cache input-colorspace train-space white threads isa seed json quiet
decompress: output threads isa json quiet
convert: filter-nan filter-box filter-sphere filter-value filter-opacity filter-floaters filter-unseen filter-slack filter-region
convert: filter-harmonics
convert: scale rotate translate antialiased input-spz-axes lod spz-version spz-axes ksplat-level sh-palette iterations lod-levels
convert: images downscale eval test-every test-images masks invert-masks alpha image-cache input-colorspace train-space
convert: white threads isa json quiet
reconstruct: output matcher camera-model cameras colmap threads isa json quiet
explain: top region json quiet
experiment: output check threads isa json quiet
prune: output run method scores filter compact-box background near images downscale eval test-every test-images masks
prune: invert-masks alpha image-cache input-colorspace train-space white threads isa seed json quiet
bd: select select-test json quiet
report: markdown html pictures maps threads isa json quiet
bench: list threads isa repeat views seed ranks json csv quiet images downscale eval test-every test-images masks
bench: invert-masks alpha image-cache input-colorspace train-space white
profile: output run view split views orbit refits repeat samples trace filter compact-box background near images downscale eval
profile: test-every test-images masks invert-masks alpha image-cache input-colorspace train-space white threads isa
profile: seed json quiet
LIST
last_command="help --json"
check every_option_has_a_condition_or_an_entry diff "$temporary/others" "$temporary/known"
echo "$cases cases of options with conditions, $(wc -l <"$temporary/others") other options"

finish
