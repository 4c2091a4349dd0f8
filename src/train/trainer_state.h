// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The trainer's inside, shared by trainer.c (the loop) and checkpoint.c (to disk and back).

#include "density/density.h"
#include "loss/exposure.h"
#include "model/filter_3d.h"
#include "loss/loss.h"
#include "optimize/numerics.h"
#include "density/pipeline.h"
#include "rays/rays.h"
#include "density/resolution.h"
#include "density/schedule.h"
#include "sparegs/trainer.h"
#include "trace/tracer.h"

// Everything a resumed run must find again, besides arrays.
typedef struct sgsi_progress {
    int32_t iteration;  // done
    int32_t adam_step;  // optimiser steps made (bias correction of dense Adam)
    int32_t last_reset; // iteration of the last opacity reset, -1 = none
    int32_t reset_since_check;
    uint32_t order_position, order_epoch; // of the view permutation
    int32_t stop;                         // sgs_stop_reason
    int32_t updates;                      // structural updates made
    int32_t rest_step;  // as adam_step, of the SH bands above 0 where they step on their own
    int32_t resolution; // down-scaling of the images in force; 0 = none yet
    int32_t structure_iteration; // iteration whose structural update, reset and resolution are made
    sgsi_pipeline_state pipeline;
    double loss_average, loss_weight; // for the progress line
    double psnr_average, psnr_weight;
    spare_equilibrium equilibrium;
    sgsi_skipped skipped;
    sgs_train_seconds seconds;
} sgsi_progress;

// A pixel of a photograph counts.
static inline bool sgsi_photo_counts(const sgs_photo *photo, int x, int y)
{
    return !photo->valid_mask ||
           (photo->valid_mask[(size_t)y * (((size_t)photo->width + 15) / 16) + (size_t)x / 16] >>
                (x % 16) &
            1);
}

// Scores from views, and what it takes to get them: columns of `capacity` primitives.
typedef struct sgsi_trainer_scores {
    size_t capacity;
    float *importance, *prune_score;
    float *gradient, *opacity, *volume, *depth, *centers;
    sgsi_statistics view; // of the view being scored
    uint8_t *bytes;       // its photograph, where that is not bytes
    size_t byte_capacity;
} sgsi_trainer_scores;

// The training views at a smaller size.
typedef struct sgsi_small_images {
    int scale;         // 0 = nothing is to change
    sgs_photo *photos; // [count], or NULL at scale 1
    size_t count;
} sgsi_small_images;

struct sgs_trainer {
    const sgs_scene *scene;
    sgs_train_options options;
    const sgsi_pipeline *pipeline;
    sgsi_schedule schedule;
    sgs_gaussians *model;
    float *m, *v;            // Adam's moments, model layout
    float *accumulated_grad; // gradients that wait for a step, model layout; NULL where every
                             // iteration steps
    uint16_t *accumulated_rows;
    float *filter_3d; // Mip-Splatting's, [capacity], padding 0; NULL with another pixel filter
    sgsi_statistics statistics;
    sgsi_trainer_scores scores;
    sgs_regions regions; // of the last update; owns its list
    sgsi_tracer *tracer;
    sgsi_ray_cache *rays;
    sgsi_loss_workspace *loss;
    sgsi_exposure *exposure; // of train_views; NULL = none
    size_t *train_views;     // indices into scene->views
    size_t train_view_count;
    uint32_t *order;      // permutation of train_views of this epoch
    float **depth_bounds; // per training view, [tiles]
    size_t *tile_counts;  // per training view
    sgsi_resolution resolution;
    sgsi_small_images small_images; // at progress.resolution > 1, else none
    float *planes;                  // colour, transmittance and their gradients: 8 planes
    size_t plane_floats;            // per plane
    bool structure_changed;
    bool seen;         // some view has met a primitive
    bool inconsistent; // the last step has begun to change things and not ended
    sgsi_progress progress;
    sgs_train_bytes bytes; // of this process, not of the checkpoint
    float *cloud_points;
    unsigned char *cloud_colors;
    size_t cloud_count;
    char stop_text[160];
};

// One view on its way through an iteration.
typedef struct step_state {
    int iteration;
    size_t view_index;                 // index into train_views
    const sgsi_statistics *statistics; // that projection and optimiser add to, or NULL
    const sgs_view *source;
    const sgs_photo *target;
    sgs_camera camera; // of the target
    sgsi_view view;
    sgsi_planes planes;
    float *d_color[3], *d_transmittance;
    float background[3];
    bool structural, prunes, last;
    sgsi_loss_output loss;
} step_state;

// The photograph of the training view step->view_index, and the camera it was taken by.
sgs_status sgsi_trainer_fetch(sgs_trainer *trainer, step_state *step);
// Forward and loss of it at step->iteration; fills the rest of *step.
sgs_status sgsi_trainer_draw(sgs_trainer *trainer, step_state *step);
// The scores that the pipeline wants, from views drawn at random.
sgs_status sgsi_trainer_score(sgs_trainer *trainer, int iteration);
void sgsi_trainer_scores_free(sgsi_trainer_scores *scores);

// Plans the sizes of the images and sets the first one; changes to one.
sgs_status sgsi_trainer_resolution_plan(sgs_trainer *trainer);
sgs_status sgsi_trainer_set_resolution(sgs_trainer *trainer, int scale);
// The images of the scale that is due after an iteration; scale 0 where none is. On failure there
// are none and the trainer is as it was.
sgs_status sgsi_trainer_next_resolution(sgs_trainer *trainer, int iteration,
                                        sgsi_small_images *images);
// Takes them over, unless their scale is 0.
void sgsi_trainer_adopt_resolution(sgs_trainer *trainer, sgsi_small_images *images);
void sgsi_small_images_free(sgsi_small_images *images);
// The depth depth_bounds of all views say nothing any more.
void sgsi_trainer_forget_depths(sgs_trainer *trainer);

// The 3D filter of the model as it is (memory and values), where the pixel filter wants one.
sgs_status sgsi_trainer_update_filter_3d(sgs_trainer *trainer);

// Zeroed gradients that wait for a step, for the model as it is; nothing where the pipeline steps
// in every iteration.
sgs_status sgsi_trainer_reserve_accumulated_grad(sgs_trainer *trainer);
float sgsi_trainer_lr_opacity(const sgs_trainer *trainer, int iteration);
// Whether opacities are linear after the iteration that was last; and makes them so, then.
bool sgsi_trainer_opacity_is_linear(const sgs_trainer *trainer);
void sgsi_trainer_convert_opacity(sgs_trainer *trainer);

// Density control after the optimiser step of `iteration`; fills the structural part of *info.
sgs_status sgsi_trainer_update_structure(sgs_trainer *trainer, int iteration, sgs_step_info *info);
// What the last iteration leaves to do before the next: its structural update, another resolution,
// its opacity reset. A photograph that is missing here leaves the trainer as it was.
sgs_status sgsi_trainer_apply_deferred(sgs_trainer *trainer, sgs_step_info *info);
// After progress.iteration: feeds SPARE-GS's termination test and says whether training is over.
sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, double loss);
