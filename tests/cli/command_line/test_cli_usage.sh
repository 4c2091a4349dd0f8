#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The command line before any work: help, versions, usage errors (status 2) that name the remedy, and missing inputs or
# unwritable outputs (status 1).
set -euo pipefail
. "$(dirname "$0")/../cli_support.sh"

# help_lists_what_exists
run 0 help help
cp "$temporary/stdout" "$temporary/help"
run 0 help
check help_of_help_is_the_help cmp "$temporary/stdout" "$temporary/help"
for command in train eval render info reconstruct; do prints "  $command"; done
for name in --help -h; do
    run 0 help "$name"
    check help_of_help_is_the_help cmp "$temporary/stdout" "$temporary/help"
done
run 2 help --version
reports "unknown option '--version'; 'sparegs help' lists all commands"
one_line
run 0 help --json
cp "$temporary/stdout" "$temporary/help"
run 0 help help --json
check help_of_help_is_the_help cmp "$temporary/stdout" "$temporary/help"
run 0 help --json
commands=$(jq -r '.commands[].command' "$temporary/stdout")
check the_commands_are_listed grep -qx train <<<"$commands"
for command in $commands; do
    run 0 help "$command"
    prints "Usage: sparegs $command"
    case $command in
    bd | explain) ;; # one thread
    bench) prints "--threads A,B,..." ;;
    *) prints "--threads N" ;;
    esac
    cp "$temporary/stdout" "$temporary/help"
    run 0 "$command" --help
    if [ $command = render ]; then
        check texts_have_units bash -c "tr -s ' \n' ' ' <'$temporary/help' | grep -qF \"one [pixels; default: the view's]\""
        check sizes_have_units bash -c "tr -s ' \n' ' ' <'$temporary/help' | grep -qF '[bytes, KiB, MiB, GiB; default: a quarter of the memory, at least 4 GiB'"
    fi
    check help_is_the_same_both_ways cmp "$temporary/stdout" "$temporary/help"
    check help_fits_100_columns awk 'length > 100 { print; bad = 1 } END { exit bad }' "$temporary/stdout"
done
run 0 help train
for text in iterations schedule images downscale eval test-every test-images pipeline spare spare-grid spare-grid-quantile spare-tau-alpha \
    spare-eps-loss spare-eps-count spare-patience spare-interval spare-demand max-gaussians filter optimizer sh-degree \
    background masks invert-masks alpha ssim-weight ssim-sigma alpha-loss opaque input-colorspace train-space white image-cache exposure save-at checkpoint-every resume init isa seed json quiet; do
    prints "--$text"
done
# help_has_the_common_options_that_the_command_reads; the others cause a warning
run 0 help bd --json
cp "$temporary/stdout" "$temporary/bd.json"
json "$temporary/bd.json" '.command == "bd" and [.options[] | select(.group == "Common options") | .name] == ["json", "quiet"]'
run 0 bd --help --json
check help_json_is_the_same_both_ways cmp "$temporary/stdout" "$temporary/bd.json"
run 2 help bd --jsn
one_line
reports "unexpected argument '--jsn'; usage: sparegs help [COMMAND] [--json]"
run 2 help nothing --json
printf 'size,psnr\n10,20\n20,25\n40,29\n' >"$temporary/curve.csv"
run 0 bd "$temporary/curve.csv" "$temporary/curve.csv" --threads 4 --isa baseline --seed 3
for name in threads isa seed; do reports "warning: --$name has no effect on bd"; done
run 0 info "$room" --seed 3 --threads 1
reports "warning: --seed has no effect on info"
check threads_have_an_effect test "$(wc -l <"$temporary/stderr")" = 1
run 0 --version
prints "sparegs "
prints "Embree"
prints "ISA: "

# mistakes_suggest_the_nearest_name
run 2
run 2 trian
reports "did you mean 'train'?"
one_line
run 2 help rendr
reports "did you mean 'render'?"
run 2 --versoin
reports "'--version'"
run 2 train "$room" -o "$temporary/out" --itertions 3
reports "did you mean '--iterations'?"
run 2 train "$room" -o "$temporary/out" --iter 3
reports "did you mean '--iterations'?"
run 2 eval a b --splt test
reports "did you mean '--split'?"
run 2 render a b -o "$temporary/out" --format pgn
reports "exr|png"
reports "did you mean 'png'?"
# distant_names_are_not_suggested
run 2 train "$room" -o "$temporary/out" --foo
reports "unknown option '--foo'; 'sparegs help train' lists all options"
one_line
run 2 render a b -o "$temporary/out" --aov foo
reports "--aov: invalid value 'foo'; choose from all|rgba,"
one_line
run 2 paint
reports "unknown command 'paint'; 'sparegs help' lists all commands"
one_line
run 2 train "$room" -o "$temporary/out" -x
reports "-x"

