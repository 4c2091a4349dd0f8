// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Steps of several views: moments and parameters are those of Adam on the mean of the views'
// gradients, which the public renderer computes here one by one, in double; parameters change at
// the end of a batch only; a batch ends before a structural update; resuming inside of a batch
// gives the same bits.

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
#include "loss/loss.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/files_support.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;
static temp_folder folder;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 16;
    folder = temp_folder_make();
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
    return 0;
}

// data: NULL = zeros, as the moments before the first step.
static sgs_gaussians *copy_model(const sgs_gaussians *from, const float *data)
{
    sgs_gaussians *copy;
    assert_int_equal(sgs_gaussians_create(from->capacity, &copy), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(copy, from->count), SGS_STATUS_OK);
    copy->sh_degree = from->sh_degree;
    for (size_t i = 0; i < from->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            *sgs_gaussians_at(copy, i, k) =
                data ? data[(i / SGS_LANES * SGS_PARAM_COUNT + (size_t)k) * SGS_LANES +
                            i % SGS_LANES]
                     : 0.0f;
    return copy;
}

// Adds dL/dparameters of a view, SH degree 0, to sum [count][SGS_PARAM_COUNT].
static void add_gradient(const sgs_gaussians *model, size_t v, double *sum)
{
    const sgs_view *view = &scene->views[v];
    const int width = view->camera.width, height = view->camera.height;
    const size_t stride = ((size_t)width + 15) / 16 * 16, plane = stride * (size_t)height;
    sgs_renderer *renderer;
    sgs_render_options options = sgs_render_options_default();
    options.near_distance = sgs_near_distance(scene->extent);
    options.sh_degree = 0;
    options.differentiable = true;
    sgs_frame frame, d_frame;
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(width, height, 0, &frame), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(width, height, 0, &d_frame), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(renderer, &view->camera, &view->pose, &options, &frame),
                     SGS_STATUS_OK);
    // The loss reads and writes rows of `stride` floats.
    float *block = sgsi_calloc(plane, 8 * sizeof *block);
    float *from[8] = {frame.color[0],   frame.color[1],   frame.color[2],   frame.transmittance,
                      d_frame.color[0], d_frame.color[1], d_frame.color[2], d_frame.transmittance};
    for (size_t k = 0; k < 4; ++k)
        for (size_t y = 0; y < (size_t)height; ++y)
            memcpy(block + k * plane + y * stride, from[k] + y * (size_t)width,
                   (size_t)width * sizeof *block);
    sgsi_loss_workspace *loss;
    assert_int_equal(sgsi_loss_create(&loss), SGS_STATUS_OK);
    const sgsi_loss_input input = {.width = width,
                                   .height = height,
                                   .stride = stride,
                                   .color = {block, block + plane, block + 2 * plane},
                                   .transmittance = block + 3 * plane,
                                   .target = &view->image,
                                   .ssim_weight = 0.2f};
    sgsi_loss_output output = {.d_color = {block + 4 * plane, block + 5 * plane, block + 6 * plane},
                               .d_transmittance = block + 7 * plane};
    assert_int_equal(sgsi_loss_evaluate(loss, &input, &output), SGS_STATUS_OK);
    for (size_t k = 4; k < 8; ++k)
        for (size_t y = 0; y < (size_t)height; ++y)
            memcpy(from[k] + y * (size_t)width, block + k * plane + y * stride,
                   (size_t)width * sizeof *block);
    sgs_gaussians *d_model = copy_model(model, model->data);
    assert_int_equal(sgs_renderer_backward(renderer, &d_frame, d_model), SGS_STATUS_OK);
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            sum[i * SGS_PARAM_COUNT + (size_t)k] += (double)*sgs_gaussians_at(d_model, i, k);
    sgs_gaussians_destroy(d_model);
    sgs_renderer_destroy(renderer);
    sgs_frame_free(&frame);
    sgs_frame_free(&d_frame);
    sgsi_loss_destroy(loss);
    sgsi_free(block);
}

