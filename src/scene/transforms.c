// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Camera files of the NeRF family: transforms_train.json / transforms_test.json of NeRF synthetic
// (Mildenhall et al. 2020) and transforms.json of nerfstudio and instant-ngp.
//
// transform_matrix is camera-to-world with OpenGL camera axes (x right, y up, z backward). Ours are
// x right, y down, z forward, so its second and third columns change sign; world axes are kept. A
// uniform scale of the matrix does not affect rays and is removed. Rounding errors of its rotation
// are repaired by polar decomposition; larger deviations from a rotation are errors.
//
// NeRF synthetic omits ".png" in file_path and composites its RGBA images over white. Errors count
// frames from 0, as JSON paths do.

#include "scene/transforms.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include "base/core.h"
#include "base/path_sandbox.h"
#include "base/plain_numbers.h"
#include "ply/point_cloud.h"
#include "rays/rotation.h"
#include "scene/transforms_lens.h"

#define TEST_FILE "transforms_test.json"
#define FRAME_EXTENSION ".png" // of a file_path without extension

// Removes a uniform scale and replaces m by the nearest rotation. Returns false if m differs by
// more than two percent from a scaled rotation.
static bool make_rotation(double m[9])
{
    double cofactors[9];
    const double scale = cbrt(sgsi_determinant(m, cofactors));
    if (!(scale > 0) || !isfinite(scale))
        return false;
    for (int i = 0; i < 9; ++i)
        m[i] /= scale;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double dot = m[i] * m[j] + m[3 + i] * m[3 + j] + m[6 + i] * m[6 + j];
            if (!(fabs(dot - (i == j)) <= 0.02))
                return false;
        }
    }
    sgsi_nearest_rotation(m);
    return true;
}

// The fourth row is (0, 0, 0, 1). Column-major matrices have the position there, and no other
// symptom: all cameras would be at the origin.
static sgs_status check_last_row(const sgsi_transforms_reader *r, const json_t *row)
{
    double value[4] = {0};
    for (size_t j = 0; j < 4; ++j)
        value[j] = json_number_value(json_array_get(row, j));
    if (fabs(value[0]) <= 1e-3 && fabs(value[1]) <= 1e-3 && fabs(value[2]) <= 1e-3)
        return SGS_STATUS_OK;
    return sgsi_fail(
        SGS_STATUS_FORMAT,
        "%s: %s: last row of 'transform_matrix' is (%g, %g, %g, %g), not (0, 0, 0, 1); "
        "transpose column-major matrices",
        r->path, r->where, value[0], value[1], value[2], value[3]);
}

static sgs_status read_pose(const sgsi_transforms_reader *r, const json_t *object, sgs_pose *pose)
{
    const json_t *rows = json_object_get(object, "transform_matrix");
    const size_t row_count = json_array_size(rows); // 0 if not an array
    bool ok = row_count == 3 || row_count == 4;
    double m[3][4] = {{0}};
    for (size_t i = 0; i < 3 && ok; ++i) {
        const json_t *row = json_array_get(rows, i);
        ok = json_array_size(row) == 4;
        for (size_t j = 0; j < 4 && ok; ++j) {
            ok = json_is_number(json_array_get(row, j));
            m[i][j] = json_number_value(json_array_get(row, j));
        }
    }
    if (!ok)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: 'transform_matrix' must be 4 rows (or 3) of 4 numbers", r->path,
                         r->where);
    const sgs_status status = check_last_row(r, json_array_get(rows, 3));
    if (status)
        return status;
    double rotation[9];
    for (int i = 0; i < 3; ++i) {
        rotation[3 * i] = m[i][0];
        rotation[3 * i + 1] = -m[i][1];
        rotation[3 * i + 2] = -m[i][2];
    }
    double cofactors[9];
    if (sgsi_determinant(rotation, cofactors) < 0)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: 'transform_matrix' is mirrored; convert left-handed cameras to "
                         "right-handed ones with x right, y up, z backward",
                         r->path, r->where);
    if (!make_rotation(rotation))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s: 'transform_matrix' contains no rotation; export the cameras again", r->path,
            r->where);
    for (int i = 0; i < 3; ++i) {
        double t = 0;
        for (int j = 0; j < 3; ++j) {
            pose->rotation[3 * i + j] = rotation[3 * j + i];
            t -= rotation[3 * j + i] * m[j][3];
        }
        pose->translation[i] = t;
    }
    return SGS_STATUS_OK;
}

