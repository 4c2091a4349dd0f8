// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Cameras of OpenUSD. Expected values are computed by hand from the documentation of
// UsdGeomXformable and UsdGeomCamera: the last operation of xformOpOrder acts first, those of the
// prims above act after those of the camera, rotateXYZ turns about x first; cameras look along -z
// with y up.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sparegs/usd_cameras.h"
#include "support/files_support.h"
#include "support/model_support.h"
#include "support/scene_support.h"
#include "support/usdz_bytes.h"

enum { WIDTH = 64, HEIGHT = 48 };

#define FILM "float focalLength = 40\nfloat horizontalAperture = 32\nfloat verticalAperture = 24\n"
#define CAMERA(attributes) "def Camera \"C\"\n{\n" FILM attributes "}\n"
#define ORDER(list) "uniform token[] xformOpOrder = [" list "]\n"
#define TRANSLATE ORDER("\"xformOp:translate\"")
#define RANGE(first, last) "#usda 1.0\n(\nstartTimeCode = " #first "\nendTimeCode = " #last "\n)\n"

static sgs_usd_cameras *read_text(const temp_folder *folder, const char *text)
{
    sgs_usd_cameras *cameras;
    warnings[0] = 0;
    file_put(temp_path(folder, "a.usda"), text, strlen(text));
    if (sgs_usd_cameras_read(temp_path(folder, "a.usda"), WIDTH, HEIGHT, &cameras))
        fail_msg("%s\n%s", sgs_last_error(), text);
    return cameras;
}

// A pose in the axes of OpenUSD with y up.
typedef struct placement {
    double center[3], right[3], up[3], back[3];
} placement;

// Models and cameras change the signs of world y and z; ours look along +z with y down.
static double placement_error(const sgs_pose *pose, const placement *expected)
{
    static const double sign[3] = {1, -1, -1};
    double error = 0, center[3];
    sgs_pose_center(pose, center);
    for (int i = 0; i < 3; ++i) {
        error = fmax(error, fabs(center[i] - sign[i] * expected->center[i]));
        error = fmax(error, fabs(pose->rotation[i] - sign[i] * expected->right[i]));
        error = fmax(error, fabs(-pose->rotation[3 + i] - sign[i] * expected->up[i]));
        error = fmax(error, fabs(-pose->rotation[6 + i] - sign[i] * expected->back[i]));
    }
    return error;
}

#define X                                                                                          \
    {                                                                                              \
        1, 0, 0                                                                                    \
    }
#define Y                                                                                          \
    {                                                                                              \
        0, 1, 0                                                                                    \
    }
#define Z                                                                                          \
    {                                                                                              \
        0, 0, 1                                                                                    \
    }
#define MINUS_X                                                                                    \
    {                                                                                              \
        -1, 0, 0                                                                                   \
    }
#define MINUS_Y                                                                                    \
    {                                                                                              \
        0, -1, 0                                                                                   \
    }
#define MINUS_Z                                                                                    \
    {                                                                                              \
        0, 0, -1                                                                                   \
    }

static const struct {
    const char *above, *inside; // attributes of the prim above the camera, and of the camera
    placement expected;
} placed[] = {
    {"", "", {{0}, X, Y, Z}},
    {"double xformOp:rotateX = 90\n" ORDER("\"xformOp:rotateX\""), "", {{0}, X, Z, MINUS_Y}},
    // x first, then z
    {"", "float3 xformOp:rotateXYZ = (90, 0, 90)\n" ORDER("\"xformOp:rotateXYZ\""), {{0}, Y, Z, X}},
    // z first, then x
    {"",
     "float3 xformOp:rotateZYX = (90, 0, 90)\n" ORDER("\"xformOp:rotateZYX\""),
     {{0}, Z, MINUS_X, MINUS_Y}},
    {"",
     "quatf xformOp:orient = (0.7071067811865476, 0, 0, 0.7071067811865476)\n" ORDER(
         "\"xformOp:orient\""),
     {{0}, Y, MINUS_X, Z}},
    // rows are the images of the axes, then the centre
    {"",
     "matrix4d xformOp:transform = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, "
     "1))\n" ORDER("\"xformOp:transform\""),
     {{5, 6, 7}, Y, MINUS_X, Z}},
    {"",
     "double3 xformOp:translate = (10, 0, 0)\nfloat xformOp:rotateZ = 90\n" ORDER(
         "\"xformOp:translate\", \"xformOp:rotateZ\""),
     {{10, 0, 0}, Y, MINUS_X, Z}},
    {"",
     ORDER("\"xformOp:rotateZ\", \"xformOp:translate\"") "double3 xformOp:translate = (10, 0, "
                                                         "0)\nfloat xformOp:rotateZ = 90\n",
     {{0, 10, 0}, Y, MINUS_X, Z}},
    // a turn about the pivot (1, 1, 0)
    {"",
     "float3 xformOp:translate:pivot = (1, 1, 0)\nfloat xformOp:rotateZ = 90\n" ORDER(
         "\"xformOp:translate:pivot\", \"xformOp:rotateZ\", \"!invert!xformOp:translate:pivot\""),
     {{2, 0, 0}, Y, MINUS_X, Z}},
    // the inverse of a turn, a scale by 4 and a translation by (4, 8, 12)
    {"matrix4d xformOp:transform = ((0, -4, 0, 0), (4, 0, 0, 0), (0, 0, 4, 0), (4, 8, 12, 1))\n" //
     ORDER("\"!invert!xformOp:transform\""),
     "",
     {{2, -1, -3}, Y, MINUS_X, Z}},
    // a scale above the camera moves it, its own does not
    {"float3 xformOp:scale = (2, 2, 2)\n" ORDER("\"xformOp:scale\""),
     "double3 xformOp:translate = (0, 0, 5)\n" TRANSLATE,
     {{0, 0, 10}, X, Y, Z}},
    {"double3 xformOp:translate = (0, 0, 5)\n" TRANSLATE,
     "float3 xformOp:scale = (2, 2, 2)\n" ORDER("\"xformOp:scale\""),
     {{0, 0, 5}, X, Y, Z}},
    {"double xformOp:rotateY = 90\n" ORDER("\"xformOp:rotateY\""),
     "double3 xformOp:translate = (1, 2, 3)\n" TRANSLATE,
     {{3, 2, -1}, MINUS_Z, Y, X}},
    {"float3 xformOp:scale = (2, 3, 4)\n" ORDER("\"xformOp:scale\""),
     "double3 xformOp:translate = (0, 0, 5)\n" ORDER(
         "\"!resetXformStack!\", \"xformOp:translate\""),
     {{0, 0, 5}, X, Y, Z}},
    // rounded: the nearest rotation
    {"",
     "matrix4d xformOp:transform = ((0, 1.0005, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (5, 6, 7, "
     "1))\n" ORDER("\"xformOp:transform\""),
     {{5, 6, 7}, Y, MINUS_X, Z}},
    // two scales whose product is uniform
    {"float3 xformOp:scale = (1, 2, 4)\n" ORDER("\"xformOp:scale\""),
     "float3 xformOp:scale = (4, 2, 1)\n" ORDER("\"xformOp:scale\""),
     {{0}, X, Y, Z}},
};

