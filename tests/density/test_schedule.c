// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The schedule against the published milestones, and the documented properties of scaled ones.

#include <limits.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "density/pipeline.h"
#include "density/schedule.h"

// Photos: number and pixels.
#define VIEWS 60
#define SMALL 1.2e5

static const sgsi_schedule_input small_photos = {.views = VIEWS, .pixels = SMALL};

static sgsi_schedule make(int iterations, sgs_schedule kind)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.schedule = kind;
    return sgsi_schedule_make(&options, &small_photos);
}

static double sh_rate(const sgs_train_options *options, size_t views)
{
    return sgsi_schedule_make(options, &(sgsi_schedule_input){.views = views, .pixels = SMALL})
        .lr_sh;
}

static int count_structural(const sgsi_schedule *schedule)
{
    int count = 0;
    for (int i = 1; i <= schedule->iterations; ++i)
        count += sgsi_schedule_is_structural(schedule, i);
    return count;
}

static void published_schedule_has_144_updates_and_4_resets(void **state)
{
    (void)state;
    const sgs_schedule kinds[] = {SGS_SCHEDULE_PAPER, SGS_SCHEDULE_SCALED}; // equal at 30 000
    for (int k = 0; k < 2; ++k) {
        const sgsi_schedule schedule = make(30000, kinds[k]);
        assert_int_equal(count_structural(&schedule), 144); // 600, 700, ..., 14900
        assert_true(sgsi_schedule_is_structural(&schedule, 600));
        assert_false(sgsi_schedule_is_structural(&schedule, 500));
        assert_true(sgsi_schedule_is_structural(&schedule, 14900));
        assert_false(sgsi_schedule_is_structural(&schedule, 15000));
        int resets = 0;
        for (int i = 1; i <= 30000; ++i)
            if (sgsi_schedule_is_reset(&schedule, i)) {
                assert_int_equal(i % 3000, 0);
                ++resets;
            }
        assert_int_equal(resets, 4);
        assert_int_equal(schedule.sh_interval, 1000);
        assert_int_equal(schedule.check_interval, 1000);
        assert_true(fabs(sgsi_schedule_lr(&schedule, 15000) - 0.1) < 1e-12);
        assert_true(fabs(sgsi_schedule_lr(&schedule, 30000) - 0.01) < 1e-12);
    }
}

// last_reset as in the trainer: an update precedes the reset of the same iteration. Scaled runs do
// not prune by size.
static void size_pruning_follows_the_published_rule(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline)
        for (int white = 0; white < 2; ++white)
            for (int length = 0; length < 4; ++length) {
                const int n = (int[]){7000, 15000, 30000, 60000}[length];
                sgs_train_options options = sgs_train_options_default();
                options.iterations = n;
                options.pipeline = (sgs_pipeline)pipeline;
                for (int c = 0; c < 3; ++c)
                    options.background[c] = (float)white;
                for (int paper = 0; paper < 2; ++paper) {
                    options.schedule = paper ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
                    const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
                    int last_reset = -1, resets = 0;
                    for (int t = 1; t <= n; ++t) {
                        const bool prunes = sgsi_schedule_prunes_large(&schedule, t, last_reset);
                        if (sgsi_schedule_is_structural(&schedule, t) && paper)
                            // train.py of 3DGS; DashGaussian and MCMC prune none
                            assert_int_equal(prunes, t > 3000 && pipeline != SGS_PIPELINE_DASH &&
                                                         pipeline != SGS_PIPELINE_MCMC);
                        assert_true(!prunes || (resets > 0 && paper));
                        if (sgsi_schedule_is_reset(&schedule, t)) {
                            last_reset = t;
                            ++resets;
                        }
                    }
                }
            }
}

// The rate of SH grows with the number of views up to 24, and is the published one for more views
// and from 30 000 iterations on, both towards 7000 iterations and below 2000, and in the published
// schedule; without a step.
static void few_views_have_a_smaller_rate_of_sh(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 7000;
    assert_true(fabs(sh_rate(&options, 12) - 0.5) < 1e-12);
    assert_true(fabs(sh_rate(&options, 1) - 1.0 / 24) < 1e-12);
    assert_true(sh_rate(&options, 24) == 1.0);
    assert_true(sh_rate(&options, 1000) == 1.0);
    options.schedule = SGS_SCHEDULE_PAPER;
    assert_true(sh_rate(&options, 12) == 1.0);
    options.schedule = SGS_SCHEDULE_SCALED;
    double longer = 1.0;
    for (options.iterations = 40000; options.iterations >= 100; options.iterations -= 100) {
        const double rate = sh_rate(&options, 12);
        assert_true(fabs(rate - longer) < 0.03 && rate >= 0.5 && rate <= 1.0);
        assert_true((options.iterations < 30000 && options.iterations > 2000) == (rate < 1.0));
        assert_true(options.iterations >= 7000 ? rate <= longer : rate >= longer);
        longer = rate;
    }
    assert_true(longer == 1.0);
}

