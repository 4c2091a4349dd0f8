// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Views drawn by several ranks, which are threads of this process here, from a model that they
// share: every pixel has the bits of the renderer of one process, for all pixel filters, numbers of
// ranks and lenses, also if rows of the file are dropped. Files that cannot be read and frames of
// another size fail on all ranks with one message.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/rank_renderer.h"
#include "support/files_support.h"
#include "support/ranks_support.h"

enum { MAX_RANKS = 4, ROWS = 3000, WIDTH = 150, HEIGHT = 90 };

static temp_folder folder;
static sgs_scene *scene;

static const sgs_camera_model models[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV,
                                          SGS_CAMERA_OPENCV_FISHEYE};
enum { VIEWS = sizeof models / sizeof *models };

// Primitives around (0, 0, 3); every hundredth has the position of the one before it, and some are
// not finite.
static void write_model(const char *path)
{
    sgs_gaussians *model;
    uint64_t drawn = 0;
    assert_int_equal(sgs_gaussians_create(ROWS, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, ROWS), SGS_STATUS_OK);
    float params[SGS_PARAM_COUNT] = {0};
    for (size_t i = 0; i < ROWS; ++i) {
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            params[k] = (float)(0.4 * sgsi_random_uniform(7, drawn++) - 0.2);
        for (int k = 0; k < 3; ++k) {
            params[SGS_PARAM_SCALE + k] = (float)(-4.5 + 2.0 * sgsi_random_uniform(7, drawn++));
            params[SGS_PARAM_SH_DC + k] = (float)(2.0 * sgsi_random_uniform(7, drawn++) - 1.0);
            params[SGS_PARAM_MEAN + k] = (float)(3.0 * sgsi_random_uniform(7, drawn++) - 1.5);
        }
        params[SGS_PARAM_MEAN + 2] += 3.0f;
        params[SGS_PARAM_ROTATION] = 1.0f;
        params[SGS_PARAM_OPACITY] = (float)(4.0 * sgsi_random_uniform(7, drawn++) - 1.0);
        if (i % 100 == 99)
            for (int k = 0; k < 3; ++k)
                params[SGS_PARAM_MEAN + k] = *sgs_gaussians_at(model, i - 1, SGS_PARAM_MEAN + k);
        if (i % 700 == 3)
            params[SGS_PARAM_SCALE] = NAN;
        sgs_gaussians_set(model, i, params);
    }
    assert_int_equal(sgs_ply_write(path, model), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
}

static sgs_scene *make_scene(void)
{
    sgs_view_source views[VIEWS];
    uint8_t *pixels = calloc(3 * WIDTH * HEIGHT, 1);
    const float point[3] = {0, 0, 3};
    const unsigned char color[3] = {128, 128, 128};
    for (int i = 0; i < VIEWS; ++i) {
        sgs_camera camera = {.model = models[i], .width = WIDTH, .height = HEIGHT};
        camera.params[0] = camera.params[1] = 80.0 + 10.0 * i;
        camera.params[2] = WIDTH / 2.0;
        camera.params[3] = HEIGHT / 2.0;
        views[i] = (sgs_view_source){.name = i == 0   ? "a.png"
                                             : i == 1 ? "b.png"
                                                      : "c.png",
                                     .camera = camera,
                                     .pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                              .translation = {0.1 * i, 0.0, 0.2 * i}},
                                     .pixel_type = SGS_PIXEL_UINT8,
                                     .channels = 3,
                                     .pixels = pixels};
    }
    const sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *made = NULL;
    if (sgs_scene_create(views, VIEWS, point, color, 1, &options, &made))
        fail_msg("%s", sgs_last_error());
    free(pixels);
    return made;
}

static int prepare(void **state)
{
    (void)state;
    folder = temp_folder_make();
    write_model(temp_path(&folder, "model.ply"));
    scene = make_scene();
    return 0;
}

static int finish(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
    return 0;
}

// ---- Ranks ----

typedef struct member {
    const char *path;
    sgs_render_options options;
    bool uses_defaults; // the scene's instead of `options`
    int frame_width;    // of the frame for the first view
    size_t first_view;  // index
    sgs_frame frames[VIEWS];
    sgs_status status;
    char message[256];
} member;

static void run_rank(void *context, sgs_ranks *ranks)
{
    member *m = context;
    sgs_rank_renderer *renderer = NULL;
    m->status = sgs_rank_renderer_create(ranks, scene, m->path,
                                         m->uses_defaults ? NULL : &m->options, &renderer);
    for (int v = 0; v < VIEWS && !m->status; ++v) {
        const int receiver = v % sgs_ranks_count(ranks);
        sgs_status own = SGS_STATUS_OK;
        if (receiver == sgs_ranks_rank(ranks))
            own = sgs_frame_create_with(v ? WIDTH : m->frame_width, HEIGHT, 0, &m->frames[v]);
        m->status = sgs_rank_renderer_render(renderer, own, m->first_view + (size_t)v, receiver,
                                             &m->frames[v]);
    }
    if (m->status)
        snprintf(m->message, sizeof m->message, "%s", sgs_last_error());
    sgs_rank_renderer_destroy(renderer);
}

static void draw(const member *plan, int count, member *all)
{
    for (int r = 0; r < count; ++r)
        all[r] = *plan;
    ranks_run(count, all, sizeof *all, run_rank);
}

