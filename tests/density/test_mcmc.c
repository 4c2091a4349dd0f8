// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// 3DGS as Markov chain Monte Carlo (Kheradmand et al. 2024): the division of a primitive against
// quadrature, the paper's double sum and the reference renderer; noise against its distribution;
// regularisers against finite differences; the updates, without and with SPARE-GS, on models small
// enough to know every row's fate.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "density/position_noise.h"
#include "density/relocation.h"
#include "sparegs/runtime.h"
#include "support/density_support.h"
#include "support/tracer_support.h"

// ---- Dividing one primitive into n (equation 9) ----

static const double opacities[] = {0.006, 0.05, 0.5, 0.9, 0.99, 0.9999};
static const uint32_t parts[] = {1, 2, 3, 10, 51, 1000};

static void division_has_the_published_values(void **state)
{
    (void)state;
    const struct {
        double opacity;
        uint32_t n;
        double part, scale;
    } cases[] = {{.5, 2, .292893, .952152},
                 {.9, 2, .683772, .867938},
                 {.9, 5, .369043, .797124},
                 {.99, 10, .369043, .667350},
                 {.99, 50, .0879892, .642245}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const double part = sgsi_relocation_opacity(cases[i].opacity, cases[i].n),
                     scale = sgsi_relocation_scale(cases[i].opacity, cases[i].n);
        assert_true(fabs(part - cases[i].part) <= 1e-6 && fabs(scale - cases[i].scale) <= 1e-6);
    }
    assert_true(sgsi_relocation_clamp(0.001) == 0.005 && sgsi_relocation_clamp(1) < 1);
}

// 1 - (1 - part g)^n on a line through the centre, by the trapezoidal rule, whose error vanishes
// exponentially for Gaussians.
static void division_keeps_the_centre_and_the_integral_of_the_profile(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof opacities / sizeof *opacities; ++i)
        for (size_t k = 0; k < sizeof parts / sizeof *parts; ++k) {
            const double opacity = opacities[i], n = parts[k];
            const double part = sgsi_relocation_opacity(opacity, parts[k]),
                         scale = sgsi_relocation_scale(opacity, parts[k]), step = 0.02;
            const double center = -expm1(n * log1p(-part));
            if (!(fabs(center - opacity) <= 1e-12))
                fail_msg("opacity %g in %u: the centre is %.15g", opacity, parts[k], center);
            double sum = 0;
            for (int j = -2000; j <= 2000; ++j) {
                const double x = j * step;
                sum += -expm1(n * log1p(-part * exp(-0.5 * x * x / (scale * scale))));
            }
            const double expected = opacity * sqrt(2 * 3.141592653589793);
            if (!(fabs(sum * step - expected) <= 1e-9 * expected))
                fail_msg("opacity %g in %u: the integral is %.12g, not %.12g", opacity, parts[k],
                         sum * step, expected);
        }
}

static void division_agrees_with_the_double_sum_of_the_paper(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof opacities / sizeof *opacities; ++i)
        for (uint32_t n = 1; n <= 51; ++n) {
            const double part = sgsi_relocation_opacity(opacities[i], n);
            long double sum = 0;
            for (uint32_t row = 1; row <= n; ++row) {
                long double term = (long double)part; // C(row - 1, k) (-1)^k part^(k + 1)
                for (uint32_t k = 0; k < row; ++k) {
                    sum += term / sqrtl(k + 1);
                    term *= -(long double)part * (row - 1 - k) / (k + 1);
                }
            }
            const double expected = opacities[i] / (double)sum;
            const double scale = sgsi_relocation_scale(opacities[i], n);
            if (!(fabs(scale - expected) <= 1e-9 * expected))
                fail_msg("opacity %g in %u: %.12g, not %.12g", opacities[i], n, scale, expected);
        }
}

