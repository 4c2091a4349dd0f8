// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Scores per primitive from whole views, for pipelines with score_views: some random training views
// are rendered, compared with their photos and traversed again for sums per primitive, from
// which the pipeline computes its scores.

#include "density/density.h"
#include "density/pipeline.h"
#include "train/train_view.h"

// Columns of the rows of all ranks; NULL with one process.
typedef struct sgsi_score_columns {
    float *gradient, *opacity, *volume, *depth, *radius, *sums;
    uint8_t *touched;
} sgsi_score_columns;

// Scores and the memory to compute them; arrays of `capacity` primitives.
typedef struct sgsi_view_scores {
    size_t capacity, whole_capacity;
    float *importance, *prune_score; // [whole_capacity]: the result
    float *gradient, *opacity, *volume, *depth, *centers;
    sgsi_statistics view;       // of the view being scored
    sgsi_score_columns columns; // with several ranks
    float *error, *weight;      // [height][stride] of the view being scored
    size_t plane_floats;
    uint8_t *bytes; // its photo in 8 bits, if it is not 8-bit or has alpha
    size_t byte_capacity;
} sgsi_view_scores;

// The model to score.
typedef struct sgsi_score_input {
    const sgsi_pipeline *pipeline;
    const sgs_gaussians *model;
    size_t count;           // rows of this rank to score: the first ones
    size_t whole_count;     // rows of all ranks to score
    const float *filter_3d; // as in sgs_render_options
    int sh_degree;
    int iteration;                     // selects the views
    const sgsi_statistics *statistics; // of the model since its last update
} sgsi_score_input;

// Fills scores->importance and prune_score; exposure and statistics of the model are unchanged.
// Fails with OUT_OF_MEMORY or as sgs_scene_photo does.
sgs_status sgsi_view_scores_compute(sgsi_train_views *views, const sgsi_score_input *input,
                                    sgsi_view_scores *scores);
void sgsi_view_scores_free(sgsi_view_scores *scores); // accepts a zeroed one
