// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// EXR files: compared bit by bit after reading with OpenEXR's C library, and with another program
// (oiiotool, if installed); a failed write keeps the existing file.

#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>
#include <openexr.h>

#include "base/core.h"
#include "support/files_support.h"
#include "sparegs/image.h"
#include "sparegs/runtime.h"

enum { WIDTH = 37, HEIGHT = 41, PLANES = 5 }; // two full chunks of 16 lines and a partial one

static float planes[PLANES][WIDTH * HEIGHT];
static uint32_t ids[WIDTH * HEIGHT];

static const double world_to_camera[16] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0, 0, 0, 1};
static const double world_to_ndc[16] = {0.5, 0, 0, -1, 0, 0.25, 0, -2, 0, 0, 1, -3, 0, 0, 1, 0};

// Deliberately out of order.
static const sgs_exr_channel channels[] = {
    {.name = "depth.Z", .floats = planes[4]},
    {.name = "R", .floats = planes[0], .half = 1},
    {.name = "G", .floats = planes[1], .half = 1},
    {.name = "B", .floats = planes[2], .half = 1},
    {.name = "A", .floats = planes[3], .half = 1},
    {.name = "hits.count", .uints = ids},
    {.name = "a.layer.with.a.name.longer.than.31.characters", .floats = planes[3]},
};
enum { CHANNELS = sizeof channels / sizeof *channels };

static const sgs_exr_info info = {
    .width = WIDTH,
    .height = HEIGHT,
    .world_to_camera = world_to_camera,
    .world_to_ndc = world_to_ndc,
    .depth_definition = "mean distance along the ray, world units",
    .view_name = "folder/DSC_0430.JPG",
};

static int fill_planes(void **state)
{
    (void)state;
    for (size_t i = 0; i < WIDTH * HEIGHT; ++i) {
        for (size_t k = 0; k < PLANES; ++k)
            planes[k][i] = (float)(sgsi_random_uniform(k, i) * (k == 4 ? 100.0 : 1.0));
        ids[i] = (uint32_t)sgsi_random_bits(9, i);
    }
    ids[0] = UINT32_MAX;
    planes[0][0] = 0.0f;
    planes[0][1] = 1.0f;
    planes[0][2] = 0.5f;
    planes[0][3] = 1.0f + 0x1p-11f;            // a tie: rounds to even, 1
    planes[0][4] = 1.0f + 3 * 0x1p-11f;        // a tie: rounds to even, 1 + 2^-9
    planes[0][5] = 1.0f + 0x1p-11f + 0x1p-20f; // just above: 1 + 2^-10
    planes[0][6] = 65504.0f;                   // the largest half
    planes[0][7] = 1e9f;                       // infinity
    planes[0][8] = 0x1p-24f;                   // the smallest half
    planes[0][9] = -2.25f;
    planes[4][0] = INFINITY;
    planes[4][1] = 3.4e38f;
    planes[4][2] = 1e-42f;
    return 0;
}

static double half_value(uint16_t bits)
{
    const int exponent = bits >> 10 & 31, mantissa = bits & 1023;
    const double size = exponent == 31  ? (mantissa ? NAN : INFINITY)
                        : exponent == 0 ? ldexp(mantissa, -24)
                                        : ldexp(mantissa + 1024, exponent - 25);
    return bits & 0x8000 ? -size : size;
}

// Nearest half to a float, ties to even, by exhaustive search.
static double nearest_half(float value)
{
    if (fabsf(value) >= 65520.0f)
        return value > 0 ? INFINITY : -INFINITY;
    uint16_t best = 0;
    for (uint32_t bits = 0; bits < 0x7c00; ++bits) {
        const double error = fabs(half_value((uint16_t)bits) - fabs((double)value));
        const double least = fabs(half_value(best) - fabs((double)value));
        if (error < least || (error == least && !(bits & 1)))
            best = (uint16_t)bits;
    }
    return value < 0 ? -half_value(best) : half_value(best);
}

static void open_exr(const char *path, exr_context_t *context)
{
    if (exr_start_read(context, path, NULL))
        fail_msg("%s cannot be read back", path);
}

