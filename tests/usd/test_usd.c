// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reading OpenUSD: several prims, transforms, the fallbacks of the schema, packages. Expected
// values follow from the documentation of UsdGeomXformable and the ParticleField schemas.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/files_support.h"
#include "support/model_support.h"
#include "support/scene_support.h"
#include "support/usdz_bytes.h"
#include "sparegs/model_file.h"

#define SPLATS "def ParticleField3DGaussianSplat \"P\""
#define POSITIONS "point3f[] positions = [(1, 2, 3)]\n"
#define ORIENTATIONS "quatf[] orientations = [(0.5, 0.1, 0.7, -0.3)]\n"
#define SCALES "float3[] scales = [(1, 2, 4)]\n"
#define OPACITIES "float[] opacities = [0.25]\n"
#define SH                                                                                         \
    "uniform int radiance:sphericalHarmonicsDegree = 1\n"                                          \
    "float3[] radiance:sphericalHarmonicsCoefficients = [(0, 0, 0), (-0.8, 0, 0), (0, 0, 0), "     \
    "(-0.6, 0, 0)]\n" // red grows towards (0.6, 0.8, 0)
#define ALL POSITIONS ORIENTATIONS SCALES OPACITIES SH

static const double point[3] = {1, 2, 3}, brightest[3] = {0.6, 0.8, 0};

static sgs_gaussians *read_text(const temp_folder *folder, const char *text, sgs_model_info *info)
{
    sgs_gaussians *model;
    warnings[0] = 0;
    file_put(temp_path(folder, "a.usda"), text, strlen(text));
    if (sgs_model_read(temp_path(folder, "a.usda"), NULL, &model, info))
        fail_msg("%s\n%s", sgs_last_error(), text);
    return model;
}

typedef struct placement {
    const char *above,
        *inside; // attributes of the prim above the splats, and of that of the splats
    double linear[3][3], moved[3]; // x -> linear x + moved
} placement;

#define IDENTITY                                                                                   \
    {                                                                                              \
        {1, 0, 0}, {0, 1, 0},                                                                      \
        {                                                                                          \
            0, 0, 1                                                                                \
        }                                                                                          \
    }
#define ABOUT_Z                                                                                    \
    {                                                                                              \
        {0, -1, 0}, {1, 0, 0},                                                                     \
        {                                                                                          \
            0, 0, 1                                                                                \
        }                                                                                          \
    } // a quarter turn: x to y
#define ORDER(list) "uniform token[] xformOpOrder = [" list "]\n"