static void transforms_place_the_camera(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (size_t n = 0; n < 2 * sizeof placed / sizeof *placed; ++n) {
        char text[4096];
        snprintf(text, sizeof text,
                 n % 2 ? "#usda 1.0\ndef Xform \"W\"\n{\n%s" CAMERA("%s") "}\n"
                       : "#usda 1.0\ndef Xform \"W\"\n{\n" CAMERA("%2$s") "%1$s}\n",
                 placed[n / 2].above, placed[n / 2].inside); // also after the children
        sgs_usd_cameras *cameras = read_text(&folder, text);
        assert_true(cameras->count == 1 && cameras->cameras[0].view_count == 1);
        assert_string_equal(cameras->cameras[0].path, "W/C");
        const double error =
            placement_error(&cameras->cameras[0].views[0].pose, &placed[n / 2].expected);
        if (!(error <= 1e-9) || *warnings)
            fail_msg("error %g, '%s', %s", error, warnings, text);
        sgs_usd_cameras_destroy(cameras);
    }
    temp_folder_remove(&folder);
}

// A splat 0.7 right of, 0.4 above and 5 in front of a camera with focal length 80 pixels is at
// 32 + 80 0.7 / 5, 24 - 80 0.4 / 5 in its image, in stages with y and z up, and wherever both are.
static void cameras_fit_the_model_of_the_stage(void **state)
{
    (void)state;
    static const char *const axes[2] = {"upAxis = \"Y\"\n", "upAxis = \"Z\"\n"};
    static const char *const cameras[2] = {
        "double3 xformOp:translate = (1, 2, 3)\n" TRANSLATE,
        // in Blender's way: looks along y, z is up
        "double3 xformOp:translate = (1, 2, 3)\nfloat3 xformOp:rotateXYZ = (90, 0, 0)\n" ORDER(
            "\"xformOp:translate\", \"xformOp:rotateXYZ\"")};
    static const char *const splats[2] = {"(1.7, 2.4, -2)", "(1.7, 7, 3.4)"};
    const temp_folder folder = temp_folder_make();
    for (int up = 0; up < 2; ++up)
        for (int moved = 0; moved < 2; ++moved) {
            char text[4096];
            snprintf(text, sizeof text,
                     "#usda 1.0\n(\nmetersPerUnit = 0.01\n%s)\ndef Xform \"W\"\n{\n%s"
                     "def ParticleField3DGaussianSplat \"P\"\n{\npoint3f[] positions = [%s]\n}\n"
                     "def Camera \"C\"\n{\n" FILM "%s}\n}\n",
                     axes[up],
                     moved ? "float3 xformOp:rotateXYZ = (10, 20, 30)\nfloat3 xformOp:scale = (3, "
                             "3, 3)\ndouble3 xformOp:translate = (4, 5, 6)\n" //
                         ORDER("\"xformOp:rotateXYZ\", \"xformOp:translate\", \"xformOp:scale\"")
                           : "",
                     splats[up], cameras[up]);
            sgs_usd_cameras *read = read_text(&folder, text);
            const sgs_usd_view *view = &read->cameras[0].views[0];
            sgs_gaussians *model;
            assert_int_equal(sgs_model_read(temp_path(&folder, "a.usda"), NULL, &model, NULL), 0);
            double point[3], pixel[2];
            for (int i = 0; i < 3; ++i) {
                point[i] = view->pose.translation[i];
                for (int j = 0; j < 3; ++j)
                    point[i] += view->pose.rotation[3 * i + j] * (double)model_value(model, 0, j);
            }
            assert_true(sgs_camera_project(&view->camera, point, pixel));
            if (!(fabs(pixel[0] - 43.2) <= 1e-4 && fabs(pixel[1] - 17.6) <= 1e-4))
                fail_msg("%g %g: %s", pixel[0], pixel[1], text);
            sgs_gaussians_destroy(model);
            sgs_usd_cameras_destroy(read);
        }
    temp_folder_remove(&folder);
}