// Up to 2000 iterations, the rate of SH grows with the number of views from 15 to 30, up to twice
// that of 3DGS, which Taming and FastGS have as published. It falls to the published one at 7000
// iterations and on high-resolution images; without a step.
static void short_runs_have_a_higher_rate_of_sh(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    for (options.iterations = 100; options.iterations <= 2000; options.iterations += 100) {
        assert_true(sh_rate(&options, 15) == 1.0);
        assert_true(fabs(sh_rate(&options, 20) - cbrt(2.0)) < 1e-12);
        assert_true(sh_rate(&options, 30) == 2.0 && sh_rate(&options, 100000) == 2.0);
    }
    double shorter = 2.0;
    for (; options.iterations <= 40000; options.iterations += 100) {
        const double rate = sh_rate(&options, 30);
        assert_true(rate <= shorter && shorter - rate < 0.06);
        assert_true((options.iterations < 7000) == (rate > 1.0));
        shorter = rate;
    }
    assert_true(shorter == 1.0);
    options.iterations = 2000;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        options.pipeline = (sgs_pipeline)pipeline;
        const double rate = (double)sgsi_pipeline_get(options.pipeline)->lr_rest,
                     wanted = pipeline == SGS_PIPELINE_MCMC ? 1.25e-4 : 2.5e-4;
        assert_true(fabs(rate * sh_rate(&options, 30) - wanted) < 1e-10);
    }
    options.pipeline = SGS_PIPELINE_3DGS;
    double smaller = 2.0;
    for (double pixels = SMALL; pixels < 1e6; pixels *= 1.1) {
        const sgsi_schedule_input input = {.views = 60, .pixels = pixels};
        const double rate = sgsi_schedule_make(&options, &input).lr_sh;
        assert_true(rate <= smaller && smaller - rate < 0.2);
        smaller = rate;
    }
    assert_true(smaller == 1.0);
    options.schedule = SGS_SCHEDULE_PAPER;
    assert_true(sh_rate(&options, 60) == 1.0);
}

// Rates but that of the position: constant as published; annealed in shorter runs, without a step
// between neighbouring lengths.
static void short_runs_anneal_their_rates(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        double longer = 1.0;
        for (int n = 30000; n >= 200; n -= 100) {
            sgs_train_options options = sgs_train_options_default();
            options.iterations = n;
            options.pipeline = (sgs_pipeline)pipeline;
            options.schedule = SGS_SCHEDULE_PAPER;
            const sgsi_schedule paper = sgsi_schedule_make(&options, &small_photos);
            assert_true(sgsi_schedule_lr_other(&paper, n) == 1.0);
            options.schedule = SGS_SCHEDULE_SCALED;
            const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
            assert_true(sgsi_schedule_lr_other(&schedule, n * 7 / 10) == 1.0);
            assert_false(sgsi_schedule_is_annealing(&schedule, n * 7 / 10));
            assert_int_equal(sgsi_schedule_is_annealing(&schedule, n * 7 / 10 + 1),
                             schedule.lr_late < 1.0);
            assert_true(n > 29000 || (schedule.lr_late < 1.0) == (n > 1000));
            const double last = sgsi_schedule_lr_other(&schedule, n);
            const double middle = sgsi_schedule_lr_other(&schedule, n * 17 / 20);
            assert_true(n % 20 || fabs(middle * middle - last) < 1e-12);
            assert_true(fabs(last - longer) < 0.12 && (n < 7000) == (last > longer || n < 1000));
            assert_true(n != 7000 || fabs(last - 0.1) < 1e-12);
            assert_true(n > 1000 || last == 1.0);
            longer = last;
        }
    }
}

