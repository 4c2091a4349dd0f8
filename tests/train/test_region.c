// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Training of a region: primitives outside keep their bytes through steps, structural updates,
// noise and resets of all pipelines; those inside change, stay inside and are limited by the cap;
// resuming gives the same bits; the images that regions train towards add up to the photos, and
// their preparation reports every view.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/compare.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/files_support.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

// The 3D filter is computed again in iteration 100.
enum { ROW = SGS_PARAM_COUNT * sizeof(float), LENGTH = 101 };

static sgs_scene *scene;
static sgs_gaussians *start; // a short training of the whole scene
static sgs_box region;
static temp_folder folder;

// A box with about half of the start's primitives, and its outer side open.
static sgs_box half_of(const sgs_gaussians *model)
{
    float *x = malloc(model->count * sizeof *x);
    assert_int_equal(sgs_gaussians_read(model, SGS_PARAM_MEAN, 0, model->count, x, 0),
                     SGS_STATUS_OK);
    qsort(x, model->count, sizeof *x, sgsi_compare_floats);
    sgs_box box = sgs_box_infinite();
    box.high[0] = x[model->count / 2];
    free(x);
    return box;
}

static int prepare(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 16;
    folder = temp_folder_make();
    if (sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene))
        return 1;
    sgs_train_options short_run = sgs_train_options_default();
    short_run.iterations = 40;
    sgs_trainer *trainer = trainer_create(scene, &short_run);
    trainer_run(trainer, 40);
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    float row[SGS_PARAM_COUNT];
    assert_int_equal(sgs_gaussians_create(model->count, &start), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(start, model->count), SGS_STATUS_OK);
    start->sh_degree = model->sh_degree;
    for (size_t i = 0; i < model->count; ++i) {
        sgs_gaussians_get(model, i, row);
        sgs_gaussians_set(start, i, row);
    }
    sgs_trainer_destroy(trainer);
    region = half_of(start);
    return 0;
}

static int clean(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    sgs_gaussians_destroy(start);
    temp_folder_remove(&folder);
    return 0;
}

static int by_bytes(const void *a, const void *b)
{
    return memcmp(a, b, ROW);
}

// The rows with centres inside or outside of the region, sorted by their bytes.
static float *rows_of(const sgs_gaussians *model, bool inside, size_t *count)
{
    float *rows = malloc((model->count + 1) * ROW);
    *count = 0;
    for (size_t i = 0; i < model->count; ++i) {
        float *row = rows + *count * SGS_PARAM_COUNT;
        sgs_gaussians_get(model, i, row);
        *count += sgs_box_contains(&region, row) == inside;
    }
    qsort(rows, *count, ROW, by_bytes);
    return rows;
}

static sgs_train_options options_of(int pipeline)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = LENGTH;
    options.pipeline = (sgs_pipeline)pipeline;
    options.filter = pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    options.optimizer = pipeline == SGS_PIPELINE_DASH ? SGS_OPTIMIZER_DENSE : SGS_OPTIMIZER_SPARSE;
    options.spare_patience = 1000;
    options.init = start;
    options.region = region;
    return options;
}

