// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Files that are written here byte by byte after the public descriptions of the formats, and their
// values; texts and bytes of written files.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/core.h"
#include "storage/archive.h"
#include "storage/unpack.h"
#include "sog/webp_image.h"
#include "support/files_support.h"
#include "support/model_bytes.h"
#include "support/model_support.h"
#include "sparegs/model_file.h"

static const double C0 = 0.28209479177387814;

static void splat_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    bytes file = {.size = 0};
    const float floats[] = {1.0f, 2.0f, -3.0f, 0.5f, 1.0f, 0.25f};
    const unsigned char rest[] = {255, 0, 51, 204, 192, 64, 128, 128};
    for (int k = 0; k < 6; ++k)
        put_float(&file, floats[k]);
    put(&file, rest, 8);
    sgs_gaussians *model = read_bytes(&folder, "a.splat", &file, &info);
    assert_int_equal(model->count, 1);
    assert_int_equal(model->sh_degree, 0);
    assert_int_equal(info.format, SGS_MODEL_SPLAT);
    expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){1, 2, -3});
    expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){log(0.5), 0, log(0.25)});
    expect_row(model, 0, SGS_PARAM_SH_DC, 3, (double[]){0.5 / C0, -0.5 / C0, (0.2 - 0.5) / C0});
    expect(model, 0, SGS_PARAM_OPACITY, logit(0.8));
    expect_row(model, 0, SGS_PARAM_ROTATION, 4, (double[]){0.5, -0.5, 0, 0});
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void compressed_ply_is_read(void **state)
{
    (void)state;
    static const char *const words[] = {"packed_position", "packed_rotation", "packed_scale",
                                        "packed_color"};
    static const char *const bounds[] = {"x",       "y", "z", "scale_x", "scale_y",
                                         "scale_z", "r", "g", "b"};
    const temp_folder folder = temp_folder_make();
    for (int colors = 0; colors < 2; ++colors) {
        bytes file = {.size = 0};
        sgs_model_info info;
        put_text(&file, "ply\nformat binary_little_endian 1.0\n"
                        "comment SplatRenderMode: MIP\nelement chunk 1\n");
        for (int k = 0; k < (colors ? 9 : 6); k += 3)
            for (int most = 0; most < 2; ++most)
                for (int axis = 0; axis < 3; ++axis)
                    put_text(&file, "property float %s_%s\n", most ? "max" : "min",
                             bounds[k + axis]);
        put_text(&file, "element vertex 1\n");
        for (int k = 0; k < 4; ++k)
            put_text(&file, "property uint %s\n", words[k]);
        put_text(&file, "element sh 1\n");
        for (int k = 0; k < 9; ++k)
            put_text(&file, "property uchar f_rest_%d\n", k);
        put_text(&file, "end_header\n");
        const float values[] = {-1, -2, -3, 1, 2,     3,    -8, -9,    -10,
                                -4, -5, -6, 0, 0.25f, 0.5f, 1,  0.75f, 0.5f};
        for (int k = 0; k < (colors ? 18 : 12); ++k)
            put_float(&file, values[k]);
        put_u32(&file, 2047u << 21 | 0u << 11 | 1024u);           // 11, 10, 11 bits
        put_u32(&file, 2u << 30 | 1023u << 20 | 0u << 10 | 512u); // y omitted; w, x, z
        put_u32(&file, 0u << 21 | 1023u << 11 | 2047u);
        put_u32(&file, 255u << 24 | 0u << 16 | 51u << 8 | 204u);
        put(&file, (const unsigned char[]){0, 255, 128, 127, 144, 112, 1, 2, 3}, 9);
        sgs_gaussians *model = read_bytes(&folder, "a.ply", &file, &info);
        assert_int_equal(info.format, SGS_MODEL_COMPRESSED_PLY); // by its contents
        assert_true(info.antialiased);
        assert_int_equal(model->sh_degree, 1);
        expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){1, -2, -3 + 6 * 1024.0 / 2047});
        expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){-8, -5, -6});
        const double r = sqrt(0.5), z = (512 / 1023.0 - 0.5) * sqrt(2.0);
        expect_row(model, 0, SGS_PARAM_ROTATION, 2, (double[]){r, -r});
        expect(model, 0, SGS_PARAM_ROTATION + 3, z);
        expect(model, 0, SGS_PARAM_OPACITY, logit(0.8));
        expect_row(model, 0, SGS_PARAM_SH_DC, 3,
                   colors ? (double[]){0.5 / C0, -0.25 / C0, 0}
                          : (double[]){0.5 / C0, -0.5 / C0, -0.3 / C0});
        // f_rest is channel-major in the file, coefficient-major in memory.
        const double sh[] = {-4, (127.5 / 256 - 0.5) * 8, (1.5 / 256 - 0.5) * 8, 4};
        expect_row(model, 0, SGS_PARAM_SH_REST, 4, sh);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

