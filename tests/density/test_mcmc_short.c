// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// What short runs of MCMC change, and that it ends at 30,000 iterations: the jitter of
// copies and the noise, draws by gradient, slower growth.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "support/density_support.h"

static const int lengths[] = {7000, 14491, 30000}; // the middle one: the geometric mean

// The rows of 3000 that share an opacity lie around the mean of their source by the covariance of
// the new scales: whitened, the offsets are normal with the same standard deviation on each axis.
static void copies_are_jittered_in_a_short_run(void **state)
{
    (void)state;
    static const double expected[] = {0.8, 0.4, 0};
    static const double q[4] = {0.5, -0.1, 0.7, 0.5}; // of norm 1
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double axes[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
                               {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
                               {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}};
    for (size_t l = 0; l < 3; ++l) {
        fixture *f = make(&sgsi_pipeline_mcmc, 3000, 1e-3f);
        f->train.iterations = lengths[l];
        f->options.max_count = 4500;
        f->options.growth = 0.5;
        f->options.update_count = 1; // grow to the cap at once
        for (size_t i = 0; i < 3000; ++i)
            for (int k = 0; k < 4; ++k) {
                *sgs_gaussians_at(f->model, i, SGS_PARAM_ROTATION + k) = (float)(2 * q[k]);
                if (k < 3)
                    *sgs_gaussians_at(f->model, i, SGS_PARAM_SCALE + k) = (float)(k - 6);
            }
        for (size_t i = 0; i < 500; ++i)
            set_faint(f, i);
        assert_int_equal(update(f), 4500);
        double sum[3] = {0}, square[3][3] = {{0}}, n = 0;
        for (size_t i = 0; i < 4500; ++i) {
            const float row = *sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC);
            double offset[3], white[3];
            for (int k = 0; k < 3; ++k)
                offset[k] = (double)*sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + k) -
                            (double)(float)sgsi_random_uniform(9, 3 * (uint64_t)row + (uint64_t)k);
            for (int a = 0; a < 3; ++a)
                white[a] =
                    (axes[a][0] * offset[0] + axes[a][1] * offset[1] + axes[a][2] * offset[2]) /
                    exp((double)*sgs_gaussians_at(f->model, i, SGS_PARAM_SCALE + a));
            if (copies_of(f, row) == 1 || l == 2) {
                assert_true(offset[0] == 0 && offset[1] == 0 && offset[2] == 0);
                continue;
            }
            ++n;
            for (int a = 0; a < 3; ++a) {
                sum[a] += white[a];
                for (int b = 0; b <= a; ++b)
                    square[a][b] += white[a] * white[b];
            }
        }
        assert_true(l == 2 || n > 2500);
        const double s = expected[l];
        for (int a = 0; a < 3 && l < 2; ++a) {
            assert_true(fabs(sum[a] / n) <= 4.5 * s / sqrt(n));
            assert_true(fabs(square[a][a] / n - s * s) <= 4.5 * s * s * sqrt(2 / n) + 1e-3 * s);
            for (int b = 0; b < a; ++b)
                assert_true(fabs(square[a][b] / n) <= 4.5 * s * s / sqrt(n));
        }
        drop(f);
    }
    fixture *given = make(&sgsi_pipeline_mcmc, 100, 1e-3f);
    given->train.iterations = 7000;
    given->train.pipeline_options.mcmc_noise = 5e5;
    given->options.growth = 1;
    given->options.max_count = 200;
    given->options.update_count = 1;
    assert_int_equal(update(given), 200);
    for (size_t i = 0; i < 200; ++i) // a given noise: no jitter
        assert_true(*sgs_gaussians_at(given->model, i, SGS_PARAM_MEAN) ==
                    (float)sgsi_random_uniform(
                        9, 3 * (uint64_t)*sgs_gaussians_at(given->model, i, SGS_PARAM_SH_DC)));
    drop(given);
}