static void rows_outside_keep_their_bytes_and_rows_inside_train(void **state)
{
    (void)state;
    size_t before, after, own_before, own;
    float *outside = rows_of(start, false, &before), *inside = rows_of(start, true, &own_before);
    assert_true(before > 100 && own_before > 100);
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        const sgs_train_options options = options_of(pipeline);
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, LENGTH);
        const sgs_gaussians *model = sgs_trainer_model(trainer);
        assert_true(trainer->progress.updates > 0);
        sgsi_trainer_reset_opacity(trainer, LENGTH);
        float *left = rows_of(model, false, &after), *trained = rows_of(model, true, &own);
        assert_int_equal(before, after);
        if (memcmp(outside, left, before * ROW) != 0)
            fail_msg("%s: a primitive outside of the region changed", trainer->pipeline->name);
        const float *filter = sgs_trainer_filter_3d(trainer);
        sgs_gaussians *fused;
        if (filter) { // the saved model
            assert_int_equal(sgs_gaussians_fuse_filter_3d(model, filter, &fused), SGS_STATUS_OK);
            free(left);
            left = rows_of(fused, false, &after);
            assert_memory_equal(outside, left, before * ROW);
            sgs_gaussians_destroy(fused);
        }
        // All rows inside have changed, and their number has.
        if (own == own_before)
            fail_msg("%s: the number of primitives did not change", trainer->pipeline->name);
        size_t kept = 0;
        for (size_t i = 0; i < own; ++i)
            kept +=
                bsearch(trained + i * SGS_PARAM_COUNT, inside, own_before, ROW, by_bytes) != NULL;
        if (!(kept < own / 2))
            fail_msg("%s: %zu of %zu rows are as before", trainer->pipeline->name, kept, own);
        assert_int_equal(own, sgsi_trainer_own(trainer));
        for (size_t i = 0; i < own; ++i) // reset to 0.01 before the filter of mip
            assert_true(trained[i * SGS_PARAM_COUNT + SGS_PARAM_OPACITY] < -4.5f ||
                        pipeline == SGS_PIPELINE_MIP);
        free(left);
        free(trained);
        sgs_trainer_destroy(trainer);
    }
    free(outside);
    free(inside);
}

// Faces one unit in the last place from a centre, and noise that would carry faint primitives away.
static void centres_stay_in_the_box(void **state)
{
    (void)state;
    sgs_train_options options = options_of(SGS_PIPELINE_MCMC);
    options.pipeline_options.mcmc_noise = 1e9;
    float row[SGS_PARAM_COUNT];
    sgs_gaussians_get(start, start->count / 3, row);
    for (int k = 0; k < 3; ++k) {
        options.region.low[k] = row[k] - 0.5f * (float)scene->extent;
        options.region.high[k] = nextafterf(row[k], INFINITY);
    }
    sgs_trainer *trainer = trainer_create(scene, &options);
    const size_t own = sgsi_trainer_own(trainer);
    assert_true(own >= 10);
    trainer_run(trainer, 20);
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    size_t at_face = 0;
    for (size_t i = 0; i < model->count; ++i) {
        sgs_gaussians_get(model, i, row);
        assert_true(sgs_box_contains(&options.region, row) == (i < sgsi_trainer_own(trainer)));
        for (int k = 0; k < 3; ++k)
            at_face += i < own && (row[k] == options.region.low[k] ||
                                   nextafterf(row[k], INFINITY) == options.region.high[k]);
    }
    assert_true(at_face > 0);
    sgs_trainer_destroy(trainer);
}

static void the_cap_counts_the_region_only(void **state)
{
    (void)state;
    size_t outside;
    free(rows_of(start, false, &outside));
    const size_t caps[] = {50, start->count - outside + 20};
    for (size_t k = 0; k < 2; ++k) {
        sgs_train_options options = options_of(SGS_PIPELINE_3DGS);
        options.max_gaussians = caps[k];
        sgs_trainer *trainer = trainer_create(scene, &options);
        for (int i = 0; i < LENGTH; ++i) {
            trainer_run(trainer, 1);
            assert_true(sgsi_trainer_own(trainer) <= caps[k]);
            assert_int_equal(sgs_trainer_model(trainer)->count - sgsi_trainer_own(trainer),
                             outside);
        }
        sgs_trainer_destroy(trainer);
    }
}

