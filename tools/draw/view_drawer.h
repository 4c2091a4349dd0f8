// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One view after another: rendered (or traced by brute force), written as files, added to a film. A
// view is written while the next one is drawn.

#include "cli/async_task.h"
#include "cameras/camera_file.h"
#include "draw/frame_files.h"
#include "cli/shared_options.h"
#include "draw/video.h"

typedef struct view_options {
    const char *folder; // NULL = no files
    unsigned aovs;
    const region_map *regions; // for AOV_REGION and AOV_SLACK
    bool axis_depth, png, reference;
    exr_encoding encoding;
    sgs_exr_compression compression;
    bool deep;
    sgs_deep_options deep_options;
    int samples;            // pictures that make one, 1 = the centre of the pixel
    double aperture, focus; // world units; focus 0 = what stands in the middle
    const char *film;       // or NULL
    double fps;
} view_options;

typedef struct view_drawer {
    const view_options *options;
    const drawing_values *drawing;
    const sgs_gaussians *model;
    sgs_renderer *renderer; // NULL with a reference
    double *params;         // with a reference
    sgs_frame
        frames[2]; // one is drawn while the other is written; kept for further views of their size
    sgs_frame *frame;    // the one that is drawn
    sgs_frame sampled;   // one sample of it
    frame_files files;   // of the view that is written,
    sgs_frame *finished; // its frame, and what does so
    background writing;
    video *film;
    size_t drawn;
    double draw_seconds, write_seconds;
} view_drawer;

// The model must outlive the drawer, which must not move. False after printing the error; release
// it with view_drawer_close in any case.
bool view_drawer_open(view_drawer *drawer, const view_options *options,
                      const drawing_values *drawing, const sgs_gaussians *model);
// The view must last until the next call. False after printing the error of this view or the one
// before.
bool view_drawer_draw(view_drawer *drawer, const named_camera *view);
// Waits for the last view and ends the film; `complete`: all views were drawn. False after printing
// the error.
bool view_drawer_close(view_drawer *drawer, bool complete);
