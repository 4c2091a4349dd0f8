// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_painter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cameras/lens_samples.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "draw/frame_files.h"
#include "sparegs/aov_descriptors.h"

enum { RANGE_SAMPLES = 16384 };

static bool prepare_frame(sgs_frame *frame, unsigned *held, int width, int height, unsigned planes)
{
    if (frame->width == width && frame->height == height && *held == planes)
        return true;
    sgs_frame_free(frame);
    *held = planes;
    return !sgs_frame_create_with(width, height, planes, frame);
}

static frame_files files_of(const view_painter *painter, const view_request *request,
                            const sgs_camera *camera, const picture_ranges *ranges)
{
    view_source *source = painter->source;
    const drawing_values *drawing = &source->drawing;
    frame_files files = {.folder = source->folder,
                         .name = "view",
                         .camera = camera,
                         .pose = &request->pose,
                         .space = drawing->space,
                         .white_point = (float)drawing->white_point,
                         .near_distance = drawing->near_distance,
                         .ranges = ranges};
    memcpy(files.background, drawing->background, sizeof files.background);
    return files;
}

// ---- Ranges of colours ----

// The 1 % and 99 % quantiles of evenly chosen values of a plane; `positive`: of the positive ones.
static value_range measure(const float *plane, const float *transmittance, size_t pixels,
                           bool positive)
{
    static const value_range none = {0, 1};
    const size_t step = pixels / RANGE_SAMPLES + 1;
    float *values = malloc((pixels / step + 1) * sizeof *values);
    size_t count = 0;
    for (size_t i = 0; values && i < pixels; i += step)
        if (isfinite(plane[i]) && (positive ? plane[i] > 0 : transmittance[i] < 1))
            values[count++] = plane[i];
    const value_range range = values ? sorted_range(values, count) : none;
    free(values);
    return range;
}

// Replaces positive values by 1 + log(v / low) / log(high / low), so that the range becomes 1 to 2.
static value_range to_logarithms(float *plane, size_t pixels, value_range range)
{
    static const value_range logarithmic = {1, 2};
    const float low = range.low > 0 ? range.low : 1e-6F * range.high;
    const float scale = 1 / logf(fmaxf(range.high / low, 1.0001F));
    for (size_t i = 0; i < pixels; ++i)
        plane[i] = plane[i] > 0 ? fmaxf(1 + logf(plane[i] / low) * scale, 1e-6F) : 0;
    return logarithmic;
}

// Sets the ranges that the picture of the request uses. Returns the range of a ramp.
static value_range prepare_ranges(const view_request *request, sgs_frame *frame,
                                  picture_ranges *ranges)
{
    const aov_row *row = &aov_rows[request->aov];
    const sgs_aov *source = sgs_aov_find(row->source);
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    const int channels =
        row->picture == AOV_PICTURE_POSITIONS ? 3 : row->picture == AOV_PICTURE_RAMP;
    for (int c = 0; c < channels; ++c)
        ranges->of[request->aov][c] = measure(sgs_aov_plane(source, frame, c), frame->transmittance,
                                              pixels, row->picture == AOV_PICTURE_RAMP);
    value_range *first = &ranges->of[request->aov][0];
    if (row->picture != AOV_PICTURE_RAMP)
        return (value_range){0, 0};
    if (request->range.high > request->range.low)
        *first = request->range;
    const value_range shown = *first;
    if (request->is_log)
        *first = to_logarithms(sgs_aov_plane(source, frame, 0), pixels, shown);
    return shown;
}

// ---- Pictures ----

// Replaces the colours by the mean of samples, as `render --spp` does.
static bool draw_samples(view_painter *painter, sgs_renderer *renderer, const sgs_camera *camera,
                         const sgs_pose *pose, const sgs_render_options *options, int samples)
{
    light_sum sum;
    unsigned none = 0;
    bool done = prepare_frame(&painter->sampled, &none, camera->width, camera->height, 0) &&
                light_sum_begin(&sum, camera->width, camera->height,
                                painter->source->drawing.space == SGS_SPACE_LINEAR);
    if (!done)
        return false;
    for (int k = 0; k < samples && done; ++k) {
        sgs_camera lens = *camera;
        sgs_pose place = *pose;
        lens_sample(k, 0, 0, &lens, &place);
        done = !sgs_renderer_render(renderer, &lens, &place, options, &painter->sampled);
        if (done)
            light_sum_add(&sum, &painter->sampled);
    }
    if (done)
        light_sum_mean(&sum, &painter->frame);
    light_sum_free(&sum);
    return done;
}

