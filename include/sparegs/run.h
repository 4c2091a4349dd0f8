// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads the folder of a training run (`sparegs train -o OUT`).
//
// Threads: all functions may be called from any thread at any time.

#include "sparegs/gaussians.h"
#include "sparegs/image.h"
#include "sparegs/render.h"

#ifdef __cplusplus
extern "C" {
#endif

// N of the folder name "iteration_N", 1 to 999 999 999; 0 for another name. Cannot fail.
SGS_API int sgs_run_iteration(const char *name);

// Path of the newest model, FOLDER/point_cloud/iteration_N/point_cloud.ply with the largest N.
// path [bytes]: written with terminator. *iteration: N; may be NULL. Fails with IO (no folder or no
// model in it) or LIMIT (path does not fit).
SGS_API sgs_status sgs_run_model_path(const char *folder, char *path, size_t bytes, int *iteration);

// Settings of a run that a rendering of its model depends on.
typedef struct sgs_run_settings {
    int iteration;           // of the newest model
    sgs_filter filter;       // for sgs_render_options
    double compact_box;      // for sgs_render_options
    float background[3];     // in the space of the model; 0 if training used a random background
    double near_distance;    // for sgs_render_options; world units
    sgs_model_colors colors; // of the model: --train-space and --white of the run
} sgs_run_settings;

// Reads the newest model and config.json of a run. What config.json lacks has the values of
// sgs_render_options_default(), and `colors` those of sgs_model_read_colors. The caller destroys
// *model; it may be NULL to read the settings only. Fails with IO, FORMAT, UNSUPPORTED, LIMIT or
// OUT_OF_MEMORY; *model is then NULL.
SGS_API sgs_status sgs_run_read(const char *folder, sgs_gaussians **model,
                                sgs_run_settings *settings);

#ifdef __cplusplus
}
#endif