#define SAMPLES(name, list) name ".timeSamples = { " list " }\n"
#define ABOUT_Z(cosine, sine) {(cosine), (sine), 0}, {-(sine), (cosine), 0}, Z
#define HALF 0.7071067811865476
#define CENTERS(list) SAMPLES("double3 xformOp:translate", list) TRANSLATE

// One view of a stage: the index-th of `count`.
static const struct {
    const char *text;
    size_t count, index;
    double time;
    int frame;
    placement expected;
} frames[] = {
    // positions are linear between samples and stay outside of them
    {RANGE(1, 4) CAMERA(CENTERS("1: (0, 0, 0), 3: (2, 4, 6)")), 4, 1, 2, 2, {{1, 2, 3}, X, Y, Z}},
    {RANGE(1, 4) CAMERA(CENTERS("1: (0, 0, 0), 3: (2, 4, 6)")), 4, 3, 4, 4, {{2, 4, 6}, X, Y, Z}},
    {RANGE(0, 3) CAMERA(CENTERS("1: (7, 0, 0), 3: (2, 4, 6)")), 4, 0, 0, 0, {{7, 0, 0}, X, Y, Z}},
    // in any order, with comments; the last of two samples at a time counts
    {RANGE(1, 3) CAMERA(CENTERS("3: (9, 9, 9), # 2: (8, 8, 8)\n 1: (0, 0, 0), /* } */ 3: (2, 4, "
                                "6),")),
     3,
     1,
     2,
     2,
     {{1, 2, 3}, X, Y, Z}},
    {RANGE(0, 2) CAMERA("double3 xformOp:translate = (7, 7, 7)\n" CENTERS("0: (0, 0, 0), 2: (2, 0, "
                                                                          "0)")),
     3,
     1,
     1,
     1,
     {{1, 0, 0}, X, Y, Z}},
    // a blocked sample: the one before it stays until then, afterwards there is no translation
    {RANGE(0, 9) CAMERA(CENTERS("0: (1, 0, 0), 4: None, 8: (5, 0, 0)")),
     10,
     3,
     3,
     3,
     {{1, 0, 0}, X, Y, Z}},
    {RANGE(0, 9) CAMERA(CENTERS("0: (1, 0, 0), 4: None, 8: (5, 0, 0)")),
     10,
     6,
     6,
     6,
     {{0}, X, Y, Z}},
    {RANGE(0, 9) CAMERA(CENTERS("0: (1, 0, 0), 4: None, 8: (5, 0, 0)")),
     10,
     9,
     9,
     9,
     {{5, 0, 0}, X, Y, Z}},
    // angles are linear, quaternions at a constant speed along the shorter arc
    {RANGE(0, 2)
         CAMERA(SAMPLES("float xformOp:rotateZ", "0: 0, 2: 180") ORDER("\"xformOp:rotateZ\"")),
     3,
     1,
     1,
     1,
     {{0}, ABOUT_Z(0, 1)}},
    {RANGE(0, 2) CAMERA(SAMPLES("float xformOp:rotateZ", "0:0,2:180") ORDER("\"xformOp:rotateZ\"")),
     3,
     1,
     1,
     1,
     {{0}, ABOUT_Z(0, 1)}},
    {RANGE(0, 3)
         CAMERA(SAMPLES("quatf xformOp:orient", "0: (1, 0, 0, 0), 3: (0.7071067811865476, 0, 0, "
                                                "0.7071067811865476)") ORDER("\"xformOp:orient\"")),
     4,
     1,
     1,
     1,
     {{0}, ABOUT_Z(0.8660254037844387, 0.5)}},
    {RANGE(0, 3) CAMERA(SAMPLES("quatf xformOp:orient",
                                "0: (2, 0, 0, 0), 3: (-0.7071067811865476, 0, 0, "
                                "-0.7071067811865476)") ORDER("\"xformOp:orient\"")),
     4,
     2,
     2,
     2,
     {{0}, ABOUT_Z(0.5, 0.8660254037844387)}},
    // matrices are linear, too: half way to a quarter turn the axes are shorter, but half turned
    {RANGE(0, 2) CAMERA(SAMPLES("matrix4d xformOp:transform",
                                "0: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)), "
                                "2: ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (2, 4, 6, 1))")
                            ORDER("\"xformOp:transform\"")),
     3,
     1,
     1,
     1,
     {{1, 2, 3}, ABOUT_Z(HALF, HALF)}},
    // a prim above the camera moves
    {RANGE(0, 2) "def Xform \"W\"\n{\n" CAMERA(CENTERS("0: (1, 0, 0), 2: (3, 0, 0)")) //
     SAMPLES("float xformOp:rotateZ", "0: 0, 2: 180") ORDER("\"xformOp:rotateZ\"") "}\n",
     3,
     1,
     1,
     1,
     {{0, 2, 0}, ABOUT_Z(0, 1)}},
    {RANGE(0, 2) "def Xform \"V\"\n{\n" SAMPLES("float xformOp:rotateZ", "0: 0, 2: 180") ORDER(
         "\"xformOp:rotateZ\"") "def Xform \"W\"\n{\n" CAMERA("double3 xformOp:translate = (1, 0, "
                                                              "0)\n" TRANSLATE) "}\n}\n",
     3,
     1,
     1,
     1,
     {{0, 1, 0}, ABOUT_Z(0, 1)}},
    // without a range, from the first to the last sample; frames are integers
    {"#usda 1.0\n" CAMERA(CENTERS("2.25: (0, 0, 0), 5.75: (7, 0, 0)")),
     3,
     0,
     3,
     3,
     {{1.5, 0, 0}, X, Y, Z}},
    {"#usda 1.0\n(\nendTimeCode = 4\n)\n" CAMERA(CENTERS("2: (0, 0, 0), 9: (7, 0, 0)")),
     3,
     2,
     4,
     4,
     {{2, 0, 0}, X, Y, Z}},
    {"#usda 1.0\n(\nstartTimeCode = 6\n)\n" CAMERA(CENTERS("2: (0, 0, 0), 4: (7, 0, 0)")),
     1,
     0,
     6,
     6,
     {{7, 0, 0}, X, Y, Z}},
    {"#usda 1.0\n" CAMERA(CENTERS("1.25: (0, 0, 0), 1.75: (7, 0, 0)")),
     1,
     0,
     1.25,
     1,
     {{0}, X, Y, Z}},
    {RANGE(3.0000001, 3.9999999) CAMERA(CENTERS("0: (0, 0, 0), 8: (8, 0, 0)")),
     2,
     0,
     3,
     3,
     {{3, 0, 0}, X, Y, Z}},
    {"#usda 1.0\n" CAMERA(SAMPLES("float focalLength", "2: 40, 5: 40")
                              CENTERS("3: (0, 0, 0), 7: (7, 0, 0)")),
     6,
     0,
     2,
     2,
     {{0}, X, Y, Z}},
    {"#usda 1.0\n" CAMERA(SAMPLES("float focalLength", "3: 40, 7: 40")
                              CENTERS("2: (0, 0, 0), 5: (7, 0, 0)")),
     6,
     5,
     7,
     7,
     {{7, 0, 0}, X, Y, Z}},
    {RANGE(0, 2) CAMERA(CENTERS("2: (3, 0, 0), 0: None, 0: (1, 0, 0)")),
     3,
     1,
     1,
     1,
     {{2, 0, 0}, X, Y, Z}},
    // one sample is no animation, but has its frame number
    {RANGE(1001, 1100) CAMERA(CENTERS("1007: (7, 0, 0)")), 1, 0, 1007, 1007, {{7, 0, 0}, X, Y, Z}},
    {RANGE(1001, 1100) CAMERA(CENTERS("-5: (7, 0, 0)")), 1, 0, -5, -5, {{7, 0, 0}, X, Y, Z}},
    {RANGE(1001, 1100) CAMERA(""), 1, 0, 0, 0, {{0}, X, Y, Z}},
    // operations that are not listed do not count
    {RANGE(1, 9) CAMERA("double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 9: (1, 1, 1) }\n"),
     1,
     0,
     0,
     0,
     {{0}, X, Y, Z}},
    // neither do other dictionaries of the metadata
    {"#usda 1.0\n(\n\"a layer\"\ncustomLayerData = {\ndouble endTimeCode = 90\nstring upAxis = "
     "\"Z\"\n}\nstartTimeCode = 1\nendTimeCode = 2 # endTimeCode = 8\n)\n"
     "def Xform \"W\" (\ncustomData = {\ndouble startTimeCode = -4\n}\n)\n{\n" CAMERA(
         CENTERS("1: (0, 0, 0), 3: (2, 4, 6)")) "}\n",
     2,
     1,
     2,
     2,
     {{1, 2, 3}, X, Y, Z}},
};

