// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Frames on disk.
//
// Colours. Training compares with photographs as they are stored, so a trained colour is a display (sRGB) value and
// blending happens between display values. An EXR is expected to be scene-linear: the blended colour is freed of its
// alpha, decoded by the sRGB curve (continued above 1) and multiplied by alpha again. `srgb` leaves the values as they
// were blended.
//
// Matrices. OpenEXR's standard attributes speak of a left-handed camera with y up and z forward; COLMAP's has y down,
// so worldToCamera is the pose with its second row negated. worldToNDC maps to (0,0) upper left, (1,1) lower right by
// the linear part of the lens (no distortion), with depth 1 - near / z; a fisheye lens has no such matrix and none is
// written.

#include "frame_files.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "colormap.h"
#include "output.h"
#include "progress.h"
#include "sparegs/metrics.h"

static const char depth_definition[] = "depth.Z: mean distance of the hits along the unit ray from the camera centre, "
                                       "weighted by their contribution, world "
                                       "units; depth_median.Z: distance of the hit that takes the transmittance to "
                                       "0.5; depth_first.Z: distance of the first "
                                       "hit; 0 where there is none";

static float srgb_to_linear(float value)
{
    return value <= 0.04045F ? value / 12.92F : powf((value + 0.055F) / 1.055F, 2.4F);
}

static void linearise(sgs_frame *frame)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    for (size_t i = 0; i < pixels; ++i) {
        const float alpha = 1 - frame->transmittance[i];
        for (int c = 0; c < 3; ++c) {
            float *value = &frame->color[c][i];
            *value = alpha > 0 ? alpha * srgb_to_linear(*value / alpha) : 0;
        }
    }
}

static void camera_matrices(const sgs_camera *camera, const sgs_pose *pose, double to_camera[16], double to_ndc[16])
{
    double fx, fy, cx, cy, rows[3][4];
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 4; ++j) {
            rows[i][j] = j < 3 ? pose->rotation[3 * i + j] : pose->translation[i];
            to_camera[4 * i + j] = i == 1 ? -rows[i][j] : rows[i][j];
        }
    const double near_distance = sgs_render_options_default().near_distance;
    for (int j = 0; j < 4; ++j) {
        to_camera[12 + j] = j == 3;
        to_ndc[j] = (fx * rows[0][j] + cx * rows[2][j]) / camera->width;
        to_ndc[4 + j] = (fy * rows[1][j] + cy * rows[2][j]) / camera->height;
        to_ndc[8 + j] = rows[2][j] - (j == 3 ? near_distance : 0);
        to_ndc[12 + j] = rows[2][j];
    }
}

bool frame_write_exr(const frame_files *files, sgs_frame *frame)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    float *alpha = malloc(pixels * sizeof *alpha);
    uint32_t *hits = malloc(pixels * sizeof *hits);
    char *path = view_path(files->folder, files->name, ".exr");
    bool written = alpha && hits;
    if (!written)
        fail_run("%s: no memory to write it", path);
    for (size_t i = 0; i < pixels && written; ++i) {
        alpha[i] = 1 - frame->transmittance[i];
        hits[i] = (uint32_t)(frame->hits[i] + 0.5F);
    }
    if (files->encoding == EXR_LINEAR && written)
        linearise(frame);
    sgs_exr_channel channels[9];
    int count = 0;
    if (files->aovs & AOV_RGBA) {
        channels[count++] = (sgs_exr_channel){.name = "R", .floats = frame->color[0]};
        channels[count++] = (sgs_exr_channel){.name = "G", .floats = frame->color[1]};
        channels[count++] = (sgs_exr_channel){.name = "B", .floats = frame->color[2]};
        channels[count++] = (sgs_exr_channel){.name = "A", .floats = alpha};
    }
    if (files->aovs & AOV_DEPTH)
        channels[count++] = (sgs_exr_channel){.name = "depth.Z", .floats = frame->depth_mean};
    if (files->aovs & AOV_DEPTH_MEDIAN)
        channels[count++] = (sgs_exr_channel){.name = "depth_median.Z", .floats = frame->depth_median};
    if (files->aovs & AOV_DEPTH_FIRST)
        channels[count++] = (sgs_exr_channel){.name = "depth_first.Z", .floats = frame->depth_first};
    if (files->aovs & AOV_TRANSMITTANCE)
        channels[count++] = (sgs_exr_channel){.name = "transmittance.T", .floats = frame->transmittance};
    if (files->aovs & AOV_HITS)
        channels[count++] = (sgs_exr_channel){.name = "hits.count", .uints = hits};
    double to_camera[16], to_ndc[16];
    camera_matrices(files->camera, files->pose, to_camera, to_ndc);
    const bool any_depth = files->aovs & (AOV_DEPTH | AOV_DEPTH_MEDIAN | AOV_DEPTH_FIRST);
    const sgs_exr_info info = {.width = frame->width,
                               .height = frame->height,
                               .world_to_camera = to_camera,
                               .world_to_ndc = sgs_camera_is_fisheye(files->camera->model) ? NULL : to_ndc,
                               .depth_definition = any_depth ? depth_definition : NULL,
                               .view_name = files->name};
    written = written && make_folder_of(path);
    if (written && sgs_exr_write(path, &info, channels, count)) {
        fail_library();
        written = false;
    }
    if (written)
        puts(path);
    free(path);
    free(alpha);
    free(hits);
    return written;
}

// Writes and frees one image.
static bool write_image(const frame_files *files, const char *suffix, sgs_image8 *image)
{
    char *path = view_path(files->folder, files->name, suffix);
    bool written = make_folder_of(path);
    if (written && sgs_png_write(path, image)) {
        fail_library();
        written = false;
    }
    if (written)
        puts(path);
    sgs_image8_free(image);
    free(path);
    return written;
}

bool frame_write_png(const frame_files *files, const sgs_frame *frame)
{
    const struct {
        unsigned bit;
        const char *suffix;
        const float *plane;
    } planes[] = {{AOV_DEPTH, ".depth.png", frame->depth_mean},
                  {AOV_DEPTH_MEDIAN, ".depth_median.png", frame->depth_median},
                  {AOV_DEPTH_FIRST, ".depth_first.png", frame->depth_first},
                  {AOV_TRANSMITTANCE, ".transmittance.png", frame->transmittance},
                  {AOV_HITS, ".hits.png", frame->hits}};
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    sgs_image8 image = {0};
    if (files->aovs & AOV_RGBA) {
        if (sgs_image8_from_planes((const float *const *)frame->color, frame->transmittance, files->background,
                                   frame->width, frame->height, &image)) {
            fail_library();
            return false;
        }
        if (!write_image(files, ".png", &image))
            return false;
    }
    for (size_t k = 0; k < sizeof planes / sizeof *planes; ++k) {
        if (!(files->aovs & planes[k].bit))
            continue;
        const value_range range = plane_range(planes[k].plane, pixels);
        const bool made = planes[k].bit == AOV_TRANSMITTANCE
                              ? plane_grey(planes[k].plane, frame->width, frame->height, &image)
                              : plane_colored(planes[k].plane, frame->width, frame->height, range, &image);
        if (!made) {
            fail_run("%s: no memory to write it", files->name);
            return false;
        }
        if (!write_image(files, planes[k].suffix, &image))
            return false;
        if (planes[k].bit != AOV_TRANSMITTANCE)
            print_note("%s%s: dark to light is %g to %g", files->name, planes[k].suffix, (double)range.low,
                       (double)range.high);
    }
    return true;
}
