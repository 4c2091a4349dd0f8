// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Photos beyond 8-bit sRGB: values against the definition of the transfer function in double
// precision, the unit of light, averages in linear light, colour spaces by name, broken pixels and
// files.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <strings.h>

#include <cmocka.h>

#include <openexr.h>

#include "image/half.h"
#include "image/image_oiio.h"
#include "image/mask.h"
#include "image/photo.h"
#include "sparegs/runtime.h"
#include "support/bad_input.h"
#include "support/exr_bytes.h"
#include "support/ocio_config.h"
#include "support/scene_support.h"

enum { WIDTH = 21, HEIGHT = 70 }; // two slabs of rows, a width that is not a multiple of 16

static double encoded(double light)
{
    return light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
}

static double decoded(double value)
{
    return value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
}

// A scene with a lamp: five stops down to black, one pixel far above white.
static float light_at(int c, int x, int y)
{
    if (x == 3 && y == 40)
        return 200.0f;
    return (float)((x + 1) * (3 + c) / 64.0 * exp2(-y % 5)) * 0.9f;
}

// An EXR of this light times `scale`; with premultiplied alpha if requested; one pixel has the
// value `broken` unless it is 0.
static void put_light(const temp_folder *folder, const char *name, float scale, bool alpha,
                      float broken, int half)
{
    static float planes[4][WIDTH * HEIGHT];
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x)
            for (int c = 0; c < 4; ++c)
                planes[c][y * WIDTH + x] =
                    c == 3 ? 0.25f : light_at(c, x, y) * scale * (alpha ? 0.25f : 1.0f);
    if (broken != 0.0f)
        planes[1][50 * WIDTH + 7] = broken;
    const sgs_exr_channel channels[4] = {{"R", planes[0], NULL, half},
                                         {"G", planes[1], NULL, half},
                                         {"B", planes[2], NULL, half},
                                         {"A", planes[3], NULL, half}};
    const sgs_exr_info info = {.width = WIDTH, .height = HEIGHT};
    tree_put(folder, name, "", 0);
    assert_int_equal(sgs_exr_write(temp_path(folder, name), &info, channels, alpha ? 4 : 3),
                     SGS_STATUS_OK);
}

static sgsi_photo_source source_of(const char *path)
{
    return (sgsi_photo_source){.image_path = path,
                               .file_width = WIDTH,
                               .file_height = HEIGHT,
                               .width = WIDTH,
                               .height = HEIGHT,
                               .white_point = 1};
}

static sgs_photo load_photo(const sgsi_photo_source *source)
{
    sgs_photo photo;
    sgsi_photo_report report;
    if (sgsi_photo_load(source, &photo, &report))
        fail_msg("%s", sgs_last_error());
    return photo;
}

static double value_at(const sgs_photo *photo, int c, int x, int y)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    return sgsi_half_to_float(
        photo->halves[(size_t)c * plane + (size_t)y * (size_t)photo->width + (size_t)x]);
}

static void halves_round_to_nearest(void **state)
{
    (void)state;
    for (uint32_t h = 0x400; h < 0x7c00; ++h) {
        const float value = sgsi_half_to_float((uint16_t)h),
                    above = sgsi_half_to_float((uint16_t)(h + 1));
        assert_true(value == (float)ldexp(1024 + (h & 1023), (int)(h >> 10) - 25));
        assert_int_equal(sgsi_half_from_float(value), h);
        if (h + 1 < 0x7c00) {
            assert_int_equal(sgsi_half_from_float(value + 0.49f * (above - value)), h);
            assert_int_equal(sgsi_half_from_float(value + 0.51f * (above - value)), h + 1);
        }
    }
    assert_int_equal(sgsi_half_from_float(NAN), 0);
    assert_int_equal(sgsi_half_from_float(-1.0f), 0);
    assert_int_equal(sgsi_half_from_float(1e-6f), 0);
    assert_int_equal(sgsi_half_from_float(INFINITY), 0x7bff);
}

