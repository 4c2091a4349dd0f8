// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "train/train_view.h"

#include <math.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/rank_calls.h"
#include "sparegs/runtime.h"
#include "train/small_images.h"
#include "train/view_ranks.h"
#include "train/view_shards.h"
#include "image/photo.h"

// False for views that are only rendered.
static bool are_trained(const sgsi_train_views *views)
{
    return views->options != NULL;
}

size_t sgs_train_ray_limit(uint64_t memory)
{
    const uint64_t known = memory ? memory : sgs_machine_memory(), share = known / 16;
    return known != UINT64_MAX && share > SGSI_RAY_CACHE_BYTES ? (size_t)share
                                                               : SGSI_RAY_CACHE_BYTES;
}

static sgs_status create_workspaces(sgsi_train_views *views, int width, int height, size_t planes)
{
    // Training returns to a view, other passes visit each once.
    const size_t limit = are_trained(views) ? sgs_train_ray_limit(0) : SGSI_RAY_CACHE_BYTES;
    views->plane_floats = ((size_t)width + 15) / 16 * 16 * (size_t)height;
    views->planes = sgsi_calloc_shared(views->plane_floats, planes * sizeof(float));
    if (!views->planes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for images of %dx%d pixels",
                         width, height);
    sgs_status status = sgsi_tracer_create(&views->tracer);
    views->rows = views->tracer;
    if (!status)
        status = sgsi_ray_cache_create(limit, 2 * views->count, &views->rays);
    return status;
}

static bool is_training_view(const sgs_view *view)
{
    return view->split == SGS_SPLIT_TRAIN && view->image.width;
}

static bool has_training_view(const sgs_scene *scene)
{
    bool found = false;
    for (size_t i = 0; i < scene->view_count && !found; ++i)
        found = scene->views[i].split == SGS_SPLIT_TRAIN;
    return found;
}

// The views of the scene that take part, and the size of the largest.
static sgs_status add_views(sgsi_train_views *views, int *width, int *height)
{
    const sgs_scene *scene = views->scene;
    const size_t most = scene->view_count ? scene->view_count : 1;
    views->scene_views = sgsi_calloc(most, sizeof *views->scene_views);
    views->depth_bounds = sgsi_calloc(most, sizeof *views->depth_bounds);
    views->tile_counts = sgsi_calloc(most, sizeof *views->tile_counts);
    if (!views->scene_views || !views->depth_bounds || !views->tile_counts)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu views",
                         scene->view_count);
    *width = *height = 1;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        if (are_trained(views) && !is_training_view(view))
            continue;
        const size_t k = views->count++;
        const size_t tiles = sgsi_tile_count(view->camera.width, view->camera.height);
        views->scene_views[k] = i;
        views->tile_counts[k] = tiles;
        views->depth_bounds[k] = sgsi_alloc(tiles, sizeof(float));
        if (!views->depth_bounds[k])
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu views",
                             scene->view_count);
        *width = view->camera.width > *width ? view->camera.width : *width;
        *height = view->camera.height > *height ? view->camera.height : *height;
    }
    sgsi_train_views_forget_depths(views);
    return SGS_STATUS_OK;
}

sgsi_schedule sgsi_train_schedule(const sgs_scene *scene, const sgs_train_options *options,
                                  bool random)
{
    bool loaded = false;
    for (size_t i = 0; i < scene->view_count && !loaded; ++i)
        loaded = scene->views[i].image.width;
    size_t count = 0;
    double pixels = 0.0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        if (loaded ? !is_training_view(view) : view->split != SGS_SPLIT_TRAIN)
            continue;
        ++count;
        pixels += (double)view->camera.width * view->camera.height;
    }
    count = count ? count : 1;
    const sgsi_schedule_input input = {
        .views = count, .pixels = fmax(pixels / (double)count, 1.0), .random = random};
    return sgsi_schedule_make(options, &input);
}

sgs_status sgsi_train_views_create(const sgs_scene *scene, const sgs_train_options *options,
                                   sgsi_train_views *views)
{
    int width, height;
    *views = (sgsi_train_views){.scene = scene,
                                .options = options,
                                .render = {.struct_size = sizeof views->render,
                                           .filter = options->filter,
                                           .near_distance = sgs_near_distance(scene->extent),
                                           .compact_box = options->compact_box},
                                .rebuild = true};
    sgs_status status = add_views(views, &width, &height);
    if (!status && !views->count)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           has_training_view(scene)
                               ? "%s: the training views have no photos; load the scene with "
                                 "option load_images, or set the pixels of its views"
                               : "%s: no training views; hold out fewer",
                           scene->path);
    if (!status)
        status = create_workspaces(views, width, height, 8);
    if (!status)
        status = sgsi_loss_create(&views->loss);
    if (!status)
        status = sgsi_loss_reserve(views->loss, width, height);
    if (!status && options->exposure)
        status = sgsi_exposure_create(views->count, views->plane_floats, &views->exposure);
    return status;
}