static void frames_are_evaluated_at_their_time_codes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (size_t n = 0; n < sizeof frames / sizeof *frames; ++n) {
        sgs_usd_cameras *cameras = read_text(&folder, frames[n].text);
        const sgs_usd_camera *camera = &cameras->cameras[0];
        if (camera->view_count != frames[n].count || *warnings)
            fail_msg("%zu views, '%s': %s", camera->view_count, warnings, frames[n].text);
        const sgs_usd_view *view = &camera->views[frames[n].index];
        const double error = placement_error(&view->pose, &frames[n].expected);
        if (!(error <= 1e-9) || view->time != frames[n].time || view->frame != frames[n].frame)
            fail_msg("error %g at %g, frame %d: %s", error, view->time, view->frame,
                     frames[n].text);
        assert_true(camera->has_samples == (frames[n].frame != 0 || camera->is_animated));
        sgs_usd_cameras_destroy(cameras);
    }
    temp_folder_remove(&folder);
}

static void rates_are_time_codes_per_second(void **state)
{
    (void)state;
    static const struct {
        const char *metadata, *samples;
        double fps;
    } cases[] = {
        {"timeCodesPerSecond = 25\nframesPerSecond = 30\n", "0: 0, 1: 1", 25},
        {"framesPerSecond = 30\n", "0: 0, 1: 1", 30},
        {"", "0: 0, 1: 1", 24},
        {"timeCodesPerSecond = 25\n", "0: 0", 0},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        char text[1024];
        snprintf(text, sizeof text,
                 "#usda 1.0\n(\n%s)\n" CAMERA("float xformOp:rotateX.timeSamples = {%s}\n" //
                                              ORDER("\"xformOp:rotateX\"")),
                 cases[k].metadata, cases[k].samples);
        sgs_usd_cameras *cameras = read_text(&folder, text);
        assert_true(cameras->fps == cases[k].fps);
        sgs_usd_cameras_destroy(cameras);
    }
    temp_folder_remove(&folder);
}

