// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Names and contents that select a format, folders with levels of detail, and what formats record
// about a model.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "storage/model_folder.h"
#include "support/files_support.h"
#include "support/locale_support.h"
#include "support/model_support.h"
#include "support/scene_support.h"
#include "support/skip_support.h"
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

// Hash of the model at `path` at a level of detail.
static void read_hash(const char *path, int lod, char hash[17])
{
    sgs_model_read_options options = sgs_model_read_options_default();
    sgs_gaussians *model;
    options.lod = lod;
    if (sgs_model_read(path, &options, &model, NULL))
        fail_msg("%s", sgs_last_error());
    sgs_gaussians_hash(model, hash);
    sgs_gaussians_destroy(model);
}

static size_t size_of(const char *path)
{
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    return (size_t)info.st_size;
}

static void a_sog_folder_is_replaced_as_a_whole(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *first = model_random(400, 3), *second = model_random(400, 0);
    char path[512], before[17], after[17];
    for (size_t i = 0; i < second->count; ++i)
        *sgs_gaussians_at(second, i, SGS_PARAM_MEAN) *= 3; // other textures and other bounds
    snprintf(path, sizeof path, "%s/meta.json", folder.path);
    assert_int_equal(sgs_model_write(path, first, NULL, NULL), SGS_STATUS_OK);
    file_put(temp_path(&folder, "notes.txt"), "x", 1);
    read_hash(path, 0, before);
    const size_t files = temp_folder_count(&folder);
    // The textures fit, the manifest does not.
    assert_true(size_of(temp_path(&folder, "means_l.webp")) < 2000 && size_of(path) > 4000);
    files_limited(2000);
    const sgs_status status = sgs_model_write(path, second, NULL, NULL);
    files_unlimited();
    assert_int_equal(status, SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "/meta.json: cannot be written: "));
    assert_null(strstr(sgs_last_error(), ".tmp."));
    read_hash(path, 0, after);
    assert_string_equal(before, after);
    assert_int_equal(temp_folder_count(&folder), files);
    // Files of the earlier model go with it, others stay.
    assert_int_equal(sgs_model_write(path, second, NULL, NULL), SGS_STATUS_OK);
    read_hash(path, 0, before);
    assert_string_not_equal(before, after);
    assert_int_equal(temp_folder_count(&folder), files - 2); // shN_centroids, shN_labels
    assert_int_equal(size_of(temp_path(&folder, "notes.txt")), 1);
    // A rename fails after others have succeeded.
    assert_int_equal(mkdir(temp_path(&folder, "shN_labels.webp"), 0777), 0);
    assert_int_equal(sgs_model_write(path, first, NULL, NULL), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "/shN_labels.webp: is a folder and cannot be"));
    read_hash(path, 0, after);
    assert_string_equal(before, after);
    assert_int_equal(temp_folder_count(&folder), files - 1);
    sgs_gaussians_destroy(first);
    sgs_gaussians_destroy(second);
    tree_remove(&folder);
}

// Writers of one folder: threads, or processes with the same id in two containers.
static void writers_of_a_folder_have_their_own_stages(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *const names[] = {"meta.json", "a/texture"};
    sgsi_model_folder writers[2];
    uint8_t *bytes;
    size_t size;
    assert_int_equal(sgsi_model_folder_open(&writers[0], folder.path, names[0]), SGS_STATUS_OK);
    // The next name is that of another process.
    char other[512];
    snprintf(other, sizeof other, "%s", writers[0].stage);
    const size_t stem = strlen(other) - 6;
    snprintf(other + stem, sizeof other - stem, "%06lu", strtoul(other + stem, NULL, 10) + 1);
    assert_int_equal(mkdir(other, 0777), 0);
    assert_int_equal(sgsi_model_folder_open(&writers[1], folder.path, names[0]), SGS_STATUS_OK);
    assert_string_not_equal(writers[0].stage, writers[1].stage);
    assert_string_not_equal(other, writers[1].stage);
    for (int k = 0; k < 2; ++k)
        for (int w = 0; w < 2; ++w)
            assert_int_equal(sgsi_model_folder_put(&writers[w], names[k],
                                                   (const uint8_t *)(w ? "second" : "first"),
                                                   w ? 6 : 5),
                             SGS_STATUS_OK);
    for (int w = 0; w < 2; ++w) {
        assert_int_equal(sgsi_model_folder_commit(&writers[w]), SGS_STATUS_OK);
        sgsi_model_folder_close(&writers[w]);
        for (int k = 0; k < 2; ++k) {
            bytes = file_get(temp_path(&folder, names[k]), &size);
            assert_string_equal((const char *)bytes, w ? "second" : "first");
            free(bytes);
        }
    }
    assert_int_equal(rmdir(other), 0); // was not touched
    assert_int_equal(temp_folder_count(&folder), 2);
    tree_remove(&folder);
}

