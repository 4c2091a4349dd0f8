// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Gradients of the reference renderer against central finite differences in double precision: all
// 59 parameters of every primitive, for three lenses and all filters, for losses on colour and on
// transmittance. The image jumps where a hit appears, ends a ray or changes places, and has kinks
// at the clamps. A parameter whose stencil crosses one of these (detected by comparing every hit
// list and every clamp) is skipped, and the number of skips is limited. The checker itself is
// tested with wrong gradients.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <float.h>
#include <stdio.h>

#include "support/oracle_support.h"
#include "reference/reference.h"
#include "base/threads.h"

enum { WIDTH = 12, HEIGHT = 9, PIXELS = WIDTH * HEIGHT };
enum { LOSS_COLOR, LOSS_TRANSMITTANCE, LOSS_COUNT };

static const double tolerance = 1e-6;

typedef struct setup {
    const char *name;
    sgs_camera_model lens;
    sgs_filter filter;
    bool dense; // many opaque primitives: rays end at T < 1e-4
} setup;

static const setup setups[] = {
    {"gradients_match_finite_differences_pinhole_3dgs", SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS, false},
    {"gradients_match_finite_differences_pinhole_none", SGS_CAMERA_PINHOLE, SGS_FILTER_NONE, false},
    {"gradients_match_finite_differences_pinhole_mip", SGS_CAMERA_PINHOLE, SGS_FILTER_MIP, false},
    {"gradients_match_finite_differences_opencv_3dgs", SGS_CAMERA_OPENCV, SGS_FILTER_3DGS, false},
    {"gradients_match_finite_differences_opencv_none", SGS_CAMERA_OPENCV, SGS_FILTER_NONE, false},
    {"gradients_match_finite_differences_opencv_mip", SGS_CAMERA_OPENCV, SGS_FILTER_MIP, false},
    {"gradients_match_finite_differences_fisheye_3dgs", SGS_CAMERA_OPENCV_FISHEYE, SGS_FILTER_3DGS,
     false},
    {"gradients_match_finite_differences_fisheye_none", SGS_CAMERA_OPENCV_FISHEYE, SGS_FILTER_NONE,
     false},
    {"gradients_match_finite_differences_fisheye_mip", SGS_CAMERA_OPENCV_FISHEYE, SGS_FILTER_MIP,
     false},
    {"gradients_match_finite_differences_when_rays_stop", SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS,
     true},
};
enum { SETUP_COUNT = sizeof setups / sizeof *setups };

// A scene, a view of it, and L = sum(d_color C) + sum(d_transmittance T) with random weights.
typedef struct problem {
    oracle_scene scene;
    sgs_camera camera;
    sgs_pose pose;
    sgs_render_options options;
    double *d_color[3], *d_transmittance;
} problem;

static problem problem_create(const setup *s, uint64_t seed)
{
    problem p = {.camera = oracle_camera(s->lens, WIDTH, HEIGHT)};
    const oracle_range sparse = {0.8, 0.1, 0.5, 0.05, 0.95, 0.15},
                       dense = {0.7, 0.3, 0.8, 0.7, 0.97, 0.15};
    p.scene = oracle_random_model(seed, s->dense ? 20 : 12, s->dense ? &dense : &sparse);
    p.pose = s->lens == SGS_CAMERA_OPENCV_FISHEYE ? oracle_pose_look_at(0.7, -0.4, -1.5)
                                                  : oracle_pose_look_at(1.3, -0.7, -2.4);
    p.options = oracle_render_options(s->filter, 3, p.scene.filter_3d);
    oracle_random random = {.seed = seed + 1};
    for (int c = 0; c < 3; ++c)
        p.d_color[c] = oracle_memory(PIXELS, sizeof(double));
    p.d_transmittance = oracle_memory(PIXELS, sizeof(double));
    for (int i = 0; i < PIXELS; ++i) {
        for (int c = 0; c < 3; ++c)
            p.d_color[c][i] = oracle_normal(&random) / PIXELS;
        p.d_transmittance[i] = oracle_normal(&random) / PIXELS;
    }
    return p;
}