// Opacity of the middle pixel, and the sum over a row of pixels, of `count` equal balls.
static void draw_balls(uint32_t count, double opacity, double scale, double *middle, double *sum)
{
    const sgs_camera camera = {
        .model = SGS_CAMERA_PINHOLE, .width = 257, .height = 1, .params = {400, 400, 128.5, 0.5}};
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_render_options options = oracle_render_options(SGS_FILTER_NONE, 0, NULL);
    oracle_scene scene = oracle_scene_create(count);
    for (uint32_t i = 0; i < count; ++i)
        oracle_set_ball(oracle_primitive(&scene, i), 0, 0, 0, scale, opacity);
    sgs_reference_frame frame;
    assert_int_equal(sgs_reference_frame_create(camera.width, camera.height, &frame),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_reference_render(scene.params, count, &camera, &pose, &options, &frame),
                     SGS_STATUS_OK);
    *sum = 0;
    for (int x = 0; x < camera.width; ++x)
        *sum += 1 - frame.transmittance[x];
    *middle = 1 - frame.transmittance[128];
    sgs_reference_frame_free(&frame);
    oracle_scene_free(&scene);
}

// The limit of alpha, 1/255, cuts the tails of faint primitives a little earlier: below 2 %.
// Without the correction of the scale the sum is 5 to 50 % larger.
static void division_keeps_the_rendered_contribution(void **state)
{
    (void)state;
    for (double opacity = 0.5; opacity < 0.95; opacity += 0.2)
        for (uint32_t n = 2; n <= 8; n += 3) {
            double middle[2], sum[2];
            draw_balls(1, opacity, 0.2, &middle[0], &sum[0]);
            draw_balls(n, sgsi_relocation_opacity(opacity, n),
                       0.2 * sgsi_relocation_scale(opacity, n), &middle[1], &sum[1]);
            if (!(fabs(middle[1] - middle[0]) <= 1e-9 && fabs(sum[1] / sum[0] - 1) <= 0.02))
                fail_msg("opacity %g in %u: middle %g, not %g; sum %g, not %g", opacity, n,
                         middle[1], middle[0], sum[1], sum[0]);
        }
}

// ---- Draws ----

static void draws_follow_their_weights(void **state)
{
    (void)state;
    enum { DRAWS = 100000, ROWS = 7 };
    const double weight[ROWS] = {0, 1, 3, 0, 0.5, 5.5, 0};
    uint32_t *drawn = oracle_memory(DRAWS, sizeof *drawn), times[ROWS] = {0};
    bool drew;
    assert_int_equal(sgsi_draw_rows(weight, ROWS, DRAWS, 11, drawn, &drew), SGS_STATUS_OK);
    assert_true(drew);
    for (size_t j = 0; j < DRAWS; ++j) {
        assert_true(drawn[j] < ROWS);
        ++times[drawn[j]];
        double u = sgsi_random_uniform(11, j) * 10; // the j-th counter chooses the j-th row
        size_t row = 0;
        while (u >= weight[row])
            u -= weight[row++];
        assert_int_equal(drawn[j], row);
    }
    for (size_t i = 0; i < ROWS; ++i) {
        const double p = weight[i] / 10;
        assert_true(fabs(times[i] - DRAWS * p) <= 4 * sqrt(DRAWS * p * (1 - p)));
    }
    const double none[3] = {0};
    assert_int_equal(sgsi_draw_rows(none, 3, 5, 11, drawn, &drew), SGS_STATUS_OK);
    assert_false(drew);
    free(drawn);
}

// ---- Noise ----

enum { NOISY = 40000 };
static const double noise_scale = 3.0, faint = 0.003;

