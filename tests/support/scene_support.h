// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Support for reader tests: byte buffers, folder trees, small COLMAP models in
// both formats, small images. Include after cmocka.h.

#include <math.h>

#include "base/core.h"
#include "support/files_support.h"
#include "support/warning_support.h"
#include "sparegs/image.h"
#include "sparegs/scene.h"

static inline void assert_holds(const char *text, const char *part)
{
    if (!strstr(text, part))
        fail_msg("'%s' does not contain '%s'", text, part);
}

// ---- Bytes --------------------------------------------------------------------------------------

typedef struct buffer {
    unsigned char data[1 << 16];
    size_t size;
} buffer;

static inline void put_bytes(buffer *b, const void *bytes, size_t size)
{
    assert_true(b->size + size <= sizeof b->data);
    memcpy(b->data + b->size, bytes, size);
    b->size += size;
}

static inline void put_integer(buffer *b, uint64_t value, int size)
{
    for (int i = 0; i < size; ++i) {
        const unsigned char byte = (unsigned char)(value >> (8 * i));
        put_bytes(b, &byte, 1);
    }
}

static inline void put_double(buffer *b, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_integer(b, bits, 8);
}

static inline void put_text(buffer *b, const char *format, ...) SGSI_PRINTF(2, 3);
static inline void put_text(buffer *b, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    const int length = vsnprintf((char *)b->data + b->size, sizeof b->data - b->size, format, args);
    va_end(args);
    assert_true(length >= 0 && b->size + (size_t)length < sizeof b->data);
    b->size += (size_t)length;
}

// ---- Folders ------------------------------------------------------------------------------------

// Writes folder/name and creates the folders of `name`.
static inline void tree_put(const temp_folder *folder, const char *name, const void *bytes,
                            size_t size)
{
    char path[512];
    snprintf(path, sizeof path, "%s", temp_path(folder, name));
    char *slash = strrchr(path, '/');
    *slash = 0;
    assert_int_equal(sgsi_make_folder(path), SGS_STATUS_OK);
    *slash = '/';
    file_put(path, bytes, size);
}

static inline void tree_put_text(const temp_folder *folder, const char *name, const char *text)
{
    tree_put(folder, name, text, strlen(text));
}

// An image of one colour; channels 1, 3 or 4.
static inline void tree_put_picture(const temp_folder *folder, const char *name, int width,
                                    int height, int channels, const uint8_t *color)
{
    uint8_t pixels[1 << 14];
    sgs_image8 image = {.width = width, .height = height, .channels = channels, .pixels = pixels};
    const size_t plane = (size_t)width * (size_t)height;
    assert_true(plane * (size_t)channels <= sizeof pixels);
    for (int c = 0; c < channels; ++c)
        memset(pixels + (size_t)c * plane, color[c], plane);
    tree_put(folder, name, "", 0);
    assert_int_equal(sgs_png_write(temp_path(folder, name), &image), SGS_STATUS_OK);
}

// ---- Images of any pixel type: uncompressed TIFF, little-endian, one strip
// -----------------------

typedef struct tiff {
    uint32_t width, height, samples, bits, photometric, format; // format: 1 unsigned, 3 float
    uint32_t extra; // 0 none, 1 premultiplied alpha, 2 straight alpha
} tiff;

static inline void tiff_put(const temp_folder *folder, const char *name, const tiff *t,
                            const void *pixels, size_t size)
{
    static buffer b;
    const uint32_t data = 8 + 2 + 12 * 12 + 4, table = (uint32_t)(data + size);
    const uint32_t tags[12][4] = {{256, 4, 1, t->width},
                                  {257, 4, 1, t->height},
                                  {258, 3, t->samples, t->samples > 2 ? table : t->bits * 0x10001},
                                  {259, 3, 1, 1},
                                  {262, 3, 1, t->photometric},
                                  {273, 4, 1, data},
                                  {277, 3, 1, t->samples},
                                  {278, 4, 1, t->height},
                                  {279, 4, 1, (uint32_t)size},
                                  {284, 3, 1, 1},
                                  {338, 3, t->extra != 0, t->extra},
                                  {339, 3, 1, t->format}};
    b.size = 0;
    put_bytes(&b, "II*\0\10\0\0\0", 8);
    put_integer(&b, t->extra ? 12 : 11, 2);
    for (int i = 0; i < 12; ++i) {
        if (tags[i][0] == 338 && !t->extra)
            continue;
        put_integer(&b, tags[i][0], 2);
        put_integer(&b, tags[i][1], 2);
        put_integer(&b, tags[i][2], 4);
        put_integer(&b, tags[i][3], 4);
    }
    put_integer(&b, 0, 4);
    while (b.size < data)
        put_integer(&b, 0, 1);
    put_bytes(&b, pixels, size);
    for (uint32_t i = 0; i < t->samples; ++i)
        put_integer(&b, t->bits, 2);
    tree_put(folder, name, b.data, b.size);
}