enum { AOV_OF_ROWS = AOV_PRIMITIVE | AOV_REGION | AOV_SLACK }; // refer to rows of the model

// The renderer of the model, or of its copy that shows a crop. NULL on failure. AOVs that refer to
// rows of the model are not cropped.
static sgs_renderer *renderer_for(view_painter *painter, const view_request *request, int aov)
{
    if (request->crop.preview == CROP_OFF || 1U << aov & AOV_OF_ROWS)
        return painter->source->renderer;
    return crop_preview_prepare(&painter->preview, &request->crop, painter->source)
               ? painter->preview.renderer
               : NULL;
}

bool view_painter_draw(view_painter *painter, const view_request *request, int width, int height,
                       int samples, sgs_progress_fn progress, void *user, painted_picture *picture)
{
    view_source *source = painter->source;
    const sgs_camera camera = width == request->camera.width && height == request->camera.height
                                  ? request->camera
                                  : sgs_camera_resized(&request->camera, width, height);
    sgs_render_options options = drawing_render_options(&source->drawing);
    options.progress = progress;
    options.progress_user = user;
    *picture = (painted_picture){0};
    sgs_renderer *renderer = renderer_for(painter, request, request->aov);
    if (!renderer)
        return false;
    picture->is_cropped = renderer == painter->preview.renderer;
    if (picture->is_cropped)
        picture->removed = painter->preview.removed;
    const unsigned aov = 1U << request->aov;
    if (!prepare_frame(&painter->frame, &painter->planes, width, height, aov_planes(aov)) ||
        sgs_renderer_render(renderer, &camera, &request->pose, &options, &painter->frame))
        return false;
    if (samples > 1 && aov == AOV_RGBA &&
        !draw_samples(painter, renderer, &camera, &request->pose, &options, samples))
        return false;
    picture_ranges ranges = {0};
    picture->range = prepare_ranges(request, &painter->frame, &ranges);
    frame_files files = files_of(painter, request, &camera, &ranges);
    files.aovs = aov;
    if (aov & (AOV_REGION | AOV_SLACK))
        files.regions = view_source_regions(source);
    return frame_aov_picture(&files, &painter->frame, request->aov, &picture->image);
}

void view_painter_free(view_painter *painter)
{
    sgs_frame_free(&painter->frame);
    sgs_frame_free(&painter->sampled);
    crop_preview_free(&painter->preview);
}

// ---- One pixel ----

static json_t *numbers_json(const float *values, int count)
{
    if (count == 1)
        return json_number((double)values[0]);
    json_t *array = json_array();
    for (int k = 0; k < count; ++k)
        json_array_append_new(array, json_number((double)values[k]));
    return array;
}

// The value of row k in a frame of one pixel.
static json_t *value_json(int k, const sgs_frame *frame, const region_map *regions)
{
    const aov_row *row = &aov_rows[k];
    const sgs_aov *source = sgs_aov_find(row->source);
    const uint32_t id = frame->primitive[0];
    const bool any = id < regions->count;
    float values[3];
    if (row->made == AOV_MADE_REGION)
        return any && regions->region[id] != SGS_NO_PRIMITIVE ? json_integer(regions->region[id])
                                                              : json_null();
    if (row->made == AOV_MADE_SLACK)
        return any ? json_number((double)regions->slack[id]) : json_null();
    if (!sgs_aov_plane(source, frame, 0))
        return json_null();
    if (source->type == SGS_AOV_TYPE_UINT)
        return id == SGS_NO_PRIMITIVE ? json_null() : json_integer(id);
    for (int c = 0; c < source->channels; ++c)
        values[c] = ((const float *)sgs_aov_plane(source, frame, c))[0];
    return numbers_json(values, source->channels);
}