static void linear_light_is_encoded_as_srgb(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int alpha = 0; alpha < 2; ++alpha) {
        put_light(&folder, "a.exr", 1, alpha, 0, 0);
        sgsi_photo_source source = source_of(temp_path(&folder, "a.exr"));
        for (int space = SGS_SPACE_SRGB; space <= SGS_SPACE_LINEAR; ++space) {
            source.space = (sgs_space)space;
            source.white_point = 0.5;
            sgs_photo photo = load_photo(&source);
            assert_true(photo.channels == 3 + alpha && photo.is_hdr && !photo.pixels &&
                        !photo.valid_mask);
            for (int y = 0; y < HEIGHT; ++y)
                for (int x = 0; x < WIDTH; ++x)
                    for (int c = 0; c < photo.channels; ++c) {
                        const double light = 2 * (double)light_at(c, x, y);
                        const double expected = c == 3                    ? 0.25
                                                : space == SGS_SPACE_SRGB ? encoded(light)
                                                                          : light;
                        assert_true(fabs(value_at(&photo, c, x, y) - expected) <=
                                    5e-4 * expected + 1e-6);
                    }
            sgsi_photo_free(&photo);
        }
    }
    tree_remove(&folder);
}

// The white point is measured in the unit of light: the same scene times eight gives the same bits.
static void scaling_linear_light_changes_no_bit(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    put_light(&folder, "one.exr", 1, false, 0, 1);
    put_light(&folder, "eight.exr", 8, false, 0, 1);
    sgs_photo photos[2];
    double white[2];
    for (int k = 0; k < 2; ++k) {
        sgsi_photo_source source = source_of(temp_path(&folder, k ? "eight.exr" : "one.exr"));
        sgsi_light *light = calloc(1, sizeof *light);
        assert_non_null(light);
        assert_int_equal(sgsi_light_add(light, source.image_path, NULL, false), SGS_STATUS_OK);
        white[k] = source.white_point = sgsi_light_quantile(light, 0.99);
        free(light);
        photos[k] = load_photo(&source);
    }
    // The lamp is one pixel of 1470.
    assert_true(white[1] == 8 * white[0] && white[0] > 0.5 && white[0] < 2);
    assert_memory_equal(photos[0].halves, photos[1].halves, 3 * WIDTH * HEIGHT * sizeof(uint16_t));
    sgsi_photo_free(&photos[0]);
    sgsi_photo_free(&photos[1]);
    tree_remove(&folder);
}

static void linear_light_is_averaged_before_it_is_encoded(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    put_light(&folder, "a.exr", 1, false, 0, 0);
    sgsi_photo_source source = source_of(temp_path(&folder, "a.exr"));
    source.width = 8; // 2.625 source pixels each
    source.height = 20;
    sgs_photo photo = load_photo(&source);
    for (int j = 0; j < source.height; ++j)
        for (int i = 0; i < source.width; ++i)
            for (int c = 0; c < 3; ++c) {
                double sum = 0;
                for (int y = 0; y < HEIGHT; ++y)
                    for (int x = 0; x < WIDTH; ++x) {
                        const double w =
                            fmin(x + 1, (i + 1) * WIDTH / 8.0) - fmax(x, i * WIDTH / 8.0);
                        const double h =
                            fmin(y + 1, (j + 1) * HEIGHT / 20.0) - fmax(y, j * HEIGHT / 20.0);
                        sum += fmax(w, 0) * fmax(h, 0) * (double)light_at(c, x, y);
                    }
                const double expected = encoded(sum * 8 * 20 / (WIDTH * HEIGHT));
                assert_true(fabs(value_at(&photo, c, i, j) - expected) <= 6e-4 * expected);
            }
    sgsi_photo_free(&photo);
    tree_remove(&folder);
}

static void sixteen_bits_keep_their_precision(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    uint16_t words[3 * WIDTH * HEIGHT];
    for (int i = 0; i < 3 * WIDTH * HEIGHT; ++i)
        words[i] = (uint16_t)(i * 14 + 3);
    tiff_put(&folder, "a.tif", &(tiff){WIDTH, HEIGHT, 3, 16, 2, 1, 0}, words, sizeof words);
    sgsi_photo_source source = source_of(temp_path(&folder, "a.tif"));
    for (int space = SGS_SPACE_SRGB; space <= SGS_SPACE_LINEAR; ++space) {
        source.space = (sgs_space)space;
        sgs_photo photo = load_photo(&source);
        assert_true(photo.halves && !photo.is_hdr);
        for (int i = 0; i < WIDTH * HEIGHT; ++i)
            for (int c = 0; c < 3; ++c) {
                const double stored = words[3 * i + c] / 65535.0,
                             expected = space ? decoded(stored) : stored;
                assert_true(fabs(value_at(&photo, c, i % WIDTH, i / WIDTH) - expected) <=
                            5e-4 * expected + 6.2e-5);
            }
        sgsi_photo_free(&photo);
    }
    // 8-bit sRGB stays 8-bit, unless the training space is linear.
    uint8_t bytes[3 * WIDTH * HEIGHT] = {200};
    tiff_put(&folder, "b.tif", &(tiff){WIDTH, HEIGHT, 3, 8, 2, 1, 0}, bytes, sizeof bytes);
    source = source_of(temp_path(&folder, "b.tif"));
    sgs_photo photo = load_photo(&source);
    assert_true(photo.pixels && !photo.halves && photo.pixels[0] == 200);
    sgsi_photo_free(&photo);
    source.space = SGS_SPACE_LINEAR;
    photo = load_photo(&source);
    assert_true(!photo.pixels && fabs(value_at(&photo, 0, 0, 0) - decoded(200 / 255.0)) < 5e-4);
    sgsi_photo_free(&photo);
    tree_remove(&folder);
}

