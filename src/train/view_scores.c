// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "train/view_scores.h"

#include <math.h>
#include <string.h>

#include "model/opacity.h"
#include "base/core.h"
#include "base/threads.h"
#include "cluster/row_streams.h"
#include "density/plane_range.h"
#include "image/mask.h"
#include "image/photo.h"
#include "sparegs/image.h"

void sgsi_view_scores_free(sgsi_view_scores *scores)
{
    sgsi_statistics_free(&scores->view);
    const sgsi_score_columns *columns = &scores->columns;
    void *const arrays[] = {
        scores->importance, scores->prune_score, scores->gradient, scores->opacity, scores->volume,
        scores->depth,      scores->centers,     scores->error,    scores->weight,  scores->bytes,
        columns->gradient,  columns->opacity,    columns->volume,  columns->depth,  columns->radius,
        columns->sums,      columns->touched};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    *scores = (sgsi_view_scores){0};
}

static bool grow_columns(sgsi_view_scores *scores, size_t capacity, size_t whole, bool shared)
{
    sgsi_score_columns *all = &scores->columns;
    float **const own[] = {&scores->gradient, &scores->opacity, &scores->volume, &scores->depth};
    float **const wide[] = {&all->gradient, &all->opacity, &all->volume, &all->depth, &all->radius};
    bool complete = true;
    for (size_t i = 0; i < sizeof own / sizeof *own; ++i)
        complete = (*own[i] = sgsi_alloc(capacity, sizeof(float))) && complete;
    for (size_t i = 0; i < sizeof wide / sizeof *wide && shared; ++i)
        complete = (*wide[i] = sgsi_alloc(whole, sizeof(float))) && complete;
    if (shared) {
        all->sums = sgsi_alloc(whole, SGSI_PROJECTED_FLOATS * sizeof(float));
        all->touched = sgsi_alloc(whole / SGS_LANES + 1, 1);
        complete = complete && all->sums && all->touched;
    }
    scores->importance = sgsi_alloc(whole, sizeof(float));
    scores->prune_score = sgsi_alloc(whole, sizeof(float));
    scores->centers = sgsi_alloc(capacity, 2 * sizeof(float));
    scores->capacity = capacity;
    scores->whole_capacity = whole;
    return complete && scores->centers && scores->importance && scores->prune_score &&
           !sgsi_statistics_reserve(&scores->view, capacity);
}

// Allocates for `capacity` primitives, `whole` of all ranks, and planes of plane_floats; zeroes the
// scores.
static sgs_status reserve(sgsi_view_scores *scores, size_t capacity, size_t whole,
                          size_t plane_floats, bool shared)
{
    if (capacity > scores->capacity || whole > scores->whole_capacity ||
        plane_floats > scores->plane_floats) {
        sgsi_view_scores_free(scores);
        scores->error = sgsi_calloc(plane_floats, sizeof *scores->error);
        scores->weight = sgsi_calloc(plane_floats, sizeof *scores->weight);
        scores->plane_floats = plane_floats;
        if (!grow_columns(scores, capacity, whole, shared) || !scores->error || !scores->weight) {
            sgsi_view_scores_free(scores);
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for the scores of %zu primitives", whole);
        }
    }
    memset(scores->importance, 0, whole * sizeof(float));
    memset(scores->prune_score, 0, whole * sizeof(float));
    return SGS_STATUS_OK;
}

typedef struct column_job {
    const sgsi_score_input *input;
    sgsi_view_scores *scores;
    const sgsi_train_view *view; // NULL for the columns of all views
} column_job;

// Columns that do not depend on the view.
static void fill_columns(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const column_job *job = context;
    const sgs_gaussians *model = job->input->model;
    const sgsi_statistics *statistics = job->input->statistics;
    sgsi_view_scores *s = job->scores;
    for (size_t i = begin; i < end; ++i) {
        const uint32_t seen = statistics->visible_count[i];
        s->gradient[i] = seen ? statistics->gradient_sum[i] / (float)seen : 0.0f;
        s->opacity[i] = sgsi_gaussians_opacity(model, i);
        float size = 0.0f;
        for (int k = 0; k < 3; ++k)
            size += *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
        s->volume[i] = expf(size);
    }
}

// View depth and projected centre of the primitives in view.
static void fill_view(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const column_job *job = context;
    sgsi_view_scores *s = job->scores;
    for (size_t i = begin; i < end; ++i) {
        double point[3], pixel[2] = {0, 0};
        for (int row = 0; row < 3; ++row) {
            point[row] = job->view->source->pose.translation[row];
            for (int k = 0; k < 3; ++k)
                point[row] += job->view->source->pose.rotation[3 * row + k] *
                              (double)*sgs_gaussians_at(job->input->model, i, SGS_PARAM_MEAN + k);
        }
        const bool visible = s->view.radius_max[i] > 0.0f;
        s->depth[i] = visible ? (float)point[2] : 0.0f;
        if (!visible || !sgs_camera_project(&job->view->camera, point, pixel))
            pixel[0] = pixel[1] = 0.0;
        s->centers[2 * i] = (float)pixel[0];
        s->centers[2 * i + 1] = (float)pixel[1];
    }
}