// Rates of 3DGS at the start, without that of the means.
static double rate_of(const sgs_trainer *trainer, int k)
{
    return k < SGS_PARAM_ROTATION  ? SGS_TRAIN_LR_MEAN * scene->extent
           : k < SGS_PARAM_SCALE   ? 1e-3
           : k < SGS_PARAM_OPACITY ? 5e-3
           : k < SGS_PARAM_SH_DC   ? (double)trainer->pipeline->lr_opacity
                                   : 2.5e-3;
}

static void a_step_is_adam_on_the_mean_gradient(void **state)
{
    (void)state;
    for (int batch = 2; batch <= 3; ++batch) {
        sgs_train_options options = sgs_train_options_default();
        options.batch = batch;
        options.schedule = SGS_SCHEDULE_PAPER;
        sgs_trainer *trainer = trainer_create(scene, &options);
        const sgs_gaussians *model = sgs_trainer_model(trainer);
        const size_t n = model->count;
        const double b1 = pow(0.9, batch), b2 = pow(0.999, batch), root = sqrt(batch);
        for (int step = 0; step < 3; ++step) {
            sgs_gaussians *before = copy_model(model, model->data),
                          *m = copy_model(model, trainer->m), *v = copy_model(model, trainer->v);
            double *mean = calloc(n * SGS_PARAM_COUNT, sizeof *mean);
            for (int k = 0; k < batch; ++k)
                add_gradient(before, trainer_run(trainer, 1).view, mean);
            size_t compared = 0;
            for (size_t i = 0; i < n; ++i)
                for (int k = 0; k < SGS_PARAM_SH_REST; ++k) {
                    const double g = mean[i * SGS_PARAM_COUNT + (size_t)k] / batch;
                    if (!(fabs(g) > 1e-9))
                        continue;
                    const size_t at =
                        (i / SGS_LANES * SGS_PARAM_COUNT + (size_t)k) * SGS_LANES + i % SGS_LANES;
                    const double m1 = b1 * (double)*sgs_gaussians_at(m, i, k) + (1 - b1) * g,
                                 v1 = b2 * (double)*sgs_gaussians_at(v, i, k) + (1 - b2) * g * g;
                    const double old = (double)*sgs_gaussians_at(before, i, k);
                    const double p =
                        old - root * rate_of(trainer, k) * m1 / (sqrt(v1) + 1e-15 / root);
                    const double got = (double)*sgs_gaussians_at(model, i, k);
                    // The position rate decays by 1e-4 per iteration at most.
                    if (!(fabs((double)trainer->m[at] - m1) <=
                          2e-3 * (fabs(m1) + (1 - b1) * fabs(g))) ||
                        !(fabs((double)trainer->v[at] - v1) <= 2e-3 * v1) ||
                        !(fabs(got - p) <= 4e-3 * fabs(p - old) + 1e-6 * fabs(old)))
                        fail_msg(
                            "batch %d, step %d, row %zu, parameter %d: m %g, expected %g; v %g, "
                            "expected %g; %g -> %g, expected %g",
                            batch, step, i, k, (double)trainer->m[at], m1, (double)trainer->v[at],
                            v1, old, got, p);
                    ++compared;
                }
            assert_true(compared > n);
            free(mean);
            sgs_gaussians_destroy(before);
            sgs_gaussians_destroy(m);
            sgs_gaussians_destroy(v);
        }
        sgs_trainer_destroy(trainer);
    }
}

enum { LENGTH = 120 };

static sgs_train_options options_of(int pipeline, int batch)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = LENGTH;
    options.pipeline = (sgs_pipeline)pipeline;
    options.filter = pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    options.optimizer = pipeline == SGS_PIPELINE_MIP ? SGS_OPTIMIZER_DENSE : SGS_OPTIMIZER_SPARSE;
    options.spare_patience = 1000;
    options.batch = batch;
    return options;
}

