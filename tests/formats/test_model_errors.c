// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Invalid, truncated and hostile model files: each gives one error that names the file and what is
// wrong, and no model. Valid files are changed at one place.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "storage/unpack.h"
#include "support/bad_input.h"
#include "support/files_support.h"
#include "support/model_support.h"
#include "sparegs/model_file.h"

// Short names for the tables.
#define F SGS_STATUS_FORMAT
#define U SGS_STATUS_UNSUPPORTED
#define L SGS_STATUS_LIMIT
#define IO SGS_STATUS_IO

// A change of a valid file. At `offset`, `size` bytes of `value`, little-endian; size 0 truncates
// the file to `offset` bytes (counted from the end if negative).
typedef struct change {
    long offset;
    int size;
    uint64_t value;
    sgs_status status;
    const char *message; // part of the error
} change;

// A change of a text: the first `from` becomes `to`.
typedef struct text_change {
    const char *from, *to;
    sgs_status status;
    const char *message;
} text_change;

static void refuse_changes(const temp_folder *folder, const char *name, const unsigned char *bytes,
                           size_t size, bool packed, const change *changes, size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        const change *c = &changes[k];
        unsigned char *copy = malloc(size + 16);
        size_t length = size;
        char what[32];
        memcpy(copy, bytes, size);
        if (c->size)
            for (int i = 0; i < c->size; ++i)
                copy[c->offset + (c->offset < 0 ? (long)size : 0) + i] =
                    (unsigned char)(c->value >> (8 * i));
        else
            length = (size_t)(c->offset < 0 ? (long)size + c->offset : c->offset);
        if (packed) {
            uint8_t *out;
            size_t out_size;
            assert_int_equal(sgsi_pack(SGSI_PACKING_GZIP, 1, copy, length, &out, &out_size),
                             SGS_STATUS_OK);
            file_put(temp_path(folder, name), out, out_size);
            sgsi_free(out);
        } else {
            file_put(temp_path(folder, name), copy, length);
        }
        free(copy);
        snprintf(what, sizeof what, "change %zu", k);
        model_refused(temp_path(folder, name), c->status, c->message, what);
    }
}

