// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes frames as EXR and PNG files.
//
// Colour. Models are trained on photos as stored, so model colours are display (sRGB) values
// and are blended as such. EXR files are expected to be scene-linear: the blended colour is
// unpremultiplied, decoded with the sRGB curve (extended above 1) and premultiplied again. `srgb`
// keeps the blended values. A model that was trained in linear light is the reverse: its blended
// colours are light, and `srgb` encodes them likewise; light above the white level is above 1.
//
// Deep samples are converted individually. If they are decoded, their sum exceeds the flat image,
// which is decoded after blending; if they are encoded, it is less. So the samples of a pixel are
// scaled by one factor per channel, at most 1 or at least 1, so that the flattened file equals the
// flat one. Samples stay positive and keep their proportions, so an object composited between them
// occludes correctly up to that factor. Without a conversion every partial sum is exact.
//
// Matrices. OpenEXR's standard attributes assume a left-handed camera with y up and z forward;
// COLMAP has y down, so worldToCamera is the pose with its second row negated. worldToNDC maps to
// (0,0) upper left, (1,1) lower right by the linear part of the lens (without distortion), with
// depth 1 - near / z. It is not written for fisheye lenses.

#include "draw/frame_files.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cameras/camera_export.h"
#include "cameras/lens_scale.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "draw/colormap.h"
#include "sparegs/aov_descriptors.h"
#include "sparegs/metrics.h"

#define DEPTHS(kind)                                                                               \
    "depth.Z: mean distance of the hits " kind                                                     \
    ", weighted by their blending weights, scene units; "                                          \
    "depth_median.Z: distance of the hit that takes the transmittance to 0.5; depth_first.Z: "     \
    "distance of the first "                                                                       \
    "hit; 0 where there is none"

static const char ray_depth[] = DEPTHS("along the unit ray from the camera centre");
static const char axis_depth[] =
    DEPTHS("as camera-space Z (distance from the camera plane, not along the ray)");

static const char deep_ray_depth[] =
    "Z, ZBack: first and last hit of a sample, along the unit ray from the camera "
    "centre, scene units";
static const char deep_axis_depth[] =
    "Z, ZBack: first and last hit of a sample, camera-space Z (distance from the camera plane, "
    "not along the ray), scene units";

static const char flat_suffix[] = ".exr", deep_suffix[] = ".deep.exr";

// The value of a model colour in the file's encoding.
static float encoded_color(const frame_files *files, float value)
{
    const bool is_light = files->space == SGS_SPACE_LINEAR;
    if (files->encoding == EXR_SRGB)
        return is_light ? sgs_srgb_encode(value) : value;
    return files->white_point * (is_light ? value : sgs_srgb_decode(value));
}

// True if files hold the model's display values, which encoded_color does not change.
static bool keeps_colors(const frame_files *files)
{
    return files->encoding == EXR_SRGB && files->space != SGS_SPACE_LINEAR;
}

static void encode_colors(const frame_files *files, sgs_frame *frame)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    for (size_t i = 0; i < pixels; ++i) {
        const float alpha = 1 - frame->transmittance[i];
        for (int c = 0; c < 3; ++c) {
            float *value = &frame->color[c][i];
            *value = alpha > 0 ? alpha * encoded_color(files, *value / alpha) : 0;
        }
    }
}

sgs_camera camera_with_border(const sgs_camera *camera, int pixels)
{
    sgs_camera out = sgs_camera_shifted(camera, pixels, pixels);
    out.width += 2 * pixels;
    out.height += 2 * pixels;
    return out;
}

// Larger values would become infinite.
static void limit_to_half(sgs_frame *frame)
{
    const float most = 65504;
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    for (int c = 0; c < 3; ++c)
        for (size_t i = 0; i < pixels; ++i)
            frame->color[c][i] = fminf(frame->color[c][i], most);
}

static void camera_matrices(const sgs_camera *camera, const sgs_pose *pose, double to_camera[16],
                            double near_distance, double to_ndc[16])
{
    double fx, fy, cx, cy, rows[3][4];
    camera_paraxial(camera, &fx, &fy, &cx, &cy);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j) {
            rows[i][j] = j < 3 ? pose->rotation[3 * i + j] : pose->translation[i];
            to_camera[4 * i + j] = i == 1 ? -rows[i][j] : rows[i][j];
        }
    for (int j = 0; j < 4; ++j) {
        to_camera[12 + j] = j == 3;
        to_ndc[j] = (fx * rows[0][j] + cx * rows[2][j]) / camera->width;
        to_ndc[4 + j] = (fy * rows[1][j] + cy * rows[2][j]) / camera->height;
        to_ndc[8 + j] = rows[2][j] - (j == 3 ? near_distance : 0);
        to_ndc[12 + j] = rows[2][j];
    }
}

