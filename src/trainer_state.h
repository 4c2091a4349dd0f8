// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The trainer's inside, shared by trainer.c (the loop) and checkpoint.c (to disk and back).

#include "density.h"
#include "exposure.h"
#include "loss.h"
#include "numerics.h"
#include "pipeline.h"
#include "rays.h"
#include "schedule.h"
#include "sparegs/trainer.h"
#include "tracer.h"

// Everything a resumed run must find again, besides arrays.
typedef struct sgsi_progress {
    int32_t iteration;          // done
    int32_t adam_step;          // optimiser steps made (bias correction of dense Adam)
    int32_t last_reset;         // iteration of the last opacity reset, -1 = none
    int32_t reset_since_check;
    uint32_t order_position, order_epoch; // of the view permutation
    int32_t stop;               // sgs_stop_reason
    int32_t updates;            // structural updates made
    double loss_average, loss_weight; // for the progress line
    double psnr_average, psnr_weight;
    spare_equilibrium equilibrium;
    sgsi_skipped skipped;
    sgs_train_seconds seconds;
} sgsi_progress;

struct sgs_trainer {
    const sgs_scene *scene;
    sgs_train_options options;
    const sgsi_pipeline *pipeline;
    sgsi_schedule schedule;
    sgs_gaussians *model;
    float *m, *v; // Adam's moments, model layout
    sgsi_statistics statistics;
    sgsi_tracer *tracer;
    sgsi_ray_cache *rays;
    sgsi_loss_workspace *loss;
    sgsi_exposure *exposure; // of train_views; NULL = none
    size_t *train_views; // indices into scene->views
    size_t train_view_count;
    uint32_t *order;     // permutation of train_views of this epoch
    float **depth_guesses; // per training view, [tiles]
    size_t *tile_counts;   // per training view
    float *planes;       // colour, transmittance and their gradients: 8 planes
    size_t plane_floats; // per plane
    bool structure_changed;
    sgsi_progress progress;
    sgs_train_bytes bytes; // of this process, not of the checkpoint
    float *cloud_points;
    unsigned char *cloud_colors;
    size_t cloud_count;
    char stop_text[160];
};

// Density control after the optimiser step of `iteration`; fills the structural part of *info.
sgs_status sgsi_trainer_update_structure(sgs_trainer *trainer, int iteration, sgs_step_info *info);
void sgsi_trainer_reset_opacity(sgs_trainer *trainer, int iteration);
// After progress.iteration: feeds SPARE-GS's termination test and says whether training is over.
sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, double loss);
