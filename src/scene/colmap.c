// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// COLMAP's sparse models, after its documentation ("Output Format", COLMAP 3.8). The binary reader
// and the text reader both call add_camera, add_image and add_point, which check the contents.
// Camera models of COLMAP 3.9 to 4.1 are read if they are special cases of a lens of camera.h.
//
// The files are untrusted. Counts are validated against the remaining bytes before allocation, and
// every error gives file, position and fix. 2-D observations and tracks are skipped. Differences
// from COLMAP's reader: names in text files may contain blanks; a warning is sent if the number of
// records in a text file's header comment (written by COLMAP) is wrong.

#include "scene/colmap.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"
#include "base/plain_numbers.h"
#include "ply/point_cloud.h"

enum {
    MAX_SIZE = 65536,
    // Minimum bytes of a record: a camera with two parameters, an image with a one-letter name and
    // no observations, a point without track.
    CAMERA_BYTES = 4 + 4 + 8 + 8 + 2 * 8,
    IMAGE_BYTES = 4 + 7 * 8 + 4 + 2 + 8,
    POINT_BYTES = 8 + 3 * 8 + 3 + 8 + 8
};

typedef struct camera_entry {
    uint32_t id;
    sgs_camera camera;
    uint64_t place;
} camera_entry;

typedef struct loader {
    const char *path, *unit; // of the current file; unit of `place`: "byte" or "line"
    uint64_t place;          // of the current record
    size_t camera_count, camera_capacity;
    camera_entry *cameras; // sorted by id when complete
    size_t frame_capacity, point_capacity, points_dropped;
    uint64_t first_dropped;
    sgsi_dataset *dataset;
} loader;

static sgs_status no_memory(const loader *l)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "%s: %s %llu: not enough memory for the rest of the file", l->path, l->unit,
                     (unsigned long long)l->place);
}

static bool grow(void **block, size_t count, size_t *capacity, size_t size)
{
    if (count < *capacity)
        return true;
    const size_t wanted = *capacity < 64 ? 64 : 2 * *capacity;
    if (!sgsi_grow(block, count, wanted, size))
        return false;
    *capacity = wanted;
    return true;
}

// ---- Camera models ------------------------------------------------------------------------------

enum { SIMPLE_FISHEYE = 14, FISHEYE = 15, EQUIRECTANGULAR = 17, MODEL_COUNT };

// Those after COLMAP 3.8 (src/colmap/sensor/models.h); no parameters: not supported.
static const struct {
    const char *name;
    int param_count;
} later_models[MODEL_COUNT - SGS_CAMERA_MODEL_COUNT] = {
    {"RAD_TAN_THIN_PRISM_FISHEYE", 0},
    {"SIMPLE_DIVISION", 0},
    {"DIVISION", 0},
    {"SIMPLE_FISHEYE", 3}, // f, cx, cy
    {"FISHEYE", 4},        // fx, fy, cx, cy
    {"EUCM", 0},
    {"EQUIRECTANGULAR", 2} // width, height
};

// NULL for an id that COLMAP does not have.
static const char *model_name(int model)
{
    if (model < 0 || model >= MODEL_COUNT)
        return NULL;
    return model < SGS_CAMERA_MODEL_COUNT ? sgs_camera_model_name((sgs_camera_model)model)
                                          : later_models[model - SGS_CAMERA_MODEL_COUNT].name;
}

static int model_param_count(int model)
{
    return model < SGS_CAMERA_MODEL_COUNT
               ? sgs_camera_param_count((sgs_camera_model)model)
               : later_models[model - SGS_CAMERA_MODEL_COUNT].param_count;
}

// -1 for a name that COLMAP does not have.
static int model_of_name(const char *name)
{
    for (int model = 0; model < MODEL_COUNT; ++model)
        if (!strcmp(model_name(model), name))
            return model;
    return -1;
}

