// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// UsdGeomCamera: looks along its -z axis with y up. Lengths of the film are in one unit, so that
// only their ratios matter: fx = focalLength / horizontalAperture * width, and the aperture offsets
// move the film right and up, the principal point therefore left and down in the image.

#include "sparegs/usd_cameras.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/image.h"
#include "usd/usd_layer.h"

enum {
    MAX_CAMERAS = 100000,
    MAX_VIEWS = 100000,
    MAX_FRAME = 1000000,
    MAX_PATH = 1000,
    FIRST_CAPACITY = 4
};
static const double DEFAULT_RATE = 24.0; // of UsdStage::GetTimeCodesPerSecond
// Sample times computed by programs may be off an integer by their rounding.
static const double TIME_ROUNDING = 1e-6;

typedef enum film_value {
    FOCAL,
    WIDTH,
    HEIGHT,
    OFFSET_X,
    OFFSET_Y,
    PIXEL_ASPECT,
    FILM_VALUES
} film_value;

// Attributes and the fallbacks of the schema.
static const struct {
    const char *name;
    double fallback;
    bool is_positive;
} film_table[FILM_VALUES] = {
    [FOCAL] = {"focalLength", 50.0, true},
    [WIDTH] = {"horizontalAperture", 20.955, true},
    [HEIGHT] = {"verticalAperture", 15.2908, true},
    [OFFSET_X] = {"horizontalApertureOffset", 0.0, false},
    [OFFSET_Y] = {"verticalApertureOffset", 0.0, false},
    [PIXEL_ASPECT] = {"sparegs:pixelAspectRatio", 1.0, true},
};

// A transform and the next one above it that is not empty.
typedef struct transform_node {
    sgsi_usd_transform transform;
    size_t parent; // SGSI_USD_NONE: the world
} transform_node;

typedef struct camera_prim {
    char *path;
    bool is_orthographic;
    bool is_referer;  // refers to other prims, or one above does
    bool placed;      // the prims above have no effect
    size_t node, top; // its transform, and the last one above it so far; SGSI_USD_NONE: none
    sgsi_usd_value film[FILM_VALUES];
} camera_prim;

typedef struct camera_stage {
    camera_prim *prims;
    size_t prim_count, prim_capacity;
    transform_node *nodes;
    size_t node_count, node_capacity;
} camera_stage;

static sgs_status fail_memory(const char *path)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read its cameras", path);
}

// Makes room for one more element.
static bool reserve(void **block, size_t count, size_t *capacity, size_t size)
{
    if (count < *capacity)
        return true;
    const size_t grown = *capacity ? 2 * *capacity : FIRST_CAPACITY;
    if (!sgsi_grow(block, count, grown, size))
        return false;
    *capacity = grown;
    return true;
}

// ---- Reading ----

static bool is_name(const char *name, size_t length)
{
    for (size_t k = 0; k < length; ++k)
        if ((unsigned char)name[k] < 32 || name[k] == 127 || name[k] == '/')
            return false;
    return length > 0;
}

// The path of the innermost open prim, without the first slash.
static sgs_status make_path(const sgsi_usd_layer *layer, char **path)
{
    char text[MAX_PATH + 1];
    size_t length = 0;
    for (int k = 1; k <= layer->depth; ++k) {
        const sgsi_usd_scope *scope = &layer->scopes[k];
        if (!scope->name || !is_name(scope->name, scope->name_length))
            return sgsi_usd_fail_line(layer, "the camera, or a prim above it, has no valid name");
        if (scope->name_length >= MAX_PATH - length)
            return sgsi_usd_fail_line(layer, "the path of the camera is longer than 1000 bytes");
        if (length)
            text[length++] = '/';
        memcpy(text + length, scope->name, scope->name_length);
        length += scope->name_length;
    }
    text[length] = 0;
    *path = sgsi_strdup(text);
    return *path ? SGS_STATUS_OK : fail_memory(layer->path);
}

static sgs_status begin_camera(void *context, sgsi_usd_layer *layer)
{
    camera_stage *stage = context;
    char *path = NULL;
    if (stage->prim_count == MAX_CAMERAS)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: contains more than %d cameras", layer->path,
                         MAX_CAMERAS);
    const sgs_status status = make_path(layer, &path);
    if (status)
        return status;
    if (!reserve((void **)&stage->prims, stage->prim_count, &stage->prim_capacity,
                 sizeof *stage->prims)) {
        sgsi_free(path);
        return fail_memory(layer->path);
    }
    stage->prims[stage->prim_count++] =
        (camera_prim){.path = path,
                      .is_referer = layer->scopes[layer->depth].is_referer,
                      .node = SGSI_USD_NONE,
                      .top = SGSI_USD_NONE};
    return SGS_STATUS_OK;
}