// Rows at the origin with the same shape and opacity; optionally the covariance of that shape.
static sgs_gaussians *equal_rows(double opacity, double sigma[9])
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(NOISY, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, NOISY), SGS_STATUS_OK);
    const double scales[3] = {0.3, 0.5, 1.1}, q[4] = {0.8, 0.4, -0.2, 0.4}; // |q| = 1
    float params[SGS_PARAM_COUNT] = {0};
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] = (float)log(scales[k]);
    for (int k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] = (float)(3 * q[k]); // need not be normalised
    params[SGS_PARAM_OPACITY] = (float)log(opacity / (1 - opacity));
    for (size_t i = 0; i < NOISY; ++i)
        sgs_gaussians_set(model, i, params);
    // Columns of the rotation: the quaternion applied to each axis, v + 2 u x (u x v + w v).
    for (int i = 0; i < 9; ++i)
        sigma[i] = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double v[3] = {axis == 0, axis == 1, axis == 2}, u[3] = {q[1], q[2], q[3]};
        double inner[3], outer[3], column[3];
        oracle_cross(u, v, inner);
        for (int k = 0; k < 3; ++k)
            inner[k] += q[0] * v[k];
        oracle_cross(u, inner, outer);
        for (int k = 0; k < 3; ++k)
            column[k] = v[k] + 2 * outer[k];
        for (int i = 0; i < 9; ++i)
            sigma[i] += scales[axis] * scales[axis] * column[i / 3] * column[i % 3];
    }
    return model;
}

static double moved(const sgs_gaussians *model, size_t i, int axis)
{
    return (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + axis);
}

// mean += c Sigma xi: mean 0, covariance c^2 Sigma^2. Bounds of five standard errors.
static void noise_has_the_mean_and_covariance_of_the_paper(void **state)
{
    (void)state;
    double sigma[9], expected[9] = {0}, mean[3] = {0}, covariance[9] = {0}, next[9] = {0};
    sgs_gaussians *model = equal_rows(faint, sigma);
    sgsi_position_noise_add(model, 0, 1, noise_scale, 5, 17);
    const double c = noise_scale * sgsi_position_noise_gate(faint);
    for (int i = 0; i < 9; ++i)
        for (int k = 0; k < 3; ++k)
            expected[i] += c * c * sigma[i / 3 * 3 + k] * sigma[k * 3 + i % 3];
    for (size_t i = 0; i < NOISY; ++i)
        for (int k = 0; k < 9; ++k) {
            mean[k % 3] += moved(model, i, k % 3) / (3.0 * NOISY);
            covariance[k] += moved(model, i, k / 3) * moved(model, i, k % 3) / NOISY;
            next[k] += moved(model, i, k / 3) * moved(model, (i + 1) % NOISY, k % 3) / NOISY;
        }
    for (int k = 0; k < 3; ++k)
        assert_true(fabs(mean[k]) <= 5 * sqrt(expected[4 * k] / NOISY));
    for (int k = 0; k < 9; ++k) {
        const double both = expected[4 * (k / 3)] * expected[4 * (k % 3)];
        if (!(fabs(covariance[k] - expected[k]) <=
              5 * sqrt((both + expected[k] * expected[k]) / NOISY)))
            fail_msg("covariance %d is %g, not %g", k, covariance[k], expected[k]);
        assert_true(fabs(next[k]) <= 5 * sqrt(both / NOISY)); // rows are independent
    }
    sgs_gaussians_destroy(model);
}

static void noise_is_gated_by_the_opacity(void **state)
{
    (void)state;
    assert_true(fabs(sgsi_position_noise_gate(0.005) - 0.5) <= 1e-12);
    assert_true(fabs(sgsi_position_noise_gate(0.05) - 0.010987) <= 1e-6);
    assert_true(fabs(sgsi_position_noise_gate(0.1) - 7.4846e-5) <= 1e-8);
    double sigma[9];
    sgs_gaussians *clear = equal_rows(0.1, sigma), *solid = equal_rows(0.151, sigma),
                  *thin = equal_rows(0.005, sigma);
    sgsi_position_noise_add(clear, 0, 1, 1, 5, 17);
    sgsi_position_noise_add(solid, 0, 1, 1, 5, 17);
    sgsi_position_noise_add(thin, 0, 1, 1, 5, 17);
    for (size_t i = 0; i < NOISY; i += 97)
        for (int k = 0; k < 3; ++k) {
            assert_true(moved(solid, i, k) == 0);
            assert_true(fabs(moved(clear, i, k) / moved(thin, i, k) / (7.4846e-5 / 0.5) - 1) <=
                        1e-4);
        }
    sgs_gaussians_destroy(clear);
    sgs_gaussians_destroy(solid);
    sgs_gaussians_destroy(thin);
}