// Reads one channel as stored.
static void read_channel(exr_context_t context, const char *name, size_t size,
                         unsigned char *pixels)
{
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers" // as in exr.c
    exr_decode_pipeline_t decoder = EXR_DECODE_PIPELINE_INITIALIZER;
#pragma GCC diagnostic pop
    int32_t lines;
    bool found = false;
    assert_int_equal(exr_get_scanlines_per_chunk(context, 0, &lines), 0);
    assert_int_equal(lines, 16); // ZIP
    for (int y = 0; y < HEIGHT; y += lines) {
        exr_chunk_info_t chunk;
        assert_int_equal(exr_read_scanline_chunk_info(context, 0, y, &chunk), 0);
        assert_int_equal(y ? exr_decoding_update(context, 0, &chunk, &decoder)
                           : exr_decoding_initialize(context, 0, &chunk, &decoder),
                         0);
        for (int k = 0; k < decoder.channel_count; ++k) {
            exr_coding_channel_info_t *channel = &decoder.channels[k];
            channel->decode_to_ptr = NULL;
            if (strcmp(channel->channel_name, name))
                continue;
            found = true;
            assert_int_equal(channel->bytes_per_element, size);
            channel->decode_to_ptr = pixels + (size_t)y * WIDTH * size;
            channel->user_pixel_stride = (int32_t)size;
            channel->user_line_stride = (int32_t)(WIDTH * size);
        }
        if (!y)
            assert_int_equal(exr_decoding_choose_default_routines(context, 0, &decoder), 0);
        assert_int_equal(exr_decoding_run(context, 0, &decoder), 0);
    }
    assert_true(found);
    exr_decoding_destroy(context, &decoder);
}

// Every channel is read back exactly, halves rounded to nearest.
static void check_pixels(const char *path)
{
    exr_context_t context;
    open_exr(path, &context);
    static unsigned char pixels[4 * WIDTH * HEIGHT];
    for (int k = 0; k < CHANNELS; ++k) {
        const sgs_exr_channel *channel = &channels[k];
        read_channel(context, channel->name, channel->half ? 2 : 4, pixels);
        if (!channel->half) {
            assert_memory_equal(pixels,
                                channel->uints ? (const void *)channel->uints
                                               : (const void *)channel->floats,
                                sizeof pixels);
            continue;
        }
        for (size_t i = 0; i < WIDTH * HEIGHT; i += i < 12 ? 1 : 29) {
            uint16_t bits;
            memcpy(&bits, pixels + 2 * i, 2);
            if (!(half_value(bits) == nearest_half(channel->floats[i])))
                fail_msg("%s, pixel %zu: %.9g became %.9g, not %.9g", channel->name, i,
                         (double)channel->floats[i], half_value(bits),
                         nearest_half(channel->floats[i]));
        }
    }
    exr_finish(&context);
}

static void exr_pixels_round_trip(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "view.exr");
    static const sgs_exr_compression compressions[] = {SGS_EXR_AUTO, SGS_EXR_ZIP};
    for (size_t k = 0; k < 2; ++k) {
        sgs_exr_info own = info;
        own.compression = compressions[k];
        if (sgs_exr_write(path, &own, channels, CHANNELS))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(temp_folder_count(&folder), 1);
        check_pixels(path);
    }
    temp_folder_remove(&folder);
}

// AUTO compresses bands that shrink by a third and leaves others uncompressed; ZIP compresses both.
static void exr_auto_compresses_bands_that_shrink(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "view.exr");
    enum { SIDE = 128 };
    static float even[SIDE * SIDE], noisy[SIDE * SIDE];
    for (size_t i = 0; i < SIDE * SIDE; ++i) {
        even[i] = 0.25f * (float)(i / SIDE % 4);
        noisy[i] = i % SIDE < 104 ? (float)sgsi_random_uniform(3, i) : 0; // a fifth of it shrinks
    }
    const size_t raw = sizeof even;
    size_t sizes[2][2];
    for (size_t k = 0; k < 4; ++k) {
        const sgs_exr_channel channel = {.name = "depth.Z", .floats = k & 1 ? noisy : even};
        const sgs_exr_info own = {
            .width = SIDE, .height = SIDE, .compression = k & 2 ? SGS_EXR_ZIP : SGS_EXR_AUTO};
        assert_int_equal(sgs_exr_write(path, &own, &channel, 1), SGS_STATUS_OK);
        free(file_get(path, &sizes[k / 2][k & 1]));
    }
    print_message("of %zu bytes, even and noisy: auto %zu and %zu, zip %zu and %zu\n", raw,
                  sizes[0][0], sizes[0][1], sizes[1][0], sizes[1][1]);
    assert_int_equal(sizes[0][0], sizes[1][0]);
    assert_true(sizes[0][0] < raw / 4 && sizes[0][1] > raw && sizes[1][1] < raw);
    temp_folder_remove(&folder);
}

