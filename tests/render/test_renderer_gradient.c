// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// sgs_renderer_backward and the options of sgs_renderer_render, through the public API: gradients
// against the oracle's in double precision (which test_reference_gradient.c compares with finite
// differences), rows without a hit, invalid calls, cancelling, and options of earlier versions.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pthread.h>

#include "sparegs/runtime.h"
#include "support/drawing_support.h"
#include "support/fragile_support.h"

enum { WIDTH = 63, HEIGHT = 47, PIXELS = WIDTH * HEIGHT };

// A differentiable drawing.
static drawing drawing_create(uint64_t seed, size_t count, sgs_camera_model lens, sgs_filter filter)
{
    drawing d = drawing_of(seed, count, lens, WIDTH, HEIGHT, SGS_AOVS_BASIC);
    d.options = oracle_render_options(filter, 3, d.scene.filter_3d);
    d.options.differentiable = true;
    return d;
}

static sgs_status draw(drawing *d)
{
    return sgs_renderer_render(d->renderer, &d->camera, &d->pose, &d->options, &d->frame);
}

// Random incoming gradients, equal in both precisions; zero where single precision may count other
// hits.
static void fill_incoming(drawing *d, double *const planes[4])
{
    float *const single[4] = {d->d_frame.color[0], d->d_frame.color[1], d->d_frame.color[2],
                              d->d_frame.transmittance};
    sgsi_reference_view view;
    assert_int_equal(sgsi_reference_view_create(d->scene.params, d->scene.count, &d->camera,
                                                &d->pose, &d->options, &view),
                     SGS_STATUS_OK);
    sgs_hit *hits = oracle_memory(d->scene.count, sizeof *hits);
    oracle_random random = {5, 0};
    for (int i = 0; i < PIXELS; ++i) {
        double direction[3];
        const bool skipped = sgsi_reference_ray(&view, i % WIDTH, i / WIDTH, direction) &&
                             judge(&view, direction, hits).fragile;
        for (int k = 0; k < 4; ++k) {
            const float value = skipped ? 0.0f : (float)oracle_normal(&random);
            single[k][i] = value;
            planes[k][i] = (double)value;
        }
    }
    free(hits);
    sgsi_reference_view_free(&view);
}

// Largest error over the largest gradient per group of parameters; each group must have gradients.
static double worst_error(const drawing *d, const double *expected)
{
    static const int begin[] = {SGS_PARAM_MEAN,    SGS_PARAM_ROTATION, SGS_PARAM_SCALE,
                                SGS_PARAM_OPACITY, SGS_PARAM_SH_DC,    SGS_PARAM_SH_REST,
                                SGS_PARAM_COUNT};
    float *column = oracle_memory(d->scene.count, sizeof *column);
    double result = 0;
    for (int group = 0; group < 6; ++group) {
        double error = 0, largest = 0;
        for (int k = begin[group]; k < begin[group + 1]; ++k) {
            assert_int_equal(sgs_gaussians_read(d->d_model, k, 0, d->scene.count, column, 0),
                             SGS_STATUS_OK);
            for (size_t i = 0; i < d->scene.count; ++i) {
                const double wanted = expected[i * SGS_PARAM_COUNT + (size_t)k];
                const double difference = fabs((double)column[i] - wanted);
                error = error >= difference ? error : difference; // keeps NaN
                largest = fmax(largest, fabs(wanted));
            }
        }
        assert_true(largest > 0);
        result = result >= error / largest ? result : error / largest;
    }
    free(column);
    return result;
}

static void gradients_are_those_of_the_reference(void **state)
{
    (void)state;
    static const sgs_camera_model lenses[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV,
                                              SGS_CAMERA_OPENCV_FISHEYE};
    for (int lens = 0; lens < 3; ++lens)
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            drawing d = drawing_create(41, 200, lenses[lens], (sgs_filter)filter);
            double *planes[4];
            for (int k = 0; k < 4; ++k)
                planes[k] = oracle_memory(PIXELS, sizeof(double));
            fill_incoming(&d, planes);
            double *expected = oracle_memory(d.scene.count * SGS_PARAM_COUNT, sizeof *expected);
            assert_int_equal(sgs_reference_backward(
                                 d.scene.params, d.scene.count, &d.camera, &d.pose, &d.options,
                                 (const double *const *)planes, planes[3], expected, NULL),
                             SGS_STATUS_OK);
            assert_int_equal(draw(&d), SGS_STATUS_OK);
            assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                             SGS_STATUS_OK);
            const double error = worst_error(&d, expected);
            print_message("%s, filter %d: %.1e\n", sgs_camera_model_name(lenses[lens]), filter,
                          error);
            assert_true(error <= 1e-4);
            // The comparison detects a wrong factor.
            for (size_t i = 0; i < d.scene.count; ++i)
                *sgs_gaussians_at(d.d_model, i, SGS_PARAM_SCALE + 1) *= 1.001f;
            assert_false(worst_error(&d, expected) <= 1e-4);
            for (int k = 0; k < 4; ++k)
                free(planes[k]);
            free(expected);
            drawing_free(&d);
        }
}