// Planes of a file that are derived from the frame's planes.
typedef struct made_planes {
    float *alpha, *slack;
    uint32_t *region;
    uint32_t *counts[AOV_ROWS]; // whole numbers, for rows with such a source
} made_planes;

static void free_planes(made_planes *planes)
{
    free(planes->alpha);
    free(planes->slack);
    free(planes->region);
    for (int k = 0; k < AOV_ROWS; ++k)
        free(planes->counts[k]);
}

// Creates the planes of region ids and slack of the primitive that contributes most. Planes that
// are not requested stay NULL. False after printing the error.
static bool make_regions(const frame_files *files, const sgs_frame *frame, unsigned aovs,
                         made_planes *planes)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    if (!(aovs & (AOV_REGION | AOV_SLACK)))
        return true;
    planes->region = malloc(pixels * sizeof *planes->region);
    planes->slack = malloc(pixels * sizeof *planes->slack);
    if (!planes->region || !planes->slack) {
        fail_run("%s: not enough memory for the region planes", files->name);
        return false;
    }
    for (size_t i = 0; i < pixels; ++i) {
        const uint32_t primitive = frame->primitive[i];
        const bool any = primitive < files->regions->count;
        planes->region[i] = any ? files->regions->region[primitive] : SGS_NO_PRIMITIVE;
        planes->slack[i] = any ? files->regions->slack[primitive] : 0;
    }
    return true;
}

// Whole numbers of the requested rows. False if out of memory.
static bool make_counts(unsigned aovs, const sgs_frame *frame, made_planes *planes)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    for (int k = 0; k < AOV_ROWS; ++k) {
        const sgs_aov *source = sgs_aov_find(aov_rows[k].source);
        if (!(aovs >> k & 1) || source->type != SGS_AOV_TYPE_COUNT)
            continue;
        const float *from = sgs_aov_plane(source, frame, 0);
        uint32_t *to = planes->counts[k] = malloc(pixels * sizeof *to);
        if (!to)
            return false;
        for (size_t i = 0; i < pixels; ++i)
            to[i] = (uint32_t)(from[i] + 0.5F);
    }
    return true;
}

static bool make_planes(const frame_files *files, const sgs_frame *frame, made_planes *planes)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    *planes = (made_planes){.alpha = malloc(pixels * sizeof *planes->alpha)};
    if (!planes->alpha || !make_counts(files->aovs, frame, planes)) {
        fail_run("%s: not enough memory to write it", files->name);
        return false;
    }
    for (size_t i = 0; i < pixels; ++i)
        planes->alpha[i] = 1 - frame->transmittance[i];
    return make_regions(files, frame, files->aovs, planes);
}

double frame_writing_bytes(unsigned aovs, sgs_space space, bool exr, bool pictures)
{
    const double regions = aovs & (AOV_REGION | AOV_SLACK) ? sizeof(uint32_t) + sizeof(float) : 0;
    double planes = sizeof(float) + regions; // with the alpha plane
    for (int k = 0; k < AOV_ROWS; ++k)
        if (aovs >> k & 1 && sgs_aov_find(aov_rows[k].source)->type == SGS_AOV_TYPE_COUNT)
            planes += sizeof(uint32_t);
    const double display = space == SGS_SPACE_LINEAR ? 3 * sizeof(float) : 0;
    return (exr ? planes : 0) + (pictures ? 3 + fmax(regions, display) : 0);
}

// Channel c of row k in an EXR.
static sgs_exr_channel channel_of(int k, int c, bool half, const sgs_frame *frame,
                                  const made_planes *made)
{
    const aov_row *row = &aov_rows[k];
    const sgs_aov *source = sgs_aov_find(row->source);
    sgs_exr_channel channel = {.name = row->channels[c], .half = half && row->half};
    if (row->made == AOV_MADE_REGION)
        channel.uints = made->region;
    else if (row->made == AOV_MADE_SLACK)
        channel.floats = made->slack;
    else if (c == source->channels)
        channel.floats = made->alpha;
    else if (source->type == SGS_AOV_TYPE_COUNT)
        channel.uints = made->counts[k];
    else if (source->type == SGS_AOV_TYPE_UINT)
        channel.uints = sgs_aov_plane(source, frame, c);
    else
        channel.floats = sgs_aov_plane(source, frame, c);
    return channel;
}