static void problem_free(problem *p)
{
    for (int c = 0; c < 3; ++c)
        free(p->d_color[c]);
    free(p->d_transmittance);
    oracle_scene_free(&p->scene);
}

static size_t problem_values(const problem *p)
{
    return p->scene.count * SGS_PARAM_COUNT;
}

// Losses of a rendering with the current parameters, and the sums of the magnitudes of their terms.
static void evaluate(const problem *p, sgs_reference_frame *frame, double loss[LOSS_COUNT],
                     double magnitude[LOSS_COUNT])
{
    assert_int_equal(sgs_reference_render(p->scene.params, p->scene.count, &p->camera, &p->pose,
                                          &p->options, frame),
                     SGS_STATUS_OK);
    memset(loss, 0, LOSS_COUNT * sizeof *loss);
    memset(magnitude, 0, LOSS_COUNT * sizeof *magnitude);
    for (int i = 0; i < PIXELS; ++i) {
        for (int c = 0; c < 3; ++c) {
            loss[LOSS_COLOR] += p->d_color[c][i] * frame->color[c][i];
            magnitude[LOSS_COLOR] += fabs(p->d_color[c][i]) * frame->color[c][i];
        }
        loss[LOSS_TRANSMITTANCE] += p->d_transmittance[i] * frame->transmittance[i];
        magnitude[LOSS_TRANSMITTANCE] += fabs(p->d_transmittance[i]) * frame->transmittance[i];
    }
}

// Identifies the smooth piece of the image function: the ordered ids of every pixel with the state
// of the 0.99 clamp, and the clamped colour channels. Needs count + PIXELS (count + 1) words.
// Returns the number of words used.
static size_t write_piece(const problem *p, uint32_t *words)
{
    sgsi_reference_view view;
    assert_int_equal(sgsi_reference_view_create(p->scene.params, p->scene.count, &p->camera,
                                                &p->pose, &p->options, &view),
                     SGS_STATUS_OK);
    sgs_hit *hits = oracle_memory(p->scene.count, sizeof *hits);
    size_t used = 0;
    for (size_t i = 0; i < view.count; ++i) {
        const bool *clamped = view.primitives[i].color_clamped;
        words[used++] = (uint32_t)(clamped[0] + 2 * clamped[1] + 4 * clamped[2]);
    }
    for (int y = 0; y < HEIGHT; ++y) {
        for (int x = 0; x < WIDTH; ++x) {
            double direction[3];
            assert_true(sgsi_reference_ray(&view, x, y, direction));
            const size_t count = sgsi_reference_trace(&view, direction, hits);
            words[used++] = (uint32_t)count;
            for (size_t k = 0; k < count; ++k)
                words[used++] = 2 * hits[k].primitive + !(hits[k].alpha < 0.99);
        }
    }
    free(hits);
    sgsi_reference_view_free(&view);
    return used;
}

// ---- Finite differences of all parameters ----

typedef struct difference_table {
    double *value[LOSS_COUNT], *scale[LOSS_COUNT]; // [count][SGS_PARAM_COUNT]
    bool *skipped;
    size_t skipped_count;
} difference_table;

// Natural unit of a parameter: the change that changes a response by about its own size.
static double natural_unit(const sgsi_reference_primitive *primitive, int param)
{
    const double *v = primitive->variance_view;
    const double thin = sqrt(fmin(v[0], fmin(v[1], v[2]))),
                 wide = sqrt(fmax(v[0], fmax(v[1], v[2])));
    if (param < SGS_PARAM_ROTATION)
        return thin;
    if (param < SGS_PARAM_SCALE)
        return primitive->quaternion_norm * thin / wide;
    return param < SGS_PARAM_SH_DC ? 1 : 10;
}