sgs_status sgsi_drawn_views_create(const sgs_scene *scene, const sgs_render_options *render,
                                   sgsi_train_views *views)
{
    int width, height;
    *views = (sgsi_train_views){.scene = scene, .render = *render, .rebuild = true};
    const sgs_status status = add_views(views, &width, &height);
    return status ? status : create_workspaces(views, width, height, 4);
}

void sgsi_train_views_free(sgsi_train_views *views)
{
    for (size_t i = 0; views->targets && i < views->count; ++i)
        sgsi_photo_free(&views->targets[i]);
    sgsi_free(views->targets);
    for (size_t i = 0; views->depth_bounds && i < views->count; ++i)
        sgsi_free(views->depth_bounds[i]);
    sgsi_view_ranks_free(views);
    sgsi_view_shards_free(views);
    sgsi_exposure_destroy(views->exposure);
    sgsi_loss_destroy(views->loss);
    sgsi_ray_cache_destroy(views->rays);
    sgsi_tracer_destroy(views->tracer);
    sgsi_small_images_free(&views->small_images);
    sgsi_free(views->scene_views);
    sgsi_free(views->depth_bounds);
    sgsi_free(views->tile_counts);
    sgsi_free(views->planes);
    *views = (sgsi_train_views){0};
}

void sgsi_train_views_forget_depths(sgsi_train_views *views)
{
    for (size_t i = 0; i < views->count; ++i)
        for (size_t t = 0; t < views->tile_counts[i]; ++t)
            views->depth_bounds[i][t] = INFINITY;
}

sgs_status sgsi_train_view_fetch(const sgsi_train_views *views, sgsi_train_view *view)
{
    const size_t scene_view = views->scene_views[view->index];
    view->source = &views->scene->views[scene_view];
    view->camera = view->source->camera;
    const bool small = views->small_images.photos != NULL;
    const double start = sgsi_seconds();
    const sgs_status status = small ? sgsi_small_images_photo(views, view->index, &view->target)
                                    : sgsi_train_view_photo(views, view->index, &view->target);
    view->seconds->image_io += sgsi_seconds() - start;
    if (!status && small)
        view->camera = sgs_camera_resized(&view->camera, view->target->width, view->target->height);
    return status;
}

static void set_planes(const sgsi_train_views *views, sgsi_train_view *view)
{
    float *block = views->planes;
    const size_t n = views->plane_floats;
    const int width = view->camera.width, height = view->camera.height;
    view->planes = (sgsi_planes){.width = width,
                                 .height = height,
                                 .stride = ((size_t)width + 15) / 16 * 16,
                                 .color = {block, block + n, block + 2 * n},
                                 .transmittance = block + 3 * n};
    if (!are_trained(views))
        return;
    for (int c = 0; c < 3; ++c)
        view->d_color[c] = block + (size_t)(4 + c) * n;
    view->d_transmittance = block + 7 * n;
}

// Divides the view among the ranks.
static sgs_status send_rows(sgsi_train_views *views, sgsi_train_view *view, sgs_status projected)
{
    if (projected)
        return projected;
    sgsi_view_ranks_cut(views, view);
    return sgsi_view_shards_send(views, view, sgsi_view_ranks_begin(views));
}

sgs_status sgsi_train_view_project(sgsi_train_views *views, sgsi_train_view *view)
{
    const sgsi_rays *rays;
    sgs_status status = sgsi_ray_cache_get(views->rays, &view->camera, &rays);
    if (status)
        return status;
    sgs_render_options options = views->render;
    options.filter_3d = view->filter_3d;
    options.sh_degree = view->sh_degree;
    sgsi_view_set(&view->view, rays, &view->source->pose, &options);
    view->view.linear_opacity = view->model->linear_opacity;
    set_planes(views, view);
    status = sgsi_tracer_project(views->rows, view->model, &view->view, view->visible_count,
                                 view->radius_max);
    if (views->view_ranks)
        status = send_rows(views, view, status);
    else if (!status)
        status = sgsi_tracer_commit(views->tracer, views->rebuild, SGSI_BVH_REFIT);
    if (status)
        return status;
    views->rebuild = false;
    const sgsi_trace_seconds spent = sgsi_tracer_seconds(views->tracer);
    view->seconds->bvh_build += spent.bvh_build;
    view->seconds->bvh_refit += spent.bvh_refit;
    const double project = sgsi_tracer_seconds(views->rows).project;
    view->seconds->project += project;
    view->seconds->forward += project;
    return SGS_STATUS_OK;
}