static void ksplat_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    bytes file = {.size = 4096 + 1024};
    unsigned char *header = file.data, *section = file.data + 4096;
    header[1] = 1;
    header[4] = header[8] = 1; // sections
    header[16] = 3;            // primitives
    header[20] = 1;            // level
    section[0] = section[4] = 3;
    section[8] = 2;  // primitives of a full bucket
    section[12] = 2; // buckets
    memcpy(section + 16, (const float[]){8.0f}, 4);
    section[20] = 12;
    section[24] = 0xFF;
    section[25] = 0x7F; // 32767
    section[32] = section[36] = 1;
    section[40] = 1;   // SH degree
    put_u32(&file, 1); // length of the partial bucket
    const float centers[] = {10, 20, 30, -1, -2, -3};
    for (int k = 0; k < 6; ++k)
        put_float(&file, centers[k]);
    for (unsigned i = 0; i < 3; ++i) {
        put_u16(&file, 0);
        put_u16(&file, 32767);
        put_u16(&file, 65534);
        put_u16(&file, 0x3800); // 0.5, 1, 0
        put_u16(&file, 0x3C00);
        put_u16(&file, 0x0000);
        put_u16(&file, 0x3400); // 0.25, -1, 0, 2^-15
        put_u16(&file, 0xBC00);
        put_u16(&file, 0x0000);
        put_u16(&file, 0x0200);
        put(&file, (const unsigned char[]){255, 0, 51, 204}, 4);
        for (unsigned k = 0; k < 9; ++k)
            put_u16(&file, 0x4000 + 0x0100 * k); // 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8
    }
    sgs_gaussians *model = read_bytes(&folder, "a.ksplat", &file, &info);
    assert_int_equal(model->count, 3);
    assert_int_equal(info.format, SGS_MODEL_KSPLAT);
    expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){10 - 4, 20, 30 + 4});
    expect_row(model, 1, SGS_PARAM_MEAN, 3, (double[]){10 - 4, 20, 30 + 4});
    expect_row(model, 2, SGS_PARAM_MEAN, 3, (double[]){-1 - 4, -2, -3 + 4});
    expect_row(model, 2, SGS_PARAM_SCALE, 3, (double[]){log(0.5), 0, -30});
    expect_row(model, 2, SGS_PARAM_ROTATION, 4, (double[]){0.25, -1, 0, 0x1p-15});
    expect_row(model, 2, SGS_PARAM_SH_DC, 3, (double[]){0.5 / C0, -0.5 / C0, -0.3 / C0});
    expect(model, 2, SGS_PARAM_OPACITY, logit(0.8));
    // The file has red, then green, then blue.
    expect_row(model, 2, SGS_PARAM_SH_REST, 9, (double[]){2, 3.5, 6, 2.5, 4, 7, 3, 5, 8});
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void put_glb(bytes *file, const char *json, const bytes *bin)
{
    bytes padded = {.size = 0};
    put(&padded, json, strlen(json));
    while (padded.size % 4)
        put_u8(&padded, ' ');
    put_u32(file, 0x46546C67);
    put_u32(file, 2);
    put_u32(file, (uint32_t)(28 + padded.size + bin->size));
    put_u32(file, (uint32_t)padded.size);
    put_u32(file, 0x4E4F534A);
    put(file, padded.data, padded.size);
    put_u32(file, (uint32_t)bin->size);
    put_u32(file, 0x004E4942);
    put(file, bin->data, bin->size);
}

