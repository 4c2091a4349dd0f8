// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Small files that expand to huge models: equal bytes compress a thousandfold, and manifests repeat
// units. They are refused before their data is decoded; compressible models of a plausible size are
// read.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <jansson.h>
#include <time.h>

#include "storage/model_rows.h"
#include "sog/sog.h"
#include "storage/unpack.h"
#include "support/bad_input.h"
#include "support/files_support.h"
#include "support/model_support.h"
#include "support/warning_support.h"
#include "sparegs/model_file.h"

enum { MANY = 300000, SIDE = 600 }; // SIDE^2 >= MANY

static void refuse(const char *path, sgs_status expected, const char *message)
{
    model_refused(path, expected, message, "a file that expands");
}

static void accept_model(const char *path, size_t count)
{
    sgs_gaussians *model;
    if (sgs_model_read(path, NULL, &model, NULL))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(model->count, count);
    sgs_gaussians_destroy(model);
}

// ---- SPZ ----

static void put_spz_header(uint8_t *at, uint32_t version, uint32_t count)
{
    memcpy(at, "NGSP", 4);
    sgsi_store_u32(at + 4, version);
    sgsi_store_u32(at + 8, count);
    at[13] = 12; // fractional bits
}

// Version 4 with streams of zeros.
static void put_spz_4(const char *path, uint32_t count)
{
    static const size_t widths[5] = {9, 1, 3, 3, 4};
    uint8_t *file = calloc(1, 1 << 16), *zeros = calloc(count, 9);
    size_t at = 32 + 5 * 16;
    assert_true(file && zeros);
    put_spz_header(file, 4, count);
    file[15] = 5;
    sgsi_store_u32(file + 16, 32);
    for (size_t k = 0; k < 5; ++k) {
        uint8_t *packed;
        size_t size;
        assert_int_equal(sgsi_pack(SGSI_PACKING_ZSTD, 1, zeros, widths[k] * count, &packed, &size),
                         SGS_STATUS_OK);
        assert_true(at + size < 1 << 16);
        memcpy(file + at, packed, size);
        sgsi_store_u64(file + 32 + 16 * k, size);
        sgsi_store_u64(file + 40 + 16 * k, widths[k] * count);
        at += size;
        sgsi_free(packed);
    }
    file_put(path, file, at);
    free(file);
    free(zeros);
}

// Version 3: a header and `size` zeros.
static void put_spz_3(const char *path, uint32_t count, size_t size)
{
    uint8_t *plain = calloc(1, 16 + size), *packed;
    size_t packed_size;
    assert_non_null(plain);
    put_spz_header(plain, 3, count);
    assert_int_equal(sgsi_pack(SGSI_PACKING_GZIP, 9, plain, 16 + size, &packed, &packed_size),
                     SGS_STATUS_OK);
    file_put(path, packed, packed_size);
    sgsi_free(packed);
    free(plain);
}

static void spz_of_zeros_is_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.spz");
    put_spz_4(path, MANY);
    refuse(path, SGS_STATUS_LIMIT, "byte 8: 300000 primitives are more than a file of");
    put_spz_4(path, 65536);
    accept_model(path, 65536);
    put_spz_3(path, MANY, 20 * (size_t)MANY);
    refuse(path, SGS_STATUS_LIMIT, "byte 8: 300000 primitives are more than a file of");
    put_spz_3(path, 65536, 20 * 65536);
    accept_model(path, 65536);
    put_spz_3(path, 1, (size_t)32 << 20);
    refuse(path, SGS_STATUS_FORMAT, "gzip data decompresses to more than");
    temp_folder_remove(&folder);
}

// `count` primitives of equal shape and colour: at one place, or on a grid.
static sgs_gaussians *model_uniform(size_t count, size_t side)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    model->sh_degree = 0;
    for (size_t i = 0; i < count; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        if (side) {
            p[SGS_PARAM_MEAN] = (float)(i % side) / 256.0f;
            p[SGS_PARAM_MEAN + 1] = (float)(i / side % side) / 256.0f;
            p[SGS_PARAM_MEAN + 2] = (float)(i / side / side) / 256.0f;
        }
        p[SGS_PARAM_ROTATION] = 1.0f;
        sgs_gaussians_set(model, i, p);
    }
    return model;
}