// Fourth-order central difference at steps h and 2h. Its truncation error is h^4 f'''''/30, below
// 1e-13 of f in natural units for h = 2e-4. The rest is rounding: a loss with terms of magnitude A
// has an error of a few eps A, which the stencil multiplies by 18/12 / h. `scale` makes this noise,
// taken as 16 eps A / h, the tolerance.
static void difference_one(problem *p, sgs_reference_frame *frame, size_t index, double h,
                           const uint32_t *piece, size_t piece_words, uint32_t *words,
                           difference_table *table)
{
    static const double step[4] = {-2, -1, 1, 2}, weight[4] = {1, -8, 8, -1};
    double *param = &p->scene.params[index], magnitude[LOSS_COUNT], sum[LOSS_COUNT] = {0};
    const double centre = *param;
    for (int k = 0; k < 4; ++k) {
        double loss[LOSS_COUNT];
        *param = centre + step[k] * h;
        evaluate(p, frame, loss, magnitude);
        const size_t used = write_piece(p, words);
        if (used != piece_words || memcmp(words, piece, used * sizeof *words) != 0)
            table->skipped[index] = true;
        for (int l = 0; l < LOSS_COUNT; ++l)
            sum[l] += weight[k] * loss[l];
    }
    *param = centre;
    table->skipped_count += table->skipped[index];
    for (int l = 0; l < LOSS_COUNT; ++l) {
        table->value[l][index] = sum[l] / (12 * h);
        table->scale[l][index] = 16 * DBL_EPSILON * magnitude[l] / h / tolerance;
    }
}

static difference_table difference_all(problem *p)
{
    difference_table table = {.skipped = oracle_memory(problem_values(p), sizeof(bool))};
    for (int l = 0; l < LOSS_COUNT; ++l) {
        table.value[l] = oracle_memory(problem_values(p), sizeof(double));
        table.scale[l] = oracle_memory(problem_values(p), sizeof(double));
    }
    const size_t room = p->scene.count + PIXELS * (p->scene.count + 1);
    uint32_t *piece = oracle_memory(room, sizeof *piece),
             *words = oracle_memory(room, sizeof *words);
    const size_t piece_words = write_piece(p, piece);
    sgs_reference_frame frame;
    sgsi_reference_view view;
    assert_int_equal(sgs_reference_frame_create(WIDTH, HEIGHT, &frame), SGS_STATUS_OK);
    assert_int_equal(sgsi_reference_view_create(p->scene.params, p->scene.count, &p->camera,
                                                &p->pose, &p->options, &view),
                     SGS_STATUS_OK);
    for (size_t index = 0; index < problem_values(p); ++index) {
        const double unit =
            natural_unit(&view.primitives[index / SGS_PARAM_COUNT], (int)(index % SGS_PARAM_COUNT));
        difference_one(p, &frame, index, 2e-4 * unit, piece, piece_words, words, &table);
    }
    sgsi_reference_view_free(&view);
    sgs_reference_frame_free(&frame);
    free(piece);
    free(words);
    return table;
}

static void difference_free(difference_table *table)
{
    for (int l = 0; l < LOSS_COUNT; ++l) {
        free(table->value[l]);
        free(table->scale[l]);
    }
    free(table->skipped);
}

// The checker: largest error of a gradient against the differences of one loss.
static double worst_gradient_error(const difference_table *table, int loss, const double *gradient,
                                   size_t count)
{
    double worst = 0;
    for (size_t i = 0; i < count; ++i)
        if (!table->skipped[i])
            worst = fmax(worst,
                         oracle_error(gradient[i], table->value[loss][i], table->scale[loss][i]));
    return worst;
}

static void gradient_of(const problem *p, int loss, double *d_params, double *d_mean_no_sh)
{
    double *zero = oracle_memory(PIXELS, sizeof *zero);
    const double *const none[3] = {zero, zero, zero};
    const double *const color[3] = {p->d_color[0], p->d_color[1], p->d_color[2]};
    assert_int_equal(sgs_reference_backward(p->scene.params, p->scene.count, &p->camera, &p->pose,
                                            &p->options, loss == LOSS_COLOR ? color : none,
                                            loss == LOSS_COLOR ? NULL : p->d_transmittance,
                                            d_params, d_mean_no_sh),
                     SGS_STATUS_OK);
    free(zero);
}

