// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The model of a trainer: its initial value, and the arrays of its length. The trainer keeps the
// initial point cloud, which callers write as input.ply.

#include <math.h>
#include <string.h>

#include "base/sh.h"
#include "base/core.h"
#include "base/threads.h"
#include "model/filter_3d.h"
#include "model/init_points.h"
#include "model/model_region.h"
#include "sparegs/image.h"
#include "sparegs/model_edit.h"
#include "train/initial_selection.h"
#include "train/trainer_state.h"

// Few points leave the space between the cameras and the objects empty. With many points, those
// close to a camera fit its image alone (tools/experiments/schedules.md).
enum { PUBLISHED_POINTS = 100000, FEW_POINTS = 10000 };

size_t sgs_train_random_points(const sgs_scene *scene, const sgs_train_options *options)
{
    sgs_train_options own = sgs_train_options_default();
    if (sgsi_options_read(options, "sgs_train_options", &own, sizeof own) || scene->point_count ||
        own.init)
        return 0;
    if (own.random_points)
        return own.random_points;
    return scene->white_background || own.schedule == SGS_SCHEDULE_PAPER ? PUBLISHED_POINTS
                                                                         : FEW_POINTS;
}

// Random cloud: in the cube around the origin for NeRF synthetic scenes, around the cameras
// otherwise.
static sgs_status random_cloud(sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->scene;
    size_t n = sgs_train_random_points(scene, &trainer->options);
    if (trainer->options.max_gaussians && n > trainer->options.max_gaussians)
        n = trainer->options.max_gaussians;
    trainer->cloud_points = sgsi_alloc(n ? n : 1, 3 * sizeof(float));
    trainer->cloud_colors = sgsi_alloc(n ? n : 1, 3);
    if (!trainer->cloud_points || !trainer->cloud_colors)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu random points", n);
    const bool cube = scene->white_background != 0;
    const double half = cube ? 1.3 : 3.0 * scene->extent;
    for (size_t i = 0; i < 3 * n; ++i) {
        const double u = sgsi_random_uniform(trainer->options.seed ^ 0xC10D, i);
        trainer->cloud_points[i] =
            (float)((cube ? 0.0 : scene->center[i % 3]) + half * (2.0 * u - 1.0));
        // As 3DGS: SH coefficients in [0, 1] / 255, colours just above middle grey.
        const double coefficient = sgsi_random_uniform(trainer->options.seed ^ 0xC0108, i) / 255.0;
        trainer->cloud_colors[i] = (unsigned char)(255.0 * (0.5 + SGSI_SH_C0 * coefficient) + 0.5);
    }
    trainer->cloud_count = n;
    return SGS_STATUS_OK;
}

// The scene's cloud, thinned to the cap.
static sgs_status scene_cloud(sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->scene;
    const size_t cap = trainer->options.max_gaussians, n = scene->point_count;
    const size_t wanted = cap && cap < n ? cap : n;
    trainer->cloud_points = sgsi_alloc(wanted, 3 * sizeof(float));
    trainer->cloud_colors = sgsi_alloc(wanted, 3);
    if (!trainer->cloud_points || !trainer->cloud_colors)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu points", wanted);
    uint8_t *chosen = sgsi_alloc(n, 1);
    if (!chosen)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu points", n);
    memset(chosen, 1, n);
    sgs_status status = SGS_STATUS_OK;
    if (wanted < n) {
        sgsi_warn("the sparse model has %zu points; thinned to %zu, limited by option "
                  "max_gaussians",
                  n, wanted);
        status = sgsi_thin_points(scene->points, n, wanted, chosen);
    }
    size_t taken = 0;
    for (size_t i = 0; i < n && !status; ++i) {
        if (!chosen[i])
            continue;
        memcpy(trainer->cloud_points + 3 * taken, scene->points + 3 * i, 3 * sizeof(float));
        for (size_t c = 0; c < 3; ++c) {
            const unsigned char color = scene->colors[3 * i + c]; // of display-encoded photos
            trainer->cloud_colors[3 * taken + c] =
                scene->space == SGS_SPACE_SRGB
                    ? color
                    : (unsigned char)(255.0f * sgs_srgb_decode((float)color / 255.0f) + 0.5f);
        }
        ++taken;
    }
    sgsi_free(chosen);
    trainer->cloud_count = taken;
    return status;
}

// Declares that all rows of a model have logits.
static sgs_status declare_logits(sgs_gaussians *model)
{
    const size_t count = model->count;
    model->linear_opacity = false;
    const sgs_status status = sgs_gaussians_resize(model, model->capacity);
    return status ? status : sgs_gaussians_resize(model, count); // inert rows of logits
}

