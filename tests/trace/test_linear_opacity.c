// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Opacities as direct parameters, for Taming 3DGS (Mallick et al. 2024): same image, gradients by
// the chain rule, opacities above 1, logits in files, and a run that switches parametrisation and
// resumes.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/files_support.h"
#include "sparegs/trainer.h"
#include "support/tracer_support.h"

static temp_folder folder;

static float *gradients(const sgs_gaussians *model, traced_view *traced,
                        const sgsi_planes *incoming)
{
    assert_int_equal(sgsi_tracer_backward(traced->tracer, &traced->view, &traced->planes,
                                          incoming->color, incoming->transmittance),
                     SGS_STATUS_OK);
    float *out = sgsi_calloc(model->capacity, SGS_PARAM_COUNT * sizeof *out);
    assert_non_null(out);
    sgsi_optimize input = {.params = model->data,
                           .count = model->count,
                           .view = traced->view,
                           .sums = sgsi_tracer_grad_sums(traced->tracer),
                           .touched = sgsi_tracer_touched(traced->tracer),
                           .gradients = out};
    input.view.linear_opacity = model->linear_opacity;
    sgsi_optimize_blocks(&input, 0, (model->count + SGS_LANES - 1) / SGS_LANES);
    return out;
}

static sgsi_planes random_planes(int width, int height)
{
    const sgsi_planes planes = traced_planes_create(width, height);
    float *const all[4] = {planes.color[0], planes.color[1], planes.color[2], planes.transmittance};
    oracle_random random = {9, 0};
    for (int k = 0; k < 4; ++k)
        for (size_t i = 0; i < planes.stride * (size_t)height; ++i)
            all[k][i] = (float)oracle_normal(&random);
    return planes;
}

// dL/do = dL/dlogit / (o (1 - o)).
static void images_are_equal_and_gradients_follow_the_chain_rule(void **state)
{
    (void)state;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 83, 61);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    oracle_scene scene = traced_scene(0);
    sgsi_planes incoming = random_planes(83, 61);
    traced_view logit =
        traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
    float *expected = gradients(scene.model, &logit, &incoming);
    double *opacity = oracle_memory(scene.count, sizeof *opacity);
    for (size_t i = 0; i < scene.count; ++i)
        opacity[i] = 1 / (1 + exp(-(double)*sgs_gaussians_at(scene.model, i, SGS_PARAM_OPACITY)));
    sgs_gaussians_linearize_opacity(scene.model);
    for (size_t i = 0; i < scene.count; ++i) {
        float *x = sgs_gaussians_at(scene.model, i, SGS_PARAM_OPACITY);
        assert_true(fabs((double)*x - opacity[i]) < 1e-7);
        *x = i % 3 ? *x : -*x; // the opacity is |x|
    }
    traced_view linear =
        traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
    double worst_image = 0, worst = 0, largest = 0;
    for (int k = 0; k < 3; ++k)
        for (int y = 0; y < 61; ++y)
            for (int x = 0; x < 83; ++x) {
                const size_t at = (size_t)y * logit.planes.stride + (size_t)x;
                worst_image = fmax(worst_image, fabs((double)logit.planes.color[k][at] -
                                                     (double)linear.planes.color[k][at]));
            }
    float *actual = gradients(scene.model, &linear, &incoming);
    for (size_t i = 0; i < scene.count; ++i) {
        const size_t at =
            ((i / SGS_LANES) * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES + i % SGS_LANES;
        const double sign = i % 3 ? 1 : -1, chain = opacity[i] * (1 - opacity[i]);
        worst = fmax(worst, fabs((double)actual[at] * sign * chain - (double)expected[at]));
        largest = fmax(largest, fabs((double)expected[at]));
    }
    print_message("image within %.2e; gradient within %.2e of %.2e\n", worst_image, worst, largest);
    assert_true(worst_image < 4e-3); // hits near the limit of 1/255 may differ
    assert_true(largest > 0.1 && worst < 2e-3 * largest);
    sgsi_free(expected);
    sgsi_free(actual);
    free(opacity);
    traced_planes_free(&incoming);
    traced_destroy(&logit);
    traced_destroy(&linear);
    oracle_scene_free(&scene);
}