static void a_resumed_region_has_the_same_bits(void **state)
{
    (void)state;
    char straight[17], resumed[17];
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; pipeline += 2) {
        sgs_train_options options = options_of(pipeline);
        options.max_gaussians = 100000;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, 57);
        const char *path = temp_path(&folder, "region");
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        sgs_threads_set(3);
        trainer_run(trainer, LENGTH - 57);
        sgs_threads_set(0);
        sgs_gaussians_hash(sgs_trainer_model(trainer), straight);
        sgs_trainer_destroy(trainer);
        trainer = trainer_create(scene, &options);
        if (sgs_trainer_load_checkpoint(trainer, path))
            fail_msg("%s", sgs_last_error());
        trainer_run(trainer, LENGTH - 57);
        sgs_gaussians_hash(sgs_trainer_model(trainer), resumed);
        assert_string_equal(straight, resumed);
        sgs_trainer_destroy(trainer);
        options.region.high[0] += 0.5f;
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "option region was -inf,-inf,-inf,"));
        sgs_trainer_destroy(trainer);
        options.region.high[0] -= 0.5f;
        options.max_gaussians = 200000; // the targets come from the first model, which it limits
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "option max_gaussians was 100000"));
        sgs_trainer_destroy(trainer);
    }
}

// A region with some of the rows, one with all of them, and none.
static void a_region_trains_all_sh_bands_from_the_first_iteration(void **state)
{
    (void)state;
    for (int k = 0; k < 3; ++k) {
        sgs_train_options options = options_of(SGS_PIPELINE_3DGS);
        if (k == 1)
            options.region = (sgs_box){{-1e6f, -1e6f, -1e6f}, {1e6f, 1e6f, 1e6f}};
        if (k == 2)
            options.region = sgs_box_infinite();
        sgs_trainer *trainer = trainer_create(scene, &options);
        assert_true((trainer->fixed == 0) == (k > 0));
        assert_int_equal(sgs_trainer_milestones(trainer).sh_interval, k < 2 ? 0 : 3);
        trainer_run(trainer, 1);
        size_t stepped = 0; // rows whose last band has a gradient
        for (size_t i = 0; i < trainer->model->count; ++i)
            stepped +=
                trainer->m[(i / SGS_LANES * SGS_PARAM_COUNT + SGS_PARAM_COUNT - 1) * SGS_LANES +
                           i % SGS_LANES] != 0.0f;
        assert_true((stepped > 10) == (k < 2));
        sgs_trainer_destroy(trainer);
    }
}

// The first views with other pixels: 3 or 4 channels, bytes or floats up to 1.5.
static sgs_scene *variant(int channels, bool floats)
{
    enum { VIEWS = 3 };
    sgs_view_source sources[VIEWS];
    float *pixels[VIEWS];
    uint8_t *bytes[VIEWS];
    for (size_t v = 0; v < VIEWS; ++v) {
        const sgs_view *view = &scene->views[7 * v];
        const size_t plane = (size_t)view->image.width * (size_t)view->image.height;
        pixels[v] = calloc(4 * plane, sizeof(float));
        bytes[v] = calloc(4 * plane, 1);
        for (size_t i = 0; i < plane; ++i)
            for (size_t c = 0; c < (size_t)channels; ++c) {
                const float value =
                    c == 3 ? (float)(i % 97) / 96.0f : sgs_photo_value(&view->image, c * plane + i);
                pixels[v][i * (size_t)channels + c] = c == 3 ? value : 1.5f * value;
                bytes[v][i * (size_t)channels + c] = (uint8_t)(255.0f * value + 0.5f);
            }
        sources[v] = (sgs_view_source){.camera = view->camera,
                                       .pose = view->pose,
                                       .pixel_type = floats ? SGS_PIXEL_FLOAT : SGS_PIXEL_UINT8,
                                       .channels = channels,
                                       .pixels = floats ? (void *)pixels[v] : (void *)bytes[v]};
    }
    sgs_scene_options options = sgs_scene_options_default();
    options.space = floats ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
    options.white_point = 1;
    sgs_scene *made;
    if (sgs_scene_create(sources, VIEWS, scene->points, scene->colors, scene->point_count, &options,
                         &made))
        fail_msg("%s", sgs_last_error());
    for (size_t v = 0; v < VIEWS; ++v) {
        free(pixels[v]);
        free(bytes[v]);
    }
    return made;
}