sgs_status sgsi_train_view_forward(sgsi_train_views *views, sgsi_train_view *view)
{
    sgs_status status = sgsi_tracer_forward(views->tracer, &view->view, &view->planes,
                                            views->depth_bounds[view->index], are_trained(views));
    if (!status && sgsi_tracer_counts(views->tracer).block_hits)
        sgs_ranks_raise(views->ranks, SGSI_RANKS_SEEN);
    if (!status && views->view_ranks)
        status = sgsi_view_ranks_image(views, view);
    const sgsi_trace_seconds spent = sgsi_tracer_seconds(views->tracer);
    view->seconds->gather += spent.gather;
    view->seconds->forward += spent.forward;
    return status;
}

static void set_background(const sgs_train_options *options, sgsi_train_view *view)
{
    for (uint64_t c = 0; c < 3; ++c)
        view->background[c] = options->background_random
                                  ? (float)sgsi_random_uniform(options->seed ^ 0xBAC6,
                                                               3 * (uint64_t)view->iteration + c)
                                  : options->background[c];
}

// Loss and exposure of the cells of this rank, then the sums of all.
static sgs_status share_loss(sgsi_train_views *views, sgsi_train_view *view,
                             const sgsi_loss_input *image, const sgsi_loss_input *compared)
{
    const sgsi_tracer_piece piece = sgsi_view_ranks_piece(views);
    sgsi_loss_sums *sums;
    double(*exposure)[SGSI_EXPOSURE] = NULL;
    sgs_status status =
        sgsi_loss_cells(views->loss, compared, piece.first, piece.last, &view->loss, &sums);
    if (!status && views->exposure)
        status = sgsi_exposure_cells(views->exposure, view->index, image, piece.first, piece.last,
                                     &view->loss, &exposure);
    if (!status)
        status = sgsi_view_ranks_sums(views, view, sums, exposure);
    if (status)
        return status;
    sgsi_loss_total(views->loss, compared, &view->loss);
    if (views->exposure)
        sgsi_exposure_total(views->exposure);
    return SGS_STATUS_OK;
}

static sgs_status evaluate_loss(sgsi_train_views *views, sgsi_train_view *view,
                                const sgsi_loss_input *image, const sgsi_loss_input *compared)
{
    if (views->view_ranks)
        return share_loss(views, view, image, compared);
    const sgs_status status = sgsi_loss_evaluate(views->loss, compared, &view->loss);
    return status || !views->exposure
               ? status
               : sgsi_exposure_backward(views->exposure, view->index, image, &view->loss);
}

sgs_status sgsi_train_view_loss(sgsi_train_views *views, sgsi_train_view *view)
{
    const double start = sgsi_seconds();
    const sgsi_planes *planes = &view->planes;
    set_background(views->options, view);
    const sgsi_loss_input image = {
        .width = planes->width,
        .height = planes->height,
        .stride = planes->stride,
        .color = {planes->color[0], planes->color[1], planes->color[2]},
        .transmittance = planes->transmittance,
        .background = {view->background[0], view->background[1], view->background[2]},
        .target = view->target,
        .ssim_weight = views->ssim_weight,
        .ssim_sigma = views->ssim_sigma,
        .alpha_weight = (float)views->options->alpha_loss,
        .opaque = views->options->opaque};
    view->loss =
        (sgsi_loss_output){.d_color = {view->d_color[0], view->d_color[1], view->d_color[2]},
                           .d_transmittance = view->d_transmittance};
    sgsi_loss_input compared = image;
    if (views->exposure)
        sgsi_exposure_forward(views->exposure, view->index, &compared);
    const sgs_status status = evaluate_loss(views, view, &image, &compared);
    view->seconds->loss += sgsi_seconds() - start;
    return status;
}

sgs_status sgsi_train_view_backward(sgsi_train_views *views, sgsi_train_view *view)
{
    sgs_status status = sgsi_tracer_backward(views->tracer, &view->view, &view->planes,
                                             view->d_color, view->d_transmittance);
    const sgsi_trace_seconds spent = sgsi_tracer_seconds(views->tracer);
    view->seconds->backward += spent.backward + spent.reduce;
    if (status || !views->view_ranks)
        return status;
    status = sgsi_view_shards_return(views, view);
    view->seconds->backward += sgsi_tracer_seconds(views->rows).reduce;
    return status;
}

sgs_status sgsi_train_view_score(sgsi_train_views *views, sgsi_train_view *view,
                                 const sgsi_score_planes *planes)
{
    sgsi_score_planes traced = *planes;
    sgs_status status = SGS_STATUS_OK;
    if (views->view_ranks)
        status = sgsi_view_shards_centers(views, planes->centers, &traced.centers);
    if (!status)
        status = sgsi_tracer_score(views->tracer, &view->view, &view->planes, &traced);
    return status || !views->view_ranks ? status : sgsi_view_shards_return(views, view);
}