// Writes a random model and returns the bytes of the file; free().
static unsigned char *write_valid(const temp_folder *folder, const char *name, size_t count,
                                  int sh_degree, const sgs_model_write_options *options,
                                  size_t *size)
{
    sgs_gaussians *model = model_random(count, sh_degree);
    assert_int_equal(sgs_model_write(temp_path(folder, name), model, options, NULL), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
    return file_get(temp_path(folder, name), size);
}

#define CHANGES(list) (list), sizeof(list) / sizeof *(list)

static void splat_sizes_are_checked(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const unsigned char zeros[256] = {0};
    for (size_t size = 0; size < 75; size += size < 24 ? 1 : 3) {
        if (size && size % 32 == 0)
            continue;
        file_put(temp_path(&folder, "a.splat"), zeros, size);
        model_refused(temp_path(&folder, "a.splat"), SGS_STATUS_FORMAT, "is not a multiple of 32",
                      "size");
    }
    temp_folder_remove(&folder);
}

static void spz_4_is_checked(void **state)
{
    (void)state;
    static const change changes[] = {
        {0, 1, 'X', F, "does not begin with NGSP"},
        {4, 4, 0, U, "version 0 is unknown"},
        {4, 4, 5, U, "version 5 is unknown"},
        {8, 4, 0, F, "contains no primitives"},
        {8, 4, 4, F, "positions: 27 bytes"},
        {8, 4, 2, F, "positions: 27 bytes"},
        {8, 4, 0xFFFFFFFF, L, "4294967295 primitives are more than a file of"},
        {12, 1, 5, F, "SH degree 5 is not within 0 to 4"},
        {12, 1, 2, F, "SH: 27 bytes"},
        {12, 1, 0, F, "has 6 streams; SH degree 0 has 5"},
        {13, 1, 31, F, "31 fractional bits"},
        {15, 1, 5, F, "has 5 streams"},
        {15, 1, 255, F, "has 255 streams"},
        {16, 4, 0, F, "table of streams at byte 0"},
        {16, 4, 31, F, "table of streams at byte 31"},
        {16, 4, 100000, F, "table of streams at byte 100000"},
        {16, 4, 0xFFFFFFFF, F, "table of streams at byte 4294967295"},
        {32, 8, 1000000, F, "positions: 27 bytes, packed 1000000"},
        {32, 8, UINT64_MAX, F, "packed 18446744073709551615"},
        {40, 8, UINT64_MAX, F, "positions: 18446744073709551615 bytes"},
        {40, 8, 0, F, "positions: 0 bytes"},
        {128, 4, 0, F, "positions cannot be decompressed"},
        {0, 0, 0, F, "has 0 bytes; the header takes 32"},
        {31, 0, 0, F, "has 31 bytes; the header takes 32"},
        {40, 0, 0, F, "is outside of the file"},
        {130, 0, 0, F, "do not fit 3 primitives and a file of 130 bytes"},
        {-1, 0, 0, F, "SH: 27 bytes"},
    };
    const temp_folder folder = temp_folder_make();
    sgs_model_write_options options = sgs_model_write_options_default();
    options.spz_version = 4;
    size_t size;
    unsigned char *bytes = write_valid(&folder, "a.spz", 3, 1, &options, &size);
    refuse_changes(&folder, "a.spz", bytes, size, false, CHANGES(changes));
    free(bytes);
    temp_folder_remove(&folder);
}

static void spz_3_is_checked(void **state)
{
    (void)state;
    static const change inside[] = {
        {0, 1, 'X', F, "does not begin with NGSP"},
        {4, 4, 0, U, "version 0 is unknown"},
        {4, 4, 4, F, "version 4 cannot be gzip data"},
        {4, 4, 77, U, "version 77 is unknown"},
        {8, 4, 0, F, "contains no primitives"},
        {8, 4, 4, F, "SH of 4 primitives take 36 bytes"},
        {8, 4, 0xFFFFFFFF, L, "4294967295 primitives are more than a file of"},
        {8, 4, 60000, F, "positions of 60000 primitives take 540000 bytes"},
        {12, 1, 3, F, "SH of 3 primitives take 135 bytes, but only 39 are left"},
        {12, 1, 9, F, "SH degree 9"},
        {13, 1, 200, F, "200 fractional bits"},
        {-8, 4, 5, F, "extension record 0xadbe0003 has 5 bytes, but only 4 are left"},
        {-8, 4, 0xFFFFFFFF, F, "has 4294967295 bytes, but only 4 are left"},
        {-4, 4, 9, U, "coordinate system 9 is not supported"},
        {-4, 4, 17, U, "coordinate system 17 is not supported"},
        {-4, 4, 99, U, "coordinate system 99 is not supported"},
        {0, 0, 0, F, "has 0 bytes of data; the header takes 16"},
        {15, 0, 0, F, "has 15 bytes of data; the header takes 16"},
        {16, 0, 0, F, "positions of 3 primitives take 27 bytes, but only 0 are left"},
        {43, 0, 0, F, "alphas of 3 primitives"},
        {47, 0, 0, F, "colours of 3 primitives"},
        {60, 0, 0, F, "scales of 3 primitives"},
        {70, 0, 0, F, "rotations of 3 primitives"},
    };
    static const change outside[] = {
        {2, 0, 0, F, "gzip data cannot be decompressed"},
        {20, 0, 0, F, "gzip data cannot be decompressed"},
        {-1, 0, 0, F, "gzip data cannot be decompressed"},
        {-8, 4, 0, F, "gzip data cannot be decompressed"},
        {2, 1, 7, F, "gzip data cannot be decompressed"},
    };
    static const change uncompressed[] = {
        {8, 4, 4, F, "SH of 4 primitives take 36 bytes"},
        {12, 1, 3, F, "SH of 3 primitives take 135 bytes"},
        {12, 0, 0, F, "has 12 bytes of data; the header takes 16"},
        {50, 0, 0, F, "colours of 3 primitives"},
    };
    const temp_folder folder = temp_folder_make();
    sgs_model_write_options options = sgs_model_write_options_default();
    options.spz_axes = SGS_SPZ_AXES_RDF;
    size_t size, plain_size;
    uint8_t *plain;
    unsigned char *bytes = write_valid(&folder, "a.spz", 3, 1, &options, &size);
    assert_int_equal(
        sgsi_unpack(SGSI_PACKING_GZIP, "a", "b", bytes, size, 4096, &plain, &plain_size),
        SGS_STATUS_OK);
    refuse_changes(&folder, "a.spz", plain, plain_size, true, CHANGES(inside));
    refuse_changes(&folder, "a.spz", bytes, size, false, CHANGES(outside));
    refuse_changes(&folder, "a.spz", plain, plain_size, false, CHANGES(uncompressed));
    sgsi_free(plain);
    free(bytes);
    temp_folder_remove(&folder);
}

static void ksplat_is_checked(void **state)
{
    (void)state;
    enum { S = 4096 };
    static const change changes[] = {
        {0, 1, 1, U, "version 1.1 is unknown"},
        {1, 1, 0, U, "version 0.0 is unknown"},
        {4, 4, 0, F, "contains no primitives"},
        {4, 4, 2, F, "2 section headers do not fit"},
        {4, 4, 0xFFFFFFFF, F, "4294967295 section headers do not fit"},
        {20, 2, 3, U, "compression level 3"},
        {20, 2, 65535, U, "compression level 65535"},
        {S, 4, 0, F, "contains no primitives"},
        {S, 4, 4, F, "has 4 primitives, but room for 3"},
        {S, 8, 0x0000000400000004, F, "section 0: 4 primitives and"},
        {S, 8, 0xFFFFFFFFFFFFFFFF, F, "section 0: 4294967295 primitives and"},
        {S + 12, 4, 0, F, "full and"},
        {S + 12, 4, 1000, F, "1000 buckets take"},
        {S + 12, 4, 0xFFFFFFFF, F, "4294967295 buckets take"},
        {S + 20, 2, 0, F, "centres of 0 bytes"},
        {S + 20, 2, 65535, F, "the file is truncated or its counts are wrong"},
        {S + 32, 4, 5, F, "5 full and"},
        {S + 32, 4, 0xFFFFFFFF, F, "4294967295 full and"},
        {S + 36, 4, 0, F, "0 partial buckets"},
        {S + 36, 4, 0xFFFFFFFF, F, "the file is truncated or its counts are wrong"},
        {S + 40, 2, 4, F, "SH degree 4 is not within 0 to 3"},
        {S + 40, 2, 2, F, "the file is truncated or its counts are wrong"},
        {S + 1024, 4, 0, F, "primitive 2 is in no bucket"},
        {0, 0, 0, F, "has 0 bytes; the header takes 4096"},
        {4095, 0, 0, F, "has 4095 bytes; the header takes 4096"},
        {S + 1023, 0, 0, F, "1 section headers do not fit"},
        {-1, 0, 0, F, "the file is truncated or its counts are wrong"},
    };
    const temp_folder folder = temp_folder_make();
    size_t size;
    unsigned char *bytes = write_valid(&folder, "a.ksplat", 3, 1, NULL, &size);
    assert_int_equal(bytes[S + 32], 0); // one partial bucket holds all
    assert_int_equal(bytes[S + 36], 1);
    change own[sizeof changes / sizeof *changes];
    memcpy(own, changes, sizeof changes);
    for (size_t k = 0; k < sizeof own / sizeof *own; ++k)
        if (own[k].offset == S + 36 && own[k].value == 0)
            own[k].message = "primitive 0 is in no bucket";
        else if (own[k].offset == S + 1024)
            own[k].message = "primitive 0 is in no bucket";
    refuse_changes(&folder, "a.ksplat", bytes, size, false, CHANGES(own));
    free(bytes);
    temp_folder_remove(&folder);
}

// Replaces the first `from` in a file of text and binary data.
static unsigned char *replace(const unsigned char *bytes, size_t size, const char *from,
                              const char *to, size_t *new_size)
{
    const unsigned char *at = memmem(bytes, size, from, strlen(from));
    if (!at)
        fail_msg("'%s' is not in the file", from);
    unsigned char *copy = malloc(size + strlen(to) + 1);
    const size_t before = (size_t)(at - bytes), after = before + strlen(from);
    memcpy(copy, bytes, before);
    memcpy(copy + before, to, strlen(to));
    memcpy(copy + before + strlen(to), bytes + after, size - after);
    *new_size = size - strlen(from) + strlen(to);
    return copy;
}

static void compressed_ply_is_checked(void **state)
{
    (void)state;
    static const text_change changes[] = {
        {"ply\n", "plx\n", F, "does not begin with 'ply'"},
        {"1.0", "2.0", U, "unknown PLY version 2.0"},
        {"binary_little_endian", "binary_big_endian", U, "must be binary_little_endian"},
        {"binary_little_endian", "ascii", U, "must be binary_little_endian"},
        {"element chunk 1", "element chunks 1", F, "has no element 'chunk'"},
        {"element chunk 1", "element chunk 0", F, "3 primitives have 1 chunks; the file has 0"},
        {"element chunk 1", "element chunk 9999999", F, "9999999 rows of element 'chunk'"},
        {"element vertex 3", "element point 3", F, "has no element 'vertex'"},
        {"element vertex 3", "element vertex 4", F, "has SH of 3 primitives, but 4 primitives"},
        {"element vertex 3", "element vertex 300", F, "300 primitives have 2 chunks"},
        {"element vertex 3", "element vertex 18446744073709551615", F, "the file has 1"},
        {"element sh 3", "element sh 2", F, "has SH of 2 primitives, but 3 primitives"},
        {"element sh 3\n", "element sh 3\nproperty uchar more\n", U, "has 10 f_rest properties"},
        {"property uchar f_rest_3\n", "", U, "has 8 f_rest properties"},
        {"property uchar f_rest_3\n", "property uchar f_rest_9\n", F,
         "uchar property 'f_rest_3' is missing"},
        {"property uchar f_rest_3\n", "property float f_rest_3\n", F, "rows of element 'sh'"},
        {"property float min_x\n", "", F, "float property 'min_x' is missing"},
        {"property float min_x\n", "property double min_x\n", F, "'min_x' is missing"},
        {"property float max_scale_z\n", "property float other\n", F, "'max_scale_z' is missing"},
        {"property float max_g\n", "property float other\n", F, "'max_g' is missing"},
        {"property uint packed_position\n", "property uint packed_positions\n", F,
         "uint property 'packed_position' is missing"},
        {"property uint packed_rotation\n", "property int packed_rotation\n", F,
         "'packed_rotation' is missing"},
        {"property uint packed_scale\n", "", F, "'packed_scale' is missing"},
        {"property uint packed_color\n", "property list uchar uint packed_color\n", U,
         "element 'vertex' has a list"},
        {"end_header\n", "end_heading\n", F, "'end_heading' is not a PLY keyword"},
    };
    const temp_folder folder = temp_folder_make();
    size_t size, changed;
    unsigned char *bytes = write_valid(&folder, "a.compressed.ply", 3, 1, NULL, &size);
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        unsigned char *copy = replace(bytes, size, changes[k].from, changes[k].to, &changed);
        file_put(temp_path(&folder, "a.compressed.ply"), copy, changed);
        free(copy);
        model_refused(temp_path(&folder, "a.compressed.ply"), changes[k].status, changes[k].message,
                      changes[k].to);
    }
    for (size_t cut = 1; cut < size; cut += 97) {
        file_put(temp_path(&folder, "a.compressed.ply"), bytes, size - cut);
        sgs_gaussians *model;
        assert_int_equal(sgs_model_read(temp_path(&folder, "a.compressed.ply"), NULL, &model, NULL),
                         SGS_STATUS_FORMAT);
    }
    free(bytes);
    temp_folder_remove(&folder);
}