// `named`: the name or number in the file.
static sgs_status refuse_model(const loader *l, uint64_t place, int model, const char *named)
{
    const char *name = model_name(model);
    char what[96];
    if (name)
        snprintf(what, sizeof what, "camera model %s (%d) is not supported", name, model);
    else
        snprintf(what, sizeof what, "unknown camera model '%.64s'", named);
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: %s %llu: %s; supported: COLMAP's models 0 to %d, SIMPLE_FISHEYE (%d), "
                     "FISHEYE (%d) and EQUIRECTANGULAR (%d): undistort the images or use one of "
                     "these",
                     l->path, l->unit, (unsigned long long)place, what, SGS_CAMERA_MODEL_COUNT - 1,
                     SIMPLE_FISHEYE, FISHEYE, EQUIRECTANGULAR);
}

// The lens of camera.h. SIMPLE_FISHEYE and FISHEYE are equidistant: OPENCV_FISHEYE without
// distortion.
static sgs_camera camera_of(int model, int width, int height, const double *params)
{
    sgs_camera camera = {.model = SGS_CAMERA_OPENCV_FISHEYE, .width = width, .height = height};
    switch (model) {
    case SIMPLE_FISHEYE:
        memcpy(camera.params, (const double[]){params[0], params[0], params[1], params[2]},
               4 * sizeof *params);
        break;
    case FISHEYE:
        memcpy(camera.params, params, 4 * sizeof *params);
        break;
    case EQUIRECTANGULAR:
        camera = sgs_camera_equirectangular(width, height);
        break;
    default:
        camera.model = (sgs_camera_model)model;
        memcpy(camera.params, params, (size_t)model_param_count(model) * sizeof *params);
    }
    return camera;
}

// ---- Checks -------------------------------------------------------------------------------------

static sgs_status add_camera(loader *l, uint32_t id, int model, uint64_t width, uint64_t height,
                             const double *params)
{
    const unsigned long long place = l->place;
    if (width < 1 || height < 1 || width > MAX_SIZE || height > MAX_SIZE)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s %llu: camera %u has size %llu x %llu, not within 1 to %d pixels; "
                         "the file may be damaged",
                         l->path, l->unit, place, id, (unsigned long long)width,
                         (unsigned long long)height, MAX_SIZE);
    if (model == EQUIRECTANGULAR &&
        !(fabs(params[0] - (double)width) < 1.0 && fabs(params[1] - (double)height) < 1.0))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s %llu: camera %u: the parameters %g x %g of EQUIRECTANGULAR are not "
            "the size %d x %d of the image; export the model again",
            l->path, l->unit, place, id, params[0], params[1], (int)width, (int)height);
    const sgs_camera camera = camera_of(model, (int)width, (int)height, params);
    if (sgs_camera_validate(&camera))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s %llu: camera %u: %s; recalibrate this camera",
                         l->path, l->unit, place, id, sgs_last_error());
    if (!grow((void **)&l->cameras, l->camera_count, &l->camera_capacity, sizeof *l->cameras))
        return no_memory(l);
    l->cameras[l->camera_count++] = (camera_entry){.id = id, .camera = camera, .place = l->place};
    return SGS_STATUS_OK;
}

static int camera_order(const void *a, const void *b)
{
    const camera_entry *x = a, *y = b;
    return (x->id > y->id) - (x->id < y->id);
}

static sgs_status finish_cameras(loader *l)
{
    if (l->camera_count == 0)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: contains no cameras; rerun COLMAP's mapper or use another model",
                         l->path);
    qsort(l->cameras, l->camera_count, sizeof *l->cameras, camera_order);
    for (size_t i = 1; i < l->camera_count; ++i) {
        const camera_entry *a = &l->cameras[i - 1], *b = &l->cameras[i];
        if (a->id == b->id)
            return sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: %s %llu: duplicate camera id %u, first used at %s %llu; keep one of them",
                l->path, l->unit, (unsigned long long)(a->place > b->place ? a->place : b->place),
                a->id, l->unit, (unsigned long long)(a->place > b->place ? b->place : a->place));
    }
    return SGS_STATUS_OK;
}