// fx, fy, cx, cy of the second of the frames 0 to 2.
static void the_film_is_the_lens(void **state)
{
    (void)state;
    static const struct {
        const char *attributes;
        double fx, fy, cx, cy;
        const char *warning; // "" for none
    } cases[] = {
        {FILM, 80, 80, 32, 24, ""},
        // half of the film right and up: the principal point is left of and below the centre
        {FILM "float horizontalApertureOffset = 2\nfloat verticalApertureOffset = 3\n", 80, 80, 28,
         30, ""},
        {FILM SAMPLES("float focalLength", "0: 40, 2: 60"), 100, 100, 32, 24, ""},
        {FILM SAMPLES("float focalLength", "0: 40, 2: 60")
             SAMPLES("float horizontalApertureOffset", "0: 0, 2: 4")
                 SAMPLES("float verticalAperture", "0: 24, 4: 24"),
         100, 100, 28, 24, ""},
        {FILM "float focalLength.connect = </C.fStop>\nfloat focalLength.timeSamples = {}\n", 80,
         80, 32, 24, ""},
        // the fallbacks of the schema; the film is 1.37 wide, so the vertical field of view stays
        {"", 50 / 15.2908 * 48, 50 / 15.2908 * 48, 32, 24,
         "the film of camera 'C' has the aspect ratio 1.37, the images 1.333: the vertical field "
         "of view is kept; images of 66x48 pixels show exactly the film"},
        {FILM SAMPLES("float focalLength", "0:40,2 :60"), 100, 100, 32, 24, ""}, // without spaces
        {FILM SAMPLES("float focalLength", "0:None"), 50 / 32.0 * 64, 50 / 24.0 * 48, 32, 24, ""},
        {FILM SAMPLES("float focalLength", "0: None"), 50 / 32.0 * 64, 50 / 24.0 * 48, 32, 24, ""},
        {FILM "float horizontalAperture = 36\nfloat horizontalApertureOffset = 4\n", 80, 80, 24, 24,
         "the aspect ratio 1.5, the images 1.333"},
        // up to one pixel of the shorter side, both apertures count
        {FILM "float horizontalAperture = 32.5\n", 40 / 32.5 * 64, 80, 32, 24, ""},
        // pixels twice as wide as high
        {FILM "float horizontalAperture = 64\ncustom float sparegs:pixelAspectRatio = 2\n", 40, 80,
         32, 24, ""},
        {FILM "float horizontalAperture = 80\ncustom float sparegs:pixelAspectRatio = 2\n", 40, 80,
         32, 24, "the aspect ratio 1.667, the images 1.333"},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t n = 0; n < sizeof cases / sizeof *cases; ++n) {
        char text[2048];
        snprintf(text, sizeof text,
                 RANGE(0, 2) "def Camera \"C\"\n{\n%s" CENTERS("0: (0, 0, 0), 2: (1, 1, 1)") "}\n",
                 cases[n].attributes);
        sgs_usd_cameras *cameras = read_text(&folder, text);
        const sgs_camera *camera = &cameras->cameras[0].views[1].camera;
        const double expected[4] = {cases[n].fx, cases[n].fy, cases[n].cx, cases[n].cy};
        assert_true(camera->model == SGS_CAMERA_PINHOLE && camera->width == WIDTH &&
                    camera->height == HEIGHT);
        for (int k = 0; k < 4; ++k)
            if (!(fabs(camera->params[k] - expected[k]) <= 1e-9))
                fail_msg("parameter %d is %g, not %g: %s", k, camera->params[k], expected[k],
                         cases[n].attributes);
        if (!strstr(warnings, cases[n].warning) || !*warnings != !*cases[n].warning)
            fail_msg("'%s' instead of '%s'", warnings, cases[n].warning);
        sgs_usd_cameras_destroy(cameras);
    }
    temp_folder_remove(&folder);
}

