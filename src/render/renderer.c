// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The public renderer: a tracer and a ray cache for a model owned by the caller. Forward and
// backward pass use the tracer of trace/; the chain rule to the parameters is that of optimize/,
// which trace/ must not include.

#include <stdlib.h>
#include <string.h>

#include "base/aov_planes.h"
#include "base/core.h"
#include "base/float_mode.h"
#include "base/progress_calls.h"
#include "trace/deep.h"
#include "optimize/optimize.h"
#include "model/normals.h"
#include "rays/rays.h"
#include "sparegs/runtime.h"
#include "base/threads.h"
#include "trace/tracer.h"

struct sgs_renderer {
    const sgs_gaussians *model;
    sgsi_tracer *tracer;
    sgsi_ray_cache *rays;
    bool changed;
    sgsi_planes planes;
    sgsi_aov aov;
    size_t discard_floats;
    // Colour and transmittance if the frame has no planes for them.
    float *discarded;
    size_t normal_count;
    float *normals; // [normal_count][4]
    sgsi_deep deep;
    float *filter_3d; // padded to a multiple of 16
    size_t filter_capacity;
    sgsi_float_mode caller_mode; // during a call, for the caller's functions
    // Of the last differentiable render; valid while its lists are.
    bool differentiable;
    sgsi_view view;
    float *zeros; // a plane, for NULL gradients
    size_t zero_count;
};

double sgs_near_distance(double extent)
{
    return extent < 1.0 ? 0.2 * extent : 0.2;
}

void sgs_render_options_init(sgs_render_options *options, size_t size)
{
    const sgs_render_options defaults = {
        .filter = SGS_FILTER_3DGS, .near_distance = 0.2, .sh_degree = 3, .compact_box = 1.0};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

// ---- Frames ----

static double memory_of(int width, int height, unsigned planes, int count)
{
    size_t aov_count;
    const sgs_aov *aovs = sgs_aov_descriptors(&aov_count);
    const double plane = (double)width * height * sizeof(float);
    double bytes = sgsi_ray_peak_bytes(width, height);
    for (size_t i = 0; i < aov_count; ++i)
        if (sgsi_aov_is_requested(&aovs[i], planes))
            bytes += plane * aovs[i].channels * count;
    return bytes;
}

uint64_t sgs_frame_memory(int width, int height, unsigned planes, int count)
{
    if (width < 1 || height < 1 || count < 0)
        return 0;
    const double bytes = memory_of(width, height, planes, count);
    return bytes < 0x1p64 ? (uint64_t)bytes : UINT64_MAX;
}

sgs_status sgs_frame_create_with(int width, int height, unsigned planes, sgs_frame *frame)
{
    *frame = (sgs_frame){0};
    if (width < 1 || height < 1)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "invalid frame size %dx%d", width, height);
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    const double bytes = memory_of(width, height, planes, 1),
                 machine = (double)sgs_machine_memory();
    if (bytes > machine)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "a frame of %dx%d pixels requires more than %.1f GiB, but the machine has "
                         "%.1f GiB; use a smaller size",
                         width, height, bytes / 0x1p30, machine / 0x1p30);
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < aovs[i].channels && sgsi_aov_is_requested(&aovs[i], planes); ++c) {
            void *plane = sgsi_calloc_shared((size_t)width * (size_t)height, sizeof(float));
            if (!plane) {
                sgs_frame_free(frame);
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                 "not enough memory for a frame of %dx%d pixels", width, height);
            }
            sgsi_plane_set(frame, aovs[i].offset, c, plane);
        }
    frame->width = width;
    frame->height = height;
    return SGS_STATUS_OK;
}

sgs_status sgs_frame_create(int width, int height, sgs_frame *frame)
{
    return sgs_frame_create_with(width, height, SGS_AOVS_BASIC, frame);
}

void sgs_frame_free(sgs_frame *frame)
{
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < aovs[i].channels; ++c)
            sgsi_free(sgs_aov_plane(&aovs[i], frame, c));
    *frame = (sgs_frame){0};
}

// ---- The renderer ----

sgs_status sgs_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer)
{
    *renderer = NULL;
    sgs_renderer *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a renderer");
    made->model = model;
    made->changed = true;
    sgs_status status = sgsi_tracer_create(&made->tracer);
    if (!status)
        status = sgsi_ray_cache_create(SGSI_RAY_CACHE_BYTES, 0, &made->rays);
    if (status) {
        sgs_renderer_destroy(made);
        return status;
    }
    *renderer = made;
    return SGS_STATUS_OK;
}