static void a_null_plane_is_zero(void **state)
{
    (void)state;
    drawing d = drawing_create(42, 100, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    for (int i = 0; i < PIXELS; ++i)
        d.d_frame.color[1][i] = (float)(i % 7) - 3.0f;
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model), SGS_STATUS_OK);
    char with_zeros[17], without[17];
    sgs_gaussians_hash(d.d_model, with_zeros);
    const sgs_frame alone = {
        .width = WIDTH, .height = HEIGHT, .color = {NULL, d.d_frame.color[1], NULL}};
    assert_int_equal(sgs_renderer_backward(d.renderer, &alone, d.d_model), SGS_STATUS_OK);
    sgs_gaussians_hash(d.d_model, without);
    assert_string_equal(with_zeros, without);
    drawing_free(&d);
}

// A primitive without a hit, and one at the camera centre, which has no viewing direction.
static void primitives_without_a_hit_have_no_gradient(void **state)
{
    (void)state;
    drawing d = drawing_create(43, 40, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    double center[3];
    sgs_pose_center(&d.pose, center);
    for (int k = 0; k < 3; ++k) {
        *sgs_gaussians_at(d.scene.model, 7, SGS_PARAM_MEAN + k) = (float)center[k];
        *sgs_gaussians_at(d.scene.model, 9, SGS_PARAM_MEAN + k) = (float)(2 * center[k]);
    }
    assert_int_equal(sgs_renderer_update(d.renderer), SGS_STATUS_OK);
    for (int i = 0; i < PIXELS; ++i)
        d.d_frame.color[0][i] = d.d_frame.transmittance[i] = 1.0f;
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    for (size_t i = 0; i < d.scene.count; ++i) // overwritten, not added to
        *sgs_gaussians_at(d.d_model, i, SGS_PARAM_MEAN) = 1e30f;
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model), SGS_STATUS_OK);
    size_t moved = 0;
    for (size_t i = 0; i < d.scene.count; ++i) {
        float gradient[SGS_PARAM_COUNT];
        sgs_gaussians_get(d.d_model, i, gradient);
        moved += gradient[SGS_PARAM_OPACITY] != 0;
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            assert_true(isfinite(gradient[k]));
            assert_true((i != 7 && i != 9) || gradient[k] == 0);
        }
    }
    assert_true(moved > 20);
    drawing_free(&d);
}

