// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Draws what a page requests: pictures, the values at a pixel, the primitives along a ray, and EXR
// files. All functions require the source's lock and return false after an error that
// sgs_last_error describes.

#include "viewer/view_crop.h"
#include "viewer/view_message.h"
#include "viewer/view_source.h"

typedef struct view_painter {
    view_source *source;
    sgs_frame frame, sampled;
    unsigned planes; // of the frame
    crop_preview preview;
} view_painter;

// Memory per pixel of a picture with samples, and of an EXR file with all AOVs: planes, and what
// encoding takes.
enum { PICTURE_PIXEL_BYTES = 72, EXR_PIXEL_BYTES = 150 };

typedef struct painted_picture {
    sgs_image8 image;
    value_range range; // of a ramp
    bool is_cropped;   // shows the crop of the request
    size_t removed;    // primitives that the crop rejects
} painted_picture;

// Draws the request at a size of width x height pixels, which shows the same field of view, with
// `samples` samples per pixel. `progress` may cancel; see sgs_render_options. Release the image
// with sgs_image8_free.
bool view_painter_draw(view_painter *painter, const view_request *request, int width, int height,
                       int samples, sgs_progress_fn progress, void *user, painted_picture *picture);

// The AOVs at pixel (x, y) of the request, as its pictures show them, with its crop: {"x", "y",
// "color", "depth", ..., "position"}. NULL on failure.
json_t *view_painter_probe(view_painter *painter, const view_request *request, int x, int y);

// True if the memory for such a picture, or EXR file, is within that of the source.
bool view_painter_allows(const view_source *source, const sgs_camera *camera, size_t pixel_bytes);

// Writes all AOVs of the request as FOLDER/view_N.exr for the first free N; *path receives the
// path, release it with free(). *path is NULL after printing the error that no N is free.
// `progress` may cancel until the file is opened; then no file is left.
bool view_painter_exr(view_painter *painter, const view_request *request, sgs_progress_fn progress,
                      void *user, char **path);

void view_painter_free(view_painter *painter);
