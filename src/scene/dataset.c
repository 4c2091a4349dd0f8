// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Shared by the readers of camera files: ownership, and the rules for image names. Names come from
// untrusted files and become paths, so they must stay below the image folder; they also appear in
// messages, tables and output names, so they must be printable.

#include "scene/dataset.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/core.h"

enum { MAX_NAME = 1024 };

void sgsi_dataset_free(sgsi_dataset *dataset)
{
    for (size_t i = 0; i < dataset->frame_count; ++i) {
        sgsi_free(dataset->frames[i].name);
        sgsi_free(dataset->frames[i].mask);
    }
    sgsi_free(dataset->frames);
    sgsi_free(dataset->points);
    sgsi_free(dataset->colors);
    *dataset = (sgsi_dataset){0};
}

const char *sgsi_image_name_clean(char *name)
{
    if (strlen(name) > MAX_NAME)
        return "is longer than 1024 bytes";
    for (char *c = name; *c; ++c) {
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            return "contains control characters";
        if (*c == '\\')
            *c = '/';
    }
    if (name[0] == '/' || (name[0] && name[1] == ':'))
        return "is an absolute path";
    char *out = name;
    for (const char *in = name; *in;) {
        const size_t length = strcspn(in, "/");
        if (length == 2 && in[0] == '.' && in[1] == '.')
            return "leaves the image folder";
        if (length > 0 && !(length == 1 && in[0] == '.')) {
            if (out != name)
                *out++ = '/';
            memmove(out, in, length);
            out += length;
        }
        in += length;
        in += *in == '/';
    }
    *out = 0;
    return out == name ? "is empty" : NULL;
}

bool sgsi_image_name_has_format(const char *name)
{
    static const char *const extensions[] = {
        "jpg",  "jpeg", "jpe", "jfif", "png", "tif", "tiff", "bmp", "webp", "exr",
        "hdr",  "tga",  "ppm", "pgm",  "gif", "psd", "dpx",  "jp2", "jxl",  "heic",
        "heif", "avif", "dng", "nef",  "cr2", "cr3", "arw",  "raf", "rw2",  "orf"};
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && i < sizeof extensions / sizeof *extensions; ++i) {
        if (!strcasecmp(dot + 1, extensions[i]))
            return true;
    }
    return false;
}

size_t sgsi_dataset_top_folder(const sgsi_dataset *dataset)
{
    const char *first = dataset->frame_count ? dataset->frames[0].name : "";
    const char *end = strchr(first, '/');
    const size_t length = end ? (size_t)(end - first) + 1 : 0;
    for (size_t i = 1; i < dataset->frame_count; ++i)
        if (strncmp(dataset->frames[i].name, first, length) != 0)
            return 0;
    return length;
}

sgs_status sgsi_dataset_add_roots(const sgsi_dataset *dataset, const char *image_folder,
                                  sgsi_roots *roots)
{
    const char *before = "";
    for (size_t i = 0; i < dataset->frame_count; ++i) {
        const char *name = dataset->frames[i].name, *end = strchr(name, '/');
        const size_t length = end ? (size_t)(end - name) + 1 : 0;
        if (!length || !strncmp(name, before, length))
            continue;
        before = name;
        char *folder = sgsi_format("%s/%.*s", image_folder, (int)length, name);
        if (!folder)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for its folders",
                             image_folder);
        const sgs_status status = sgsi_roots_add(roots, folder);
        sgsi_free(folder);
        if (status)
            return status;
    }
    return SGS_STATUS_OK;
}

static int frame_order(const void *a, const void *b)
{
    const sgsi_frame *x = *(const sgsi_frame *const *)a, *y = *(const sgsi_frame *const *)b;
    const int order = strcmp(x->name, y->name);
    return order ? order : (x->place > y->place) - (x->place < y->place);
}

sgs_status sgsi_dataset_check_names(const sgsi_dataset *dataset, const char *path, const char *unit)
{
    const size_t count = dataset->frame_count;
    const sgsi_frame **order = sgsi_alloc(count, sizeof *order);
    if (!order)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu images", path,
                         count);
    for (size_t i = 0; i < count; ++i)
        order[i] = &dataset->frames[i];
    qsort(order, count, sizeof *order, frame_order);
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 1; i < count && !status; ++i) {
        const sgsi_frame *a = order[i - 1], *b = order[i];
        if (strcmp(a->name, b->name) != 0)
            continue;
        const sgsi_frame *second = b->file ? b : a;
        if (a->file != b->file)
            status = sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: %s %llu: image '%s' is also %s %llu of %s; remove it from one of the files",
                path, unit, (unsigned long long)(second == b ? a : b)->place, b->name, unit,
                (unsigned long long)second->place, second->file);
        else
            status = sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: %s %llu: duplicate image name '%s', first used at %s %llu; use unique names",
                path, unit, (unsigned long long)b->place, b->name, unit,
                (unsigned long long)a->place);
    }
    sgsi_free(order);
    return status;
}
