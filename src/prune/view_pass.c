// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "prune/view_pass.h"

#include <string.h>

#include "base/core.h"
#include "rays/rays.h"

// Less than for training: every view is traced once.
static const size_t RAY_CACHE_BYTES = (size_t)1 << 28;

typedef struct view_pass {
    const sgs_gaussians *model;
    sgs_render_options render;
    int downscale;
    sgsi_tracer *tracer;
    sgsi_ray_cache *rays;
    float *planes, *filter_3d; // filter_3d: padded to whole blocks, or NULL
    size_t plane_floats;
    bool built;
} view_pass;

void sgs_view_pass_options_init(sgs_view_pass_options *options, size_t size)
{
    const sgs_view_pass_options defaults = {.downscale = 1};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

static void pass_free(view_pass *pass)
{
    sgsi_tracer_destroy(pass->tracer);
    sgsi_ray_cache_destroy(pass->rays);
    sgsi_free(pass->planes);
    sgsi_free(pass->filter_3d);
}

static sgs_status pass_create(view_pass *pass)
{
    sgs_status status = sgsi_tracer_create(&pass->tracer);
    if (!status)
        status = sgsi_ray_cache_create(RAY_CACHE_BYTES, 0, &pass->rays);
    if (status || pass->render.filter != SGS_FILTER_MIP || !pass->render.filter_3d)
        return status;
    pass->filter_3d = sgsi_calloc(pass->model->capacity, sizeof *pass->filter_3d);
    if (!pass->filter_3d)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the 3D filter of %zu primitives",
                         pass->model->count);
    memcpy(pass->filter_3d, pass->render.filter_3d, pass->model->count * sizeof(float));
    return SGS_STATUS_OK;
}

static sgs_status reserve_planes(view_pass *pass, const sgs_camera *camera, sgsi_planes *planes)
{
    const size_t stride = ((size_t)camera->width + 15) / 16 * 16;
    const size_t floats = stride * (size_t)camera->height;
    if (floats > pass->plane_floats) {
        sgsi_free(pass->planes);
        pass->planes = sgsi_alloc(floats, 4 * sizeof *pass->planes);
        pass->plane_floats = pass->planes ? floats : 0;
        if (!pass->planes)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for an image of %dx%d pixels", camera->width,
                             camera->height);
    }
    float *p = pass->planes;
    *planes = (sgsi_planes){.width = camera->width,
                            .height = camera->height,
                            .stride = stride,
                            .color = {p, p + floats, p + 2 * floats},
                            .transmittance = p + 3 * floats};
    return SGS_STATUS_OK;
}

static sgs_status trace_view(view_pass *pass, const sgs_view *source, sgsi_traced_view_fn visit,
                             void *context)
{
    const int divisor = pass->downscale;
    sgs_camera camera = source->camera;
    if (divisor > 1)
        camera = sgs_camera_resized(&camera, (camera.width + divisor - 1) / divisor,
                                    (camera.height + divisor - 1) / divisor);
    const sgsi_rays *rays;
    sgs_status status = sgsi_ray_cache_get(pass->rays, &camera, &rays);
    sgsi_planes planes;
    if (!status)
        status = reserve_planes(pass, &camera, &planes);
    if (status)
        return status;
    sgs_render_options render = pass->render;
    render.filter_3d = pass->filter_3d;
    sgsi_view view;
    sgsi_view_set(&view, rays, &source->pose, &render);
    view.linear_opacity = pass->model->linear_opacity;
    status = sgsi_tracer_project(pass->tracer, pass->model, &view, NULL, NULL);
    if (!status)
        status = sgsi_tracer_commit(pass->tracer, !pass->built, SGSI_BVH_REFIT);
    if (!status)
        status = sgsi_tracer_forward(pass->tracer, &view, &planes, NULL, true);
    if (status)
        return status;
    pass->built = true;
    const sgsi_traced_view traced = {.model = pass->model,
                                     .tracer = pass->tracer,
                                     .view = &view,
                                     .planes = &planes,
                                     .camera = &camera,
                                     .pose = &source->pose,
                                     .render = &render};
    return visit(context, &traced);
}

static sgs_status read_options(const sgs_scene *scene, const sgs_view_pass_options *options,
                               sgs_render_options *render)
{
    *render = sgs_render_options_default();
    render->near_distance = sgs_near_distance(scene->extent);
    const sgs_status status =
        sgsi_options_read(options->render, "sgs_render_options", render, sizeof *render);
    if (status)
        return status;
    if (options->downscale < 1 || options->downscale > 1024)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "downscale %d is not in [1, 1024]",
                         options->downscale);
    return sgsi_render_options_check(render);
}

sgs_status sgsi_view_pass(const sgs_gaussians *model, const sgs_scene *scene,
                          const sgs_view_pass_options *options, sgsi_traced_view_fn visit,
                          void *context)
{
    size_t total = 0, done = 0;
    view_pass pass = {.model = model, .downscale = options->downscale};
    sgs_status status = read_options(scene, options, &pass.render);
    for (size_t i = 0; i < scene->view_count; ++i)
        total += scene->views[i].split == SGS_SPLIT_TRAIN;
    if (!status && !total)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: no training views; hold out fewer",
                           scene->path ? scene->path : "scene");
    if (status)
        return status;
    status = pass_create(&pass);
    for (size_t i = 0; i < scene->view_count && !status; ++i) {
        if (scene->views[i].split != SGS_SPLIT_TRAIN)
            continue;
        status = trace_view(&pass, &scene->views[i], visit, context);
        ++done;
        if (!status && options->progress && !options->progress(options->progress_user, done, total))
            status =
                sgsi_fail(SGS_STATUS_CANCELLED, "cancelled after %zu of %zu views", done, total);
    }
    pass_free(&pass);
    return status;
}
