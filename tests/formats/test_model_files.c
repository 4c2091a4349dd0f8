// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Names and contents that select a format, and folders with levels of detail.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/files_support.h"
#include "support/model_support.h"
#include "support/scene_support.h"
#include "sparegs/model_file.h"

static void lod_levels_are_nested(void **state)
{
    (void)state;
    enum { COUNT = 9000 };
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(COUNT, 1), *levels[3];
    float *importance = malloc(COUNT * sizeof *importance);
    for (size_t i = 0; i < COUNT; ++i) // a long model: the tree is split
        importance[i] = (float)(i * 7919 % COUNT);
    sgs_model_write_options options = sgs_model_write_options_default();
    options.lod_levels = 3;
    options.importance = importance;
    options.palette_iterations = 1;
    char path[512];
    snprintf(path, sizeof path, "%s/lod-meta.json", folder.path);
    if (sgs_model_write(path, model, &options, NULL))
        fail_msg("%s", sgs_last_error());
    sgs_model_read_options read = sgs_model_read_options_default();
    for (read.lod = 0; read.lod < 3; ++read.lod) {
        sgs_model_info info;
        if (sgs_model_read(folder.path, &read, &levels[read.lod], &info))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(info.lod_count, 3);
        assert_int_equal(levels[read.lod]->count, COUNT >> read.lod);
    }
    // Every primitive of level 2 is one of the most important quarter; x identifies it.
    for (size_t j = 0; j < levels[2]->count; j += 50) {
        size_t nearest = 0;
        for (size_t i = 0; i < COUNT; ++i)
            if (fabsf(model_value(model, i, 0) - model_value(levels[2], j, 0)) <
                fabsf(model_value(model, nearest, 0) - model_value(levels[2], j, 0)))
                nearest = i;
        assert_true(importance[nearest] >= COUNT - COUNT / 4);
    }
    read.lod = 3;
    sgs_gaussians *none;
    assert_int_equal(sgs_model_read(folder.path, &read, &none, NULL), SGS_STATUS_INVALID_ARGUMENT);
    for (int k = 0; k < 3; ++k)
        sgs_gaussians_destroy(levels[k]);
    tree_remove(&folder);
    free(importance);
    sgs_gaussians_destroy(model);
}

