// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The library inside a host program: the host's rounding mode and traps neither change results nor
// end the program, and the host has them again afterwards and in its callbacks; a failing callback
// is explained; the renderers refuse the poses and cameras that a scene refuses.

#include <fenv.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sparegs/compress.h"
#include "sparegs/model_file.h"
#include "sparegs/profile.h"
#include "sparegs/rank_check.h"
#include "sparegs/runtime.h"
#include "support/drawing_support.h"
#include "support/files_support.h"
#include "support/trainer_support.h"

enum { WIDTH = 200, HEIGHT = 90, PIXELS = WIDTH * HEIGHT, COUNT = 3000 };

static drawing drawing_create(void)
{
    drawing d = drawing_of(7, COUNT, SGS_CAMERA_OPENCV, WIDTH, HEIGHT, SGS_AOVS_ALL);
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < PIXELS; ++i)
            d.d_frame.color[c][i] = (float)((i * 13 + c) % 7) / 7.0f;
    return d;
}

// ---- The floating-point mode ----

typedef struct bits {
    float color[3][PIXELS], transmittance[PIXELS], normal[3][PIXELS];
    uint64_t deep;
    char gradient[17], trained[17];
} bits;

static sgs_status add_samples(void *context, int y, int rows, const uint32_t *counts,
                              const sgs_deep_sample *samples)
{
    uint64_t *sum = context;
    (void)y;
    for (size_t i = 0; i < (size_t)rows * WIDTH; ++i)
        for (uint32_t k = 0; k < counts[i]; ++k, ++samples) {
            uint32_t alpha;
            memcpy(&alpha, &samples->alpha, sizeof alpha);
            *sum = *sum * 31 + alpha;
        }
    return SGS_STATUS_OK;
}

// Everything that can depend on the mode of the calling thread when `mode` is set; the trees and
// the teams are made in it, too.
static void draw_all(const sgs_scene *room, void (*mode)(void), bits *out)
{
    drawing d = drawing_create();
    sgs_threads_set(1); // ends the team of before
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, NULL, &d.frame),
                     SGS_STATUS_OK);
    sgs_threads_set(3);
    sgs_render_options options = sgs_render_options_default();
    options.differentiable = true;
    out->deep = 0;
    fenv_t before;
    assert_int_equal(fegetenv(&before), 0);
    mode();
    const sgs_status deep = sgs_renderer_render_deep(d.renderer, &d.camera, &d.pose, NULL, NULL,
                                                     &d.frame, add_samples, &out->deep);
    const sgs_status render =
        sgs_renderer_render(d.renderer, &d.camera, &d.pose, &options, &d.frame);
    const sgs_status backward = sgs_renderer_backward(d.renderer, &d.d_frame, d.d_model);
    sgs_trainer *trainer = NULL;
    sgs_step_info info;
    sgs_status train = sgs_trainer_create(room, NULL, &trainer);
    for (int i = 0; i < 12 && !train; ++i)
        train = sgs_trainer_step(trainer, &info);
    const int round = fegetround();
    assert_int_equal(fesetenv(&before), 0);
    assert_false(deep || render || backward || train);
    sgs_gaussians_hash(d.d_model, out->gradient);
    sgs_gaussians_hash(sgs_trainer_model(trainer), out->trained);
    for (int c = 0; c < 3; ++c) {
        memcpy(out->color[c], d.frame.color[c], sizeof out->color[c]);
        memcpy(out->normal[c], d.frame.normal[c], sizeof out->normal[c]);
    }
    memcpy(out->transmittance, d.frame.transmittance, sizeof out->transmittance);
    sgs_trainer_destroy(trainer);
    drawing_free(&d);
    mode(); // the calls left the mode as it was
    const int expected = fegetround();
    assert_int_equal(fesetenv(&before), 0);
    assert_int_equal(round, expected);
}

static void plain(void)
{
}

static void upward(void)
{
    fesetround(FE_UPWARD);
}

static void toward_zero(void)
{
    fesetround(FE_TOWARDZERO);
}

static void trapping(void)
{
    feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW | FE_UNDERFLOW);
}

static void results_do_not_depend_on_the_mode_of_the_caller(void **state)
{
    static void (*const modes[])(void) = {upward, toward_zero, trapping};
    static bits expected, found;
    draw_all(*state, plain, &expected);
    for (size_t i = 0; i < sizeof modes / sizeof *modes; ++i) {
        draw_all(*state, modes[i], &found);
        assert_memory_equal(&found, &expected, sizeof found);
    }
    sgs_threads_set(0);
}