// The cap keeps the primitives of largest opacity times cross section. It does not apply to those
// outside of the region. `from` may be the trainer's own model; it is replaced if rows are omitted,
// because moments and statistics have the capacity of the model.
static sgs_status copy_initial_model(sgs_trainer *trainer, const sgs_gaussians *from)
{
    const size_t cap = trainer->options.max_gaussians, n = from->count ? from->count : 1;
    uint8_t *marks = sgsi_calloc(n, 2);
    if (!marks)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         from->count);
    uint8_t *const own = marks, *const chosen = marks + n;
    size_t owned = 0, taken = 0;
    const sgs_box *region = &trainer->options.region;
    const bool whole = sgs_box_is_infinite(region); // rows that are not finite, too
    for (size_t i = 0; i < from->count; ++i) {
        own[i] = whole || sgsi_region_has(from, i, region);
        owned += own[i];
    }
    const size_t wanted = cap && cap < owned ? cap : owned;
    if (wanted < owned)
        sgsi_warn("the initial model has %zu primitives; using the %zu of largest opacity times "
                  "cross section, limited by option max_gaussians",
                  owned, wanted);
    const size_t count = from->count - owned + wanted;
    const bool in_place = from == trainer->model && count == from->count;
    sgs_gaussians *made = in_place ? trainer->model : NULL;
    sgs_status status = sgsi_select_largest(from, own, wanted, chosen);
    if (!status && !in_place)
        status = sgs_gaussians_create(count + SGS_LANES, &made);
    if (!status && !in_place)
        status = sgs_gaussians_resize(made, count);
    for (size_t i = 0; i < from->count && !status; ++i) {
        if (own[i] && !chosen[i])
            continue;
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(from, i, params);
        params[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(from, i);
        sgs_gaussians_set(made, taken++, params);
    }
    sgsi_free(marks);
    if (in_place)
        return status ? status : declare_logits(made);
    sgs_gaussians_destroy(trainer->model);
    trainer->model = made;
    return status;
}

void sgsi_trainer_clamp_to_region(sgs_trainer *trainer)
{
    if (!sgs_box_is_infinite(&trainer->options.region))
        sgsi_region_clamp(trainer->model, sgsi_trainer_own(trainer), &trainer->options.region);
}

// Orders a new model by the region: its own rows first.
static sgs_status begin_region(sgs_trainer *trainer)
{
    const sgs_box *region = &trainer->options.region;
    size_t own;
    if (sgs_box_is_infinite(region))
        return SGS_STATUS_OK;
    const sgs_status status = sgsi_region_order(trainer->model, region, &own);
    if (status)
        return status;
    if (!own)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "no centre of the initial model is in the region");
    trainer->fixed = trainer->model->count - own;
    return SGS_STATUS_OK;
}

bool sgsi_trainer_accumulates(const sgs_trainer *trainer)
{
    return trainer->schedule.batch_rest || trainer->options.batch > 1;
}

sgs_status sgsi_trainer_reserve_accumulated_grad(sgs_trainer *trainer)
{
    trainer->progress.batch_views = 0;
    if (!sgsi_trainer_accumulates(trainer))
        return SGS_STATUS_OK;
    const size_t capacity = trainer->model->capacity;
    sgsi_free(trainer->accumulated_grad);
    sgsi_free(trainer->accumulated_rows);
    trainer->accumulated_grad = sgsi_calloc_shared(capacity, SGS_PARAM_COUNT * sizeof(float));
    trainer->accumulated_rows = sgsi_calloc(capacity / SGS_LANES + 1, 2 * sizeof(uint16_t));
    if (trainer->accumulated_grad && trainer->accumulated_rows)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for the gradients of %zu primitives",
                     trainer->model->count);
}

sgs_status sgsi_trainer_reserve_filter_3d(sgs_trainer *trainer)
{
    if (trainer->options.filter != SGS_FILTER_MIP)
        return SGS_STATUS_OK;
    sgsi_free(trainer->filter_3d);
    trainer->filter_3d = sgsi_calloc_shared(trainer->model->capacity, sizeof *trainer->filter_3d);
    return trainer->filter_3d ? SGS_STATUS_OK
                              : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                          "not enough memory for the 3D filter of %zu primitives",
                                          trainer->model->count);
}

// The largest value of all ranks.
static sgs_status share_largest(sgs_trainer *trainer, sgs_status own, float *value)
{
    const int count = sgsi_trainer_ranks(trainer);
    float *all = sgsi_alloc((size_t)count, sizeof *all);
    if (!all && !own)
        own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %d ranks", count);
    const sgs_status status =
        sgs_ranks_gather(trainer->views.ranks, own, value, sizeof *value, all);
    for (int r = 0; r < count && !status; ++r)
        *value = fmaxf(*value, all[r]);
    sgsi_free(all);
    return status;
}

