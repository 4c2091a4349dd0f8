// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The n-th allocation fails, for every n: loading a scene, creating a trainer, a step, a structural
// update, saving and loading checkpoints and models end with OUT_OF_MEMORY and a message, without a
// crash, a leak (address sanitizer) or a partial result, and succeed afterwards.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core.h"
#include "support/files_support.h"
#include "sparegs/image.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "train/trainer_state.h"

enum { WIDTH = 48, HEIGHT = 32, VIEWS = 3, MAX_ALLOCATIONS = 5000 };

static temp_folder folder;
static sgs_scene *scene;
static sgs_trainer *trainer;

static void write_file(const char *name, const char *text)
{
    file_put(temp_path(&folder, name), text, strlen(text));
}

static int make_scene(void **state)
{
    (void)state;
    folder = temp_folder_make();
    write_file("cameras.txt", "1 OPENCV 48 32 40 40 24 16 0.01 0 0 0\n");
    write_file(
        "images.txt",
        "1 1 0 0 0 0 0 4 1 a.png\n\n2 1 0 0 0 0.2 0 4 1 b.png\n\n3 1 0 0 0 0.4 0 4 1 c.png\n\n");
    char points[8192] = "";
    for (int i = 0; i < 100; ++i) {
        const double x = 2 * sgsi_random_uniform(1, 3 * (uint64_t)i) - 1,
                     y = 2 * sgsi_random_uniform(1, 3 * (uint64_t)i + 1) - 1;
        snprintf(points + strlen(points), sizeof points - strlen(points),
                 "%d %.4f %.4f %.4f %d 90 30 0.5\n", i + 1, x, y, 0.3 * x * y, i);
    }
    write_file("points3D.txt", points);
    uint8_t pixels[3 * WIDTH * HEIGHT];
    for (size_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)(i % 251);
    const sgs_image8 image = {WIDTH, HEIGHT, 3, pixels};
    const char *const names[VIEWS] = {"a.png", "b.png", "c.png"};
    for (int i = 0; i < VIEWS; ++i)
        if (sgs_png_write(temp_path(&folder, names[i]), &image))
            return 1;
    sgs_threads_set(1); // one order of allocations
    return 0;
}

static int remove_scene(void **state)
{
    (void)state;
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
    return 0;
}

static sgs_status load_scene(void)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.images_dir = folder.path;
    options.downscale = 2;
    return sgs_scene_load(folder.path, &options, &scene);
}

static sgs_status create_trainer(void)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    return sgs_trainer_create(scene, &options, &trainer);
}

// Runs `work` with a failing n-th allocation, n = 1, 2, ..., until none fails. `work` may succeed
// in spite of at most `advisory` failures (in messages); `undo` then checks and releases its
// result.
static void fail_each(const char *what, sgs_status (*work)(void), int advisory, void (*undo)(void))
{
    for (size_t n = 1;; ++n) {
        assert_true(n < MAX_ALLOCATIONS);
        const size_t before = sgsi_allocation_count();
        sgsi_fail_allocation(n);
        const sgs_status status = work();
        sgsi_fail_allocation(0);
        const bool failed = sgsi_allocation_count() - before >= n;
        const bool done_without = failed && !status && advisory-- > 0;
        if (failed && !done_without && (status != SGS_STATUS_OUT_OF_MEMORY || !*sgs_last_error()))
            fail_msg("%s: allocation %zu failed, the status is %d: %s", what, n, status,
                     sgs_last_error());
        if (!failed) {
            if (status)
                fail_msg("%s: %s", what, sgs_last_error());
            return;
        }
        if (!status)
            undo();
    }
}

static void nothing(void)
{
}

static void expect_scene(void)
{
    assert_int_equal(scene->view_count, VIEWS);
    assert_int_equal(scene->point_count, 100);
    assert_int_equal(scene->images_missing, 0);
    sgs_scene_destroy(scene);
}

static void loading_a_scene(void **state)
{
    (void)state;
    fail_each("scene", load_scene, 20, expect_scene); // the search for photos without a pose
    assert_int_equal(scene->view_count, VIEWS);
}

static void creating_a_trainer(void **state)
{
    (void)state;
    assert_non_null(scene);
    fail_each("trainer", create_trainer, 0, nothing);
}

static sgs_status first_step(void)
{
    sgs_trainer_destroy(trainer);
    trainer = NULL;
    sgs_step_info info;
    const sgs_status status = create_trainer();
    return status ? status : sgs_trainer_step(trainer, &info);
}

static void the_first_step(void **state)
{
    (void)state;
    fail_each("step", first_step, 0, nothing);
}

static sgs_status structural_update(void)
{
    sgs_trainer_destroy(trainer); // after a failed update the model is unusable
    trainer = NULL;
    sgs_step_info info;
    sgs_status status = create_trainer();
    if (!status)
        status = sgs_trainer_step(trainer, &info);
    return status ? status : sgsi_trainer_update_structure(trainer, 2, NULL, &info);
}

static void a_structural_update(void **state)
{
    (void)state;
    fail_each("structural update", structural_update, 0, nothing);
}

static sgs_status save_checkpoint(void)
{
    return sgs_trainer_save_checkpoint(trainer, temp_path(&folder, "state"));
}

static sgs_status load_checkpoint(void)
{
    return sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "state"));
}

static void saving_and_loading_a_checkpoint(void **state)
{
    (void)state;
    char before[17], after[17];
    fail_each("save checkpoint", save_checkpoint, 0, nothing);
    sgs_gaussians_hash(sgs_trainer_model(trainer), before);
    fail_each("load checkpoint", load_checkpoint, 0, nothing);
    sgs_gaussians_hash(sgs_trainer_model(trainer), after);
    assert_string_equal(before, after);
    sgs_step_info info;
    assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
}

static sgs_gaussians *model;

static sgs_status save_model(void)
{
    return sgs_ply_write(temp_path(&folder, "model"), sgs_trainer_model(trainer));
}

static sgs_status load_model(void)
{
    return sgs_ply_read(temp_path(&folder, "model"), &model);
}

static void saving_and_loading_a_model(void **state)
{
    (void)state;
    fail_each("save model", save_model, 0, nothing);
    fail_each("load model", load_model, 0, nothing);
    assert_int_equal(model->count, sgs_trainer_model(trainer)->count);
    sgs_gaussians_destroy(model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(loading_a_scene),
        cmocka_unit_test(creating_a_trainer),
        cmocka_unit_test(the_first_step),
        cmocka_unit_test(a_structural_update),
        cmocka_unit_test(saving_and_loading_a_checkpoint),
        cmocka_unit_test(saving_and_loading_a_model),
    };
    return cmocka_run_group_tests(tests, make_scene, remove_scene);
}