// `before`, `count` zeros with a comma each, `after`; release with free.
static char *with_zeros(const char *before, int count, const char *after)
{
    char *text;
    size_t length;
    FILE *stream = open_memstream(&text, &length);
    assert_non_null(stream);
    fputs(before, stream);
    for (int k = 0; k < count; ++k)
        fputs("0,", stream);
    fputs(after, stream);
    assert_int_equal(fclose(stream), 0);
    return text;
}

// Changes the JSON chunk; its length and that of the file follow.
static void put_glb(const char *path, const unsigned char *bytes, size_t size, const char *from,
                    const char *to)
{
    size_t changed;
    unsigned char *copy = replace(bytes, size, from, to, &changed);
    const size_t json = (size_t)copy[12] + 256u * copy[13] + 65536u * copy[14];
    const size_t length = json + changed - size;
    copy[12] = (unsigned char)length;
    copy[13] = (unsigned char)(length >> 8);
    copy[14] = (unsigned char)(length >> 16);
    file_put(path, copy, changed);
    free(copy);
}

static void glb_is_checked(void **state)
{
    (void)state;
    static const text_change changes[] = {
        {"{\"asset\"", "{\"asset", F, "JSON: line 1"},
        {"\"scene\":0", "\"scene\":0,\"scene\":0", F, "JSON: line 1: duplicate object key"},
        {"\"scene\":0", "\"nodes\":[],\"x\":0", F, "JSON: line 1: duplicate object key"},
        {"\"scenes\":[{\"nodes\":[0]}]", "\"scenes\":[{\"nodes\":[7]}]", F,
         "a node of the scene does not exist"},
        {"\"scenes\":[{\"nodes\":[0]}]", "\"scenes\":[{\"nodes\":[-1]}]", F,
         "a node of the scene does not exist"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"children\":[0]}]", L,
         "more than 4096 nodes, or nested deeper than 64"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":5}]", F, "contains no primitive with"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"scale\":[0,0,0]}]", U,
         "the transform of a node with Gaussians is singular"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"scale\":[1,0,1]}]", U,
         "the transform of a node with Gaussians is singular"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"scale\":[\"a\",1,1]}]", U,
         "or has invalid values"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"rotation\":[0,0,0,0]}]", U,
         "the transform of a node"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"rotation\":[0,0,0]}]", U,
         "the transform of a node"},
        {"\"nodes\":[{\"mesh\":0}]",
         "\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,1,1,0,0,0,0,0,1]}]", U,
         "the transform of a node"},
        {"\"nodes\":[{\"mesh\":0}]",
         "\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0.01,0,0,1,0,0,0,0,1]}]", U,
         "the transform of a node with Gaussians is singular, projective or has"},
        {"\"nodes\":[{\"mesh\":0}]",
         "\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,2]}]", U,
         "is singular, projective"},
        {"\"nodes\":[{\"mesh\":0}]", "\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0]}]", U,
         "the transform of a node"},
        {"\"extensions\":{\"KHR_gaussian_splatting\"", "\"extensions\":{\"KHR_other\"", F,
         "contains no primitive with KHR_gaussian_splatting"},
        {"\"POSITION\":0", "\"NORMAL\":0", F, "'POSITION' has no accessor of type VEC3"},
        {"\"POSITION\":0", "\"POSITION\":99", F, "'POSITION' has no accessor of type VEC3"},
        {"\"POSITION\":0", "\"POSITION\":\"0\"", F, "'POSITION' has no accessor of type VEC3"},
        {"\"POSITION\":0", "\"POSITION\":1", F, "'POSITION' has no accessor of type VEC3"},
        {"KHR_gaussian_splatting:SCALE\":2", "KHR_gaussian_splatting:SIZE\":2", F,
         "SCALE' has no accessor of type VEC3"},
        {"SH_DEGREE_1_COEF_1", "SH_DEGREE_1_COEF_9", F,
         "SH_DEGREE_1_COEF_1' has no accessor of type VEC3"},
        {"\"bufferView\":0,", "\"bufferView\":99,", U, "is sparse or not in the binary chunk"},
        {"\"bufferView\":0,", "\"sparse\":{},\"bufferView\":0,", U, "is sparse or not"},
        {"\"buffer\":0,", "\"buffer\":1,", U, "is sparse or not in the binary chunk"},
        {"\"buffers\":[{", "\"buffers\":[{\"uri\":\"a.bin\",", U, "is sparse or not"},
        {"\"componentType\":5126", "\"componentType\":5125", U, "has component type 5125"},
        {"\"count\":3", "\"count\":4", F, "'POSITION': 4 values of 12 bytes exceed"},
        {"\"count\":3", "\"count\":4294967295", F, "exceed the binary chunk"},
        {"\"count\":3", "\"count\":-3", F, "a size of its accessor or buffer view is invalid"},
        {"\"count\":3", "\"count\":2", F, "has 3 values for 2 positions"},
        {"\"byteOffset\":0", "\"byteOffset\":1000000", F, "exceed the binary chunk"},
        {"\"byteOffset\":0", "\"byteOffset\":\"a\"", F, "is invalid"},
        {"\"byteLength\":36", "\"byteLength\":35", F, "exceed the binary chunk"},
        {"\"byteLength\":36", "\"byteLength\":36,\"byteStride\":4", F, "is invalid"},
        {"\"byteLength\":36", "\"byteLength\":36,\"byteStride\":16", F, "exceed the binary chunk"},
    };
    static const change binary[] = {
        {0, 1, 'x', F, "does not begin with glTF"},
        {4, 4, 1, U, "glTF version 1"},
        {12, 4, 0xFFFFFFF0, F, "a chunk has 4294967280 bytes"},
        {16, 4, 0, F, "has no JSON chunk"},
        {-1, 0, 0, F, "the file is truncated"},
        {12, 0, 0, F, "has no JSON chunk"},
        {11, 0, 0, F, "does not begin with glTF"},
        {0, 0, 0, F, "does not begin with glTF"},
    };
    const temp_folder folder = temp_folder_make();
    size_t size;
    unsigned char *bytes = write_valid(&folder, "a.glb", 3, 1, NULL, &size);
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        put_glb(temp_path(&folder, "a.glb"), bytes, size, changes[k].from, changes[k].to);
        model_refused(temp_path(&folder, "a.glb"), changes[k].status, changes[k].message,
                      changes[k].to);
    }
    // Many nodes with one mesh, then also many primitives without Gaussians.
    char *nodes = with_zeros("\"scenes\":[{\"nodes\":[", 3000, "0]}]"),
         *primitives = with_zeros("\"primitives\":[", 8000, "");
    put_glb(temp_path(&folder, "a.glb"), bytes, size, "\"scenes\":[{\"nodes\":[0]}]", nodes);
    model_refused(temp_path(&folder, "a.glb"), L, "its nodes repeat primitives", "instances");
    size_t repeated_size;
    unsigned char *repeated = file_get(temp_path(&folder, "a.glb"), &repeated_size);
    put_glb(temp_path(&folder, "a.glb"), repeated, repeated_size, "\"primitives\":[", primitives);
    model_refused(temp_path(&folder, "a.glb"), L, "more than 1048576 primitives", "primitives");
    free(repeated);
    free(primitives);
    free(nodes);
    refuse_changes(&folder, "a.glb", bytes, size, false, CHANGES(binary));
    free(bytes);
    temp_folder_remove(&folder);
}