static const placement placements[] = {
    {"double xformOp:rotateX = 90\n" ORDER("\"xformOp:rotateX\""),
     "",
     {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}},
     {0}},
    {"",
     "float xformOp:rotateY = 90\n" ORDER("\"xformOp:rotateY\""),
     {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}},
     {0}},
    {"", "half xformOp:rotateZ = 90\n" ORDER("'xformOp:rotateZ'"), ABOUT_Z, {0}},
    // x first, then z
    {"float3 xformOp:rotateXYZ = (90, 0, 90)\n" ORDER("\"xformOp:rotateXYZ\""),
     "",
     {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}},
     {0}},
    // z first, then x
    {"float3 xformOp:rotateZYX = (90, 0, 90)\n" ORDER("\"xformOp:rotateZYX\""),
     "",
     {{0, -1, 0}, {0, 0, -1}, {1, 0, 0}},
     {0}},
    {"",
     "quatd xformOp:orient = (0.7071067811865476, 0, 0, 0.7071067811865476)\n" ORDER(
         "\"xformOp:orient\""),
     ABOUT_Z,
     {0}},
    // rows are the images of the axes; the last one is the translation
    {"matrix4d xformOp:transform = ( (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1) "
     ")\n" ORDER("\"xformOp:transform\""),
     "",
     ABOUT_Z,
     {5, 6, 7}},
    // the last operation acts first
    {"double3 xformOp:translate = (10, 0, 0)\nfloat xformOp:rotateZ = 90\n"
     "float3 xformOp:scale = (2, 2, 2)\n" ORDER(
         "\"xformOp:translate\", \"xformOp:rotateZ\", \"xformOp:scale\""),
     "",
     {{0, -2, 0}, {2, 0, 0}, {0, 0, 2}},
     {10, 0, 0}},
    {ORDER("\"xformOp:rotateZ\", \"xformOp:translate\"") "double3 xformOp:translate = (10, 0, "
                                                         "0)\nfloat xformOp:rotateZ = 90\n",
     "",
     ABOUT_Z,
     {0, 10, 0}},
    // a turn about the pivot (1, 1, 0)
    {"",
     "float3 xformOp:translate:pivot = (1, 1, 0)\nfloat xformOp:rotateZ:turn = 90\n" ORDER(
         "\"xformOp:translate:pivot\", \"xformOp:rotateZ:turn\", "
         "\"!invert!xformOp:translate:pivot\""),
     ABOUT_Z,
     {2, 0, 0}},
    {"", "float xformOp:rotateZ = -90\n" ORDER("\"!invert!xformOp:rotateZ\""), ABOUT_Z, {0}},
    {"matrix4d xformOp:transform = ( (0, -4, 0, 0), (4, 0, 0, 0), (0, 0, 4, 0), (4, 8, 12, 1) "
     ")\n" ORDER("\"!invert!xformOp:transform\""),
     "",
     {{0, -0.25, 0}, {0.25, 0, 0}, {0, 0, 0.25}},
     {2, -1, -3}},
    // that of the splats acts before the one above
    {"double3 xformOp:translate = (0, 0, 5)\n" ORDER("\"xformOp:translate\""),
     "float3 xformOp:scale = (2, 2, 2)\n" ORDER("\"xformOp:scale\""),
     {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}},
     {0, 0, 5}},
    {"float3 xformOp:scale = (2, 2, 2)\n" ORDER("\"xformOp:scale\""),
     "double3 xformOp:translate = (0, 0, 5)\n" ORDER("\"xformOp:translate\""),
     {{2, 0, 0}, {0, 2, 0}, {0, 0, 2}},
     {0, 0, 10}},
    {"float3 xformOp:scale = (2, 3, 4)\n" ORDER("\"xformOp:scale\""),
     "double3 xformOp:translate = (0, 0, 5)\nfloat xformOp:rotateZ = 7\n" ORDER(
         "\"xformOp:rotateZ\", \"!resetXformStack!\", \"xformOp:translate\""),
     IDENTITY,
     {0, 0, 5}},
    // two scales whose product is uniform
    {"float3 xformOp:scale = (1, 2, 4)\nfloat3 xformOp:scale:b = (4, 2, 1)\n" ORDER(
         "\"xformOp:scale\", \"xformOp:scale:b\""),
     "",
     {{4, 0, 0}, {0, 4, 0}, {0, 0, 4}},
     {0}},
    // scales of the axes of the splats, then also with a turn and a mirror
    {"",
     "float3 xformOp:scale = (2, 2, 1)\n" ORDER("\"xformOp:scale\""),
     {{2, 0, 0}, {0, 2, 0}, {0, 0, 1}},
     {0}},
    {"double3 xformOp:translate = (10, 0, 0)\nfloat xformOp:rotateZ = 90\n"
     "float3 xformOp:scale = (1, 2, -4)\n" ORDER(
         "\"xformOp:translate\", \"xformOp:rotateZ\", \"xformOp:scale\""),
     "",
     {{0, -2, 0}, {1, 0, 0}, {0, 0, -4}},
     {10, 0, 0}},
    // a turn before the scale; a shear
    {"float3 xformOp:scale = (1, 2, 4)\n" ORDER("\"xformOp:scale\""),
     "float xformOp:rotateZ = 30\n" ORDER("\"xformOp:rotateZ\""),
     {{0.8660254037844386, -0.5, 0}, {1, 1.7320508075688772, 0}, {0, 0, 4}},
     {0}},
    {"matrix4d xformOp:transform = ((1, 0, 0, 0), (0.1, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, "
     "1))\n" ORDER("\"xformOp:transform\""),
     "",
     {{1, 0.1, 0}, {0, 1, 0}, {0, 0, 1}},
     {0}},
    {"float xformOp:translateX = 3\ndouble xformOp:scaleY = -1\n" ORDER(
         "\"xformOp:translateX\", \"xformOp:scaleY\""),
     "",
     {{1, 0, 0}, {0, -1, 0}, {0, 0, 1}},
     {3, 0, 0}}, // a mirror
    // without effect: not listed, without attribute, without value
    {"float xformOp:rotateX = 90\n", "", IDENTITY, {0}},
    {"float xformOp:rotateX.timeSamples = { 0: 90 }\n", "", IDENTITY, {0}},
    {"float xformOp:rotateX = 90\nfloat xformOp:rotateY = None\n" ORDER(
         "\"xformOp:rotateY\", \"xformOp:rotateZ\""),
     "",
     IDENTITY,
     {0}},
    {"float xformOp:rotateX = 90\nuniform token[] xformOpOrder = None\n", "", IDENTITY, {0}},
    {"custom string note = \"a\" (\n customData = { float xformOp:rotateX = 9 }\n)\n"
     "float xformOp:rotateX = 0 (\n doc = \"b\"\n)\n" ORDER("\"xformOp:rotateX\""),
     "",
     IDENTITY,
     {0}},
};

