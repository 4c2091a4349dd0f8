// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Colour maps per image: gradients against finite differences, the same bits with any number of
// threads, and recovery of known exposure changes.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "base/core.h"
#include "loss/exposure.h"
#include "support/files_support.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "base/threads.h"
#include "train/trainer_state.h"

enum { WIDTH = 45, HEIGHT = 33, STRIDE = 48, PLANE = STRIDE * HEIGHT };

// Input of one evaluation; image and target are random.
typedef struct fixture {
    sgsi_exposure *exposure;
    sgsi_loss_workspace *workspace;
    float *planes[8]; // colour, T, gradients of both
    sgs_photo target;
} fixture;

static float *take(size_t count)
{
    float *block = sgsi_calloc(count, sizeof *block);
    assert_non_null(block);
    return block;
}

static fixture make_fixture(int channels)
{
    fixture f = {
        .target = {.width = WIDTH, .height = HEIGHT, .channels = channels, .kept = WIDTH * HEIGHT}};
    assert_int_equal(sgsi_exposure_create(2, PLANE, &f.exposure), SGS_STATUS_OK);
    assert_int_equal(sgsi_loss_create(&f.workspace), SGS_STATUS_OK);
    f.target.pixels = sgsi_calloc(WIDTH * HEIGHT, 4);
    assert_non_null(f.target.pixels);
    for (size_t i = 0; i < 4 * WIDTH * HEIGHT; ++i)
        f.target.pixels[i] = (uint8_t)(40 + sgsi_random_uniform(3, i) * 170);
    for (int k = 0; k < 8; ++k)
        f.planes[k] = take(PLANE);
    for (size_t i = 0; i < PLANE; ++i)
        for (int k = 0; k < 4; ++k)
            f.planes[k][i] = (float)(0.15 + 0.4 * sgsi_random_uniform(10 + (uint64_t)k, i));
    // A general map.
    size_t count;
    double *map = sgsi_exposure_state(f.exposure, &count);
    for (int i = 0; i < SGSI_EXPOSURE; ++i)
        map[i] += 0.1 * (sgsi_random_uniform(5, (uint64_t)i) - 0.5);
    return f;
}

static void free_fixture(fixture *f)
{
    for (int k = 0; k < 8; ++k)
        sgsi_free(f->planes[k]);
    sgsi_free(f->target.pixels);
    sgsi_loss_destroy(f->workspace);
    sgsi_exposure_destroy(f->exposure);
}

// Loss of the mapped image; with `gradients` also the backward pass.
static double evaluate(fixture *f, bool gradients)
{
    const sgsi_loss_input image = {.width = WIDTH,
                                   .height = HEIGHT,
                                   .stride = STRIDE,
                                   .color = {f->planes[0], f->planes[1], f->planes[2]},
                                   .transmittance = f->planes[3],
                                   .background = {0.3f, 0.2f, 0.6f},
                                   .target = &f->target,
                                   .ssim_weight = 0.2f,
                                   .alpha_weight = 0.1f};
    sgsi_loss_input input = image;
    sgsi_loss_output output = {.d_color = {f->planes[4], f->planes[5], f->planes[6]},
                               .d_transmittance = f->planes[7]};
    sgsi_exposure_forward(f->exposure, 0, &input);
    assert_int_equal(sgsi_loss_evaluate(f->workspace, &input, &output), SGS_STATUS_OK);
    if (gradients)
        assert_int_equal(sgsi_exposure_backward(f->exposure, 0, &image, &output), SGS_STATUS_OK);
    return output.loss;
}