#define KHR "\"KHR_gaussian_splatting"
static const char glb_text[] =
    "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
    "\"nodes\":[{\"translation\":[0,0,5],\"children\":[1]},{\"mesh\":0,\"scale\":[2,2,2],"
    "\"rotation\":[0,0,0.70710678,0.70710678]}],\"meshes\":[{\"primitives\":[{\"mode\":0,"
    "\"extensions\":{" KHR "\":{}},\"attributes\":{\"POSITION\":0," KHR ":ROTATION\":1," KHR
    ":SCALE\":2," KHR ":OPACITY\":3," KHR ":SH_DEGREE_0_COEF_0\":4}}]}],"
    "\"buffers\":[{\"byteLength\":36}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
    "\"accessors\":["
    "{\"bufferView\":0,\"byteOffset\":0,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"},"
    "{\"bufferView\":0,\"byteOffset\":12,\"componentType\":5120,\"normalized\":true,\"count\":1,"
    "\"type\":\"VEC4\"},"
    "{\"bufferView\":0,\"byteOffset\":16,\"componentType\":5123,\"normalized\":true,\"count\":1,"
    "\"type\":\"VEC3\"},"
    "{\"bufferView\":0,\"byteOffset\":22,\"componentType\":5121,\"normalized\":true,\"count\":1,"
    "\"type\":\"SCALAR\"},"
    "{\"bufferView\":0,\"byteOffset\":24,\"componentType\":5126,\"count\":1,\"type\":\"VEC3\"}]}";

static void put_glb_of(bytes *file, const char *json)
{
    bytes bin = {.size = 0};
    put_float(&bin, 1);
    put_float(&bin, 2);
    put_float(&bin, 3);
    put(&bin, (const signed char[]){127, 0, 0, 0}, 4); // x y z w
    put_u16(&bin, 65535);
    put_u16(&bin, 6553);
    put_u16(&bin, 655);
    put_u8(&bin, 204);
    put_u8(&bin, 0);
    put_float(&bin, 0.1f);
    put_float(&bin, 0.2f);
    put_float(&bin, 0.3f);
    put_glb(file, json, &bin);
}

static sgs_gaussians *read_glb(const temp_folder *folder, const char *json, sgs_model_info *info)
{
    bytes file = {.size = 0};
    put_glb_of(&file, json);
    return read_bytes(folder, "a.glb", &file, info);
}