// Replaces the file name of `path` by `name`.
static char *sibling_path(const char *path, const char *name)
{
    const char *slash = strrchr(path, '/');
    return sgsi_format("%.*s%s", slash ? (int)(slash + 1 - path) : 0, path, name);
}

// The name of the photo that the JSON file names, as a new string, or NULL without memory.
// *problem: why it is no name, see sgsi_image_name_clean, or NULL. NeRF synthetic omits the
// extension, so a name without the extension of an image gets one, unless there is a file of this
// name.
static char *image_name(const char *json_path, const char *file, const char **problem)
{
    char *name = sgsi_strdup(file);
    *problem = name ? sgsi_image_name_clean(name) : NULL;
    if (!name || *problem || sgsi_image_name_has_format(name))
        return name;
    char *as_written = sibling_path(json_path, name);
    char *extended = as_written ? sgsi_format("%s" FRAME_EXTENSION, name) : NULL;
    const bool keeps = as_written && sgsi_is_file(as_written);
    sgsi_free(as_written);
    sgsi_free(keeps ? extended : name);
    if (keeps)
        return name;
    *problem = extended ? sgsi_image_name_clean(extended) : NULL; // its length
    return extended;
}

// Reads the path under `key`, relative to the JSON file's folder.
static sgs_status read_path(const sgsi_transforms_reader *r, const json_t *object, const char *key,
                            bool is_photo, char **path)
{
    const char *file = json_string_value(json_object_get(object, key)), *problem = NULL;
    if (!file)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: '%s' must be a string", r->path, r->where,
                         key);
    *path = is_photo ? image_name(r->path, file, &problem) : sgsi_strdup(file);
    if (!*path)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: %s: not enough memory", r->path, r->where);
    if (!is_photo)
        problem = sgsi_image_name_clean(*path);
    if (problem)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' %s; use a path below the folder of this JSON file", r->path,
                         r->where, key, problem);
    return SGS_STATUS_OK;
}

// nerfstudio's mask of a frame: white pixels are valid.
static sgs_status read_mask(const sgsi_transforms_reader *r, const json_t *object, char **path)
{
    const json_t *value = json_object_get(object, "mask_path");
    return !value || json_is_null(value) ? SGS_STATUS_OK
                                         : read_path(r, object, "mask_path", false, path);
}

static sgs_status read_frame(sgsi_transforms_reader *r, const json_t *object,
                             const sgsi_lens_keys *global, sgsi_frame *frame)
{
    sgsi_lens_keys own = *global;
    if (!json_is_object(object))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: must be an object", r->path, r->where);
    sgs_status status = read_path(r, object, "file_path", true, &frame->name);
    if (!status)
        status = read_mask(r, object, &frame->mask);
    if (!status)
        status = read_pose(r, object, &frame->pose);
    if (!status)
        status = sgsi_lens_keys_read(r, object, &own);
    return status ? status : sgsi_lens_keys_apply(r, &own, frame);
}

static sgs_status read_frames(sgsi_transforms_reader *r, const json_t *root, sgs_split split,
                              sgsi_dataset *d)
{
    const json_t *frames = json_object_get(root, "frames");
    const size_t count = json_array_size(frames);
    if (!json_is_array(frames) || count == 0)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: 'frames' must be a list with at least one frame",
                         r->path);
    sgsi_lens_keys global = sgsi_lens_keys_none();
    snprintf(r->where, sizeof r->where, "the global keys");
    sgs_status status = sgsi_lens_keys_read(r, root, &global);
    if (status)
        return status;
    if (!sgsi_grow((void **)&d->frames, d->frame_count, d->frame_count + count, sizeof *d->frames))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu frames", r->path,
                         count);
    for (size_t i = 0; i < count && !status; ++i) {
        snprintf(r->where, sizeof r->where, "frame %zu", i);
        sgsi_frame *frame = &d->frames[d->frame_count++];
        *frame = (sgsi_frame){
            .split = split, .place = i, .file = split == SGS_SPLIT_TEST ? TEST_FILE : NULL};
        status = read_frame(r, json_array_get(frames, i), &global, frame);
    }
    return status;
}