// Rotation and scale: published rates at 30 000, at most twice those in shorter runs.
static void short_runs_shape_faster(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    double longer = 1.0;
    for (int n = 40000; n >= 100; n -= 100) {
        options.iterations = n;
        options.schedule = SGS_SCHEDULE_PAPER;
        assert_true(sgsi_schedule_make(&options, &small_photos).lr_shape == 1.0);
        options.schedule = SGS_SCHEDULE_FINETUNE;
        assert_true(sgsi_schedule_make(&options, &small_photos).lr_shape == 1.0);
        options.schedule = SGS_SCHEDULE_SCALED;
        const double shape = sgsi_schedule_make(&options, &small_photos).lr_shape;
        assert_true((n < 30000) == (shape > 1.0) && (n <= 7500) == (shape == 2.0));
        assert_true(n != 15000 || fabs(shape - sqrt(2.0)) < 1e-12);
        assert_true(shape >= longer && shape - longer < 0.02);
        longer = shape;
        options.pipeline = SGS_PIPELINE_MCMC; // with the dense optimiser only
        assert_true(sgsi_schedule_make(&options, &small_photos).lr_shape ==
                    (n < 2000 ? 1.0 : shape));
        options.pipeline = SGS_PIPELINE_3DGS;
    }
}

static void white_backgrounds_have_an_additional_reset(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    for (int c = 0; c < 3; ++c)
        options.background[c] = 1;
    for (int paper = 0; paper < 2; ++paper) {
        options.iterations = paper ? 7000 : 30000;
        options.schedule = paper ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
        const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
        int resets = 0;
        for (int i = 1; i <= options.iterations; ++i)
            resets += sgsi_schedule_is_reset(&schedule, i);
        assert_int_equal(resets, paper ? 3 : 5);
        assert_true(sgsi_schedule_is_reset(&schedule, 500)); // train.py of 3DGS
    }
    options.background_random = true;
    const sgsi_schedule random = sgsi_schedule_make(&options, &small_photos);
    assert_false(sgsi_schedule_is_reset(&random, 500));
}

static void paper_schedule_cut_short_keeps_its_milestones(void **state)
{
    (void)state;
    const sgsi_schedule schedule = make(7000, SGS_SCHEDULE_PAPER);
    assert_int_equal(count_structural(&schedule), 65); // 600 ... 7000
    assert_true(sgsi_schedule_is_reset(&schedule, 3000));
    assert_true(sgsi_schedule_is_reset(&schedule, 6000));
    assert_true(sgsi_schedule_lr(&schedule, 7000) > 0.3);
}

static int count_resets(const sgsi_schedule *schedule)
{
    int count = 0;
    for (int i = 1; i <= schedule->iterations; ++i)
        count += sgsi_schedule_is_reset(schedule, i);
    return count;
}

// One iteration less than published keeps all resets; a short run has none, not even the additional
// one for white backgrounds.
static void resets_change_little_around_the_published_length(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline)
        for (int white = 0; white < 2; ++white) {
            sgs_train_options options = sgs_train_options_default();
            options.pipeline = (sgs_pipeline)pipeline;
            for (int c = 0; c < 3; ++c)
                options.background[c] = (float)white;
            const sgsi_schedule published = sgsi_schedule_make(&options, &small_photos);
            const int all = count_resets(&published);
            if (pipeline == SGS_PIPELINE_MCMC) { // has none at any length
                assert_int_equal(all, 0);
                continue;
            }
            assert_int_equal(all, (pipeline == SGS_PIPELINE_DASH ? 8 : 4) + white);
            for (int n = 29999; n >= 29000; n -= 37) {
                options.iterations = n;
                const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
                assert_int_equal(count_resets(&schedule), all);
            }
            for (int n = 30001; n < 70000; n += 499) {
                options.iterations = n;
                const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
                int last = 0;
                for (int i = 1; i <= n; ++i)
                    if (sgsi_schedule_is_reset(&schedule, i))
                        last = i;
                assert_int_equal(count_resets(&schedule) - white,
                                 (schedule.densify_until - 1500) / 3000);
                assert_true(schedule.densify_until - last >= 1500);
            }
            for (int n = 29000; n > 1000; n -= 250) {
                options.iterations = n;
                const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
                const int resets = count_resets(&schedule);
                assert_true(resets <= all && (n > 4000 || !resets));
                assert_int_equal(sgsi_schedule_is_reset(&schedule, 500), white && resets > 1);
            }
        }
}

// The update interval depends on the photos, and resets follow updates.
static void resets_depend_on_the_length_only(void **state)
{
    (void)state;
    static const int lengths[] = {8999, 9000, 14999, 15000, 20999, 21000, 26999, 27000, 29999};
    static const int expected[] = {0, 1, 1, 2, 2, 3, 3, 4, 4}; // floor((n / 2 - 1500) / 3000)
    sgs_train_options options = sgs_train_options_default();
    for (size_t k = 0; k < sizeof lengths / sizeof *lengths; ++k)
        for (size_t views = 10; views <= 70; ++views)
            for (double pixels = 1e5; pixels < 2e6; pixels *= 2.1) {
                options.iterations = lengths[k];
                const sgsi_schedule schedule =
                    sgsi_schedule_make(&options, &(sgsi_schedule_input){views, pixels, false});
                assert_int_equal(count_resets(&schedule), expected[k]);
            }
}

