// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Rendering with a model that is divided among ranks: the stages of train_view.h up to the image,
// on the rows that each rank owns. Used to evaluate the model that a training run has saved.

#include "sparegs/rank_renderer.h"

#include <string.h>

#include "base/core.h"
#include "base/row_groups.h"
#include "cluster/row_streams.h"
#include "ply/ply_parts.h"
#include "train/train_view.h"
#include "train/view_ranks.h"

struct sgs_rank_renderer {
    sgs_gaussians *model; // the own rows
    sgsi_train_views views;
    sgs_train_seconds seconds;
};

// ---- The model ----

// What rank 0 sends to the others before the rows.
typedef struct model_head {
    uint64_t count;
    int64_t sh_degree;
} model_head;

// Rank 0 reads the file.
typedef struct model_reader {
    sgsi_ply_source *source;
    sgs_gaussians *part;
    size_t left; // rows
    sgs_status status;
} model_reader;

// The next whole blocks of the model.
static void give_blocks(void *context, void *bytes, size_t size)
{
    model_reader *reader = context;
    const size_t room = size / SGSI_BLOCK_BYTES * SGS_LANES;
    const size_t rows = room < reader->left ? room : reader->left;
    reader->left -= rows;
    if (!reader->status)
        reader->status = sgs_gaussians_resize(reader->part, 0);
    if (!reader->status)
        reader->status = sgs_gaussians_resize(reader->part, rows);
    if (reader->status) {
        memset(bytes, 0, size);
        return;
    }
    sgsi_ply_source_next(reader->source, reader->part);
    memcpy(bytes, reader->part->data, size);
}

// The status is the same on all ranks.
static sgs_status share_head(sgs_ranks *ranks, const char *path, model_reader *reader,
                             model_head *head)
{
    size_t count = 0;
    int sh_degree = 0;
    sgs_status own = SGS_STATUS_OK;
    if (!sgs_ranks_rank(ranks)) {
        own = sgsi_ply_source_open(path, &reader->source, &count, &sh_degree);
        if (!own)
            own = sgs_gaussians_create(SGS_LANES, &reader->part);
    }
    *head = (model_head){count, sh_degree};
    return sgsi_ranks_copy(ranks, own, SGS_RANKS_OTHER, head, sizeof *head);
}

static sgs_status share_model(sgs_rank_renderer *renderer, sgs_ranks *ranks, const char *path)
{
    model_reader reader = {0};
    model_head head;
    sgs_status status = share_head(ranks, path, &reader, &head);
    if (!status) {
        const size_t own =
            sgsi_shard_count((size_t)head.count, sgs_ranks_rank(ranks), sgs_ranks_count(ranks));
        sgs_status made = sgs_gaussians_create(own + SGS_LANES, &renderer->model);
        if (!made)
            made = sgs_gaussians_resize(renderer->model, own);
        reader.left = (size_t)head.count;
        const sgsi_row_array array =
            sgsi_block_array(made ? NULL : renderer->model->data, (size_t)head.count);
        status = sgsi_rows_distribute(ranks, made, &array, give_blocks, &reader);
    }
    if (!status)
        renderer->model->sh_degree = (int)head.sh_degree;
    sgs_status read = reader.source ? sgsi_ply_source_close(reader.source) : SGS_STATUS_OK;
    if (!read)
        read = reader.status;
    sgs_gaussians_destroy(reader.part);
    return status ? status : sgs_ranks_agree(ranks, read);
}

// ---- Creation ----

static sgs_status create_views(sgs_rank_renderer *renderer, sgs_ranks *ranks,
                               const sgs_scene *scene, const sgs_render_options *options)
{
    sgs_render_options own = sgs_render_options_default();
    own.near_distance = sgs_near_distance(scene->extent);
    sgs_status status = sgsi_options_read(options, "sgs_render_options", &own, sizeof own);
    own.filter_3d = NULL;
    if (!status)
        status = sgsi_render_options_check(&own);
    if (!status && sgs_ranks_count(ranks) < 2)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "rendering on ranks requires two or more");
    if (!status)
        status = sgsi_drawn_views_create(scene, &own, &renderer->views);
    return status ? status : sgsi_view_ranks_create(&renderer->views, ranks);
}

sgs_status sgs_rank_renderer_create(sgs_ranks *ranks, const sgs_scene *scene, const char *path,
                                    const sgs_render_options *options, sgs_rank_renderer **renderer)
{
    *renderer = NULL;
    sgs_rank_renderer *made = sgsi_calloc(1, sizeof *made);
    sgs_status status =
        made ? create_views(made, ranks, scene, options)
             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to render on several ranks");
    status = sgs_ranks_agree(ranks, status);
    if (!status)
        status = share_model(made, ranks, path);
    if (status) {
        sgs_rank_renderer_destroy(made);
        return status;
    }
    *renderer = made;
    return SGS_STATUS_OK;
}

void sgs_rank_renderer_destroy(sgs_rank_renderer *renderer)
{
    if (!renderer)
        return;
    sgsi_train_views_free(&renderer->views);
    sgs_gaussians_destroy(renderer->model);
    sgsi_free(renderer);
}

// ---- A view ----

static void copy_plane(const sgsi_planes *planes, const float *from, float *to)
{
    const size_t width = (size_t)planes->width;
    for (size_t y = 0; y < (size_t)planes->height && to; ++y)
        memcpy(to + y * width, from + y * planes->stride, width * sizeof *to);
}

static sgs_status check_frame(const sgs_scene *scene, size_t view, const sgs_frame *frame)
{
    const sgs_camera *camera = &scene->views[view].camera;
    return frame->width == camera->width && frame->height == camera->height
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "frame size %dx%d differs from the camera's, %dx%d", frame->width,
                           frame->height, camera->width, camera->height);
}

sgs_status sgs_rank_renderer_render(sgs_rank_renderer *renderer, sgs_status own, size_t view,
                                    int receiver, sgs_frame *frame)
{
    sgsi_train_views *views = &renderer->views;
    const bool receives = sgs_ranks_rank(views->ranks) == receiver;
    if (!own && view >= views->scene->view_count)
        own = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the scene has no view %zu, only %zu views",
                        view, views->scene->view_count);
    if (!own && receives)
        own = check_frame(views->scene, view, frame);
    sgs_status status = sgs_ranks_agree(views->ranks, own);
    if (status)
        return status;
    sgsi_train_view drawn = {.index = view,
                             .model = renderer->model,
                             .sh_degree = views->render.sh_degree,
                             .seconds = &renderer->seconds,
                             .need = SGSI_IMAGE_ONE,
                             .receiver = receiver,
                             .source = &views->scene->views[view],
                             .camera = views->scene->views[view].camera};
    status = sgsi_train_view_project(views, &drawn);
    if (!status)
        status = sgsi_train_view_forward(views, &drawn);
    status = sgs_ranks_agree(views->ranks, status);
    if (status || !receives)
        return status;
    for (int c = 0; c < 3; ++c)
        copy_plane(&drawn.planes, drawn.planes.color[c], frame->color[c]);
    copy_plane(&drawn.planes, drawn.planes.transmittance, frame->transmittance);
    return SGS_STATUS_OK;
}
