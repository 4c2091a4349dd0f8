// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// What EXR files say about their pixels, in files made byte by byte: which of many layers is the
// photo, its colour space, against its definition in double precision, and its place in the
// camera's picture.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/compare.h"
#include "image/image_oiio.h"
#include "support/bad_input.h"
#include "support/exr_bytes.h"
#include "support/scene_support.h"

static void keep_pixel(void *context, int y, const float *row)
{
    (void)y;
    memcpy(context, row, 3 * sizeof *row);
}

// Writes one pixel whose channels are 1, 2, 3, ... and reads its colours.
static void read_layers(const temp_folder *folder, const char *const *names, int count,
                        sgsi_image_info *info, float pixel[3])
{
    static const float values[12] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
    exr_file file = {.width = 1, .height = 1, .count = count};
    for (int c = 0; c < count; ++c) {
        file.names[c] = names[c];
        file.planes[c] = &values[c];
    }
    exr_put(folder, "a.exr", &file);
    const char *path = temp_path(folder, "a.exr");
    if (sgsi_oiio_describe(path, NULL, info))
        fail_msg("%s", sgs_last_error());
    if (sgsi_oiio_read_rows(path, NULL, keep_pixel, pixel))
        fail_msg("%s", sgs_last_error());
}

// Channels are sorted by name, so layers of light passes come before the picture.
static void the_layer_of_the_picture_is_preferred(void **state)
{
    (void)state;
    static const struct {
        const char *names[12];
        int count;
        float expected[3];
        const char *note; // NULL = none
    } cases[] = {
        // Blender.
        {{"ViewLayer.AO.B", "ViewLayer.AO.G", "ViewLayer.AO.R", "ViewLayer.Combined.A",
          "ViewLayer.Combined.B", "ViewLayer.Combined.G", "ViewLayer.Combined.R",
          "ViewLayer.Depth.Z"},
         8,
         {7, 6, 5},
         "2 layers have R, G and B; 'ViewLayer.Combined' is used"},
        // Lower case, and three layers.
        {{"albedo.B", "albedo.G", "albedo.R", "beauty.b", "beauty.g", "beauty.r", "spec.B",
          "spec.G", "spec.R"},
         9,
         {6, 5, 4},
         "3 layers have R, G and B; 'beauty' is used"},
        // The first of two pictures; a component that begins with a name of a picture is another.
        {{"RGBs.B", "RGBs.G", "RGBs.R", "a.RGBA.B", "a.RGBA.G", "a.RGBA.R", "b.Composite.B",
          "b.Composite.G", "b.Composite.R"},
         9,
         {6, 5, 4},
         "3 layers have R, G and B; 'a.RGBA' is used"},
        // No layer of that name: the first one. A layer without G does not count.
        {{"Combined.B", "Combined.R", "diffuse.B", "diffuse.G", "diffuse.R", "gloss.B", "gloss.G",
          "gloss.R"},
         8,
         {5, 4, 3},
         "2 layers have R, G and B; 'diffuse' is used"},
        // The main layer needs no name, a single layer no note.
        {{"B", "Combined.B", "Combined.G", "Combined.R", "G", "R"}, 6, {6, 5, 1}, NULL},
        {{"any.B", "any.G", "any.R", "depth.Z"}, 4, {3, 2, 1}, NULL},
        {{"Y", "any.B", "any.G", "any.R"}, 4, {4, 3, 2}, NULL},
        {{"Y", "any.G", "any.R"}, 3, {1, 1, 1}, NULL},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        sgsi_image_info info;
        float pixel[3];
        read_layers(&folder, cases[i].names, cases[i].count, &info, pixel);
        for (int c = 0; c < 3; ++c)
            if (pixel[c] != cases[i].expected[c])
                fail_msg("case %zu, channel %d: %g, expected %g", i, c, (double)pixel[c],
                         (double)cases[i].expected[c]);
        if (cases[i].note)
            assert_holds(info.notes[SGSI_NOTE_LAYER], cases[i].note);
        else
            assert_string_equal(info.notes[SGSI_NOTE_LAYER], "");
    }
    tree_remove(&folder);
}