static void assert_text(exr_context_t context, const char *name, const char *expected)
{
    int32_t length;
    const char *text;
    assert_int_equal(exr_attr_get_string(context, 0, name, &length, &text), 0);
    assert_int_equal(length, strlen(expected));
    assert_memory_equal(text, expected, strlen(expected));
}

static void assert_transposed(exr_context_t context, const char *name, const double *matrix)
{
    exr_attr_m44f_t stored;
    assert_int_equal(exr_attr_get_m44f(context, 0, name, &stored), 0);
    for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 4; ++column)
            assert_true(stored.m[4 * row + column] == (float)matrix[4 * column + row]);
    }
}

static void exr_header_has_the_attributes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "view.exr");
    assert_int_equal(sgs_exr_write(path, &info, channels, CHANNELS), SGS_STATUS_OK);
    exr_context_t context;
    open_exr(path, &context);
    exr_storage_t storage;
    exr_compression_t compression;
    exr_attr_box2i_t data, display;
    assert_int_equal(exr_get_storage(context, 0, &storage), 0);
    assert_int_equal(storage, EXR_STORAGE_SCANLINE);
    assert_int_equal(exr_get_compression(context, 0, &compression), 0);
    assert_int_equal(compression, EXR_COMPRESSION_ZIP);
    assert_int_equal(exr_get_data_window(context, 0, &data), 0);
    assert_int_equal(exr_get_display_window(context, 0, &display), 0);
    assert_memory_equal(&data, &display, sizeof data);
    assert_int_equal(data.min.x, 0);
    assert_int_equal(data.min.y, 0);
    assert_int_equal(data.max.x, WIDTH - 1);
    assert_int_equal(data.max.y, HEIGHT - 1);
    exr_attr_chromaticities_t c;
    assert_int_equal(exr_attr_get_chromaticities(context, 0, "chromaticities", &c), 0);
    const exr_attr_chromaticities_t rec709 = {0.64f, 0.33f, 0.30f,   0.60f,
                                              0.15f, 0.06f, 0.3127f, 0.3290f};
    assert_memory_equal(&c, &rec709, sizeof c);
    char software[64];
    snprintf(software, sizeof software, "sparegs %s", sgs_version());
    assert_text(context, "software", software);
    assert_text(context, "sparegs:depthDefinition", info.depth_definition);
    assert_text(context, "sparegs:view", info.view_name);
    assert_transposed(context, "worldToCamera", world_to_camera);
    assert_transposed(context, "worldToNDC", world_to_ndc);
    const exr_attr_chlist_t *list;
    assert_int_equal(exr_get_channels(context, 0, &list), 0);
    assert_int_equal(list->num_channels, CHANNELS);
    for (int k = 1; k < list->num_channels; ++k)
        assert_true(strcmp(list->entries[k - 1].name.str, list->entries[k].name.str) < 0);
    exr_finish(&context);
    // The rates of OpenEXR's ImfStandardAttributes.h and ImfFramesPerSecond.h.
    static const struct {
        double rate;
        exr_attr_rational_t rational;
    } rates[] = {{24, {24, 1}},          {25, {25, 1}},          {23.976, {24000, 1001}},
                 {29.97, {30000, 1001}}, {59.94, {60000, 1001}}, {47.952, {48000, 1001}},
                 {12.5, {12500, 1000}},  {0.25, {250, 1000}},    {1000, {1000, 1}}};
    exr_attr_rational_t rational;
    for (size_t k = 0; k < sizeof rates / sizeof *rates; ++k) {
        sgs_exr_info timed = info;
        timed.frame_rate = rates[k].rate;
        assert_int_equal(sgs_exr_write(path, &timed, channels, 1), SGS_STATUS_OK);
        open_exr(path, &context);
        assert_int_equal(exr_attr_get_rational(context, 0, "framesPerSecond", &rational), 0);
        assert_int_equal(rational.num, rates[k].rational.num);
        assert_int_equal(rational.denom, rates[k].rational.denom);
        exr_finish(&context);
    }
    // Without matrices, texts and a rate.
    const sgs_exr_info bare = {.width = WIDTH, .height = HEIGHT};
    assert_int_equal(sgs_exr_write(path, &bare, channels, 1), SGS_STATUS_OK);
    open_exr(path, &context);
    exr_attr_m44f_t none;
    assert_int_not_equal(exr_attr_get_m44f(context, 0, "worldToCamera", &none), 0);
    assert_int_not_equal(exr_attr_get_rational(context, 0, "framesPerSecond", &rational), 0);
    exr_finish(&context);
    temp_folder_remove(&folder);
}