sgs_status sgsi_trainer_update_filter_3d(sgs_trainer *trainer)
{
    const sgsi_train_views *views = &trainer->views;
    sgs_status status = sgsi_trainer_reserve_filter_3d(trainer);
    float farthest = 0.0f;
    if (trainer->options.filter != SGS_FILTER_MIP)
        return status;
    if (!status)
        status = sgsi_filter_3d_sample(trainer->model, trainer->scene, views->scene_views,
                                       views->count, sgs_near_distance(trainer->scene->extent),
                                       trainer->filter_3d, &farthest);
    if (sgsi_trainer_is_shared(trainer))
        status = share_largest(trainer, status, &farthest);
    if (!status)
        sgsi_filter_3d_scale(trainer->scene, views->scene_views, views->count, farthest,
                             trainer->filter_3d, trainer->model->count);
    // The rows outside of a region have the filter of their own training.
    for (size_t i = sgsi_trainer_own(trainer); i < trainer->model->count && !status; ++i)
        trainer->filter_3d[i] = 0.0f;
    return status;
}

static sgsi_late_opacity opacity_after(const sgs_trainer *trainer, int iteration)
{
    const sgsi_pipeline *pipeline = trainer->pipeline;
    return pipeline->late_opacity && iteration >= trainer->schedule.densify_until
               ? pipeline->late_opacity(&trainer->options)
               : SGSI_LATE_OPACITY_TRAINED;
}

float sgsi_trainer_lr_opacity(const sgs_trainer *trainer, int iteration)
{
    if (opacity_after(trainer, iteration) == SGSI_LATE_OPACITY_FROZEN)
        return 0.0f;
    return (float)trainer->schedule.lr_opacity * trainer->pipeline->lr_opacity;
}

bool sgsi_trainer_opacity_is_linear(const sgs_trainer *trainer)
{
    const int iteration =
        trainer->progress.iteration; // of the last step; they are converted after it
    return iteration > 0 && opacity_after(trainer, iteration) == SGSI_LATE_OPACITY_LINEAR;
}

void sgsi_trainer_convert_opacity(sgs_trainer *trainer)
{
    sgs_gaussians *model = trainer->model;
    if (!sgsi_trainer_opacity_is_linear(trainer) || model->linear_opacity)
        return;
    sgs_gaussians_linearize_opacity(model);
    for (size_t block = 0; block < model->capacity / SGS_LANES; ++block) {
        const size_t at = (block * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES;
        memset(trainer->m + at, 0, SGS_LANES * sizeof(float));
        memset(trainer->v + at, 0, SGS_LANES * sizeof(float));
    }
}

sgs_status sgsi_trainer_create_model(sgs_trainer *trainer)
{
    sgs_status status;
    if (trainer->options.init) {
        status = copy_initial_model(trainer, trainer->options.init);
        trainer->options.init = NULL;
        trainer->has_init = true;
    } else {
        status = trainer->scene->point_count ? scene_cloud(trainer) : random_cloud(trainer);
        if (!status)
            status = sgsi_gaussians_init_points(trainer->cloud_points, trainer->cloud_colors,
                                                trainer->cloud_count, 0.01 * trainer->scene->extent,
                                                trainer->sampling.start_opacity,
                                                trainer->sampling.start_scale, &trainer->model);
    }
    if (status)
        return status;
    sgs_gaussians_limit_sh(trainer->model, trainer->options.sh_degree);
    trainer->model->sh_degree = trainer->options.sh_degree;
    status = sgsi_density_sort(trainer->model);
    if (!status && !trainer->model->count)
        status =
            sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the initial model has no finite primitives");
    if (!status)
        status = begin_region(trainer);
    if (status)
        return status;
    trainer->count = trainer->model->count;
    trainer->progress.pipeline.initial_count = (int64_t)sgsi_trainer_trained(trainer);
    status = sgsi_trainer_update_filter_3d(trainer);
    // Stored models have the 3D filter of Mip-Splatting in their scales and opacities, and would
    // get it twice.
    if (!status && trainer->has_init && trainer->filter_3d)
        sgsi_filter_3d_unfuse_rows(trainer->model, trainer->filter_3d);
    return status;
}

sgs_status sgsi_trainer_reserve_state(sgs_trainer *trainer)
{
    const size_t capacity = trainer->model->capacity;
    if (trainer->m)
        return SGS_STATUS_OK;
    sgs_status status = sgsi_trainer_reserve_accumulated_grad(trainer);
    if (!status)
        status = sgsi_statistics_reserve(&trainer->statistics, capacity);
    if (status)
        return status;
    trainer->v = sgsi_calloc_shared(capacity, SGS_PARAM_COUNT * sizeof(float));
    trainer->m = trainer->v ? sgsi_calloc_shared(capacity, SGS_PARAM_COUNT * sizeof(float)) : NULL;
    if (trainer->m)
        return SGS_STATUS_OK;
    sgsi_free(trainer->v);
    trainer->v = NULL;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for the optimiser of %zu primitives",
                     trainer->model->count);
}