// As readers of version 4 demand: extension records up to the table of sizes, and nothing after
// the last stream.
static void assert_spz_4_is_full(const char *path)
{
    size_t size, at = 32;
    unsigned char *bytes = file_get(path, &size);
    const size_t table = sgsi_load_u32(bytes + 16), streams = bytes[15];
    while (bytes[14] & 2 && at < table)
        at += 8 + sgsi_load_u32(bytes + at + 4);
    assert_int_equal(at, table);
    at += 16 * streams;
    for (size_t k = 0; k < streams; ++k)
        at += sgsi_load_u64(bytes + table + 16 * k);
    assert_int_equal(at, size);
    free(bytes);
}

static void compressible_spz_is_read_back(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.spz");
    sgs_model_write_options options = sgs_model_write_options_default();
    for (size_t side = 0; side <= 64; side += 64) {
        sgs_gaussians *model = model_uniform(64 * 64 * 64, side);
        for (int variant = 0; variant < 4; ++variant) {
            options.spz_version = 3 + variant % 2;
            options.spz_axes = variant / 2 ? SGS_SPZ_AXES_RDF : SGS_SPZ_AXES_RUB;
            assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
            accept_model(path, model->count);
            if (options.spz_version == 4)
                assert_spz_4_is_full(path);
        }
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

// ---- SOG as a ZIP file ----

// A ZIP file of deflated entries.
static void put_zip(const char *path, const sgsi_archive_file *files, size_t count)
{
    uint8_t *bytes = calloc(1, 1 << 20), *central = calloc(1, 4096);
    size_t at = 0, directory = 0;
    assert_true(bytes && central);
    for (size_t k = 0; k < count; ++k) {
        uint8_t *packed, *local = bytes + at, *entry = central + directory;
        size_t size;
        const size_t length = strlen(files[k].name);
        assert_int_equal(
            sgsi_pack(SGSI_PACKING_DEFLATE, 9, files[k].bytes, files[k].size, &packed, &size),
            SGS_STATUS_OK);
        assert_true(at + size + 4096 < 1 << 20);
        sgsi_store_u32(local, 0x04034B50);
        sgsi_store_u16(local + 26, (uint32_t)length);
        memcpy(local + 30, files[k].name, length);
        memcpy(local + 30 + length, packed, size);
        sgsi_store_u32(entry, 0x02014B50);
        sgsi_store_u16(entry + 10, 8);
        sgsi_store_u32(entry + 20, (uint32_t)size);
        sgsi_store_u32(entry + 24, (uint32_t)files[k].size);
        sgsi_store_u16(entry + 28, (uint32_t)length);
        sgsi_store_u32(entry + 42, (uint32_t)at);
        memcpy(entry + 46, files[k].name, length);
        at += 30 + length + size;
        directory += 46 + length;
        sgsi_free(packed);
    }
    memcpy(bytes + at, central, directory);
    uint8_t *end = bytes + at + directory;
    sgsi_store_u32(end, 0x06054B50);
    sgsi_store_u16(end + 10, (uint32_t)count);
    sgsi_store_u32(end + 12, (uint32_t)directory);
    sgsi_store_u32(end + 16, (uint32_t)at);
    file_put(path, bytes, at + directory + 22);
    free(bytes);
    free(central);
}

// Appends `size` bytes of `value` to a file.
static void pad(sgsi_archive_file *file, size_t size, int value)
{
    uint8_t *bytes = sgsi_alloc(file->size + size, 1);
    assert_non_null(bytes);
    memcpy(bytes, file->bytes, file->size);
    memset(bytes + file->size, value, size);
    sgsi_free(file->bytes);
    file->bytes = bytes;
    file->size += size;
}

// The files of a model of `count` primitives, whose textures have one colour.
static size_t make_uniform_sog(size_t count, sgsi_archive_file files[SGSI_SOG_FILES])
{
    const sgs_model_write_options options = sgs_model_write_options_default();
    sgs_gaussians *model = model_uniform(3, 0);
    size_t file_count = 0;
    assert_int_equal(sgsi_sog_encode_model(model, &options, files, &file_count), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
    sgsi_webp image = {.width = SIDE, .height = SIDE, .rgba = calloc(SIDE * SIDE, 4)};
    assert_non_null(image.rgba);
    for (size_t k = 0; k + 1 < file_count; ++k) {
        sgsi_free(files[k].bytes);
        assert_int_equal(sgsi_webp_encode(&image, &files[k].bytes, &files[k].size), SGS_STATUS_OK);
    }
    free(image.rgba);
    sgsi_archive_file *meta = &files[file_count - 1];
    json_t *root = json_loadb((const char *)meta->bytes, meta->size, 0, NULL);
    assert_non_null(root);
    json_object_set_new(root, "count", json_integer((json_int_t)count));
    char *text = json_dumps(root, JSON_COMPACT);
    json_decref(root);
    sgsi_free(meta->bytes);
    meta->bytes = (uint8_t *)sgsi_strdup(text);
    meta->size = strlen(text);
    free(text);
    return file_count;
}

static void inflated_sog_is_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.sog");
    sgsi_archive_file files[SGSI_SOG_FILES] = {0};
    size_t count = make_uniform_sog(1000, files);
    sgsi_archive_file *meta = &files[count - 1];
    // SIDE^2 pixels are more than the bytes of the ZIP file, but not more than those inflated.
    pad(meta, 400000, ' ');
    put_zip(path, files, count);
    refuse(path, SGS_STATUS_LIMIT, "600 x 600 pixels, more than a file of this size can hold");
    pad(meta, 1 << 20, ' ');
    put_zip(path, files, count);
    refuse(path, SGS_STATUS_LIMIT, "bytes; the limit is 1048576");
    sgsi_sog_files_free(files);

    count = make_uniform_sog(MANY, files);
    pad(&files[count - 1], 400000, ' ');
    put_zip(path, files, count);
    refuse(path, SGS_STATUS_LIMIT, "meta.json: 300000 primitives are more than");
    sgsi_sog_files_free(files);

    count = make_uniform_sog(1000, files);
    pad(&files[0], 400000, 0);
    put_zip(path, files, count);
    refuse(path, SGS_STATUS_LIMIT, "means_l.webp has 4000");
    sgsi_sog_files_free(files);
    temp_folder_remove(&folder);
}

static void deflated_sog_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const sgs_model_write_options options = sgs_model_write_options_default();
    sgsi_archive_file files[SGSI_SOG_FILES] = {0};
    sgs_gaussians *models[2] = {model_random(2000, 3), model_uniform(60000, 0)};
    for (size_t k = 0; k < 2; ++k) {
        size_t count = 0;
        assert_int_equal(sgsi_sog_encode_model(models[k], &options, files, &count), SGS_STATUS_OK);
        put_zip(temp_path(&folder, "a.sog"), files, count);
        accept_model(temp_path(&folder, "a.sog"), models[k]->count);
        sgsi_sog_files_free(files);
        sgs_gaussians_destroy(models[k]);
    }
    temp_folder_remove(&folder);
}

// ---- SOG with levels of detail ----

static const char manifest_head[] = "{\"version\":1,\"lodLevels\":1,\"filenames\":[";

// A folder with the unit 0_0 of `count` primitives.
static void put_unit(const temp_folder *folder, size_t count)
{
    sgs_gaussians *model = model_random(count, 0);
    sgs_model_write_options options = sgs_model_write_options_default();
    options.lod_levels = 1;
    assert_int_equal(sgs_model_write(temp_path(folder, "lod-meta.json"), model, &options, NULL),
                     SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
}

static void put_manifest(const temp_folder *folder, const char *names, const char *children)
{
    char text[2048];
    const int length = snprintf(text, sizeof text, "%s%s],\"tree\":{\"children\":[%s]}}",
                                manifest_head, names, children);
    assert_in_range(length, 1, sizeof text - 1);
    file_put(temp_path(folder, "lod-meta.json"), text, (size_t)length);
}

#define RANGE(file, offset, count)                                                                 \
    "{\"lods\":{\"0\":{\"file\":" #file ",\"offset\":" #offset ",\"count\":" #count "}}}"

static void repeated_units_are_one(void **state)
{
    (void)state;
    static const char *const aliases[] = {"0_0/meta.json", "./0_0/meta.json", "0_0//meta.json",
                                          "link/meta.json"};
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "lod-meta.json");
    put_unit(&folder, 5);
    assert_int_equal(symlink("0_0", temp_path(&folder, "link")), 0);
    for (size_t k = 0; k < sizeof aliases / sizeof *aliases; ++k) {
        char names[128];
        snprintf(names, sizeof names, "\"%s\",\"none\",\"0_0/meta.json\"", aliases[k]);
        put_manifest(&folder, names, RANGE(2, 0, 5) "," RANGE(1, 0, 0) "," RANGE(0, 0, 5));
        refuse(path, SGS_STATUS_FORMAT, "the tree names 10 primitives of SOG file 0, which has 5");
        put_manifest(&folder, names, RANGE(2, 3, 2) "," RANGE(1, 0, 0) "," RANGE(0, 0, 3));
        accept_model(path, 5);
    }
    // Rows keep the order of the tree within a unit.
    sgs_gaussians *whole, *turned;
    put_manifest(&folder, "\"0_0/meta.json\"", RANGE(0, 0, 5));
    assert_int_equal(sgs_model_read(path, NULL, &whole, NULL), SGS_STATUS_OK);
    put_manifest(&folder, "\"0_0/meta.json\"", RANGE(0, 3, 2) "," RANGE(0, 0, 3));
    assert_int_equal(sgs_model_read(path, NULL, &turned, NULL), SGS_STATUS_OK);
    for (size_t i = 0; i < 5; ++i)
        assert_true(model_value(turned, i, 0) == model_value(whole, (i + 3) % 5, 0));
    sgs_gaussians_destroy(whole);
    sgs_gaussians_destroy(turned);
    put_manifest(&folder, "\"none/meta.json\"", RANGE(0, 0, 5));
    sgs_gaussians *none;
    assert_int_equal(sgs_model_read(path, NULL, &none, NULL), SGS_STATUS_IO);
    tree_remove(&folder);
}

// Version 1 has no codebooks: a unit of few bytes.
static void put_tiny_unit(const temp_folder *folder, const char *name, int count,
                          const sgsi_archive_file *texture)
{
    char text[1024], path[64];
    const int length = snprintf(
        text, sizeof text,
        "{\"means\":{\"shape\":[%d,3],\"mins\":[0,0,0],\"maxs\":[1,1,1],\"files\":[\"a\",\"a\"]},"
        "\"scales\":{\"mins\":[0,0,0],\"maxs\":[1,1,1],\"files\":[\"a\"]},"
        "\"quats\":{\"files\":[\"a\"]},"
        "\"sh0\":{\"mins\":[0,0,0,0],\"maxs\":[1,1,1,1],\"files\":[\"a\"]}}",
        count);
    assert_int_equal(mkdir(temp_path(folder, name), 0777), 0);
    snprintf(path, sizeof path, "%s/meta.json", name);
    file_put(temp_path(folder, path), text, (size_t)length);
    snprintf(path, sizeof path, "%s/a", name);
    file_put(temp_path(folder, path), texture->bytes, texture->size);
}

static void tiny_units_are_bounded_together(void **state)
{
    (void)state;
    enum { UNIT_ROWS = 60000 };
    const temp_folder folder = temp_folder_make();
    sgsi_archive_file texture = {.size = 0};
    sgsi_webp image = {.width = 256, .height = 256, .rgba = calloc(256 * 256, 4)};
    assert_non_null(image.rgba);
    assert_int_equal(sgsi_webp_encode(&image, &texture.bytes, &texture.size), SGS_STATUS_OK);
    put_tiny_unit(&folder, "u", UNIT_ROWS, &texture);
    put_tiny_unit(&folder, "v", UNIT_ROWS, &texture);
    put_manifest(&folder, "\"u/meta.json\",\"v/meta.json\"", RANGE(0, 0, 60000));
    accept_model(temp_path(&folder, "lod-meta.json"), UNIT_ROWS);
    put_manifest(&folder, "\"u/meta.json\",\"v/meta.json\"",
                 RANGE(0, 0, 60000) "," RANGE(1, 0, 60000));
    refuse(temp_path(&folder, "lod-meta.json"), SGS_STATUS_LIMIT,
           "120000 primitives are more than");
    put_manifest(&folder, "\"u/meta.json\"],\"environment\":\"v/meta.json\",\"others\":[",
                 RANGE(0, 0, 60000));
    refuse(temp_path(&folder, "lod-meta.json"), SGS_STATUS_LIMIT,
           "120000 primitives are more than");
    sgsi_free(texture.bytes);
    free(image.rgba);
    tree_remove(&folder);
}

// The time is proportional to the manifest, not to ranges times file names: it is compared with
// the time to parse it.
static void long_manifests_take_linear_time(void **state)
{
    (void)state;
    enum { ENTRIES = 200000 };
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "lod-meta.json");
    put_unit(&folder, 3);
    FILE *stream = fopen(path, "wb");
    assert_non_null(stream);
    fprintf(stream, "%s\"0_0/meta.json\"", manifest_head);
    for (int k = 1; k < ENTRIES; ++k)
        fputs(",\"a\"", stream);
    fputs("],\"tree\":{\"children\":[" RANGE(0, 0, 3), stream);
    for (int k = 1; k < ENTRIES; ++k)
        fprintf(stream, ",{\"lods\":{\"0\":{\"file\":%d,\"offset\":0,\"count\":0}}}", k);
    fputs("]}}", stream);
    assert_int_equal(fclose(stream), 0);
    const clock_t start = clock();
    json_t *root = json_load_file(path, JSON_REJECT_DUPLICATES, NULL);
    const clock_t parsed = clock();
    assert_non_null(root);
    json_decref(root);
    const clock_t begin = clock();
    accept_model(path, 3);
    const clock_t end = clock();
    if (end - begin > 20 * (parsed - start))
        fail_msg("reading took %ld times as long as parsing",
                 (long)((end - begin) / (parsed - start + 1)));
    tree_remove(&folder);
}