static void free_frames(member *all, int count)
{
    for (int r = 0; r < count; ++r)
        for (int v = 0; v < VIEWS; ++v)
            sgs_frame_free(&all[r].frames[v]);
}

static member plan_of(const char *path, sgs_filter filter)
{
    member plan = {.path = path, .options = sgs_render_options_default(), .frame_width = WIDTH};
    plan.options.filter = filter;
    return plan;
}

// ---- Tests ----

static void compare(sgs_renderer *renderer, const member *plan, int count)
{
    const size_t bytes = (size_t)WIDTH * HEIGHT * sizeof(float);
    member all[MAX_RANKS];
    draw(plan, count, all);
    for (int v = 0; v < VIEWS; ++v) {
        const sgs_view *view = &scene->views[v];
        const member *receiver = &all[v % count];
        sgs_frame expected;
        assert_string_equal(receiver->message, "");
        assert_int_equal(sgs_frame_create_with(WIDTH, HEIGHT, 0, &expected), SGS_STATUS_OK);
        assert_int_equal(
            sgs_renderer_render(renderer, &view->camera, &view->pose, &plan->options, &expected),
            SGS_STATUS_OK);
        double light = 0.0;
        for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; ++i)
            light += 1.0 - (double)expected.transmittance[i];
        assert_true(light > 0.2 * WIDTH * HEIGHT);
        for (int c = 0; c < 3; ++c)
            assert_memory_equal(receiver->frames[v].color[c], expected.color[c], bytes);
        assert_memory_equal(receiver->frames[v].transmittance, expected.transmittance, bytes);
        sgs_frame_free(&expected);
    }
    free_frames(all, count);
}

static void images_have_the_bits_of_one_process(void **state)
{
    (void)state;
    const char *path = temp_path(&folder, "model.ply");
    static const sgs_filter filters[] = {SGS_FILTER_3DGS, SGS_FILTER_NONE, SGS_FILTER_MIP};
    sgs_gaussians *model;
    sgs_renderer *renderer;
    assert_int_equal(sgs_ply_read(path, &model), SGS_STATUS_OK);
    assert_true(model->count < ROWS); // rows were dropped
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    for (int i = 0; i < 3; ++i) {
        member plan = plan_of(path, filters[i]);
        plan.options.compact_box = i ? 0.5 : 1.0;
        compare(renderer, &plan, 2 + i);
    }
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);
}

// Without options the near distance is that of the scene.
static void the_defaults_are_those_of_the_scene(void **state)
{
    (void)state;
    const char *path = temp_path(&folder, "model.ply");
    const double extent = scene->extent;
    sgs_gaussians *model;
    sgs_renderer *renderer;
    assert_int_equal(sgs_ply_read(path, &model), SGS_STATUS_OK);
    for (int i = 0; i < 3; ++i) { // around the first camera
        *sgs_gaussians_at(model, 0, SGS_PARAM_MEAN + i) = i < 2 ? 0.0f : 0.1f;
        *sgs_gaussians_at(model, 0, SGS_PARAM_SCALE + i) = -4.0f;
    }
    path = temp_path(&folder, "near.ply");
    assert_int_equal(sgs_ply_write(path, model), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    scene->extent = 0.1;
    member plan = plan_of(path, SGS_FILTER_3DGS);
    plan.uses_defaults = true;
    plan.options.near_distance = sgs_near_distance(scene->extent); // of the expected images
    assert_true(plan.options.near_distance < 0.1);
    compare(renderer, &plan, 2);
    scene->extent = extent;
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);
}

static void expect_failure(const member *plan, sgs_status status, const char *text)
{
    member all[MAX_RANKS];
    draw(plan, 3, all);
    for (int r = 0; r < 3; ++r) {
        assert_int_equal(all[r].status, status);
        assert_non_null(strstr(all[r].message, "rank 0 ("));
        assert_non_null(strstr(all[r].message, text));
    }
    free_frames(all, 3);
}

static void failures_are_those_of_all_ranks(void **state)
{
    (void)state;
    member plan = plan_of(temp_path(&folder, "missing.ply"), SGS_FILTER_3DGS);
    expect_failure(&plan, SGS_STATUS_IO, "missing.ply");
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "model.ply"), &size);
    plan.path = temp_path(&folder, "short.ply");
    file_put(plan.path, bytes, size - 1000);
    free(bytes);
    expect_failure(&plan, SGS_STATUS_FORMAT, "short.ply");
    plan = plan_of(temp_path(&folder, "model.ply"), SGS_FILTER_3DGS);
    plan.options.compact_box = 2.0;
    expect_failure(&plan, SGS_STATUS_INVALID_ARGUMENT, "compact box");
    plan = plan_of(temp_path(&folder, "model.ply"), SGS_FILTER_3DGS);
    plan.frame_width = WIDTH + 1;
    expect_failure(&plan, SGS_STATUS_INVALID_ARGUMENT, "frame size");
    plan = plan_of(temp_path(&folder, "model.ply"), SGS_FILTER_3DGS);
    plan.first_view = VIEWS;
    expect_failure(&plan, SGS_STATUS_INVALID_ARGUMENT, "the scene has no view 3, only 3 views");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_have_the_bits_of_one_process),
        cmocka_unit_test(the_defaults_are_those_of_the_scene),
        cmocka_unit_test(failures_are_those_of_all_ranks),
    };
    return cmocka_run_group_tests(tests, prepare, finish);
}