// Sources of equal opacity, whose gradients are 0.5 and 1.5 times the mean in equal numbers, and
// one that no view has seen.
static void sources_of_a_short_run_are_drawn_by_gradient(void **state)
{
    (void)state;
    static const double expected[] = {0.75, 0.625, 0.5};
    for (size_t l = 0; l < 3; ++l)
        for (int grows = 0; grows < 2; ++grows) {
            fixture *f = make(&sgsi_pipeline_mcmc, 8000, 1e-3f);
            f->train.iterations = lengths[l];
            f->options.max_count = grows ? 12000 : 8000;
            f->options.growth = 0.5;
            f->options.update_count = 1;
            for (size_t i = 0; i < 8000; ++i) {
                if (!grows && i < 4000)
                    set_faint(f, i);
                f->statistics.gradient_sum[i] *= i < 4000 && !grows ? 77.0f : i % 2 ? 1.5f : 0.5f;
            }
            f->statistics.visible_count[5000] = 0;
            assert_int_equal(update(f), grows ? 12000 : 8000);
            double strong = 0;
            for (size_t i = 0; i < f->model->count; ++i)
                strong += (int)*sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC) % 2;
            const double p = expected[l], drawn = strong - (grows ? 4000 : 2000);
            assert_true(fabs(drawn - 4000 * p) <= 4 * sqrt(4000 * p * (1 - p)));
            assert_true(l > 0 || copies_of(f, 5000) == 1);
            drop(f);
        }
}

// Without statistics, as at the beginning, the opacities remain.
static void without_gradients_sources_are_drawn_by_opacity(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 1000, 0);
    f->train.iterations = 7000;
    f->options.max_count = 2000;
    f->options.growth = 1;
    f->options.update_count = 1;
    assert_int_equal(update(f), 2000);
    drop(f);
}

// 1000 rows reach their cap of 2000 with the tenth of 50 updates, in equal ratios; a cap that is
// too far is approached with the growth of the options; a run of 30 000 iterations uses that
// always.
static void growth_of_a_short_run_ends_after_a_fifth_of_the_updates(void **state)
{
    (void)state;
    const struct {
        int iterations;
        size_t cap;
        double ratio;
    } cases[] = {{7000, 2000, pow(2, 0.1)},
                 {7000, 20000, 1.1},
                 {14491, 2000, 1 + (pow(2, 0.1) - 1 + 0.1) / 2},
                 {30000, 2000, 1.1}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        fixture *f = make(&sgsi_pipeline_mcmc, 1000, 1e-3f);
        f->train.iterations = cases[k].iterations;
        f->options.max_count = cases[k].cap;
        f->options.growth = 0.1;
        f->options.update_count = 50;
        f->options.update = 0;
        const double first = (double)update(f);
        assert_true(fabs(first - 1000 * cases[k].ratio) <= 1);
        for (f->options.update = 1; f->options.update < 10; ++f->options.update) {
            const size_t before = f->model->count, after = update(f);
            assert_true(cases[k].iterations != 7000 || cases[k].cap - before < 2 ||
                        fabs((double)after / (double)before - cases[k].ratio) <= 2e-3);
        }
        assert_int_equal(f->model->count == cases[k].cap, cases[k].cap == 2000);
        drop(f);
    }
}

// Noise replaces the jitter: none up to 7000 iterations, the published amount at 30 000.
static void noise_begins_where_the_jitter_ends(void **state)
{
    (void)state;
    static const double expected[] = {0, 0.5, 1};
    sgs_train_options train = sgs_train_options_default();
    train.pipeline = SGS_PIPELINE_MCMC;
    for (size_t l = 0; l < 3; ++l) {
        train.iterations = lengths[l];
        const double noise = sgsi_pipeline_sampling(&train, 5).noise;
        assert_true(fabs(noise - expected[l] * 5e5) <= 5e5 * 1e-4);
    }
    train.iterations = 7000;
    train.schedule = SGS_SCHEDULE_PAPER;
    assert_true(sgsi_pipeline_sampling(&train, 5).noise == 5e5);
    train.schedule = SGS_SCHEDULE_SCALED;
    train.pipeline_options.mcmc_noise = 3; // a given value is used as it is
    assert_true(sgsi_pipeline_sampling(&train, 5).noise == 3);
    train.schedule = SGS_SCHEDULE_FINETUNE; // nothing relocates what the noise moves away
    assert_true(sgsi_pipeline_sampling(&train, 5).noise == 3);
    train.pipeline_options.mcmc_noise = -1;
    assert_true(sgsi_pipeline_sampling(&train, 5).noise == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(copies_are_jittered_in_a_short_run),
        cmocka_unit_test(sources_of_a_short_run_are_drawn_by_gradient),
        cmocka_unit_test(without_gradients_sources_are_drawn_by_opacity),
        cmocka_unit_test(growth_of_a_short_run_ends_after_a_fifth_of_the_updates),
        cmocka_unit_test(noise_begins_where_the_jitter_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
