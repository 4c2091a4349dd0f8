// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Colour spaces of photos: those encoded for display keep 1 as white, scene-linear ones are exposed
// by the white level of the scene; names of OpenColorIO configurations are resolved by them.
// References: the published transfer functions, and matrices from the chromaticities.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "image/half.h"
#include "image/image_oiio.h"
#include "support/ocio_config.h"
#include "support/png_bytes.h"
#include "support/scene_support.h"

static double srgb_decoded(double v)
{
    return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

static double srgb_encoded(double v)
{
    return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
}

static double bt709_decoded(double v)
{
    return v < 0.081 ? v / 4.5 : pow((v + 0.099) / 1.099, 1 / 0.45);
}

static double power_decoded(double v, double gamma)
{
    return pow(v, gamma);
}

// ---- Display-encoded and scene-linear files ----

// A scene of PNG files of one colour. gama: see png_file.
static sgs_scene *load_pictures(const temp_folder *folder, const uint8_t *color, uint32_t gama,
                                const sgs_scene_options *options)
{
    enum { WIDTH = 64, HEIGHT = 48 };
    const model m = model_make();
    sgs_scene *scene;
    uint16_t values[3 * WIDTH * HEIGHT];
    for (int i = 0; i < 3 * WIDTH * HEIGHT; ++i)
        values[i] = color[i % 3];
    for (int i = 0; i < m.image_count; ++i) {
        char name[64];
        snprintf(name, sizeof name, "images/%s", m.images[i].name);
        png_put(folder, name, &(png_file){WIDTH, HEIGHT, 3, 8, gama, values});
    }
    model_put(folder, "sparse/0/", &m, true);
    if (sgs_scene_load(folder->path, options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

static const double p3[3][3] = {
    {1.2249402, -0.2249402, 0}, {-0.0420570, 1.0420570, 0}, {-0.0196376, -0.0786360, 1.0982736}};
static const double adobe[3][3] = {
    {1.3983557, -0.3983557, 0}, {0, 1, 0}, {0, -0.0429290, 1.0429290}};
static const double ap1[3][3] = {{1.7050510, -0.6217921, -0.0832589},
                                 {-0.1302564, 1.1408047, -0.0105483},
                                 {-0.0240034, -0.1289690, 1.1529723}};
static const double rec709[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

enum curve { SRGB, BT709, POWER };

static const struct {
    const char *option; // NULL = from the chunk gAMA
    uint32_t gama;      // 100000 times the encoding's exponent
    const double (*matrix)[3];
    enum curve curve;
    double gamma;
} displays[] = {
    {"srgb_p3d65_display", 0, p3, SRGB, 0},
    {"g22_adobergb_display", 0, adobe, POWER, 563.0 / 256},
    {"g24_rec709_display", 0, rec709, POWER, 2.4},
    {"Rec709", 0, rec709, BT709, 0},
    {NULL, 55556, rec709, POWER, 1.8},
};

static double display_decoded(size_t k, double v)
{
    return displays[k].curve == SRGB    ? srgb_decoded(v)
           : displays[k].curve == BT709 ? bt709_decoded(v)
                                        : power_decoded(v, displays[k].gamma);
}

// Dark grey stays dark grey: the brightest pixel of the photos does not become white.
static void display_encoded_photos_keep_their_white(void **state)
{
    (void)state;
    // The last one is outside of the gamut of Rec. 709 in some spaces: models reach 1 at most.
    static const uint8_t colors[3][3] = {{64, 64, 64}, {120, 60, 40}, {255, 10, 10}};
    for (size_t k = 0; k < sizeof displays / sizeof *displays; ++k)
        for (int n = 0; n < 3; ++n) {
            const temp_folder folder = temp_folder_make();
            sgs_scene_options options = sgs_scene_options_default();
            options.colorspace = displays[k].option;
            options.white_point = n ? 0.01 : 0; // has no effect on them
            sgs_scene *scene = load_pictures(&folder, colors[n], displays[k].gama, &options);
            assert_true(n || scene->white_point == 1);
            assert_int_equal(scene->linear_images, 0);
            const sgs_photo *photo = &scene->views[0].image;
            assert_true(photo->halves && !photo->is_hdr);
            const size_t plane = (size_t)photo->width * (size_t)photo->height;
            for (size_t c = 0; c < 3; ++c) {
                double light = 0;
                for (int i = 0; i < 3; ++i)
                    light += displays[k].matrix[c][i] * display_decoded(k, colors[n][i] / 255.0);
                const double value = (double)sgsi_half_to_float(photo->halves[c * plane + 5]),
                             expected = srgb_encoded(fmin(fmax(light, 0), 1));
                if (!(fabs(value - expected) <= 5e-4))
                    fail_msg("%s, channel %zu: %.5f, expected %.5f",
                             displays[k].option ? displays[k].option : "gAMA", c, value, expected);
            }
            sgs_scene_destroy(scene);
            tree_remove(&folder);
        }
}

// A gamma of 1 marks linear light, whatever the type of the samples.
static void linear_integers_are_exposed(void **state)
{
    (void)state;
    static const uint8_t color[3] = {64, 64, 64};
    for (int k = 0; k < 3; ++k) {
        const temp_folder folder = temp_folder_make();
        sgs_scene_options options = sgs_scene_options_default();
        options.colorspace = k == 1 ? "linear" : k == 2 ? "lin_p3d65_scene" : NULL;
        sgs_scene *scene = load_pictures(&folder, color, k ? 0 : 100000, &options);
        assert_int_equal(scene->linear_images, scene->view_count);
        // Bins of 1/32 octave.
        assert_true(scene->white_point >= 0.99 * 64 / 255 && scene->white_point < 1.03 * 64 / 255);
        assert_true(scene->views[0].image.is_hdr);
        const double value = (double)sgsi_half_to_float(scene->views[0].image.halves[0]);
        assert_true(fabs(value - 1) < 0.02);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

// ---- Names of a configuration ----

static const char config[] = OCIO_OF_ACESCG
    "  - !<ColorSpace>\n"
    "    name: sRGB Encoded AP1 - Texture\n"
    "    to_scene_reference: !<GroupTransform>\n"
    "      children:\n"
    "        - !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}\n"
    "        - !<MatrixTransform> {matrix: [0.695452241, 0.140678696,"
    " 0.163869062, 0, 0.044794563, 0.859671118, 0.095534318, 0, -0.005525883, 0.00402521,"
    " 1.001500672, 0, 0, 0, 0, 1]}\n"
    "  - !<ColorSpace>\n"
    "    name: Camera Log\n"
    "    to_scene_reference: !<LogTransform> {base: 10, direction: inverse}\n";

static void keep_row(void *context, int y, const float *row)
{
    assert_int_equal(y, 0);
    memcpy(context, row, 9 * sizeof *row);
}

static const uint8_t samples[9] = {200, 60, 60, 10, 120, 240, 64, 64, 64};

static void read_samples(const temp_folder *folder, const char *option, sgsi_image_info *info,
                         float row[9])
{
    const char *path = temp_path(folder, "a.tif");
    if (sgsi_oiio_describe(path, option, info) || sgsi_oiio_read_rows(path, option, keep_row, row))
        fail_msg("%s", sgs_last_error());
}

static void assert_from_ap1(const float row[9], double (*decode)(double))
{
    for (int x = 0; x < 3; ++x)
        for (int c = 0; c < 3; ++c) {
            double expected = 0;
            for (int i = 0; i < 3; ++i)
                expected += ap1[c][i] * decode(samples[3 * x + i] / 255.0);
            if (!(fabs((double)row[3 * x + c] - expected) < 2e-4))
                fail_msg("pixel %d, channel %d: %.6f, expected %.6f", x, c, (double)row[3 * x + c],
                         expected);
        }
}

static double same(double v)
{
    return v;
}

// Names that only begin with sRGB, the role scene_linear, and logarithmic encodings.
static void names_are_those_of_the_configuration(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_image_info info;
    float row[9];
    tiff_put(&folder, "a.tif", &(tiff){3, 1, 3, 8, 2, 1, 0}, samples, sizeof samples);
    tree_put_text(&folder, "config.ocio", config);
    setenv("OCIO", temp_path(&folder, "config.ocio"), 1);
    read_samples(&folder, "sRGB Encoded AP1 - Texture", &info, row);
    assert_from_ap1(row, srgb_decoded);
    assert_true(info.linear && !info.scene_linear);
    read_samples(&folder, "scene_linear", &info, row);
    assert_from_ap1(row, same);
    assert_true(info.linear && info.scene_linear);
    read_samples(&folder, "Camera Log", &info, row); // its code value 1 is 10 times white
    assert_true(info.linear && info.scene_linear);
    // Names of sRGB itself need no configuration.
    static const char *const names[] = {"sRGB",
                                        "srgb_tx",
                                        "sRGB - Texture",
                                        "srgb_texture",
                                        "sRGB Encoded Rec.709 (sRGB)",
                                        "srgb_rec709_display"};
    for (int k = 0; k < 2; ++k) {
        for (size_t n = 0; n < sizeof names / sizeof *names; ++n) {
            read_samples(&folder, names[n], &info, row);
            assert_true(!info.linear && !info.scene_linear);
            for (int i = 0; i < 9; ++i)
                assert_true(fabsf(row[i] - (float)samples[i] / 255) < 1e-6f);
        }
        unsetenv("OCIO");
    }
    // Without a configuration, scene_linear is linear light, and unknown names are errors.
    read_samples(&folder, "scene_linear", &info, row);
    assert_true(info.scene_linear && fabsf(row[0] - 200.0f / 255) < 1e-6f);
    assert_int_equal(sgsi_oiio_describe(temp_path(&folder, "a.tif"), "sRGB in sepia", &info),
                     SGS_STATUS_UNSUPPORTED);
    assert_holds(sgs_last_error(), "a.tif: unknown colour space 'sRGB in sepia'");
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(display_encoded_photos_keep_their_white, warnings_begin),
        cmocka_unit_test_setup(linear_integers_are_exposed, warnings_begin),
        cmocka_unit_test(names_are_those_of_the_configuration),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