// Number of rays with hits that are not counted because T would fall below 1e-4.
static size_t stopped_rays(const problem *p)
{
    sgsi_reference_view view;
    assert_int_equal(sgsi_reference_view_create(p->scene.params, p->scene.count, &p->camera,
                                                &p->pose, &p->options, &view),
                     SGS_STATUS_OK);
    sgs_hit *hits = oracle_memory(p->scene.count, sizeof *hits);
    size_t stopped = 0;
    for (int pixel = 0; pixel < PIXELS; ++pixel) {
        double direction[3];
        assert_true(sgsi_reference_ray(&view, pixel % WIDTH, pixel / WIDTH, direction));
        size_t met = 0;
        for (size_t i = 0; i < view.count; ++i) {
            double rho_squared, t;
            sgsi_reference_response(&view.primitives[i], direction, &rho_squared, &t);
            met += view.primitives[i].opacity * exp(-0.5 * rho_squared) >= 1.0 / 255 && t > 0.2;
        }
        stopped += sgsi_reference_trace(&view, direction, hits) < met;
    }
    free(hits);
    sgsi_reference_view_free(&view);
    return stopped;
}

static void gradients_match_finite_differences(void **state)
{
    const setup *s = *state;
    problem p = problem_create(s, 11 + (uint64_t)(s - setups));
    assert_true(!s->dense || stopped_rays(&p) > PIXELS / 4);
    difference_table table = difference_all(&p);
    const size_t values = problem_values(&p);
    double *gradient = oracle_memory(values, sizeof *gradient);
    for (int loss = 0; loss < LOSS_COUNT; ++loss) {
        gradient_of(&p, loss, gradient, NULL);
        const double worst = worst_gradient_error(&table, loss, gradient, values);
        size_t moving = 0, meaningful = 0;
        for (size_t i = 0; i < values; ++i) {
            moving += gradient[i] != 0;
            meaningful += fabs(gradient[i]) > table.scale[loss][i];
        }
        print_message("    loss %d: worst error %.2g; %zu of %zu parameters skipped; %zu of %zu "
                      "gradients above noise\n",
                      loss, worst, table.skipped_count, values, meaningful, moving);
        assert_true(worst <= tolerance);
        // The transmittance depends on the 11 geometric parameters only.
        assert_true(moving > (loss == LOSS_COLOR ? values : p.scene.count * 11) * 3 / 4);
        assert_true(meaningful > moving * 9 / 10);
    }
    assert_true(table.skipped_count < values / 10);
    free(gradient);
    difference_free(&table);
    problem_free(&p);
}

// ---- The checker must detect errors ----

typedef enum planted_error {
    PLANTED_MEAN_SIGN,
    PLANTED_SCALE_DOUBLED,
    PLANTED_ROTATION_TRANSPOSED,
    PLANTED_OPACITY_SIGN,
    PLANTED_SH_SHIFTED,
    PLANTED_NO_SH_DIRECTION,
    PLANTED_ONE_NAN,
    PLANTED_COUNT
} planted_error;

static void plant(planted_error error, const double *d_mean_no_sh, size_t count, double *gradient)
{
    for (size_t i = 0; i < count; ++i) {
        double *d = gradient + i * SGS_PARAM_COUNT;
        switch (error) {
        case PLANTED_MEAN_SIGN:
            d[SGS_PARAM_MEAN] = -d[SGS_PARAM_MEAN];
            break;
        case PLANTED_SCALE_DOUBLED:
            d[SGS_PARAM_SCALE + 1] *= 2;
            break;
        case PLANTED_ROTATION_TRANSPOSED: // R^T is the matrix of the conjugate quaternion
            for (int k = 1; k < 4; ++k)
                d[SGS_PARAM_ROTATION + k] = -d[SGS_PARAM_ROTATION + k];
            break;
        case PLANTED_OPACITY_SIGN:
            d[SGS_PARAM_OPACITY] = -d[SGS_PARAM_OPACITY];
            break;
        case PLANTED_SH_SHIFTED:
            d[SGS_PARAM_SH_REST + 5] = d[SGS_PARAM_SH_REST + 8];
            break;
        case PLANTED_NO_SH_DIRECTION:
            memcpy(d + SGS_PARAM_MEAN, d_mean_no_sh + 3 * i, 3 * sizeof *d);
            break;
        default:
            break;
        }
    }
    if (error == PLANTED_ONE_NAN)
        gradient[SGS_PARAM_MEAN + 2] = NAN;
}