static void parameters_change_at_the_end_of_a_batch(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        const sgs_train_options options = options_of(pipeline, 4);
        sgs_trainer *trainer = trainer_create(scene, &options);
        char before[17], after[17];
        int views = 0, steps = 0, updates = 0;
        sgs_gaussians_hash(sgs_trainer_model(trainer), before);
        for (int i = 1; i < LENGTH; ++i) {
            const sgs_step_info info = trainer_run(trainer, 1);
            const sgsi_schedule *schedule = &trainer->schedule;
            const bool structural = sgsi_schedule_is_update(schedule, i);
            const bool last = sgsi_schedule_is_update(schedule, i + 1) ||
                              sgsi_schedule_is_reset(schedule, i) || i == schedule->densify_until ||
                              i + 1 == LENGTH;
            views += !structural;
            const bool ends = !structural && (views == 4 || last);
            assert_int_equal(trainer->progress.batch_views, ends ? 0 : views);
            views = ends ? 0 : views;
            steps += ends;
            updates += info.structural;
            sgs_gaussians_hash(sgs_trainer_model(trainer), after);
            if (!info.structural && strcmp(before, after) != 0 && !ends)
                fail_msg("%s: iteration %d changed the model", trainer->pipeline->name, i);
            if (!strcmp(before, after) && ends && pipeline != SGS_PIPELINE_FASTGS)
                fail_msg("%s: iteration %d made no step", trainer->pipeline->name, i);
            if (structural) // the update is made by the next step
                assert_int_equal(views, 0);
            memcpy(before, after, sizeof before);
        }
        assert_true(steps >= LENGTH / 5 && steps < LENGTH / 2 && updates > 0);
        sgs_trainer_destroy(trainer);
    }
}

static void resuming_inside_of_a_batch_gives_the_same_bits(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        char hash[3][17];
        sgs_train_options options = options_of(pipeline, 3);
        options.exposure = pipeline == SGS_PIPELINE_TAMING;
        sgs_trainer *trainer = trainer_create(scene, &options);
        int at = 60;
        for (trainer_run(trainer, at); trainer->progress.batch_views != 2; ++at)
            trainer_run(trainer, 1);
        const char *path = temp_path(&folder, "batch");
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        trainer_run(trainer, LENGTH - at);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hash[0]);
        sgs_trainer_destroy(trainer);
        sgs_threads_set(3);
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        trainer_run(trainer, LENGTH - at);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hash[1]);
        sgs_trainer_destroy(trainer);
        sgs_threads_set(0);
        options.batch = 1;
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(
            strstr(sgs_last_error(), "option batch was 3 when the run started and is 1"));
        trainer_run(trainer, LENGTH);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hash[2]);
        sgs_trainer_destroy(trainer);
        assert_string_equal(hash[0], hash[1]);
        assert_string_not_equal(hash[0], hash[2]);
    }
}

// Also a run that is shorter than its batch. The batch of a run that can be extended stays open.
static void the_last_batch_of_a_run_makes_a_step(void **state)
{
    (void)state;
    static const sgs_schedule schedules[] = {SGS_SCHEDULE_SCALED, SGS_SCHEDULE_PAPER};
    for (int k = 0; k < 2; ++k) {
        sgs_train_options options = sgs_train_options_default();
        options.iterations = 6;
        options.batch = 16;
        options.schedule = schedules[k];
        char hash[2][17];
        sgs_trainer *trainer = trainer_create(scene, &options);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hash[0]);
        trainer_run(trainer, 6);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hash[1]);
        assert_int_equal(strcmp(hash[0], hash[1]) != 0, schedules[k] != SGS_SCHEDULE_PAPER);
        assert_int_equal(trainer->progress.batch_views, k ? 5 : 0);
        sgs_trainer_destroy(trainer);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_step_is_adam_on_the_mean_gradient),
        cmocka_unit_test(parameters_change_at_the_end_of_a_batch),
        cmocka_unit_test(resuming_inside_of_a_batch_gives_the_same_bits),
        cmocka_unit_test(the_last_batch_of_a_run_makes_a_step),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