// Flags that the host has not raised stay lowered.
static void calls_raise_no_flags(void **state)
{
    (void)state;
    drawing d = drawing_create();
    feclearexcept(FE_ALL_EXCEPT);
    const sgs_status status = sgs_renderer_render(d.renderer, &d.camera, &d.pose, NULL, &d.frame);
    const int raised = fetestexcept(FE_ALL_EXCEPT);
    assert_int_equal(status, SGS_STATUS_OK);
    assert_int_equal(raised, 0);
    drawing_free(&d);
}

typedef struct watch {
    int calls, other; // other: calls in another rounding mode, or without denormals
} watch;

static void watch_mode(watch *w)
{
    volatile float denormal = 1e-39f;
    ++w->calls;
    w->other += fegetround() != FE_UPWARD || denormal * 0.5f == 0.0f;
}

static bool watch_progress(void *user, size_t done, size_t total)
{
    (void)done, (void)total;
    watch_mode(user);
    return true;
}

static sgs_status watch_rows(void *context, int y, int rows, const uint32_t *counts,
                             const sgs_deep_sample *samples)
{
    (void)y, (void)rows, (void)counts, (void)samples;
    watch_mode(context);
    return SGS_STATUS_OK;
}

static void callbacks_run_in_the_mode_of_the_caller(void **state)
{
    (void)state;
    drawing d = drawing_create();
    watch render = {0}, deep = {0}, rows = {0}, load = {0};
    sgs_render_options options = sgs_render_options_default();
    options.progress = watch_progress;
    sgs_scene_options scene_options = sgs_scene_options_default();
    scene_options.downscale = 8;
    scene_options.progress = watch_progress;
    scene_options.progress_user = &load;
    sgs_scene *scene;
    sgs_threads_set(3);
    fesetround(FE_UPWARD);
    options.progress_user = &render;
    sgs_status status = sgs_renderer_render(d.renderer, &d.camera, &d.pose, &options, &d.frame);
    options.progress_user = &deep;
    if (!status)
        status = sgs_renderer_render_deep(d.renderer, &d.camera, &d.pose, &options, NULL, &d.frame,
                                          watch_rows, &rows);
    if (!status)
        status = sgs_scene_load(SGSI_TEST_DATA "/room", &scene_options, &scene);
    fesetround(FE_TONEAREST);
    assert_int_equal(status, SGS_STATUS_OK);
    assert_true(render.calls && deep.calls && rows.calls && load.calls == 70);
    assert_int_equal(render.other + deep.other + rows.other + load.other, 0);
    sgs_scene_destroy(scene);
    drawing_free(&d);
    sgs_threads_set(0);
}

// ---- A failing callback ----

static sgs_status fail_silently(void *context, int y, int rows, const uint32_t *counts,
                                const sgs_deep_sample *samples)
{
    (void)context, (void)y, (void)rows, (void)counts, (void)samples;
    return SGS_STATUS_LIMIT;
}

static sgs_status fail_in_the_library(void *context, int y, int rows, const uint32_t *counts,
                                      const sgs_deep_sample *samples)
{
    (void)context, (void)y, (void)rows, (void)counts, (void)samples;
    sgs_gaussians *model;
    return sgs_ply_read("missing_of_rows.ply", &model);
}

static void a_failing_rows_callback_is_explained(void **state)
{
    (void)state;
    drawing d = drawing_create();
    sgs_gaussians *model;
    assert_int_equal(sgs_ply_read("earlier.ply", &model), SGS_STATUS_IO);
    assert_int_equal(sgs_renderer_render_deep(d.renderer, &d.camera, &d.pose, NULL, NULL, &d.frame,
                                              fail_silently, NULL),
                     SGS_STATUS_LIMIT);
    assert_string_equal(sgs_last_error(), "the rows callback failed: a limit was reached");
    // The same error as that of the call before.
    for (int k = 0; k < 2; ++k) {
        assert_int_equal(sgs_renderer_render_deep(d.renderer, &d.camera, &d.pose, NULL, NULL,
                                                  &d.frame, fail_in_the_library, NULL),
                         SGS_STATUS_IO);
        assert_non_null(strstr(sgs_last_error(), "missing_of_rows.ply"));
    }
    drawing_free(&d);
}