static void checker_fails_on_planted_errors(void **state)
{
    (void)state;
    problem p = problem_create(&setups[0], 11);
    difference_table table = difference_all(&p);
    const size_t values = problem_values(&p);
    double *gradient = oracle_memory(values, sizeof *gradient),
           *planted = oracle_memory(values, sizeof *planted);
    double *d_mean_no_sh = oracle_memory(p.scene.count * 3, sizeof *d_mean_no_sh);
    gradient_of(&p, LOSS_COLOR, gradient, d_mean_no_sh);
    assert_true(worst_gradient_error(&table, LOSS_COLOR, gradient, values) <= tolerance);
    assert_false(table.skipped[SGS_PARAM_MEAN + 2]);
    for (int error = 0; error < PLANTED_COUNT; ++error) {
        memcpy(planted, gradient, values * sizeof *planted);
        plant((planted_error)error, d_mean_no_sh, p.scene.count, planted);
        const double worst = worst_gradient_error(&table, LOSS_COLOR, planted, values);
        assert_false(worst <= tolerance);
        assert_true(worst > 0.1); // by a clear margin
    }
    free(gradient);
    free(planted);
    free(d_mean_no_sh);
    difference_free(&table);
    problem_free(&p);
}

// ---- Properties that finite differences cannot test ----

// Without the SH direction the gradient is that of a model with view-independent colours.
static void mean_gradient_without_sh_is_that_of_painted_colours(void **state)
{
    (void)state;
    for (int s = 0; s < SETUP_COUNT; ++s) {
        problem p = problem_create(&setups[s], 40);
        sgsi_reference_view view;
        double *painted = oracle_memory(problem_values(&p), sizeof *painted);
        double *d_mean = oracle_memory(p.scene.count * 3, sizeof *d_mean);
        gradient_of(&p, LOSS_COLOR, painted, d_mean);
        assert_int_equal(sgsi_reference_view_create(p.scene.params, p.scene.count, &p.camera,
                                                    &p.pose, &p.options, &view),
                         SGS_STATUS_OK);
        for (size_t i = 0; i < p.scene.count; ++i) {
            const double *color = view.primitives[i].color;
            oracle_set_color(oracle_primitive(&p.scene, i), color[0], color[1], color[2]);
        }
        p.options.sh_degree = 0;
        gradient_of(&p, LOSS_COLOR, painted, NULL);
        for (size_t i = 0; i < p.scene.count; ++i)
            assert_true(oracle_worst_error(d_mean + 3 * i, painted + i * SGS_PARAM_COUNT, 3,
                                           1e-3) <= 1e-10);
        sgsi_reference_view_free(&view);
        free(painted);
        free(d_mean);
        problem_free(&p);
    }
}

// One ball on the axis of a one-pixel camera: everything has a closed form.
static void ball_gradient(const double *ball, double *d_params)
{
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, 1, 1, {100, 100, 0.5, 0.5}};
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    const sgs_render_options options = oracle_render_options(SGS_FILTER_NONE, 3, NULL);
    const double one[1] = {1};
    const double *const d_color[3] = {one, one, one};
    assert_int_equal(
        sgs_reference_backward(ball, 1, &camera, &pose, &options, d_color, NULL, d_params, NULL),
        SGS_STATUS_OK);
}

static void clamp_of_alpha_is_straight_through(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT], d[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.999);
    oracle_set_color(ball, 0.75, 0.5, 0.25);
    ball_gradient(ball, d);
    assert_true(oracle_error(d[SGS_PARAM_OPACITY], 1.5 * 0.999 * 0.001, 0) <= 1e-12);
    assert_true(oracle_error(d[SGS_PARAM_SH_DC], 0.99 * 0.28209479177387814, 0) <= 1e-12);
}

