// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Renders views (with the tracer or by brute force), writes their files and appends them to a
// video. A view is written while the next one is rendered.

#include "processes/async_task.h"
#include "cameras/camera_file.h"
#include "draw/frame_files.h"
#include "arguments/shared_options.h"
#include "draw/video.h"

typedef struct view_options {
    const char *folder; // NULL = no files
    unsigned aovs;
    const region_map *regions; // for AOV_REGION and AOV_SLACK
    bool axis_depth, png, reference;
    value_range depth_range; // of PNG files; {0, 0} = measured
    exr_encoding encoding;
    sgs_exr_compression compression;
    bool half; // EXR files: half floats where aov_row.half, and for the colours of deep files
    bool deep;
    sgs_deep_options deep_options;
    int samples;            // samples per pixel; 1 = the pixel centre
    double aperture, focus; // world units; focus 0 = surface at the image centre
    const char *film;       // or NULL
    double fps;             // of `film`
    double frame_rate;      // recorded in EXR files, 0 = none
    int overscan;           // pixels around the views; EXR only
} view_options;

typedef struct view_drawer {
    const view_options *options;
    const drawing_values *drawing;
    const sgs_gaussians *model;
    sgs_renderer *renderer; // NULL with a reference
    double *params;         // with a reference
    sgs_frame
        frames[2]; // one is rendered while the other is written; reused for views of the same size
    sgs_camera cameras[2]; // of these frames, with the overscan
    sgs_frame *frame;      // the frame being rendered
    sgs_frame sampled;     // one sample of it
    picture_ranges ranges;
    frame_files files;   // of the view being written
    sgs_frame *finished; // the frame being written
    async_task writing;
    video *film;
    double film_aspect;   // of its pixels, width over height
    size_t frame_bytes;   // of a frame of the video
    unsigned char *round; // rank 0: [round_views][frame_bytes], the frames of the ranks
    size_t round_views;
    bool filmed;    // the video is complete
    bool cancelled; // a signal ended the rendering of a view, which is not written
    size_t drawn, skipped;
    double draw_seconds, write_seconds;
} view_drawer;

// The model must outlive the drawer, and the drawer must not move. False after printing the error;
// call view_drawer_close in either case.
bool view_drawer_open(view_drawer *drawer, const view_options *options,
                      const drawing_values *drawing, const sgs_gaussians *model);
// Checks that the frames fit in the memory, and the sizes of those of a video; measures the ranges
// of PNG files over all views and reports them. Call it before the first view. False after printing
// the error. Without ranks, a signal cancels this and the next function.
bool view_drawer_prepare(view_drawer *drawer, const camera_list *views);
// Removes the views whose files all exist on rank 0 from the list. Collective; false on all ranks
// if one fails.
bool view_drawer_skip_existing(view_drawer *drawer, camera_list *views);
// The view must stay valid until the next call. False after printing the error of this view or of
// the previous one.
bool view_drawer_draw(view_drawer *drawer, const named_camera *view);
// For a video on ranks: a round of `views` views, one per rank. Draws `view` of this rank, NULL if
// it has none, and sends the frames to rank 0, which encodes them during the next round. Rank 0
// holds two frames of each rank. Collective; false on all ranks if one fails.
bool view_drawer_draw_round(view_drawer *drawer, const named_camera *view, size_t views);
// Waits until the last view is written. Call it before view_drawer_close. False after printing the
// error.
bool view_drawer_finish(view_drawer *drawer);
// Closes the video, which is discarded if `complete` is false. False after printing the error.
bool view_drawer_close(view_drawer *drawer, bool complete);