static void a_scene_warns_once_of_layers(void **state)
{
    (void)state;
    enum { SIDE = 8 };
    static float plane[SIDE * SIDE];
    static const char *const names[] = {"AO.B", "AO.G", "AO.R", "beauty.B", "beauty.G", "beauty.R"};
    const temp_folder folder = temp_folder_make();
    exr_file file = {.width = SIDE, .height = SIDE, .count = 6};
    for (int c = 0; c < 6; ++c) {
        file.names[c] = names[c];
        file.planes[c] = plane;
    }
    exr_put(&folder, "a.exr", &file);
    exr_put(&folder, "b.exr", &file);
    exr_put(&folder, "c.exr", &file);
    tree_put_text(&folder, "transforms.json",
                  "{\"camera_angle_x\":1,\"frames\":["
                  "{\"file_path\":\"a.exr\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]},"
                  "{\"file_path\":\"b.exr\",\"transform_matrix\":[[1,0,0,1],[0,1,0,0],[0,0,1,0]]},"
                  "{\"file_path\":\"c.exr\",\"transform_matrix\":[[1,0,0,2],[0,1,0,0],[0,0,1,0]]}"
                  "]}");
    sgs_scene *scene;
    if (sgs_scene_load(folder.path, NULL, &scene))
        fail_msg("%s", sgs_last_error());
    assert_holds(warnings, "a.exr: 2 layers have R, G and B; 'beauty' is used; to select another "
                           "one, name it Combined (and 2 other images)\n");
    assert_null(strstr(strstr(warnings, "layers have") + 1, "layers have"));
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

typedef struct part_rows {
    int next, channels;
    float values[8];
} part_rows;

static void keep_part_row(void *context, int y, const float *row)
{
    part_rows *rows = context;
    assert_int_equal(y, rows->next++);
    memcpy(rows->values + 2 * y * rows->channels, row,
           2 * (size_t)rows->channels * sizeof *rows->values);
}

// Each part is a layer; the picture may be in any part, whose size and attributes are its own.
static void parts_are_layers(void **state)
{
    (void)state;
    static const float ones[4] = {1, 1, 1, 1}, planes[4][2] = {{1, 0.5f}, {3, 4}, {5, 6}, {7, 8}};
    const exr_file normals = {.part = "normals",
                              .width = 2,
                              .height = 2,
                              .count = 3,
                              .names = {"B", "G", "R"},
                              .planes = {ones, ones, ones}},
                   depth = {.part = "depth",
                            .width = 2,
                            .height = 2,
                            .count = 1,
                            .names = {"Z"},
                            .planes = {ones}},
                   picture = {.part = "ViewLayer.Combined",
                              .data = {1, 1, 2, 1},
                              .display = {0, 0, 3, 2},
                              .width = 2,
                              .height = 1,
                              .count = 4,
                              .names = {"A", "B", "G", "R"},
                              .planes = {planes[0], planes[1], planes[2], planes[3]},
                              .interop = "lin_rec709_scene"},
                   grey = {.part = "grey",
                           .display = {0, 0, 1, 1},
                           .width = 2,
                           .height = 1,
                           .count = 1,
                           .names = {"Y"},
                           .planes = {planes[1]}};
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.exr");
    exr_file parts[3] = {normals, depth, picture};
    sgsi_image_info info;
    for (int k = 0; k < 2; ++k)
        for (int i = 0; i < 4; ++i)
            parts[k].display[i] = picture.display[i]; // shared by all parts
    exr_put_parts(&folder, "a.exr", parts, 3);
    if (sgsi_oiio_describe(path, NULL, &info))
        fail_msg("%s", sgs_last_error());
    assert_true(info.width == 2 && info.height == 1 && info.channels == 4 && info.left == 1);
    assert_string_equal(info.notes[SGSI_NOTE_LAYER],
                        "2 layers have R, G and B; 'ViewLayer.Combined' is used; to select another "
                        "one, name it Combined");
    part_rows rows = {.channels = 4};
    assert_int_equal(sgsi_oiio_read_rows(path, NULL, keep_part_row, &rows), SGS_STATUS_OK);
    assert_memory_equal(rows.values, ((const float[]){7, 5, 3, 1, 8, 6, 4, 0.5f}),
                        8 * sizeof(float));
    exr_put_parts(&folder, "a.exr", (const exr_file[]){depth, grey}, 2);
    rows = (part_rows){.channels = 3};
    if (sgsi_oiio_read_rows(path, NULL, keep_part_row, &rows))
        fail_msg("%s", sgs_last_error());
    assert_memory_equal(rows.values, ((const float[]){3, 3, 3, 4, 4, 4}), 6 * sizeof(float));
    exr_file other = depth;
    other.part = "fog";
    exr_put_parts(&folder, "a.exr", (const exr_file[]){depth, other}, 2);
    assert_int_equal(sgsi_oiio_describe(path, NULL, &info), SGS_STATUS_UNSUPPORTED);
    assert_holds(sgs_last_error(), "a.exr: no colour channels R, G, B or Y; the channels are "
                                   "depth.Z, fog.Z");
    bad_input();
    tree_remove(&folder);
}

// To Rec. 709 by Bradford's cone responses, in rational arithmetic (Python) from the chromaticities
// of the recommendation.
static const double matrices[6][3][3] = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
    {{2.5216862, -1.1341310, -0.3875552}, // AP0
     {-0.2764799, 1.3727191, -0.0962392},
     {-0.0153781, -0.1529753, 1.1683534}},
    {{1.7050510, -0.6217921, -0.0832589}, // AP1
     {-0.1302564, 1.1408047, -0.0105483},
     {-0.0240034, -0.1289690, 1.1529723}},
    {{1.2249402, -0.2249402, 0}, {-0.0420570, 1.0420570, 0}, {-0.0196376, -0.0786360, 1.0982736}},
    {{1.6604910, -0.5876411, -0.0728499}, // Rec. 2020
     {-0.1245505, 1.1328999, -0.0083494},
     {-0.0181508, -0.1005789, 1.1187297}},
    {{1.3983557, -0.3983557, 0}, {0, 1, 0}, {0, -0.0429290, 1.0429290}}}; // Adobe RGB