static void active_perspective_cameras_are_read(void **state)
{
    (void)state;
    static const char text[] = RANGE(
        5,
        7) "class Camera \"Class\"\n{\n}\nover Camera \"Over\"\n{\n}\n"
           "def Xform \"Off\" (\nactive = false\n)\n{\n" CAMERA(
               "") "}\n"
                   "def Camera \"Top\"\n{\ntoken projection = \"orthographic\"\n}\n"
                   "def Camera \"Side\"\n{\ntoken projection.timeSamples = { 1: \"perspective\", "
                   "2: 'orthographic' }\n}\n"
                   "def Xform \"W\" (\nprepend apiSchemas = [\"MotionAPI\"]\n)\n{\n"
                   "custom string note = \"def Camera\"\n"
                   "token visibility = \"invisible\"\n"
                   "def Camera \"Still\" (\nkind = \"a\"\n)\n{\ntoken projection = "
                   "\"perspective\"\n" FILM "}\n"
                   "def 'Group'\n{\n" CAMERA(CENTERS("5: (0, 0, 0), 7: (1, 0, 0)")) "}\n}\n";
    const temp_folder folder = temp_folder_make();
    sgs_usd_cameras *cameras = read_text(&folder, text);
    assert_int_equal(cameras->count, 2);
    assert_string_equal(cameras->cameras[0].path, "W/Still");
    assert_string_equal(cameras->cameras[1].path, "W/Group/C");
    assert_true(!cameras->cameras[0].has_samples && !cameras->cameras[0].is_animated);
    assert_true(cameras->cameras[1].has_samples && cameras->cameras[1].is_animated);
    assert_int_equal(cameras->cameras[0].view_count, 1);
    assert_int_equal(cameras->cameras[1].view_count, 3);
    assert_string_equal(strstr(warnings, ": ") + 2, "2 orthographic camera(s) are omitted\n");
    sgs_usd_cameras_destroy(cameras);

    // references of a camera or above it could change it; those of other prims could not
    static const char *const references[] = {
        "(\nsubLayers = [@b.usda@]\n)\n" CAMERA(""),
        "def Xform \"W\" (\nprepend references = </Loop>\n)\n{\n" CAMERA("") "}\n",
        "def Camera \"C\" (\npayload = @c.usda@</A>\n)\n{\n" FILM "}\n",
        "def Camera \"C\" (\ninherits = </_class>\n)\n{\n" FILM "}\n",
        "def Xform \"W\" (\nreferences = @b.usda@\n)\n{\n}\n" CAMERA(""),
    };
    for (size_t k = 0; k < sizeof references / sizeof *references; ++k) {
        char whole[1024];
        snprintf(whole, sizeof whole, "#usda 1.0\n%s", references[k]);
        sgs_usd_cameras_destroy(read_text(&folder, whole));
        assert_true((k < 4) == (strstr(warnings, "of its cameras are not read; apply them with "
                                                 "'usdcat -f ") != NULL));
    }
    temp_folder_remove(&folder);
}

// The file is refused with this status and one line that begins with its path and has the message.
static void refused(const char *path, sgs_status expected, const char *message)
{
    sgs_usd_cameras *cameras = (sgs_usd_cameras *)path;
    const sgs_status status = sgs_usd_cameras_read(path, WIDTH, HEIGHT, &cameras);
    if (status != expected || strncmp(sgs_last_error(), path, strlen(path)) ||
        !strstr(sgs_last_error(), message) || strchr(sgs_last_error(), '\n'))
        fail_msg("status %d with '%s', expected %d with '%s'", status, sgs_last_error(), expected,
                 message);
    assert_null(cameras);
    bad_input();
}

// A matrix whose scales along x and y change from 1 to these.
#define SCALED(x, y)                                                                               \
    SAMPLES("matrix4d xformOp:transform",                                                          \
            "0: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)), 2: ((" x                 \
            ", 0, 0, 0), (0, " y ", 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))")                           \
    ORDER("\"xformOp:transform\"")