void sgs_renderer_destroy(sgs_renderer *renderer)
{
    if (!renderer)
        return;
    sgsi_tracer_destroy(renderer->tracer);
    sgsi_ray_cache_destroy(renderer->rays);
    sgsi_free(renderer->discarded);
    sgsi_free(renderer->normals);
    sgsi_deep_free(&renderer->deep);
    sgsi_free(renderer->filter_3d);
    sgsi_free(renderer->zeros);
    sgsi_free(renderer);
}

void sgs_renderer_ray_limit_set(sgs_renderer *renderer, size_t bytes)
{
    sgsi_ray_cache_limit_set(renderer->rays, bytes);
}

size_t sgs_renderer_ray_bytes(const sgs_renderer *renderer)
{
    return sgsi_ray_cache_bytes(renderer->rays);
}

sgs_status sgs_renderer_update(sgs_renderer *renderer)
{
    renderer->changed = true;
    return sgs_renderer_refit(renderer);
}

// Every rendering refits the BVH to the view, and builds it if the number of primitives has
// changed.
sgs_status sgs_renderer_refit(sgs_renderer *renderer)
{
    renderer->differentiable = false;
    return SGS_STATUS_OK;
}

// The kernels write directly into the frame. Colour and transmittance planes missing from it are
// replaced by internal ones.
static sgs_status prepare_planes(sgs_renderer *renderer, const sgs_frame *frame)
{
    const size_t floats = (size_t)frame->width * (size_t)frame->height;
    float *basic[4] = {frame->color[0], frame->color[1], frame->color[2], frame->transmittance};
    for (size_t k = 0; k < 4; ++k) {
        if (basic[k])
            continue;
        if (4 * floats > renderer->discard_floats) {
            sgsi_free(renderer->discarded);
            renderer->discarded = sgsi_alloc(floats, 4 * sizeof *renderer->discarded);
            renderer->discard_floats = renderer->discarded ? 4 * floats : 0;
            if (!renderer->discarded)
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                 "not enough memory for a frame of %dx%d pixels", frame->width,
                                 frame->height);
        }
        basic[k] = renderer->discarded + k * floats;
    }
    renderer->planes = (sgsi_planes){.width = frame->width,
                                     .height = frame->height,
                                     .stride = (size_t)frame->width,
                                     .color = {basic[0], basic[1], basic[2]},
                                     .transmittance = basic[3],
                                     .depth_mean = frame->depth_mean,
                                     .depth_median = frame->depth_median,
                                     .depth_first = frame->depth_first,
                                     .hits = frame->hits,
                                     .candidates = frame->candidates};
    return SGS_STATUS_OK;
}

static bool any_plane(float *const planes[3])
{
    return planes[0] || planes[1] || planes[2];
}

// AOVs beyond the basic ones, and the normals of the primitives if requested.
static sgs_status prepare_aov(sgs_renderer *renderer, const sgsi_view *view,
                              const sgs_render_options *options, const sgs_frame *frame)
{
    sgsi_aov *aov = &renderer->aov;
    *aov = (sgsi_aov){.primitive = frame->primitive, .axis_depth = options->axis_depth};
    memcpy(aov->normal, frame->normal, sizeof aov->normal);
    memcpy(aov->position, frame->position, sizeof aov->position);
    memcpy(aov->rotation, view->rotation, sizeof aov->rotation);
    memcpy(aov->center, view->center, sizeof aov->center);
    memcpy(aov->center_low, view->center_low, sizeof aov->center_low);
    const bool normal = any_plane(aov->normal), position = any_plane(aov->position);
    renderer->planes.aov = normal || position || aov->primitive || aov->axis_depth ? aov : NULL;
    if (!normal)
        return SGS_STATUS_OK;
    // Also for an empty model: the kernels write the plane only if there are normals.
    if (!renderer->normals || renderer->normal_count < renderer->model->count) {
        sgsi_free(renderer->normals);
        renderer->normals = sgsi_alloc(renderer->model->count, 4 * sizeof *renderer->normals);
        renderer->normal_count = renderer->normals ? renderer->model->count : 0;
        if (!renderer->normals)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for the normals of %zu primitives",
                             renderer->model->count);
    }
    double center[3];
    for (int k = 0; k < 3; ++k)
        center[k] = (double)view->center[k] + (double)view->center_low[k];
    sgsi_normals_fill(renderer->model, center, renderer->normals);
    aov->normals = renderer->normals;
    return SGS_STATUS_OK;
}