// The channels of an EXR file, at most EXR_CHANNELS.
enum { EXR_CHANNELS = 4 * AOV_ROWS };

static int list_channels(const frame_files *files, const sgs_frame *frame, const made_planes *made,
                         sgs_exr_channel *channels)
{
    int count = 0;
    for (int k = 0; k < AOV_ROWS; ++k)
        for (int c = 0; files->aovs >> k & 1 && aov_rows[k].channels[c]; ++c)
            channels[count++] = channel_of(k, c, files->half, frame, made);
    return count;
}

// Fills the header attributes; `matrices` holds the matrices.
typedef struct view_matrices {
    double to_camera[16], to_ndc[16], intrinsics[4];
} view_matrices;

static sgs_exr_info describe(const frame_files *files, bool any_depth, bool any_color,
                             view_matrices *matrices)
{
    // Of the display window.
    const sgs_camera shown = camera_with_border(files->camera, -files->overscan);
    camera_matrices(&shown, files->pose, matrices->to_camera, files->near_distance,
                    matrices->to_ndc);
    double *k = matrices->intrinsics;
    camera_paraxial(&shown, &k[0], &k[1], &k[2], &k[3]);
    const sgs_camera whole =
        sgs_camera_equirectangular(files->camera->width, files->camera->height);
    // Readers map the data window to the whole sphere.
    const bool is_latlong = sgs_camera_equal(files->camera, &whole);
    return (sgs_exr_info){.width = files->camera->width,
                          .height = files->camera->height,
                          .world_to_camera = matrices->to_camera,
                          .world_to_ndc =
                              sgs_camera_is_fisheye(files->camera->model) ? NULL : matrices->to_ndc,
                          .intrinsics = camera_is_perspective(files->camera) ? k : NULL,
                          .is_latlong = is_latlong,
                          .depth_definition = !any_depth          ? NULL
                                              : files->axis_depth ? axis_depth
                                                                  : ray_depth,
                          .view_name = files->name,
                          .compression = files->compression,
                          .frame_rate = files->frame_rate,
                          .overscan = files->overscan,
                          .color_space = !any_color                    ? NULL
                                         : files->encoding == EXR_SRGB ? SGS_COLOR_SRGB
                                                                       : SGS_COLOR_LINEAR};
}

static bool write_exr(const frame_files *files, const char *path, const sgs_frame *frame,
                      const made_planes *made)
{
    sgs_exr_channel channels[EXR_CHANNELS];
    view_matrices matrices;
    const bool any_depth = files->aovs & (AOV_DEPTH | AOV_DEPTH_MEDIAN | AOV_DEPTH_FIRST);
    const sgs_exr_info info = describe(files, any_depth, files->aovs & AOV_RGBA, &matrices);
    if (!make_folder_of(path))
        return false;
    if (sgs_exr_write(path, &info, channels, list_channels(files, frame, made, channels))) {
        fail_library();
        return false;
    }
    if (!files->is_silent)
        report_file(path);
    return true;
}

bool frame_write_exr(const frame_files *files, sgs_frame *frame)
{
    made_planes made;
    char *path = format_text("%s/%s%s", files->folder, files->stem, flat_suffix);
    bool written = make_planes(files, frame, &made);
    if (written && !keeps_colors(files) && files->aovs & AOV_RGBA)
        encode_colors(files, frame);
    if (written && files->half && files->aovs & AOV_RGBA)
        limit_to_half(frame);
    written = written && write_exr(files, path, frame, &made);
    free(path);
    free_planes(&made);
    return written;
}

// ---- Deep files ----

struct deep_file {
    const frame_files *files;
    const sgs_frame *frame;
    sgs_exr_deep *exr;
    char *path;
    sgs_deep_sample *samples; // of a band
    size_t capacity;
    bool failed; // and the error is printed
};

deep_file *deep_file_open(const frame_files *files, const sgs_frame *frame, int max_samples)
{
    deep_file *file = calloc(1, sizeof *file);
    if (!file) {
        fail_run("%s: not enough memory to write it", files->name);
        return NULL;
    }
    view_matrices matrices;
    sgs_exr_info info = describe(files, true, true, &matrices);
    info.depth_definition = files->axis_depth ? deep_axis_depth : deep_ray_depth;
    info.deep_half = files->half;
    *file = (deep_file){.files = files,
                        .frame = frame,
                        .path = format_text("%s/%s%s", files->folder, files->stem, deep_suffix)};
    if (make_folder_of(file->path)) {
        if (!sgs_exr_deep_open(file->path, &info, max_samples, &file->exr))
            return file;
        fail_library();
    }
    free(file->path);
    free(file);
    return NULL;
}

