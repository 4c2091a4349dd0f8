#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Plants faults one at a time in a copy of the sources, builds each and runs the default suite. A fault is caught when a
# test fails; survivors need a test. Takes about a minute per fault; needs the machine for itself.
#     tools/scripts/mutants.sh [NAME...]        all faults, or those whose name matches one of the regular expressions
#     tools/scripts/mutants.sh --check          only checks that each fault can be planted; builds nothing
# Results are appended to build/mutants/results.tsv (name, verdict, first failing test); faults listed there are skipped,
# so that an interrupted run can be repeated. Fails when a fault survives.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
work=$root/build/mutants
results=$work/results.tsv
tree=$work/tree

# NAME | regular expression of the tests that should catch it (run first) | perl pattern (must match one line of the
# sources) | replacement
faults() {
    cat <<'FAULTS'
alpha_clamp | tracer_gradient|tracer_oracle | define ALPHA_MAX 0\.99f | define ALPHA_MAX 0.98f
transmittance_limit | tracer_oracle|tracer_gradient | define TRANSMITTANCE_MIN 1e-4f | define TRANSMITTANCE_MIN 2e-4f
slack_denominator | test_spare | (region->slack = .*)\+ 1\.0\) | ${1}+ 2.0)
swapped_quota_share | test_spare | region->quota = budget \* region->share; | region->quota = budget * (1.0 - region->share);
redundancy_threshold | test_spare | \.tau_alpha = 0\.05, | .tau_alpha = 0.04,
unseen_is_redundant | test_spare | redundant\[i\] = faint && seen && | redundant[i] = faint &&
split_scale | test_density|pipelines | -= 0\.47000363f | -= 0.40546511f
split_scale_in_pruning | test_pipelines|test_density|golden | (split \? columns->scale_max\[i\]) / 1\.6f | ${1} / 1.3f
opacity_threshold | golden|test_trainer | \.opacity_min = 0\.005, | .opacity_min = 0.004,
split_size | golden|test_trainer | \.size_split = 0\.01 \* extent, | .size_split = 0.02 * extent,
opacity_after_reset | test_trainer|test_density | limit_opacity\(trainer, 0\.01, | limit_opacity(trainer, 0.02,
sh_interval | test_schedule | \.sh_interval = rounded\(1000 \* f, 1\) | .sh_interval = rounded(900 * f, 1)
thinning_grows | test_density | c->action\[i\] = SGSI_ACTION_KEEP;$ | c->action[i] = SGSI_ACTION_CLONE;
mip_opacity_rate | test_schedule | fmax\(opacity_rate / \(double\)pipeline->lr_opacity, 1\.0\) | LARGE_OPACITY_RATE
fastgs_thins | test_schedule | schedule->late_removal > 0\.0 && !pipeline->prune_interval | schedule->late_removal > 0.0
learning_rate_decay | test_schedule | exp\(u \* log\(0\.01\)\) | exp(u * log(0.02))
adam_beta2 | golden|test_trainer | \.beta2 = 0\.999f | .beta2 = 0.99f
learning_rate_scale | golden | \.lr_scale = shape \* 5e-3f | .lr_scale = shape * 4e-3f
exposure_beta2 | test_exposure | state->v\[i\] = 0\.999 \* state->v\[i\] \+ 0\.001 | state->v[i] = 0.99 * state->v[i] + 0.01
tangential_distortion | test_camera | (y\[1\] = v \* g \+ )2 \* l->p2 \* u \* v | ${1}2 * l->p1 * u * v
ssim_c2_of_the_loss | test_loss | vf_add\(variances, border\), vf_set1\(9e-4f\) | vf_add(variances, border), vf_set1(3e-4f)
ssim_c2_of_the_metric | test_metrics | c1 = 1e-4, c2 = 9e-4 | c1 = 1e-4, c2 = 3e-4
flip_knee | test_flip | knee = 0\.4 \* job | knee = 0.5 * job
sharpness_of_the_photo | test_flip | energy\[0\] / energy\[1\] | energy[1] / energy[0]
lpips_without_the_length | test_lpips | 1\.0 / \(sqrt\(scale\[k\]\[i\]\) \+ 1e-10\) | 1.0
flip_of_masked_pixels | cli_metrics | sgs_flip\(photo, drawn, valid_mask, | sgs_flip(photo, drawn, NULL,
sh_band_3_sign | test_tracer|test_reference | (basis\[14\] = vf_mul\(vf_mul\(vf_set1\()-0\.59 | ${1}0.59
sh_band_2_sign | test_tracer|test_reference | (basis\[6\] = vf_mul\(vf_set1\()-1\.09 | ${1}1.09
skipped_last_tile | tracer_gradient|golden | sgsi_parallel_parts\(pass->last_tile - pass->first_tile, | sgsi_parallel_parts(pass->last_tile - pass->first_tile - 1,
dilation_of_3dgs | test_tracer_oracle | (SGS_FILTER_3DGS  *\? )0\.3f | ${1}0.31f
near_distance_of_small_scenes | test_trainer|test_cli|test_aov | extent < 1\.0 \? 0\.2 \* extent : 0\.2 | extent < 1.0 ? 0.2 : 0.2
median_at_a_half | test_aov | vf_gt\(front, half\) | vf_gt(front, vf_set1(0.6f))
filter_3d_variance | test_mip | margin = 0\.15, variance = 0\.2 | margin = 0.15, variance = 0.3
mask_inverted | test_mask | value\(&mask, at, plane\) >= lowest\) == drops_white | value(&mask, at, plane) >= lowest) != drops_white
test_split_offset | test_scene | every && i % \(size_t\)every == 0 \? | every && i % (size_t)every == 1 ?
initial_opacity | test_gaussians | start_opacity = 0\.1, | start_opacity = 0.2,
srgb_decode | test_photo|test_image|cli_outputs | encoded \+ 0\.055f\) / 1\.055f, 2\.4f | encoded + 0.055f) / 1.055f, 2.2f
checkpoint_without_second_moments | test_checkpoint|test_trainer|cli_stop | visit_blocks\(visit, "moment2", trainer->v\); | visit_blocks(visit, "moment2", trainer->m);
equilibrium_patience | test_spare_equilibrium | state->held >= tolerance->patience | state->held >= tolerance->patience - 1
f_rest_order | test_ply|test_links | ^    return SGS_PARAM_SH_REST \+ 3 \* \(k % per_channel\) \+ k / per_channel; |     return SGS_PARAM_SH_REST + k;
aov_without_premultiplication | cli_outputs | \*value = alpha > 0 \? alpha \* encoded_color | *value = alpha > 0 ? encoded_color
densification_threshold | golden|test_trainer | define SGSI_GRADIENT_THRESHOLD 2e-4 | define SGSI_GRADIENT_THRESHOLD 3e-4
window_of_ssim | test_loss | if \(workspace->sigma == sigma\) | if (workspace->sigma > 0.0)
rate_of_opacity | test_schedule_effect | return \(float\)trainer->schedule\.lr_opacity \* | return
late_removal | test_schedule | return late \|\| sgsi_schedule_is_thinning\(schedule, iteration\) \? (schedule->late_removal) : 0\.0 | return ${1}
scaled_prunes_large | test_schedule | return schedule->prunes_large && sgsi_schedule_is_structural | return sgsi_schedule_is_structural
faintest_first | test_density | = -\(double\)columns->opacity\[i\]; | = (double)columns->opacity[i];
jitter_of_a_duplicate | test_mcmc_short | (move_in_covariance\(params, )moves->jitter | ${1}0.9 * moves->jitter
spread_beside_a_given_noise | test_mcmc_short | train->pipeline_options\.mcmc_noise < 0\.0 \? sgsi_run | true ? sgsi_run
draws_by_gradient | test_mcmc_short | shortness \* relative | shortness * relative * relative
growth_to_the_cap | test_mcmc_short | CAP_REACHED = 0\.2 | CAP_REACHED = 0.25
ssim_weight | golden | define SSIM_WEIGHT 0\.2 | define SSIM_WEIGHT 0.3
FAULTS
}

copy_sources() {
    rm -rf "$tree"
    mkdir -p "$tree"
    (cd "$root" && git ls-files -z | xargs -0 cp -p --parents -t "$tree")
}

# place PATTERN DIRECTORY: prints the source file in which exactly one line matches; fails if there is none, or more.
place() {
    local pattern=$1 found
    found=$(cd "$2" && grep -rnlP --include='*.[ch]' --include='*.inl' --include='*.cpp' -- "$pattern" src bvh spare tools || true)
    [ "$(printf '%s' "$found" | grep -c .)" = 1 ] && [ "$(grep -cP -- "$pattern" "$2/$found")" = 1 ] || return 1
    echo "$found"
}

# parse LINE: sets name, tests, pattern and replacement.
parse() {
    local rest=${1#* | }
    name=${1%% | *}
    tests=${rest%% | *}
    rest=${rest#* | }
    pattern=${rest% | *}
    replacement=${rest##* | }
}

check() {
    local line status=0 count=0
    while IFS= read -r line; do
        parse "$line"
        count=$((count + 1))
        place "$pattern" "$root" >/dev/null && continue
        echo "mutants: $name: the pattern does not match exactly one line: $pattern"
        status=1
    done < <(faults)
    [ "$status" != 0 ] || echo "$count faults can be planted"
    return "$status"
}

# plant PATTERN REPLACEMENT: changes the one line that matches; prints its file.
plant() {
    local pattern=$1 replacement=$2 found
    found=$(place "$pattern" "$tree") || return 1
    PATTERN=$pattern REPLACEMENT=$replacement perl -pi -e '
        BEGIN { $p = qr/$ENV{PATTERN}/; $r = $ENV{REPLACEMENT}; $r =~ s/\\&/&/g; }
        s/$p/my $first = $1; (my $t = $r) =~ s{\$\{1\}}{$first}g; $t/e' "$tree/$found"
    echo "$found"
}

# first_failure CTEST-ARGUMENT...: runs the tests until one fails; prints its name.
first_failure() {
    ctest --test-dir "$work/build" --stop-on-failure -j "$(nproc)" --timeout 900 "$@" >"$work/ctest.log" 2>&1 || true
    sed -n 's/^ *[0-9]*\/[0-9]* Test *#[0-9]*: \([a-z0-9_]*\) .*\*\*\*.*/\1/p' "$work/ctest.log" | head -1
}

# build_tests EXPRESSION: the program and the tests that match; all without an expression.
build_tests() {
    local targets=()
    if [ -n "$1" ]; then
        targets=(--target sparegs-cli)
        for test in $(ctest --test-dir "$work/build" -N -R "$1" | sed -n 's/^ *Test *#[0-9]*: //p'); do
            grep -qx "\.\.\. $test" "$work/targets" && targets+=("$test")
        done
    fi
    cmake --build "$work/build" -j "$(nproc)" "${targets[@]}" >"$work/build.log" 2>&1
}

if [ "${1:-}" = --check ]; then
    check
    exit
fi
mkdir -p "$work"
touch "$results"
copy_sources
cmake -S "$tree" -B "$work/build" -DCMAKE_BUILD_TYPE=Release >"$work/cmake.log"
cmake --build "$work/build" --target help >"$work/targets"
build_tests ''
# test_mutants compares the sources with the patterns, so it fails with every fault.
not_here='test_package|test_layout|test_docs|test_mutants'
baseline=$(first_failure -L unit)
[ -n "$baseline" ] || baseline=$(first_failure -L cli -E "$not_here")
[ -z "$baseline" ] || { echo "mutants: $baseline fails without a planted fault"; exit 1; }

survivors=0
while IFS= read -r line; do
    parse "$line"
    if [ $# -gt 0 ]; then
        wanted=0
        for expression in "$@"; do [[ $name =~ $expression ]] && wanted=1; done
        [ "$wanted" = 1 ] || continue
    fi
    grep -q "^$name	" "$results" && continue
    if ! file=$(plant "$pattern" "$replacement"); then
        echo "mutants: $name: the pattern does not match exactly one line: $pattern"
        exit 1
    fi
    if ! build_tests "$tests"; then
        echo "mutants: $name does not build, see $work/build.log"
        exit 1
    fi
    failing=$(first_failure -R "$tests")
    [ -n "$failing" ] || { build_tests '' && failing=$(first_failure -L unit); }
    [ -n "$failing" ] || failing=$(first_failure -L cli -E "$not_here")
    if [ -n "$failing" ]; then
        printf '%s\tcaught\t%s\n' "$name" "$failing" | tee -a "$results"
    else
        printf '%s\tsurvived\t%s\n' "$name" "$file" | tee -a "$results"
    fi
    cp -p "$root/$file" "$tree/$file"
    touch "$tree/$file"
done < <(faults)
survivors=$(grep -c '	survived	' "$results" || true)
echo "$(grep -c '	caught	' "$results" || true) caught, $survivors survived"
[ "$survivors" = 0 ]