// `list`: comma-separated names, without duplicates.
static void assert_distinct(const char *list)
{
    size_t count = 0;
    for (const char *name = list; *name; name += strspn(name, ", ")) {
        const size_t length = strcspn(name, ",");
        for (const char *other = name + length + strspn(name + length, ", "); *other;
             other += strspn(other, ", ")) {
            const size_t same = strcspn(other, ",");
            assert_true(length != same || strncasecmp(name, other, length));
            other += same;
        }
        name += length;
        ++count;
    }
    assert_true(count > 2);
}

static void colour_spaces_are_selected_by_name(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    put_light(&folder, "a.exr", 1, false, 0, 0);
    sgsi_photo_source source = source_of(temp_path(&folder, "a.exr"));
    sgs_photo photo;
    sgsi_photo_report report;
    source.colorspace = "sRGB"; // the values are not converted
    photo = load_photo(&source);
    assert_true(fabs(value_at(&photo, 0, 5, 0) - (double)light_at(0, 5, 0)) < 5e-4 &&
                !photo.is_hdr);
    sgsi_photo_free(&photo);
    source.colorspace = "Rec709"; // converted by OpenImageIO: transfer function of ITU-R BT.709
    photo = load_photo(&source);
    const double light = pow(((double)light_at(0, 5, 0) + 0.099) / 1.099, 1 / 0.45);
    assert_true(fabs(value_at(&photo, 0, 5, 0) - encoded(light)) < 2e-3);
    sgsi_photo_free(&photo);
    source.colorspace = "sepia";
    assert_int_equal(sgsi_photo_load(&source, &photo, &report), SGS_STATUS_UNSUPPORTED);
    assert_holds(sgs_last_error(),
                 "a.exr: unknown colour space 'sepia'; choose with option colorspace from");
    assert_distinct(strstr(sgs_last_error(), "from ") + 5);
    assert_null(photo.halves);
    tree_remove(&folder);
}

// Replaces the values of a file's attribute chromaticities.
static void put_primaries(const char *path, const float values[8])
{
    static const char head[] = "chromaticities\0chromaticities"; // name and type
    size_t size;
    unsigned char *bytes = file_get(path, &size), *at = memmem(bytes, size, head, sizeof head);
    assert_non_null(at);
    memcpy(at + sizeof head + 4, values, 8 * sizeof *values); // after the size
    file_put(path, bytes, size);
    free(bytes);
}

// Red, green, blue and grey, at half opacity if there is alpha.
static void put_unit_colors(const temp_folder *folder, const char *name, bool alpha,
                            const float primaries[8])
{
    const float planes[4][4] = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, {0.5f, 0.5f, 0.5f, 0.5f}};
    const sgs_exr_channel channels[4] = {{"R", planes[0], NULL, 0},
                                         {"G", planes[1], NULL, 0},
                                         {"B", planes[2], NULL, 0},
                                         {"A", planes[3], NULL, 0}};
    const sgs_exr_info info = {.width = 4, .height = 1};
    assert_int_equal(sgs_exr_write(temp_path(folder, name), &info, channels, alpha ? 4 : 3),
                     SGS_STATUS_OK);
    put_primaries(temp_path(folder, name), primaries);
}

typedef struct kept_row {
    float values[16];
    size_t count;
} kept_row;

static void keep_row(void *context, int y, const float *row)
{
    kept_row *kept = context;
    assert_int_equal(y, 0);
    memcpy(kept->values, row, kept->count * sizeof *row);
}