static sgs_status add_image(loader *l, uint32_t id, const double pose[7], uint32_t camera_id,
                            const char *name)
{
    sgsi_dataset *d = l->dataset;
    const unsigned long long place = l->place;
    if (!grow((void **)&d->frames, d->frame_count, &l->frame_capacity, sizeof *d->frames))
        return no_memory(l);
    sgsi_frame *frame = &d->frames[d->frame_count];
    *frame = (sgsi_frame){.name = sgsi_strdup(name), .place = l->place};
    if (!frame->name)
        return no_memory(l);
    ++d->frame_count; // now owned by the dataset
    const char *problem = sgsi_image_name_clean(frame->name);
    if (problem)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s %llu: the name of image %u %s ('%.200s'); rename it in the model",
                         l->path, l->unit, place, id, problem,
                         strcmp(problem, "contains control characters") ? name : "not shown");
    if (sgs_pose_from_quaternion(pose, pose + 4, &frame->pose))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s %llu: image %u '%.200s': %s; remove or re-register the image",
                         l->path, l->unit, place, id, frame->name, sgs_last_error());
    const camera_entry key = {.id = camera_id};
    const camera_entry *entry =
        bsearch(&key, l->cameras, l->camera_count, sizeof key, camera_order);
    if (!entry)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s %llu: image %u '%.200s' refers to camera %u, which is missing in "
                         "the cameras file; use files of the same model",
                         l->path, l->unit, place, id, frame->name, camera_id);
    frame->camera = entry->camera;
    return SGS_STATUS_OK;
}

static sgs_status finish_images(loader *l)
{
    if (l->dataset->frame_count == 0)
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: contains no registered images; rerun COLMAP's mapper or use another model",
            l->path);
    return sgsi_dataset_check_names(l->dataset, l->path, l->unit);
}

static sgs_status add_point(loader *l, const double xyz[3], const uint8_t rgb[3])
{
    sgsi_dataset *d = l->dataset;
    const float point[3] = {(float)xyz[0], (float)xyz[1], (float)xyz[2]};
    if (!isfinite(point[0]) || !isfinite(point[1]) || !isfinite(point[2])) {
        if (l->points_dropped++ == 0)
            l->first_dropped = l->place;
        return SGS_STATUS_OK;
    }
    if (d->point_count == l->point_capacity) {
        size_t capacity = l->point_capacity;
        if (!grow((void **)&d->points, d->point_count, &capacity, sizeof point) ||
            !grow((void **)&d->colors, d->point_count, &l->point_capacity, 3))
            return no_memory(l);
    }
    memcpy(d->points + 3 * d->point_count, point, sizeof point);
    memcpy(d->colors + 3 * d->point_count, rgb, 3);
    ++d->point_count;
    return SGS_STATUS_OK;
}

static void warn_dropped_points(const loader *l)
{
    sgsi_point_cloud_warn_dropped(l->path, l->unit, (unsigned long long)l->first_dropped,
                                  l->points_dropped);
}

// ---- Binary -------------------------------------------------------------------------------------

typedef struct bytes {
    const uint8_t *data;
    size_t size, at;
} bytes;

static uint64_t decode(const uint8_t *p, int count)
{
    uint64_t value = 0;
    for (int i = 0; i < count; ++i)
        value |= (uint64_t)p[i] << (8 * i);
    return value;
}