// Seed, iteration and row determine it; the number of threads does not.
static void noise_is_a_function_of_its_counters(void **state)
{
    (void)state;
    char first[17] = "", hash[17] = "";
    double sigma[9];
    for (int k = 0; k < 6; ++k) {
        sgs_gaussians *model = equal_rows(faint, sigma);
        sgs_threads_set(k < 3 ? k + 1 : 2);
        sgsi_position_noise_add(model, 0, 1, 1, k == 3 ? 6 : 5, k == 4 ? 18 : 17);
        if (k == 5)
            sgsi_position_noise_add(model, 0, 1, 1, 5, 17);
        sgs_gaussians_hash(model, k ? hash : first);
        if (k)
            assert_int_equal(strcmp(hash, first) == 0, k < 3);
        sgs_gaussians_destroy(model);
    }
    sgs_threads_set(0);
}

// ---- Regularisers ----

static const double opacity_weight = 0.7, scale_weight = 0.3;

static double regulariser(const double *p)
{
    return opacity_weight / (1 + exp(-p[SGS_PARAM_OPACITY])) +
           scale_weight * (exp(p[SGS_PARAM_SCALE]) + exp(p[SGS_PARAM_SCALE + 1]) +
                           exp(p[SGS_PARAM_SCALE + 2]));
}

// Of all rows, though no ray has met any.
static void regularisers_have_the_gradient_of_their_loss(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(6, 40, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16);
    const sgs_pose pose = oracle_pose_look_at(0.5, 0.3, -4);
    const sgs_isa best = sgs_isa_get();
    for (int isa = 0; isa <= SGS_ISA_AVX512; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        for (sgs_filter filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            traced_view traced =
                traced_create(scene.model, &camera, &pose, filter, 2, SGSI_BVH_LOW);
            uint8_t *untouched = sgsi_calloc(scene.model->capacity / 16, 1);
            float *gradients =
                sgsi_calloc(scene.model->capacity, SGS_PARAM_COUNT * sizeof *gradients);
            const sgsi_optimize input = {.params = scene.model->data,
                                         .count = scene.count,
                                         .view = traced.view,
                                         .sums = sgsi_tracer_grad_sums(traced.tracer),
                                         .touched = untouched,
                                         .opacity_loss = (float)opacity_weight,
                                         .scale_loss = (float)scale_weight,
                                         .gradients = gradients};
            sgsi_optimize_blocks(&input, 0, (scene.count + 15) / 16);
            for (size_t i = 0; i < scene.count; ++i)
                for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
                    double *p = oracle_primitive(&scene, i), kept = p[k];
                    p[k] = kept + 1e-5;
                    double expected = regulariser(p);
                    p[k] = kept - 1e-5;
                    expected = (expected - regulariser(p)) / 2e-5;
                    p[k] = kept;
                    const double actual =
                        (double)gradients[(i / 16 * SGS_PARAM_COUNT + (size_t)k) * 16 + i % 16];
                    if (!(fabs(actual - expected) <= 1e-4 * fabs(expected) + 1e-9))
                        fail_msg("%s, row %zu, parameter %d: %g, not %g",
                                 sgs_isa_name((sgs_isa)isa), i, k, actual, expected);
                }
            sgsi_free(untouched);
            sgsi_free(gradients);
            traced_destroy(&traced);
        }
    }
    sgs_isa_set(best);
    oracle_scene_free(&scene);
}

// ---- Updates ----

static float *moment_of(const fixture *f, float *moments, size_t i, int k)
{
    (void)f;
    return moments + (i / SGS_LANES * SGS_PARAM_COUNT + (size_t)k) * SGS_LANES + i % SGS_LANES;
}

// Moments that carry the number of their row, and one as second moment.
static void mark_moments(fixture *f)
{
    for (size_t i = 0; i < f->model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            *moment_of(f, f->m, i, k) = 1 + (float)i;
            *moment_of(f, f->v, i, k) = 1;
        }
}

static double opacity_of(const fixture *f, size_t i)
{
    return 1 / (1 + exp(-(double)*sgs_gaussians_at(f->model, i, SGS_PARAM_OPACITY)));
}