// The data window of every compression begins outside the display window; the film back is that of
// the display window.
static void overscan_surrounds_the_display_window(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "over.exr");
    enum { OVER = 5 };
    const double k[4] = {60, 60, 30, 20};
    for (int compression = 0; compression < SGS_EXR_COMPRESSION_COUNT; ++compression) {
        sgs_exr_info own = info;
        own.compression = (sgs_exr_compression)compression;
        own.overscan = OVER;
        own.intrinsics = k;
        if (sgs_exr_write(path, &own, channels, CHANNELS))
            fail_msg("%s", sgs_last_error());
        exr_context_t context;
        open_exr(path, &context);
        exr_attr_box2i_t data, display;
        assert_int_equal(exr_get_data_window(context, 0, &data), 0);
        assert_int_equal(exr_get_display_window(context, 0, &display), 0);
        const exr_attr_box2i_t outer = {.min = {.x = -OVER, .y = -OVER},
                                        .max = {.x = WIDTH - OVER - 1, .y = HEIGHT - OVER - 1}},
                               inner = {
                                   .min = {.x = 0, .y = 0},
                                   .max = {.x = WIDTH - 2 * OVER - 1, .y = HEIGHT - 2 * OVER - 1}};
        assert_memory_equal(&data, &outer, sizeof data);
        assert_memory_equal(&display, &inner, sizeof display);
        float window;
        assert_int_equal(exr_get_screen_window_width(context, 0, &window), 0);
        assert_true(window == (float)((WIDTH - 2 * OVER) / 60.0));
        exr_finish(&context);
        static char output[1 << 16];
        const char *const compare[] = {"oiiotool", path, "--ch", "depth.Z", "--printinfo", NULL};
        assert_int_equal(run_program(compare, output, sizeof output), 0);
        char origin[64];
        snprintf(origin, sizeof origin, "pixel data origin: x=%d, y=%d", -OVER, -OVER);
        assert_non_null(strstr(output, origin));
    }
    const int refused[] = {-1, (HEIGHT < WIDTH ? HEIGHT : WIDTH) / 2 + 1, 70000, INT_MAX};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; ++i) {
        sgs_exr_info own = info;
        own.overscan = refused[i];
        assert_int_equal(sgs_exr_write(path, &own, channels, CHANNELS),
                         SGS_STATUS_INVALID_ARGUMENT);
        sgs_exr_deep *deep;
        assert_int_equal(sgs_exr_deep_open(path, &own, 4, &deep), SGS_STATUS_INVALID_ARGUMENT);
        assert_null(deep);
    }
    temp_folder_remove(&folder);
}

