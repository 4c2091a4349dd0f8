// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// What EXR files say about their pixels, in files made byte by byte: which of many layers is the
// photo.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "image/image_oiio.h"
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_layer_of_the_picture_is_preferred),
        cmocka_unit_test_setup(a_scene_warns_once_of_layers, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