// True if the value, or one of its time samples, is this token.
static bool names_token(sgsi_usd_text text, const char *token)
{
    char word[SGSI_USD_NAME + 1];
    const bool sampled = sgsi_usd_accept(&text, "{");
    do {
        if (!sgsi_usd_token(&text, word) || *word == '}')
            return false;
        if ((*word == '"' || *word == '\'') && text.string_length == strlen(token) &&
            !strncmp(text.string, token, text.string_length))
            return true;
    } while (sampled);
    return false;
}

static sgs_status read_value(void *context, sgsi_usd_layer *layer, const char *name)
{
    camera_stage *stage = context;
    camera_prim *prim = &stage->prims[layer->scopes[layer->depth].own];
    const size_t length = strcspn(name, ".");
    if (!strcmp(name, "projection") || !strcmp(name, "projection.timeSamples"))
        prim->is_orthographic |= names_token(layer->text, "orthographic");
    for (int k = 0; k < FILM_VALUES; ++k)
        if (strlen(film_table[k].name) == length && !strncmp(name, film_table[k].name, length) &&
            !sgsi_usd_value_set(&prim->film[k], name + length, layer->text, true))
            return fail_memory(layer->path);
    return SGS_STATUS_OK;
}

// Places the cameras in the innermost open prim, which may be one itself.
static sgs_status end_prim(void *context, sgsi_usd_layer *layer)
{
    camera_stage *stage = context;
    sgsi_usd_scope *scope = &layer->scopes[layer->depth];
    if (!scope->transform.listed && !scope->transform.crowded && !scope->transform.resets)
        return SGS_STATUS_OK;
    if (!reserve((void **)&stage->nodes, stage->node_count, &stage->node_capacity,
                 sizeof *stage->nodes))
        return fail_memory(layer->path);
    const size_t node = stage->node_count++;
    stage->nodes[node] = (transform_node){scope->transform, SGSI_USD_NONE};
    scope->transform.operations = NULL; // they have moved
    scope->transform.count = 0;
    for (size_t i = scope->first; i < stage->prim_count; ++i) {
        camera_prim *prim = &stage->prims[i];
        if (prim->placed)
            continue;
        if (prim->top == SGSI_USD_NONE)
            prim->node = node;
        else
            stage->nodes[prim->top].parent = node;
        prim->top = node;
        prim->placed = stage->nodes[node].transform.resets;
    }
    return SGS_STATUS_OK;
}

static void free_stage(camera_stage *stage)
{
    for (size_t i = 0; i < stage->prim_count; ++i) {
        for (int k = 0; k < FILM_VALUES; ++k)
            sgsi_usd_value_free(&stage->prims[i].film[k]);
        sgsi_free(stage->prims[i].path);
    }
    for (size_t i = 0; i < stage->node_count; ++i)
        sgsi_usd_transform_free(&stage->nodes[i].transform);
    sgsi_free(stage->prims);
    sgsi_free(stage->nodes);
}

// ---- Evaluation ----

// What is evaluated, for messages.
typedef struct evaluation {
    const sgsi_usd_layer *layer;
    const camera_stage *stage;
    int width, height;
    const camera_prim *misfit; // the first camera whose film has another shape than the images
    double misfit_ratio;       // width over height in pixels that would show its film
} evaluation;

static sgs_status fail_view(const evaluation *work, sgs_status status, const camera_prim *prim,
                            double time, const char *what)
{
    return sgsi_fail(status, "%s: camera '%s', time code %.9g: %s", work->layer->path, prim->path,
                     time, what);
}

static sgs_status evaluate_film(const evaluation *work, const camera_prim *prim, double time,
                                double film[FILM_VALUES])
{
    for (int k = 0; k < FILM_VALUES; ++k) {
        const sgsi_usd_value *value = &prim->film[k];
        const char *name = film_table[k].name, *problem = NULL;
        double numbers[SGSI_USD_NUMBERS];
        bool between;
        const int count = sgsi_usd_value_at(value, time, SGSI_USD_LINEAR, numbers, &between);
        film[k] = count > 0 ? numbers[0] : film_table[k].fallback;
        if (value->has_spline && !value->sample_count)
            problem = "has a spline, which is not read; convert it to time samples";
        else if ((count && count != 1) || !isfinite(film[k]))
            problem = "is not a number";
        else if (film_table[k].is_positive && !(film[k] > 0.0))
            problem = "is not positive";
        if (problem)
            return sgsi_fail(value->has_spline ? SGS_STATUS_UNSUPPORTED : SGS_STATUS_FORMAT,
                             "%s: camera '%s', time code %.9g: %s %s", work->layer->path,
                             prim->path, time, name, problem);
    }
    return SGS_STATUS_OK;
}