enum { REC709, AP0, AP1, P3, REC2020, ADOBE };

// The transfer functions of the recommendation: sRGB if gamma is 0. Powers leave negative values.
static double decoded(double v, double gamma)
{
    if (gamma > 0)
        return v > 0 ? pow(v, gamma) : v;
    return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

enum { COLORS = 3 };
static const float colors[COLORS][3] = {
    {0.5f, 0.2f, 0.8f}, {2.5f, 0.03f, 0.6f}, {0.9f, -0.01f, 0.4f}};

// A row of these colours, premultiplied by `alpha` unless it is 0.
static void put_colors(const temp_folder *folder, const char *interop, const float *chromaticities,
                       float alpha)
{
    static const char *const names[] = {"A", "B", "G", "R"};
    float planes[4][COLORS];
    const int first = alpha > 0 ? 0 : 1;
    exr_file file = {.width = COLORS,
                     .height = 1,
                     .count = 4 - first,
                     .interop = interop,
                     .chromaticities = chromaticities};
    for (int c = 0; c < 4; ++c)
        for (int x = 0; x < COLORS; ++x)
            planes[c][x] = c ? colors[x][3 - c] * (first ? 1.0f : alpha) : alpha;
    for (int c = first; c < 4; ++c) {
        file.names[c - first] = names[c];
        file.planes[c - first] = planes[c];
    }
    exr_put(folder, "a.exr", &file);
}

typedef struct kept_row {
    int channels;
    float values[4 * COLORS];
} kept_row;

static void keep_row(void *context, int y, const float *row)
{
    kept_row *kept = context;
    assert_int_equal(y, 0);
    memcpy(kept->values, row, (size_t)(COLORS * kept->channels) * sizeof *row);
}

// Compares the file's colours, read with this option, with the definition of the space. gamma < 0:
// sRGB of Rec. 709, which stays encoded.
static void assert_colors(const temp_folder *folder, const char *option, const char *what,
                          const double matrix[3][3], double gamma, float alpha)
{
    const char *path = temp_path(folder, "a.exr");
    sgsi_image_info info;
    kept_row row = {.channels = alpha > 0 ? 4 : 3};
    if (sgsi_oiio_describe(path, option, &info) ||
        sgsi_oiio_read_rows(path, option, keep_row, &row))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(info.channels, row.channels);
    assert_int_equal(info.linear, gamma >= 0);
    for (int x = 0; x < COLORS; ++x)
        for (int c = 0; c < 3; ++c) {
            double expected = 0;
            for (int k = 0; k < 3; ++k)
                expected += matrix[c][k] * (gamma < 0 ? (double)colors[x][k]
                                                      : decoded((double)colors[x][k], gamma));
            expected *= alpha > 0 ? (double)alpha : 1.0;
            const double value = (double)row.values[x * row.channels + c];
            if (!(fabs(value - expected) <= 2e-6 * fmax(1, fabs(expected))))
                fail_msg("%s, colour %d, channel %d: %.7f, expected %.7f", what, x, c, value,
                         expected);
        }
}

static const struct {
    const char *id;
    int matrix;
    double gamma;
} spaces[] = {
    {"lin_rec709_scene", REC709, 1},     {"lin_ap0_scene", AP0, 1},
    {"lin_ap1_scene", AP1, 1},           {"lin_p3d65_scene", P3, 1},
    {"lin_rec2020_scene", REC2020, 1},   {"lin_adobergb_scene", ADOBE, 1},
    {"srgb_rec709_scene", REC709, -1},   {"srgb_p3d65_scene", P3, 0},
    {"srgb_ap1_scene", AP1, 0},          {"g24_rec709_scene", REC709, 2.4},
    {"g22_rec709_scene", REC709, 2.2},   {"g18_rec709_scene", REC709, 1.8},
    {"g22_ap1_scene", AP1, 2.2},         {"g22_adobergb_scene", ADOBE, 563.0 / 256},
    {"srgb_rec709_display", REC709, -1},
};

// The IDs of "Color Space Encodings for Texture Assets and CG Rendering" 1.1, except
// lin_ciexyzd65_scene; also as option colorspace.
static void interop_ids_name_curve_and_primaries(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (size_t i = 0; i < sizeof spaces / sizeof *spaces; ++i)
        for (int k = 0; k < 4; ++k) {
            const float alpha = k % 2 ? 0.25f : 0.0f;
            const char *option = k / 2 ? spaces[i].id : NULL;
            put_colors(&folder, option ? NULL : spaces[i].id, NULL, alpha);
            assert_colors(&folder, option, spaces[i].id, matrices[spaces[i].matrix],
                          spaces[i].gamma, alpha);
        }
    tree_remove(&folder);
}

static void contradictions_and_unknown_ids_are_noted(void **state)
{
    (void)state;
    static const float ap1[8] = {0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};
    static const float rounded[8] = {0.713f, 0.293f, 0.165f,  0.83f,
                                     0.128f, 0.044f, 0.3217f, 0.3377f};
    static const struct {
        const char *id;
        const float *chromaticities;
        int matrix;
        double gamma;
        const char *note;
    } cases[] = {
        {"lin_ap1_scene", rounded, AP1, 1, ""},
        {"srgb_ap1_scene", ap1, AP1, 0, ""},
        {"lin_rec709_scene", ap1, REC709, 1,
         "colorInteropID 'lin_rec709_scene' contradicts the attribute chromaticities, which is "
         "ignored; set option colorspace to linear to use it instead"},
        {"srgb_rec709_scene", ap1, REC709, -1,
         "colorInteropID 'srgb_rec709_scene' contradicts the attribute chromaticities"},
        {"pq_rec2020_display", NULL, REC709, 1,
         "colorInteropID 'pq_rec2020_display' is unknown; the colours are read as linear light; "
         "name their space with option colorspace"},
        {"lin_ap1_scenery", ap1, AP1, 1, "colorInteropID 'lin_ap1_scenery' is unknown"},
        {"lin_ap11", NULL, REC709, 1, "colorInteropID 'lin_ap11' is unknown"},
        {"line\nbreak", NULL, REC709, 1, "colorInteropID 'line break' is unknown"},
        {"data", NULL, REC709, 1, "colorInteropID 'data' is unknown"},
        {"unknown", ap1, AP1, 1, ""},
        {NULL, ap1, AP1, 1, ""},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        sgsi_image_info info;
        put_colors(&folder, cases[i].id, cases[i].chromaticities, 0.5f);
        assert_int_equal(sgsi_oiio_describe(temp_path(&folder, "a.exr"), NULL, &info),
                         SGS_STATUS_OK);
        if (*cases[i].note)
            assert_holds(info.notes[SGSI_NOTE_COLOR], cases[i].note);
        else
            assert_string_equal(info.notes[SGSI_NOTE_COLOR], "");
        assert_colors(&folder, NULL, cases[i].note, matrices[cases[i].matrix], cases[i].gamma,
                      0.5f);
    }
    // The user decides: by the chromaticities, or without both attributes, and without a note.
    sgsi_image_info info;
    put_colors(&folder, "lin_rec709_scene", ap1, 0.5f);
    assert_colors(&folder, "linear", "linear", matrices[AP1], 1, 0.5f);
    assert_colors(&folder, "lin_rec2020_scene", "option", matrices[REC2020], 1, 0.5f);
    assert_colors(&folder, "lin_rec709", "option", matrices[REC709], 1, 0.5f);
    assert_int_equal(sgsi_oiio_describe(temp_path(&folder, "a.exr"), "linear", &info),
                     SGS_STATUS_OK);
    assert_string_equal(info.notes[SGSI_NOTE_COLOR], "");
    tree_remove(&folder);
}

enum { SHOWN_WIDTH = 10, SHOWN_HEIGHT = 8 };

typedef struct window_case {
    int data[4]; // relative to the display window
    bool alpha;
    const char *size; // of the camera, or ""
} window_case;

static float window_value(int c, int x, int y)
{
    return (float)(x + 16 + 40 * (y + 16) + 3000 * c) / 16384.0f;
}

// Straight colour c (3 = alpha) of a pixel of the display window.
static double window_expected(const window_case *w, int c, int x, int y)
{
    const bool inside = x >= w->data[0] && x <= w->data[2] && y >= w->data[1] && y <= w->data[3];
    return !inside ? 0 : c < 3 ? (double)window_value(c, x, y) : w->alpha ? 0.5 : 1;
}

// A scene whose only photo has this data window; the display window begins at (-2, 5).
static temp_folder put_window(const window_case *w)
{
    static const char *const names[] = {"A", "B", "G", "R"};
    static float planes[4][32 * 32];
    const temp_folder folder = temp_folder_make();
    exr_file file = {.width = w->data[2] - w->data[0] + 1,
                     .height = w->data[3] - w->data[1] + 1,
                     .display = {-2, 5, SHOWN_WIDTH - 3, SHOWN_HEIGHT + 4},
                     .interop = "lin_rec709_scene"};
    for (int k = 0; k < 4; ++k)
        file.data[k] = w->data[k] + (k % 2 ? 5 : -2);
    for (int c = w->alpha ? 0 : 1; c < 4; ++c) {
        for (int y = 0; y < file.height; ++y)
            for (int x = 0; x < file.width; ++x)
                planes[c][y * file.width + x] =
                    c ? window_value(3 - c, x + w->data[0], y + w->data[1]) *
                            (w->alpha ? 0.5f : 1.0f)
                      : 0.5f;
        file.names[file.count] = names[c];
        file.planes[file.count++] = planes[c];
    }
    exr_put(&folder, "a.exr", &file);
    char text[512];
    snprintf(text, sizeof text,
             "{\"camera_angle_x\":1,%s\"frames\":[{\"file_path\":\"a.exr\","
             "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}",
             w->size);
    tree_put_text(&folder, "transforms.json", text);
    return folder;
}

static double photo_at(const sgs_photo *photo, int c, int x, int y)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    return (double)sgs_photo_value(photo, (size_t)c * plane + (size_t)(y * photo->width + x));
}