// ---- A small COLMAP model -----------------------------------------------------------------------

enum { MODEL_CAMERAS = 3, MODEL_IMAGES = 4, MODEL_POINTS = 5 };

typedef struct model_camera {
    uint32_t id;
    int model;
    uint64_t width, height;
    double params[12];
} model_camera;

typedef struct model_image {
    uint32_t id;
    double pose[7]; // quaternion, translation
    uint32_t camera;
    const char *name;
    int observations;
} model_image;

typedef struct model_point {
    double xyz[3];
    uint8_t rgb[3];
    int track;
} model_point;

// Tests modify entries and counts before writing the model.
typedef struct model {
    int camera_count, image_count, point_count;
    model_camera cameras[MODEL_CAMERAS];
    model_image images[MODEL_IMAGES];
    model_point points[MODEL_POINTS];
} model;

static inline model model_make(void)
{
    return (model){
        .camera_count = MODEL_CAMERAS,
        .image_count = MODEL_IMAGES,
        .point_count = MODEL_POINTS,
        .cameras =
            {{7, SGS_CAMERA_OPENCV, 64, 48, {50.5, 51.25, 31.75, 24.125, -0.1, 0.02, 1e-3, -2e-3}},
             {2, SGS_CAMERA_SIMPLE_PINHOLE, 64, 48, {1.0 / 3 * 150, 32, 24}},
             {9,
              SGS_CAMERA_FULL_OPENCV,
              128,
              96,
              {90, 91, 64, 48, .1, .2, 1e-3, 2e-3, .01, .02, .03, .04}}},
        .images = {{4, {1, 0, 0, 0, 0, 0, 1}, 7, "b.png", 2},
                   {1, {0.9, 0.1, -0.2, 0.3, 1.0 / 3, -2, 3e-5}, 2, "a.png", 0},
                   {3, {-0.5, 0.5, 0.5, 0.5, -1, 2, 3}, 9, "sub/c.png", 1},
                   {8, {0.1, 0, 0, 2, 1e3, 0, 0}, 7, "d with blanks.png", 3}},
        .points = {{{0, 0, 2}, {255, 0, 7}, 2},
                   {{1.0 / 7, -0.25, 3}, {1, 2, 3}, 0},
                   {{-1e-8, 1e8, 12.5}, {0, 0, 0}, 1},
                   {{1, 2, 3}, {9, 8, 7}, 3},
                   {{-1, -2, -3}, {100, 200, 50}, 0}},
    };
}

static inline void model_cameras_binary(const model *m, buffer *b)
{
    b->size = 0;
    put_integer(b, (uint64_t)m->camera_count, 8);
    for (int i = 0; i < m->camera_count; ++i) {
        const model_camera *c = &m->cameras[i];
        put_integer(b, c->id, 4);
        put_integer(b, (uint32_t)c->model, 4);
        put_integer(b, c->width, 8);
        put_integer(b, c->height, 8);
        for (int k = 0; k < sgs_camera_param_count((sgs_camera_model)c->model); ++k)
            put_double(b, c->params[k]);
    }
}

static inline void model_images_binary(const model *m, buffer *b)
{
    b->size = 0;
    put_integer(b, (uint64_t)m->image_count, 8);
    for (int i = 0; i < m->image_count; ++i) {
        const model_image *image = &m->images[i];
        put_integer(b, image->id, 4);
        for (int k = 0; k < 7; ++k)
            put_double(b, image->pose[k]);
        put_integer(b, image->camera, 4);
        put_bytes(b, image->name, strlen(image->name) + 1);
        put_integer(b, (uint64_t)image->observations, 8);
        for (int k = 0; k < image->observations; ++k) {
            put_double(b, 3.5 * k);
            put_double(b, 2.5 * k);
            put_integer(b, k == 1 ? UINT64_MAX : (uint64_t)k, 8);
        }
    }
}