static void clamped_colour_channel_has_no_gradient(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT], d[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.5);
    oracle_set_color(ball, -0.25, 0.5, 0.25);
    ball_gradient(ball, d);
    for (int k = 0; k < SGSI_SH_COUNT; ++k)
        assert_true(d[SGS_PARAM_SH_DC + 3 * k] == 0);
    assert_true(d[SGS_PARAM_SH_DC + 1] != 0);
    assert_true(oracle_error(d[SGS_PARAM_OPACITY], 0.75 * 0.25, 0) <= 1e-12);
}

static void zero_quaternion_and_unseen_primitives_get_zero(void **state)
{
    (void)state;
    problem p = problem_create(&setups[2], 60);
    double *d = oracle_memory(problem_values(&p), sizeof *d);
    memset(oracle_primitive(&p.scene, 0) + SGS_PARAM_ROTATION, 0, 4 * sizeof *d);
    oracle_primitive(&p.scene, 1)[SGS_PARAM_OPACITY] = -30;
    oracle_primitive(&p.scene, 2)[SGS_PARAM_SCALE] = NAN;
    oracle_primitive(&p.scene, 3)[SGS_PARAM_SCALE + 1] = HUGE_VAL;
    oracle_primitive(&p.scene, 4)[SGS_PARAM_MEAN] = NAN;
    p.scene.filter_3d[5] = 0;
    oracle_set_scales(oracle_primitive(&p.scene, 5), 1e-300, 1e-300, 1e-300);
    gradient_of(&p, LOSS_COLOR, d, NULL);
    for (int k = 0; k < 4; ++k)
        assert_true(d[SGS_PARAM_ROTATION + k] == 0);
    assert_true(d[SGS_PARAM_MEAN] != 0);
    for (size_t k = SGS_PARAM_COUNT; k < 6 * SGS_PARAM_COUNT; ++k)
        assert_true(d[k] == 0);
    for (size_t k = 0; k < problem_values(&p); ++k)
        assert_true(isfinite(d[k]));
    free(d);
    problem_free(&p);
}

// A lower degree in the options equals zero coefficients above it, which get no gradient.
static void lower_sh_degree_is_zeroed_coefficients(void **state)
{
    (void)state;
    for (int degree = 0; degree < 3; ++degree) {
        problem p = problem_create(&setups[4], 65);
        const size_t values = problem_values(&p);
        const int used = 3 * (degree + 1) * (degree + 1);
        double *limited = oracle_memory(values, sizeof *limited),
               *zeroed = oracle_memory(values, sizeof *zeroed);
        p.options.sh_degree = degree;
        gradient_of(&p, LOSS_COLOR, limited, NULL);
        for (size_t i = 0; i < p.scene.count; ++i)
            for (int k = SGS_PARAM_SH_DC + used; k < SGS_PARAM_COUNT; ++k)
                oracle_primitive(&p.scene, i)[k] = 0;
        p.options.sh_degree = 3;
        gradient_of(&p, LOSS_COLOR, zeroed, NULL);
        for (size_t i = 0; i < p.scene.count; ++i) {
            const double *d = limited + i * SGS_PARAM_COUNT;
            assert_true(oracle_worst_error(d, zeroed + i * SGS_PARAM_COUNT,
                                           (size_t)(SGS_PARAM_SH_DC + used), 1e-3) <= 1e-12);
            for (int k = SGS_PARAM_SH_DC + used; k < SGS_PARAM_COUNT; ++k)
                assert_true(d[k] == 0);
        }
        free(limited);
        free(zeroed);
        problem_free(&p);
    }
}