static sgs_status parse_file(const char *path, json_t **root)
{
    uint8_t *content;
    size_t size;
    json_error_t error;
    *root = NULL;
    const sgs_status status = sgsi_file_read(path, (size_t)1 << 30, &content, &size);
    if (status)
        return status;
    const size_t mark = sgsi_byte_order_mark(content);
    // Integers as doubles too: integers of many digits are not an error.
    *root = json_loadb((const char *)content + mark, size - mark, JSON_DECODE_INT_AS_REAL, &error);
    sgsi_free(content);
    if (!*root)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: line %d, column %d: %s; correct it or export the cameras again", path,
                         error.line, error.column, error.text);
    if (!json_is_object(*root)) {
        json_decref(*root);
        *root = NULL;
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: must contain a JSON object with 'frames'", path);
    }
    return SGS_STATUS_OK;
}

static int frame_order(const void *a, const void *b)
{
    const sgsi_frame *const *x = a, *const *y = b;
    return strcmp((*x)->name, (*y)->name);
}

static int name_order(const void *key, const void *element)
{
    const sgsi_frame *const *frame = element;
    return strcmp(key, (*frame)->name);
}

// Name of the frame that an entry of nerfstudio's lists means; NULL if there is none. The caller
// frees it.
static char *listed_name(const char *json_path, const json_t *entry)
{
    const char *file = json_string_value(entry), *problem = NULL;
    char *name = file ? image_name(json_path, file, &problem) : NULL;
    if (problem) {
        sgsi_free(name);
        return NULL;
    }
    return name;
}

// The frames of a file by name, for nerfstudio's lists. Frames with the same name are an error
// later (sgsi_dataset_check_names).
typedef struct frame_index {
    const char *path;
    const json_t *root;
    sgsi_dataset *dataset;
    sgsi_frame **sorted; // [frame_count]
    bool *listed;        // [frame_count], in the order of the frames
} frame_index;

// Marks the frames that a list names. Returns their number.
static size_t mark_listed(const frame_index *index, const char *key, sgs_split split)
{
    const json_t *names = json_object_get(index->root, key), *entry;
    const size_t count = index->dataset->frame_count;
    size_t i, unknown = 0;
    char first[256] = "";
    json_array_foreach(names, i, entry)
    {
        char *name = listed_name(index->path, entry);
        sgsi_frame **found =
            name ? bsearch(name, index->sorted, count, sizeof *index->sorted, name_order) : NULL;
        sgsi_free(name);
        if (found) {
            (*found)->split = split;
            index->listed[*found - index->dataset->frames] = true;
        } else if (unknown++ == 0) {
            if (json_is_string(entry))
                snprintf(first, sizeof first, "'%.200s'", json_string_value(entry));
            else
                snprintf(first, sizeof first, "entry %zu, which is not a string", i);
        }
    }
    if (unknown)
        sgsi_warn("%s: %zu of %zu entries of '%s' match no frame and are ignored, first %s",
                  index->path, unknown, json_array_size(names), key, first);
    return json_array_size(names) - unknown;
}

static void drop_unlisted(const frame_index *index, const char *held_out)
{
    sgsi_dataset *dataset = index->dataset;
    const size_t all = dataset->frame_count;
    char *first = NULL;
    dataset->frame_count = 0;
    for (size_t i = 0; i < all; ++i) {
        sgsi_frame *frame = &dataset->frames[i];
        if (index->listed[i]) {
            dataset->frames[dataset->frame_count++] = *frame;
            continue;
        }
        if (!first)
            first = frame->name;
        else
            sgsi_free(frame->name);
        sgsi_free(frame->mask);
    }
    if (first)
        sgsi_warn("%s: %zu of %zu frames are in neither 'train_filenames' nor '%s' and are not "
                  "used, first '%s'",
                  index->path, all - dataset->frame_count, all, held_out, first);
    sgsi_free(first);
}