// A decay by less than 5 % would end the equilibrium checks at 70 % of the run.
static void runs_close_to_the_published_length_have_constant_rates(void **state)
{
    (void)state;
    for (int n = 25000; n < 30000; n += 100) {
        const sgsi_schedule schedule = make(n, SGS_SCHEDULE_SCALED);
        assert_true(schedule.lr_late == 1.0 || schedule.lr_late <= 0.95);
        assert_true(sgsi_schedule_is_annealing(&schedule, n - 1) == (schedule.lr_late < 1.0));
        assert_true(n < 29700 || schedule.lr_late == 1.0);
    }
}

static void scaled_schedule_has_its_documented_properties_at_every_length(void **state)
{
    (void)state;
    int previous = 0;
    for (int n = 1; n <= 60000; n = n < 100 ? n + 1 : n * 11 / 10) {
        const sgsi_schedule schedule = make(n, SGS_SCHEDULE_SCALED);
        const int updates = count_structural(&schedule);
        assert_true(schedule.densify_until <= n / 2 + 1);
        assert_true(fabs(sgsi_schedule_lr(&schedule, n) - 0.01) < 1e-9);
        int last = -100000;
        for (int i = 1; i <= n; ++i) {
            if (!sgsi_schedule_is_reset(&schedule, i))
                continue;
            assert_true(sgsi_schedule_is_structural(&schedule, i));
            assert_true(i - last >= 3000 - schedule.densify_interval / 2);
            last = i;
        }
        if (n >= 7000 && n <= 30000) {
            assert_true(updates + 1 >=
                        previous); // not fewer updates in a longer run (rounding: one less)
            previous = updates;
        }
        assert_true(n < 1000 || updates >= 4);
        assert_true(schedule.check_interval >= 1 && schedule.sh_interval >= 1);
    }
}

static void a_check_interval_beyond_int_means_no_check(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 100000;
    options.spare_interval = 1000000000;
    assert_int_equal(sgsi_schedule_make(&options, &small_photos).check_interval, INT_MAX);
}

static sgsi_schedule make_for(sgs_pipeline pipeline, int iterations)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.pipeline = pipeline;
    return sgsi_schedule_make(&options, &small_photos);
}

static void late_updates_of_scaled_runs_remove_five_percent_at_most(void **state)
{
    (void)state;
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p)
        for (int n = 200; n < 30000; n += 1700) {
            sgs_train_options options = sgs_train_options_default();
            options.pipeline = (sgs_pipeline)p;
            options.iterations = n;
            const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
            const bool limited = n >= 1000 && options.pipeline != SGS_PIPELINE_MCMC;
            int first = 0;
            for (int i = 1; i <= n; ++i) {
                const bool structural = sgsi_schedule_is_structural(&schedule, i),
                           late = structural && i > schedule.densify_until / 2;
                first = !first && structural ? i : first;
                assert_true(sgsi_schedule_removal_max(&schedule, i) ==
                            (late && limited ? 0.05 : 0.0));
            }
            assert_int_equal(sgsi_schedule_first_update(&schedule), first);
        }
    const sgsi_schedule published = make(30000, SGS_SCHEDULE_SCALED),
                        paper = make(7000, SGS_SCHEDULE_PAPER),
                        shortest = make(20, SGS_SCHEDULE_SCALED);
    for (int i = 1; i <= 30000; ++i) {
        assert_true(sgsi_schedule_removal_max(&published, i) == 0.0);
        assert_true(sgsi_schedule_removal_max(&paper, i) == 0.0);
    }
    assert_int_equal(sgsi_schedule_first_update(&published), 600);
    assert_int_equal(sgsi_schedule_first_update(&shortest), 0);
}

static void finetuning_has_no_milestones(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        sgs_train_options options = sgs_train_options_default();
        options.iterations = 31000; // beyond every published milestone
        options.schedule = SGS_SCHEDULE_FINETUNE;
        options.pipeline = (sgs_pipeline)pipeline;
        for (int c = 0; c < 3; ++c)
            options.background[c] = 1; // has an additional reset otherwise
        const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
        assert_int_equal(schedule.sh_interval, 0); // all bands at once
        for (int t = 1; t <= options.iterations; ++t) {
            assert_false(sgsi_schedule_is_structural(&schedule, t));
            assert_false(sgsi_schedule_is_reset(&schedule, t));
            assert_false(sgsi_schedule_is_final_prune(&schedule, t));
            assert_true(sgsi_schedule_steps_main(&schedule, t));
            assert_true(sgsi_schedule_steps_rest(&schedule, t));
            assert_true(fabs(sgsi_schedule_lr(&schedule, t) - 0.01) < 1e-12);
        }
        assert_int_equal(sgsi_schedule_updates(&schedule), 1);
    }
}