static double decode_double(const uint8_t *p)
{
    const uint64_t bits = decode(p, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

// Returns the next `count` bytes, or NULL if fewer are left.
static const uint8_t *take(bytes *b, uint64_t count)
{
    if (count > b->size - b->at)
        return NULL;
    const uint8_t *p = b->data + b->at;
    b->at += (size_t)count;
    return p;
}

static sgs_status truncated(const loader *l, const bytes *b, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT,
                     "%s: byte %zu: unexpected end of file in %s; the file is truncated: copy or "
                     "export it again",
                     l->path, b->at, what);
}

// Reads the leading count and validates it against the remaining bytes.
static sgs_status take_count(const loader *l, bytes *b, size_t min_bytes, const char *what,
                             uint64_t *count)
{
    const uint8_t *p = take(b, 8);
    if (!p)
        return truncated(l, b, "its first count");
    *count = decode(p, 8);
    if (*count > (b->size - b->at) / min_bytes)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte 0: declares %llu %s, but the remaining %zu bytes can hold at "
                         "most %zu; the file is truncated or damaged: copy or export it again",
                         l->path, (unsigned long long)*count, what, b->size - b->at,
                         (b->size - b->at) / min_bytes);
    return SGS_STATUS_OK;
}

// Calls `read` for each record of a file that starts with their number.
static sgs_status read_records(loader *l, bytes *b, size_t min_bytes, const char *what,
                               sgs_status (*read)(loader *l, bytes *b))
{
    uint64_t count = 0;
    sgs_status status = take_count(l, b, min_bytes, what, &count);
    for (uint64_t i = 0; i < count && !status; ++i) {
        l->place = b->at;
        status = read(l, b);
    }
    return status;
}

static sgs_status read_camera_binary(loader *l, bytes *b)
{
    const uint8_t *p = take(b, 24);
    if (!p)
        return truncated(l, b, "a camera");
    const int model = (int)(int32_t)(uint32_t)decode(p + 4, 4);
    const int param_count = model_name(model) ? model_param_count(model) : 0;
    if (!param_count) {
        char number[16];
        snprintf(number, sizeof number, "%d", model);
        return refuse_model(l, l->place + 4, model, number);
    }
    const uint8_t *raw = take(b, 8 * (uint64_t)param_count);
    if (!raw)
        return truncated(l, b, "the parameters of a camera");
    double params[12] = {0};
    for (int k = 0; k < param_count; ++k)
        params[k] = decode_double(raw + 8 * k);
    return add_camera(l, (uint32_t)decode(p, 4), model, decode(p + 8, 8), decode(p + 16, 8),
                      params);
}

static sgs_status read_cameras_binary(loader *l, bytes *b)
{
    const sgs_status status = read_records(l, b, CAMERA_BYTES, "cameras", read_camera_binary);
    return status ? status : finish_cameras(l);
}

static sgs_status read_image_binary(loader *l, bytes *b)
{
    const uint8_t *p = take(b, 64);
    if (!p)
        return truncated(l, b, "an image");
    double pose[7];
    for (int k = 0; k < 7; ++k)
        pose[k] = decode_double(p + 4 + 8 * k);
    const char *name = (const char *)b->data + b->at;
    const uint8_t *end = memchr(name, 0, b->size - b->at);
    if (!end)
        return truncated(l, b, "the name of an image");
    b->at = (size_t)(end - b->data) + 1;
    const uint8_t *observations = take(b, 8);
    if (!observations)
        return truncated(l, b, "an image");
    const uint64_t n = decode(observations, 8);
    if (n > (b->size - b->at) / 24)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: image %u declares %llu 2-D points, but only %zu bytes are "
                         "left; the file is truncated or damaged: copy or export it again",
                         l->path, b->at - 8, (unsigned)decode(p, 4), (unsigned long long)n,
                         b->size - b->at);
    b->at += 24 * (size_t)n;
    return add_image(l, (uint32_t)decode(p, 4), pose, (uint32_t)decode(p + 60, 4), name);
}

static sgs_status read_images_binary(loader *l, bytes *b)
{
    const sgs_status status = read_records(l, b, IMAGE_BYTES, "images", read_image_binary);
    return status ? status : finish_images(l);
}