static sgs_camera film_camera(evaluation *work, const camera_prim *prim,
                              const double film[FILM_VALUES])
{
    const int width = work->width, height = work->height;
    const double fy = film[FOCAL] / film[HEIGHT] * height;
    double fx = film[FOCAL] / film[WIDTH] * width;
    if (sgs_pixel_aspect(fx * film[PIXEL_ASPECT], fy, width, height) != 1.0) {
        if (!work->misfit) {
            work->misfit = prim;
            work->misfit_ratio = film[WIDTH] / film[HEIGHT] / film[PIXEL_ASPECT];
        }
        fx = fy / film[PIXEL_ASPECT];
    }
    return (sgs_camera){SGS_CAMERA_PINHOLE,
                        width,
                        height,
                        {fx, fy, 0.5 * width - film[OFFSET_X] / film[FOCAL] * fx,
                         0.5 * height + film[OFFSET_Y] / film[FOCAL] * fy}};
}

// Camera to world of the stage, with y up. *between: as of sgsi_usd_transform_at.
static sgs_status evaluate_world(const evaluation *work, const camera_prim *prim, double time,
                                 double world[4][4], bool *between)
{
    static const char *const faults[] = {
        [SGSI_USD_ANIMATED] = "its transform has a spline, which is not read; convert it to time "
                              "samples",
        [SGSI_USD_INVALID] = "its transform has an operation of an unknown type or without a valid "
                             "value",
        [SGSI_USD_CROWDED] = "its transform has a prim with more than 32 operations"};
    const transform_node *nodes = work->stage->nodes;
    sgsi_usd_identity(world);
    *between = false;
    for (size_t k = prim->node; k != SGSI_USD_NONE; k = nodes[k].parent) {
        double matrix[4][4];
        const sgsi_usd_fault fault =
            sgsi_usd_transform_at(&nodes[k].transform, time, matrix, between);
        if (fault)
            return fail_view(work,
                             fault == SGSI_USD_INVALID ? SGS_STATUS_FORMAT : SGS_STATUS_UNSUPPORTED,
                             prim, time, faults[fault]);
        sgsi_usd_multiply(world, (const double(*)[4])matrix);
    }
    if (work->layer->z_up)
        sgsi_usd_turn_y_up(world);
    return SGS_STATUS_OK;
}

static bool is_finite(const double matrix[4][4])
{
    bool finite = true;
    for (int k = 0; k < 16; ++k)
        finite = finite && isfinite(matrix[k / 4][k % 4]);
    return finite;
}

// Axes and centre change their y and z, as those of models do; the camera's own y and z, too.
static sgs_status evaluate_pose(const evaluation *work, const camera_prim *prim, double time,
                                sgs_pose *pose)
{
    static const double sign[3] = {1.0, -1.0, -1.0};
    double world[4][4];
    sgsi_affine affine;
    bool between;
    const sgs_status status = evaluate_world(work, prim, time, world, &between);
    if (status)
        return status;
    if (!sgsi_usd_affine((const double(*)[4])world, &affine))
        return fail_view(work, SGS_STATUS_FORMAT, prim, time,
                         between && is_finite((const double(*)[4])world)
                             ? "its matrix interpolated between two time samples is singular; add "
                               "samples"
                             : "its transform is not finite, or has a scale of 0");
    if (affine.mirrored)
        return fail_view(work, SGS_STATUS_UNSUPPORTED, prim, time,
                         "its transform mirrors it; remove the negative scale");
    if (affine.deforms && !between)
        return fail_view(work, SGS_STATUS_UNSUPPORTED, prim, time,
                         "its transform has a shear or a scale that is not uniform; export it "
                         "without");
    for (int i = 0; i < 3; ++i) {
        pose->translation[i] = 0.0;
        for (int j = 0; j < 3; ++j) {
            pose->rotation[3 * i + j] = sign[i] * sign[j] * affine.similarity.rotation[j][i];
            pose->translation[i] -= pose->rotation[3 * i + j] * sign[j] * world[3][j];
        }
    }
    return sgs_pose_validate(pose)
               ? fail_view(work, SGS_STATUS_FORMAT, prim, time, sgs_last_error())
               : SGS_STATUS_OK;
}

