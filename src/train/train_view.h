// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The stages of an iteration for one training view: photo, rays, BVH, image, loss with its
// gradient image, gradient sums per primitive. One function per stage, called in the order below.
// Independent of trainer, optimiser and density control. For views that are only rendered, the
// stages end with the image.

#include "base/progress_calls.h"
#include "base/core.h"
#include "density/schedule.h"
#include "loss/exposure.h"
#include "loss/loss.h"
#include "rays/rays.h"
#include "sparegs/ranks.h"
#include "sparegs/trainer.h"
#include "trace/tracer.h"

// The photos of the training views at a reduced size.
typedef struct sgsi_small_images {
    int scale;         // down-scaling; 0 = not set yet
    sgs_photo *photos; // NULL at scale 1; [count], or one if the scene has an image cache
    size_t count;      // of photos
} sgsi_small_images;

// All training views of a scene, and the workspace to render one of them.
typedef struct sgsi_train_views {
    const sgs_scene *scene;
    const sgs_train_options *options; // NULL if the views are only rendered
    sgs_render_options render;        // its filter_3d and sh_degree are those of the view
    size_t count;
    size_t *scene_views;  // [count] indices into scene->views
    float **depth_bounds; // [count][tiles], see sgsi_tracer_forward
    size_t *tile_counts;  // [count]
    sgsi_small_images small_images;
    float ssim_weight, ssim_sigma; // of the loss
    sgs_photo *targets;            // [count] instead of the photos, for a region; NULL without
    sgsi_tracer *tracer;           // of the primitives that are drawn
    // Projects the rows of the model and holds their gradient sums. The same object as `tracer`,
    // unless ranks share the rows.
    sgsi_tracer *rows;
    sgsi_ray_cache *rays;
    sgsi_loss_workspace *loss;
    sgsi_exposure *exposure; // NULL without option exposure
    float *planes;       // colour, transmittance and, for training, their gradients: 4 or 8 planes
    size_t plane_floats; // per plane
    bool rebuild;        // rebuild the BVH for the next view instead of refitting it
    sgs_ranks *ranks;    // that share views and rows, or NULL
    struct sgsi_view_ranks *view_ranks; // NULL without several ranks
    struct sgsi_view_shards *view_shards;
    size_t prepared, to_prepare; // photos, before training: see sgsi_train_views_advance
    sgsi_float_mode caller_mode; // of the call that prepares them, for options->progress
} sgsi_train_views;

// The pixels of a view that several ranks need.
typedef enum sgsi_image_need {
    SGSI_IMAGE_PIECES, // each rank those of its cells and around them, for the loss
    SGSI_IMAGE_ALL,    // all ranks all pixels, for scores
    SGSI_IMAGE_ONE     // rank `receiver` all pixels, others only their own
} sgsi_image_need;

typedef struct sgsi_train_view {
    // Set by the caller.
    int iteration; // selects the random background
    size_t index;  // of the training view
    const sgs_gaussians *model;
    const float *filter_3d; // as in sgs_render_options
    int sh_degree;
    uint32_t *visible_count; // statistics that the projection updates, or NULL
    float *radius_max;
    sgs_train_seconds *seconds; // each stage adds its time
    sgsi_image_need need;
    int receiver;
    // sgsi_train_view_fetch
    const sgs_view *source;
    const sgs_photo *target;
    sgs_camera camera; // at the size of the target
    // sgsi_train_view_project
    sgsi_view view;
    sgsi_planes planes;
    float *d_color[3], *d_transmittance;
    // sgsi_train_view_loss
    float background[3];
    sgsi_loss_output loss;
} sgsi_train_view;

// Purpose of the messages of a view: `training` unless it is scored or only rendered.
static inline sgs_ranks_purpose sgsi_train_view_purpose(const sgsi_train_view *view,
                                                        sgs_ranks_purpose training)
{
    return view->need == SGSI_IMAGE_PIECES ? training
           : view->need == SGSI_IMAGE_ALL  ? SGS_RANKS_SCORES
                                           : SGS_RANKS_OTHER;
}

// Views, tracer and workspaces for the training split of `scene`. scene and options must outlive
// *views. Fails with OUT_OF_MEMORY, UNSUPPORTED (Embree), or INVALID_ARGUMENT without a training
// view; free *views also after a failure.
sgs_status sgsi_train_views_create(const sgs_scene *scene, const sgs_train_options *options,
                                   sgsi_train_views *views);
void sgsi_train_views_free(sgsi_train_views *views); // accepts a zeroed one
// Views to render: all views of the scene, without photos, loss and gradients. Fails as above.
sgs_status sgsi_drawn_views_create(const sgs_scene *scene, const sgs_render_options *render,
                                   sgsi_train_views *views);

// The schedule of a run on the training views of a scene, which may be loaded without its
// photos. random: the run began with a random cloud. Cannot fail.
sgsi_schedule sgsi_train_schedule(const sgs_scene *scene, const sgs_train_options *options,
                                  bool random);

// Reports that another photo of views->to_prepare was prepared for training to options->progress.
// Fails with CANCELLED.
static inline sgs_status sgsi_train_views_advance(sgsi_train_views *views)
{
    const sgs_train_options *options = views->options;
    ++views->prepared;
    if (!options->progress ||
        sgsi_progress_call(options->progress, options->progress_user, views->prepared,
                           views->to_prepare, views->caller_mode))
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_CANCELLED, "%s: cancelled after preparing %zu of %zu photos",
                     views->scene->path, views->prepared, views->to_prepare);
}

// Sets all depth bounds to "unknown". Cannot fail.
void sgsi_train_views_forget_depths(sgsi_train_views *views);

// For a pass over all views in their order, before the photo of view `index` is fetched: prefetches
// those that follow it. Cannot fail.
static inline void sgsi_train_views_prefetch(const sgsi_train_views *views, size_t index)
{
    const size_t ahead = sgs_scene_prefetch_count(views->scene);
    for (size_t k = index + 1; k <= index + ahead && k < views->count; ++k)
        sgs_scene_prefetch(views->scene, views->scene_views[k]);
}

// The photo, or target, of a view at full size. Fails as sgs_scene_photo does.
static inline sgs_status sgsi_train_view_photo(const sgsi_train_views *views, size_t index,
                                               const sgs_photo **photo)
{
    if (!views->targets)
        return sgs_scene_photo(views->scene, views->scene_views[index], photo);
    *photo = &views->targets[index];
    return SGS_STATUS_OK;
}

// The photo, valid until the next call, and its camera. Fails as sgs_scene_photo or
// sgsi_small_images_photo does, without a change.
sgs_status sgsi_train_view_fetch(const sgsi_train_views *views, sgsi_train_view *view);
// Rays of the camera, projected primitives and their bounds; refits or rebuilds the BVH.
sgs_status sgsi_train_view_project(sgsi_train_views *views, sgsi_train_view *view);
// Gathers and blends into view->planes.
sgs_status sgsi_train_view_forward(sgsi_train_views *views, sgsi_train_view *view);
// The loss and its gradient image: view->loss, d_color, d_transmittance.
sgs_status sgsi_train_view_loss(sgsi_train_views *views, sgsi_train_view *view);
// Gradient sums per primitive: sgsi_tracer_grad_sums and sgsi_tracer_touched of views->rows.
sgs_status sgsi_train_view_backward(sgsi_train_views *views, sgsi_train_view *view);
// Scores of primitives, as sgsi_tracer_score, instead of gradient sums. planes->centers are those
// of the rows of the model.
sgs_status sgsi_train_view_score(sgsi_train_views *views, sgsi_train_view *view,
                                 const sgsi_score_planes *planes);