static void compare_with_finite_differences(int channels)
{
    fixture f = make_fixture(channels);
    size_t count;
    double *map = sgsi_exposure_state(f.exposure, &count), gradient[SGSI_EXPOSURE], worst = 0;
    evaluate(&f, true);
    memcpy(gradient, sgsi_exposure_gradient(f.exposure), sizeof gradient);
    for (int i = 0; i < SGSI_EXPOSURE; ++i) {
        const double value = map[i], step = 5e-5; // kinks of the L1 term
        map[i] = value + step;
        const double up = evaluate(&f, false);
        map[i] = value - step;
        const double down = evaluate(&f, false);
        map[i] = value;
        const double error = fabs((up - down) / (2 * step) - gradient[i]);
        worst = fmax(worst, error / (0.01 + fabs(gradient[i])));
    }
    print_message("map: largest error %.1e of the gradient\n", worst);
    assert_true(worst < 5e-3);
    // Colours and transmittance at a few pixels; the step is large because single values change the
    // loss little.
    evaluate(&f, true);
    float *d_planes[4];
    for (int k = 0; k < 4; ++k) {
        d_planes[k] = take(PLANE);
        memcpy(d_planes[k], f.planes[4 + k], PLANE * sizeof(float));
    }
    for (int k = 0; k < 4; ++k) {
        double sum = 0, expected = 0;
        const double step = 1e-3; // a whole plane, along the signs of its gradient
        for (int pass = 0; pass < 2; ++pass) {
            for (size_t i = 0; i < PLANE; ++i)
                if (i % STRIDE < WIDTH)
                    f.planes[k][i] +=
                        (float)((pass ? -2 : 1) * step) * (d_planes[k][i] > 0 ? 1.0f : -1.0f);
            sum += (pass ? -1 : 1) * evaluate(&f, false);
        }
        for (size_t i = 0; i < PLANE; ++i) {
            if (i % STRIDE >= WIDTH)
                continue;
            f.planes[k][i] += (float)step * (d_planes[k][i] > 0 ? 1.0f : -1.0f);
            expected += fabs((double)d_planes[k][i]);
        }
        assert_true(fabs(sum / (2 * step) - expected) < 0.02 * expected);
    }
    for (int k = 0; k < 4; ++k)
        sgsi_free(d_planes[k]);
    free_fixture(&f);
}

// Without and with the alpha channel of the photo.
static void gradients_match_finite_differences(void **state)
{
    (void)state;
    compare_with_finite_differences(3);
    compare_with_finite_differences(4);
}

// A map does not change what lies behind the primitives if the photo has an alpha channel.
static void the_background_is_not_mapped_behind_alpha(void **state)
{
    (void)state;
    for (int channels = 3; channels <= 4; ++channels) {
        fixture f = make_fixture(channels);
        for (size_t i = 0; i < PLANE; ++i) {
            f.planes[0][i] = f.planes[1][i] = f.planes[2][i] = 0;
            f.planes[3][i] = 1;
        }
        sgsi_loss_input input = {.width = WIDTH,
                                 .height = HEIGHT,
                                 .stride = STRIDE,
                                 .color = {f.planes[0], f.planes[1], f.planes[2]},
                                 .transmittance = f.planes[3],
                                 .background = {0.3f, 0.2f, 0.6f},
                                 .target = &f.target};
        sgsi_exposure_forward(f.exposure, 0, &input);
        double change = 0;
        for (int c = 0; c < 3; ++c)
            change +=
                fabs((double)(input.color[c][7] + input.transmittance[7] * input.background[c] -
                              (const float[]){0.3f, 0.2f, 0.6f}[c]));
        assert_true(channels == 4 ? change < 1e-6 : change > 0.01);
        free_fixture(&f);
    }
}

// Steps with changing gradients against Adam (Kingma and Ba 2015, algorithm 1) with 0.9, 0.999 and
// 1e-8, written out here.
static void steps_are_those_of_adam(void **state)
{
    (void)state;
    fixture f = make_fixture(4);
    size_t count;
    const double *map = sgsi_exposure_state(f.exposure, &count), rate = 0.01;
    double expected[SGSI_EXPOSURE], m[SGSI_EXPOSURE] = {0}, v[SGSI_EXPOSURE] = {0};
    memcpy(expected, map, sizeof expected);
    for (int t = 1; t <= 30; ++t) {
        for (size_t i = 0; i < PLANE; ++i)
            f.planes[0][i] = (float)(0.1 + 0.5 * sgsi_random_uniform(40 + (uint64_t)t, i));
        evaluate(&f, true);
        const double *g = sgsi_exposure_gradient(f.exposure);
        for (int i = 0; i < SGSI_EXPOSURE; ++i) {
            m[i] = 0.9 * m[i] + (1 - 0.9) * g[i];
            v[i] = 0.999 * v[i] + (1 - 0.999) * g[i] * g[i];
            expected[i] -=
                rate * (m[i] / (1 - pow(0.9, t))) / (sqrt(v[i] / (1 - pow(0.999, t))) + 1e-8);
        }
        sgsi_exposure_step(f.exposure, 0, rate);
        for (int i = 0; i < SGSI_EXPOSURE; ++i)
            assert_true(fabs(map[i] - expected[i]) < 1e-9);
    }
    free_fixture(&f);
}