static sgs_status evaluate_view(evaluation *work, const camera_prim *prim, double time,
                                sgs_usd_view *view)
{
    double film[FILM_VALUES];
    view->time = time;
    sgs_status status = evaluate_film(work, prim, time, film);
    if (status)
        return status;
    view->camera = film_camera(work, prim, film);
    if (sgs_camera_validate(&view->camera))
        return fail_view(work, SGS_STATUS_FORMAT, prim, time, sgs_last_error());
    return evaluate_pose(work, prim, time, &view->pose);
}

// ---- Frames ----

// The time samples of a camera.
typedef struct sample_range {
    bool any, several; // several: of one attribute
    double first, last;
} sample_range;

static void include_samples(sample_range *range, const sgsi_usd_value *value)
{
    if (!value->sample_count)
        return;
    const double first = value->samples[0].time,
                 last = value->samples[value->sample_count - 1].time;
    range->first = range->any ? fmin(range->first, first) : first;
    range->last = range->any ? fmax(range->last, last) : last;
    range->any = true;
    range->several |= value->sample_count > 1;
}

static sample_range find_samples(const camera_stage *stage, const camera_prim *prim)
{
    sample_range range = {0};
    for (int k = 0; k < FILM_VALUES; ++k)
        include_samples(&range, &prim->film[k]);
    for (size_t k = prim->node; k != SGSI_USD_NONE; k = stage->nodes[k].parent) {
        const sgsi_usd_transform *transform = &stage->nodes[k].transform;
        for (int i = 0; i < transform->listed; ++i)
            include_samples(&range, &transform->operations[transform->order[i].operation].value);
    }
    return range;
}

static bool is_frame(double time)
{
    return fabs(time) <= MAX_FRAME;
}

// Time of the first view, and the number of views at intervals of 1.
static sgs_status find_frames(const evaluation *work, const camera_prim *prim,
                              const sample_range *range, double *first, size_t *count)
{
    const sgsi_usd_times *times = &work->layer->times;
    const bool has_start = !isnan(times->start), has_end = !isnan(times->end);
    *first = range->first; // 0 without samples
    *count = 1;
    if (!range->several)
        return SGS_STATUS_OK;
    const double last = has_end     ? times->end
                        : has_start ? fmax(times->start, range->last)
                                    : range->last;
    *first = has_start ? times->start : has_end ? fmin(times->end, *first) : *first;
    if (*first > last)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: startTimeCode, %.9g, is after endTimeCode, %.9g",
                         work->layer->path, *first, last);
    if (!is_frame(*first) || !is_frame(last))
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "%s: camera '%s' has the time codes %.9g to %.9g; frames are numbered "
                         "from -%d to %d: set startTimeCode and endTimeCode",
                         work->layer->path, prim->path, *first, last, MAX_FRAME, MAX_FRAME);
    const double low = ceil(*first - TIME_ROUNDING), high = floor(last + TIME_ROUNDING);
    if (low <= high) { // else no integer is in the range
        *first = low;
        *count = (size_t)(high - low) + 1;
    }
    return SGS_STATUS_OK;
}

static sgs_status read_rate(const sgsi_usd_layer *layer, double *fps)
{
    const sgsi_usd_times *times = &layer->times;
    *fps = !isnan(times->codes_per_second)    ? times->codes_per_second
           : !isnan(times->frames_per_second) ? times->frames_per_second
                                              : DEFAULT_RATE;
    return *fps >= 0.01 && *fps <= 1000.0
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_FORMAT,
                           "%s: timeCodesPerSecond or framesPerSecond, %g, is not from 0.01 to "
                           "1000; each time code is a frame",
                           layer->path, *fps);
}

// ---- Cameras ----

static sgs_status evaluate_camera(evaluation *work, const camera_prim *prim, size_t *total,
                                  sgs_usd_camera *camera)
{
    const sample_range range = find_samples(work->stage, prim);
    double first;
    size_t count;
    sgs_status status = find_frames(work, prim, &range, &first, &count);
    if (status)
        return status;
    *total += count;
    if (*total > MAX_VIEWS)
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "%s: its cameras have more than %d frames from startTimeCode to "
                         "endTimeCode; reduce the range",
                         work->layer->path, MAX_VIEWS);
    camera->path = sgsi_strdup(prim->path);
    camera->views = sgsi_calloc(count, sizeof *camera->views);
    if (!camera->path || !camera->views)
        return fail_memory(work->layer->path);
    camera->has_samples = range.any && is_frame(first);
    camera->is_animated = range.several;
    camera->view_count = count;
    for (size_t i = 0; i < count && !status; ++i) {
        camera->views[i].frame = camera->has_samples ? (int)lrint(first) + (int)i : 0;
        status = evaluate_view(work, prim, first + (double)i, &camera->views[i]);
    }
    return status;
}