static void fastgs_steps_and_prunes_as_published(void **state)
{
    (void)state;
    const sgsi_schedule schedule = make_for(SGS_PIPELINE_FASTGS, 30000);
    int main_steps[3] = {0}, rest_steps[3] = {0}, prunes = 0;
    for (int t = 1; t <= 30000; ++t) {
        const int phase = t <= 15000 ? 0 : t <= 20000 ? 1 : 2;
        main_steps[phase] += sgsi_schedule_steps_main(&schedule, t);
        rest_steps[phase] += sgsi_schedule_steps_rest(&schedule, t);
        if (sgsi_schedule_is_final_prune(&schedule, t)) {
            assert_true(t == 18000 || t == 21000 || t == 24000 || t == 27000);
            ++prunes;
        }
    }
    assert_int_equal(prunes, 4);
    assert_int_equal(main_steps[0], 15000);
    assert_int_equal(rest_steps[0], 15000 / 16);
    assert_int_equal(main_steps[1] + main_steps[2],
                     156 + 156 +
                         1); // 20000 is a multiple of 32: the last iteration of its phase steps
    assert_int_equal(rest_steps[1] + rest_steps[2], main_steps[1] + main_steps[2]);
    assert_int_equal(count_structural(&schedule), 28); // 1000, 1500, ..., 14500
    const sgsi_schedule small = make_for(SGS_PIPELINE_FASTGS, 3000);
    int late = 0;
    for (int t = 1501; t <= 3000; ++t)
        late += sgsi_schedule_steps_main(&small, t);
    assert_true(late > 250 && late < 400); // similar to the number of steps of a full run
}

// Also where the interval is rounded, and where the run is longer than the published one.
static void fastgs_makes_four_final_prunes_at_every_length(void **state)
{
    (void)state;
    for (int n = 60; n <= 60000; n = n < 1000 ? n + 1 : n * 101 / 100) {
        const sgsi_schedule schedule = make_for(SGS_PIPELINE_FASTGS, n);
        int prunes = 0, first = 0, last = 0;
        for (int t = 1; t <= n; ++t)
            if (sgsi_schedule_is_final_prune(&schedule, t)) {
                ++prunes;
                first = first ? first : t;
                last = t;
            }
        assert_int_equal(prunes, 4);
        assert_true(abs(10 * first - 6 * n) <= 30 && abs(10 * last - 9 * n) <= 45);
    }
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 40000;
    options.pipeline = SGS_PIPELINE_FASTGS;
    options.schedule = SGS_SCHEDULE_PAPER;
    const sgsi_schedule longer = sgsi_schedule_make(&options, &small_photos);
    for (int t = 27001; t <= 40000; ++t)
        assert_false(sgsi_schedule_is_final_prune(&longer, t));
}

static void dash_densifies_until_nine_tenths(void **state)
{
    (void)state;
    const sgsi_schedule schedule = make_for(SGS_PIPELINE_DASH, 30000);
    assert_int_equal(schedule.densify_until, 27000);
    assert_int_equal(sgsi_schedule_updates(&schedule), 265);
    assert_int_equal(schedule.resolution_interval, 100);
    for (int t = 1; t <= 30000; ++t) // 3DGS steps in every iteration
        assert_true(sgsi_schedule_steps_main(&schedule, t) &&
                    sgsi_schedule_steps_rest(&schedule, t));
    const sgsi_schedule small = make_for(SGS_PIPELINE_DASH, 3000),
                        vanilla = make_for(SGS_PIPELINE_3DGS, 3000);
    assert_int_equal(small.densify_until, 2700);
    assert_int_equal(small.densify_interval, vanilla.densify_interval);
}