static void bits_do_not_depend_on_threads(void **state)
{
    (void)state;
    double gradients[2][SGSI_EXPOSURE];
    float *planes[2];
    for (int k = 0; k < 2; ++k) {
        sgsi_threads_set(k ? 3 : 1);
        fixture f = make_fixture(4);
        evaluate(&f, true);
        memcpy(gradients[k], sgsi_exposure_gradient(f.exposure), sizeof gradients[k]);
        planes[k] = f.planes[7];
        f.planes[7] = NULL;
        free_fixture(&f);
    }
    sgsi_threads_set(0);
    assert_memory_equal(gradients[0], gradients[1], sizeof gradients[0]);
    assert_memory_equal(planes[0], planes[1], PLANE * sizeof(float));
    sgsi_free(planes[0]);
    sgsi_free(planes[1]);
}

static double gain_of(size_t view)
{
    return 0.5 + 0.5 * sgsi_random_uniform(77, view);
}

// Loss after a short training on images with varying exposure; *correlation between gains and
// learned maps.
static double train(bool exposure, double *correlation)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    for (size_t v = 0; v < scene->view_count; ++v) {
        sgs_photo *photo = &scene->views[v].image;
        for (size_t i = 0; i < 3 * (size_t)photo->width * (size_t)photo->height; ++i)
            photo->pixels[i] = (uint8_t)(photo->pixels[i] * gain_of(v));
    }
    sgs_train_options values = sgs_train_options_default();
    values.iterations = 175; // five iterations per image
    values.exposure = exposure;
    values.sh_degree = 0;
    sgs_trainer *trainer;
    sgs_step_info info = {0};
    assert_int_equal(sgs_trainer_create(scene, &values, &trainer), SGS_STATUS_OK);
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    double x = 0, y = 0, xx = 0, yy = 0, xy = 0;
    for (size_t v = 0; v < scene->view_count && exposure; ++v) {
        const double *map = sgs_trainer_exposure(trainer, v), gain = gain_of(v);
        assert_non_null(map);
        const double learned = (map[0] + map[5] + map[10]) / 3 + (map[3] + map[7] + map[11]) / 1.5;
        x += gain, y += learned, xx += gain * gain, yy += learned * learned, xy += gain * learned;
    }
    const double n = (double)scene->view_count;
    *correlation = exposure ? (xy - x * y / n) / sqrt((xx - x * x / n) * (yy - y * y / n)) : 0;
    if (!exposure)
        assert_null(sgs_trainer_exposure(trainer, 0));
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(scene);
    return info.loss_average;
}

static void changing_exposures_are_learned(void **state)
{
    (void)state;
    double correlation, none;
    const double without = train(false, &none), with = train(true, &correlation);
    print_message("loss %.4f, with exposure %.4f; correlation of gains and maps %.3f\n", without,
                  with, correlation);
    assert_true(with < without - 0.003 && correlation > 0.8);
}

static sgs_trainer *start(const sgs_scene *scene)
{
    sgs_train_options values = sgs_train_options_default();
    values.iterations = 80;
    values.exposure = true;
    sgs_trainer *trainer;
    if (sgs_trainer_create(scene, &values, &trainer))
        fail_msg("%s", sgs_last_error());
    return trainer;
}

static void run(sgs_trainer *trainer, int steps)
{
    sgs_step_info info;
    for (int i = 0; i < steps; ++i)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
}