// Matrices computed with NumPy from the chromaticities and Bradford's cone responses. To the digits
// that they give, they are those of ACES (AP0, AP1) and of ITU-R BT.2087.
static void exr_primaries_become_rec709(void **state)
{
    (void)state;
    static const struct {
        float primaries[8];
        double matrix[3][3];
    } cases[] = {
        {{0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.077f, 0.32168f, 0.33767f}, // AP0
         {{2.521686, -1.134131, -0.387555},
          {-0.276480, 1.372719, -0.096239},
          {-0.015378, -0.152975, 1.168353}}},
        {{0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f}, // AP1
         {{1.705051, -0.621792, -0.083259},
          {-0.130256, 1.140805, -0.010548},
          {-0.024003, -0.128969, 1.152972}}},
        {{0.68f, 0.32f, 0.265f, 0.69f, 0.15f, 0.06f, 0.3127f, 0.329f}, // P3, D65
         {{1.224940, -0.224940, 0}, {-0.042057, 1.042057, 0}, {-0.019638, -0.078636, 1.098274}}},
        {{0.708f, 0.292f, 0.17f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.329f}, // BT.2020
         {{1.660491, -0.587641, -0.072850},
          {-0.124550, 1.132900, -0.008349},
          {-0.018151, -0.100579, 1.118730}}},
        {{0.6405f, 0.3295f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f}, // Rec. 709, rounded
         {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k)
        for (int alpha = 0; alpha < 2; ++alpha) {
            const size_t channels = alpha ? 4 : 3;
            kept_row row = {.count = 4 * channels};
            put_unit_colors(&folder, "a.exr", alpha, cases[k].primaries);
            if (sgsi_oiio_read_rows(temp_path(&folder, "a.exr"), NULL, keep_row, &row))
                fail_msg("%s", sgs_last_error());
            for (size_t x = 0; x < 4; ++x)
                for (size_t c = 0; c < 3; ++c) {
                    const double expected = x < 3 ? cases[k].matrix[c][x] : 1; // grey stays grey
                    const double value = (double)row.values[x * channels + c];
                    if (!(fabs(value - expected) < 3e-6))
                        fail_msg("case %zu, column %zu, row %zu: %.7f, expected %.7f", k, x, c,
                                 value, expected);
                }
        }
    // A photo has no negative light: L1 could not reach it.
    sgsi_photo_source source = source_of(temp_path(&folder, "a.exr"));
    source.file_width = source.width = 4;
    source.file_height = source.height = 1;
    put_unit_colors(&folder, "a.exr", false, cases[1].primaries);
    for (int space = 0; space < 2; ++space) {
        source.space = (sgs_space)space;
        sgs_photo photo = load_photo(&source);
        for (int c = 0; c < 3; ++c)
            for (int x = 0; x < 3; ++x)
                assert_true(c == x ? value_at(&photo, c, x, 0) > 1
                                   : value_at(&photo, c, x, 0) == 0);
        sgs_photo_free(&photo);
    }
    // A space with primaries of its own overrides the attribute; "linear" does not.
    kept_row row = {.count = 12};
    put_unit_colors(&folder, "a.exr", false, cases[1].primaries);
    assert_int_equal(sgsi_oiio_read_rows(temp_path(&folder, "a.exr"), "lin_rec709", keep_row, &row),
                     SGS_STATUS_OK);
    assert_true(row.values[0] == 1.0f && row.values[1] == 0.0f);
    assert_int_equal(sgsi_oiio_read_rows(temp_path(&folder, "a.exr"), "linear", keep_row, &row),
                     SGS_STATUS_OK);
    assert_true(row.values[0] > 1.7f);
    temp_folder_remove(&folder);
}

// The working space has the primaries of ACES; a second configuration also has linear Rec. 709.
static void spaces_of_ocio_become_rec709(void **state)
{
    (void)state;
    static const char config[] = OCIO_OF_ACESCG;
    static const char rec709[] =
        "  - !<ColorSpace>\n"
        "    name: Linear Rec.709 (sRGB)\n"
        "    to_scene_reference: !<MatrixTransform> {matrix: [0.439632982, 0.382988698, 0.17737832,"
        " 0, 0.089776443, 0.813439429, 0.096784128, 0, 0.01754117, 0.111546553, 0.870912276, 0,"
        " 0, 0, 0, 1]}\n";
    static const double expected[3][3] = {{1.705051, -0.621792, -0.083259},
                                          {-0.130256, 1.140805, -0.010548},
                                          {-0.024003, -0.128969, 1.152972}};
    const temp_folder folder = temp_folder_make();
    const float own[8] = {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f};
    for (int k = 0; k < 4; ++k) {
        char text[2000];
        snprintf(text, sizeof text, "%s%s", config, k & 2 ? rec709 : "");
        file_put(temp_path(&folder, "config.ocio"), text, strlen(text));
        setenv("OCIO", temp_path(&folder, "config.ocio"), 1);
        const size_t channels = k & 1 ? 4 : 3;
        kept_row row = {.count = 4 * channels};
        put_unit_colors(&folder, "a.exr", k & 1, own);
        assert_int_equal(sgsi_oiio_read_rows(temp_path(&folder, "a.exr"), "ACEScg", keep_row, &row),
                         SGS_STATUS_OK);
        unsetenv("OCIO");
        for (size_t i = 0; i < 9; ++i)
            assert_true(
                fabs((double)row.values[i % 3 * channels + i / 3] - expected[i / 3][i % 3]) < 1e-4);
    }
    temp_folder_remove(&folder);
}

static void impossible_primaries_are_refused(void **state)
{
    (void)state;
    static const float cases[][8] = {
        {0, 0, 0, 0, 0, 0, 0, 0},
        {0.64f, 0.33f, 0.64f, 0.33f, 0.15f, 0.06f, 0.3127f, 0.329f}, // on a line
        {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0},
        {NAN, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, 0.3127f, 0.329f},
        {0.64f, 0.33f, 0.3f, 0.6f, 0.15f, 0.06f, INFINITY, 0.329f},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgsi_image_info info;
        const char *path = temp_path(&folder, "a.exr");
        put_unit_colors(&folder, "a.exr", false, cases[k]);
        assert_int_equal(sgsi_oiio_describe(path, NULL, &info), SGS_STATUS_UNSUPPORTED);
        assert_int_equal(strncmp(sgs_last_error(), path, strlen(path)), 0);
        assert_holds(sgs_last_error(),
                     "the chromaticities attribute is degenerate (its primaries form no triangle)");
        bad_input();
        assert_int_equal(sgsi_oiio_describe(path, "lin_rec709", &info), SGS_STATUS_OK);
    }
    temp_folder_remove(&folder);
}

// A scene of scene_support whose photos are EXR files, with the names of the model's PNG
// files.
static temp_folder make_scene(float broken)
{
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    static const char *const names[] = {"b.exr", "a.exr", "sub/c.exr", "d with blanks.exr"};
    for (int i = 0; i < m.image_count; ++i) {
        char path[64];
        m.images[i].name = names[i];
        snprintf(path, sizeof path, "images/%s", names[i]);
        put_light(&folder, path, 8, false, i == 1 ? broken : 0, 0);
    }
    for (int k = 0; k < m.camera_count; ++k) {
        const int center = m.cameras[k].model == SGS_CAMERA_SIMPLE_PINHOLE ? 1 : 2; // cx, cy
        m.cameras[k].width = WIDTH, m.cameras[k].height = HEIGHT;
        m.cameras[k].params[center] = 0.5 * WIDTH, m.cameras[k].params[center + 1] = 0.5 * HEIGHT;
    }
    model_put(&folder, "sparse/0/", &m, true);
    return folder;
}

static void nonfinite_pixels_are_ignored_and_counted(void **state)
{
    (void)state;
    static const float values[] = {NAN, INFINITY, -INFINITY};
    for (int k = 0; k < 3; ++k) {
        const temp_folder folder = make_scene(values[k]);
        sgs_scene *scene;
        assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_OK);
        assert_int_equal(scene->pixels_nonfinite, 1);
        assert_true(scene->white_point > 4 && scene->white_point < 16);
        assert_holds(warnings, "a.exr: ignored 1 pixel(s) with infinite or NaN values");
        const sgs_photo *photo = &scene->views[0].image;
        assert_string_equal(scene->views[0].name, "a.exr");
        assert_int_equal(photo->kept, WIDTH * HEIGHT - 1);
        assert_false(sgs_mask_is_valid(photo->valid_mask, WIDTH, 7, 50));
        for (int i = 0; i < 3 * WIDTH * HEIGHT; ++i)
            assert_true(photo->halves[i] < 0x7c00);
        assert_null(scene->views[1].image.valid_mask);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

// sgs_scene_photo_read against the scene's own photos.
static void photos_are_read_without_the_cache(void **state)
{
    (void)state;
    const temp_folder folder = make_scene(NAN);
    for (int k = 0; k < 4; ++k) {
        sgs_scene_options options = sgs_scene_options_default();
        options.space = k % 2 ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
        options.colorspace = k < 2 ? NULL : "sRGB";
        sgs_scene *loaded, *bare;
        assert_int_equal(sgs_scene_load(folder.path, &options, &loaded), SGS_STATUS_OK);
        options.load_images = false;
        options.measure_white_point = true;
        assert_int_equal(sgs_scene_load(folder.path, &options, &bare), SGS_STATUS_OK);
        assert_true(bare->white_point == loaded->white_point && (k > 1 || bare->white_point > 4));
        for (size_t i = 0; i < loaded->view_count; ++i) {
            const sgs_photo *kept;
            sgs_photo photo;
            assert_int_equal(sgs_scene_photo(loaded, i, &kept), SGS_STATUS_OK);
            assert_int_equal(sgs_scene_photo_read(bare, i, WIDTH, HEIGHT, &photo), SGS_STATUS_OK);
            assert_int_equal(photo.channels, kept->channels);
            assert_int_equal(photo.kept, WIDTH * HEIGHT);
            assert_null(photo.valid_mask);
            assert_memory_equal(photo.halves, kept->halves,
                                3 * WIDTH * HEIGHT * sizeof *photo.halves);
            sgs_photo_free(&photo);
            assert_int_equal(sgs_scene_photo_read(bare, i, 2, 1, &photo), SGS_STATUS_OK);
            assert_int_equal(photo.width * photo.height, 2);
            sgs_photo_free(&photo);
        }
        sgs_photo photo;
        assert_int_equal(sgs_scene_photo_read(bare, 9, WIDTH, HEIGHT, &photo),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_int_equal(sgs_scene_photo_read(bare, 0, WIDTH + 1, HEIGHT, &photo),
                         SGS_STATUS_FORMAT);
        assert_null(photo.halves);
        sgs_scene_destroy(loaded);
        sgs_scene_destroy(bare);
    }
    tree_remove(&folder);
}

static void broken_files_are_reported_in_one_line(void **state)
{
    (void)state;
    const temp_folder folder = make_scene(0);
    sgs_scene *scene;
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "images/a.exr"), &size);
    file_put(temp_path(&folder, "images/a.exr"), bytes, size / 2);
    free(bytes);
    static const float plane[WIDTH * HEIGHT];
    const sgs_exr_channel odd[2] = {{"depth.Z", plane, NULL, 0}, {"velocity.X", plane, NULL, 0}};
    const sgs_exr_info info = {.width = WIDTH, .height = HEIGHT};
    assert_int_equal(sgs_exr_write(temp_path(&folder, "images/b.exr"), &info, odd, 2),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_OK);
    assert_int_equal(scene->view_count, 2);
    assert_int_equal(scene->images_missing, 2);
    assert_holds(warnings, "images/a.exr: cannot read the image");
    assert_holds(warnings, "images/b.exr: no colour channels R, G, B or Y; the channels are "
                           "depth.Z, velocity.X; the view");
    size_t lines = 0;
    for (const char *c = warnings; *c; ++c)
        lines += *c == '\n';
    assert_int_equal(lines, 2);
    sgs_scene_destroy(scene);
    sgs_scene_options options = sgs_scene_options_default();
    options.colorspace = "sepia";
    warnings[0] = 0;
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_UNSUPPORTED);
    assert_holds(sgs_last_error(), "'sepia'");
    tree_remove(&folder);
}

// A layer's colours are found by the name after its prefix, without the alpha of another layer.
static void exr_layers_are_found_by_name(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static float planes[5][WIDTH * HEIGHT];
    for (int k = 0; k < 5; ++k)
        for (int i = 0; i < WIDTH * HEIGHT; ++i)
            planes[k][i] = 0.1f * (float)(k + 1);
    const sgs_exr_channel layers[5] = {{"Z", planes[0], NULL, 0},
                                       {"beauty.B", planes[1], NULL, 0},
                                       {"beauty.G", planes[2], NULL, 0},
                                       {"beauty.R", planes[3], NULL, 0},
                                       {"other.A", planes[4], NULL, 0}};
    const sgs_exr_info info = {.width = WIDTH, .height = HEIGHT};
    assert_int_equal(sgs_exr_write(temp_path(&folder, "a.exr"), &info, layers, 5), SGS_STATUS_OK);
    sgsi_photo_source source = source_of(temp_path(&folder, "a.exr"));
    source.space = SGS_SPACE_LINEAR;
    sgs_photo photo = load_photo(&source);
    assert_int_equal(photo.channels, 3);
    const double expected[3] = {0.4, 0.3, 0.2};
    for (int c = 0; c < 3; ++c)
        assert_true(fabs(value_at(&photo, c, 4, 4) - expected[c]) < 2e-4);
    sgsi_photo_free(&photo);
    tree_remove(&folder);
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { SANITIZED = 1 }; // freed memory stays in use
#else
enum { SANITIZED = 0 };
#endif

enum { TILE = 64, TILED_WIDTH = 300, TILED_HEIGHT = 270, LAYER_CHANNELS = 300 };

static float tiled_value(int c, int x, int y)
{
    return (float)(c * 300 + (c == 1 ? x : y)) / 1024.0f;
}

// Encodes one tile: zeros in the channels of the first layers, tiled_value in z.B, z.G, z.R.
static void put_tile(exr_context_t file, exr_encode_pipeline_t *encoder, int column, int row)
{
    static float values[3][TILE * TILE];
    static uint8_t zeros[TILE * TILE * 2];
    exr_chunk_info_t chunk;
    assert_int_equal(exr_write_tile_chunk_info(file, 0, column, row, 0, 0, &chunk), 0);
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < chunk.width * chunk.height; ++i)
            values[c][i] =
                tiled_value(c, column * TILE + i % chunk.width, row * TILE + i / chunk.width);
    assert_int_equal(encoder->channels ? exr_encoding_update(file, 0, &chunk, encoder)
                                       : exr_encoding_initialize(file, 0, &chunk, encoder),
                     0);
    for (int k = 0; k < encoder->channel_count; ++k) {
        exr_coding_channel_info_t *channel = &encoder->channels[k];
        const char *const colors = "BGR", *found = strchr(colors, channel->channel_name[2]);
        const bool colored = channel->channel_name[0] == 'z';
        channel->encode_from_ptr = colored ? (const uint8_t *)values[found - colors] : zeros;
        channel->user_pixel_stride = channel->user_bytes_per_element;
        channel->user_line_stride = chunk.width * channel->user_bytes_per_element;
    }
    assert_int_equal(exr_encoding_choose_default_routines(file, 0, encoder), 0);
    assert_int_equal(exr_encoding_run(file, 0, encoder), 0);
}

// Tiled, with many channels before the colours.
static void put_tiled(const char *path)
{
    exr_context_t file;
    int part;
    assert_int_equal(exr_start_write(&file, path, EXR_WRITE_FILE_DIRECTLY, NULL), 0);
    assert_int_equal(exr_add_part(file, "a", EXR_STORAGE_TILED, &part), 0);
    assert_int_equal(exr_initialize_required_attr_simple(file, part, TILED_WIDTH, TILED_HEIGHT,
                                                         EXR_COMPRESSION_ZIP),
                     0);
    assert_int_equal(
        exr_set_tile_descriptor(file, part, TILE, TILE, EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN),
        0);
    for (int k = 0; k < LAYER_CHANNELS + 3; ++k) {
        char name[16];
        snprintf(name, sizeof name, k < LAYER_CHANNELS ? "c%03d.q" : "z.%c",
                 k < LAYER_CHANNELS ? k : "BGR"[k - LAYER_CHANNELS]);
        assert_int_equal(exr_add_channel(file, part, name,
                                         k < LAYER_CHANNELS ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                                         EXR_PERCEPTUALLY_LINEAR, 1, 1),
                         0);
    }
    assert_int_equal(exr_write_header(file), 0);
    exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
    for (int row = 0; row * TILE < TILED_HEIGHT; ++row)
        for (int column = 0; column * TILE < TILED_WIDTH; ++column)
            put_tile(file, &encoder, column, row);
    exr_encoding_destroy(file, &encoder);
    assert_int_equal(exr_finish(&file), 0);
}

static void check_tiled_row(void *context, int y, const float *row)
{
    int *rows = context;
    assert_int_equal(y, *rows);
    ++*rows;
    for (int x = 0; x < TILED_WIDTH; ++x)
        for (int c = 0; c < 3; ++c)
            assert_true(row[3 * x + c] == tiled_value(2 - c, x, y));
}

// Only the colours of one row of tiles are in memory.
static void layers_before_the_colours_take_no_memory(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.exr");
    put_tiled(path);
    const uint64_t all = sizeof(float) * TILED_WIDTH * TILED_HEIGHT * LAYER_CHANNELS,
                   before = sgs_rss_peak();
    int rows = 0;
    if (sgsi_oiio_read_rows(path, NULL, check_tiled_row, &rows))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(rows, TILED_HEIGHT);
    assert_true(SANITIZED || sgs_rss_peak() - before < all / 2);
    tree_remove(&folder);
}

// The header and an empty table of offsets of a file with large tiles.
static void put_large_tiles(const char *path, int display_side)
{
    enum { SIDE = 16384, WIDE = 64, OFFSETS = SIDE / WIDE };
    static buffer b;
    b.size = 0;
    put_integer(&b, 0x01312f76, 4);
    put_integer(&b, 2 | 1 << 9, 4);
    exr_attribute(&b, "channels", "chlist", 3 * 18 + 1);
    for (int k = 0; k < 3; ++k) {
        const char name[2] = {"BGR"[k], 0};
        put_bytes(&b, name, 2);
        put_integer(&b, 1, 4); // half
        put_integer(&b, 0, 4);
        put_integer(&b, 1, 4);
        put_integer(&b, 1, 4);
    }
    put_integer(&b, 0, 1);
    exr_attribute(&b, "compression", "compression", 1);
    put_integer(&b, 3, 1); // ZIP
    for (int k = 0; k < 2; ++k) {
        exr_attribute(&b, k ? "displayWindow" : "dataWindow", "box2i", 16);
        put_integer(&b, 0, 8);
        put_integer(&b, (uint64_t)(k ? display_side : SIDE) - 1, 4);
        put_integer(&b, (uint64_t)(k ? display_side : SIDE) - 1, 4);
    }
    exr_fixed_attributes(&b);
    exr_attribute(&b, "tiles", "tiledesc", 9);
    put_integer(&b, WIDE, 4);
    put_integer(&b, SIDE, 4);
    put_integer(&b, 0, 1);
    put_integer(&b, 0, 1); // end of the header
    for (int k = 0; k < OFFSETS; ++k)
        put_integer(&b, 0, 8);
    file_put(path, b.data, b.size);
}

static void tiles_larger_than_the_limit_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.exr");
    put_large_tiles(path, 16384);
    int rows = 0;
    assert_int_equal(sgsi_oiio_read_rows(path, NULL, check_tiled_row, &rows), SGS_STATUS_LIMIT);
    assert_holds(sgs_last_error(), "a.exr: 16384 rows of 16384 pixels with 3 channels exceed");
    bad_input();
    tree_remove(&folder);
}

