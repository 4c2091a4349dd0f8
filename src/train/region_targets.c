// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Blocks are trained independently and then merged. If each of them matched the photos
// everywhere, each would also correct the errors that its neighbours correct, and the merged model
// would contain corrections twice. Therefore each block corrects only its own share. With the
// initial model's image I and the photo P, block k is trained towards
//   I + w_k (P - I),   w_k = sum over its own hits of T alpha / sum over all hits of T alpha.
// The w_k of all blocks add up to 1, so to first order the corrections add up to P - I. Where no
// primitive is hit w_k is 1: what appears there is new.

#include "train/region_targets.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/sh.h"
#include "base/threads.h"
#include "image/half.h"
#include "image/mask.h"

// A model of the same shape whose own rows are white and the others black.
static sgs_status make_marks(const sgs_gaussians *model, size_t own, sgs_gaussians **marks)
{
    sgs_status status = sgs_gaussians_create(model->capacity, marks);
    if (!status)
        status = sgs_gaussians_resize(*marks, model->count);
    for (size_t i = 0; i < model->count && !status; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, params);
        for (int c = 0; c < 3; ++c)
            params[SGS_PARAM_SH_DC + c] = (float)((i < own ? 0.5 : -0.5) / SGSI_SH_C0);
        memset(params + SGS_PARAM_SH_REST, 0,
               (SGS_PARAM_COUNT - SGS_PARAM_SH_REST) * sizeof(float));
        sgs_gaussians_set(*marks, i, params);
    }
    return status;
}

typedef struct compose_job {
    const sgsi_train_view *view; // its planes hold the marks
    const float *color[3];       // of the model
    float background[3];
    sgs_photo *target;
} compose_job;

static void put_value(sgs_photo *photo, size_t at, float value)
{
    value = fmaxf(value, 0.0f);
    if (photo->pixels)
        photo->pixels[at] = (uint8_t)(255.0f * fminf(value, 1.0f) + 0.5f);
    else
        photo->halves[at] = sgsi_half_from_float(value);
}

static void compose_row(void *context, size_t y, int thread)
{
    (void)thread;
    const compose_job *job = context;
    const sgs_photo *photo = job->view->target;
    const sgsi_planes *marks = &job->view->planes;
    const size_t width = (size_t)photo->width, plane = width * (size_t)photo->height;
    const bool has_alpha = photo->channels == 4;
    for (size_t x = 0; x < width; ++x) {
        const size_t at = y * width + x, from = y * marks->stride + x;
        const float through = marks->transmittance[from], drawn = 1.0f - through;
        const float w =
            drawn > 1e-3f ? fminf(fmaxf(marks->color[0][from] / drawn, 0.0f), 1.0f) : 1.0f;
        const float alpha = has_alpha ? sgs_photo_value(photo, 3 * plane + at) : 1.0f;
        const float opaque = has_alpha ? w * alpha + (1.0f - w) * drawn : 1.0f;
        for (size_t c = 0; c < 3; ++c) {
            const float behind = has_alpha ? 0.0f : through * job->background[c];
            const float value = w * alpha * sgs_photo_value(photo, c * plane + at) +
                                (1.0f - w) * (job->color[c][from] + behind);
            put_value(job->target, c * plane + at, opaque > 0.0f ? value / opaque : 0.0f);
        }
        if (has_alpha)
            put_value(job->target, 3 * plane + at, opaque);
    }
}

// Memory for a photo like `from`, with a copy of its mask.
static sgs_status copy_shape(const sgs_photo *from, sgs_photo *to)
{
    const size_t values = (size_t)from->channels * (size_t)from->width * (size_t)from->height,
                 words = sgs_mask_words(from->width) * (size_t)from->height;
    *to = *from;
    to->pixels = from->pixels ? sgsi_alloc(values, 1) : NULL;
    to->halves = from->halves ? sgsi_alloc(values, sizeof *to->halves) : NULL;
    to->valid_mask = from->valid_mask ? sgsi_alloc(words, sizeof *to->valid_mask) : NULL;
    if ((!to->pixels && !to->halves) || (from->valid_mask && !to->valid_mask))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the images of a region");
    if (to->valid_mask)
        memcpy(to->valid_mask, from->valid_mask, words * sizeof *to->valid_mask);
    return SGS_STATUS_OK;
}

// The first view builds the BVH, the others refit it.
static sgs_status draw_model(sgsi_train_views *views, sgsi_train_view *view,
                             const sgs_gaussians *model)
{
    view->model = model;
    const sgs_status status = sgsi_train_view_project(views, view);
    return status ? status : sgsi_train_view_forward(views, view);
}

// The marks have the shapes of the model: the BVH and the bounds in it stay valid.
static sgs_status draw_marks(sgsi_train_views *views, sgsi_train_view *view,
                             const sgs_gaussians *marks)
{
    view->model = marks;
    const sgs_status status = sgsi_tracer_project(views->rows, marks, &view->view, NULL, NULL);
    return status ? status : sgsi_train_view_forward(views, view);
}

static sgs_status make_target(sgsi_train_views *views, sgsi_train_view *view,
                              const sgs_gaussians *model, const sgs_gaussians *marks, float *color)
{
    const sgs_train_options *options = views->options;
    sgs_photo *target = &views->targets[view->index];
    sgs_status status = draw_model(views, view, model);
    if (status)
        return status;
    const size_t n = views->plane_floats;
    compose_job job = {view, {color, color + n, color + 2 * n}, {0}, target};
    memcpy(color, view->planes.color[0], 3 * n * sizeof *color); // the planes are adjacent
    for (int c = 0; c < 3; ++c)
        job.background[c] = options->background_random ? 0.0f : options->background[c];
    status = draw_marks(views, view, marks);
    if (!status)
        status = copy_shape(view->target, target);
    if (!status)
        sgsi_parallel_for((size_t)target->height, 1, compose_row, &job);
    return status;
}

sgs_status sgsi_region_targets_make(sgsi_train_views *views, const sgs_gaussians *model, size_t own,
                                    const float *filter_3d)
{
    sgs_train_seconds ignored = {0};
    sgs_gaussians *marks = NULL;
    sgs_photo *targets = sgsi_calloc(views->count, sizeof *targets);
    float *color = sgsi_alloc(views->plane_floats, 3 * sizeof *color);
    sgs_status status =
        targets && color
            ? make_marks(model, own, &marks)
            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the images of a region");
    for (size_t i = 0; i < views->count && !status; ++i) {
        sgsi_train_view view = {.index = i,
                                .filter_3d = filter_3d,
                                .sh_degree = views->options->sh_degree,
                                .seconds = &ignored};
        sgsi_train_views_prefetch(views, i);
        views->targets = NULL; // fetch the photo
        status = sgsi_train_view_fetch(views, &view);
        views->targets = targets;
        if (!status)
            status = make_target(views, &view, model, marks, color);
        if (!status)
            status = sgsi_train_views_advance(views);
    }
    views->targets = targets;
    views->rebuild = true;
    sgsi_train_views_forget_depths(views);
    sgs_gaussians_destroy(marks);
    sgsi_free(color);
    return status;
}