static sgs_status read_point_binary(loader *l, bytes *b)
{
    const uint8_t *p = take(b, POINT_BYTES);
    if (!p)
        return truncated(l, b, "a point");
    const uint64_t track = decode(p + 43, 8);
    if (track > (b->size - b->at) / 8)
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: byte %zu: point %llu declares a track of %llu images, but only %zu bytes are "
            "left; the file is truncated or damaged: copy or export it again",
            l->path, b->at - 8, (unsigned long long)decode(p, 8), (unsigned long long)track,
            b->size - b->at);
    b->at += 8 * (size_t)track;
    const double xyz[3] = {decode_double(p + 8), decode_double(p + 16), decode_double(p + 24)};
    return add_point(l, xyz, p + 32);
}

static sgs_status read_points_binary(loader *l, bytes *b)
{
    const sgs_status status = read_records(l, b, POINT_BYTES, "points", read_point_binary);
    if (!status)
        warn_dropped_points(l);
    return status;
}

// ---- Text ---------------------------------------------------------------------------------------

typedef struct lines {
    char *next, *end;
    uint64_t announced; // from the "# Number of ...: N" comment; UINT64_MAX if absent
} lines;

// The next line, trimmed, or NULL at the end of the file.
static char *next_line(loader *l, lines *t)
{
    if (t->next >= t->end)
        return NULL;
    char *line = t->next;
    char *end = memchr(line, '\n', (size_t)(t->end - line));
    t->next = end ? end + 1 : t->end;
    ++l->place;
    if (!end)
        end = t->end;
    while (end > line && (end[-1] == ' ' || end[-1] == '\t' || end[-1] == '\r'))
        --end;
    *end = 0;
    return line + strspn(line, " \t");
}

// The next line that is neither empty nor a comment.
static char *next_record(loader *l, lines *t)
{
    char *line;
    while ((line = next_line(l, t))) {
        unsigned long long announced;
        if (line[0] != '#' && line[0])
            return line;
        if (sscanf(line, "# Number of %*[a-z]: %llu", &announced) == 1)
            t->announced = announced;
    }
    return NULL;
}

static char *next_word(char **cursor)
{
    char *word = *cursor + strspn(*cursor, " \t");
    if (!*word)
        return NULL;
    char *end = word + strcspn(word, " \t");
    *cursor = *end ? end + 1 : end;
    *end = 0;
    return word;
}

static bool word_double(char **cursor, double *value)
{
    char *word = next_word(cursor), *end;
    if (!word)
        return false;
    *value = strtod(word, &end);
    return *end == 0;
}

static bool word_integer(char **cursor, uint64_t limit, uint64_t *value)
{
    char *word = next_word(cursor), *end;
    if (!word || word[0] < '0' || word[0] > '9')
        return false;
    errno = 0;
    *value = strtoull(word, &end, 10);
    return *end == 0 && errno == 0 && *value <= limit;
}

static sgs_status bad_line(const loader *l, const char *expected)
{
    return sgsi_fail(
        SGS_STATUS_FORMAT,
        "%s: line %llu: expected %s; the file is truncated or damaged: export it again", l->path,
        (unsigned long long)l->place, expected);
}

static void check_announced(const loader *l, const lines *t, uint64_t count, const char *what)
{
    if (t->announced != UINT64_MAX && t->announced != count)
        sgsi_warn(
            "%s: the header declares %llu %s, but the file contains %llu; is the file complete?",
            l->path, (unsigned long long)t->announced, what, (unsigned long long)count);
}

static sgs_status read_cameras_text(loader *l, lines *t)
{
    char *line;
    while ((line = next_record(l, t))) {
        uint64_t id, width, height;
        double params[12] = {0};
        const char *form = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]";
        if (!word_integer(&line, UINT32_MAX, &id))
            return bad_line(l, form);
        const char *name = next_word(&line);
        if (!name)
            return bad_line(l, form);
        const int model = model_of_name(name), expected = model < 0 ? 0 : model_param_count(model);
        if (!expected)
            return refuse_model(l, l->place, model, name);
        if (!word_integer(&line, UINT64_MAX, &width) || !word_integer(&line, UINT64_MAX, &height))
            return bad_line(l, form);
        int count = 0;
        while (count < expected && word_double(&line, &params[count]))
            ++count;
        if (count < expected || next_word(&line))
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: line %llu: camera model %s requires exactly %d parameters; "
                             "export the model again",
                             l->path, (unsigned long long)l->place, name, expected);
        const sgs_status status = add_camera(l, (uint32_t)id, model, width, height, params);
        if (status)
            return status;
    }
    check_announced(l, t, l->camera_count, "cameras");
    return finish_cameras(l);
}