static void usda_is_checked(void **state)
{
    (void)state;
    static const text_change changes[] = {
        {"#usda", "#usdc", F, "does not begin with #usda"},
        {"#usda 1.0", "#usd", F, "does not begin with #usda"},
        {"def ParticleField3DGaussianSplat", "def Points", F,
         "contains no ParticleField3DGaussianSplat"},
        {"def ParticleField3DGaussianSplat", "def ParticleField_3DGaussianSplat", F,
         "contains no ParticleField3DGaussianSplat"},
        {"positions = [", "points = [", F,
         "contains no ParticleField3DGaussianSplat with positions"},
        {"positions = [", "positions = 3 [", F, "is not an array"},
        {"positions = [", "positions = None # [", F, "is not an array"},
        {"positions = [", "positions = [1, ", F, "has 10 numbers, which is no multiple of 3"},
        {"orientations = [", "orientations = [1, ", F, "'orientations' of the splats has 13"},
        {"positions = [", "positions = [a, ", F, "line 16: an array contains something"},
        {"positions = [", "positions = [\"1\", ", F, "an array contains something"},
        {"Degree = 1", "Degree = 4", U, "SH degree 4 is not within 0 to 3"},
        {"Degree = 1", "Degree = 99999999999", U, "is not within 0 to 3"},
        {"positions = [", "positions.timeSamples = { 0: [] }\nfloat[] x = [", U,
         "'positions' of the splats has time samples"},
        {"opacities = [", "opacities.timeSamples = { 0: [] }\nfloat[] x = [", U,
         "'opacities' of the splats has time samples"},
        {"uniform token sortingModeHint", "}}}}\nuniform token sortingModeHint", F,
         "'}' without '{'"},
        {"uniform token sortingModeHint", "{\nuniform token sortingModeHint", F,
         "the file ends inside a prim"},
    };
    const temp_folder folder = temp_folder_make();
    size_t size, changed;
    unsigned char *bytes = write_valid(&folder, "a.usda", 3, 1, NULL, &size);
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        unsigned char *copy = replace(bytes, size, changes[k].from, changes[k].to, &changed);
        file_put(temp_path(&folder, "a.usda"), copy, changed);
        free(copy);
        model_refused(temp_path(&folder, "a.usda"), changes[k].status, changes[k].message,
                      changes[k].to);
    }
    for (size_t cut = 3; cut < size; cut += 31) { // without the last brace and line feed
        file_put(temp_path(&folder, "a.usda"), bytes, size - cut);
        sgs_gaussians *model;
        assert_int_equal(sgs_model_read(temp_path(&folder, "a.usda"), NULL, &model, NULL), F);
    }
    free(bytes);
    temp_folder_remove(&folder);
}