static sgs_status fail_empty(const sgsi_usd_layer *layer, const camera_stage *stage)
{
    if (stage->prim_count)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: camera '%s' is orthographic; only perspective cameras are read",
                         layer->path, stage->prims[0].path);
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: contains no active prim of type Camera%s", layer->path,
                     layer->is_package || layer->has_references
                         ? "; add those of other files with 'usdcat -f'"
                         : "");
}

static void warn(const evaluation *work, size_t orthographic)
{
    const char *path = work->layer->path;
    const double ratio = (double)work->width / work->height;
    bool refers = work->layer->has_sublayers;
    for (size_t i = 0; i < work->stage->prim_count; ++i)
        refers |= work->stage->prims[i].is_referer;
    if (orthographic)
        sgsi_warn("%s: %zu orthographic camera(s) are omitted", path, orthographic);
    if (refers)
        sgsi_warn("%s: references, sublayers and inherited values of its cameras are not read; "
                  "apply them with 'usdcat -f %s -o X.usda'",
                  path, path);
    if (work->misfit)
        sgsi_warn("%s: the film of camera '%s' has the aspect ratio %.4g, the images %.4g: the "
                  "vertical field of view is kept; images of %.0fx%d pixels show exactly the film",
                  path, work->misfit->path, work->misfit_ratio, ratio,
                  fmax(1.0, rint(work->misfit_ratio * work->height)), work->height);
}

static sgs_status evaluate_cameras(evaluation *work, sgs_usd_cameras *made)
{
    const camera_stage *stage = work->stage;
    sgs_status status = SGS_STATUS_OK;
    size_t total = 0;
    bool animated = false;
    made->cameras = sgsi_calloc(stage->prim_count + 1, sizeof *made->cameras);
    if (!made->cameras)
        return fail_memory(work->layer->path);
    for (size_t i = 0; i < stage->prim_count && !status; ++i)
        if (!stage->prims[i].is_orthographic) {
            sgs_usd_camera *camera = &made->cameras[made->count++];
            status = evaluate_camera(work, &stage->prims[i], &total, camera);
            animated |= camera->is_animated;
        }
    if (!status && !made->count)
        status = fail_empty(work->layer, stage);
    if (!status && animated)
        status = read_rate(work->layer, &made->fps);
    if (!status)
        warn(work, stage->prim_count - made->count);
    return status;
}

sgs_status sgs_usd_cameras_read(const char *path, int width, int height, sgs_usd_cameras **cameras)
{
    static const sgsi_usd_visitor visitor = {.type = "Camera",
                                             .plural = "cameras are",
                                             .animates = true,
                                             .begin = begin_camera,
                                             .value = read_value,
                                             .end = end_prim};
    enum { MAX_SIZE = 65536 };
    camera_stage stage = {0};
    sgsi_usd_layer *layer = NULL;
    *cameras = NULL;
    if (width < 1 || width > MAX_SIZE || height < 1 || height > MAX_SIZE)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: width and height are %d and %d; they must be from 1 to %d", path,
                         width, height, MAX_SIZE);
    sgs_usd_cameras *made = sgsi_calloc(1, sizeof *made);
    sgs_status status =
        made ? sgsi_usd_layer_read(path, &visitor, &stage, &layer) : fail_memory(path);
    if (!status) {
        evaluation work = {.layer = layer, .stage = &stage, .width = width, .height = height};
        status = evaluate_cameras(&work, made);
    }
    free_stage(&stage);
    sgsi_usd_layer_close(layer);
    if (status)
        sgs_usd_cameras_destroy(made);
    else
        *cameras = made;
    return status;
}

void sgs_usd_cameras_destroy(sgs_usd_cameras *cameras)
{
    if (!cameras)
        return;
    for (size_t i = 0; i < cameras->count; ++i) {
        sgsi_free(cameras->cameras[i].path);
        sgsi_free(cameras->cameras[i].views);
    }
    sgsi_free(cameras->cameras);
    sgsi_free(cameras);
}