static void a_resumed_run_has_the_same_maps(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    sgs_trainer *straight = start(scene), *resumed = start(scene);
    run(straight, 50);
    assert_int_equal(sgs_trainer_save_checkpoint(straight, temp_path(&folder, "state.bin")),
                     SGS_STATUS_OK);
    run(straight, 30);
    if (sgs_trainer_load_checkpoint(resumed, temp_path(&folder, "state.bin")))
        fail_msg("%s", sgs_last_error());
    run(resumed, 30);
    for (size_t v = 0; v < scene->view_count; ++v)
        assert_memory_equal(sgs_trainer_exposure(straight, v), sgs_trainer_exposure(resumed, v),
                            SGSI_EXPOSURE * sizeof(double));
    char hashes[2][17];
    sgs_gaussians_hash(sgs_trainer_model(straight), hashes[0]);
    sgs_gaussians_hash(sgs_trainer_model(resumed), hashes[1]);
    assert_string_equal(hashes[0], hashes[1]);
    sgs_trainer_destroy(straight);
    sgs_trainer_destroy(resumed);
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
}

// Votes of FastGS with photos and colour maps of this gain; *count: primitives.
static float *votes_with_gain(sgs_trainer *trainer, sgs_scene *scene, double gain, size_t *count)
{
    for (size_t v = 0; v < scene->view_count; ++v) {
        sgs_photo *photo = &scene->views[v].image;
        for (size_t i = 0; i < 3 * (size_t)photo->width * (size_t)photo->height; ++i)
            photo->pixels[i] = (uint8_t)(photo->pixels[i] * gain + 0.5);
    }
    size_t numbers;
    double *states = sgsi_exposure_state(trainer->views.exposure, &numbers);
    const size_t each = numbers / trainer->views.count;
    for (size_t i = 0; i < trainer->views.count; ++i)
        for (size_t k = 0; k < SGSI_EXPOSURE; ++k)
            states[i * each + k] = k % 5 ? 0 : gain; // the diagonal
    const sgsi_score_input input = {.pipeline = trainer->pipeline,
                                    .model = trainer->model,
                                    .count = trainer->count,
                                    .whole_count = trainer->count,
                                    .iteration = trainer->progress.iteration,
                                    .statistics = &trainer->statistics};
    sgsi_view_scores scores = {0};
    assert_int_equal(sgsi_view_scores_compute(&trainer->views, &input, &scores), SGS_STATUS_OK);
    *count = trainer->count;
    float *votes = take(*count);
    memcpy(votes, scores.importance, *count * sizeof *votes);
    sgsi_view_scores_free(&scores);
    return votes;
}

// A pixel counts if its error is large compared with the others of its view: darker photos
// with maps of the same gain get the same votes.
static void votes_compare_with_the_exposure_of_the_photo(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    sgs_train_options values = sgs_train_options_default();
    values.iterations = 80;
    values.exposure = true;
    values.pipeline = SGS_PIPELINE_FASTGS;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, &values, &trainer), SGS_STATUS_OK);
    run(trainer, 15);
    size_t count;
    float *const bright = votes_with_gain(trainer, scene, 1, &count), *const dark = votes_with_gain(
                                                                          trainer, scene, 0.4,
                                                                          &count);
    double sum = 0, difference = 0;
    for (size_t i = 0; i < count; ++i) {
        sum += (double)bright[i];
        difference += fabs((double)bright[i] - (double)dark[i]);
    }
    print_message("votes %.0f, difference %.0f\n", sum, difference);
    assert_true(sum > 0 && difference < 0.1 * sum);
    sgsi_free(bright);
    sgsi_free(dark);
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_match_finite_differences),
        cmocka_unit_test(the_background_is_not_mapped_behind_alpha),
        cmocka_unit_test(steps_are_those_of_adam),
        cmocka_unit_test(bits_do_not_depend_on_threads),
        cmocka_unit_test(changing_exposures_are_learned),
        cmocka_unit_test(a_resumed_run_has_the_same_maps),
        cmocka_unit_test(votes_compare_with_the_exposure_of_the_photo),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