// The kernels read whole blocks of 16; the caller's array has model->count entries.
static sgs_status pad_filter(sgs_renderer *renderer, const sgs_render_options *options,
                             const float **filter_3d)
{
    const size_t count = renderer->model->count, capacity = renderer->model->capacity;
    *filter_3d = NULL;
    if (options->filter != SGS_FILTER_MIP || !options->filter_3d)
        return SGS_STATUS_OK;
    if (capacity > renderer->filter_capacity) {
        sgsi_free(renderer->filter_3d);
        renderer->filter_3d = sgsi_calloc(capacity, sizeof *renderer->filter_3d);
        renderer->filter_capacity = renderer->filter_3d ? capacity : 0;
        if (!renderer->filter_3d)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for the 3D filter of %zu primitives", count);
    }
    memcpy(renderer->filter_3d, options->filter_3d, count * sizeof *renderer->filter_3d);
    *filter_3d = renderer->filter_3d;
    return SGS_STATUS_OK;
}

typedef struct ray_watch {
    const sgs_render_options *options;
    size_t total; // of the whole call
    sgsi_float_mode mode;
} ray_watch;

static bool watch_rays(void *user, size_t done, size_t total)
{
    const ray_watch *watch = user;
    (void)total;
    return sgsi_progress_call(watch->options->progress, watch->options->progress_user, done,
                              watch->total, watch->mode);
}

// All steps before tracing.
static sgs_status begin_view(sgs_renderer *renderer, const sgs_camera *camera, const sgs_pose *pose,
                             const sgs_render_options *options, const sgs_frame *frame,
                             size_t progress_total, sgsi_view *view)
{
    renderer->differentiable = false;
    if (frame->width != camera->width || frame->height != camera->height)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "frame size %dx%d differs from the camera's, %dx%d", frame->width,
                         frame->height, camera->width, camera->height);
    const sgsi_rays *rays;
    ray_watch watch = {options, progress_total, renderer->caller_mode};
    sgs_status status = sgsi_render_options_check(options);
    if (!status)
        status = sgs_pose_validate(pose);
    if (!status)
        status = sgsi_ray_cache_get_watched(renderer->rays, camera,
                                            options->progress ? watch_rays : NULL, &watch, &rays);
    if (!status && options->axis_depth && !rays->forward)
        status = sgsi_fail(SGS_STATUS_UNSUPPORTED,
                           "option axis_depth is not defined for rays 90 degrees or more from the "
                           "camera axis; measure along the ray");
    if (!status)
        status = prepare_planes(renderer, frame);
    if (status)
        return status;
    sgs_render_options padded = *options;
    status = pad_filter(renderer, options, &padded.filter_3d);
    if (status)
        return status;
    sgsi_view_set(view, rays, pose, &padded);
    status = sgsi_tracer_project(renderer->tracer, renderer->model, view, NULL, NULL);
    // Candidates are those of a tree over this view, whatever was rendered before.
    const bool rebuild = renderer->changed || frame->candidates;
    if (!status)
        status = sgsi_tracer_commit(renderer->tracer, rebuild, SGSI_BVH_REFIT);
    renderer->changed = renderer->changed && status;
    if (!status)
        status = prepare_aov(renderer, view, options, frame);
    return status;
}

// Rows of macrotiles per band: enough work for all threads within a limit on sample memory.
static int band_rows(const sgsi_rays *rays, int max_samples)
{
    const size_t wanted = 8 * (size_t)sgsi_threads() / (size_t)rays->macrotiles_x + 1;
    const size_t row_bytes = (size_t)rays->macrotile_side * SGSI_TILE * (size_t)rays->camera.width *
                             (size_t)max_samples * sizeof(sgs_deep_sample);
    const size_t allowed = ((size_t)256 << 20) / row_bytes;
    return (int)(wanted < allowed ? wanted : allowed ? allowed : 1);
}

// Renders in bands and calls the progress function between them.
static sgs_status render_bands(sgs_renderer *renderer, const sgsi_view *view,
                               const sgs_render_options *options)
{
    const sgsi_rays *rays = view->rays;
    const int step = band_rows(rays, 1) * rays->macrotile_side;
    for (int first = 0; first < rays->tiles_y; first += step) {
        const int last = first + step < rays->tiles_y ? first + step : rays->tiles_y;
        const sgs_status status =
            sgsi_tracer_forward_rows(renderer->tracer, view, &renderer->planes, first, last);
        if (status)
            return status;
        if (!sgsi_progress_call(options->progress, options->progress_user, (size_t)last,
                                (size_t)rays->tiles_y, renderer->caller_mode))
            return sgsi_fail(SGS_STATUS_CANCELLED, "rendering was cancelled");
    }
    return SGS_STATUS_OK;
}