// At the cap, 30 dead rows among 100: each takes the place of a living one.
static void dead_rows_are_relocated(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 100, 1e-3f);
    f->options.max_count = 100;
    f->options.growth = 0.05;
    for (size_t i = 0; i < 30; ++i)
        set_faint(f, i);
    mark_moments(f);
    assert_int_equal(update(f), 100);
    assert_int_equal(f->result.relocated, 30);
    assert_int_equal(f->result.pruned + f->result.cloned, 0);
    size_t dead = 0, sources = 0, zeroed = 0;
    for (size_t i = 0; i < 100; ++i) {
        const float row = *sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC),
                    moment = *moment_of(f, f->m, i, 7);
        const size_t n = copies_of(f, row);
        assert_true(row >= 30);
        const double scale =
            exp((double)*sgs_gaussians_at(f->model, i, SGS_PARAM_SCALE + 1)) / (double)0.005f;
        assert_true(fabs(opacity_of(f, i) - sgsi_relocation_opacity(0.5, (uint32_t)n)) <= 1e-6);
        assert_true(fabs(scale - sgsi_relocation_scale(0.5, (uint32_t)n)) <= 1e-5);
        for (int k = 0; k < 3; ++k) // at the place of the source
            assert_true(*sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + k) ==
                        (float)sgsi_random_uniform(9, 3 * (uint64_t)row + (uint64_t)k));
        sources += n > 1 && moment == 0;
        zeroed += moment == 0;
        dead += moment > 0 && moment <= 30; // the dead keep their moments
        assert_int_equal(moment == 0, *moment_of(f, f->v, i, 7) == 0);
        assert_true(moment == 0 || moment <= 30 || (n == 1 && moment == 1 + row));
    }
    assert_int_equal(dead, 30);
    assert_true(sources == zeroed && sources > 5 && sources <= 30);
    drop(f);
}

// Sources by opacity: 0.9 and 0.1 in equal numbers.
static void sources_are_drawn_by_opacity(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 8000, 1e-3f);
    f->options.max_count = 8000;
    for (size_t i = 0; i < 8000; ++i)
        *sgs_gaussians_at(f->model, i, SGS_PARAM_OPACITY) =
            i < 4000 ? -6.0f : (float)(i % 2 ? log(9) : -log(9));
    assert_int_equal(update(f), 8000);
    double strong = 0;
    for (size_t i = 0; i < 8000; ++i)
        strong += (int)*sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC) % 2;
    // 2000 stay, 4000 draws with p = 0.9.
    assert_true(fabs(strong - 2000 - 3600) <= 4 * sqrt(4000 * 0.9 * 0.1));
    drop(f);
}

static void growth_is_five_per_cent_up_to_the_cap(void **state)
{
    (void)state;
    const struct {
        size_t cap, initial, expected;
    } cases[] = {{0, 1000, 1050}, {1020, 1000, 1020}, {1000, 1000, 1000}, {500, 1000, 1000},
                 {0, 102, 1020},  {0, 100, 1000},     {0, 200000, 1050}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        fixture *f = make(&sgsi_pipeline_mcmc, 1000, 1e-3f);
        f->options.growth = 0.05;
        f->options.max_count = cases[k].cap;
        f->state.initial_count = (int64_t)cases[k].initial;
        mark_moments(f);
        assert_int_equal(update(f), cases[k].expected);
        assert_int_equal(f->result.cloned, cases[k].expected - 1000);
        assert_int_equal(f->result.relocated, 0);
        for (size_t i = 0; i < f->model->count; ++i) {
            const float row = *sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC);
            const uint32_t n = (uint32_t)copies_of(f, row);
            assert_true(fabs(opacity_of(f, i) - sgsi_relocation_opacity(0.5, n)) <= 1e-6);
            assert_true(*moment_of(f, f->m, i, 3) == (n > 1 ? 0 : 1 + row));
        }
        drop(f);
    }
}