static void others_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *text, *message;
        sgs_status status;
    } cases[] = {
        {"#usda 1.0\ndef Xform \"W\"\n{\n}\n", "contains no active prim of type Camera",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\ndef Xform \"W\" (\nreferences = @b.usda@\n)\n{\n}\n",
         "of type Camera; add those of other files with 'usdcat -f'", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("token projection = \"orthographic\"\n"),
         "camera 'C' is orthographic; only perspective cameras are read", SGS_STATUS_UNSUPPORTED},
        {"#usda 1.0\ndef Xform \"W\"\n{\nvariantSet \"v\" = {\n\"a\" {\n" CAMERA("") "}\n}\n}\n",
         "line 7: cameras are in a variant; select one with 'usdcat -f", SGS_STATUS_UNSUPPORTED},
        {"#usda 1.0\n" CAMERA("float focalLength = 0\n"),
         "camera 'C', time code 0: focalLength is not positive", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float verticalAperture = -1\n"), "verticalAperture is not positive",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float horizontalAperture = nan\n"),
         "horizontalAperture is not a number", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float horizontalAperture = (1, 2)\n"),
         "horizontalAperture is not a number", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float focalLength = \"long\"\n"), "focalLength is not a number",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float verticalApertureOffset = inf\n"),
         "verticalApertureOffset is not a number", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float focalLength = 1e300\nfloat verticalAperture = 1e-300\n"),
         "camera 'C', time code 0: parameter 1 of the PINHOLE camera is not finite",
         SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA(SAMPLES("float focalLength", "1: 5, 3: 0")),
         "camera 'C', time code 3: focalLength is not positive", SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA(SAMPLES("float focalLength", "1: 5, 3")), "focalLength is not a number",
         SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA(SAMPLES("float focalLength", "1: 5, nan: 3")),
         "focalLength is not a number", SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA("float focalLength.timeSamples = { 1: 5, 3: 4\n"),
         "the file ends inside a prim", SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA("float focalLength.spline = { 1: 5; 3: 4 }\n"),
         "focalLength has a spline, which is not read; convert it to time samples",
         SGS_STATUS_UNSUPPORTED},
        {RANGE(1, 3) CAMERA("float xformOp:rotateX.spline = { 1: 5 }\n" //
                            ORDER("\"xformOp:rotateX\"")),
         "its transform has a spline", SGS_STATUS_UNSUPPORTED},
        {"#usda 1.0\n" CAMERA("matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, "
                              "0), (0, 0, 0, 1), "
                              "(1, 1, 1, 1))\n" ORDER("\"xformOp:transform\"")),
         "without a valid value", SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA(CENTERS("1: (0, 0), 3: (1, 1)")),
         "time code 1: its transform has an operation of an unknown type or without a valid value",
         SGS_STATUS_FORMAT},
        {RANGE(1, 3) CAMERA(CENTERS("1: (0, 0, 0), 2: (1, 1), 3: (1, 1, 1)")),
         "time code 2: its transform has an operation", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float xformOp:twist = 1\n" ORDER("\"xformOp:twist\"")),
         "its transform has an operation of an unknown type", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float xformOp:rotateX = inf\n" ORDER("\"xformOp:rotateX\"")),
         "its transform is not finite, or has a scale of 0", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float3 xformOp:scale = (0, 0, 0)\n" ORDER("\"xformOp:scale\"")),
         "its transform is not finite, or has a scale of 0", SGS_STATUS_FORMAT},
        {RANGE(0, 2) CAMERA(SCALED("-1", "-1")),
         "camera 'C', time code 1: its matrix interpolated between two "
         "time samples is singular; add samples",
         SGS_STATUS_FORMAT},
        {RANGE(0, 2) CAMERA(SCALED("inf", "1")), "code 1: its transform is not finite, or has",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("double3 xformOp:translate = (1e16, 0, 0)\n" TRANSLATE),
         "camera position is out of range", SGS_STATUS_FORMAT},
        {"#usda 1.0\n" CAMERA("float3 xformOp:scale = (1, 1, -1)\n" ORDER("\"xformOp:scale\"")),
         "its transform mirrors it; remove the negative scale", SGS_STATUS_UNSUPPORTED},
        {"#usda 1.0\n" CAMERA("float3 xformOp:scale = (1, 1, 2)\n" ORDER("\"xformOp:scale\"")),
         "a shear or a scale that is not uniform", SGS_STATUS_UNSUPPORTED},
        {RANGE(4, 3) CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")),
         "startTimeCode, 4, is after endTimeCode, 3", SGS_STATUS_FORMAT},
        {RANGE(-1000001, 3) CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")),
         "the time codes -1000001 to 3; frames are numbered from -1000000 to 1000000: set",
         SGS_STATUS_LIMIT},
        {RANGE(1, 1e300) CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")),
         "the time codes 1 to 1e+300", SGS_STATUS_LIMIT},
        {RANGE(1, inf) CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")), "the time codes 1 to inf",
         SGS_STATUS_LIMIT},
        {"#usda 1.0\n" CAMERA(CENTERS("1: (0, 0, 0), 3e9: (1, 1, 1)")), "the time codes 1 to 3e+09",
         SGS_STATUS_LIMIT},
        {RANGE(0, 1000000) CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")),
         "its cameras have more than 100000 frames", SGS_STATUS_LIMIT},
        {"#usda 1.0\n(\ntimeCodesPerSecond = 0\n)\n" CAMERA(CENTERS("1: (0, 0, 0), 3: (1, 1, 1)")),
         "timeCodesPerSecond or framesPerSecond, 0, is not from 0.01 to 1000", SGS_STATUS_FORMAT},
        {"#usda 1.0\ndef Camera\n{\n}\n", "line 3: the camera, or a prim above it, has no valid",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\ndef Xform \"../a\"\n{\n" CAMERA("") "}\n", "has no valid name",
         SGS_STATUS_FORMAT},
        {"#usda 1.0\ndef Camera \"C\"\n{\n", "the file ends inside a prim", SGS_STATUS_FORMAT},
        {"#usda 1.0\n}", "'}' without '{'", SGS_STATUS_FORMAT},
        {"PXR-USDC\0", "is binary OpenUSD, which is not read; convert it to text with 'usdcat ",
         SGS_STATUS_UNSUPPORTED},
        {"def Camera", "is not OpenUSD text: it does not begin with #usda", SGS_STATUS_FORMAT},
    };
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.usda");
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        file_put(path, cases[k].text, strlen(cases[k].text));
        refused(path, cases[k].status, cases[k].message);
    }
    refused(temp_path(&folder, "missing.usda"), SGS_STATUS_IO, "");
    sgs_usd_cameras *cameras;
    assert_int_equal(sgs_usd_cameras_read(path, 0, 48, &cameras), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_usd_cameras_read(path, 64, 65537, &cameras), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(cameras);
    temp_folder_remove(&folder);
}