// The rotation of the polar decomposition by Higham's iteration, Q <- (Q + Q^-T) / 2.
static void rotation_of(const double linear[3][3], double q[3][3])
{
    memcpy(q, linear, 9 * sizeof **q);
    for (int n = 0; n < 50; ++n) {
        double cofactors[3][3], volume = 0;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                cofactors[i][j] = q[(i + 1) % 3][(j + 1) % 3] * q[(i + 2) % 3][(j + 2) % 3] -
                                  q[(i + 1) % 3][(j + 2) % 3] * q[(i + 2) % 3][(j + 1) % 3];
        for (int j = 0; j < 3; ++j)
            volume += q[0][j] * cofactors[0][j];
        for (int k = 0; k < 9; ++k)
            q[k / 3][k % 3] = (q[k / 3][k % 3] + cofactors[k / 3][k % 3] / volume) / 2;
    }
}

static void transforms_are_applied(void **state)
{
    (void)state;
    static const double flip[3] = {1, -1, -1}, q[4] = {0.5, 0.1, 0.7, -0.3}, sizes[3] = {1, 2, 4};
    const temp_folder folder = temp_folder_make();
    double before[3][3];
    model_covariance(q, sizes, before);
    for (size_t n = 0; n < 2 * sizeof placements / sizeof *placements; ++n) {
        const placement *p = &placements[n / 2];
        char text[4096];
        snprintf(text, sizeof text,
                 n % 2 ? "#usda 1.0\ndef Xform \"W\"\n{\n%s" SPLATS "\n{\n%s" ALL "}\n}\n"
                       : "#usda 1.0\ndef Xform \"W\"\n{\n" SPLATS "\n{\n" ALL "%2$s}\n%1$s}\n",
                 p->above, p->inside); // also after the children and the arrays
        sgs_gaussians *model = read_text(&folder, text, NULL);
        assert_int_equal(model->count, 1);
        double error = 0, after[3][3], rotation[4], scales[3], turn[3][3];
        rotation_of(p->linear, turn);
        for (int k = 0; k < 4; ++k)
            rotation[k] = (double)model_value(model, 0, SGS_PARAM_ROTATION + k);
        for (int k = 0; k < 3; ++k)
            scales[k] = exp((double)model_value(model, 0, SGS_PARAM_SCALE + k));
        model_covariance(rotation, scales, after);
        const double c[3] = {-(double)model_value(model, 0, SGS_PARAM_SH_REST + 6),
                             -(double)model_value(model, 0, SGS_PARAM_SH_REST),
                             (double)model_value(model, 0, SGS_PARAM_SH_REST + 3)};
        for (int i = 0; i < 3; ++i) {
            double mean = p->moved[i], direction = 0;
            for (int j = 0; j < 3; ++j) {
                double sum = 0;
                mean += p->linear[i][j] * point[j];
                direction += turn[i][j] * brightest[j];
                for (int k = 0; k < 9; ++k)
                    sum += p->linear[i][k / 3] * before[k / 3][k % 3] * p->linear[j][k % 3];
                error = fmax(error, fabs(sum - flip[i] * flip[j] * after[i][j]));
            }
            error = fmax(error, fabs(mean - flip[i] * (double)model_value(model, 0, i)));
            error = fmax(error, fabs(direction - flip[i] * c[i]));
        }
        if (!(error <= 1e-4) || *warnings)
            fail_msg("error %g, '%s', %s", error, warnings, text);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

// A point reflection keeps the functions of even degrees.
static void mirrors_change_odd_degrees(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(5, 3), *mirrored;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.usda"), model, NULL, NULL), 0);
    size_t size;
    char *text = (char *)file_get(temp_path(&folder, "a.usda"), &size), *brace = strchr(text, '{'),
         *changed = malloc(size + 200);
    snprintf(changed, size + 200, "%.*s{\nfloat3 xformOp:scale = (-1, -1, -1)\n%s%s",
             (int)(brace - text), text, ORDER("\"xformOp:scale\""), brace + 1);
    mirrored = read_text(&folder, changed, NULL);
    for (size_t i = 0; i < 5; ++i)
        for (int k = 0; k < SGS_PARAM_SH_REST + 45; ++k) {
            const int rest = (k - SGS_PARAM_SH_REST) / 3;
            const bool odd =
                k < SGS_PARAM_MEAN + 3 || (k >= SGS_PARAM_SH_REST && (rest < 3 || rest >= 8));
            const double expected = (odd ? -1 : 1) * (double)model_value(model, i, k);
            if (!(fabs(expected - (double)model_value(mirrored, i, k)) <= 1e-5))
                fail_msg("parameter %d: %g, not %g", k, (double)model_value(mirrored, i, k),
                         expected);
        }
    free(changed);
    free(text);
    sgs_gaussians_destroy(mirrored);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void other_transforms_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *attributes, *message;
        sgs_status status;
    } cases[] = {
        {"float3 xformOp:scale = (2, 2, 0)\n" ORDER("\"xformOp:scale\""),
         "line 4: the transform of the splats is singular, projective or not finite",
         SGS_STATUS_UNSUPPORTED},
        {"float xformOp:rotateXYZ = (20, 30, 40)\nfloat3 xformOp:scale = (1, 0, 1)\n" ORDER(
             "\"xformOp:rotateXYZ\", \"xformOp:scale\", \"!invert!xformOp:rotateXYZ\""),
         "is singular", SGS_STATUS_UNSUPPORTED},
        {"matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 1), (0, 0, 0, "
         "1))\n" ORDER("\"xformOp:transform\""),
         "is singular, projective", SGS_STATUS_UNSUPPORTED},
        {"float xformOp:scaleX = 0\n" ORDER("\"!invert!xformOp:scaleX\""), "or not finite",
         SGS_STATUS_UNSUPPORTED},
        {"float xformOp:rotateX = nan\n" ORDER("\"xformOp:rotateX\""), "or not finite",
         SGS_STATUS_UNSUPPORTED},
        {"float xformOp:rotateX.timeSamples = { 0: 0 }\n" ORDER("\"xformOp:rotateX\""),
         "the transform of the splats has time samples", SGS_STATUS_UNSUPPORTED},
        {"float xformOp:rotateX = 1\nfloat xformOp:rotateX.spline = { 0: 0 }\n" ORDER(
             "\"xformOp:rotateX\""),
         "has time samples", SGS_STATUS_UNSUPPORTED},
        {"float xformOp:twist = 1\n" ORDER("\"xformOp:twist\""), "has an operation of an unknown",
         SGS_STATUS_FORMAT},
        {"float3 xformOp:translate = (1, 2)\n" ORDER("\"xformOp:translate\""),
         "without a valid value", SGS_STATUS_FORMAT},
        {"float3 xformOp:rotateXYZ = 1\n" ORDER("\"xformOp:rotateXYZ\""), "without a valid value",
         SGS_STATUS_FORMAT},
    };
    const temp_folder folder = temp_folder_make();
    char text[16384];
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        snprintf(text, sizeof text, "#usda 1.0\ndef Xform \"W\"\n{ " SPLATS "\n{\n" ALL "}\n%s}\n",
                 cases[k].attributes);
        file_put(temp_path(&folder, "a.usda"), text, strlen(text));
        model_refused(temp_path(&folder, "a.usda"), cases[k].status, cases[k].message, text);
        // of another prim
        snprintf(text, sizeof text, "#usda 1.0\n" SPLATS "\n{\n" ALL "def Xform \"W\"\n{\n%s}\n}\n",
                 cases[k].attributes);
        sgs_gaussians_destroy(read_text(&folder, text, NULL));
    }
    for (int listed = 0; listed < 2; ++listed) {
        size_t length = (size_t)snprintf(text, sizeof text, "#usda 1.0\n" SPLATS "\n{\n" ALL);
        if (listed)
            length += (size_t)snprintf(text + length, sizeof text - length,
                                       "uniform token[] xformOpOrder = [\n");
        for (int k = 0; k < 40; ++k)
            length += (size_t)snprintf(
                text + length, sizeof text - length,
                listed ? "\"xformOp:rotateX:t%d\",\n" : "float xformOp:rotateX:t%d = 1\n", k);
        snprintf(text + length, sizeof text - length, listed ? "]\n}\n" : "}\n");
        file_put(temp_path(&folder, "a.usda"), text, strlen(text));
        model_refused(temp_path(&folder, "a.usda"), SGS_STATUS_UNSUPPORTED,
                      "has a prim with more than 32 operations", "operations");
    }
    temp_folder_remove(&folder);
}