# the_last_value_of_an_option_counts_with_a_warning
run 2 render "$room" --view 0001 --view=0009 --spp 1 --spp 2 --quiet --quiet --spp none
check a_warning_per_repetition test "$(grep -c 'is given more than once' "$temporary/stderr")" = 4
reports "warning: --quiet is given more than once"
reports "warning: --spp is given more than once; '2' replaces the earlier value"
reports "warning: --view is given more than once; '0009' replaces the earlier value"

run 2 train "$room" -o "$temporary/out" --image-cache 4bananas
reports "'4bananas' is not a size"

# values_out_of_range_name_option_and_range
out_of_range() {
    run 2 train "$room" -o "$temporary/out" "--$1" "$2"
    check names_option_and_value grep -qE -- "^sparegs: --$1: (invalid value )?'" "$temporary/stderr"
    reports "$3"
    one_line
}
out_of_range iterations 0 "from 1 to"
out_of_range iterations -5 "from 1 to"
out_of_range iterations 12x "whole number"
out_of_range iterations 99999999999999999999 "from 1 to"
out_of_range sh-degree 4 "from 0 to 3"
out_of_range spare-grid 1 "from 2 to 256"
out_of_range spare-grid-quantile 0.3 "from 0 to 0.25, or auto"
out_of_range ssim-weight -0.5 "from 0 to 1, or auto"
out_of_range ssim-weight automatic "from 0 to 1, or auto"
out_of_range alpha-loss auto "from 0 to 1000"
out_of_range spare-tau-alpha nan "from 0 to 1"
out_of_range spare-eps-loss 1.5 "from 0 to 1"
out_of_range background 0,0 "R,G,B"
out_of_range background 0,0,2 "from 0 to 1"
out_of_range spare bmd,rip "on|off|bmd,rap,edt"
out_of_range spare-demand x "h,v,c"
out_of_range isa sse9 "baseline|avx2|avx512"
out_of_range save-at 100,x "from 1 to"
out_of_range downscale 0 "from 1 to 64"
out_of_range threads -1 "from 0 to"
out_of_range max-gaussians -1 "from 0 to"
out_of_range test-every 1 "from 2 to"
run 2 train "$room" -o "$temporary/out" --iterations=0
reports "--iterations: '0'"

# incomplete_commands_name_the_missing_part
run 2 train
reports "SCENE"
run 2 train "$room"
reports "-o OUT"
run 2 train "$room" -o
reports "requires a value"
run 2 train "$room" -o --quiet
reports "requires a value"
run 2 train "$room" -o "$temporary/out" --json=1
reports "takes no value"
run 2 train "$room" other -o "$temporary/out"
reports "unexpected argument"
run 2 train "$room" -o "$temporary/out" --eval --test-every 4
reports "are mutually exclusive"
run 2 train "$room" -o "$temporary/out" --init model.ply --pipeline taming --taming-count 100 --taming-multiplier 2
reports "--taming-multiplier has no effect with --taming-count"
run 2 eval model.ply
run 2 render model.ply "$room"
reports "-o DIR"
run 2 render model.ply -o "$temporary/out"
reports "SCENE"
check nothing_was_written test ! -e "$temporary/out"

# missing_inputs
run 1 train "$temporary/nowhere" -o "$temporary/out" --quiet
one_line
reports "$temporary/nowhere"
check nothing_was_written test ! -e "$temporary/out"
run 1 eval "$temporary/nowhere.ply" "$room"
one_line
reports "$temporary/nowhere.ply"
run 1 train "$room" -o "$temporary/out" --init "$temporary/nope.ply" --quiet
one_line
reports "nope.ply: no such model"
run 2 train "$room" -o "$temporary/out" --pipeline taming --taming-opacity linear --filter mip
one_line
reports "--taming-opacity linear and --filter mip are mutually exclusive"
run 1 render "$temporary/nope" --camera "$temporary/nope.json" -o "$temporary/out"
one_line
for extra in '--version x' 'help train x'; do
    # shellcheck disable=SC2086
    run 2 $extra
    one_line
    reports "unexpected argument"