static sgs_status render(sgs_renderer *renderer, const sgs_camera *camera, const sgs_pose *pose,
                         const sgs_render_options *options, sgs_frame *frame)
{
    sgs_render_options own = sgs_render_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_render_options", &own, sizeof own);
    if (!status && own.differentiable && own.progress)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "a differentiable rendering takes no progress function");
    if (!status)
        status = begin_view(renderer, camera, pose, &own, frame,
                            ((size_t)camera->height + SGSI_TILE - 1) / SGSI_TILE, &renderer->view);
    if (status)
        return status;
    if (own.progress)
        return render_bands(renderer, &renderer->view, &own);
    status = sgsi_tracer_forward(renderer->tracer, &renderer->view, &renderer->planes, NULL,
                                 own.differentiable);
    renderer->differentiable = own.differentiable && !status;
    return status;
}

sgs_status sgs_renderer_render(sgs_renderer *renderer, const sgs_camera *camera,
                               const sgs_pose *pose, const sgs_render_options *options,
                               sgs_frame *frame)
{
    renderer->caller_mode = sgsi_float_mode_enter();
    const sgs_status status = render(renderer, camera, pose, options, frame);
    sgsi_float_mode_set(renderer->caller_mode);
    return status;
}

static sgs_status call_rows(const sgs_renderer *renderer, int y, int height, sgs_deep_rows_fn rows,
                            void *context)
{
    const size_t errors = sgsi_error_count();
    sgsi_float_mode_set(renderer->caller_mode);
    const sgs_status status =
        rows(context, y, height, renderer->deep.counts, renderer->deep.samples);
    (void)sgsi_float_mode_enter();
    if (status && sgsi_error_count() == errors)
        sgsi_record_error("the rows callback failed: %s", sgs_status_text(status));
    return status;
}

static sgs_status render_deep(sgs_renderer *renderer, const sgs_camera *camera,
                              const sgs_pose *pose, const sgs_render_options *options,
                              const sgs_deep_options *deep, sgs_frame *frame, sgs_deep_rows_fn rows,
                              void *context)
{
    sgs_render_options own = sgs_render_options_default();
    sgs_deep_options own_deep = sgs_deep_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_render_options", &own, sizeof own);
    if (!status)
        status = sgsi_options_read(deep, "sgs_deep_options", &own_deep, sizeof own_deep);
    if (status)
        return status;
    deep = &own_deep;
    if (!(deep->tolerance >= 0 && deep->tolerance <= 1) || deep->max_samples < 1 ||
        deep->max_samples > 256)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "deep tolerance %g or %d samples per pixel is out of range",
                         deep->tolerance, deep->max_samples);
    sgsi_view view;
    status = begin_view(renderer, camera, pose, &own, frame, (size_t)camera->height, &view);
    if (status)
        return status;
    const sgsi_rays *rays = view.rays;
    const int macrotile_rows = band_rows(rays, deep->max_samples),
              step = macrotile_rows * rays->macrotile_side;
    status = sgsi_deep_reserve(&renderer->deep, deep, camera->width, step * SGSI_TILE);
    renderer->aov.visit = sgsi_deep_visit;
    renderer->aov.context = &renderer->deep;
    renderer->planes.aov = &renderer->aov;
    for (int first = 0; first < rays->tiles_y && !status; first += step) {
        const int y = first * SGSI_TILE, left = camera->height - y;
        const int height = left < step * SGSI_TILE ? left : step * SGSI_TILE;
        sgsi_deep_begin(&renderer->deep, y, height);
        status =
            sgsi_tracer_forward_rows(renderer->tracer, &view, &renderer->planes, first,
                                     first + step < rays->tiles_y ? first + step : rays->tiles_y);
        if (status)
            break;
        sgsi_deep_pack(&renderer->deep);
        status = call_rows(renderer, y, height, rows, context);
        if (!status && own.progress &&
            !sgsi_progress_call(own.progress, own.progress_user, (size_t)y + (size_t)height,
                                (size_t)camera->height, renderer->caller_mode))
            status = sgsi_fail(SGS_STATUS_CANCELLED, "rendering was cancelled");
    }
    return status;
}

sgs_status sgs_renderer_render_deep(sgs_renderer *renderer, const sgs_camera *camera,
                                    const sgs_pose *pose, const sgs_render_options *options,
                                    const sgs_deep_options *deep, sgs_frame *frame,
                                    sgs_deep_rows_fn rows, void *context)
{
    renderer->caller_mode = sgsi_float_mode_enter();
    const sgs_status status =
        render_deep(renderer, camera, pose, options, deep, frame, rows, context);
    sgsi_float_mode_set(renderer->caller_mode);
    return status;
}