// SH degrees 0 and 1, one prim inside of another, their own transforms, and prims without effect.
static void all_prims_are_joined(void **state)
{
    (void)state;
    static const char text[] =
        "#usda 1.0\nclass \"_C\"\n{\n" SPLATS " { " ALL "}\n}\n"
        "def Xform \"W\"\n{\n" SPLATS "\n{\n"
        "custom uniform double sparegs:whitePoint = 3\n"
        "uniform token colorSpace:name = \"lin_rec709_scene\"\n"
        "point3f[] positions = [(1, 0, 0), (2, 0, 0)]\nfloat[] opacities = [0.25, 0.5]\n"
        "quatf[] orientations = [(1, 0, 0, 0), (0, 1, 0, 0)]\nfloat3[] scales = [(1, 1, 1), (2, 2, "
        "2)]\nuniform int radiance:sphericalHarmonicsDegree = 0\n"
        "float3[] radiance:sphericalHarmonicsCoefficients = [(7, 8, 9), (4, 5, 6)]\n"
        "def ParticleField3DGaussianSplat \"Q\" (\n customData = { bool active = 0 }\n)\n{\n" ALL
        "double3 xformOp:translate = (0, 0, 10)\n" ORDER(
            "\"xformOp:translate\"") "}\n"
                                     "double3 xformOp:translate = (100, 0, 0)\n" ORDER(
                                         "\"xformOp:translate\"") "}\n"
                                                                  "def "
                                                                  "ParticleField3DGaussianSplat "
                                                                  "\"Off\" (\n active = "
                                                                  "false\n)\n{\n" ALL "}\n"
                                                                  "def "
                                                                  "ParticleField3DGaussianSplat "
                                                                  "\"None\"\n{\n}\n"
                                                                  "over "
                                                                  "ParticleField3DGaussianSplat "
                                                                  "\"Over\"\n{\n" ALL
                                                                  "}\n}\n" SPLATS "\n{\n" ALL "}\n";
    static const double means[4][3] = {{101, 0, 0}, {102, 0, 0}, {101, -2, -13}, {1, -2, -3}};
    static const double reds[4][2] = {{7, 0}, {4, 0}, {0, 0.8}, {0, 0.8}}; // DC, towards y
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    sgs_gaussians *model = read_text(&folder, text, &info);
    assert_int_equal(model->count, 4);
    assert_int_equal(model->sh_degree, 1);
    for (size_t i = 0; i < 4; ++i) {
        for (int k = 0; k < 3; ++k)
            assert_true(fabs((double)model_value(model, i, k) - means[i][k]) <= 1e-5);
        assert_true(fabs((double)model_value(model, i, SGS_PARAM_SH_DC) - reds[i][0]) <= 1e-6);
        assert_true(fabs((double)model_value(model, i, SGS_PARAM_SH_REST) - reds[i][1]) <= 1e-6);
    }
    assert_int_equal(info.colors.space, SGS_SPACE_LINEAR);
    assert_true(info.colors.white_point == 3.0);
    assert_string_equal(strstr(warnings, "its prims have"),
                        "its prims have several colour spaces; that of the first is used\n");
    sgs_gaussians_destroy(model);
    file_put(temp_path(&folder, "a.usda"), text, strlen(text));
    sgs_model_colors colors;
    assert_int_equal(sgs_model_read_colors(temp_path(&folder, "a.usda"), &colors), 0);
    assert_true(colors.space == SGS_SPACE_LINEAR && colors.white_point == 3.0);
    temp_folder_remove(&folder);
}