// See the top of this file.
static void encode_samples(const frame_files *files, sgs_deep_sample *samples, size_t count,
                           const float flat[3], float alpha)
{
    for (int c = 0; c < 3; ++c) {
        double sum = 0, through = 1;
        for (size_t k = 0; k < count; ++k) {
            float *value = &samples[k].color[c];
            *value = samples[k].alpha > 0
                         ? samples[k].alpha * encoded_color(files, *value / samples[k].alpha)
                         : 0;
            sum += through * (double)*value;
            through *= 1 - (double)samples[k].alpha;
        }
        const double wanted =
            alpha > 0 ? (double)(alpha * encoded_color(files, flat[c] / alpha)) : 0;
        const float scale = sum > 0 ? (float)(wanted / sum) : 0;
        for (size_t k = 0; k < count; ++k)
            samples[k].color[c] *= scale;
    }
}

bool deep_file_failed(const deep_file *file)
{
    return file->failed;
}

sgs_status deep_file_rows(void *context, int y, int rows, const uint32_t *counts,
                          const sgs_deep_sample *samples)
{
    deep_file *file = context;
    const sgs_frame *frame = file->frame;
    const size_t width = (size_t)frame->width, pixels = width * (size_t)rows,
                 first = width * (size_t)y;
    if (keeps_colors(file->files))
        return sgs_exr_deep_write(file->exr, rows, counts, samples);
    size_t total = 0;
    for (size_t i = 0; i < pixels; ++i)
        total += counts[i];
    if (total > file->capacity) {
        free(file->samples);
        file->samples = malloc(total * sizeof *file->samples);
        file->capacity = file->samples ? total : 0;
        if (!file->samples) {
            fail_run("not enough memory for the samples of %d rows", rows);
            file->failed = true;
            return SGS_STATUS_OUT_OF_MEMORY;
        }
    }
    if (total)
        memcpy(file->samples, samples, total * sizeof *samples);
    sgs_deep_sample *at = file->samples;
    for (size_t i = 0; i < pixels; at += counts[i++]) {
        const float flat[3] = {frame->color[0][first + i], frame->color[1][first + i],
                               frame->color[2][first + i]};
        encode_samples(file->files, at, counts[i], flat, 1 - frame->transmittance[first + i]);
    }
    return sgs_exr_deep_write(file->exr, rows, counts, file->samples);
}

bool deep_file_close(deep_file *file, bool complete)
{
    bool written = complete;
    if (!complete)
        sgs_exr_deep_abort(file->exr);
    else if (sgs_exr_deep_close(file->exr)) {
        fail_library();
        written = false;
    } else {
        report_file(file->path);
    }
    free(file->samples);
    free(file->path);
    free(file);
    return written;
}

// ---- PNG ----

// Writes an image and releases it. description: NULL for none.
static bool write_image(const frame_files *files, const char *suffix, const char *description,
                        sgs_image8 *image)
{
    char *path = format_text("%s/%s%s", files->folder, files->stem, suffix);
    bool written = make_folder_of(path);
    if (written && sgs_png_write_described(path, image, description)) {
        fail_library();
        written = false;
    }
    if (written)
        report_file(path);
    sgs_image8_free(image);
    free(path);
    return written;
}

bool frame_picture(const frame_files *files, const sgs_frame *frame, sgs_image8 *image)
{
    if (files->space != SGS_SPACE_LINEAR) {
        if (!sgs_image8_from_planes((const float *const *)frame->color, frame->transmittance,
                                    files->background, frame->width, frame->height, image))
            return true;
        fail_library();
        return false;
    }
    // Composite scene-linear values over the background first, then display-encode.
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    float *display = malloc(3 * pixels * sizeof *display);
    if (!display) {
        fail_run("%s: not enough memory to write it", files->name);
        return false;
    }
    for (size_t c = 0; c < 3; ++c)
        for (size_t i = 0; i < pixels; ++i)
            display[c * pixels + i] = sgs_srgb_encode(
                frame->color[c][i] + frame->transmittance[i] * files->background[c]);
    const float *const planes[3] = {display, display + pixels, display + 2 * pixels};
    const bool made = !sgs_image8_from_planes(planes, NULL, files->background, frame->width,
                                              frame->height, image);
    free(display);
    if (!made)
        fail_library();
    return made;
}