// The n-th allocation fails, for every n, while two units and an environment are read.
static void units_survive_lack_of_memory(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "lod-meta.json");
    sgs_gaussians *model = model_random(80, 0), *back = NULL;
    sgs_model_write_options options = sgs_model_write_options_default();
    options.lod_levels = 2;
    assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
    put_manifest(
        &folder,
        "\"0_0/meta.json\",\"1_0/meta.json\"],\"environment\":\"1_0/meta.json\",\"others\":[",
        RANGE(1, 0, 40) "," RANGE(0, 0, 80));
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    for (size_t n = 1; status; ++n) {
        sgsi_fail_allocation(n);
        status = sgs_model_read(path, NULL, &back, NULL);
        sgsi_fail_allocation(0);
        if (status && (status != SGS_STATUS_OUT_OF_MEMORY || back ||
                       strncmp(sgs_last_error(), folder.path, strlen(folder.path))))
            fail_msg("allocation %zu: %s", n, sgs_last_error());
        assert_true(n < 500);
    }
    assert_int_equal(back->count, 160);
    sgs_gaussians_destroy(back);
    sgs_gaussians_destroy(model);
    tree_remove(&folder);
}

// ---- Messages ----

static void refused_writes_name_the_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.ksplat");
    sgs_gaussians *model = model_random(3, 0);
    *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN) = 1e9f;
    assert_int_equal(sgs_model_write(path, model, NULL, NULL), SGS_STATUS_LIMIT);
    assert_int_equal(strncmp(sgs_last_error(), path, strlen(path)), 0);
    assert_non_null(strstr(sgs_last_error(), ": the model is larger than 10 million units"));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// ---- Ranges of the formats ----

