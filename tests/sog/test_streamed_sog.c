// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The environment of a SOG with levels of detail, after PlayCanvas' "The Streamed SOG Format".

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/model_bytes.h"

enum { COUNT = 40, ENVIRONMENT = 7 };

// Levels of 40 and 20 primitives, and an environment of another SH degree as a folder and as a ZIP
// file. Returns lod-meta.json as written.
static char *put_model(const temp_folder *folder)
{
    sgs_gaussians *model = model_random(COUNT, 0), *environment = model_random(ENVIRONMENT, 1);
    sgs_model_write_options options = sgs_model_write_options_default();
    size_t size;
    options.lod_levels = 2;
    assert_int_equal(sgs_model_write(temp_path(folder, "lod-meta.json"), model, &options, NULL),
                     SGS_STATUS_OK);
    options.antialiased = true;
    assert_int_equal(
        sgs_model_write(temp_path(folder, "env/meta.json"), environment, &options, NULL),
        SGS_STATUS_OK);
    assert_int_equal(sgs_model_write(temp_path(folder, "env.sog"), environment, &options, NULL),
                     SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(environment);
    return (char *)file_get(temp_path(folder, "lod-meta.json"), &size);
}

// The manifest with these members in front.
static void put_members(const temp_folder *folder, const char *text, const char *members)
{
    bytes changed = {.size = 0};
    put_text(&changed, "{%s%s", members, text + 1);
    file_put(temp_path(folder, "lod-meta.json"), changed.data, changed.size);
}

static sgs_gaussians *read_level(const char *path, int level, sgs_model_info *info)
{
    sgs_model_read_options options = sgs_model_read_options_default();
    sgs_gaussians *model;
    options.lod = level;
    if (sgs_model_read(path, &options, &model, info))
        fail_msg("%s", sgs_last_error());
    return model;
}

static void the_environment_belongs_to_every_level(void **state)
{
    (void)state;
    static const char *const members[] = {"\"environment\":\"env/meta.json\",",
                                          "\"environment\":\"env.sog\","};
    const temp_folder folder = temp_folder_make();
    char *text = put_model(&folder);
    sgs_model_info info, plain_info;
    sgs_gaussians *environment = read_level(temp_path(&folder, "env"), 0, &info);
    for (int level = 0; level < 2; ++level) {
        put_members(&folder, text, "");
        sgs_gaussians *plain = read_level(folder.path, level, &plain_info);
        assert_int_equal(plain->count, COUNT >> level);
        assert_false(plain_info.antialiased);
        for (int k = 0; k < 2; ++k) {
            put_members(&folder, text, members[k]);
            sgs_gaussians *model = read_level(folder.path, level, &info);
            assert_int_equal(model->count, plain->count + ENVIRONMENT);
            assert_int_equal(model->sh_degree, 1);
            assert_int_equal(info.lod_count, 2);
            assert_true(info.antialiased && info.file_bytes > plain_info.file_bytes);
            for (size_t i = 0; i < model->count; ++i)
                for (int p = 0; p < SGS_PARAM_COUNT; ++p)
                    assert_true(model_value(model, i, p) ==
                                (i < plain->count ? model_value(plain, i, p)
                                                  : model_value(environment, i - plain->count, p)));
            sgs_gaussians_destroy(model);
        }
        sgs_gaussians_destroy(plain);
    }
    sgs_gaussians_destroy(environment);
    free(text);
    tree_remove(&folder);
}

static void environments_are_checked(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    char *text = put_model(&folder);
    static const struct {
        const char *members, *message;
        sgs_status status;
    } cases[] = {
        {"\"environment\":5,", "lod-meta.json: 'environment' is missing or invalid",
         SGS_STATUS_FORMAT},
        {"\"environment\":\"../env/meta.json\",", "the name of 'environment' leaves the folder",
         SGS_STATUS_FORMAT},
        {"\"environment\":\"/env/meta.json\",", "the name of 'environment' leaves the folder",
         SGS_STATUS_FORMAT},
        {"\"environment\":\"none/meta.json\",", "none", SGS_STATUS_IO},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        put_members(&folder, text, cases[k].members);
        model_refused(folder.path, cases[k].status, cases[k].message, cases[k].members);
    }
    // Without an environment: as written, and by writers that leave its member.
    static const char *const none[] = {"", "\"environment\":null,", "\"environment\":\"\","};
    for (size_t k = 0; k < sizeof none / sizeof *none; ++k) {
        put_members(&folder, text, none[k]);
        sgs_gaussians *model = read_level(folder.path, 0, NULL);
        assert_int_equal(model->count, COUNT);
        sgs_gaussians_destroy(model);
    }
    assert_null(strstr(text, "environment"));
    free(text);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_environment_belongs_to_every_level),
        cmocka_unit_test(environments_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