static void sog_meta_is_checked(void **state)
{
    (void)state;
    static const text_change changes[] = {
        {"{\"version\":2", "{\"version\":3", U, "SOG version 3 is unknown"},
        {"{\"version\":2", "{\"version\":2,\"version\":2", F, "duplicate object key"},
        {"{\"version\":2", "[\"version\",2", F, "meta.json: line 1"},
        {"{\"version\":2,", "{", F, "the number of primitives is missing"}, // version 1
        {"\"count\":3", "\"count\":0", F, "the number of primitives is missing"},
        {"\"count\":3", "\"count\":-1", F, "the number of primitives is missing"},
        {"\"count\":3", "\"count\":3.5", F, "the number of primitives is missing"},
        {"\"count\":3", "\"count\":17", F, "4 x 4 pixels for 17 primitives"},
        {"\"count\":3", "\"count\":100000000000", L, "more than"},
        {"\"means\"", "\"mean\"", F, "'means' is missing"},
        {"\"means_l.webp\",\"means_u.webp\"", "\"means_l.webp\"", F, "'means' is missing"},
        {"\"means_l.webp\"", "5", F, "'means' is missing"},
        {"\"means_l.webp\"", "\"../means_l.webp\"", F, "is not a valid entry name"},
        {"\"means_l.webp\"", "\"/etc/passwd\"", F, "is not a valid entry name"},
        {"\"means_l.webp\"", "\"a\\u001bb\"", F, "an entry name contains control characters"},
        {"\"means_l.webp\"", "\"none.webp\"", IO, "none.webp: cannot be opened"},
        {"\"means_l.webp\"", "\"meta.json\"", F, "meta.json is not a WebP image"},
        {"\"mins\":[", "\"mins\":[null,", F, "'means' is missing or invalid"},
        {"\"maxs\":[", "\"max\":[", F, "'means' is missing or invalid"},
        {"\"scales\"", "\"scale\"", F, "'scales' is missing"},
        {"\"quats\"", "\"quat\"", F, "'quats' is missing"},
        {"\"sh0\"", "\"sh1\"", F, "'sh0' is missing"},
        {"\"codebook\":[", "\"codebook\":[1,2],\"x\":[", F, "a codebook of 256 numbers"},
        {"\"codebook\":[", "\"codebook\":[\"a\",", F, "a codebook of 256 numbers"},
        {"\"shN_centroids.webp\",", "", F, "'shN' is missing"},
        {"\"bands\":1", "\"bands\":0", F, "'bands' of 'shN'"},
        {"\"bands\":1", "\"bands\":4", F, "'bands' of 'shN'"},
        {"\"bands\":1", "\"bands\":2", F, "is 192 pixels wide"},
        {"\"count\":3,\"bands\"", "\"count\":0,\"bands\"", F, "'count' of 'shN'"},
    };
    const temp_folder folder = temp_folder_make();
    char meta[300];
    snprintf(meta, sizeof meta, "%s/meta.json", folder.path);
    sgs_gaussians *model = model_random(3, 1);
    assert_int_equal(sgs_model_write(meta, model, NULL, NULL), SGS_STATUS_OK);
    size_t size, changed;
    unsigned char *bytes = file_get(meta, &size);
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        unsigned char *copy = replace(bytes, size, changes[k].from, changes[k].to, &changed);
        file_put(meta, copy, changed);
        free(copy);
        if (changes[k].status == IO) { // the missing file is named, in the folder
            sgs_gaussians *none;
            assert_int_equal(sgs_model_read(meta, NULL, &none, NULL), IO);
            assert_non_null(strstr(sgs_last_error(), changes[k].message));
            bad_input();
        } else {
            sgs_gaussians *none = model;
            const sgs_status status = sgs_model_read(meta, NULL, &none, NULL);
            if (status != changes[k].status || !strstr(sgs_last_error(), changes[k].message) ||
                !strstr(sgs_last_error(), folder.path))
                fail_msg("%s: status %d with '%s', expected '%s'", changes[k].to, status,
                         sgs_last_error(), changes[k].message);
            assert_null(none);
            bad_input();
        }
    }
    file_put(meta, bytes, size);
    free(bytes);
    // A texture that is damaged, lossy in name only, or huge.
    unsigned char *texture = file_get(temp_path(&folder, "quats.webp"), &size);
    for (size_t cut = 1; cut + 12 < size; cut += 3) {
        file_put(temp_path(&folder, "quats.webp"), texture, size - cut);
        model_refused(meta, F, "quats.webp", "truncated texture");
    }
    free(texture);
    static const unsigned char huge[] = {'R',  'I', 'F', 'F', 26, 0, 0, 0, 'W',  'E',  'B',  'P',
                                         'V',  'P', '8', 'L', 14, 0, 0, 0, 0x2f, 0xff, 0xff, 0xff,
                                         0x0f, 0,   0,   0,   0,  0, 0, 0, 0,    0};
    file_put(temp_path(&folder, "quats.webp"), huge, sizeof huge);
    model_refused(meta, L, "quats.webp has 16384 x 16384 pixels, more than a file of this size",
                  "huge");
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void sog_zip_is_checked(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    size_t size;
    unsigned char *bytes = write_valid(&folder, "a.sog", 3, 0, NULL, &size);
    const long end = -22, directory = bytes[size - 6] + 256L * bytes[size - 5];
    const change changes[] = {
        {0, 0, 0, F, "has no ZIP directory"},
        {21, 0, 0, F, "has no ZIP directory"},
        {-1, 0, 0, F, "has no ZIP directory"},
        {end, 1, 'X', F, "has no ZIP directory"},
        {end + 10, 2, 65535, F, "ZIP directory of 65535 entries"},
        {end + 10, 2, 7, F, "entry 6 of the ZIP directory is corrupt"},
        {end + 10, 2, 0, F, "has no file 'meta.json'"},
        {end + 16, 4, 0xFFFFFFFF, F, "at byte 4294967295 is outside of the file"},
        {end + 16, 4, 0, F, "entry 0 of the ZIP directory is corrupt"},
        {directory, 1, 'X', F, "entry 0 of the ZIP directory is corrupt"},
        {directory + 8, 2, 1, U, "means_l.webp is encrypted"},
        {directory + 10, 2, 99, U, "means_l.webp has ZIP method 99"},
        {directory + 10, 2, 8, F, "means_l.webp cannot be decompressed"},
        {directory + 20, 4, 0xFFFFFFFF, F, "beyond the end of the file"},
        {directory + 20, 4, 1, F, "means_l.webp is stored, but has two sizes"},
        {directory + 28, 2, 65535, F, "entry 0 of the ZIP directory is truncated"},
        {directory + 42, 4, 0xFFFFFFFF, F, "means_l.webp has no local ZIP header"},
        {directory + 42, 4, 1, F, "means_l.webp has no local ZIP header"},
        {directory + 46, 1, 'X', F, "has no file 'means_l.webp'"},
        {0, 4, 0, F, "means_l.webp has no local ZIP header"},
        {26, 2, 65535, F, "beyond the end of the file"},
        {30 + 12, 4, 0, F, "means_l.webp has a wrong checksum; the file is damaged"},
        {30 + 12 + 40, 1, 0xFF, F, "means_l.webp has a wrong checksum"}, // of a valid image
        {directory + 16, 4, 1, F, "means_l.webp has a wrong checksum"},
    };
    refuse_changes(&folder, "a.sog", bytes, size, false, CHANGES(changes));
    free(bytes);
    temp_folder_remove(&folder);
}