// The degree is a field that the caller sets; the writers would size their rows by it.
static void models_of_unknown_degree_are_not_written(void **state)
{
    (void)state;
    static const char *const names[] = {"m.ply",  "m.spz",         "m.sog",    "m.ksplat",
                                        "m.glb",  "m.splat",       "m.usda",   "m.compressed.ply",
                                        "m.html", "lod-meta.json", "meta.json"};
    static const int degrees[] = {-1000, -1, 4, 1000};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(300, 3);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k)
        for (size_t d = 0; d < sizeof degrees / sizeof *degrees; ++d) {
            char expected[512];
            const char *path = temp_path(&folder, names[k]);
            snprintf(expected, sizeof expected,
                     "%s: SH degree %d of the model is not within 0 to 3", path, degrees[d]);
            model->sh_degree = degrees[d];
            assert_int_equal(sgs_model_write(path, model, NULL, NULL), SGS_STATUS_INVALID_ARGUMENT);
            assert_string_equal(sgs_last_error(), expected);
        }
    assert_int_equal(temp_folder_count(&folder), 0);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// NULL: none.
static void assert_warning(const char *expected)
{
    if (!expected)
        assert_string_equal(warnings, "");
    else
        assert_non_null(strstr(warnings, expected));
}

// Writes the model and reads it back; the warning of the writer is in warnings.
static sgs_gaussians *read_back(const char *path, const sgs_gaussians *model,
                                const sgs_model_write_options *options)
{
    sgs_gaussians *back;
    warnings_begin(NULL);
    const sgs_status status = sgs_model_write(path, model, options, NULL);
    warnings_end();
    if (status || sgs_model_read(path, NULL, &back, NULL))
        fail_msg("%s", sgs_last_error());
    return back;
}