// train.py of 3DGS-MCMC: iteration > 500, < 25 000, every 100; 5 % each; no opacity resets, also
// not on white.
static void mcmc_has_244_updates_and_no_reset(void **state)
{
    (void)state;
    for (int paper = 0; paper < 2; ++paper) {
        sgs_train_options options = sgs_train_options_default();
        options.pipeline = SGS_PIPELINE_MCMC;
        options.schedule = paper ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
        for (int c = 0; c < 3; ++c)
            options.background[c] = 1;
        const sgsi_schedule schedule = sgsi_schedule_make(&options, &small_photos);
        assert_int_equal(count_structural(&schedule), 244); // 600, 700, ..., 24900
        assert_true(sgsi_schedule_is_structural(&schedule, 600));
        assert_false(sgsi_schedule_is_structural(&schedule, 500));
        assert_true(sgsi_schedule_is_structural(&schedule, 24900));
        assert_false(sgsi_schedule_is_structural(&schedule, 25000));
        assert_true(schedule.growth == 0.05);
        assert_int_equal(schedule.sh_interval, 1000);
        assert_true(schedule.threshold_factor == 1);
        assert_true(fabs(sgsi_schedule_lr(&schedule, 15000) - 0.1) < 1e-12);
        for (int t = 1; t <= 30000; ++t)
            assert_false(sgsi_schedule_is_reset(&schedule, t) ||
                         sgsi_schedule_is_final_prune(&schedule, t));
    }
}

// A scaled run offers the same total growth in its own time, at most doubling in one update.
static void mcmc_scales_its_updates_with_the_run(void **state)
{
    (void)state;
    for (int n = 100; n < 30000; n = n * 5 / 4) {
        const sgsi_schedule schedule = make_for(SGS_PIPELINE_MCMC, n);
        assert_true(schedule.densify_interval >= 50 && schedule.densify_interval <= 100);
        assert_true(abs(schedule.densify_until - n * 5 / 6) <= 1);
        assert_true(schedule.growth > 0 && schedule.growth <= 1);
        assert_true(count_structural(&schedule) >= 1);
        if (schedule.growth == 1)
            continue;
        const double total = log1p(schedule.growth) * n / schedule.densify_interval;
        assert_true(fabs(total / (300 * log(1.05)) - 1) < 1e-9);
    }
    const sgsi_schedule schedule = make_for(SGS_PIPELINE_MCMC, 7000);
    assert_int_equal(schedule.densify_interval, 50);
    assert_true(sgsi_schedule_is_structural(&schedule, 500) &&
                !sgsi_schedule_is_structural(&schedule, 450));
    assert_true(fabs(schedule.growth - 0.1103) < 1e-4);
}

static void auto_is_dense_for_long_runs_of_mcmc(void **state)
{
    (void)state;
    for (sgs_pipeline pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        const bool mcmc = pipeline == SGS_PIPELINE_MCMC;
        assert_false(make_for(pipeline, 1999).dense);
        assert_int_equal(make_for(pipeline, 2000).dense, mcmc);
        assert_int_equal(make_for(pipeline, 30000).dense, mcmc);
    }
    sgs_train_options options = sgs_train_options_default();
    options.pipeline = SGS_PIPELINE_MCMC;
    options.iterations = 100;
    options.schedule = SGS_SCHEDULE_PAPER;
    assert_true(sgsi_schedule_make(&options, &small_photos).dense);
    options.optimizer = SGS_OPTIMIZER_SPARSE;
    assert_false(sgsi_schedule_make(&options, &small_photos).dense);
    options.schedule = SGS_SCHEDULE_FINETUNE;
    options.optimizer = SGS_OPTIMIZER_DENSE;
    assert_true(sgsi_schedule_make(&options, &small_photos).dense);
}