static void lod_manifest_is_checked(void **state)
{
    (void)state;
    static const text_change changes[] = {
        {"{\"version\":1", "{\"version\":2", U, "version 2 is unknown"},
        {"{\"version\":1", "{\"version\":1,,", F, "lod-meta.json: line 1"},
        {"{\"version\":1", "{\"version\":1,\"tree\":{}", F, "duplicate object key"},
        {"\"lodLevels\":1", "\"lodLevels\":0", F, "'lodLevels' is missing"},
        {"\"lodLevels\":1", "\"lodLevels\":257", F, "'lodLevels' is missing"},
        {"\"lodLevels\":1", "\"lodLevels\":\"1\"", F, "'lodLevels' is missing"},
        {"\"filenames\":", "\"files\":", F, "'filenames' is missing"},
        {"\"filenames\":[", "\"filenames\":[5,", F, "the name of SOG file 0 is missing"},
        {"\"0_0/meta.json\"", "\"../0_0/meta.json\"", F, "leaves the folder"},
        {"\"0_0/meta.json\"", "\"/tmp/meta.json\"", F, "leaves the folder"},
        {"\"0_0/meta.json\"", "\"0_0/..\\\\meta.json\"", F, "leaves the folder"},
        {"\"tree\":", "\"trees\":", F, "a node of 'tree' is missing"},
        {"\"tree\":{", "\"tree\":{\"children\":[3],", F, "a node of 'tree' is missing"},
        {"\"file\":0", "\"file\":1", F, "a file number of 'tree'"},
        {"\"file\":0", "\"file\":-1", F, "a range of 'tree'"},
        {"\"offset\":0", "\"offset\":1", F, "rows 1 to 4 exceed SOG file 0 of 3 primitives"},
        {"\"offset\":0", "\"offset\":2147483647", F, "exceed SOG file 0 of 3 primitives"},
        {"\"offset\":0", "\"offset\":99999999999", F, "a range of 'tree'"},
        {"\"offset\":0,\"count\":3", "\"offset\":0,\"count\":4", F,
         "the tree names 4 primitives of SOG file 0, which has 3"},
        {"\"offset\":0,\"count\":3", "\"offset\":0,\"count\":null", F, "a range of 'tree'"},
        {"\"offset\":0,\"count\":3", "\"offset\":0,\"count\":2147483647", F, "which has 3"},
    };
    const temp_folder folder = temp_folder_make();
    char path[300];
    snprintf(path, sizeof path, "%s/lod-meta.json", folder.path);
    sgs_gaussians *model = model_random(3, 0);
    sgs_model_write_options options = sgs_model_write_options_default();
    options.lod_levels = 1;
    assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
    size_t size, changed;
    unsigned char *bytes = file_get(path, &size);
    for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k) {
        unsigned char *copy = replace(bytes, size, changes[k].from, changes[k].to, &changed);
        file_put(path, copy, changed);
        free(copy);
        model_refused(path, changes[k].status, changes[k].message, changes[k].to);
    }
    // Nested nodes.
    char *deep;
    size_t length;
    FILE *stream = open_memstream(&deep, &length);
    assert_non_null(stream);
    fputs("\"tree\":{", stream);
    for (int k = 0; k < 300; ++k)
        fputs("\"children\":[{", stream);
    for (int k = 0; k < 300; ++k)
        fputs("}]", stream);
    fputs(",", stream);
    assert_int_equal(fclose(stream), 0);
    unsigned char *copy = replace(bytes, size, "\"tree\":{", deep, &changed);
    file_put(path, copy, changed);
    model_refused(path, F, "a node of 'tree'", "nested nodes");
    free(copy);
    free(deep);
    free(bytes);
    sgs_gaussians_destroy(model);
    tree_remove(&folder);
}