static bool stop_at_once(void *user, size_t done, size_t total)
{
    (void)user, (void)total;
    return done < 20;
}

static void levels_of_detail_are_replaced_as_a_whole(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *first = model_random(400, 1), *second = model_random(300, 1);
    sgs_model_write_options options = sgs_model_write_options_default();
    char path[512], before[2][17], after[17];
    snprintf(path, sizeof path, "%s/lod-meta.json", folder.path);
    options.lod_levels = 3;
    assert_int_equal(sgs_model_write(path, first, &options, NULL), SGS_STATUS_OK);
    file_put(temp_path(&folder, "1_0/notes.txt"), "x", 1);
    for (int level = 0; level < 2; ++level)
        read_hash(path, level, before[level]);
    const size_t files = temp_folder_count(&folder);
    for (int stopped = 0; stopped < 2; ++stopped) { // by a full disk, by the user in level 1
        options.progress = stopped ? stop_at_once : NULL;
        if (!stopped)
            files_limited(2000);
        const sgs_status status = sgs_model_write(path, second, &options, NULL);
        files_unlimited();
        assert_int_equal(status, stopped ? SGS_STATUS_CANCELLED : SGS_STATUS_IO);
        assert_true(!stopped || strstr(sgs_last_error(), ": writing was cancelled"));
        for (int level = 0; level < 2; ++level) {
            read_hash(path, level, after);
            assert_string_equal(before[level], after);
        }
        assert_int_equal(temp_folder_count(&folder), files);
    }
    // Units of the earlier model go with it, other files stay.
    options.progress = NULL;
    options.lod_levels = 1;
    assert_int_equal(sgs_model_write(path, second, &options, NULL), SGS_STATUS_OK);
    read_hash(path, 0, after);
    assert_string_not_equal(before[0], after);
    assert_int_equal(temp_folder_count(&folder), files - 1);
    assert_int_equal(access(temp_path(&folder, "2_0"), F_OK), -1);
    assert_int_equal(access(temp_path(&folder, "1_0/meta.json"), F_OK), -1);
    assert_int_equal(size_of(temp_path(&folder, "1_0/notes.txt")), 1);
    sgs_gaussians_destroy(first);
    sgs_gaussians_destroy(second);
    tree_remove(&folder);
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
                 {"x/META.JSON", -1}, // the folder of a model has these names
                 {"room-lod-meta.json", -1},
                 {"room-meta.json", -1},
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
        // So is one with the name of a format that has no signature, unless it is gzip data.
        assert_int_equal(rename(temp_path(&folder, "model.bin"), temp_path(&folder, "model.splat")),
                         0);
        assert_true(sgs_model_format_detect(temp_path(&folder, "model.splat"), &found));
        assert_int_equal(found, format == SGS_MODEL_SPZ ? SGS_MODEL_SPLAT : format);
    }
    // Pages of this library are known by their mark, not by the document type of every page.
    sgs_model_format page;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.html"), model, NULL, NULL),
                     SGS_STATUS_OK);
    assert_true(sgs_model_format_detect(temp_path(&folder, "a.html"), &page));
    assert_int_equal(page, SGS_MODEL_HTML);
    model_refused(temp_path(&folder, "a.html"), SGS_STATUS_UNSUPPORTED,
                  "is a page that shows a model and cannot be read", "page");
    static const char other[] = "<!doctype html>\n<html lang=\"en\"><title>Notes</title>";
    static const char *const pages[] = {"other.html", "other.bin"};
    for (size_t k = 0; k < 2; ++k) {
        file_put(temp_path(&folder, pages[k]), other, sizeof other - 1);
        assert_false(sgs_model_format_detect(temp_path(&folder, pages[k]), &page));
        model_refused(temp_path(&folder, pages[k]), SGS_STATUS_UNSUPPORTED,
                      "is not a model in a known format", pages[k]);
    }
    assert_int_equal(mkfifo(temp_path(&folder, "a.pipe"), 0600), 0);
    model_refused(temp_path(&folder, "a.pipe"), SGS_STATUS_IO, "is not a regular file", "pipe");
    // The readers of a folder look for its file by name.
    static const char meta[] = "{\"means\":{\"files\":[\"means_l.webp\"]}}",
                      lod[] = "{\"lodLevels\":1}";
    file_put(temp_path(&folder, "a-meta.json"), meta, sizeof meta - 1);
    model_refused(temp_path(&folder, "a-meta.json"), SGS_STATUS_UNSUPPORTED,
                  "is the meta.json of a SOG model; give it this name", "renamed");
    file_put(temp_path(&folder, "meta.json"), lod, sizeof lod - 1);
    model_refused(temp_path(&folder, "meta.json"), SGS_STATUS_UNSUPPORTED,
                  "is the lod-meta.json of a SOG model", "renamed");
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Half-precision variants, a z-up layer, comments, strings and other prims.
static void usda_is_read(void **state)
{
    (void)state;
    static const char text[] =
        "#usda 1.0\n(\n  doc = \"\"\"a { string } = [\n\"\"\"\n  upAxis = \"Z\" # { \n)\n"
        "def Camera \"C\" { matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0) )\n }\n"
        "def Scope \"S\" (\n customData = { string image = \"}\" }\n)\n{\n"
        "asset a = @./it's {.png@ // it's {\nasset b = @@@a@{@@@ /* it's\n{ */\n"
        "rel r = </S/ParticleField3DGaussianSplat>\ndef Scope \"R\" {\n}\n"
        "matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )\n"
        "double3 xformOp:translate = (0, -0.0, 0)\ndouble xformOp:rotateX:turn = 0\n"
        "float3 xformOp:scale = (1, 1, 1)\nquatf xformOp:orient = (1, 0, 0, 0)\n"
        "def ParticleField3DGaussianSplat \"P\"\n{\n"
        "  point3h[] positionsh = [(9, 9, 9)]\n  point3f[] positions = [(1, 2, 3)]\n"
        "  quath[] orientationsh = [(1, 0, 0, 0)]\n  half3[] scalesh = [(1, 2, 4)]\n"
        "  half[] opacitiesh = [0.5]\n  point3h[] positionsh = [(8, 8, 8), (7, 7, 7)]\n"
        "  uniform int radiance:sphericalHarmonicsDegree = 0\n"
        "  float3[] radiance:sphericalHarmonicsCoefficients = [(0.1, 0.2, 3e-1)] (\n"
        "    elementSize = 1\n  )\n  def Mesh \"M\" { point3f[] positions = [(5, 5, 5)] }\n}\n"
        "def Camera \"D\" { double xformOp:rotateX = 90\n}\n}\n"
        "def Camera \"E\" { double xformOp:rotateX = 90\n}\n";
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

static void values_that_are_no_numbers_are_dropped(void **state)
{
    (void)state;
    static const char *const changes[][2] = {{"[(1, 2, 3)]", "[(1, nan, 3)]"},
                                             {"[(1, 0, 0, 0)]", "[(1, 0, 0, nan)]"},
                                             {"[(1, 2, 4)]", "[(1, 2, -4)]"},
                                             {"[0.5]", "[nan]"}};
    static const char text[] =
        "#usda 1.0\ndef ParticleField3DGaussianSplat \"P\"\n{\n"
        "point3f[] positions = [(1, 2, 3)]\nquatf[] orientations = [(1, 0, 0, 0)]\n"
        "float3[] scales = [(1, 2, 4)]\nfloat[] opacities = [0.5]\n"
        "uniform int radiance:sphericalHarmonicsDegree = 0\n"
        "float3[] radiance:sphericalHarmonicsCoefficients = [(0.1, 0.2, 0.3)]\n}\n";
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        sgs_gaussians *model;
        sgs_model_info info;
        const char *at = strstr(text, changes[k][0]), *rest = at + strlen(changes[k][0]);
        char changed[1024];
        snprintf(changed, sizeof changed, "%.*s%s%s", (int)(at - text), text, changes[k][1], rest);
        file_put(temp_path(&folder, "a.usda"), changed, strlen(changed));
        if (sgs_model_read(temp_path(&folder, "a.usda"), NULL, &model, &info))
            fail_msg("%s", sgs_last_error());
        if (model->count || info.dropped != 1)
            fail_msg("%s was kept", changes[k][1]);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

static void usda_is_written_in_any_language(void **state)
{
    (void)state;
    if (!decimal_comma_set())
        skip_because("the system cannot make a locale");
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(3, 1), *back;
    const sgs_status status = sgs_model_write(temp_path(&folder, "a.usda"), model, NULL, NULL);
    decimal_comma_unset();
    assert_int_equal(status, SGS_STATUS_OK);
    if (sgs_model_read(temp_path(&folder, "a.usda"), NULL, &back, NULL))
        fail_msg("%s", sgs_last_error());
    for (size_t i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            assert_true(model_value(back, i, k) == model_value(model, i, k));
    sgs_gaussians_destroy(back);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void refuses(const char *path, const sgs_gaussians *model,
                    const sgs_model_write_options *options, const char *words)
{
    assert_int_equal(sgs_model_write(path, model, options, NULL), SGS_STATUS_INVALID_ARGUMENT);
    assert_holds(sgs_last_error(), words);
    assert_int_equal(access(path, F_OK), -1);
}

// One value that is not finite would take other primitives of a chunk or the whole file with it.
static void only_ply_holds_values_that_are_not_finite(void **state)
{
    (void)state;
    static const char *const names[] = {
        "a.compressed.ply", "a.splat", "a.spz", "a.ksplat", "a.glb", "a.sog", "a.usda", "a.html"};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(20, 1), *back;
    const sgs_model_camera *const no_cameras = NULL;
    sgs_model_write_options options = sgs_model_write_options_default();
    sgs_model_write_options tilted = sgs_model_write_options_default();
    tilted.up[1] = NAN;
    options.cameras = no_cameras;
    options.camera_count = 2;
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        const char *path = temp_path(&folder, names[k]);
        static const int params[] = {SGS_PARAM_MEAN, SGS_PARAM_SCALE, SGS_PARAM_OPACITY,
                                     SGS_PARAM_SH_REST + 8};
        for (size_t p = 0; p < 4; ++p) {
            float *value = sgs_gaussians_at(model, 7, params[p]);
            const float before = *value;
            *value = NAN;
            refuses(path, model, NULL, "primitive 7 has a parameter that is not finite");
            *value = before;
        }
        refuses(path, model, &options, "cameras is NULL");
        refuses(path, model, &tilted, "up is not finite");
        *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = INFINITY; // opaque
        assert_int_equal(sgs_model_write(path, model, NULL, NULL), SGS_STATUS_OK);
        unlink(path);
        sgs_gaussians *linear = model_random(20, 1);
        sgs_gaussians_linearize_opacity(linear);
        *sgs_gaussians_at(linear, 7, SGS_PARAM_OPACITY) = INFINITY; // no opacity
        refuses(path, linear, NULL, "primitive 7 has a parameter that is not finite");
        sgs_gaussians_destroy(linear);
    }
    *sgs_gaussians_at(model, 7, SGS_PARAM_MEAN) = NAN;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.ply"), model, NULL, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.ply"), NULL, &back, NULL), SGS_STATUS_OK);
    assert_int_equal(back->count, 19);
    sgs_gaussians_destroy(back);
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

// The first place of a text in a file, from the offset on; fails without one.
static size_t find_text(const unsigned char *bytes, size_t size, const char *text)
{
    const unsigned char *at = memmem(bytes, size, text, strlen(text));
    if (!at)
        fail_msg("the file has no '%s'", text);
    return (size_t)(at - bytes);
}

static sgs_model_colors read_colors(const char *path)
{
    sgs_model_colors colors, probed;
    sgs_gaussians *model;
    sgs_model_info info;
    if (sgs_model_read(path, NULL, &model, &info) || sgs_model_read_colors(path, &probed))
        fail_msg("%s", sgs_last_error());
    sgs_gaussians_destroy(model);
    colors = info.colors;
    assert_int_equal(probed.space_known, colors.space_known);
    assert_int_equal(probed.space, colors.space);
    assert_true(probed.white_point == colors.white_point);
    return colors;
}

// The words in the files are those of the formats' specifications.
static void colors_are_recorded(void **state)
{
    (void)state;
    static const struct {
        const char *name, *words[2]; // by sgs_space; NULL: not recorded
        const char *white;
    } cases[] = {
        {"a.ply",
         {"comment ColorSpace: srgb\n", "comment ColorSpace: linear\n"},
         "WhitePoint: 5.25\n"},
        {"a.compressed.ply",
         {"comment ColorSpace: srgb\n", "comment ColorSpace: linear\n"},
         "WhitePoint: 5.25\n"},
        {"a.usda",
         {"uniform token colorSpace:name = \"srgb_rec709_scene\"\n",
          "uniform token colorSpace:name = \"lin_rec709_scene\"\n"},
         "double sparegs:whitePoint = 5.25\n"},
        {"a.glb",
         {"\"colorSpace\":\"srgb_rec709_display\"", "\"colorSpace\":\"lin_rec709_display\""},
         "\"sparegs:whitePoint\":5.25"},
        {"a.spz", {NULL, NULL}, NULL},
        {"a.splat", {NULL, NULL}, NULL},
        {"a.ksplat", {NULL, NULL}, NULL},
        {"a.sog", {NULL, NULL}, NULL},
    };
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(5, 1);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k)
        for (int white = 0; white < 2; ++white)
            for (int space = 0; space < 2; ++space) {
                const char *path = temp_path(&folder, cases[k].name);
                sgs_model_write_options options = sgs_model_write_options_default();
                options.colors = (sgs_model_colors){.space = (sgs_space)space,
                                                    .white_point = white ? 5.25 : 0.0};
                assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
                sgs_model_format format;
                assert_true(sgs_model_format_of_name(path, &format));
                const bool marks = cases[k].words[0];
                assert_int_equal(sgs_model_format_marks_colors(format), marks);
                const sgs_model_colors back = read_colors(path);
                const bool silent = strstr(path, ".ply") && !space && !white;
                assert_int_equal(back.space_known, marks && !silent);
                assert_int_equal(back.space, marks ? space : 0);
                assert_true(back.white_point == (marks && white ? 5.25 : 0.0));
                uint8_t *bytes;
                size_t size;
                assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
                if (marks && !silent)
                    find_text(bytes, size, cases[k].words[space]);
                if (marks && white)
                    find_text(bytes, size, cases[k].white);
                assert_true(!silent || !memmem(bytes, size, "comment", 7));
                sgsi_free(bytes);
            }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// COLOR_0 is linear light: a value of 0.5 is 0.5 if the colours are, else 0.2140 (IEC 61966-2-1).
static void glb_fallback_colors_are_linear(void **state)
{
    (void)state;
    static const int expected[] = {55, 128};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(1, 0);
    float params[SGS_PARAM_COUNT];
    sgs_gaussians_get(model, 0, params);
    memset(params + SGS_PARAM_SH_DC, 0, 3 * sizeof *params); // colour 0.5
    sgs_gaussians_set(model, 0, params);
    for (int space = 0; space < 2; ++space) {
        sgs_model_write_options options = sgs_model_write_options_default();
        options.colors.space = (sgs_space)space;
        uint8_t *bytes;
        size_t size;
        assert_int_equal(sgs_model_write(temp_path(&folder, "a.glb"), model, &options, NULL),
                         SGS_STATUS_OK);
        assert_int_equal(sgsi_file_read(temp_path(&folder, "a.glb"), 0, &bytes, &size),
                         SGS_STATUS_OK);
        for (size_t c = 0; c < 3; ++c) // the last attribute of the file
            assert_int_equal(bytes[size - 4 + c], expected[space]);
        sgsi_free(bytes);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// The text between the parent of the splats and their attributes, with the mark of the splats.
#define USD_MARK "uniform token colorSpace:name = \"lin_rec709_scene\"\n"
#define USD_SPLATS "    def ParticleField3DGaussianSplat \"Splats\""
#define USD_HEAD                                                                                   \
    USD_SPLATS                                                                                     \
    " (\n        prepend apiSchemas = [\"ColorSpaceAPI\"]\n    )\n    {\n        " USD_MARK

// Marks of other programs: their words, other primaries, marks of other prims, and values that mean
// nothing.
static void foreign_colors_are_read(void **state)
{
    static const struct {
        const char *name, *from, *to;
        bool named;
        int space;
        double white;
        const char *warning;
    } cases[] = {
        {"a.ply", "ColorSpace: linear", "COLORSPACE: LINEAR", true, 1, 5.25, NULL},
        {"a.ply", "ColorSpace: linear", "ColorSpace: purple", false, 0, 5.25, NULL},
        {"a.ply", "WhitePoint: 5.25", "WhitePoint: -5.2", true, 1, 0, NULL},
        {"a.ply", "WhitePoint: 5.25", "WhitePoint: nan ", true, 1, 0, NULL},
        {"a.ply", "WhitePoint: 5.25", "WhitePoint: 1e999", true, 1, 0, NULL},
        {"a.ply", "WhitePoint: 5.25", "WhitePoint: wide", true, 1, 0, NULL},
        {"a.usda", "lin_rec709_scene", "lin_ap1_scene", true, 1, 5.25,
         "'lin_ap1_scene' is read as"},
        {"a.usda", "lin_rec709_scene", "g22_rec709_scene", true, 0, 5.25, "is read as sRGB"},
        {"a.usda", "lin_rec709_scene", "lin_rec709_display", true, 1, 5.25, NULL},
        {"a.usda", "lin_rec709_scene", "srgb_rec709_display", true, 0, 5.25, NULL}, // of 3dgrut
        {"a.usda", "lin_rec709_scene", "srgb_rec709_scene", true, 0, 5.25, NULL},
        {"a.glb", "lin_rec709_display", "lin\\np3d65_display", true, 0, 5.25,
         "'lin?p3d65_display'"},
        {"a.glb", "lin_rec709_display", "lin_p3d65_display0", true, 1, 5.25, "is read as linear"},
        {"a.glb", "\"lin_rec709_display\"", "[3, 4,    5,    6  ]", false, 0, 5.25, NULL},
        {"a.glb", "Point\":5.25", "Point\":-5.2", true, 1, 0, NULL},
        {"a.usda", "colorSpace:name", "colorSpace:none", false, 0, 5.25, NULL},
        {"a.usda", "\"lin_rec709_scene\"", "7", false, 0, 5.25, NULL},
        {"a.usda", "= 5.25", "= \"x\"", true, 1, 0, NULL},
        {"a.usda", USD_HEAD, USD_MARK USD_SPLATS " {", true, 1, 5.25, NULL}, // inherited
        {"a.usda", USD_SPLATS, "    uniform token colorSpace:name = \"srgb\"\n" USD_SPLATS, true, 1,
         5.25, NULL}, // its own is nearer
        {"a.usda", USD_HEAD, "    def Scope \"A\" {\n" USD_MARK "}\n" USD_SPLATS " {", false, 0,
         5.25, NULL}, // of a sibling
        {"a.usda", USD_HEAD, USD_SPLATS " {\n        def Scope \"A\" {\n" USD_MARK "        }\n",
         false, 0, 5.25, NULL}, // of a child
    };
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(5, 1);
    sgs_model_write_options options = sgs_model_write_options_default();
    options.colors = (sgs_model_colors){.space = SGS_SPACE_LINEAR, .white_point = 5.25};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const char *path = temp_path(&folder, cases[k].name);
        uint8_t *bytes;
        size_t size;
        assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
        assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
        const size_t at = find_text(bytes, size, cases[k].from), from = strlen(cases[k].from),
                     to = strlen(cases[k].to);
        unsigned char *changed = malloc(size + to);
        assert_non_null(changed);
        memcpy(changed, bytes, at);
        memcpy(changed + at, cases[k].to, to);
        memcpy(changed + at + to, bytes + at + from, size - at - from);
        file_put(path, changed, size - from + to);
        warnings_begin(state);
        const sgs_model_colors colors = read_colors(path);
        sgs_warning_handler_set(NULL, NULL);
        if (colors.space_known != cases[k].named || (int)colors.space != cases[k].space ||
            colors.white_point != cases[k].white)
            fail_msg("%s: named %d, space %d, white point %g", cases[k].to, colors.space_known,
                     colors.space, colors.white_point);
        if (cases[k].warning) // one, and none by sgs_model_read_colors
            assert_ptr_equal(strchr(warnings, '\n'), warnings + strlen(warnings) - 1);
        if (cases[k].warning)
            assert_holds(warnings, cases[k].warning);
        else
            assert_string_equal(warnings, "");
        free(changed);
        sgsi_free(bytes);
    }
    // A file that is no model has no colours.
    sgs_model_colors none = {.space_known = true, .white_point = 2};
    file_put(temp_path(&folder, "a.usda"), "#usda 1.0\n{", 11);
    assert_int_equal(sgs_model_read_colors(temp_path(&folder, "a.usda"), &none), SGS_STATUS_FORMAT);
    assert_false(none.space_known || none.white_point > 0);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// KHR_gaussian_splatting: programs that do not know a kernel read its splats as ellipses.
static void other_kernels_are_reported(void **state)
{
    static const char *const cases[][3] = {
        {"\"ellipse\"", "\"surflet\"",
         "a.glb: kernel 'surflet' is unknown; its splats are read as"},
        {"\"ellipse\"", "\"\\u0007a\"", "a.glb: kernel '?a' is unknown"},
        {"\"ellipse\"", "\"ellipse\"", NULL},
        {"\"kernel\"", "\"kernal\"", NULL},
    };
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.glb");
    sgs_gaussians *model = model_random(5, 1), *back;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        uint8_t *bytes;
        size_t size;
        sgs_model_colors colors;
        assert_int_equal(sgs_model_write(path, model, NULL, NULL), SGS_STATUS_OK);
        assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
        memcpy(bytes + find_text(bytes, size, cases[k][0]), cases[k][1], strlen(cases[k][1]));
        file_put(path, bytes, size);
        sgsi_free(bytes);
        warnings_begin(state);
        assert_int_equal(sgs_model_read_colors(path, &colors), SGS_STATUS_OK);
        assert_string_equal(warnings, "");
        if (sgs_model_read(path, NULL, &back, NULL))
            fail_msg("%s", sgs_last_error());
        sgs_warning_handler_set(NULL, NULL);
        if (cases[k][2])
            assert_holds(warnings, cases[k][2]);
        else
            assert_string_equal(warnings, "");
        for (size_t i = 0; i < 5; ++i)
            assert_true(model_value(back, i, 0) == model_value(model, i, 0));
        sgs_gaussians_destroy(back);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Of a PLY, the header alone decides, here of a file that holds no model.
static void primitives_are_counted(void **state)
{
    (void)state;
    static const char *const names[] = {"a.ply", "a.compressed.ply", "a.splat",
                                        "a.spz", "a.ksplat",         "a.glb",
                                        "a.sog", "a.usda",           "meta.json"};
    static const char header[] = "ply\nformat binary_little_endian 1.0\nelement chunk 2\nproperty "
                                 "float min\nelement vertex 3\nproperty float x\nend_header\n";
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(300, 1);
    size_t count;
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        const char *path = temp_path(&folder, names[k]);
        if (sgs_model_write(path, model, NULL, NULL) || sgs_model_read_count(path, &count))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(count, 300);
    }
    unsigned char bytes[sizeof header + 19] = {0};
    memcpy(bytes, header, sizeof header - 1);
    const char *path = temp_path(&folder, "b.ply");
    file_put(path, bytes, sizeof header - 1 + 20);
    assert_int_equal(sgs_model_read_count(path, &count), SGS_STATUS_OK);
    assert_int_equal(count, 3);
    file_put(path, bytes, sizeof header - 1 + 19);
    assert_int_equal(sgs_model_read_count(path, &count), SGS_STATUS_FORMAT);
    assert_int_equal(count, 0);
    assert_non_null(strstr(sgs_last_error(), "b.ply"));
    assert_int_equal(sgs_model_read_count(temp_path(&folder, "c.ply"), &count), SGS_STATUS_IO);
    sgs_gaussians_destroy(model);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(usda_is_read),
        cmocka_unit_test(values_that_are_no_numbers_are_dropped),
        cmocka_unit_test(usda_is_written_in_any_language),
        cmocka_unit_test(lod_levels_are_nested),
        cmocka_unit_test(a_sog_folder_is_replaced_as_a_whole),
        cmocka_unit_test(writers_of_a_folder_have_their_own_stages),
        cmocka_unit_test(levels_of_detail_are_replaced_as_a_whole),
        cmocka_unit_test(names_and_contents_select_formats),
        cmocka_unit_test(only_ply_holds_values_that_are_not_finite),
        cmocka_unit_test(omitted_sh_are_reported),
        cmocka_unit_test(colors_are_recorded),
        cmocka_unit_test(glb_fallback_colors_are_linear),
        cmocka_unit_test(foreign_colors_are_read),
        cmocka_unit_test(other_kernels_are_reported),
        cmocka_unit_test(primitives_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