// Coordinates beyond 24 bits would be clamped to a wall.
static void far_coordinates_of_spz_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.spz");
    sgs_gaussians *model = model_random(3, 0);
    sgs_model_write_options options = sgs_model_write_options_default();
    for (options.spz_version = 3; options.spz_version <= 4; ++options.spz_version) {
        *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN + 1) = -8388607.0f;
        sgs_gaussians *back = read_back(path, model, &options);
        assert_true(*sgs_gaussians_at(back, 1, SGS_PARAM_MEAN + 1) == -8388607.0f);
        sgs_gaussians_destroy(back);
        *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN + 1) = -8388608.0f;
        assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_LIMIT);
        assert_int_equal(strncmp(sgs_last_error(), path, strlen(path)), 0);
        assert_non_null(strstr(sgs_last_error(), "8388608 exceeds the 8388607 units of SPZ"));
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// One far primitive takes the fractional bits of all.
static void coarse_positions_of_spz_cause_a_warning(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(200, 0);
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = i < 3 ? -5.0f : -3.0f; // 0.007, 0.05
    static const struct {
        float far;
        const char *warning;                                    // NULL: none
    } cases[] = {{8191, NULL},                                  // steps of 1/1024 units
                 {65535, "all positions 0.00781 units"},        // 3 of 200 are smaller
                 {524287, "more than the size of 200 of 200"}}; // 1/16
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        *sgs_gaussians_at(model, 100, SGS_PARAM_MEAN) = cases[c].far;
        sgs_gaussians_destroy(read_back(temp_path(&folder, "a.spz"), model, NULL));
        assert_warning(cases[c].warning);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void scales_beyond_the_format_cause_a_warning(void **state)
{
    (void)state;
    const struct {
        const char *name, *warning; // NULL: none
        float scales[3], back;      // the largest one, as it is read
    } cases[] = {{"a.spz", NULL, {-30, -9, -8}, -8},
                 {"a.spz", NULL, {-30, 0, 5.9375f}, 5.9375f},
                 {"a.spz", "1 of 3 primitives have others", {-30, 0, 6}, 5.9375f},
                 {"a.spz", "1 of 3 primitives have others", {-30, -12, -11}, -10},
                 {"a.ksplat", NULL, {-30, 0, 11}, 11},
                 {"a.ksplat", "1 of 3 primitives have larger ones", {-30, 0, 12}, 11.0898f}};
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_gaussians *model = model_random(3, 0);
        for (int i = 0; i < 3; ++i) // one cell of KSPLAT: the order is kept
            for (int j = 0; j < 3; ++j) {
                *sgs_gaussians_at(model, (size_t)i, SGS_PARAM_MEAN + j) = (float)i;
                *sgs_gaussians_at(model, (size_t)i, SGS_PARAM_SCALE + j) =
                    i == 1 ? cases[k].scales[j] : -3.0f;
            }
        sgs_gaussians *back = read_back(temp_path(&folder, cases[k].name), model, NULL);
        assert_int_equal(back->count, 3);
        assert_float_equal(*sgs_gaussians_at(back, 1, SGS_PARAM_SCALE + 2), cases[k].back, 1e-3);
        assert_warning(cases[k].warning);
        sgs_gaussians_destroy(back);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

// Two of 100 primitives have the colour; a format that holds it gives it back.
static void colors_beyond_the_format_cause_a_warning(void **state)
{
    (void)state;
    const struct {
        const char *name, *warning; // NULL: none
        float dc;
    } cases[] = {{"a.spz", NULL, 3.3f},
                 {"a.spz", "SPZ holds colours up to 1.44; 2 of 100 primitives are brighter", 4.4f},
                 {"a.splat", NULL, 2.5f}, // clipped by less than a quarter
                 {"a.splat", ".splat holds colours up to 1; 2 of 100 primitives are brighter", 3},
                 {"a.ksplat", "KSPLAT holds colours up to 1; 2 of 100 primitives", 3},
                 {"a.glb", NULL, 30}};
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_gaussians *model = model_random(100, 0);
        for (size_t i = 0; i < 100; ++i)
            for (int j = 0; j < 3; ++j)
                *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + j) =
                    i % 50 == 7 && j == 1 ? cases[k].dc : 0.5f;
        sgs_gaussians *back = read_back(temp_path(&folder, cases[k].name), model, NULL);
        float most = 0;
        for (size_t i = 0; i < back->count; ++i)
            most = fmaxf(most, *sgs_gaussians_at(back, i, SGS_PARAM_SH_DC + 1));
        assert_true(!strcmp(cases[k].name, "a.splat") ||
                    (fabsf(most - cases[k].dc) <= 0.02f) == !cases[k].warning);
        assert_warning(cases[k].warning);
        sgs_gaussians_destroy(back);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spz_of_zeros_is_refused),
        cmocka_unit_test(compressible_spz_is_read_back),
        cmocka_unit_test(inflated_sog_is_refused),
        cmocka_unit_test(deflated_sog_is_read),
        cmocka_unit_test(repeated_units_are_one),
        cmocka_unit_test(tiny_units_are_bounded_together),
        cmocka_unit_test(long_manifests_take_linear_time),
        cmocka_unit_test(units_survive_lack_of_memory),
        cmocka_unit_test(refused_writes_name_the_file),
        cmocka_unit_test(models_of_unknown_degree_are_not_written),
        cmocka_unit_test(far_coordinates_of_spz_are_refused),
        cmocka_unit_test(coarse_positions_of_spz_cause_a_warning),
        cmocka_unit_test(scales_beyond_the_format_cause_a_warning),
        cmocka_unit_test(colors_beyond_the_format_cause_a_warning),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