// Premultiplied value of a photo: colour c, or its alpha with c = 3.
static double value_of(const sgs_photo *photo, size_t c, size_t i)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    const double alpha = photo->channels > 3 ? (double)sgs_photo_value(photo, 3 * plane + i) : 1.0;
    return c == 3 ? alpha : alpha * (double)sgs_photo_value(photo, c * plane + i);
}

// To first order the corrections of all regions add up to that of the photo: target - image,
// where some primitive is seen. The image is that of the renderer.
static void check_targets(const sgs_scene *of, double tolerance)
{
    sgs_trainer *halves[2];
    double differs[2] = {0};
    sgs_train_options options = options_of(SGS_PIPELINE_3DGS);
    options.background[1] = 0.25f;
    for (int k = 0; k < 2; ++k) {
        if (k)
            options.region =
                (sgs_box){{region.high[0], -INFINITY, -INFINITY}, {INFINITY, INFINITY, INFINITY}};
        if (sgs_trainer_create(of, &options, &halves[k]))
            fail_msg("%s", sgs_last_error());
    }
    sgs_renderer *renderer;
    sgs_render_options render = sgs_render_options_default();
    render.near_distance = sgs_near_distance(of->extent);
    assert_int_equal(sgs_renderer_create(start, &renderer), SGS_STATUS_OK);
    for (size_t v = 0; v < of->view_count; v += of == scene ? 7 : 1) {
        const sgs_view *view = &of->views[v];
        const sgs_photo *photo = &view->image;
        const size_t plane = (size_t)photo->width * (size_t)photo->height;
        sgs_frame frame;
        assert_int_equal(sgs_frame_create(photo->width, photo->height, &frame), SGS_STATUS_OK);
        assert_int_equal(sgs_renderer_render(renderer, &view->camera, &view->pose, &render, &frame),
                         SGS_STATUS_OK);
        for (size_t c = 0; c < (size_t)photo->channels; ++c)
            for (size_t i = 0; i < plane; ++i) {
                const double through = (double)frame.transmittance[i];
                const double image =
                    c == 3
                        ? 1 - through
                        : (double)frame.color[c][i] +
                              (photo->channels > 3 ? 0 : through * (double)options.background[c]);
                const double given = value_of(photo, c, i);
                double sum = 0;
                for (int k = 0; k < 2; ++k) {
                    const double target = value_of(&halves[k]->views.targets[v], c, i);
                    sum += target - image;
                    differs[k] += fabs(target - given) / (double)plane;
                }
                if (through > 0.99 || (image > 0.99 && !photo->halves) || given > 0.99)
                    continue; // new, or clamped
                if (!(fabs(sum - (given - image)) <= tolerance))
                    fail_msg("view %zu, pixel %zu, channel %zu: %g, expected %g", v, i, c, sum,
                             given - image);
            }
        sgs_frame_free(&frame);
    }
    assert_true(differs[0] > 0.01 && differs[1] > 0.01);
    sgs_renderer_destroy(renderer);
    sgs_trainer_destroy(halves[0]);
    sgs_trainer_destroy(halves[1]);
}

static void targets_of_two_halves_add_up_to_the_photos(void **state)
{
    (void)state;
    check_targets(scene, 1.01 / 255);
    sgs_scene *alpha = variant(4, false), *hdr = variant(3, true);
    check_targets(alpha, 2.5 / 255); // colour and alpha are rounded
    check_targets(hdr, 2e-3);
    sgs_scene_destroy(alpha);
    sgs_scene_destroy(hdr);
}