static void calls_that_cannot_fail_keep_the_last_error(void **state)
{
    (void)state;
    sgs_gaussians *model;
    sgs_model_format format;
    const sgs_train_options options = {.struct_size = 1};
    const sgs_scene scene = {0};
    assert_int_equal(sgs_ply_read("first.ply", &model), SGS_STATUS_IO);
    char expected[1024];
    snprintf(expected, sizeof expected, "%s", sgs_last_error());
    assert_false(sgs_is_compressed("missing"));
    assert_false(sgs_model_format_detect("missing", &format));
    assert_false(sgs_model_format_detect("/", &format));
    assert_int_equal(sgs_rank_file_digest("missing"), 0);
    assert_int_equal(sgs_train_memory(&scene, &options, 0, 100), 0);
    assert_string_equal(sgs_last_error(), expected);
    assert_int_equal(sgs_ply_read("second.ply", &model), SGS_STATUS_IO); // records again
    assert_non_null(strstr(sgs_last_error(), "second.ply"));
}

// ---- Cameras and poses ----

static sgs_status refuse_rows(void *context, int y, int rows, const uint32_t *counts,
                              const sgs_deep_sample *samples)
{
    (void)y, (void)rows, (void)counts, (void)samples;
    ++*(int *)context;
    return SGS_STATUS_OK;
}

static void assert_refused(const drawing *d, const sgs_camera *camera, const sgs_pose *pose,
                           const char *message)
{
    int rows = 0;
    sgs_profile *profile;
    sgs_reference_frame slow;
    double hit_color[PIXELS] = {0}, d_params[SGS_PARAM_COUNT];
    const double *d_color[3] = {hit_color, hit_color, hit_color};
    sgs_hit hit;
    size_t hits;
    assert_int_equal(sgs_reference_frame_create(WIDTH, HEIGHT, &slow), SGS_STATUS_OK);
    sgs_frame frame = d->frame;
    for (int call = 0; call < 6; ++call) {
        const sgs_status status =
            call == 0   ? sgs_renderer_render(d->renderer, camera, pose, NULL, &frame)
            : call == 1 ? sgs_renderer_render_deep(d->renderer, camera, pose, NULL, NULL, &frame,
                                                   refuse_rows, &rows)
            : call == 2 ? sgs_profile_view(d->scene.model, camera, pose, NULL, &profile)
            : call == 3 ? sgs_reference_render(d->scene.params, 1, camera, pose, NULL, &slow)
            : call == 4
                ? sgs_reference_hits(d->scene.params, 1, camera, pose, NULL, 3, 3, &hit, 1, &hits)
                : sgs_reference_backward(d->scene.params, 1, camera, pose, NULL, d_color, NULL,
                                         d_params, NULL);
        assert_int_equal(status, SGS_STATUS_INVALID_ARGUMENT);
        if (!strstr(sgs_last_error(), message))
            fail_msg("call %d: '%s' lacks '%s'", call, sgs_last_error(), message);
    }
    assert_int_equal(rows, 0);
    sgs_reference_frame_free(&slow);
}

static void poses_that_a_scene_refuses_are_refused(void **state)
{
    (void)state;
    drawing d = drawing_create();
    sgs_pose pose = d.pose;
    for (int k = 0; k < 9; ++k)
        pose.rotation[k] *= 2;
    assert_refused(&d, &d.camera, &pose, "pose.rotation is not orthonormal");
    pose = (sgs_pose){0};
    assert_refused(&d, &d.camera, &pose, "pose.rotation is not orthonormal");
    pose = d.pose;
    for (int k = 0; k < 3; ++k)
        pose.rotation[k] = -pose.rotation[k];
    assert_refused(&d, &d.camera, &pose, "pose.rotation is mirrored");
    pose = d.pose;
    pose.translation[1] = NAN;
    assert_refused(&d, &d.camera, &pose, "pose.translation is not finite");
    pose.translation[1] = 1e16;
    assert_refused(&d, &d.camera, &pose, "camera position is out of range");
    sgs_camera camera = d.camera;
    camera.params[0] = -1;
    assert_refused(&d, &camera, &d.pose, "focal length -1");
    assert_int_equal(sgs_renderer_render(d.renderer, &d.camera, &d.pose, NULL, &d.frame),
                     SGS_STATUS_OK);
    drawing_free(&d);
}

static int load(void **state)
{
    return room_load(8, (sgs_scene **)state);
}

static int unload(void **state)
{
    sgs_scene_destroy(*state);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(results_do_not_depend_on_the_mode_of_the_caller),
        cmocka_unit_test(calls_raise_no_flags),
        cmocka_unit_test(callbacks_run_in_the_mode_of_the_caller),
        cmocka_unit_test(a_failing_rows_callback_is_explained),
        cmocka_unit_test(calls_that_cannot_fail_keep_the_last_error),
        cmocka_unit_test(poses_that_a_scene_refuses_are_refused),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