// A photo of which nothing is missing gets no alpha.
static bool has_alpha(const window_case *w)
{
    return w->alpha || w->data[0] > 0 || w->data[1] > 0 || w->data[2] < SHOWN_WIDTH - 1 ||
           w->data[3] < SHOWN_HEIGHT - 1;
}

// Compares a photo reduced by `factor` with the mean of the display window, weighted by alpha.
static void assert_window(const window_case *w, const sgs_photo *photo, int factor)
{
    const int channels = has_alpha(w) ? 4 : 3;
    assert_int_equal(photo->channels, channels);
    assert_int_equal(photo->width, SHOWN_WIDTH / factor);
    assert_int_equal(photo->height, SHOWN_HEIGHT / factor);
    for (int y = 0; y < photo->height; ++y)
        for (int x = 0; x < photo->width; ++x)
            for (int c = 0; c < channels; ++c) {
                double sum = 0, weight = 0;
                for (int k = 0; k < factor * factor; ++k) {
                    const int i = x * factor + k % factor, j = y * factor + k / factor;
                    const double alpha = window_expected(w, 3, i, j);
                    sum += c == 3 ? alpha : alpha * window_expected(w, c, i, j);
                    weight += c == 3 ? 1 : alpha;
                }
                const double expected = weight > 0 ? sum / weight : 0;
                if (!(fabs(photo_at(photo, c, x, y) - expected) <= 1e-3 * expected))
                    fail_msg("channel %d at (%d, %d): %.6f, expected %.6f", c, x, y,
                             photo_at(photo, c, x, y), expected);
            }
}