static void names_and_contents_select_formats(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int format; // -1: none
    } cases[] = {{"a.ply", SGS_MODEL_PLY},
                 {"a/b.PLY", SGS_MODEL_PLY},
                 {"a.compressed.ply", SGS_MODEL_COMPRESSED_PLY},
                 {"a.splat", SGS_MODEL_SPLAT},
                 {"a.ksplat", SGS_MODEL_KSPLAT},
                 {"a.spz", SGS_MODEL_SPZ},
                 {"a.glb", SGS_MODEL_GLB},
                 {"a.sog", SGS_MODEL_SOG},
                 {"x/meta.json", SGS_MODEL_SOG},
                 {"x/lod-meta.json", SGS_MODEL_LOD_SOG},
                 {"a.usda", SGS_MODEL_USDA},
                 {"a.obj", -1},
                 {"transforms.json", -1},
                 {"ply", -1}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_model_format format = SGS_MODEL_FORMAT_COUNT;
        assert_int_equal(sgs_model_format_of_name(cases[k].name, &format), cases[k].format >= 0);
        assert_true(cases[k].format < 0 || (int)format == cases[k].format);
    }
    // A file with a wrong name is recognised.
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(5, 0), *back;
    sgs_model_info info;
    static const char *const names[] = {"a.ply", "a.compressed.ply", "a.spz", "a.glb", "a.sog"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        sgs_model_format format, found;
        assert_int_equal(sgs_model_write(temp_path(&folder, names[k]), model, NULL, NULL),
                         SGS_STATUS_OK);
        assert_int_equal(rename(temp_path(&folder, names[k]), temp_path(&folder, "model.bin")), 0);
        assert_true(sgs_model_format_of_name(names[k], &format));
        assert_true(sgs_model_format_detect(temp_path(&folder, "model.bin"), &found));
        assert_int_equal(found, format);
        assert_int_equal(sgs_model_read(temp_path(&folder, "model.bin"), NULL, &back, &info),
                         SGS_STATUS_OK);
        assert_int_equal(info.format, format);
        sgs_gaussians_destroy(back);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Half twins, a z-up layer, comments, strings and other prims.
static void usda_is_read(void **state)
{
    (void)state;
    static const char text[] =
        "#usda 1.0\n(\n  doc = \"\"\"a { string } = [\n\"\"\"\n  upAxis = \"Z\" # { \n)\n"
        "def Camera \"C\" { matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0) )\n }\n"
        "def Scope \"S\" (\n customData = { string image = \"}\" }\n)\n{\n"
        "def ParticleField3DGaussianSplat \"P\"\n{\n"
        "  point3h[] positionsh = [(9, 9, 9)]\n  point3f[] positions = [(1, 2, 3)]\n"
        "  quath[] orientationsh = [(1, 0, 0, 0)]\n  half3[] scalesh = [(1, 2, 4)]\n"
        "  half[] opacitiesh = [0.5]\n  point3h[] positionsh = [(8, 8, 8), (7, 7, 7)]\n"
        "  uniform int radiance:sphericalHarmonicsDegree = 0\n"
        "  float3[] radiance:sphericalHarmonicsCoefficients = [(0.1, 0.2, 3e-1)] (\n"
        "    elementSize = 1\n  )\n  def Mesh \"M\" { point3f[] positions = [(5, 5, 5)] }\n}\n}\n";
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model;
    file_put(temp_path(&folder, "a.usda"), text, strlen(text));
    if (sgs_model_read(temp_path(&folder, "a.usda"), NULL, &model, NULL))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(model->count, 1);
    // z up, y into the scene: x right, y down, z front is (x, -z, y).
    const double mean[] = {1, -3, 2}, scales[] = {0, log(2), log(4)}, colors[] = {0.1, 0.2, 0.3};
    for (int k = 0; k < 3; ++k) {
        assert_true(fabs((double)model_value(model, 0, k) - mean[k]) <= 1e-6);
        assert_true(fabs((double)model_value(model, 0, SGS_PARAM_SCALE + k) - scales[k]) <= 1e-6);
        assert_true(fabs((double)model_value(model, 0, SGS_PARAM_SH_DC + k) - colors[k]) <= 1e-6);
    }
    assert_true(fabs(model_opacity(model, 0) - 0.5) <= 1e-6);
    // The axes of the primitive are those of the file: a quarter turn about x.
    assert_true(fabs(fabs((double)model_value(model, 0, SGS_PARAM_ROTATION)) - sqrt(0.5)) <= 1e-6);
    assert_true(fabs(fabs((double)model_value(model, 0, SGS_PARAM_ROTATION + 1)) - sqrt(0.5)) <=
                1e-6);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Formats without the SH of the model: one warning that names the file, and none without a loss.
static void omitted_sh_are_reported(void **state)
{
    static const struct {
        const char *name;
        int kept; // degree
    } cases[] = {{"a.splat", 0}, {"a.ksplat", 2}, {"a.ply", 3}, {"a.spz", 3}};
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k)
        for (int degree = 0; degree <= 3; ++degree) {
            sgs_gaussians *model = model_random(5, degree), *back;
            const char *path = temp_path(&folder, cases[k].name);
            warnings_begin(state);
            assert_int_equal(sgs_model_write(path, model, NULL, NULL), SGS_STATUS_OK);
            sgs_warning_handler_set(NULL, NULL);
            if (degree > cases[k].kept) {
                assert_int_equal(strncmp(warnings, path, strlen(path)), 0);
                assert_holds(warnings, "omitted");
                assert_ptr_equal(strchr(warnings, '\n'), warnings + strlen(warnings) - 1);
            } else {
                assert_string_equal(warnings, "");
            }
            assert_int_equal(sgs_model_read(path, NULL, &back, NULL), SGS_STATUS_OK);
            assert_int_equal(back->sh_degree, degree < cases[k].kept ? degree : cases[k].kept);
            sgs_gaussians_destroy(back);
            sgs_gaussians_destroy(model);
        }
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(usda_is_read),
        cmocka_unit_test(lod_levels_are_nested),
        cmocka_unit_test(names_and_contents_select_formats),
        cmocka_unit_test(omitted_sh_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