static void attributes_out_of_range_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "out.exr");
    const double rates[] = {NAN, INFINITY, -24, 1e-4, 2e6};
    const double intrinsics[][4] = {{0, 60, 30, 20},      {60, 0, 30, 20},      {-60, 60, 30, 20},
                                    {NAN, 60, 30, 20},    {60, INFINITY, 3, 2}, {60, 60, NAN, 20},
                                    {60, 60, 30, -1e300}, {1e-300, 60, 30, 20}, {1e39, 1e39, 3, 2}};
    const size_t rate_count = sizeof rates / sizeof *rates;
    for (size_t k = 0; k < rate_count + sizeof intrinsics / sizeof *intrinsics; ++k) {
        sgs_exr_info own = info;
        sgs_exr_deep *deep;
        own.frame_rate = k < rate_count ? rates[k] : 0;
        own.intrinsics = k < rate_count ? NULL : intrinsics[k - rate_count];
        const char *word = k < rate_count ? "out.exr: frame_rate" : "out.exr: intrinsics";
        assert_int_equal(sgs_exr_write(path, &own, channels, CHANNELS),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), word));
        assert_int_equal(sgs_exr_deep_open(path, &own, 4, &deep), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), word));
        assert_int_equal(temp_folder_count(&folder), 0);
    }
    temp_folder_remove(&folder);
}

// One value of a pixel (oiiotool reorders the channels).
static void assert_dumped(const char *dump, int x, int y, const char *value)
{
    char place[64];
    snprintf(place, sizeof place, "Pixel (%d, %d):", x, y);
    const char *line = strstr(dump, place);
    assert_non_null(line);
    const char *end = strchr(line, '\n');
    const char *found = strstr(line, value);
    if (!found || (end && found > end))
        fail_msg("%s lacks '%s': %.300s", place, value, line);
}

static void exr_is_readable_by_another_program(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static float red[6] = {0, 0.5f, 1, -2, 4096, 0.25f}, depth[6] = {1, 2, 3, 4.5f, 1e6f, 0};
    static uint32_t hits[6] = {0, 1, 2, 3, 4, 70000};
    const sgs_exr_channel few[] = {{.name = "depth.Z", .floats = depth},
                                   {.name = "hits", .uints = hits},
                                   {.name = "R", .floats = red, .half = 1}};
    sgs_exr_info small = info;
    small.width = 3;
    small.height = 2;
    const char *path = temp_path(&folder, "small.exr");
    assert_int_equal(sgs_exr_write(path, &small, few, 3), SGS_STATUS_OK);
    static char output[1 << 16];
    const char *const information[] = {"oiiotool", "--info", "-v", path, NULL};
    const int status = run_program(information, output, sizeof output);
    assert_int_equal(status, 0);
    static const char *const expected[] = {
        "3 x    2, 3 channel",
        "R (half)",
        "depth.Z (float)",
        "hits (uint)",
        "openexr",
        "worldToCamera: 1, 5, 9, 0, 2, 6, 10, 0, 3, 7, 11, 0, 4, 8, 12, 1",
        "compression: \"zip\"",
        "sparegs:depthDefinition: \"mean",
        "sparegs:view: \"folder/DSC_0430.JPG\"",
        "Software: \"sparegs ",
    };
    for (size_t k = 0; k < sizeof expected / sizeof *expected; ++k) {
        if (!strcasestr(output, expected[k]))
            fail_msg("oiiotool does not say '%s' but:\n%s", expected[k], output);
    }
    const char *const dump[] = {"oiiotool", "--dumpdata", path, NULL};
    assert_int_equal(run_program(dump, output, sizeof output), 0);
    assert_dumped(output, 1, 0, " 0.500000000");
    assert_dumped(output, 1, 0, " 2.000000000");
    assert_dumped(output, 0, 1, " -2.000000000");
    assert_dumped(output, 0, 1, " 4.500000000");
    assert_dumped(output, 2, 1, " 0.000016298"); // integers are printed as fractions of 2^32 - 1
    temp_folder_remove(&folder);
}