// A camera of the shape of the display window is that of the display window, unless it has the size
// of another data window.
static void cameras_choose_the_window(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.exr");
    for (int display = 8192; display <= 32768; display *= 2)
        for (int side = 8192; side <= 65536; side *= 2)
            for (int height = side / 2; height <= side; height += side / 2) {
                const sgs_camera camera = {SGS_CAMERA_PINHOLE, side, height, {9, 9, 9, 9}};
                sgsi_image_info info;
                bool shown;
                put_large_tiles(path, display);
                assert_int_equal(sgsi_oiio_describe(path, NULL, &info), SGS_STATUS_OK);
                assert_true(info.width == 16384 && info.full_width == display &&
                            info.full_height == display);
                assert_false(sgsi_photo_choose_window(path, &info, &camera, &shown));
                assert_int_equal(shown, display != 16384 && side != 16384 && height == side);
            }
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cameras_choose_the_window),
        cmocka_unit_test(halves_round_to_nearest),
        cmocka_unit_test(linear_light_is_encoded_as_srgb),
        cmocka_unit_test(scaling_linear_light_changes_no_bit),
        cmocka_unit_test(linear_light_is_averaged_before_it_is_encoded),
        cmocka_unit_test(sixteen_bits_keep_their_precision),
        cmocka_unit_test(colour_spaces_are_selected_by_name),
        cmocka_unit_test_setup(nonfinite_pixels_are_ignored_and_counted, warnings_begin),
        cmocka_unit_test_setup(photos_are_read_without_the_cache, warnings_begin),
        cmocka_unit_test_setup(broken_files_are_reported_in_one_line, warnings_begin),
        cmocka_unit_test(exr_layers_are_found_by_name),
        cmocka_unit_test(exr_primaries_become_rec709),
        cmocka_unit_test(spaces_of_ocio_become_rec709),
        cmocka_unit_test(impossible_primaries_are_refused),
        cmocka_unit_test(layers_before_the_colours_take_no_memory),
        cmocka_unit_test(tiles_larger_than_the_limit_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
