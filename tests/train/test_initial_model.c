// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The model that a training run begins with, from option init.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "support/files_support.h"
#include "support/trainer_support.h"

enum { ROWS = 50 };

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    return room_load(16, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

// Primitives at points of the scene, with SH of degree 3.
static sgs_gaussians *model_with_all_bands(void)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_init_points(scene->points, scene->colors, ROWS, 0.01, &model),
                     SGS_STATUS_OK);
    for (size_t i = 0; i < ROWS; ++i)
        for (int k = SGS_PARAM_SH_REST; k < SGS_PARAM_COUNT; ++k)
            *sgs_gaussians_at(model, i, k) = (float)sgsi_random_normal(1, 118 * i + 2 * (size_t)k);
    return model;
}

// With a copy of init and with init itself.
static void a_lower_sh_degree_removes_the_higher_bands(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "model.ply");
    for (int degree = 0; degree <= 3; ++degree)
        for (int takes = 0; takes < 2; ++takes) {
            sgs_train_options options = sgs_train_options_default();
            sgs_gaussians *init = model_with_all_bands(), *written;
            sgs_trainer *trainer;
            char in_memory[17], in_file[17];
            options.sh_degree = degree;
            options.init = takes ? NULL : init;
            if (takes ? sgs_trainer_create_from(scene, &options, &init, &trainer)
                      : sgs_trainer_create(scene, &options, &trainer))
                fail_msg("%s", sgs_last_error());
            sgs_gaussians_hash(sgs_trainer_model(trainer), in_memory);
            assert_int_equal(sgs_trainer_write_ply(trainer, path), SGS_STATUS_OK);
            assert_int_equal(sgs_ply_read(path, &written), SGS_STATUS_OK);
            sgs_gaussians_hash(written, in_file);
            if (strcmp(in_memory, in_file) != 0)
                fail_msg("degree %d: %s in memory, %s in the file", degree, in_memory, in_file);
            sgs_gaussians_destroy(written);
            sgs_gaussians_destroy(init);
            sgs_trainer_destroy(trainer);
        }
    temp_folder_remove(&folder);
}

static size_t first_count(const sgs_scene *of, const sgs_train_options *options)
{
    sgs_trainer *trainer;
    if (sgs_trainer_create(of, options, &trainer))
        fail_msg("%s", sgs_last_error());
    const size_t count = sgs_trainer_model(trainer)->count;
    sgs_trainer_destroy(trainer);
    return count;
}

// 10 000 points; as published 100 000, with the published schedule and in NeRF synthetic scenes.
static void a_scene_without_points_starts_from_a_random_cloud(void **state)
{
    (void)state;
    sgs_scene empty = *scene;
    sgs_train_options options = sgs_train_options_default();
    empty.point_count = 0;
    for (int paper = 0; paper < 2; ++paper)
        for (int white = 0; white < 2; ++white) {
            options.schedule = paper ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
            empty.white_background = white != 0;
            const size_t expected = paper || white ? 100000 : 10000;
            assert_int_equal(sgs_train_random_points(&empty, &options), expected);
            assert_int_equal(first_count(&empty, &options), expected);
        }
    options.random_points = 70;
    assert_int_equal(sgs_train_random_points(&empty, &options), 70);
    assert_int_equal(first_count(&empty, &options), 70);
    sgs_train_options earlier = options; // a struct without the field, and none
    earlier.struct_size = offsetof(sgs_train_options, random_points);
    empty.white_background = false;
    assert_int_equal(sgs_train_random_points(&empty, &earlier), 100000);
    assert_int_equal(sgs_train_random_points(&empty, NULL), 10000);
    earlier.struct_size = 1;
    assert_int_equal(sgs_train_random_points(&empty, &earlier), 0);
    options.max_gaussians = 60;
    assert_int_equal(first_count(&empty, &options), 60);
    assert_int_equal(sgs_train_random_points(scene, &options), 0);
    sgs_gaussians *init = model_with_all_bands();
    options.init = init;
    assert_int_equal(sgs_train_random_points(&empty, &options), 0);
    assert_int_equal(first_count(&empty, &options), ROWS);
    sgs_gaussians_destroy(init);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lower_sh_degree_removes_the_higher_bands),
        cmocka_unit_test(a_scene_without_points_starts_from_a_random_cloud),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
