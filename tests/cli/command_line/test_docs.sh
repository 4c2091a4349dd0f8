#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The examples of README.md and tools/manual/*.md work. Each ```sh and ```console block runs in a temporary folder that
# holds the bundled scene, one folder per Markdown file. A block directly below the line
#     <!-- example: REASON -->
# is not run: it needs data, time, or rights that a test does not have. One below
#     <!-- slow example -->
# is run by test_cli_parts_long. For every block, run or not, the commands, their
# options, and the scripts of the repository must exist. Also checked: relative links and their anchors, options in
# running text, the length of README.md. The last part plants faults and checks that they are found.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$SPAREGS_SOURCE/tests/cli/cli_support.sh"
last_command="reading the documentation"

readme_lines=200
bin=$temporary/bin
mkdir -p "$bin"
ln -s "$program" "$bin/sparegs"

# Texts of `sparegs help COMMAND`; the checks below read them without starting a process for each option.
declare -A helps=()
for command in $("$program" help | awk '/^Commands:/ { list = 1; next } list && NF == 0 { exit } list { print $1 }'); do
    [ "$command" = help ] || helps[$command]=$("$program" help "$command")
done

# has_option COMMAND OPTION: its help lists --name or -n.
has_option() {
    local line=$'(^|\n) +'
    case $2 in
        --*) [[ ${helps[$1]} =~ $line(-[a-z],\ )?"$2"([[:space:]]|$) ]] ;;
        *) [[ ${helps[$1]} =~ $line"$2, " ]] ;;
    esac
}