// Renders all AOVs of a one-pixel camera, with the model (full or cropped) used for AOV `aov`. The
// number of candidates only if it is shown, because it requires a new BVH.
static bool render_pixel(view_painter *painter, const view_request *request,
                         const sgs_camera *pixel, int aov, sgs_frame *frame)
{
    const sgs_render_options options = drawing_render_options(&painter->source->drawing);
    sgs_renderer *renderer = renderer_for(painter, request, aov);
    const unsigned planes = request->aov == AOV_INDEX_CANDIDATES
                                ? SGS_AOVS_ALL
                                : SGS_AOVS_ALL & ~(unsigned)SGS_AOV_CANDIDATES;
    return renderer && !sgs_frame_create_with(1, 1, planes, frame) &&
           !sgs_renderer_render(renderer, pixel, &request->pose, &options, frame);
}

json_t *view_painter_probe(view_painter *painter, const view_request *request, int x, int y)
{
    view_source *source = painter->source;
    if (x >= request->camera.width || y >= request->camera.height)
        return NULL;
    sgs_camera pixel = sgs_camera_shifted(&request->camera, -x, -y);
    pixel.width = pixel.height = 1;
    const region_map *regions = view_source_regions(source);
    const bool crops = request->crop.preview != CROP_OFF;
    sgs_frame frame = {0}, cropped = {0};
    const bool done = render_pixel(painter, request, &pixel, AOV_INDEX_PRIMITIVE, &frame) &&
                      (!crops || render_pixel(painter, request, &pixel, AOV_INDEX_RGBA, &cropped));
    json_t *object = done ? json_pack("{s:s,s:i,s:i}", "type", "probe", "x", x, "y", y) : NULL;
    for (int k = 0; k < AOV_ROWS && done; ++k)
        json_object_set_new(
            object, aov_words[k],
            value_json(k, crops && !(1U << k & AOV_OF_ROWS) ? &cropped : &frame, regions));
    sgs_frame_free(&frame);
    sgs_frame_free(&cropped);
    return object;
}

// ---- EXR ----

bool view_painter_allows(const view_source *source, const sgs_camera *camera, size_t pixel_bytes)
{
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    return !source->picture_bytes || pixels * pixel_bytes <= source->picture_bytes;
}

bool view_painter_exr(view_painter *painter, const view_request *request, sgs_progress_fn progress,
                      void *user, char **path)
{
    view_source *source = painter->source;
    const bool has_regions = view_source_regions(source)->iteration != 0;
    sgs_render_options options = drawing_render_options(&source->drawing);
    sgs_frame frame = {0};
    char stem[40];
    const int n = free_number(source->folder, "view", "exr");
    *path = NULL;
    if (!n)
        return false;
    options.progress = progress;
    options.progress_user = user;
    sgs_frame_free(&painter->frame); // the memory is for one of the frames
    sgs_frame_free(&painter->sampled);
    snprintf(stem, sizeof stem, "view_%04d", n);
    *path = format_text("%s/%s.exr", source->folder, stem);
    frame_files files = files_of(painter, request, &request->camera, NULL);
    files.stem = stem;
    files.is_silent = true;
    files.regions = &source->regions;
    files.aovs = has_regions ? AOV_ALL : AOV_ALL & ~(unsigned)(AOV_REGION | AOV_SLACK);
    sgs_renderer *renderer = source->renderer;
    if (request->crop.preview == CROP_HIDE) { // rows of the copy are not those of the model
        files.aovs &= ~(unsigned)AOV_OF_ROWS;
        renderer = renderer_for(painter, request, AOV_INDEX_RGBA);
    }
    const bool done =
        renderer &&
        !sgs_frame_create_with(request->camera.width, request->camera.height, SGS_AOVS_ALL,
                               &frame) &&
        !sgs_renderer_render(renderer, &request->camera, &request->pose, &options, &frame) &&
        (!progress || progress(user, 1, 1)) && frame_write_exr(&files, &frame);
    sgs_frame_free(&frame);
    return done;
}