static void invalid_gradient_calls_are_refused(void **state)
{
    (void)state;
    drawing d = drawing_create(44, 50, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT); // no rendering
    assert_non_null(strstr(sgs_last_error(), "differentiable"));
    d.options.differentiable = false;
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT);
    d.options.differentiable = true;
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT); // depth planes
    assert_non_null(strstr(sgs_last_error(), "only colour and transmittance"));
    const sgs_frame small = {.width = WIDTH - 1, .height = HEIGHT};
    assert_int_equal(sgs_renderer_backward(d.renderer, &small, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_resize(d.d_model, 49), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_resize(d.d_model, 50), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_update(d.renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT); // the model may have changed
    drawing_free(&d);
}

static void assert_draws_as_a_new_renderer(drawing *d)
{
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(draw(d), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(d->scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(WIDTH, HEIGHT, &frame), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(renderer, &d->camera, &d->pose, &d->options, &frame),
                     SGS_STATUS_OK);
    for (int c = 0; c < 3; ++c)
        assert_memory_equal(d->frame.color[c], frame.color[c], PIXELS * sizeof(float));
    assert_memory_equal(d->frame.transmittance, frame.transmittance, PIXELS * sizeof(float));
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
}

// Also after primitives have changed places, and with another number of them.
static void a_refitted_renderer_draws_the_bits_of_a_new_one(void **state)
{
    (void)state;
    drawing d = drawing_create(45, 300, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    float *const before = oracle_memory(PIXELS, sizeof *before);
    memcpy(before, d.frame.color[0], PIXELS * sizeof *before);
    for (size_t i = 0; i < 150; ++i) {
        float first[SGS_PARAM_COUNT], second[SGS_PARAM_COUNT];
        sgs_gaussians_get(d.scene.model, i, first);
        sgs_gaussians_get(d.scene.model, 299 - i, second);
        first[SGS_PARAM_MEAN] += 0.05f;
        second[SGS_PARAM_SCALE] += 0.1f;
        sgs_gaussians_set(d.scene.model, 299 - i, first);
        sgs_gaussians_set(d.scene.model, i, second);
    }
    assert_int_equal(sgs_renderer_refit(d.renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model),
                     SGS_STATUS_INVALID_ARGUMENT); // of the model before
    assert_draws_as_a_new_renderer(&d);
    assert_memory_not_equal(before, d.frame.color[0], PIXELS * sizeof *before);
    assert_int_equal(sgs_gaussians_resize(d.scene.model, 201), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_refit(d.renderer), SGS_STATUS_OK);
    assert_draws_as_a_new_renderer(&d);
    assert_int_equal(sgs_gaussians_resize(d.scene.model, 300), SGS_STATUS_OK);
    free(before);
    drawing_free(&d);
}

// ---- Progress ----

typedef struct watcher {
    size_t calls, cancel_at, done, total;
} watcher;

static bool watch(void *user, size_t done, size_t total)
{
    watcher *w = user;
    assert_true(done > w->done && done <= total);
    w->done = done;
    w->total = total;
    return ++w->calls != w->cancel_at;
}

static void a_rendering_with_progress_has_the_same_bits_and_can_be_cancelled(void **state)
{
    (void)state;
    drawing d = drawing_create(45, 100, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    d.camera = oracle_camera(SGS_CAMERA_PINHOLE, 700, 500);
    d.options.differentiable = false;
    sgs_frame frames[2];
    watcher w = {0};
    for (int k = 0; k < 2; ++k) {
        assert_int_equal(sgs_frame_create(700, 500, &frames[k]), SGS_STATUS_OK);
        d.options.progress = k ? watch : NULL;
        d.options.progress_user = &w;
        assert_int_equal(
            sgs_renderer_render(d.renderer, &d.camera, &d.pose, &d.options, &frames[k]),
            SGS_STATUS_OK);
    }
    const size_t bytes = sizeof(float) * 700 * 500;
    assert_memory_equal(frames[0].color[1], frames[1].color[1], bytes);
    assert_memory_equal(frames[0].depth_mean, frames[1].depth_mean, bytes);
    assert_true(w.done == w.total && w.calls > 2);
    w = (watcher){.cancel_at = 2};
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, &d.options, &frames[1]),
                     SGS_STATUS_CANCELLED);
    assert_int_equal(w.calls, 2);
    d.options.differentiable = true; // lists are kept for whole views only
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, &d.options, &frames[1]),
                     SGS_STATUS_INVALID_ARGUMENT);
    for (int k = 0; k < 2; ++k)
        sgs_frame_free(&frames[k]);
    drawing_free(&d);
}

static bool stop(void *user, size_t done, size_t total)
{
    (void)total;
    *(size_t *)user = done;
    return false;
}

static void a_large_rendering_is_cancelled_before_its_first_band(void **state)
{
    (void)state;
    drawing d = drawing_create(45, 100, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    sgs_frame frame;
    size_t done = 1;
    d.camera = oracle_camera(SGS_CAMERA_PINHOLE, 1100, 1000);
    d.options.differentiable = false;
    d.options.progress = stop;
    d.options.progress_user = &done;
    assert_int_equal(sgs_frame_create(1100, 1000, &frame), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, &d.options, &frame),
                     SGS_STATUS_CANCELLED);
    assert_int_equal(done, 0); // the rays were not complete
    d.options.progress = NULL;
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, &d.options, &frame),
                     SGS_STATUS_OK);
    sgs_frame_free(&frame);
    drawing_free(&d);
}

// ---- Threads ----

typedef struct painter {
    drawing *d;
    char gradient[17];
    sgs_status status;
} painter;

static void *paint(void *context)
{
    painter *p = context;
    for (int round = 0; round < 5 && !p->status; ++round) {
        p->status = draw(p->d);
        if (!p->status)
            p->status = sgs_renderer_backward(p->d->renderer, &p->d->d_frame, p->d->d_model);
    }
    sgs_gaussians_hash(p->d->d_model, p->gradient);
    return NULL;
}