static void glb_is_read_with_the_transforms_of_its_nodes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    sgs_gaussians *model = read_glb(&folder, glb_text, &info);
    assert_int_equal(info.format, SGS_MODEL_GLB);
    // Turned by 90 degrees about z, (x, y) -> (-y, x), doubled, moved; then x and y change signs.
    expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){4, -2, 11});
    expect_row(model, 0, SGS_PARAM_SCALE, 3,
               (double[]){log(2), log(2 * 6553 / 65535.0), log(2 * 655 / 65535.0)});
    const double r = sqrt(0.5); // (w, x, y, z) = (r, 0, 0, r) times (0, 1, 0, 0)
    expect_row(model, 0, SGS_PARAM_ROTATION, 4, (double[]){0, -r, -r, 0});
    expect(model, 0, SGS_PARAM_OPACITY, logit(0.8));
    expect_row(model, 0, SGS_PARAM_SH_DC, 3, (double[]){0.1, 0.2, 0.3});
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// The covariance of KHR_gaussian_splatting, M C C^T M^T. Here C is the diagonal of the scales, and
// M turns by 45 degrees about z, doubles y and turns by 90 degrees about z. Worked out by hand.
static void glb_is_read_with_deformed_gaussians(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *meshes = strstr(glb_text, ",\"meshes\"");
    bytes text = {.size = 0};
    sgs_model_info info;
    put(&text, glb_text, (size_t)(strstr(glb_text, "[0]}]") - glb_text));
    put_text(&text,
             "[0]}],\"nodes\":[{\"translation\":[0,0,5],\"rotation\":[0,0,0.70710678,0.70710678],"
             "\"scale\":[1,2,1],\"children\":[1]},{\"mesh\":0,"
             "\"rotation\":[0,0,0.38268343,0.92387953]}]%s",
             meshes);
    put_u8(&text, 0);
    sgs_gaussians *model = read_glb(&folder, (const char *)text.data, &info);
    // The point (1, 2, 3) turns to (-1, 3) r, is scaled to (-1, 6) r and turns to (-6, -1) r.
    const double r = sqrt(0.5), x = 1, y = 6553 / 65535.0, z = 655 / 65535.0;
    expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){6 * r, r, 8});
    // Likewise, the axes (x, 0) and (0, y) become (-2, 1) r x and (-2, -1) r y. Then x and y change
    // their signs, which leaves the covariance as it is.
    const double xx = 2 * (x * x + y * y), xy = -(x * x - y * y), yy = 0.5 * (x * x + y * y);
    double q[4], scales[3], got[3][3], least = INFINITY;
    for (int k = 0; k < 4; ++k)
        q[k] = (double)model_value(model, 0, SGS_PARAM_ROTATION + k);
    for (int k = 0; k < 3; ++k) {
        scales[k] = exp((double)model_value(model, 0, SGS_PARAM_SCALE + k));
        least = fmin(least, scales[k]);
    }
    model_covariance(q, scales, got);
    const double expected[3][3] = {{xx, xy, 0}, {xy, yy, 0}, {0, 0, z * z}};
    for (int i = 0; i < 9; ++i)
        if (!(fabs(got[i / 3][i % 3] - expected[i / 3][i % 3]) <= 1e-6))
            fail_msg("covariance %d, %d: %g, not %g", i / 3, i % 3, got[i / 3][i % 3],
                     expected[i / 3][i % 3]);
    assert_true(fabs(least / z - 1) <= 1e-5); // not lost beside the others
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Of two Gaussians, the one with the scales (-1, 1, 1) is dropped, with any transform of its node;
// likewise, if it is asked for, the one with rotation 0 0 0 0.
static void glb_drops_invalid_gaussians_of_any_node(void **state)
{
    (void)state;
    enum { NODES = 4 };
    static const char *const nodes[NODES] = {"", ",\"scale\":[1,2,1]", ",\"scale\":[-1,1,1]",
                                             ",\"rotation\":[0,0,0.6,0.8]"};
    const temp_folder folder = temp_folder_make();
    for (int n = 0; n < 2 * NODES; ++n) {
        const bool unrotated = n >= NODES;
        bytes text = {.size = 0}, bin = {.size = 0}, file = {.size = 0};
        put_text(&text,
                 "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
                 "\"nodes\":[{\"mesh\":0%s}],\"meshes\":[{\"primitives\":[{\"mode\":0,"
                 "\"extensions\":{" KHR "\":{}},\"attributes\":{\"POSITION\":0," KHR
                 ":ROTATION\":1," KHR ":SCALE\":0," KHR ":OPACITY\":2," KHR
                 ":SH_DEGREE_0_COEF_0\":0}}]}],"
                 "\"buffers\":[{\"byteLength\":64}],\"bufferViews\":[{\"buffer\":0,"
                 "\"byteLength\":64}],\"accessors\":[",
                 nodes[n % NODES]);
        for (int k = 0; k < 3; ++k)
            put_text(&text,
                     "%s{\"bufferView\":0,\"byteOffset\":%d,\"componentType\":5126,\"count\":2,"
                     "\"type\":\"%s\"}",
                     k ? "," : "", (const int[]){0, 24, 56}[k],
                     (const char *[]){"VEC3", "VEC4", "SCALAR"}[k]);
        put_text(&text, "]}");
        put_u8(&text, 0);
        const float values[16] = {unrotated ? 1 : -1, 1, 1, 1, 1, 1,    0,   0, 0, // scales, x y z
                                  unrotated ? 0 : 1,  0, 0, 0, 1, 0.5f, 0.5f};
        for (int k = 0; k < 16; ++k)
            put_float(&bin, values[k]);
        put_glb(&file, (const char *)text.data, &bin);
        file_put(temp_path(&folder, "a.glb"), file.data, file.size);
        sgs_model_read_options options = sgs_model_read_options_default();
        sgs_gaussians *model;
        options.drop_zero_quaternions = unrotated;
        assert_int_equal(sgs_model_read(temp_path(&folder, "a.glb"), &options, &model, NULL), 0);
        if (model->count != 1)
            fail_msg("%zu Gaussians, case %d", model->count, n);
        expect(model, 0, SGS_PARAM_SCALE, 0);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

// Data of other extensions: in a buffer without bytes (EXT_meshopt_compression), or as SPZ.
static void compressed_glb_is_refused(void **state)
{
    (void)state;
    static const char *const changes[][3] = {
        {"36}],\"bufferViews\":[{\"buffer\":0",
         "36},{\"byteLength\":36}],\"bufferViews\":[{\"buffer\":1",
         "'POSITION' is sparse or not in the binary chunk"},
        {KHR "\":{}", KHR "\":{\"extensions\":{" KHR "_compression_spz_2\":{\"bufferView\":0}}}",
         "its Gaussians are compressed"}};
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        const char *at = strstr(glb_text, changes[k][0]);
        bytes text = {.size = 0}, file = {.size = 0};
        put_text(&text, "%.*s%s%s", (int)(at - glb_text), glb_text, changes[k][1],
                 at + strlen(changes[k][0]));
        put_u8(&text, 0);
        put_glb_of(&file, (const char *)text.data);
        file_put(temp_path(&folder, "a.glb"), file.data, file.size);
        model_refused(temp_path(&folder, "a.glb"), SGS_STATUS_UNSUPPORTED, changes[k][2],
                      changes[k][1]);
    }
    temp_folder_remove(&folder);
}

// A flattened object, its child, and 5000 empty nodes.
static void glb_is_read_beside_nodes_of_other_kinds(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    bytes text = {.size = 0};
    const char *scene = strstr(glb_text, "[0]}]"), *meshes = strstr(glb_text, "],\"meshes\"");
    put(&text, glb_text, (size_t)(scene - glb_text));
    put_text(&text, "[2,0");
    for (int k = 0; k < 5000; ++k)
        put_text(&text, ",3");
    put_text(&text, "%.*s", (int)(meshes - scene) - 2, scene + 2);
    put_text(&text, ",{\"scale\":[1,0,1],\"children\":[4]}");
    for (int k = 0; k < 5002; ++k)
        put_text(&text, ",{}");
    put_text(&text, "%s", meshes);
    put_u8(&text, 0);
    sgs_gaussians *model = read_glb(&folder, (const char *)text.data, &info);
    assert_int_equal(model->count, 1);
    expect_row(model, 0, SGS_PARAM_MEAN, 3, (double[]){4, -2, 11});
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void put_texture(const temp_folder *folder, const char *name, int width, int height,
                        const unsigned char *rgba)
{
    sgsi_webp image = {.width = width, .height = height, .rgba = (uint8_t *)rgba};
    uint8_t *packed;
    size_t size;
    assert_int_equal(sgsi_webp_encode(&image, &packed, &size), SGS_STATUS_OK);
    file_put(temp_path(folder, name), packed, size);
    sgsi_free(packed);
}

static void put_numbers(bytes *text, double first, double step)
{
    for (int k = 0; k < 256; ++k)
        put_text(text, "%s%.6f", k ? "," : "", first + step * k);
}

// Two primitives in textures of 4 x 4 pixels; 70 palette entries, of which the second has label 65.
static void put_sog_textures(const temp_folder *folder)
{
    unsigned char pixels[64] = {0};
    static unsigned char palette[192 * 2 * 4];
    memcpy(pixels, (const unsigned char[]){0xFF, 0, 0x34, 255, 0, 0, 0, 255}, 8);
    put_texture(folder, "l.webp", 4, 4, pixels);
    memcpy(pixels, (const unsigned char[]){0xFF, 0, 0x12, 255, 0, 0, 0, 255}, 8);
    put_texture(folder, "u.webp", 4, 4, pixels);
    // x omitted (tag 253): w, y, z = 0.8, -0.6, 0 over sqrt(2) in 8 bits; an invalid tag.
    memcpy(pixels, (const unsigned char[]){230, 51, 128, 253, 1, 2, 3, 0}, 8);
    put_texture(folder, "q.webp", 4, 4, pixels);
    memcpy(pixels, (const unsigned char[]){10, 20, 30, 255, 0, 254, 253, 255}, 8);
    put_texture(folder, "s.webp", 4, 4, pixels);
    memcpy(pixels, (const unsigned char[]){1, 2, 3, 204, 0, 5, 6, 0}, 8);
    put_texture(folder, "c.webp", 4, 4, pixels);
    memcpy(pixels, (const unsigned char[]){65, 0, 0, 255, 0, 1, 0, 255}, 8); // 65 and 256
    put_texture(folder, "n.webp", 4, 4, pixels);
    // Entry 65 is the second of the second row; its three coefficients follow each other.
    for (int j = 0; j < 3; ++j)
        for (int c = 0; c < 3; ++c)
            palette[4 * (192 + 3 + j) + c] = (unsigned char)(100 + 10 * j + c);
    put_texture(folder, "p.webp", 192, 2, palette);
}

static void check_sog(const sgs_gaussians *model, const double scales[3], const double colors[3],
                      double opacity, double rest)
{
    assert_int_equal(model->count, 2);
    assert_int_equal(model->sh_degree, 1);
    const double z = -1 + 5 * 0x1234 / 65535.0;
    expect_row(model, 0, SGS_PARAM_MEAN, 3,
               (double[]){exp(1) - 1, 1 - exp(2), copysign(exp(fabs(z)) - 1, z)});
    const double w = (230 / 255.0 * 2 - 1) / sqrt(2.0), y = (51 / 255.0 * 2 - 1) / sqrt(2.0),
                 last = (128 / 255.0 * 2 - 1) / sqrt(2.0);
    expect_row(model, 0, SGS_PARAM_ROTATION, 4,
               (double[]){w, sqrt(1 - w * w - y * y - last * last), y, last});
    expect_row(model, 1, SGS_PARAM_ROTATION, 4, (double[]){1, 0, 0, 0});
    expect_row(model, 0, SGS_PARAM_SCALE, 3, scales);
    expect_row(model, 0, SGS_PARAM_SH_DC, 3, colors);
    expect(model, 0, SGS_PARAM_OPACITY, opacity);
    for (int k = 0; k < 9; ++k) // steps of 0.01 from `rest`; a label beyond the palette is 0
        expect(model, 0, SGS_PARAM_SH_REST + k, rest + 0.01 * (10 * (k / 3) + k % 3));
    for (int k = 0; k < 9; ++k)
        expect(model, 1, SGS_PARAM_SH_REST + k, 0);
}

static void sog_is_read(void **state)
{
    (void)state;
    bytes text = {.size = 0};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model;
    sgs_model_info info;
    put_sog_textures(&folder);
    put_text(
        &text,
        "{\"version\":2,\"count\":2,\"model\":\"antialiased\",\"means\":{\"mins\":[0,-2,-1],"
        "\"maxs\":[1,3,4],\"files\":[\"l.webp\",\"u.webp\"]},\"quats\":{\"files\":[\"q.webp\"]},"
        "\"scales\":{\"files\":[\"s.webp\"],\"codebook\":[");
    put_numbers(&text, -10, 0.05);
    put_text(&text, "]},\"sh0\":{\"files\":[\"c.webp\"],\"codebook\":[");
    put_numbers(&text, -1, 0.25);
    put_text(
        &text,
        "]},\"shN\":{\"count\":70,\"bands\":1,\"files\":[\"p.webp\",\"n.webp\"],\"codebook\":[");
    put_numbers(&text, -1, 0.01);
    put_text(&text, "]}}");
    file_put(temp_path(&folder, "meta.json"), text.data, text.size);
    if (sgs_model_read(folder.path, NULL, &model, &info))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(info.format, SGS_MODEL_SOG);
    assert_true(info.antialiased);
    check_sog(model, (double[]){-9.5, -9, -8.5}, (double[]){-0.75, -0.5, -0.25}, logit(0.8), 0.0);
    sgs_gaussians_destroy(model);

    // Early writers of version 2 stored null as the first entry of each codebook.
    static const char list[] = "\"codebook\":[";
    for (char *at = (char *)text.data; (at = strstr(at, list));) {
        at += strlen(list);
        memset(at, ' ', strcspn(at, ","));
        memcpy(at, "null", 4);
    }
    file_put(temp_path(&folder, "meta.json"), text.data, text.size);
    assert_int_equal(sgs_model_read(folder.path, NULL, &model, NULL), SGS_STATUS_OK);
    check_sog(model, (double[]){-9.5, -9, -8.5}, (double[]){-0.75, -0.5, -0.25}, logit(0.8), 0.0);
    expect(model, 1, SGS_PARAM_SCALE, -9.95 + (-9.95 - 2.75) / 255); // t1 + (t1 - t255) / 255
    expect(model, 1, SGS_PARAM_SH_DC, -0.75 + (-0.75 - 62.75) / 255);
    sgs_gaussians_destroy(model);

    // Version 1: bounds instead of codebooks, and opacity logits.
    text.size = 0;
    put_text(
        &text,
        "{\"means\":{\"shape\":[2,3],\"mins\":[0,-2,-1],\"maxs\":[1,3,4],\"files\":[\"l.webp\","
        "\"u.webp\"]},\"quats\":{\"files\":[\"q.webp\"]},"
        "\"scales\":{\"files\":[\"s.webp\"],\"mins\":[0,0,0],\"maxs\":[2.55,5.1,7.65]},"
        "\"sh0\":{\"files\":[\"c.webp\"],\"mins\":[0,0,0,-10],\"maxs\":[255,2.55,25.5,10]},"
        "\"shN\":{\"mins\":-1,\"maxs\":1.55,\"files\":[\"p.webp\",\"n.webp\"]}}");
    file_put(temp_path(&folder, "meta.json"), text.data, text.size);
    if (sgs_model_read(temp_path(&folder, "meta.json"), NULL, &model, &info))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(info.version, 1);
    check_sog(model, (double[]){0.1, 0.4, 0.9}, (double[]){1, 0.02, 0.3}, -10 + 20 * 0.8, 0.0);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void contains(const char *text, const char *part)
{
    if (!strstr(text, part))
        fail_msg("'%s' is not in: %s", part, text);
}

// The specification has "antialias", splat-transform writes "model".
static void sog_marks_of_antialiasing_are_read_and_written(void **state)
{
    (void)state;
    static const struct {
        const char *members;
        bool antialiased;
    } cases[] = {{"", false},
                 {"\"antialias\":true,", true},
                 {"\"antialias\":false,", false},
                 {"\"antialias\":null,\"model\":\"default\",", false},
                 {"\"model\":\"antialiased\",", true},
                 {"\"antialias\":true,\"model\":\"antialiased\",", true}};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(3, 0);
    sgs_model_write_options options = sgs_model_write_options_default();
    size_t size;
    assert_int_equal(sgs_model_write(temp_path(&folder, "meta.json"), model, &options, NULL),
                     SGS_STATUS_OK);
    char *text = (char *)file_get(temp_path(&folder, "meta.json"), &size);
    assert_true(!strstr(text, "\"antialias") && !strstr(text, "\"model\""));
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        bytes changed = {.size = 0};
        sgs_model_info info;
        put_text(&changed, "{%s%s", cases[k].members, text + 1);
        sgs_gaussians *back = read_bytes(&folder, "meta.json", &changed, &info);
        assert_int_equal(info.antialiased, cases[k].antialiased);
        sgs_gaussians_destroy(back);
    }
    free(text);
    options.antialiased = true;
    assert_int_equal(sgs_model_write(temp_path(&folder, "meta.json"), model, &options, NULL),
                     SGS_STATUS_OK);
    text = (char *)file_get(temp_path(&folder, "meta.json"), &size);
    contains(text, "\"antialias\":true");
    contains(text, "\"model\":\"antialiased\"");
    free(text);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void usda_has_the_attributes_of_the_schema(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(1, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, 1), SGS_STATUS_OK);
    model->sh_degree = 1;
    float p[SGS_PARAM_COUNT] = {
        1, 2, 3, 0, 2, 0, 0, 0, (float)log(2), (float)log(0.5), 0, 0.25f, 0.5f, 0.75f, 1,
        2, 3, 4, 5, 6, 7, 8, 9};
    sgs_gaussians_set(model, 0, p);
    // 100 x 50 pixels, f 200: 36 mm aperture and 72 mm focal length. A quarter turn about y.
    const sgs_model_camera camera = {.name = "a \"b\".jpg",
                                     .width = 100,
                                     .height = 50,
                                     .fx = 200,
                                     .fy = 400,
                                     .cx = 45,
                                     .cy = 30,
                                     .rotation = {0, 0, -1, 0, 1, 0, 1, 0, 0},
                                     .translation = {1, 2, 3}};
    sgs_model_write_options options = sgs_model_write_options_default();
    options.cameras = &camera;
    options.camera_count = 1;
    sgs_model_written written;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.usda"), model, &options, &written),
                     SGS_STATUS_OK);
    size_t size;
    char *text = (char *)file_get(temp_path(&folder, "a.usda"), &size);
    assert_int_equal(written.bytes, size);
    assert_memory_equal(text, "#usda 1.0\n(\n", 12);
    contains(text, "def ParticleField3DGaussianSplat \"Splats\"");
    contains(text, "point3f[] positions = [\n            (1, -2, -3)\n        ]");
    contains(text, "quatf[] orientations = [\n            (0, 1, 0, 0)\n        ]"); // unit
    contains(text, "float3[] scales = [\n            (1, 2, 0.5)\n        ]");
    contains(text, "float[] opacities = [\n            0.5\n        ]");
    contains(text, "uniform int radiance:sphericalHarmonicsDegree = 1");
    // y and z change signs: coefficients 1 and 2 (y, z) do, 3 (x) does not.
    contains(text, "(0.25, 0.5, 0.75), (-1, -2, -3), (-4, -5, -6), (7, 8, 9)\n        ] (\n"
                   "            elementSize = 4\n            interpolation = \"vertex\"");
    contains(text, "uniform token sortingModeHint = \"rayHitDistance\"");
    double box[6]; // three standard deviations; the rotation by 180 degrees does not change it
    const char *extent = strstr(text, "float3[] extent = [");
    assert_non_null(extent);
    assert_int_equal(sscanf(extent, "float3[] extent = [(%lf, %lf, %lf), (%lf, %lf, %lf)]", box,
                            box + 1, box + 2, box + 3, box + 4, box + 5),
                     6);
    for (int k = 0; k < 6; ++k)
        assert_true(fabs(box[k] - (const double[]){-2, -8, -4.5, 4, 4, -1.5}[k]) <= 1e-6);
    contains(text, "string image = \"a \\\"b\\\".jpg\"");
    contains(text, "float focalLength = 72\n");
    contains(text, "float horizontalApertureOffset = 1.8\n"); // (50 - 45) 36 / 100
    contains(text, "float verticalAperture = 9\n");           // 50 * 72 / 400
    contains(text, "float verticalApertureOffset = 0.9\n");   // (30 - 25) 72 / 400
    // Rows: x axis (0,0,-1), minus y axis (0,1,0), minus z axis (1,0,0), centre -R^T t = (-3,-2,1);
    // the second and third coordinate of each change signs.
    contains(text, "( (0, -0, 1, 0), (-0, 1, 0, 0), (-1, 0, 0, 0), (-3, 2, -1, 1) )");
    free(text);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splat_is_read),
        cmocka_unit_test(compressed_ply_is_read),
        cmocka_unit_test(ksplat_is_read),
        cmocka_unit_test(glb_is_read_with_the_transforms_of_its_nodes),
        cmocka_unit_test(glb_is_read_with_deformed_gaussians),
        cmocka_unit_test(glb_is_read_beside_nodes_of_other_kinds),
        cmocka_unit_test(glb_drops_invalid_gaussians_of_any_node),
        cmocka_unit_test(compressed_glb_is_refused),
        cmocka_unit_test(sog_is_read),
        cmocka_unit_test(sog_marks_of_antialiasing_are_read_and_written),
        cmocka_unit_test(usda_has_the_attributes_of_the_schema),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