done
run 2 train "$room" -o "$temporary/out" --spare bmd,rpa
reports "invalid value 'rpa'"
reports "did you mean 'rap'?"
run 2 train "$room" -o "$temporary/out" --spare on,bmd
reports "--spare: 'on' cannot be combined with other words"
one_line
run 2 render "$temporary/out" "$room" -o "$temporary/out" --aov depth,all
reports "--aov: 'all' cannot be combined with other words"
mkdir "$temporary/empty"
run 1 eval "$temporary/empty" "$room"
one_line
reports "point_cloud"
run 1 render "$temporary/nowhere.ply" "$room" -o "$temporary/out"
one_line
run 1 info "$temporary/nowhere"
one_line
reports "nowhere: no such file or folder; specify a model file, a run folder or a data set"
run 1 info "$temporary/empty"
one_line

# a_run_before_its_first_save_is_named, and a scene in the folder of a run is a scene
mkdir "$temporary/unsaved"
echo '{"options": {"iterations": 7000}}' >"$temporary/unsaved/config.json"
run 1 info "$temporary/unsaved"
one_line
reports "unsaved: is a run without a saved model yet; wait for its first save"
cp -r "$room/sparse" "$room/images" "$temporary/unsaved"
run 0 info "$temporary/unsaved"
prints "type: scene"

# sizes_out_of_range_are_told_from_texts_that_are_no_sizes
for size in 1K 0 999999B 2000T; do
    run 2 train "$room" -o "$temporary/out" --max-memory $size
    one_line
    reports "--max-memory: '$size' is not a size from 1e+06 to 1e+15 bytes"
done
for size in K 1X '' 1e; do
    run 2 train "$room" -o "$temporary/out" --max-memory "$size"
    one_line
    reports "--max-memory: '$size' is not a size; write for example 500M or 4GiB"
done

# control_characters_of_arguments_do_not_reach_the_terminal
run 2 train "$room" -o "$temporary/out" --spare "$(printf 'a\nb\033[31m')"
one_line
reports "--spare: invalid value 'a?b?[31m'"
run 2 train "$room" -o "$temporary/out" "--sp$(printf '\033')"
one_line
reports "'--sp?'"

# a_model_where_a_scene_is_expected_is_named
: >"$temporary/model.spz"
run 1 train "$temporary/model.spz" -o "$temporary/out" --quiet
one_line
reports "model.spz: is a file of 3D Gaussians, not a scene; specify a scene folder or a transforms.json"
: >"$temporary/notes.txt"
run 1 train "$temporary/notes.txt" -o "$temporary/out" --quiet
one_line
reports "notes.txt: is a file, not a scene"
run 1 info "$temporary/model.spz"
one_line
reports "model.spz: "
reports "has 0 bytes; the header takes 32"

# messages_with_a_path_that_is_not_utf_8
odd="$temporary/a$(printf '\377').spz"
cp "$temporary/model.spz" "$odd"
run 1 info "$odd" --json
json "$temporary/stdout" '.error.file == null and .error.message == "has 0 bytes"'

# named_pipes_are_refused
for pipe in model.ply model.spz model cameras.json; do
    mkfifo "$temporary/pipe_$pipe"
    run 1 info "$temporary/pipe_$pipe"
    one_line
    reports "pipe_$pipe: "
done
run 1 experiment "$temporary/pipe_cameras.json" -o "$temporary/out"
one_line
reports "pipe_cameras.json: cannot be read: is not a regular file"

# errors_name_the_remedy
echo "no model" >"$temporary/text.ply"
run 1 info "$temporary/text.ply"
one_line
reports "text.ply: not a PLY file: it does not begin with 'ply'; specify another file, or rename this one with the extension of its format"
run 1 train "$room" --iterations 1 -o /proc/none/out
one_line
reports "/proc/none: cannot be created: No such file or directory; choose another folder, or check the permissions"

# unwritable_outputs
echo "not a folder" >"$temporary/file"
run 1 train "$room" -o "$temporary/file/out" --quiet
one_line
reports "$temporary/file"
run 1 train "$room" -o "$temporary/file" --quiet
one_line
check the_file_is_intact grep -qx "not a folder" "$temporary/file"
run 1 train "$room" -o /proc/sparegs --quiet
one_line

finish