// True for a list of X Y POINT3D_ID triples, the second line of an image. Detects pose lines in
// files whose second lines were removed.
static bool is_observation_line(const char *line)
{
    size_t words = 0;
    const char *last = line;
    for (const char *c = line + strspn(line, " \t"); *c; c += strspn(c, " \t")) {
        last = c;
        c += strcspn(c, " \t");
        ++words;
    }
    last += *last == '-';
    const size_t digits = strspn(last, "0123456789");
    return words % 3 == 0 && (words == 0 || (digits > 0 && !last[digits]));
}

static sgs_status read_images_text(loader *l, lines *t)
{
    char *line;
    while ((line = next_record(l, t))) {
        const char *form = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
        uint64_t id, camera_id;
        double pose[7];
        if (!word_integer(&line, UINT32_MAX, &id))
            return bad_line(l, form);
        for (int i = 0; i < 7; ++i) {
            if (!word_double(&line, &pose[i]))
                return bad_line(l, form);
        }
        if (!word_integer(&line, UINT32_MAX, &camera_id))
            return bad_line(l, form);
        line += strspn(line, " \t");
        if (!*line)
            return bad_line(l, form);
        const sgs_status status = add_image(l, (uint32_t)id, pose, (uint32_t)camera_id, line);
        if (status)
            return status;
        const char *second = next_line(l, t);
        if (second && !is_observation_line(second))
            return bad_line(
                l, "X Y POINT3D_ID ... (the second line of every image, which may be empty)");
    }
    check_announced(l, t, l->dataset->frame_count, "images");
    return finish_images(l);
}

static sgs_status read_points_text(loader *l, lines *t)
{
    char *line;
    uint64_t count = 0;
    while ((line = next_record(l, t))) {
        const char *form = "POINT3D_ID X Y Z R G B ERROR TRACK[]";
        uint64_t id, rgb[3];
        double xyz[3], error;
        bool ok = word_integer(&line, UINT64_MAX, &id);
        for (int i = 0; i < 3; ++i)
            ok = ok && word_double(&line, &xyz[i]);
        for (int i = 0; i < 3; ++i)
            ok = ok && word_integer(&line, 255, &rgb[i]);
        if (!ok || !word_double(&line, &error))
            return bad_line(l, form);
        const uint8_t color[3] = {(uint8_t)rgb[0], (uint8_t)rgb[1], (uint8_t)rgb[2]};
        const sgs_status status = add_point(l, xyz, color);
        if (status)
            return status;
        ++count;
    }
    check_announced(l, t, count, "points");
    warn_dropped_points(l);
    return SGS_STATUS_OK;
}

// ---- Files --------------------------------------------------------------------------------------

static bool file_present(const char *folder, const char *name)
{
    char path[PATH_MAX];
    const int length = snprintf(path, sizeof path, "%s/%s", folder, name);
    return length > 0 && length < PATH_MAX && !access(path, F_OK);
}

static bool binary_present(const char *folder)
{
    return file_present(folder, "cameras.bin") && file_present(folder, "images.bin");
}

static bool text_present(const char *folder)
{
    return file_present(folder, "cameras.txt") && file_present(folder, "images.txt");
}

bool sgsi_colmap_present(const char *folder)
{
    return binary_present(folder) || text_present(folder);
}