// A row that was relocated to may be a source of growth at once; the count of its copies still
// determines its opacity: two divisions in a row are one.
static void relocation_and_growth_combine(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 10, 1e-3f);
    f->options.growth = 1;
    f->options.max_count = 20;
    for (size_t i = 1; i < 10; ++i)
        set_faint(f, i);
    assert_int_equal(update(f), 20);
    assert_int_equal(copies_of(f, 0), 20);
    double clear = 1; // what all rows let through in the centre
    for (size_t i = 0; i < 20; ++i)
        clear *= 1 - opacity_of(f, i);
    assert_true(fabs(clear - 0.5) <= 1e-5);
    drop(f);
}

static void without_a_living_row_nothing_moves(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 50, 1e-3f);
    f->options.max_count = 50;
    for (size_t i = 0; i < 50; ++i)
        set_faint(f, i);
    assert_int_equal(update(f), 50);
    for (int i = 0; i < 50; ++i)
        assert_int_equal(copies_of(f, (float)i), 1);
    drop(f);
}

static void rows_that_are_not_finite_are_removed_and_never_drawn(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_mcmc, 100, 1e-3f);
    f->options.growth = 0.05;
    f->options.max_count = 100;
    for (size_t i = 0; i < 20; ++i) {
        if (i % 2)
            set_faint(f, i);
        else
            *sgs_gaussians_at(f->model, i, SGS_PARAM_OPACITY) = NAN;
    }
    assert_int_equal(update(f), 90 + 4); // 5 % of the 90 that stay
    assert_int_equal(f->result.pruned, 10);
    for (size_t i = 0; i < f->model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            assert_true(isfinite(*sgs_gaussians_at(f->model, i, k)));
    drop(f);
}

// ---- SPARE-GS ----

// 150 rows in one voxel and 50 in voxels of their own.
static void crowd(fixture *f)
{
    for (size_t i = 0; i < 200; ++i) {
        *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN) =
            i < 150 ? 0.01f * (float)sgsi_random_uniform(3, i) : 0.2f + 0.016f * (float)(i - 150);
        *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 1) =
            *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 2) = 0;
        f->statistics.radius_max[i] = 4;
    }
}

// The weights that the update will compute.
static void weights_of(const fixture *f, float weights[200])
{
    float x[200], y[200] = {0}, z[200] = {0}, opacity[200];
    uint8_t redundant[200];
    for (size_t i = 0; i < 200; ++i) {
        x[i] = *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN);
        opacity[i] = (float)opacity_of(f, i);
    }
    const spare_input input = {.count = 200,
                               .x = x,
                               .y = y,
                               .z = z,
                               .opacity = opacity,
                               .gradient_sum = f->statistics.gradient_sum,
                               .visible_count = f->statistics.visible_count,
                               .radius_max = f->statistics.radius_max};
    void *memory = sgsi_alloc(spare_workspace_size(&f->spare, 200), 1);
    spare_result result;
    spare_evaluate(&f->spare, &input, memory, weights, redundant, &result);
    sgsi_free(memory);
}

// Growth adds floor(growth * sum of min(w, 1)), and crowded rows are drawn less often.
static void weights_change_the_growth_and_the_draws(void **state)
{
    (void)state;
    size_t crowded[2], count[2];
    for (int spare = 0; spare < 2; ++spare) {
        fixture *f = make(&sgsi_pipeline_mcmc, 200, 2e-4f);
        float weights[200];
        crowd(f);
        weights_of(f, weights);
        f->options.spare_densify = spare;
        f->options.growth = 1;
        double sum = 0;
        for (size_t i = 0; i < 200; ++i)
            sum += spare ? fmin((double)weights[i], 1) : 1;
        assert_true(spare ? sum < 180 && sum > 120 : sum == 200);
        count[spare] = update(f);
        assert_int_equal(count[spare], 200 + (size_t)floor(sum));
        crowded[spare] = 0;
        for (int i = 0; i < 150; ++i)
            crowded[spare] += copies_of(f, (float)i) - 1;
        drop(f);
    }
    const double before = (double)crowded[0] / (double)(count[0] - 200),
                 after = (double)crowded[1] / (double)(count[1] - 200);
    assert_true(before > 0.65 && after < before - 0.02);
}