// nerfstudio's lists of images: test_filenames, or val_filenames without it, are held out. With
// train_filenames, images in neither list are not used.
static sgs_status apply_lists(const char *path, const json_t *root, sgsi_dataset *dataset)
{
    static const char train[] = "train_filenames";
    const bool tests = json_array_size(json_object_get(root, "test_filenames")) > 0;
    const char *held_out = tests ? "test_filenames" : "val_filenames";
    const size_t count = dataset->frame_count;
    if (!count || (!json_array_size(json_object_get(root, held_out)) &&
                   !json_array_size(json_object_get(root, train))))
        return SGS_STATUS_OK;
    frame_index index = {.path = path,
                         .root = root,
                         .dataset = dataset,
                         .sorted = sgsi_alloc(count, sizeof *index.sorted),
                         .listed = sgsi_calloc(count, sizeof *index.listed)};
    if (index.sorted && index.listed) {
        for (size_t i = 0; i < count; ++i)
            index.sorted[i] = &dataset->frames[i];
        qsort(index.sorted, count, sizeof *index.sorted, frame_order);
        const bool trains = mark_listed(&index, train, SGS_SPLIT_TRAIN) > 0;
        if (mark_listed(&index, held_out, SGS_SPLIT_TEST))
            dataset->has_split = true;
        if (trains)
            drop_unlisted(&index, held_out);
    }
    const bool done = index.sorted && index.listed;
    sgsi_free(index.sorted);
    sgsi_free(index.listed);
    return done ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "%s: not enough memory for its lists of images", path);
}

// The point cloud is optional: if it cannot be read, a warning is sent and the scene has no points.
static void read_points(const char *path, const json_t *root, sgsi_dataset *dataset)
{
    const json_t *value = json_object_get(root, "ply_file_path");
    char *name = json_is_string(value) ? sgsi_strdup(json_string_value(value)) : NULL;
    if (!name)
        return;
    const char *problem = sgsi_image_name_clean(name);
    char *cloud = problem ? NULL : sibling_path(path, name);
    char *folder = sibling_path(path, ".");
    sgsi_roots roots = {0};
    if (problem)
        sgsi_warn(
            "%s: 'ply_file_path' %s; the scene has no points, and training starts from random "
            "ones",
            path, problem);
    else if (!cloud || sgsi_roots_add(&roots, folder) || sgsi_roots_check(&roots, cloud, NULL) ||
             sgsi_point_cloud_read(cloud, &dataset->point_count, &dataset->points,
                                   &dataset->colors))
        sgsi_warn("%s; the scene has no points, and training starts from random ones",
                  cloud ? sgs_last_error() : "not enough memory for the points");
    sgsi_roots_free(&roots);
    sgsi_free(folder);
    sgsi_free(cloud);
    sgsi_free(name);
}

static sgs_status read_file(const char *path, sgs_split split, sgsi_dataset *dataset)
{
    sgsi_transforms_reader r = {.path = path};
    json_t *root;
    sgs_status status = parse_file(path, &root);
    if (status)
        return status;
    status = read_frames(&r, root, split, dataset);
    if (!status && split == SGS_SPLIT_TRAIN)
        status = apply_lists(path, root, dataset);
    if (!status && split == SGS_SPLIT_TRAIN)
        read_points(path, root, dataset);
    json_decref(root);
    return status;
}

static sgs_status read_files(const char *path, sgsi_dataset *dataset)
{
    const char *suffix = "transforms_train.json";
    const size_t length = strlen(path), suffix_length = strlen(suffix);
    *dataset = (sgsi_dataset){.format = SGS_SCENE_TRANSFORMS};
    sgs_status status = read_file(path, SGS_SPLIT_TRAIN, dataset);
    if (!status && length >= suffix_length && !strcmp(path + length - suffix_length, suffix)) {
        dataset->white_background = true;
        char *test = sibling_path(path, TEST_FILE);
        if (!test)
            status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory", path);
        else if (!access(test, F_OK)) {
            status = read_file(test, SGS_SPLIT_TEST, dataset);
            dataset->has_split = true;
        }
        sgsi_free(test);
    }
    if (!status)
        status = sgsi_dataset_check_names(dataset, path, "frame");
    if (status)
        sgsi_dataset_free(dataset);
    return status;
}

sgs_status sgsi_transforms_read(const char *path, sgsi_dataset *dataset)
{
    const sgsi_plain_numbers numbers = sgsi_plain_numbers_begin();
    const sgs_status status = read_files(path, dataset);
    sgsi_plain_numbers_end(&numbers);
    return status;
}