static inline void model_points_binary(const model *m, buffer *b)
{
    b->size = 0;
    put_integer(b, (uint64_t)m->point_count, 8);
    for (int i = 0; i < m->point_count; ++i) {
        const model_point *p = &m->points[i];
        put_integer(b, 10 + (uint64_t)i, 8);
        for (int k = 0; k < 3; ++k)
            put_double(b, p->xyz[k]);
        put_bytes(b, p->rgb, 3);
        put_double(b, 0.5);
        put_integer(b, (uint64_t)p->track, 8);
        for (int k = 0; k < p->track; ++k)
            put_integer(b, (uint64_t)k << 32 | 4, 8);
    }
}

static inline void model_cameras_text(const model *m, buffer *b)
{
    b->size = 0;
    put_text(b,
             "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, "
             "HEIGHT, PARAMS[]\n"
             "# Number of cameras: %d\n",
             m->camera_count);
    for (int i = 0; i < m->camera_count; ++i) {
        const model_camera *c = &m->cameras[i];
        put_text(b, "%u %s %llu %llu", c->id, sgs_camera_model_name((sgs_camera_model)c->model),
                 (unsigned long long)c->width, (unsigned long long)c->height);
        for (int k = 0; k < sgs_camera_param_count((sgs_camera_model)c->model); ++k)
            put_text(b, " %.17g", c->params[k]);
        put_text(b, "\n");
    }
}

static inline void model_images_text(const model *m, buffer *b)
{
    b->size = 0;
    put_text(b,
             "# Image list with two lines of data per image:\n# Number of images: %d, mean "
             "observations: 1.5\n",
             m->image_count);
    for (int i = 0; i < m->image_count; ++i) {
        const model_image *image = &m->images[i];
        put_text(b, "%u", image->id);
        for (int k = 0; k < 7; ++k)
            put_text(b, " %.17g", image->pose[k]);
        put_text(b, " %u %s\n", image->camera, image->name);
        for (int k = 0; k < image->observations; ++k)
            put_text(b, "%s%g %g %d", k ? " " : "", 3.5 * k, 2.5 * k, k == 1 ? -1 : k);
        put_text(b, "\n");
    }
}

static inline void model_points_text(const model *m, buffer *b)
{
    b->size = 0;
    put_text(b,
             "# 3D point list with one line of data per point:\n# Number of points: %d, mean track "
             "length: 1\n",
             m->point_count);
    for (int i = 0; i < m->point_count; ++i) {
        const model_point *p = &m->points[i];
        put_text(b, "%d %.17g %.17g %.17g %d %d %d 0.5", 10 + i, p->xyz[0], p->xyz[1], p->xyz[2],
                 p->rgb[0], p->rgb[1], p->rgb[2]);
        for (int k = 0; k < p->track; ++k)
            put_text(b, " 4 %d", k);
        put_text(b, "\n");
    }
}

// Writes folder/place/{cameras,images,points3D}.{bin,txt}; `place` ends in '/' or is empty.
static inline void model_put(const temp_folder *folder, const char *place, const model *m,
                             bool binary)
{
    static void (*const writers[2][3])(const model *, buffer *) = {
        {model_cameras_text, model_images_text, model_points_text},
        {model_cameras_binary, model_images_binary, model_points_binary}};
    static const char *const names[3] = {"cameras", "images", "points3D"};
    static buffer b;
    for (int i = 0; i < 3; ++i) {
        char name[256];
        writers[binary][i](m, &b);
        snprintf(name, sizeof name, "%s%s.%s", place, names[i], binary ? "bin" : "txt");
        tree_put(folder, name, b.data, b.size);
    }
}

typedef struct picture {
    int width, height, channels;
    const uint8_t *color;
} picture;

// A picture of one colour for each image of the model, in the folder `place`.
static inline void model_put_pictures(const temp_folder *folder, const char *place, const model *m,
                                      picture p)
{
    for (int i = 0; i < m->image_count; ++i) {
        char name[256];
        snprintf(name, sizeof name, "%s/%s", place, m->images[i].name);
        tree_put_picture(folder, name, p.width, p.height, p.channels, p.color);
    }
}