static void unknown_files_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model_refused(temp_path(&folder, "none.spz"), SGS_STATUS_IO, "cannot be opened", "missing");
    static const char *const missing[] = {"none", "none.bin", "none.html"};
    for (size_t k = 0; k < sizeof missing / sizeof *missing; ++k) {
        size_t count;
        const char *path = temp_path(&folder, missing[k]);
        model_refused(path, SGS_STATUS_IO, "cannot be opened", missing[k]);
        assert_int_equal(sgs_model_read_count(path, &count), SGS_STATUS_IO);
    }
    model_refused(folder.path, SGS_STATUS_IO, "is a folder without meta.json or lod-meta.json",
                  "folder");
    file_put(temp_path(&folder, "a.bin"), "hello", 5);
    model_refused(temp_path(&folder, "a.bin"), SGS_STATUS_UNSUPPORTED, "supported: .ply",
                  "unknown");
    // An option that the file does not have.
    sgs_gaussians *model = model_random(2, 0), *none;
    sgs_model_read_options options = sgs_model_read_options_default();
    options.lod = 1;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.spz"), model, NULL, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), &options, &none, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    // Writing: names, options and empty models.
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.obj"), model, NULL, NULL),
                     SGS_STATUS_UNSUPPORTED);
    sgs_model_write_options write = sgs_model_write_options_default();
    write.spz_version = 2;
    assert_int_equal(sgs_model_write(temp_path(&folder, "b.spz"), model, &write, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_resize(model, 0), SGS_STATUS_OK);
    static const char *const names[] = {"b.spz", "b.ksplat", "b.sog", "b.glb", "b.splat", "b.usda"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        assert_int_equal(sgs_model_write(temp_path(&folder, names[k]), model, NULL, NULL),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "cannot be empty"));
        assert_int_equal(access(temp_path(&folder, names[k]), F_OK), -1);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// A full disk leaves the old file and no temporary one.
static void write_failures_keep_the_old_file(void **state)
{
    (void)state;
    static const char *const names[] = {
        "a.ply", "a.compressed.ply", "a.splat", "a.spz", "a.ksplat", "a.glb", "a.sog", "a.usda"};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(200, 3);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        file_put(temp_path(&folder, names[k]), "old", 3);
        files_limited(1000);
        const sgs_status status = sgs_model_write(temp_path(&folder, names[k]), model, NULL, NULL);
        files_unlimited();
        assert_int_equal(status, SGS_STATUS_IO);
        size_t size;
        char *text = (char *)file_get(temp_path(&folder, names[k]), &size);
        assert_string_equal(text, "old");
        free(text);
        assert_int_equal(temp_folder_count(&folder), k + 1);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// The n-th allocation fails, for every n: an error that names the file, no model, and nothing leaks
// (checked by the address sanitizer).
static void formats_survive_lack_of_memory(void **state)
{
    (void)state;
    static const char *const names[] = {
        "a.ply", "a.compressed.ply", "a.splat", "a.spz", "a.ksplat", "a.glb", "a.sog", "a.usda"};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(20, 1);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k)
        for (int reading = 0; reading < 2; ++reading) {
            sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
            size_t n = 0;
            while (status) {
                sgs_gaussians *back = NULL;
                sgsi_fail_allocation(++n);
                status = reading ? sgs_model_read(temp_path(&folder, names[k]), NULL, &back, NULL)
                                 : sgs_model_write(temp_path(&folder, names[k]), model, NULL, NULL);
                sgsi_fail_allocation(0);
                if (status && (status != SGS_STATUS_OUT_OF_MEMORY ||
                               strncmp(sgs_last_error(), folder.path, strlen(folder.path))))
                    fail_msg("%s, allocation %zu: %s", names[k], n, sgs_last_error());
                assert_true(n < 500 && (!status || !back));
                sgs_gaussians_destroy(back);
            }
        }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(splat_sizes_are_checked),
        cmocka_unit_test(spz_4_is_checked),
        cmocka_unit_test(spz_3_is_checked),
        cmocka_unit_test(ksplat_is_checked),
        cmocka_unit_test(compressed_ply_is_checked),
        cmocka_unit_test(glb_is_checked),
        cmocka_unit_test(usda_is_checked),
        cmocka_unit_test(sog_meta_is_checked),
        cmocka_unit_test(sog_zip_is_checked),
        cmocka_unit_test(lod_manifest_is_checked),
        cmocka_unit_test(unknown_files_are_refused),
        cmocka_unit_test(write_failures_keep_the_old_file),
        cmocka_unit_test(formats_survive_lack_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