// DWAA changes R, G, B of each layer only: luma and chroma are no colours here. Names that are
// prefixes of others keep their order. OpenEXR's C library 3.1 cannot decode DWAA.
static void exr_dwaa_is_lossy_for_colors_only(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        bool lossy;
    } named[] = {{"A", false},      {"B", true},         {"BY", false},  {"G", true},
                 {"N.X", false},    {"N.Y", false},      {"N.Z", false}, {"R", true},
                 {"RY", false},     {"Y", false},        {"Y.R", true},  {"YZ", false},
                 {"ids.Y", false},  {"light.B", true},   {"y", false},   {"light.G", true},
                 {"light.R", true}, {"light.Y/x", false}};
    enum { NAMED = sizeof named / sizeof *named };
    sgs_exr_channel many[NAMED];
    for (size_t k = 0; k < NAMED; ++k) {
        const bool uints = !strcmp(named[k].name, "ids.Y");
        many[k] = (sgs_exr_channel){.name = named[k].name,
                                    .floats = uints ? NULL : planes[k % 3 + 1],
                                    .uints = uints ? ids : NULL,
                                    .half = named[k].name[0] == 'l'};
    }
    const temp_folder folder = temp_folder_make();
    char paths[2][300];
    for (int k = 0; k < 2; ++k) {
        sgs_exr_info own = info;
        own.compression = k ? SGS_EXR_DWAA : SGS_EXR_NONE;
        snprintf(paths[k], sizeof paths[k], "%s", temp_path(&folder, k ? "dwaa.exr" : "none.exr"));
        if (sgs_exr_write(paths[k], &own, many, NAMED))
            fail_msg("%s", sgs_last_error());
    }
    static char output[1 << 14];
    for (size_t k = 0; k < NAMED; ++k) {
        const char *const compare[] = {"oiiotool",    "--fail",      "0",      paths[0],
                                       "--ch",        named[k].name, paths[1], "--ch",
                                       named[k].name, "--diff",      NULL};
        const int status = run_program(compare, output, sizeof output);
        if (!status == named[k].lossy || strstr(output, "ERROR"))
            fail_msg("%s: oiiotool ends with %d: %s", named[k].name, status, output);
    }
    temp_folder_remove(&folder);
}

// OpenImageIO does not encode one channel with DWAA.
static void exr_dwaa_of_one_channel_is_zip(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "depth.exr");
    sgs_exr_info own = info;
    own.compression = SGS_EXR_DWAA;
    if (sgs_exr_write(path, &own, channels, 1))
        fail_msg("%s", sgs_last_error());
    exr_context_t context;
    open_exr(path, &context);
    static unsigned char pixels[4 * WIDTH * HEIGHT];
    read_channel(context, channels[0].name, 4, pixels);
    assert_memory_equal(pixels, channels[0].floats, sizeof pixels);
    exr_finish(&context);
    temp_folder_remove(&folder);
}

static void exr_write_failure_keeps_the_old_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "view.exr");
    assert_int_equal(sgs_exr_write(path, &info, channels, 1), SGS_STATUS_OK);
    size_t size, size_after;
    unsigned char *before = file_get(path, &size);
    static const size_t limits[] = {0, 100, 700, 1500, 9000, 20000};
    for (size_t k = 0; k < sizeof limits / sizeof *limits; ++k) {
        files_limited(limits[k]);
        const sgs_status status = sgs_exr_write(path, &info, channels, CHANNELS);
        files_unlimited();
        assert_int_equal(status, SGS_STATUS_IO);
        assert_non_null(strstr(sgs_last_error(), "view.exr: cannot be written: File too large"));
        assert_int_equal(temp_folder_count(&folder), 1);
    }
    unsigned char *after = file_get(path, &size_after);
    assert_int_equal(size, size_after);
    assert_memory_equal(before, after, size);
    free(before);
    free(after);
    assert_int_equal(sgs_exr_write("/nonexistent/folder/a.exr", &info, channels, 1), SGS_STATUS_IO);
    temp_folder_remove(&folder);
}

static void exr_write_reports_failed_allocations(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    char path[300];
    snprintf(path, sizeof path, "%s", temp_path(&folder, "view.exr"));
    sgs_exr_info zip = info;
    zip.compression = SGS_EXR_ZIP;
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    size_t n = 0;
    while (status) {
        sgsi_fail_allocation(++n);
        status = sgs_exr_write(path, &zip, channels, CHANNELS);
        if (status && status != SGS_STATUS_OUT_OF_MEMORY)
            fail_msg("allocation %zu: %s", n, sgs_last_error());
        assert_int_equal(temp_folder_count(&folder), status ? 0 : 1);
    }
    sgsi_fail_allocation(0);
    assert_true(n > 10);
    temp_folder_remove(&folder);
}