static void large_files_are_limited(void **state)
{
    (void)state;
    static const char camera[] = "def Camera \"C\" {}\n";
    enum { CAMERAS = 100001, NAME = 600 };
    const size_t length = sizeof camera - 1;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.usda");
    char *text = malloc(CAMERAS * length + 16);
    memcpy(text, "#usda 1.0\n", 10);
    for (size_t k = 0; k < CAMERAS; ++k)
        memcpy(text + 10 + k * length, camera, length);
    file_put(path, text, 10 + CAMERAS * length);
    refused(path, SGS_STATUS_LIMIT, "contains more than 100000 cameras");
    file_put(path, text, 10 + (CAMERAS - 1) * length);
    sgs_usd_cameras *cameras;
    assert_int_equal(sgs_usd_cameras_read(path, WIDTH, HEIGHT, &cameras), 0);
    assert_int_equal(cameras->count, CAMERAS - 1);
    sgs_usd_cameras_destroy(cameras);
    memset(text, 'n', NAME);
    char *nested = malloc(3 * NAME);
    snprintf(nested, 3 * NAME, "#usda 1.0\ndef \"%.*s\" { def Camera \"%.*s\" {} }", NAME, text,
             NAME, text);
    file_put(path, nested, strlen(nested));
    refused(path, SGS_STATUS_FORMAT, "line 2: the path of the camera is longer than 1000 bytes");
    free(nested);
    free(text);
    temp_folder_remove(&folder);
}

static void packages_are_read(void **state)
{
    (void)state;
    static const char text[] = "#usda 1.0\n" CAMERA(""), binary[] = "PXR-USDC\0\10\0\0\0\0\0\0";
    const char *files[2][2] = {{"a.usda", text}, {"0.png", "pixels"}};
    size_t sizes[2] = {sizeof text - 1, 6};
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.usdz");
    unsigned char zip[4096];
    sgs_usd_cameras *cameras;
    file_put(path, zip, usdz_bytes(zip, files, sizes));
    assert_int_equal(sgs_usd_cameras_read(path, WIDTH, HEIGHT, &cameras), 0);
    assert_string_equal(cameras->cameras[0].path, "C");
    sgs_usd_cameras_destroy(cameras);
    files[0][0] = "a.usdc";
    files[0][1] = binary;
    sizes[0] = sizeof binary - 1;
    file_put(path, zip, usdz_bytes(zip, files, sizes));
    refused(path, SGS_STATUS_UNSUPPORTED, "contains binary OpenUSD, which is not read; convert it");
    temp_folder_remove(&folder);
}

static void reading_survives_failed_allocations(void **state)
{
    (void)state;
    static const char text[] = RANGE(1, 20) "def Xform \"W\"\n{\n" CAMERA(
        CENTERS("1: (0, 0, 0), 3: (1, 1, 1), 4: (1, 2, 3)")
            SAMPLES("float focalLength", "1: 5, 2: 6")) "float xformOp:rotateX = 3\n" //
        ORDER("\"xformOp:rotateX\"") CAMERA("") "}\n";
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.usda");
    sgs_usd_cameras *cameras = NULL;
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    size_t n = 0;
    file_put(path, text, sizeof text - 1);
    while (status == SGS_STATUS_OUT_OF_MEMORY) {
        assert_null(cameras);
        sgsi_fail_allocation(++n);
        status = sgs_usd_cameras_read(path, WIDTH, HEIGHT, &cameras);
    }
    sgsi_fail_allocation(0);
    assert_int_equal(status, 0);
    assert_true(n > 12);
    sgs_usd_cameras_destroy(cameras);
    sgs_usd_cameras_destroy(NULL);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transforms_place_the_camera),
        cmocka_unit_test(cameras_fit_the_model_of_the_stage),
        cmocka_unit_test(frames_are_evaluated_at_their_time_codes),
        cmocka_unit_test(rates_are_time_codes_per_second),
        cmocka_unit_test(the_film_is_the_lens),
        cmocka_unit_test(active_perspective_cameras_are_read),
        cmocka_unit_test(others_are_refused),
        cmocka_unit_test(large_files_are_limited),
        cmocka_unit_test(packages_are_read),
        cmocka_unit_test(reading_survives_failed_allocations),
    };
    return cmocka_run_group_tests(tests, warnings_begin, NULL);
}