static void variants_are_refused(void **state)
{
    (void)state;
    static const char text[] = "#usda 1.0\ndef Xform \"W\" (\n variants = { string lod = \"a\" }\n "
                               "prepend variantSets = \"lod\"\n)\n{\nvariantSet \"lod\" = {\n"
                               "\"a\" {\n" SPLATS " {\n" ALL "}\n}\n}\n}\n";
    static const char outside[] = "#usda 1.0\ndef Xform \"W\"\n{\nvariantSet \"lod\" = {\n"
                                  "\"a\" {\n}\n}\n" SPLATS " {\n" ALL "}\n}\n";
    static const char referenced[] = "#usda 1.0\ndef Xform \"W\" (\n"
                                     "prepend references = @b.usda@\n)\n{\n}\n";
    const temp_folder folder = temp_folder_make();
    file_put(temp_path(&folder, "a.usda"), text, strlen(text));
    model_refused(temp_path(&folder, "a.usda"), SGS_STATUS_UNSUPPORTED,
                  "line 9: the splats are in a variant; select one with 'usdcat -f", "variant");
    file_put(temp_path(&folder, "a.usda"), referenced, strlen(referenced));
    model_refused(temp_path(&folder, "a.usda"), SGS_STATUS_FORMAT,
                  "with positions; add those of other files with 'usdcat -f'", "reference");
    sgs_gaussians_destroy(read_text(&folder, outside, NULL));
    temp_folder_remove(&folder);
}