# list_blocks ROOT FOLDER FILE...: writes each sh and console block to FOLDER/NUMBER; its first line is FILE, LINE,
# LANGUAGE, and the marker, separated by tabs. Prints what is wrong with the Markdown.
list_blocks() {
    local root=$1 folder=$2
    shift 2
    mkdir -p "$folder"
    awk -v root="$root" -v folder="$folder" '
        function problem(text) { printf "%s:%d: %s\n", name, FNR, text }
        FNR == 1 {
            if (inside) printf "%s: a code block has no end\n", name
            name = substr(FILENAME, length(root) + 2)
            inside = 0; out = ""; marker = ""
        }
        inside && /^ *```/ { inside = 0; if (out) close(out); out = ""; next }
        inside {
            if (out) print >out
            else if (/^(\$ |sparegs |tools\/)/) problem("commands in a block that is neither sh nor console")
            next
        }
        /^ *```/ {
            inside = 1
            language = $0
            sub(/^ *```/, "", language)
            if (language == "sh" || language == "console") {
                out = sprintf("%s/%04d", folder, ++count)
                printf "%s\t%d\t%s\t%s\n", name, FNR, language, marker >out
            } else if (language !~ /^(c|cmake|cpp|csv|json|python|text)$/)
                problem("a code block of the language \"" language "\"")
            else if (marker)
                problem("an example marker above a block that is neither sh nor console")
            marker = ""
            next
        }
        marker { problem("an example marker without a block below it") }
        {
            marker = /^<!-- (example: [^ ].*|slow example) -->$/ ? $0 : ""
            if (!marker && /<!-- *(slow *)?example/) problem("a malformed example marker")
            if (/^    +(\$ |sparegs |tools\/|cmake )/) problem("commands outside of a fenced block")
        }
        END { if (inside) printf "%s: a code block has no end\n", name }' "$@"
}

# script_of BLOCK LANGUAGE: the commands of a block. Those of a console block follow "$ ".
script_of() {
    case $2 in
        console) tail -n +2 "$1" | awk '/^\$ / || more { sub(/^\$ /, ""); print; more = /\\$/ }' ;;
        *) tail -n +2 "$1" ;;
    esac
}

# simple_commands: from a script, one simple command per line, without here-documents and comments.
# shellcheck disable=SC2016 # $( is text here
simple_commands() {
    awk '
        end != "" { if ($0 == end) end = ""; next }
        {
            if (match($0, /<<.?[A-Z]+/)) { end = substr($0, RSTART + 2, RLENGTH - 2); gsub(/[^A-Z]/, "", end) }
            print
        }' | sed -e ':again' -e '/\\$/{N;s/\\\n/ /;b again}' -e 's/^ *#.*//; s/  *# .*//' |
    sed -e 's/&&\|||\||\|;\|\$(\|"\|)/\n/g' | sed -e 's/^ *\(sudo \)* *//' -e '/^$/d'
}

# check_command WORD...: prints what does not exist of a simple command.
check_command() {
    local word
    case $1 in
        tools/*) [ -x "$SPAREGS_SOURCE/$1" ] || echo "there is no script $1" ;;
        sparegs) ;;
        *) return 0 ;;
    esac
    [ "$1" = sparegs ] || return 0
    case ${2:-} in
        --version | --help | help) return 0 ;;
    esac
    [ -n "${helps[${2:-none}]-}" ] || {
        echo "there is no command 'sparegs ${2:-}'"
        return 0
    }
    for word in "${@:3}"; do
        case $word in
            [0-9]\>* | \>*) break ;;
            -[a-z]* | --[a-z]*) has_option "$2" "${word%%=*}" || echo "'sparegs $2' has no option ${word%%=*}" ;;
        esac
    done
}

# run_script SCRIPT FOLDER: runs it there; every command must succeed. Unless test_cli_parts_long runs them, training runs of
# 30 to 300 iterations have 10 at a fourth of the size, or 60 where the next commands need a structural update or opaque
# images, and measurements are not repeated.
run_script() {
    local shorter='/--opaque|out\/spare /{s/(--iterations )300\b/\160/;b}; s/(--(iterations|finetune) )([123]00|[36]0)\b/\110/
        s/(sparegs train .*--downscale )2\b/\14/; s/(--repeat )3\b/\11/'
    if is_long; then shorter=; fi
    {
        echo 'set -euo pipefail'
        # shellcheck disable=SC2016 # for the script
        echo 'trap '\''echo "failed: $BASH_COMMAND" >&2'\'' ERR'
        sed -E -e 's/ && /\n/g' -e "$shorter" "$1" # alone, a command left of && may fail unseen
    } >"$1.run"
    (cd "$2" && PATH=$bin:$PATH timeout 600 bash "$1.run" </dev/null >"$1.out" 2>"$1.err")
}

# check_block BLOCK WORK: prints what is wrong with a block; runs it below WORK unless it is marked or WORK is empty.
check_block() {
    local block=$1 work=$2 name line language marker missing words
    IFS=$'\t' read -r name line language marker <"$block"
    if is_long && [ "$marker" = "<!-- slow example -->" ]; then marker=; fi
    script_of "$block" "$language" >"$block.script"
    [ -s "$block.script" ] || echo "$name:$line: the block has no command"
    bash -n "$block.script" 2>"$block.err" || echo "$name:$line: not a shell script: $(head -n 1 "$block.err")"
    while read -ra words; do
        check_command "${words[@]}"
    done < <(simple_commands <"$block.script") >"$block.missing"
    while IFS= read -r missing; do echo "$name:$line: $missing"; done <"$block.missing"
    if [[ $(<"$block.script") == *'||'* ]]; then
        echo "$name:$line: '||' hides a failure"
    fi
    if [ -z "$marker" ] && [ -n "$work" ] && [ ! -s "$block.missing" ]; then
        work=$work/${name//\//_}
        [ -d "$work" ] || { mkdir -p "$work/tests/data" && cp -r "$room" "$work/tests/data/room"; }
        run_script "$block.script" "$work" ||
            echo "$name:$line: the example does not run: $(grep -v '^[0-9]*/' "$block.script.err" | tail -n 3 | tr '\n' ' ')"
    fi
}

# anchors FILE: the anchors of its headings, as GitHub makes them.
anchors() {
    awk '/^ *```/ { inside = !inside } !inside && /^#+ / { sub(/^#+ +/, ""); print tolower($0) }' "$1" |
        sed -e 's/[^a-z0-9 _-]//g' -e 's/ /-/g'
}

# prose FILE: the text outside of code blocks, each line with its number.
prose() { awk '/^ *```/ { inside = !inside; next } !inside { print FNR ":" $0 }' "$1"; }

# check_text ROOT FILE: prints dead relative links, and options in code spans that no command has.
check_text() {
    local root=$1 file=$2 name=${2#"$1"/} line target option path anchor
    while IFS=: read -r line target; do
        case $target in
            http://* | https://* | mailto:*) continue ;;
        esac
        path=${target%%#*} anchor=
        case $target in *'#'*) anchor=${target#*#} ;; esac
        path=${path:+${file%/*}/$path}
        path=${path:-$file}
        if [ ! -e "$path" ]; then
            echo "$name:$line: the link to $target leads to no file"
        elif [ -n "$anchor" ] && ! anchors "$path" | grep -qxF -- "$anchor"; then
            echo "$name:$line: the link to $target leads to no heading"
        fi
    done < <(prose "$file" | awk '{
        number = $0; sub(/:.*/, "", number)
        while (match($0, /\]\([^ )]+\)/)) {
            print number ":" substr($0, RSTART + 2, RLENGTH - 3)
            $0 = substr($0, RSTART + RLENGTH)
        }
    }')
    while IFS=: read -r line option; do
        [ -n "${known_options[$option]-}" ] || echo "$name:$line: no command has the option $option"
    done < <(prose "$file" | awk -F'`' '{
        number = $1; sub(/:.*/, "", number)
        for (i = 2; i <= NF; i += 2)
            if ($i !~ /^(tools|cmake|ctest|apt|pkg-config|mpirun|srun)/)
                for (n = split($i, words, /[ =]/); n > 0; --n)
                    if (words[n] ~ /^--[a-z]/) print number ":" words[n]
    }')
}

# inspect ROOT WORK: prints every problem of the documentation below ROOT; examples run below WORK, if given.
inspect() {
    local root=$1 work=${2:-} file block blocks
    local files=("$root/README.md" "$root"/tools/manual/*.md)
    blocks=$(mktemp -d -p "$temporary")
    for file in "${files[@]}"; do
        [ -f "$file" ] || { echo "${file#"$root"/}: there is no such file"; return; }
    done
    [ "$(wc -l <"$root/README.md")" -le "$readme_lines" ] || echo "README.md: has more than $readme_lines lines"
    list_blocks "$root" "$blocks" "${files[@]}"
    for file in "${files[@]}"; do
        check_text "$root" "$file"
        grep -lqs "^${file#"$root"/}	" "$blocks"/* || echo "${file#"$root"/}: has no example"
    done
    grep -qsP '\t(sh|console)\t$' "$blocks"/* || echo "no example is run"
    for block in "$blocks"/[0-9][0-9][0-9][0-9]; do
        [ ! -f "$block" ] || check_block "$block" "$work"
    done
    echo "$(find "$blocks" -name '[0-9][0-9][0-9][0-9]' | wc -l) $(find "$blocks" -name '*.script.run' | wc -l)" >"$temporary/counts"
}

# All options of all commands, and those of other programs that the text names.
declare -A known_options=([--version]=1 [--static]=1)
for option in --bind --bind-to --map-by --cpu-bind --ntasks-per-node --exclusive --mem --signal --kill-on-invalid-dep --kill-on-bad-exit; do known_options[$option]=1; done # mpirun, Slurm
for option in $(printf '%s\n' "${helps[@]}" | sed -nE 's/^ +(-[a-z], )?(--[a-z-]+).*/\2/p'); do known_options[$option]=1; done
check help_lists_options test "${#known_options[@]}" -gt 50

# no_problems: holds PROBLEMS of inspect.
no_problems() { [ ! -s "$1" ] || { cat "$1"; return 1; }; }

# examples_run_and_links_lead_somewhere
: >"$temporary/stderr"
work=$temporary/work
# shellcheck disable=SC2119 # any sanitizer
if is_sanitized 2>/dev/null; then
    work= # too slow; the release build runs them
fi
inspect "$SPAREGS_SOURCE" "$work" >"$temporary/problems"
read -r block_count run_count <"$temporary/counts"
echo "$block_count examples, $run_count of them run"
while IFS= read -r problem; do echo "$problem"; done <"$temporary/problems"
last_command="inspect README.md tools/manual"
check documentation_is_right no_problems "$temporary/problems"
check there_are_examples test "$block_count" -gt 0
[ -z "$work" ] || check examples_were_run test "$run_count" -gt 0

# planted_faults_are_found: PROBLEM, README.md, and a guide; printf formats. plant_run also runs the examples.
planted=$temporary/planted
planted_work=
plant_run() {
    planted_work=$temporary/planted_work
    plant "$@"
    planted_work=
}
plant() {
    local problem=$1
    rm -rf "$planted" "$temporary/planted_work"
    mkdir -p "$planted/tools/manual"
    # shellcheck disable=SC2059 # formats
    printf "$2" >"$planted/README.md"
    # shellcheck disable=SC2059
    printf "${3:-$good}" >"$planted/tools/manual/guide.md"
    inspect "$planted" "$planted_work" >"$temporary/problems"
    last_command="inspect of a planted fault: $problem"
    if [ -z "$problem" ]; then
        check faultless_text_has_no_problem no_problems "$temporary/problems"
    else
        check planted_fault_is_found grep -qF -- "$problem" "$temporary/problems"
    fi
}
fence='```'
good="# Guide\n\n${fence}sh\nsparegs --version\n${fence}\n"
mark='<!-- example: needs your own data -->'
plant_run "" "${good}[guide](tools/manual/guide.md#guide) \`--iterations\`\n"
plant_run "README.md:3: the example does not run" "\n\n${fence}sh\nsparegs info nowhere\n${fence}\n"
plant_run "failed: false" "\n\n${fence}sh\nfalse && sparegs --version\nsparegs --version\n${fence}\n"
plant "README.md:2: 'sparegs train' has no option --itertions" "$mark\n${fence}sh\nsparegs train s -o x --itertions 3\n${fence}\n"
plant "there is no command 'sparegs trian'" "$mark\n${fence}sh\ncd x && sparegs trian scene\n${fence}\n"
plant "there is no script tools/nothing.sh" "$mark\n${fence}sh\ntools/nothing.sh\n${fence}\n"
plant "not a shell script" "$mark\n${fence}sh\nif sparegs\n${fence}\n"
plant "the block has no command" "$good${fence}console\nsparegs --version\n${fence}\n"
plant "a code block of the language \"\"" "$good${fence}\nsparegs --version\n${fence}\n"
plant "neither sh nor console" "$good${fence}text\n\$ sparegs --version\n${fence}\n"
plant "commands outside of a fenced block" "$good\n    sparegs --version\n"
plant "marker without a block" "$good\n$mark\n\n${fence}sh\nsparegs --version\n${fence}\n"
plant "malformed example marker" "$good\n<!-- slow example: reason -->\n${fence}sh\nsparegs --version\n${fence}\n"
plant "malformed example marker" "$good\n<!-- example -->\n${fence}sh\nsparegs --version\n${fence}\n"
plant "hides a failure" "${fence}sh\nsparegs info nowhere || true\n${fence}\n"
plant "a code block has no end" "${fence}sh\nsparegs --version\n"
plant "README.md: has no example" "# Nothing\n"
unrun="$mark\n${fence}sh\nsparegs --version\n${fence}\n"
plant "no example is run" "$unrun" "$unrun"
plant "README.md: has more than 200 lines" "$good$(printf '%0201d' 0 | sed 's/0/\\n/g')"
plant "the link to nothing.md leads to no file" "${good}[x](nothing.md)\n"
plant "leads to no heading" "${good}[x](tools/manual/guide.md#other)\n"
plant "no command has the option --no-such-thing" "$good \`--no-such-thing 3\`\n"

finish