// A trainer of one view alone builds the BVH for it; that of all views refits the one of the first.
static void targets_of_a_view_do_not_depend_on_other_views(void **state)
{
    (void)state;
    const sgs_train_options options = options_of(SGS_PIPELINE_3DGS);
    sgs_trainer *all = trainer_create(scene, &options);
    const sgsi_trace_seconds seconds = sgsi_tracer_seconds(all->views.tracer);
    assert_true(seconds.bvh_build == 0 && seconds.bvh_refit > 0);
    size_t differs = 0;
    for (size_t v = 0; v < scene->view_count; v += 5) {
        sgs_scene one = *scene;
        one.views = scene->views + v;
        one.view_count = 1;
        sgs_trainer *alone = trainer_create(&one, &options);
        const sgs_photo *a = &all->views.targets[v], *b = &alone->views.targets[0],
                        *photo = &scene->views[v].image;
        const size_t values = (size_t)a->channels * (size_t)a->width * (size_t)a->height;
        assert_memory_equal(a->pixels, b->pixels, values);
        differs += memcmp(a->pixels, photo->pixels, values) != 0;
        sgs_trainer_destroy(alone);
    }
    assert_true(differs > 2);
    sgs_trainer_destroy(all);
}

typedef struct preparation {
    size_t calls, done, total, limit; // limit: of the calls that continue
} preparation;

static bool count_preparation(void *user, size_t done, size_t total)
{
    preparation *p = user;
    ++p->calls;
    p->done = done;
    p->total = total;
    return done < p->limit;
}

static void preparing_images_reports_every_view_and_can_be_cancelled(void **state)
{
    (void)state;
    for (int pipeline = SGS_PIPELINE_3DGS; pipeline <= SGS_PIPELINE_DASH;
         pipeline += SGS_PIPELINE_DASH - SGS_PIPELINE_3DGS)
        for (int whole = 0; whole < 2; ++whole) { // without a region
            sgs_train_options options = options_of(pipeline);
            const size_t views = scene->view_count,
                         total = views * ((pipeline == SGS_PIPELINE_DASH) + !whole);
            if (whole)
                options.region = sgs_box_infinite();
            preparation p = {.limit = SIZE_MAX};
            options.progress = count_preparation;
            options.progress_user = &p;
            sgs_trainer_destroy(trainer_create(scene, &options));
            assert_true(p.calls == total && p.done == total && p.total == total);
            for (size_t limit = 1; limit < total; limit += views - 1) {
                sgs_trainer *trainer = NULL;
                p = (preparation){.limit = limit};
                assert_int_equal(sgs_trainer_create(scene, &options, &trainer),
                                 SGS_STATUS_CANCELLED);
                assert_null(trainer);
                assert_true(p.calls == limit && p.total == total);
            }
        }
}

static void a_region_without_primitives_is_refused(void **state)
{
    (void)state;
    sgs_train_options options = options_of(SGS_PIPELINE_3DGS);
    sgs_trainer *trainer;
    options.region = (sgs_box){{1e6f, 1e6f, 1e6f}, {2e6f, 2e6f, 2e6f}};
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(trainer);
    assert_string_equal(sgs_last_error(), "no centre of the initial model is in the region");
    options.init = NULL;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    assert_string_equal(sgs_last_error(), "region requires init");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_outside_keep_their_bytes_and_rows_inside_train),
        cmocka_unit_test(centres_stay_in_the_box),
        cmocka_unit_test(the_cap_counts_the_region_only),
        cmocka_unit_test(a_resumed_region_has_the_same_bits),
        cmocka_unit_test(a_region_trains_all_sh_bands_from_the_first_iteration),
        cmocka_unit_test(targets_of_two_halves_add_up_to_the_photos),
        cmocka_unit_test(targets_of_a_view_do_not_depend_on_other_views),
        cmocka_unit_test(preparing_images_reports_every_view_and_can_be_cancelled),
        cmocka_unit_test(a_region_without_primitives_is_refused),
    };
    return cmocka_run_group_tests(tests, prepare, clean);
}