// The picture of a row that is not a colour image. False if out of memory.
static bool draw_row(const frame_files *files, const sgs_frame *frame, const made_planes *made,
                     int k, sgs_image8 *image)
{
    const aov_row *row = &aov_rows[k];
    const sgs_aov *source = sgs_aov_find(row->source);
    const int width = frame->width, height = frame->height;
    const void *first = sgs_aov_plane(source, frame, 0);
    const float *planes[3] = {NULL};
    for (int c = 0; c < source->channels && source->type != SGS_AOV_TYPE_UINT; ++c)
        planes[c] = sgs_aov_plane(source, frame, c);
    const uint32_t *ids = row->made == AOV_MADE_REGION ? made->region : first;
    switch (row->picture) {
    case AOV_PICTURE_COLOR:
        break;
    case AOV_PICTURE_GREY:
        return plane_grey(planes[0], width, height, image);
    case AOV_PICTURE_RAMP:
        return plane_colored(planes[0], width, height, files->ranges->of[k][0], image);
    case AOV_PICTURE_NORMALS:
        return normals_colored(planes, width, height, image);
    case AOV_PICTURE_POSITIONS:
        return positions_colored(planes, files->ranges->of[k], width, height, image);
    case AOV_PICTURE_IDS:
        return ids_colored(ids, width, height, image);
    case AOV_PICTURE_SLACK:
        return slack_colored(made->slack, made->region, width, height, image);
    }
    return false;
}

bool frame_aov_picture(const frame_files *files, const sgs_frame *frame, int k, sgs_image8 *image)
{
    if (aov_rows[k].picture == AOV_PICTURE_COLOR)
        return frame_picture(files, frame, image);
    made_planes made = {0};
    const bool ready = make_regions(files, frame, 1U << k, &made);
    const bool drawn = ready && draw_row(files, frame, &made, k, image);
    if (ready && !drawn)
        fail_run("%s: not enough memory to write it", files->name);
    free_planes(&made);
    return drawn;
}

// The ending of the picture of row k.
enum { SUFFIX_LENGTH = 40 };
static void picture_suffix(int k, char suffix[SUFFIX_LENGTH])
{
    if (aov_rows[k].picture == AOV_PICTURE_COLOR)
        snprintf(suffix, SUFFIX_LENGTH, ".png");
    else
        snprintf(suffix, SUFFIX_LENGTH, ".%s.png", aov_words[k]);
}

// Writes the picture of a row. The description of a ramp holds its range.
static bool write_quantity(const frame_files *files, const sgs_frame *frame, int k)
{
    sgs_image8 image = {0};
    if (!frame_aov_picture(files, frame, k, &image))
        return false;
    const value_range range = files->ranges->of[k][0];
    char suffix[SUFFIX_LENGTH], description[120];
    picture_suffix(k, suffix);
    snprintf(description, sizeof description,
             "%s: colours from dark to light represent %.9g to %.9g", aov_words[k],
             (double)range.low, (double)range.high);
    return write_image(files, suffix, aov_rows[k].picture == AOV_PICTURE_RAMP ? description : NULL,
                       &image);
}

bool frame_write_png(const frame_files *files, const sgs_frame *frame)
{
    bool written = true;
    for (int k = 0; k < AOV_ROWS && written; ++k)
        if (files->aovs >> k & 1)
            written = write_quantity(files, frame, k);
    return written;
}

// ---- Files of an earlier command ----

static bool visit_file(const char *folder, const char *stem, const char *suffix,
                       frame_files_fn visit, void *context)
{
    char *path = format_text("%s/%s%s", folder, stem, suffix);
    const bool continues = visit(path, context);
    free(path);
    return continues;
}

bool frame_files_each(const char *folder, const char *stem, unsigned aovs, bool png, bool deep,
                      frame_files_fn visit, void *context)
{
    bool continues = (png || visit_file(folder, stem, flat_suffix, visit, context)) &&
                     (!deep || visit_file(folder, stem, deep_suffix, visit, context));
    for (int k = 0; k < AOV_ROWS && continues && png; ++k) {
        char suffix[SUFFIX_LENGTH];
        picture_suffix(k, suffix);
        continues = !(aovs >> k & 1) || visit_file(folder, stem, suffix, visit, context);
    }
    return continues;
}

// A frame_files_fn. False for an empty file, which a full disk or another program may leave.
static bool has_file(const char *path, void *context)
{
    (void)context;
    struct stat info;
    return !stat(path, &info) && S_ISREG(info.st_mode) && info.st_size > 0;
}

bool frame_files_exist(const char *folder, const char *stem, unsigned aovs, bool png, bool deep)
{
    return frame_files_each(folder, stem, aovs, png, deep, has_file, NULL);
}