// Renderers of different models, and of the same model.
static void renderers_of_two_threads_do_not_disturb_each_other(void **state)
{
    (void)state;
    for (int same = 0; same < 2; ++same) {
        drawing d[2];
        painter alone[2], at_once[2];
        pthread_t threads[2];
        for (int k = 0; k < 2; ++k) {
            d[k] =
                drawing_create(47 + (same ? 0 : (uint64_t)k), 300,
                               k ? SGS_CAMERA_OPENCV_FISHEYE : SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
            for (int i = 0; i < PIXELS; ++i)
                d[k].d_frame.color[k][i] = 1.0f;
        }
        if (same) {
            sgs_renderer_destroy(d[1].renderer);
            assert_int_equal(sgs_renderer_create(d[0].scene.model, &d[1].renderer), SGS_STATUS_OK);
        }
        for (int k = 0; k < 2; ++k) {
            alone[k] = at_once[k] = (painter){.d = &d[k]};
            paint(&alone[k]);
            assert_int_equal(alone[k].status, SGS_STATUS_OK);
        }
        for (int k = 0; k < 2; ++k)
            assert_int_equal(pthread_create(&threads[k], NULL, paint, &at_once[k]), 0);
        for (int k = 0; k < 2; ++k) {
            assert_int_equal(pthread_join(threads[k], NULL), 0);
            assert_int_equal(at_once[k].status, SGS_STATUS_OK);
            assert_string_equal(at_once[k].gradient, alone[k].gradient);
        }
        for (int k = 0; k < 2; ++k)
            drawing_free(&d[k]);
    }
}

// Between the rendering and its gradient: from 1 thread to 4, and from 4 to 1.
static void the_number_of_threads_may_change_before_the_gradient(void **state)
{
    (void)state;
    static const int threads[3][2] = {{2, 2}, {1, 4}, {4, 1}};
    char gradients[3][17];
    for (int k = 0; k < 3; ++k) {
        drawing d = drawing_create(48, 300, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
        for (int i = 0; i < PIXELS; ++i)
            d.d_frame.color[0][i] = 1.0f;
        sgs_threads_set(threads[k][0]);
        assert_int_equal(draw(&d), SGS_STATUS_OK);
        sgs_threads_set(threads[k][1]);
        assert_int_equal(sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model), SGS_STATUS_OK);
        sgs_gaussians_hash(d.d_model, gradients[k]);
        assert_string_equal(gradients[k], gradients[0]);
        drawing_free(&d);
    }
    sgs_threads_set(0);
}

// ---- Options of other versions ----

static void options_of_other_sizes_are_filled_up_or_refused(void **state)
{
    (void)state;
    drawing d = drawing_create(46, 50, SGS_CAMERA_PINHOLE, SGS_FILTER_3DGS);
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, NULL, &d.frame),
                     SGS_STATUS_OK); // the defaults
    d.options.struct_size = 0;
    assert_int_equal(draw(&d), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "sgs_render_options.struct_size is 0"));
    d.options.struct_size = sizeof d.options + 8;
    assert_int_equal(draw(&d), SGS_STATUS_INVALID_ARGUMENT);
    // A struct that ends after the filter: the memory past it is not read.
    d.options.struct_size = offsetof(sgs_render_options, near_distance);
    d.options.near_distance = NAN;
    d.options.sh_degree = 77;
    assert_int_equal(draw(&d), SGS_STATUS_OK);
    d.options.struct_size = sizeof d.options;
    assert_int_equal(draw(&d), SGS_STATUS_INVALID_ARGUMENT);
    drawing_free(&d);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_are_those_of_the_reference),
        cmocka_unit_test(a_null_plane_is_zero),
        cmocka_unit_test(primitives_without_a_hit_have_no_gradient),
        cmocka_unit_test(invalid_gradient_calls_are_refused),
        cmocka_unit_test(a_refitted_renderer_draws_the_bits_of_a_new_one),
        cmocka_unit_test(a_rendering_with_progress_has_the_same_bits_and_can_be_cancelled),
        cmocka_unit_test(a_large_rendering_is_cancelled_before_its_first_band),
        cmocka_unit_test(renderers_of_two_threads_do_not_disturb_each_other),
        cmocka_unit_test(the_number_of_threads_may_change_before_the_gradient),
        cmocka_unit_test(options_of_other_sizes_are_filled_up_or_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