// The colours of the photo in 8 bits, over the background: those of transparent pixels do not
// count. Half-float values are clamped to [0, 1].
static const uint8_t *photo_bytes(sgsi_view_scores *scores, const sgsi_train_view *view)
{
    const sgs_photo *photo = view->target;
    if (!photo->halves && photo->channels == 3)
        return photo->pixels;
    const size_t values = 3 * (size_t)photo->width * (size_t)photo->height;
    if (values > scores->byte_capacity) {
        sgsi_free(scores->bytes);
        scores->bytes = sgsi_alloc(values, 1);
        scores->byte_capacity = scores->bytes ? values : 0;
    }
    if (scores->bytes)
        sgsi_photo_over_bytes(photo, view->background, scores->bytes);
    return scores->bytes;
}

typedef struct error_job {
    sgsi_loss_input drawn;
    float *error;
} error_job;

static void fill_error(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const error_job *job = context;
    const sgsi_loss_input *drawn = &job->drawn;
    const sgs_photo *target = drawn->target;
    const size_t width = (size_t)drawn->width;
    const float most = target->is_hdr ? INFINITY : 1.0f;
    for (size_t y = begin; y < end; ++y)
        for (size_t x = 0; x < width; ++x) {
            const size_t at = y * drawn->stride + x;
            float sum = 0.0f;
            for (int c = 0; c < 3; ++c) {
                const float value =
                    drawn->color[c][at] + drawn->transmittance[at] * drawn->background[c];
                const float photo =
                    sgsi_photo_over(target, (size_t)c, y * width + x, drawn->background);
                sum += fabsf(fminf(fmaxf(value, 0.0f), most) - photo);
            }
            job->error[at] = sgs_mask_is_valid(target->valid_mask, target->width, (int)x, (int)y)
                                 ? sum / 3.0f
                                 : 0.0f;
        }
}

// The mean over channels of |image - photo|, both in [0, 1], or >= 0 for an HDR photo.
// The image has the exposure of the photo.
static sgsi_scored_image error_image(const sgsi_train_views *views, const sgsi_train_view *view,
                                     const uint8_t *bytes, float *error)
{
    const sgsi_planes *planes = &view->planes;
    error_job job = {
        .drawn = {.width = planes->width,
                  .height = planes->height,
                  .stride = planes->stride,
                  .color = {planes->color[0], planes->color[1], planes->color[2]},
                  .transmittance = planes->transmittance,
                  .target = view->target,
                  .background = {view->background[0], view->background[1], view->background[2]}},
        .error = error};
    if (views->exposure)
        sgsi_exposure_forward(views->exposure, view->index, &job.drawn);
    sgsi_parallel_ranges((size_t)planes->height, 8, fill_error, &job);
    const sgsi_plane_range range =
        sgsi_plane_range_find(error, planes->width, planes->height, planes->stride);
    return (sgsi_scored_image){.width = planes->width,
                               .height = planes->height,
                               .stride = planes->stride,
                               .error = error,
                               .error_min = range.least,
                               .error_max = range.most,
                               .pixels = bytes};
}

// Weights of the pixels for the sums; 0 for invalid pixels.
static sgs_status weigh_pixels(const sgsi_train_views *views, const sgsi_pipeline *pipeline,
                               const sgsi_train_view *view, sgsi_view_scores *scores)
{
    const sgs_photo *target = view->target;
    const uint8_t *bytes = photo_bytes(scores, view);
    if (!bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for an image of %dx%d pixels",
                         target->width, target->height);
    const sgsi_scored_image image = error_image(views, view, bytes, scores->error);
    const sgs_status status = pipeline->pixel_weights(&image, views->options, scores->weight);
    for (int y = 0; y < image.height && target->valid_mask; ++y)
        for (int x = 0; x < image.width; ++x)
            if (!sgs_mask_is_valid(target->valid_mask, target->width, x, y))
                scores->weight[(size_t)y * image.stride + (size_t)x] = 0.0f;
    return status;
}

// The scored view of the rows of all ranks, whose columns medians and quantiles need.
static sgs_status gather_view(sgsi_train_views *views, const sgsi_score_input *input,
                              sgsi_view_scores *scores, sgsi_scored_view *scored)
{
    const sgsi_score_columns *all = &scores->columns;
    const size_t n = input->whole_count, blocks = (n + SGS_LANES - 1) / SGS_LANES;
    const struct {
        const void *own;
        void *whole;
        size_t size, rows, group;
    } columns[] = {{scored->gradient, all->gradient, 4, n, SGSI_SHARD_ROWS},
                   {scored->opacity, all->opacity, 4, n, SGSI_SHARD_ROWS},
                   {scored->volume, all->volume, 4, n, SGSI_SHARD_ROWS},
                   {scored->depth, all->depth, 4, n, SGSI_SHARD_ROWS},
                   {scored->radius, all->radius, 4, n, SGSI_SHARD_ROWS},
                   {scored->sums, all->sums, 64, n, SGSI_SHARD_ROWS},
                   {scored->touched, all->touched, 1, blocks, SGSI_SHARD_ROWS / SGS_LANES}};
    sgs_status status = SGS_STATUS_OK;
    for (size_t k = 0; k < sizeof columns / sizeof *columns && !status; ++k) {
        const sgsi_row_array array = {(void *)columns[k].own, columns[k].group * columns[k].size,
                                      columns[k].rows * columns[k].size};
        status = sgsi_rows_gather(views->ranks, status, SGS_RANKS_SCORES, &array, columns[k].whole);
    }
    *scored = (sgsi_scored_view){.count = n,
                                 .loss = scored->loss,
                                 .sums = all->sums,
                                 .touched = all->touched,
                                 .depth = all->depth,
                                 .radius = all->radius,
                                 .gradient = all->gradient,
                                 .opacity = all->opacity,
                                 .volume = all->volume};
    return status;
}