// Short runs of 3DGS, Mip-Splatting and FastGS: the rule of small photos up to 130 000 pixels,
// that of large ones from 320 000 on, monotone between; also with up to 15 and from 60 on. The
// published length, the published schedule and the other pipelines do not depend on the size.
static void short_runs_follow_the_size_of_the_photos(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 7000;
    double threshold = 1.7, share = 0.0;
    for (double pixels = 1; pixels < 1e8; pixels *= 1.1) {
        const sgsi_schedule schedule =
            sgsi_schedule_make(&options, &(sgsi_schedule_input){VIEWS, pixels, false});
        assert_true(schedule.threshold_factor <= threshold && schedule.abs_share >= share);
        assert_true(threshold - schedule.threshold_factor < 0.2);
        assert_true(schedule.abs_share - share < 0.1);
        threshold = schedule.threshold_factor;
        share = schedule.abs_share;
        assert_true(pixels > 1.3e5 || (fabs(threshold - 1.7) < 1e-12 && share == 0.0));
        assert_true(pixels < 3.2e5 || (fabs(threshold - 0.8) < 1e-12 && share == 0.5));
        assert_true(fabs(schedule.near_depth - 0.74 * share) < 1e-12);
        assert_true(fabs(schedule.ssim_weight - 0.2 - 0.4 * share) < 1e-12);
        assert_true(fabs(schedule.ssim_sigma - 1.5 + share) < 1e-12);
        assert_true(fabs(schedule.lr_opacity - pow(4.0, share)) < 1e-12);
        assert_true(fabs(schedule.lr_late - 0.1 * pow(25.0, share)) < 1e-12);
        const double half = 0.6 * 7000 * share;
        assert_true(half < 117 ? schedule.half_size_until == 0
                               : fabs(schedule.half_size_until - half) < 0.51);
    }
    double few = 1.7;
    for (size_t views = 1; views < 100; ++views) {
        const sgsi_schedule schedule =
            sgsi_schedule_make(&options, &(sgsi_schedule_input){views, 1e6, false});
        assert_true(schedule.threshold_factor <= few && few - schedule.threshold_factor < 0.1);
        few = schedule.threshold_factor;
        assert_true((schedule.abs_share == 0.0) == (views <= 15));
        assert_true((schedule.abs_share == 0.5) == (views >= 60));
        assert_true(fabs(log(few / 1.7) / log(0.8 / 1.7) - 2 * schedule.abs_share) < 1e-9);
    }
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline)
        for (int k = 0; k < 3; ++k) {
            options.pipeline = (sgs_pipeline)pipeline;
            options.iterations = k == 0 ? 30000 : 7000;
            options.schedule = k == 1 ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
            const sgsi_schedule small = sgsi_schedule_make(&options, &small_photos),
                                large = sgsi_schedule_make(
                                    &options, &(sgsi_schedule_input){VIEWS, 1e6, false});
            const bool vanilla = pipeline == SGS_PIPELINE_3DGS, mip = pipeline == SGS_PIPELINE_MIP,
                       fine = vanilla || mip || pipeline == SGS_PIPELINE_FASTGS,
                       same = k < 2 || !fine;
            assert_true((large.threshold_factor == small.threshold_factor) == same);
            // The others have their own rule for absolute gradients; mip has twice 3DGS's rate of
            // opacity anyway.
            assert_true((large.abs_share == 0.5) == (!same && vanilla) && small.abs_share == 0.0);
            assert_true(large.lr_opacity == (same || mip ? 1.0 : 2.0) && small.lr_opacity == 1.0);
            assert_true((large.near_depth == 0.0) == same && small.near_depth == 0.0);
            assert_true((large.ssim_weight == 0.2) == same && small.ssim_weight == 0.2);
            assert_true((large.ssim_sigma == 1.5) == same && small.ssim_sigma == 1.5);
            assert_true((large.lr_late == small.lr_late) == same);
            assert_true((large.half_size_until == 0) == same && small.half_size_until == 0);
            assert_true((large.densify_interval == small.densify_interval) == same);
        }
}

// Short runs of 3DGS and Mip-Splatting on high-resolution images: updates go on until the rates
// decay, and only remove.
static void high_resolution_models_are_thinned_until_the_rates_decay(void **state)
{
    (void)state;
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p)
        for (int k = 0; k < 7; ++k) { // at 29 999 the settings have faded out
            const int lengths[] = {999, 1000, 7000, 15000, 30000, 7000, 29999};
            sgs_train_options options = sgs_train_options_default();
            options.pipeline = (sgs_pipeline)p;
            options.iterations = lengths[k];
            options.schedule = k == 5 ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
            const sgsi_schedule small = sgsi_schedule_make(&options, &small_photos),
                                large = sgsi_schedule_make(
                                    &options, &(sgsi_schedule_input){VIEWS, 1e6, false});
            const bool fine = p == SGS_PIPELINE_3DGS || p == SGS_PIPELINE_MIP,
                       thins = fine && k >= 1 && k <= 3;
            int updates = 0, last = 0;
            assert_int_equal(small.thin_until, 0);
            for (int i = 1; i <= options.iterations; ++i) {
                const bool thinning = sgsi_schedule_is_thinning(&large, i);
                assert_false(thinning && sgsi_schedule_prunes_large(&large, i, i - 1));
                assert_false(sgsi_schedule_is_thinning(&small, i));
                assert_false(thinning && (sgsi_schedule_is_structural(&large, i) ||
                                          sgsi_schedule_is_annealing(&large, i)));
                assert_true(!thinning || (sgsi_schedule_is_final_prune(&large, i) &&
                                          sgsi_schedule_removal_max(&large, i) == 0.05));
                updates += thinning;
                last = thinning ? i : last;
            }
            // Statistics are collected for every update, itself included, and not after the last.
            for (int i = 1; i <= options.iterations; ++i)
                assert_int_equal(sgsi_schedule_needs_statistics(&large, i),
                                 i < options.iterations && (i < large.densify_until || i <= last));
            assert_int_equal(large.thin_until, last);
            const int room = large.anneal_from - large.densify_until;
            assert_int_equal(updates > 0, thins);
            assert_true(!thins || k == 3 || abs(updates - room / large.densify_interval) <= 1);
            assert_true(k != 3 || large.thin_until < large.anneal_from);
        }
}