// The camera's field of view is that of the display window: crops, larger and shifted data windows,
// with and without a size in the camera file.
static void data_windows_are_placed_in_the_display_window(void **state)
{
    (void)state;
    static const window_case cases[] = {
        {{3, 2, 6, 4}, false, ""},    {{3, 2, 6, 4}, true, "\"w\":10,\"h\":8,"},
        {{-4, -3, 12, 9}, false, ""}, {{-1, -1, 10, 8}, true, "\"w\":20,\"h\":16,"},
        {{-3, 1, 6, 8}, false, ""},   {{2, -2, 11, 5}, true, "\"w\":10,\"h\":8,"},
        {{0, 0, 9, 3}, false, ""},    {{12, 10, 15, 12}, false, ""}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i)
        for (int k = 0; k < 4; ++k) {
            const temp_folder folder = put_window(&cases[i]);
            sgs_scene_options options = sgs_scene_options_default();
            options.space = SGS_SPACE_LINEAR;
            options.white_point = 1;
            options.downscale = k % 2 ? 2 : 1;
            options.image_cache = k / 2; // 1 byte: decoded when it is used
            sgs_scene *scene;
            if (sgs_scene_load(folder.path, &options, &scene))
                fail_msg("case %zu: %s", i, sgs_last_error());
            const sgs_camera *camera = &scene->views[0].camera;
            const double focal = 0.5 * SHOWN_WIDTH / tan(0.5) / options.downscale;
            assert_int_equal(camera->width, SHOWN_WIDTH / options.downscale);
            assert_int_equal(camera->height, SHOWN_HEIGHT / options.downscale);
            assert_true(fabs(camera->params[0] - focal) < 1e-9 * focal);
            assert_true(fabs(camera->params[2] - 0.5 * camera->width) < 1e-9);
            const sgs_photo *photo;
            sgs_photo read;
            assert_int_equal(sgs_scene_photo(scene, 0, &photo), SGS_STATUS_OK);
            assert_window(&cases[i], photo, options.downscale);
            assert_int_equal(sgs_scene_photo_read(scene, 0, camera->width, camera->height, &read),
                             SGS_STATUS_OK);
            assert_window(&cases[i], &read, options.downscale);
            sgs_photo_free(&read);
            assert_true(scene->has_alpha == has_alpha(&cases[i]));
            assert_string_equal(warnings, "");
            sgs_scene_destroy(scene);
            tree_remove(&folder);
        }
}