static sgs_status score_view(sgsi_train_views *views, const sgsi_score_input *input, size_t index,
                             sgsi_view_scores *scores)
{
    const size_t n = input->count;
    sgs_train_seconds ignored = {0}; // the caller times scoring as density control
    sgsi_train_view view = {.iteration = input->iteration,
                            .index = index,
                            .model = input->model,
                            .filter_3d = input->filter_3d,
                            .sh_degree = input->sh_degree,
                            .visible_count = scores->view.visible_count,
                            .radius_max = scores->view.radius_max,
                            .seconds = &ignored,
                            .need = SGSI_IMAGE_ALL};
    sgsi_statistics_clear(&scores->view, scores->capacity);
    sgs_status status = sgsi_train_view_fetch(views, &view);
    if (!status)
        status = sgsi_train_view_project(views, &view);
    if (!status)
        status = sgsi_train_view_forward(views, &view);
    if (!status)
        status = sgsi_train_view_loss(views, &view);
    if (status)
        return status;
    column_job job = {input, scores, &view};
    sgsi_parallel_ranges(n, 4096, fill_view, &job);
    if (input->model->count > n) // rows outside of a region have no scores
        memset(scores->centers + 2 * n, 0, 2 * (input->model->count - n) * sizeof(float));
    status = weigh_pixels(views, input->pipeline, &view, scores);
    if (status)
        return status;
    const sgsi_score_planes planes = {.weight = scores->weight, .centers = scores->centers};
    status = sgsi_train_view_score(views, &view, &planes);
    sgsi_scored_view scored = {.count = n,
                               .loss = view.loss.loss,
                               .sums = sgsi_tracer_grad_sums(views->rows),
                               .touched = sgsi_tracer_touched(views->rows),
                               .depth = scores->depth,
                               .radius = scores->view.radius_max,
                               .gradient = scores->gradient,
                               .opacity = scores->opacity,
                               .volume = scores->volume};
    if (!status && views->view_ranks)
        status = gather_view(views, input, scores, &scored);
    if (!status)
        input->pipeline->score_view(&scored, scores->importance, scores->prune_score);
    return status;
}

// Draws `wanted` different ones of n views.
static void draw_views(uint64_t seed, size_t n, size_t wanted, size_t *drawn)
{
    for (size_t k = 0; k < wanted; ++k) {
        bool fresh = false;
        for (uint64_t attempt = 0; !fresh; ++attempt) { // until the view is not drawn yet
            drawn[k] = (size_t)(sgsi_random_uniform(seed, 4096 * k + attempt) * (double)n);
            fresh = drawn[k] < n;
            for (size_t j = 0; j < k; ++j)
                fresh = fresh && drawn[j] != drawn[k];
        }
    }
}

sgs_status sgsi_view_scores_compute(sgsi_train_views *views, const sgsi_score_input *input,
                                    sgsi_view_scores *scores)
{
    const sgsi_pipeline *pipeline = input->pipeline;
    enum { MAX_DRAWN = 64 };
    size_t drawn[MAX_DRAWN];
    const size_t n = views->count;
    size_t wanted = (size_t)pipeline->score_views < n ? (size_t)pipeline->score_views : n;
    wanted = wanted < MAX_DRAWN ? wanted : MAX_DRAWN;
    const bool shared = views->view_ranks != NULL;
    sgs_status status = reserve(scores, input->model->capacity,
                                shared ? input->whole_count + 1 : input->model->capacity,
                                views->plane_floats, shared);
    if (status)
        return status;
    column_job job = {input, scores, NULL};
    sgsi_parallel_ranges(input->count, 4096, fill_columns, &job);
    const uint64_t seed =
        sgsi_random_bits(views->options->seed ^ 0x5C08E, (uint64_t)input->iteration);
    draw_views(seed, n, wanted, drawn);
    const size_t ahead = views->targets ? 0 : sgs_scene_prefetch_count(views->scene);
    for (size_t k = 0; k < wanted && !status; ++k) {
        for (size_t j = k + 1; j <= k + ahead && j < wanted; ++j)
            sgs_scene_prefetch(views->scene, views->scene_views[drawn[j]]);
        status = score_view(views, input, drawn[k], scores);
    }
    if (!status && pipeline->finish_scores)
        pipeline->finish_scores(input->whole_count, (int)wanted, scores->importance,
                                scores->prune_score);
    return status;
}