// One ball in the centre of the image: alpha = min(0.99, o exp(-rho^2 / 2)) along its rows.
static void opacity_above_one_widens_the_opaque_core(void **state)
{
    (void)state;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 65, 65);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    for (int step = 0; step < 3; ++step) {
        const double opacity = (double[]){0.5, 3.0, 20.0}[step], scale = 0.3;
        oracle_scene scene = oracle_scene_create(1);
        oracle_set_ball(oracle_primitive(&scene, 0), 0, 0, 0, scale, 0.5);
        oracle_scene_round(&scene);
        sgs_gaussians_linearize_opacity(scene.model);
        *sgs_gaussians_at(scene.model, 0, SGS_PARAM_OPACITY) = (float)opacity;
        traced_view traced =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_NONE, 2, SGSI_BVH_REFIT);
        double worst = 0;
        int seen = 0;
        for (int y = 0; y < 65; ++y)
            for (int x = 0; x < 65; ++x) {
                double d[3], t;
                assert_true(sgs_camera_unproject(&camera, (double[]){x + 0.5, y + 0.5}, d));
                t = 4 * d[2]; // the ray's point closest to the centre, which is 4 units away
                const double miss2 =
                    d[0] * d[0] * t * t + d[1] * d[1] * t * t + (d[2] * t - 4) * (d[2] * t - 4);
                const double alpha = fmin(opacity * exp(-0.5 * miss2 / (scale * scale)), 0.99);
                if (fabs(alpha * 255 - 1) < 1e-3)
                    continue;
                const double expected = alpha * 255 >= 1 ? 1 - alpha : 1;
                worst = fmax(worst,
                             fabs((double)traced.planes
                                      .transmittance[(size_t)y * traced.planes.stride + (size_t)x] -
                                  expected));
                seen += expected < 1;
            }
        assert_true(seen > 100);
        assert_true(worst < 2e-5);
        traced_destroy(&traced);
        oracle_scene_free(&scene);
    }
}

static void files_and_digests_hold_logits(void **state)
{
    (void)state;
    oracle_scene scene = traced_scene(1);
    sgs_gaussians_linearize_opacity(scene.model);
    *sgs_gaussians_at(scene.model, 0, SGS_PARAM_OPACITY) = 7.5f;
    *sgs_gaussians_at(scene.model, 1, SGS_PARAM_OPACITY) = -0.25f;
    const char *path = temp_path(&folder, "model.ply");
    assert_int_equal(sgs_ply_write(path, scene.model), SGS_STATUS_OK);
    sgs_gaussians *read;
    assert_int_equal(sgs_ply_read(path, &read), SGS_STATUS_OK);
    assert_false(read->linear_opacity);
    assert_true(fabs(*sgs_gaussians_at(read, 0, SGS_PARAM_OPACITY) - log((1 - 1e-6) / 1e-6)) <
                1e-5);
    assert_true(fabs(*sgs_gaussians_at(read, 1, SGS_PARAM_OPACITY) - log(0.25 / 0.75)) < 1e-6);
    char written[17], again[17];
    sgs_gaussians_hash(scene.model, written);
    sgs_gaussians_hash(read, again);
    assert_string_equal(written, again);
    sgs_gaussians_destroy(read);
    oracle_scene_free(&scene);
}

static void run(sgs_trainer *trainer, int steps)
{
    sgs_step_info info;
    for (int i = 0; i < steps; ++i)
        if (sgs_trainer_step(trainer, &info))
            fail_msg("%s", sgs_last_error());
}

static void training_switches_parametrisation_and_resumes(void **state)
{
    (void)state;
    enum { LENGTH = 80 };
    sgs_scene_options small = sgs_scene_options_default();
    small.downscale = 16;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &small, &scene), SGS_STATUS_OK);
    sgs_train_options options = sgs_train_options_default();
    options.iterations = LENGTH;
    options.pipeline = SGS_PIPELINE_TAMING;
    options.pipeline_options.taming_opacity = SGS_TAMING_LINEAR;
    options.spare = 0;
    float *rows = NULL;
    size_t bytes = 0;
    for (int stop = 0; stop < 4; ++stop) { // no stop; then a stop before, at and after the switch
        const int at = (int[]){0, LENGTH / 2 - 5, LENGTH / 2, LENGTH / 2 + 5}[stop];
        sgs_trainer *trainer;
        assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
        if (stop) {
            run(trainer, at);
            assert_int_equal(sgs_trainer_model(trainer)->linear_opacity, stop >= 2);
            const char *path = temp_path(&folder, "state");
            assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
            sgs_trainer_destroy(trainer);
            assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
            assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        }
        run(trainer, LENGTH - at);
        const sgs_gaussians *model = sgs_trainer_model(trainer);
        assert_true(model->linear_opacity);
        if (!stop) { // the digest does not cover opacities above 1: compare rows
            bytes = model->count / SGS_LANES * SGS_LANES * SGS_PARAM_COUNT * sizeof *rows;
            rows = oracle_memory(bytes, 1);
            memcpy(rows, model->data, bytes);
            size_t above = 0;
            for (size_t i = 0; i < model->count; ++i)
                above += fabsf(*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)) > 1.0f;
            assert_true(above > 0);
        }
        assert_memory_equal(model->data, rows, bytes);
        sgs_trainer_destroy(trainer);
    }
    free(rows);
    options.filter = SGS_FILTER_MIP;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    sgs_scene_destroy(scene);
}

static int make_folder(void **state)
{
    (void)state;
    folder = temp_folder_make();
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    temp_folder_remove(&folder);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_are_equal_and_gradients_follow_the_chain_rule),
        cmocka_unit_test(opacity_above_one_widens_the_opaque_core),
        cmocka_unit_test(files_and_digests_hold_logits),
        cmocka_unit_test(training_switches_parametrisation_and_resumes),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
