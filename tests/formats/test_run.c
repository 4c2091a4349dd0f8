// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Run folders: the newest model, the settings of config.json, and folders that are incomplete.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/model_file.h"
#include "sparegs/run.h"
#include "support/files_support.h"

static temp_folder folder;
static char run[512];

static void put(const char *name, const char *text)
{
    char path[1024];
    snprintf(path, sizeof path, "%s/%s", run, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static void put_model(const char *iteration, size_t count)
{
    char path[1024];
    snprintf(path, sizeof path, "%s/point_cloud", run);
    mkdir(path, 0777);
    snprintf(path, sizeof path, "%s/point_cloud/%s", run, iteration);
    assert_int_equal(mkdir(path, 0777), 0);
    if (!count)
        return;
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    float params[SGS_PARAM_COUNT] = {0};
    params[SGS_PARAM_ROTATION] = 1;
    for (size_t i = 0; i < count; ++i)
        sgs_gaussians_set(model, i, params);
    snprintf(path, sizeof path, "%s/point_cloud/%s/point_cloud.ply", run, iteration);
    assert_int_equal(sgs_ply_write(path, model), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
}

static void the_newest_model_is_read_with_its_settings(void **state)
{
    (void)state;
    snprintf(run, sizeof run, "%s", temp_path(&folder, "run"));
    assert_int_equal(mkdir(run, 0777), 0);
    put_model("iteration_900", 2);
    put_model("iteration_1000", 3);
    put_model("iteration_2000", 0);   // without a model
    put_model("iteration_30000x", 4); // another name
    sgs_run_settings settings;
    sgs_gaussians *model;
    char path[1024];
    int iteration;
    assert_int_equal(sgs_run_read(run, &model, &settings), SGS_STATUS_OK);
    assert_int_equal(model->count, 3);
    assert_int_equal(settings.iteration, 1000);
    assert_int_equal(settings.filter, SGS_FILTER_3DGS);
    assert_true(settings.compact_box == 1.0 && settings.background[1] == 0.0f);
    sgs_gaussians_destroy(model);
    put("config.json", "{\"options\": {\"filter\": \"mip\", \"compact_box\": 0.5, "
                       "\"background\": [0.25, 0.5, 1]}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_int_equal(settings.filter, SGS_FILTER_MIP);
    assert_true(settings.compact_box == 0.5 && settings.background[0] == 0.25f &&
                settings.background[2] == 1.0f);
    put("config.json", "{\"options\": {\"background\": \"random\"}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_true(settings.background[0] == 0.0f);
    assert_int_equal(sgs_run_model_path(run, path, sizeof path, &iteration), SGS_STATUS_OK);
    assert_int_equal(iteration, 1000);
    assert_non_null(strstr(path, "/point_cloud/iteration_1000/point_cloud.ply"));
    assert_int_equal(sgs_run_model_path(run, path, 20, NULL), SGS_STATUS_LIMIT);
    assert_int_equal(sgs_run_iteration("iteration_7000"), 7000);
    const char *const others[] = {"iteration_",   "iteration_7x", "iteration_0",
                                  "iteration_ 7", "iteration_+7", "iteration_-7",
                                  "7000",         "iteration_07", "iteration_99999999999"};
    for (size_t k = 0; k < sizeof others / sizeof *others; ++k)
        assert_int_equal(sgs_run_iteration(others[k]), 0);
}

// A model of a small scene in linear light is rendered as it was trained.
static void near_distance_and_colours_are_those_of_the_training(void **state)
{
    (void)state;
    sgs_run_settings settings;
    put("config.json", "{\"near_distance\": 0.0112, \"options\": {\"train_space\": \"linear\", "
                       "\"white\": 5.25}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_true(settings.near_distance == 0.0112);
    assert_true(settings.colors.space_known && settings.colors.space == SGS_SPACE_LINEAR &&
                settings.colors.white_point == 5.25);
    put("config.json", "{\"near_distance\": 0.2, \"options\": {\"train_space\": \"srgb\", "
                       "\"white\": 1.0}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_true(settings.near_distance == 0.2);
    assert_true(settings.colors.space_known && settings.colors.space == SGS_SPACE_SRGB &&
                settings.colors.white_point == 1);
    // Without the options: the defaults, and what the file of the model records.
    char path[1024];
    sgs_gaussians *model;
    sgs_model_write_options options = sgs_model_write_options_default();
    options.colors =
        (sgs_model_colors){.space_known = true, .space = SGS_SPACE_LINEAR, .white_point = 3};
    put_model("iteration_5000", 2);
    assert_int_equal(sgs_run_model_path(run, path, sizeof path, NULL), SGS_STATUS_OK);
    assert_int_equal(sgs_ply_read(path, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
    put("config.json", "{\"options\": {}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_int_equal(settings.iteration, 5000);
    assert_true(settings.near_distance == sgs_render_options_default().near_distance);
    assert_true(settings.colors.space_known && settings.colors.space == SGS_SPACE_LINEAR &&
                settings.colors.white_point == 3);
    put("config.json", "{\"options\": {\"train_space\": \"srgb\"}}");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_OK);
    assert_true(settings.colors.space == SGS_SPACE_SRGB && settings.colors.white_point == 0);
}

static void invalid_folders_are_named(void **state)
{
    (void)state;
    const struct {
        const char *config, *words;
    } cases[] = {{"{", "config.json: line 1"},
                 {"{\"options\": {\"filter\": \"box\"}}", "option filter"},
                 {"{\"options\": {\"filter\": 3}}", "option filter"},
                 {"{\"options\": {\"background\": [1, 2]}}", "option background"},
                 {"{\"near_distance\": 0}", "config.json: near_distance has an unknown value"},
                 {"{\"near_distance\": \"0.2\"}", "near_distance"},
                 {"{\"options\": {\"train_space\": \"aces\"}}", "option train_space"},
                 {"{\"options\": {\"train_space\": 1}}", "option train_space"},
                 {"{\"options\": {\"white\": -1}}", "option white"},
                 {"{\"options\": {\"white\": \"5\"}}", "option white"},
                 {"{\"options\": {\"compact_box\": 0}}", "option compact_box"},
                 {"{\"options\": {\"compact_box\": \"all\"}}", "option compact_box"}};
    sgs_run_settings settings;
    sgs_gaussians *model = NULL;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        put("config.json", cases[k].config);
        assert_int_equal(sgs_run_read(run, &model, &settings), SGS_STATUS_FORMAT);
        assert_non_null(strstr(sgs_last_error(), cases[k].words));
        assert_null(model);
    }
    char pipe[1024];
    snprintf(pipe, sizeof pipe, "%s/config.json", run);
    assert_int_equal(unlink(pipe), 0);
    assert_int_equal(mkfifo(pipe, 0600), 0);
    assert_int_equal(sgs_run_read(run, &model, &settings), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "config.json: is not a regular file"));
    assert_int_equal(sgs_run_read(temp_path(&folder, "nowhere"), &model, &settings), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "specify a PLY file or a run folder"));
    static char long_path[8192];
    memset(long_path, 'a', sizeof long_path - 1);
    assert_int_equal(sgs_run_read(long_path, &model, &settings), SGS_STATUS_LIMIT);
    assert_non_null(strstr(sgs_last_error(), "aaaa...: path of a run folder is too long"));
}

static void an_unreadable_config_is_named_with_the_reason(void **state)
{
    (void)state;
    sgs_run_settings settings;
    unlink(temp_path(&folder, "run/config.json"));
    file_put_unreadable(run, "config.json");
    assert_int_equal(sgs_run_read(run, NULL, &settings), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "config.json: cannot be opened: No such device"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_newest_model_is_read_with_its_settings),
        cmocka_unit_test(near_distance_and_colours_are_those_of_the_training),
        cmocka_unit_test(invalid_folders_are_named),
        cmocka_unit_test(an_unreadable_config_is_named_with_the_reason),
    };
    folder = temp_folder_make();
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    nftw(folder.path, tree_remove_entry, 16, FTW_DEPTH | FTW_PHYS);
    return failed;
}