// Overscan is brighter than the picture, and does not count.
static void the_white_point_is_that_of_the_display_window(void **state)
{
    (void)state;
    static const window_case cases[] = {{{-4, -3, 12, 28}, false, ""}, {{3, 2, 20, 28}, false, ""}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const int *data = cases[i].data;
        float shown[SHOWN_WIDTH * SHOWN_HEIGHT];
        size_t count = 0;
        for (int y = data[1] > 0 ? data[1] : 0; y < SHOWN_HEIGHT; ++y)
            for (int x = data[0] > 0 ? data[0] : 0; x < SHOWN_WIDTH; ++x)
                shown[count++] = window_value(2, x, y); // the brightest channel
        qsort(shown, count, sizeof *shown, sgsi_compare_floats);
        const double white = (double)shown[(size_t)ceil(0.99 * (double)count) - 1];
        const temp_folder folder = put_window(&cases[i]);
        sgs_scene_options options = sgs_scene_options_default();
        options.space = SGS_SPACE_LINEAR;
        sgs_scene *scene;
        assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
        // Samples are half floats, and the quantile is the upper edge of a bin.
        assert_in_range(scene->white_point / white * 1e6, 0.999e6, 1.001e6 * exp2(1.0 / 32));
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

// Cameras of the data window: as made by programs that ignore the display window.
static void cameras_of_the_data_window_keep_it(void **state)
{
    (void)state;
    const window_case cropped = {{3, 2, 8, 4}, false, "\"w\":6,\"h\":3,"};
    const temp_folder folder = put_window(&cropped);
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_OK);
    assert_true(scene->views[0].camera.width == 6 && scene->views[0].image.width == 6 &&
                scene->views[0].image.channels == 3);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// A display window of 65537 pixels, in a file of a few bytes.
static void large_display_windows_are_refused(void **state)
{
    (void)state;
    static const float plane[1];
    const temp_folder folder = temp_folder_make();
    const exr_file file = {.width = 1,
                           .height = 1,
                           .display = {0, 0, 65536, 1},
                           .count = 3,
                           .names = {"B", "G", "R"},
                           .planes = {plane, plane, plane}};
    exr_put(&folder, "a.exr", &file);
    tree_put_text(&folder, "transforms.json",
                  "{\"camera_angle_x\":1,\"frames\":[{\"file_path\":\"a.exr\","
                  "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}");
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "a.exr: its display window of 65537 x 2 pixels exceeds");
    bad_input();
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(interop_ids_name_curve_and_primaries),
        cmocka_unit_test(contradictions_and_unknown_ids_are_noted),
        cmocka_unit_test_setup(data_windows_are_placed_in_the_display_window, warnings_begin),
        cmocka_unit_test_setup(the_white_point_is_that_of_the_display_window, warnings_begin),
        cmocka_unit_test_setup(cameras_of_the_data_window_keep_it, warnings_begin),
        cmocka_unit_test_setup(large_display_windows_are_refused, warnings_begin),
        cmocka_unit_test(parts_are_layers),
        cmocka_unit_test(the_layer_of_the_picture_is_preferred),
        cmocka_unit_test_setup(a_scene_warns_once_of_layers, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
