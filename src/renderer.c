// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The public renderer: one tracer, one ray cache, a model somebody else owns.

#include <stdlib.h>
#include <string.h>

#include "core.h"
#include "rays.h"
#include "tracer.h"

enum { RENDER_BIN_TILES = 2 };

struct sgs_renderer {
    const sgs_gaussians *model;
    sgsi_tracer *tracer;
    sgsi_ray_cache *rays;
    bool changed;
    sgsi_planes planes; // padded rows
    size_t plane_floats;
    float *plane_block;
};

sgs_render_options sgs_render_options_default(void)
{
    return (sgs_render_options){.filter = SGS_FILTER_3DGS, .near_distance = 0.2, .sh_degree = 3};
}

sgs_status sgs_frame_create(int width, int height, sgs_frame *frame)
{
    *frame = (sgs_frame){0};
    if (width < 1 || height < 1)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "a frame of %dx%d pixels is empty", width, height);
    float **const planes[] = {&frame->color[0], &frame->color[1], &frame->color[2], &frame->transmittance,
                              &frame->depth_mean, &frame->depth_median, &frame->depth_first, &frame->hits};
    for (size_t i = 0; i < sizeof planes / sizeof *planes; ++i) {
        *planes[i] = sgsi_calloc((size_t)width * (size_t)height, sizeof(float));
        if (!*planes[i]) {
            sgs_frame_free(frame);
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for a frame of %dx%d pixels", width, height);
        }
    }
    frame->width = width;
    frame->height = height;
    return SGS_STATUS_OK;
}

void sgs_frame_free(sgs_frame *frame)
{
    float *const planes[] = {frame->color[0], frame->color[1], frame->color[2], frame->transmittance,
                             frame->depth_mean, frame->depth_median, frame->depth_first, frame->hits};
    for (size_t i = 0; i < sizeof planes / sizeof *planes; ++i)
        sgsi_free(planes[i]);
    *frame = (sgs_frame){0};
}

sgs_status sgs_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer)
{
    *renderer = NULL;
    sgs_renderer *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for a renderer");
    made->model = model;
    made->changed = true;
    sgs_status status = sgsi_tracer_create(&made->tracer);
    if (!status)
        status = sgsi_ray_cache_create(RENDER_BIN_TILES, (size_t)1 << 30, &made->rays);
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
    sgsi_free(renderer->plane_block);
    sgsi_free(renderer);
}

sgs_status sgs_renderer_update(sgs_renderer *renderer)
{
    renderer->changed = true;
    return SGS_STATUS_OK;
}

static sgs_status prepare_planes(sgs_renderer *renderer, const sgs_frame *frame)
{
    const size_t stride = ((size_t)frame->width + 15) / 16 * 16, floats = stride * (size_t)frame->height;
    if (floats > renderer->plane_floats) {
        sgsi_free(renderer->plane_block);
        renderer->plane_floats = 0;
        renderer->plane_block = sgsi_calloc(floats, 8 * sizeof(float));
        if (!renderer->plane_block)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for a frame of %dx%d pixels", frame->width, frame->height);
        renderer->plane_floats = floats;
    }
    float *block = renderer->plane_block;
    renderer->planes = (sgsi_planes){.width = frame->width, .height = frame->height, .stride = stride,
                                     .color = {block, block + floats, block + 2 * floats}, .transmittance = block + 3 * floats,
                                     .depth_mean = frame->depth_mean ? block + 4 * floats : NULL,
                                     .depth_median = frame->depth_median ? block + 5 * floats : NULL,
                                     .depth_first = frame->depth_first ? block + 6 * floats : NULL,
                                     .hits = frame->hits ? block + 7 * floats : NULL};
    return SGS_STATUS_OK;
}

static void copy_plane(float *to, const float *from, const sgsi_planes *planes)
{
    if (!to || !from)
        return;
    for (int y = 0; y < planes->height; ++y)
        memcpy(to + (size_t)y * (size_t)planes->width, from + (size_t)y * planes->stride, (size_t)planes->width * sizeof *to);
}

sgs_status sgs_renderer_render(sgs_renderer *renderer, const sgs_camera *camera, const sgs_pose *pose,
                               const sgs_render_options *options, sgs_frame *frame)
{
    if (frame->width != camera->width || frame->height != camera->height)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the frame is %dx%d pixels but its camera %dx%d", frame->width,
                         frame->height, camera->width, camera->height);
    if (options->filter != SGS_FILTER_3DGS && options->filter != SGS_FILTER_NONE)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "the tracer has the pixel filters 3dgs and none");
    if (options->sh_degree < 0 || options->sh_degree > 3 || !(options->near_distance >= 0.0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "SH degree %d or near distance %g is out of range", options->sh_degree,
                         options->near_distance);
    const sgsi_rays *rays;
    sgs_status status = sgsi_ray_cache_get(renderer->rays, camera, &rays);
    if (!status)
        status = prepare_planes(renderer, frame);
    if (status)
        return status;
    sgsi_view view;
    sgsi_view_set(&view, rays, pose, options);
    status = sgsi_tracer_project(renderer->tracer, renderer->model, &view, NULL, NULL);
    if (!status)
        status = sgsi_tracer_commit(renderer->tracer, renderer->changed, SGSI_BVH_LOW);
    if (!status)
        status = sgsi_tracer_forward(renderer->tracer, &view, &renderer->planes, NULL, false);
    if (status)
        return status;
    renderer->changed = false;
    const sgsi_planes *planes = &renderer->planes;
    for (int c = 0; c < 3; ++c)
        copy_plane(frame->color[c], planes->color[c], planes);
    copy_plane(frame->transmittance, planes->transmittance, planes);
    copy_plane(frame->depth_mean, planes->depth_mean, planes);
    copy_plane(frame->depth_median, planes->depth_median, planes);
    copy_plane(frame->depth_first, planes->depth_first, planes);
    copy_plane(frame->hits, planes->hits, planes);
    return SGS_STATUS_OK;
}
