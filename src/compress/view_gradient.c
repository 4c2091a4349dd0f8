// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "compress/view_gradient.h"

#include <string.h>

static const float SSIM_WEIGHT = 0.2f;

sgs_status sgsi_view_gradient_create(const sgsi_compress_job *job, const sgs_gaussians *model,
                                     bool photos, sgsi_view_gradient *views)
{
    const sgs_scene *scene = job->options->scene;
    *views = (sgsi_view_gradient){.scene = scene, .render = job->render};
    memcpy(views->background, job->options->background, sizeof views->background);
    views->render.progress = NULL;
    views->views = sgsi_alloc(scene->view_count + 1, sizeof *views->views);
    views->order = sgsi_alloc(scene->view_count + 1, sizeof *views->order);
    if (!views->views || !views->order)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu views",
                         scene->view_count);
    for (size_t i = 0; i < scene->view_count; ++i)
        if (scene->views[i].split == SGS_SPLIT_TRAIN && (scene->views[i].image.width || !photos))
            views->views[views->count++] = i;
    if (!views->count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: no training view%s", scene->path,
                         photos ? " with an image for the fine-tuning" : "");
    sgs_status status = sgs_renderer_create(model, &views->renderer);
    if (!status)
        status = sgs_gaussians_create(model->count, &views->d_model);
    if (!status)
        status = sgs_gaussians_resize(views->d_model, model->count);
    if (!status)
        status = sgsi_loss_create(&views->loss);
    return status;
}

void sgsi_view_gradient_free(sgsi_view_gradient *views)
{
    sgs_renderer_destroy(views->renderer);
    sgs_gaussians_destroy(views->d_model);
    sgsi_loss_destroy(views->loss);
    sgs_frame_free(&views->frame);
    sgs_frame_free(&views->d_frame);
    sgsi_free(views->planes);
    sgsi_free(views->views);
    sgsi_free(views->order);
    *views = (sgsi_view_gradient){0};
}

size_t sgsi_view_gradient_next(sgsi_view_gradient *views, uint64_t seed, int step)
{
    const size_t at = (size_t)step - 1, position = at % views->count;
    if (!position)
        sgsi_random_permutation(sgsi_random_bits(seed, at / views->count), views->count,
                                views->order);
    return views->order[position];
}

static size_t stride_of(int width)
{
    return ((size_t)width + 15) / 16 * 16;
}

static sgs_status reserve(sgsi_view_gradient *views, int width, int height)
{
    if (views->frame.width == width && views->frame.height == height)
        return SGS_STATUS_OK;
    sgs_frame_free(&views->frame);
    sgs_frame_free(&views->d_frame);
    sgsi_free(views->planes);
    views->planes = sgsi_calloc(stride_of(width) * (size_t)height, 8 * sizeof(float));
    if (!views->planes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for images of %dx%d pixels",
                         width, height);
    sgs_status status = sgs_frame_create_with(width, height, 0, &views->frame);
    if (!status)
        status = sgs_frame_create_with(width, height, 0, &views->d_frame);
    if (!status)
        status = sgsi_loss_reserve(views->loss, width, height);
    return status;
}

// Moves a plane between the strides of renderer and loss.
static void copy_plane(float *to, size_t to_stride, const float *from, size_t from_stride,
                       const sgs_frame *size)
{
    for (size_t y = 0; y < (size_t)size->height; ++y)
        memcpy(to + y * to_stride, from + y * from_stride, (size_t)size->width * sizeof *to);
}

static sgs_status evaluate_loss(sgsi_view_gradient *views, const sgs_photo *photo,
                                sgsi_loss_output *out)
{
    const size_t width = (size_t)views->frame.width, stride = stride_of(views->frame.width);
    const size_t plane = stride * (size_t)views->frame.height;
    float *p[8];
    for (size_t k = 0; k < 8; ++k)
        p[k] = views->planes + k * plane;
    for (int c = 0; c < 3; ++c)
        copy_plane(p[c], stride, views->frame.color[c], width, &views->frame);
    copy_plane(p[3], stride, views->frame.transmittance, width, &views->frame);
    const sgsi_loss_input input = {
        .width = views->frame.width,
        .height = views->frame.height,
        .stride = stride,
        .color = {p[0], p[1], p[2]},
        .transmittance = p[3],
        .background = {views->background[0], views->background[1], views->background[2]},
        .target = photo,
        .ssim_weight = SSIM_WEIGHT};
    *out = (sgsi_loss_output){.d_color = {p[4], p[5], p[6]}, .d_transmittance = p[7]};
    const sgs_status status = sgsi_loss_evaluate(views->loss, &input, out);
    if (status)
        return status;
    for (int c = 0; c < 3; ++c)
        copy_plane(views->d_frame.color[c], width, p[4 + c], stride, &views->frame);
    copy_plane(views->d_frame.transmittance, width, p[7], stride, &views->frame);
    return SGS_STATUS_OK;
}

sgs_status sgsi_view_gradient_compare(sgsi_view_gradient *views, const sgs_camera *camera,
                                      const sgs_pose *pose, const sgs_photo *photo, bool gradient,
                                      double *mse)
{
    views->render.differentiable = gradient;
    sgs_status status = reserve(views, camera->width, camera->height);
    if (!status)
        status = sgs_renderer_render(views->renderer, camera, pose, &views->render, &views->frame);
    sgsi_loss_output out;
    if (!status)
        status = evaluate_loss(views, photo, &out);
    if (status)
        return status;
    *mse = out.mse;
    return gradient ? sgs_renderer_backward(views->renderer, &views->d_frame, views->d_model)
                    : SGS_STATUS_OK;
}

sgs_status sgsi_view_gradient_evaluate(sgsi_view_gradient *views, size_t k, bool gradient,
                                       double *mse)
{
    const sgs_view *view = &views->scene->views[views->views[k]];
    const sgs_photo *photo = NULL;
    const sgs_status status = sgs_scene_photo(views->scene, views->views[k], &photo);
    return status ? status
                  : sgsi_view_gradient_compare(views, &view->camera, &view->pose, photo, gradient,
                                               mse);
}
