// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the viewer shows: a model, stored or copied from a training run, its cameras and photos,
// and the records of its run.
//
// Threads: the drawing thread holds `lock` while it uses model, renderer and regions. A training
// replaces the model by view_source_offer between two iterations, if the lock is free, and by
// view_source_replace after the last one.

#include <pthread.h>
#include <stdatomic.h>

#include "arguments/shared_options.h"
#include "cameras/camera_file.h"
#include "draw/region_map.h"
#include "run/region_file.h"

typedef struct view_source {
    pthread_mutex_t lock;
    sgs_gaussians *model; // owned
    sgs_renderer *renderer;
    atomic_int iteration;     // of the model; 0 for a file
    atomic_size_t count;      // of its primitives
    _Atomic uint64_t version; // counts the models
    region_map regions;       // of the model; made when requested
    bool regions_made;
    drawing_values drawing;       // how it is rendered
    atomic_bool wanted;           // a new copy is of use
    _Atomic double photo_seconds; // spent on photos, not yet charged to the drawing thread
    atomic_bool replacing;        // the last model follows; nobody else takes `lock`

    // Constant while the viewer serves.
    const char *name;       // of the model
    char *folder;           // of a run, or of the model file
    char *marks;            // options of `convert` that mark its file as a crop; NULL: none
    bool is_run;            // folder is a run folder
    bool expects_regions;   // updates with SPARE-GS will follow
    const sgs_scene *scene; // or NULL
    // The most memory for a picture or EXR file, and for a photo; 0 = no limit.
    size_t picture_bytes, photo_bytes;
    camera_list views; // those of the scene, or of the run's cameras.json
    // Of the first model: medians of the coordinates, and the widest range from the 10 % to the 90
    // % quantile.
    double center[3], extent;

    pthread_mutex_t history_lock;
    region_history history; // updates with SPARE-GS
} view_source;

// A renderer whose ray tables take at most VIEWER_RAY_BYTES, or one table: every field of view,
// size and lens that a page shows has its own. False after printing the error.
enum { VIEWER_RAY_BYTES = 64 << 20 };
bool view_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer);

// Zero-initialise, set drawing, name and scene, then open. model becomes owned. folder: of
// a run, whose regions and cameras are read, else NULL. False after printing the error; close in
// any case.
bool view_source_open(view_source *source, sgs_gaussians *model, const char *folder, int iteration);
void view_source_close(view_source *source);

// A copy of the model of a training run, if one is wanted and the render thread is not drawing.
// filter_3d: see sgs_trainer_filter_3d. True if the model was copied.
bool view_source_offer(view_source *source, const sgs_gaussians *model, const float *filter_3d,
                       int iteration);
// The last model will follow: the drawing thread abandons its work and starts no other before
// view_source_replace.
void view_source_expect_last(view_source *source);
// The same as view_source_offer for the last model: waits until the drawing thread has released the
// lock. False if no memory is left, or if a signal has requested a stop meanwhile.
bool view_source_replace(view_source *source, const sgs_gaussians *model, const float *filter_3d,
                         int iteration);
// Adds a structural update to the history.
void view_source_add_regions(view_source *source, const sgs_regions *update);
// The regions of the model; map->iteration is 0 without any. Call with `lock` held.
const region_map *view_source_regions(view_source *source);
// True if any update was recorded.
bool view_source_has_regions(view_source *source);