// ---- Gradients ----

typedef struct gradient_job {
    const sgsi_optimize *input;
    float *out; // model layout
} gradient_job;

// The chain rule for blocks with a hit. Rows without a hit get zero gradients, also if the chain
// rule gives NaN (a primitive at the camera centre has no direction).
static void finish_blocks(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const gradient_job *job = context;
    const sgsi_optimize *input = job->input;
    for (size_t block = begin; block < end; ++block) {
        float *out = job->out + block * SGS_PARAM_COUNT * SGS_LANES;
        if (!input->touched[block]) {
            memset(out, 0, SGS_PARAM_COUNT * SGS_LANES * sizeof *out);
            continue;
        }
        sgsi_optimize_blocks(input, block, block + 1);
        for (size_t lane = 0; lane < SGS_LANES; ++lane) {
            const float *sums = input->sums + (block * SGS_LANES + lane) * SGSI_PROJECTED_FLOATS;
            for (int k = 0; k < SGS_PARAM_COUNT && !(sums[SGSI_GRAD_SUM_WEIGHT] > 0.0f); ++k)
                out[(size_t)k * SGS_LANES + lane] = 0.0f;
        }
    }
}

static sgs_status check_gradients(const sgs_renderer *renderer, const sgs_frame *d_frame,
                                  const sgs_gaussians *d_model)
{
    if (!renderer->differentiable)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "no rendering to differentiate: set sgs_render_options.differentiable");
    const sgs_camera *camera = &renderer->view.rays->camera;
    if (d_frame->width != camera->width || d_frame->height != camera->height)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "the gradient has %dx%d pixels but the rendering %dx%d", d_frame->width,
                         d_frame->height, camera->width, camera->height);
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < aovs[i].channels; ++c)
            if (aovs[i].bit && sgs_aov_plane(&aovs[i], d_frame, c))
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                                 "only colour and transmittance have gradients; leave the other "
                                 "planes of the frame NULL");
    if (d_model->count != renderer->model->count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "the gradient has %zu primitives but the model %zu", d_model->count,
                         renderer->model->count);
    return SGS_STATUS_OK;
}

static sgs_status backward(sgs_renderer *renderer, const sgs_frame *d_frame, sgs_gaussians *d_model)
{
    sgs_status status = check_gradients(renderer, d_frame, d_model);
    if (status)
        return status;
    const size_t pixels = (size_t)d_frame->width * (size_t)d_frame->height;
    if (renderer->zero_count < pixels) {
        sgsi_free(renderer->zeros);
        renderer->zeros = sgsi_calloc(pixels, sizeof *renderer->zeros);
        renderer->zero_count = renderer->zeros ? pixels : 0;
        if (!renderer->zeros)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for a gradient of %dx%d pixels", d_frame->width,
                             d_frame->height);
    }
    float *d_color[3];
    for (int c = 0; c < 3; ++c)
        d_color[c] = d_frame->color[c] ? d_frame->color[c] : renderer->zeros;
    const sgsi_planes sizes = {
        .width = d_frame->width, .height = d_frame->height, .stride = (size_t)d_frame->width};
    status =
        sgsi_tracer_backward(renderer->tracer, &renderer->view, &sizes, d_color,
                             d_frame->transmittance ? d_frame->transmittance : renderer->zeros);
    if (status)
        return status;
    const sgs_gaussians *model = renderer->model;
    renderer->view.linear_opacity = model->linear_opacity;
    const sgsi_optimize input = {.params = model->data,
                                 .count = model->count,
                                 .view = renderer->view,
                                 .sums = sgsi_tracer_grad_sums(renderer->tracer),
                                 .touched = sgsi_tracer_touched(renderer->tracer),
                                 .gradients = d_model->data};
    gradient_job job = {&input, d_model->data};
    sgsi_parallel_ranges((model->count + SGS_LANES - 1) / SGS_LANES, 32, finish_blocks, &job);
    d_model->sh_degree = model->sh_degree;
    d_model->linear_opacity = model->linear_opacity;
    return SGS_STATUS_OK;
}

sgs_status sgs_renderer_backward(sgs_renderer *renderer, const sgs_frame *d_frame,
                                 sgs_gaussians *d_model)
{
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    const sgs_status status = backward(renderer, d_frame, d_model);
    sgsi_float_mode_set(mode);
    return status;
}