// NULL for dL/dT means zeros; gradients are added; the gradients of both losses are used together.
static void losses_add(void **state)
{
    (void)state;
    problem p = problem_create(&setups[5], 70);
    const size_t values = problem_values(&p);
    double *color = oracle_memory(values, sizeof *color),
           *transmittance = oracle_memory(values, sizeof *color);
    double *both = oracle_memory(values, sizeof *both);
    const double *const d_color[3] = {p.d_color[0], p.d_color[1], p.d_color[2]};
    gradient_of(&p, LOSS_COLOR, color, NULL);
    gradient_of(&p, LOSS_TRANSMITTANCE, transmittance, NULL);
    assert_int_equal(sgs_reference_backward(p.scene.params, p.scene.count, &p.camera, &p.pose,
                                            &p.options, d_color, p.d_transmittance, both, NULL),
                     SGS_STATUS_OK);
    for (size_t i = 0; i < values; ++i)
        color[i] += transmittance[i];
    assert_true(oracle_worst_error(color, both, values, 1e-3) <= 1e-11);
    free(color);
    free(transmittance);
    free(both);
    problem_free(&p);
}

static void gradient_bits_do_not_depend_on_threads(void **state)
{
    (void)state;
    problem p = problem_create(&setups[3], 80);
    const size_t values = problem_values(&p);
    double *first = oracle_memory(values, sizeof *first),
           *other = oracle_memory(values, sizeof *other);
    const int threads = sgsi_threads();
    sgsi_threads_set(1);
    gradient_of(&p, LOSS_COLOR, first, NULL);
    for (int count = 2; count <= 5; ++count) {
        sgsi_threads_set(count);
        gradient_of(&p, LOSS_COLOR, other, NULL);
        assert_memory_equal(first, other, values * sizeof *first);
    }
    sgsi_threads_set(threads);
    free(first);
    free(other);
    problem_free(&p);
}

static void backward_rejects_bad_arguments_and_survives_lack_of_memory(void **state)
{
    (void)state;
    problem p = problem_create(&setups[0], 90);
    double *d = oracle_memory(problem_values(&p), sizeof *d);
    const double *const missing[3] = {p.d_color[0], NULL, p.d_color[2]};
    const double *const full[3] = {p.d_color[0], p.d_color[1], p.d_color[2]};
    const oracle_scene *scene = &p.scene;
    assert_int_equal(sgs_reference_backward(scene->params, scene->count, &p.camera, &p.pose,
                                            &p.options, missing, NULL, d, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_reference_backward(scene->params, scene->count, &p.camera, &p.pose,
                                            &p.options, full, NULL, NULL, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    size_t n = 1;
    for (;; ++n) {
        sgsi_fail_allocation(n);
        const sgs_status status = sgs_reference_backward(scene->params, scene->count, &p.camera,
                                                         &p.pose, &p.options, full, NULL, d, NULL);
        sgsi_fail_allocation(0);
        if (status == SGS_STATUS_OK)
            break;
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    }
    assert_true(n > 3);
    free(d);
    problem_free(&p);
}

int main(void)
{
    struct CMUnitTest tests[SETUP_COUNT + 9];
    size_t count = 0;
    for (size_t s = 0; s < SETUP_COUNT; ++s)
        tests[count++] = (struct CMUnitTest){setups[s].name, gradients_match_finite_differences,
                                             NULL, NULL, (void *)&setups[s]};
    const struct CMUnitTest others[9] = {
        cmocka_unit_test(checker_fails_on_planted_errors),
        cmocka_unit_test(mean_gradient_without_sh_is_that_of_painted_colours),
        cmocka_unit_test(clamp_of_alpha_is_straight_through),
        cmocka_unit_test(clamped_colour_channel_has_no_gradient),
        cmocka_unit_test(zero_quaternion_and_unseen_primitives_get_zero),
        cmocka_unit_test(lower_sh_degree_is_zeroed_coefficients),
        cmocka_unit_test(losses_add),
        cmocka_unit_test(gradient_bits_do_not_depend_on_threads),
        cmocka_unit_test(backward_rejects_bad_arguments_and_survives_lack_of_memory),
    };
    memcpy(tests + count, others, sizeof others);
    sgsi_threads_set(1); // 30 000 images of 108 pixels: one thread is faster
    return cmocka_run_group_tests(tests, NULL, NULL);
}