// Opacities of 0.01 to 0.04 for the 150 crowded rows.
static void make_faint(fixture *f)
{
    for (size_t i = 0; i < 150; ++i) {
        const double opacity = 0.01 + 0.0002 * (double)i;
        *sgs_gaussians_at(f->model, i, SGS_PARAM_OPACITY) = (float)log(opacity / (1 - opacity));
    }
}

// 150 crowded rows that no view pulls, with opacities of 0.01 to 0.04: the faintest go, as many as
// growth may add, and the cap with them.
static void redundant_rows_leave_faintest_first_and_lower_the_cap(void **state)
{
    (void)state;
    for (int relocates = 0; relocates < 2; ++relocates) {
        fixture *f = make(&sgsi_pipeline_mcmc, 200, 1e-5f);
        crowd(f);
        make_faint(f);
        f->options.spare_prune = true;
        f->options.growth = relocates ? 0.05 : 1; // a scaled growth does not raise the limit
        f->options.max_count = 200;
        f->train.iterations = relocates ? 30000 : 7000;
        f->train.pipeline_options.mcmc_redundant = relocates ? SGS_MCMC_RELOCATE : SGS_MCMC_DELETE;
        assert_int_equal(update(f), relocates ? 200 : 190);
        assert_int_equal(f->result.spare_pruned, relocates ? 0 : 10);
        assert_int_equal(f->result.relocated, relocates ? 10 : 0);
        assert_int_equal(f->result.spare_deferred, 140);
        assert_int_equal(f->state.deleted, relocates ? 0 : 10);
        for (int i = 0; i < 150; ++i)
            assert_true(i < 10 ? copies_of(f, (float)i) == 0 : copies_of(f, (float)i) >= 1);
        if (!relocates) { // the place of what was deleted stays empty
            f->options.spare_prune = false;
            assert_int_equal(update(f), 190);
        }
        drop(f);
    }
}

// With the published growth of 5 %, an update deletes at most half of what it may add.
static void published_runs_delete_half_of_the_growth(void **state)
{
    (void)state;
    const size_t caps[] = {1000, 204, 200}, deleted[] = {5, 2, 0};
    for (size_t k = 0; k < sizeof caps / sizeof *caps; ++k) {
        fixture *f = make(&sgsi_pipeline_mcmc, 200, 1e-5f);
        crowd(f);
        make_faint(f);
        f->options.spare_prune = true;
        f->options.growth = 0.05;
        f->options.max_count = caps[k];
        f->train.iterations = 30000;
        update(f);
        assert_int_equal(f->result.spare_pruned, deleted[k]);
        assert_int_equal(f->result.spare_deferred, 150 - deleted[k]);
        assert_int_equal(f->state.deleted, deleted[k]);
        drop(f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(division_has_the_published_values),
        cmocka_unit_test(division_keeps_the_centre_and_the_integral_of_the_profile),
        cmocka_unit_test(division_agrees_with_the_double_sum_of_the_paper),
        cmocka_unit_test(division_keeps_the_rendered_contribution),
        cmocka_unit_test(draws_follow_their_weights),
        cmocka_unit_test(noise_has_the_mean_and_covariance_of_the_paper),
        cmocka_unit_test(noise_is_gated_by_the_opacity),
        cmocka_unit_test(noise_is_a_function_of_its_counters),
        cmocka_unit_test(regularisers_have_the_gradient_of_their_loss),
        cmocka_unit_test(dead_rows_are_relocated),
        cmocka_unit_test(sources_are_drawn_by_opacity),
        cmocka_unit_test(growth_is_five_per_cent_up_to_the_cap),
        cmocka_unit_test(relocation_and_growth_combine),
        cmocka_unit_test(without_a_living_row_nothing_moves),
        cmocka_unit_test(rows_that_are_not_finite_are_removed_and_never_drawn),
        cmocka_unit_test(weights_change_the_growth_and_the_draws),
        cmocka_unit_test(redundant_rows_leave_faintest_first_and_lower_the_cap),
        cmocka_unit_test(published_runs_delete_half_of_the_growth),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