// A text file, without the byte order mark that some editors write.
static lines text_lines(uint8_t *content, size_t size)
{
    return (lines){.next = (char *)content + sgsi_byte_order_mark(content),
                   .end = (char *)content + size,
                   .announced = UINT64_MAX};
}

// Reads one file with one of the readers.
static sgs_status read_file(loader *l, const char *folder, const char *name,
                            sgs_status (*binary)(loader *, bytes *),
                            sgs_status (*text)(loader *, lines *))
{
    char *path = sgsi_format("%s/%s.%s", folder, name, binary ? "bin" : "txt");
    uint8_t *content = NULL;
    size_t size = 0;
    if (!path)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", folder);
    sgs_status status = sgsi_file_read(path, 0, &content, &size);
    l->path = path;
    l->unit = binary ? "byte" : "line";
    l->place = 0;
    if (!status && binary) {
        bytes b = {.data = content, .size = size};
        status = binary(l, &b);
        if (!status && b.at < size)
            sgsi_warn(
                "%s: byte %zu: ignored %zu bytes after the last record; the file may be damaged",
                path, b.at, size - b.at);
    } else if (!status) {
        const uint8_t *nul = memchr(content, 0, size);
        lines t = text_lines(content, size);
        status = nul ? sgsi_fail(SGS_STATUS_FORMAT,
                                 "%s: byte %zu: zero byte in a text file; export it again", path,
                                 (size_t)(nul - content))
                     : text(l, &t);
    }
    l->path = folder;
    sgsi_free(content);
    sgsi_free(path);
    return status;
}

static sgs_status read_model(loader *l, const char *folder, bool binary)
{
    sgs_status status =
        read_file(l, folder, "cameras", binary ? read_cameras_binary : NULL, read_cameras_text);
    if (!status)
        status =
            read_file(l, folder, "images", binary ? read_images_binary : NULL, read_images_text);
    if (status)
        return status;
    // Tools that edit the points alone may leave text points with binary cameras, or vice versa.
    const bool binary_points = file_present(folder, "points3D.bin"),
               text_points = file_present(folder, "points3D.txt");
    if (!binary_points && !text_points) {
        sgsi_warn("%s: no points3D.%s; the model has no points", folder, binary ? "bin" : "txt");
        return SGS_STATUS_OK;
    }
    return read_file(l, folder, "points3D",
                     binary_points && (binary || !text_points) ? read_points_binary : NULL,
                     read_points_text);
}

sgs_status sgsi_colmap_read(const char *folder, sgsi_dataset *dataset)
{
    const bool binary = binary_present(folder);
    *dataset = (sgsi_dataset){.format = binary ? SGS_SCENE_COLMAP_BINARY : SGS_SCENE_COLMAP_TEXT};
    loader l = {.dataset = dataset};
    if (binary && text_present(folder))
        sgsi_warn("%s: contains the model as .bin and as .txt; the .txt files are ignored", folder);
    const sgsi_plain_numbers numbers = sgsi_plain_numbers_begin();
    const sgs_status status = read_model(&l, folder, binary);
    sgsi_plain_numbers_end(&numbers);
    sgsi_free(l.cameras);
    if (status)
        sgsi_dataset_free(dataset);
    return status;
}

size_t sgsi_colmap_image_count(const char *folder)
{
    const bool binary = binary_present(folder);
    char *path = sgsi_format("%s/images.%s", folder, binary ? "bin" : "txt");
    uint8_t *content = NULL;
    size_t size = 0, count = 0;
    if (!path || sgsi_file_read(path, 0, &content, &size)) {
        sgsi_free(path);
        return 0;
    }
    if (binary) {
        const uint64_t announced = size < 8 ? 0 : decode(content, 8);
        count = announced > size / IMAGE_BYTES ? 0 : (size_t)announced;
    } else {
        loader l = {.path = path};
        lines t = text_lines(content, size);
        while (next_record(&l, &t)) {
            next_line(&l, &t);
            ++count;
        }
    }
    sgsi_free(content);
    sgsi_free(path);
    return count;
}