static void exr_rejects_invalid_arguments(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "view.exr");
    static const sgs_exr_channel same[] = {{.name = "R", .floats = planes[0]},
                                           {.name = "R", .floats = planes[1]}};
    static const sgs_exr_channel bad[] = {{.name = "R"},
                                          {.name = "R", .floats = planes[0], .uints = ids},
                                          {.name = "R", .uints = ids, .half = 1},
                                          {.name = "", .floats = planes[0]},
                                          {.floats = planes[0]}};
    assert_int_equal(sgs_exr_write(path, &info, same, 2), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "view.exr: duplicate channel 'R'"));
    for (size_t k = 0; k < sizeof bad / sizeof *bad; ++k)
        assert_int_equal(sgs_exr_write(path, &info, &bad[k], 1), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_exr_write(path, &info, channels, 0), SGS_STATUS_INVALID_ARGUMENT);
    static const int sizes[][2] = {{0, 5}, {5, 0}, {-1, 5}, {65537, 1}, {1, INT32_MAX}};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k) {
        const sgs_exr_info wrong = {.width = sizes[k][0], .height = sizes[k][1]};
        assert_int_equal(sgs_exr_write(path, &wrong, channels, 1), SGS_STATUS_INVALID_ARGUMENT);
    }
    assert_int_equal(temp_folder_count(&folder), 0);
    temp_folder_remove(&folder);
}

static void frame_rates_are_rational(void **state)
{
    (void)state;
    static const struct {
        double rate;
        int numerator, denominator;
    } cases[] = {{24, 24, 1},           {23.976, 24000, 1001}, {23.98, 23980, 1000},
                 {29.97, 30000, 1001},  {29.5, 29500, 1000},   {119.88, 120000, 1001},
                 {22.977, 22977, 1000}, {0.001, 1, 1000},      {1e6, 1000000, 1},
                 {12.3456, 12346, 1000}};
    int numerator = -1, denominator = -2;
    const double wrong[] = {0, 0.0009, -24, 1.001e6, NAN, INFINITY};
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; ++k)
        assert_false(sgs_frame_rate(wrong[k], &numerator, &denominator));
    assert_true(numerator == -1 && denominator == -2);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        assert_true(sgs_frame_rate(cases[k].rate, &numerator, &denominator));
        if (numerator != cases[k].numerator || denominator != cases[k].denominator)
            fail_msg("%g: %d/%d", cases[k].rate, numerator, denominator);
    }
}

static void pixels_of_calibrations_are_square(void **state)
{
    (void)state;
    static const struct {
        double fx, fy;
        int width, height;
        double aspect;
    } cases[] = {{500, 500, 640, 480, 1},     {500, 504, 640, 480, 1}, // 0.8 %
                 {500, 506, 640, 480, 1.012}, {500, 494, 640, 480, 0.988}, {500, 506, 640, 80, 1},
                 {500, 506, 80, 640, 1}, // less than 1/80
                 {500, 510, 640, 80, 1.02},   {100, 50, 640, 480, 0.5},    {50, 100, 640, 480, 2}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const double aspect =
            sgs_pixel_aspect(cases[k].fx, cases[k].fy, cases[k].width, cases[k].height);
        if (!(fabs(aspect - cases[k].aspect) < 1e-12))
            fail_msg("case %zu: %g", k, aspect);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exr_pixels_round_trip),
        cmocka_unit_test(frame_rates_are_rational),
        cmocka_unit_test(pixels_of_calibrations_are_square),
        cmocka_unit_test(exr_header_has_the_attributes),
        cmocka_unit_test(overscan_surrounds_the_display_window),
        cmocka_unit_test(attributes_out_of_range_are_refused),
        cmocka_unit_test(exr_is_readable_by_another_program),
        cmocka_unit_test(exr_dwaa_is_lossy_for_colors_only),
        cmocka_unit_test(exr_dwaa_of_one_channel_is_zip),
        cmocka_unit_test(exr_write_failure_keeps_the_old_file),
        cmocka_unit_test(exr_write_reports_failed_allocations),
        cmocka_unit_test(exr_rejects_invalid_arguments),
        cmocka_unit_test(exr_auto_compresses_bands_that_shrink),
    };
    return cmocka_run_group_tests(tests, fill_planes, NULL);
}