static void a_given_ssim_is_used_by_all_schedules(void **state)
{
    (void)state;
    const sgs_schedule kinds[] = {SGS_SCHEDULE_SCALED, SGS_SCHEDULE_PAPER, SGS_SCHEDULE_FINETUNE};
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 7000;
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
        options.schedule = kinds[k];
        options.ssim_weight = -1;
        options.ssim_sigma = 0;
        assert_true(sgsi_schedule_make(&options, &small_photos).ssim_weight == 0.2);
        assert_true(sgsi_schedule_make(&options, &small_photos).ssim_sigma == 1.5);
        for (int tenths = 0; tenths <= 10; ++tenths) {
            options.ssim_weight = tenths / 10.0;
            options.ssim_sigma = 0.3 * tenths;
            const sgsi_schedule schedule =
                sgsi_schedule_make(&options, &(sgsi_schedule_input){VIEWS, 1e6, false});
            assert_true(schedule.ssim_weight == options.ssim_weight);
            assert_true(!tenths || schedule.ssim_sigma == options.ssim_sigma);
        }
    }
}

// From a random cloud: the published threshold and at least 30 updates; all else is equal.
static void random_clouds_grow_as_published(void **state)
{
    (void)state;
    const sgsi_schedule_input random = {.views = VIEWS, .pixels = SMALL, .random = true};
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p)
        for (int n = 1500; n <= 31500; n += 1500) {
            sgs_train_options options = sgs_train_options_default();
            options.pipeline = (sgs_pipeline)p;
            options.iterations = n;
            const sgsi_schedule other = sgsi_schedule_make(&options, &small_photos);
            sgsi_schedule schedule = sgsi_schedule_make(&options, &random);
            assert_true(schedule.threshold_factor == 1.0);
            if (n < 30000 && options.pipeline != SGS_PIPELINE_MCMC) {
                assert_true(schedule.densify_interval < other.densify_interval);
                assert_true(count_structural(&schedule) >= 27); // the interval is whole
            } else {
                assert_int_equal(schedule.densify_interval, other.densify_interval);
                assert_int_equal(schedule.reset_interval, other.reset_interval);
            }
            assert_int_equal(schedule.densify_until, other.densify_until);
            assert_int_equal(schedule.densify_from, other.densify_from);
            assert_true(schedule.lr_late == other.lr_late && schedule.lr_span == other.lr_span);
            options.schedule = SGS_SCHEDULE_PAPER;
            schedule = sgsi_schedule_make(&options, &random);
            assert_int_equal(schedule.densify_interval,
                             sgsi_schedule_make(&options, &small_photos).densify_interval);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(published_schedule_has_144_updates_and_4_resets),
        cmocka_unit_test(size_pruning_follows_the_published_rule),
        cmocka_unit_test(few_views_have_a_smaller_rate_of_sh),
        cmocka_unit_test(short_runs_have_a_higher_rate_of_sh),
        cmocka_unit_test(short_runs_anneal_their_rates),
        cmocka_unit_test(short_runs_shape_faster),
        cmocka_unit_test(white_backgrounds_have_an_additional_reset),
        cmocka_unit_test(paper_schedule_cut_short_keeps_its_milestones),
        cmocka_unit_test(resets_change_little_around_the_published_length),
        cmocka_unit_test(resets_depend_on_the_length_only),
        cmocka_unit_test(runs_close_to_the_published_length_have_constant_rates),
        cmocka_unit_test(scaled_schedule_has_its_documented_properties_at_every_length),
        cmocka_unit_test(late_updates_of_scaled_runs_remove_five_percent_at_most),
        cmocka_unit_test(random_clouds_grow_as_published),
        cmocka_unit_test(finetuning_has_no_milestones),
        cmocka_unit_test(fastgs_steps_and_prunes_as_published),
        cmocka_unit_test(fastgs_makes_four_final_prunes_at_every_length),
        cmocka_unit_test(dash_densifies_until_nine_tenths),
        cmocka_unit_test(a_check_interval_beyond_int_means_no_check),
        cmocka_unit_test(mcmc_has_244_updates_and_no_reset),
        cmocka_unit_test(mcmc_scales_its_updates_with_the_run),
        cmocka_unit_test(short_runs_follow_the_size_of_the_photos),
        cmocka_unit_test(high_resolution_models_are_thinned_until_the_rates_decay),
        cmocka_unit_test(a_given_ssim_is_used_by_all_schedules),
        cmocka_unit_test(auto_is_dense_for_long_runs_of_mcmc),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