#define TWO "point3f[] positions = [(1, 2, 3), (4, 5, 6)]\n"
#define TWO_OPACITIES "float[] opacities = [0.25, 0.25]\n"
#define TWO_SCALES "float3[] scales = [(1, 2, 4), (1, 2, 4)]\n"
#define TWO_ORIENTATIONS "quatf[] orientations = [(0.5, 0.5, 0.5, 0.5), (0.5, 0.5, 0.5, 0.5)]\n"
#define TWO_SH                                                                                     \
    "uniform int radiance:sphericalHarmonicsDegree = 0\n"                                          \
    "float3[] radiance:sphericalHarmonicsCoefficients = [(7, 8, 9), (7, 8, 9)]\n"
#define DEGREE_0 "uniform int radiance:sphericalHarmonicsDegree = 0\n"

static void missing_values_have_the_fallbacks_of_the_schema(void **state)
{
    (void)state;
    static const struct {
        const char *attributes, *warning; // "" for none
        double opacity, scale, turn, red; // of the second primitive; turn: w of its quaternion
    } cases[] = {
        {TWO_ORIENTATIONS TWO_SCALES TWO_OPACITIES TWO_SH, "", 0.25, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_SCALES TWO_SH, "line 3: the splats have no 'opacities': opacity 1 is",
         1, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_SCALES "float[] opacities = None\n" TWO_SH,
         "the splats have no 'opacities': opacity 1 is", 1, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_SCALES "float[] opacities = [0.25]\n" TWO_SH,
         "'opacities' has 1 value(s) for 2 splats and is ignored: opacity 1 is used", 1, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_SCALES "half[] opacitiesh = [0.25, 0.5, 0.75]\n" TWO_SH,
         "'opacities' has 3 value(s) for 2 splats; the last ones are ignored", 0.5, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_SCALES "float[] opacities = [1, 1]\n" TWO_SH, "", 1, 2, 0.5, 7},
        {TWO_ORIENTATIONS TWO_OPACITIES TWO_SH, "the splats have no 'scales': scale 1 is used",
         0.25, 1, 0.5, 7},
        {TWO_ORIENTATIONS TWO_OPACITIES TWO_SH
         "float3[] scales = [(1, 3, 4), (1, 3, 4), (1, 1, 1)]\n",
         "'scales' has 3 value(s) for 2 splats; the last ones are ignored", 0.25, 3, 0.5, 7},
        {TWO_SCALES TWO_OPACITIES TWO_SH "quatf[] orientations = [(0.5, 0.5, 0.5, 0.5)]\n",
         "'orientations' has 1 value(s) for 2 splats and is ignored: no rotation is used", 0.25, 2,
         1, 7},
        {TWO_SCALES TWO_OPACITIES TWO_SH, "the splats have no 'orientations': no rotation is used",
         0.25, 2, 1, 7},
        {TWO_ORIENTATIONS TWO_SCALES TWO_OPACITIES,
         "the splats have no 'radiance:sphericalHarmonicsCoefficients': the colour 0.5 without SH "
         "is used",
         0.25, 2, 0.5, 0},
        {TWO_ORIENTATIONS TWO_SCALES TWO_OPACITIES
         "float3[] "
         "radiance:sphericalHarmonicsCoefficients = [(7, 8, 9), (7, 8, 9)]\n",
         "Coefficients' has 2 value(s) for 2 splats of SH degree 3 and is ignored: the colour 0.5",
         0.25, 2, 0.5, 0},
        {TWO_ORIENTATIONS TWO_SCALES TWO_OPACITIES DEGREE_0
         "half3[] "
         "radiance:sphericalHarmonicsCoefficientsh = [(7, 8, 9), (6, 8, 9), (1, 1, 1)]\n",
         "Coefficients' has 3 value(s) for 2 splats of SH degree 0; the last ones are", 0.25, 2,
         0.5, 6},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        char text[4096];
        snprintf(text, sizeof text, "#usda 1.0\n" SPLATS "\n{\n" TWO "%s}\n", cases[k].attributes);
        sgs_gaussians *model = read_text(&folder, text, NULL);
        const char *line = strchr(warnings, '\n');
        if (!strstr(warnings, cases[k].warning) || (line != NULL) != (*cases[k].warning != 0) ||
            (line && line[1]))
            fail_msg("'%s' instead of '%s'", warnings, cases[k].warning);
        assert_int_equal(model->count, 2);
        assert_int_equal(model->sh_degree, 0);
        const double got[] = {model_opacity(model, 1),
                              exp((double)model_value(model, 1, SGS_PARAM_SCALE + 1)),
                              (double)model_value(model, 1, SGS_PARAM_ROTATION),
                              (double)model_value(model, 1, SGS_PARAM_SH_DC)};
        const double expected[] = {cases[k].opacity, cases[k].scale, cases[k].turn, cases[k].red};
        for (int j = 0; j < 4; ++j)
            if (!(fabs(got[j] - expected[j]) <= 2e-6))
                fail_msg("value %d: %g, not %g: %s", j, got[j], expected[j], text);
        sgs_gaussians_destroy(model);
    }
    // one warning for many prims
    sgs_gaussians *model =
        read_text(&folder,
                  "#usda 1.0\n" SPLATS "\n{\n" TWO TWO_ORIENTATIONS TWO_OPACITIES TWO_SH
                  "}\n" SPLATS "\n{\n" TWO TWO_ORIENTATIONS TWO_SCALES TWO_OPACITIES TWO_SH
                  "}\n" SPLATS "\n{\n" TWO TWO_ORIENTATIONS TWO_OPACITIES TWO_SH "}\n",
                  NULL);
    assert_string_equal(strstr(warnings, "line"),
                        "line 3: the splats have no 'scales': scale 1 is used; 2 prims in "
                        "total\n");
    assert_int_equal(model->count, 6);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void packages_are_read(void **state)
{
    (void)state;
    static const char text[] = "#usda 1.0\n" SPLATS "\n{\n" ALL "}\n",
                      binary[] = "PXR-USDC\0\10\0\0\0\0\0\0",
                      other[] = "#usda 1.0\ndef Xform \"W\" {}";
    static const struct {
        const char *name, *layer, *content;
        size_t size;
        const char *message; // NULL: it is read
        sgs_status status;
    } cases[] = {
        {"a.usdz", "default.usda", text, sizeof text - 1, NULL, 0},
        {"a.zip", "b.usd", text, sizeof text - 1, NULL, 0},
        {"a.usdz", "b.usdc", binary, sizeof binary - 1,
         "contains binary OpenUSD, which is not read; convert it to text with 'usdcat -f ",
         SGS_STATUS_UNSUPPORTED},
        {"a.bin", "b.usd", binary, sizeof binary - 1, "contains binary OpenUSD",
         SGS_STATUS_UNSUPPORTED},
        {"a.usdz", "b.usda", other, sizeof other - 1,
         "with positions; add those of other files with 'usdcat -f'", SGS_STATUS_FORMAT},
        {"a.usdz", "b.txt", other + 1, sizeof other - 2, "its first file is not OpenUSD text",
         SGS_STATUS_FORMAT},
        {"a.zip", "b.txt", text, sizeof text - 1, "has no file 'meta.json'", SGS_STATUS_FORMAT},
    };
    const temp_folder folder = temp_folder_make();
    unsigned char zip[4096];
    sgs_gaussians *model;
    sgs_model_info info;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const char *const files[2][2] = {{cases[k].layer, cases[k].content}, {"0.png", "pixels"}};
        const size_t sizes[2] = {cases[k].size, 6};
        char *path = strdup(temp_path(&folder, cases[k].name));
        file_put(path, zip, usdz_bytes(zip, files, sizes));
        if (cases[k].message) {
            model_refused(path, cases[k].status, cases[k].message, cases[k].layer);
        } else {
            if (sgs_model_read(path, NULL, &model, &info))
                fail_msg("%s", sgs_last_error());
            assert_int_equal(info.format, SGS_MODEL_USDA);
            assert_int_equal(model->count, 1);
            sgs_gaussians_destroy(model);
        }
        free(path);
    }
    static const char *const names[] = {"a.usdc", "a.usd", "a.usda"};
    for (int k = 0; k < 3; ++k) {
        file_put(temp_path(&folder, names[k]), binary, sizeof binary - 1);
        model_refused(temp_path(&folder, names[k]), SGS_STATUS_UNSUPPORTED,
                      "is binary OpenUSD, which is not read; convert it to text with 'usdcat ",
                      names[k]);
    }
    file_put(temp_path(&folder, "b.usd"), text, sizeof text - 1);
    assert_int_equal(sgs_model_read(temp_path(&folder, "b.usd"), NULL, &model, &info), 0);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transforms_are_applied),
        cmocka_unit_test(mirrors_change_odd_degrees),
        cmocka_unit_test(other_transforms_are_refused),
        cmocka_unit_test(all_prims_are_joined),
        cmocka_unit_test(variants_are_refused),
        cmocka_unit_test(missing_values_have_the_fallbacks_of_the_schema),
        cmocka_unit_test(packages_are_read),
    };
    return cmocka_run_group_tests(tests, warnings_begin, NULL);
}
