// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scores from whole views, for the pipelines that ask for them: a handful of training views is
// drawn at random, rendered, compared with the photographs and walked through once more for the
// sums per primitive. What the sums mean is the pipeline's business.

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "image/half.h"
#include "base/threads.h"
#include "train/trainer_state.h"

void sgsi_trainer_scores_free(sgsi_trainer_scores *scores)
{
    sgsi_free(scores->bytes);
    void *const arrays[] = {scores->importance,
                            scores->prune_score,
                            scores->gradient,
                            scores->opacity,
                            scores->volume,
                            scores->depth,
                            scores->centers,
                            scores->view.gradient_sum,
                            scores->view.abs_grad_sum,
                            scores->view.visible_count,
                            scores->view.radius_max};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    *scores = (sgsi_trainer_scores){0};
}

static sgs_status reserve(sgsi_trainer_scores *scores, size_t capacity)
{
    if (capacity > scores->capacity) {
        sgsi_trainer_scores_free(scores);
        float **const columns[] = {&scores->importance, &scores->prune_score, &scores->gradient,
                                   &scores->opacity,    &scores->volume,      &scores->depth};
        bool complete = true;
        for (size_t i = 0; i < sizeof columns / sizeof *columns; ++i)
            complete = (*columns[i] = sgsi_alloc(capacity, sizeof(float))) && complete;
        scores->centers = sgsi_alloc(capacity, 2 * sizeof(float));
        if (!complete || !scores->centers || sgsi_statistics_reserve(&scores->view, capacity)) {
            sgsi_trainer_scores_free(scores);
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for the scores of %zu primitives",
                             capacity);
        }
        scores->capacity = capacity;
    }
    memset(scores->importance, 0, capacity * sizeof(float));
    memset(scores->prune_score, 0, capacity * sizeof(float));
    return SGS_STATUS_OK;
}

typedef struct column_job {
    const sgs_trainer *trainer;
    sgsi_trainer_scores *scores;
    const step_state *step;
} column_job;

// What does not depend on the view.
static void fill_columns(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const column_job *job = context;
    const sgs_gaussians *model = job->trainer->model;
    const sgsi_statistics *statistics = &job->trainer->statistics;
    sgsi_trainer_scores *s = job->scores;
    for (size_t i = begin; i < end; ++i) {
        const uint32_t seen = statistics->visible_count[i];
        s->gradient[i] = seen ? statistics->gradient_sum[i] / (float)seen : 0.0f;
        s->opacity[i] = 1.0f / (1.0f + expf(-*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)));
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
    sgsi_trainer_scores *s = job->scores;
    for (size_t i = begin; i < end; ++i) {
        double point[3], pixel[2] = {0, 0};
        for (int row = 0; row < 3; ++row) {
            point[row] = job->step->source->pose.translation[row];
            for (int k = 0; k < 3; ++k)
                point[row] += job->step->source->pose.rotation[3 * row + k] *
                              (double)*sgs_gaussians_at(job->trainer->model, i, SGS_PARAM_MEAN + k);
        }
        const bool visible = s->view.radius_max[i] > 0.0f;
        s->depth[i] = visible ? (float)point[2] : 0.0f;
        if (!visible || !sgs_camera_project(&job->step->camera, point, pixel))
            pixel[0] = pixel[1] = 0.0;
        s->centers[2 * i] = (float)pixel[0];
        s->centers[2 * i + 1] = (float)pixel[1];
    }
}

static float photo_value(const sgs_photo *photo, size_t at)
{
    return photo->halves ? sgsi_half_to_float(photo->halves[at])
                         : (float)photo->pixels[at] / 255.0f;
}

// The photograph's colours as bytes: its own, or those of half-float numbers clamped to what bytes
// can say.
static const uint8_t *photo_bytes(sgsi_trainer_scores *scores, const sgs_photo *photo)
{
    if (!photo->halves)
        return photo->pixels;
    const size_t values = 3 * (size_t)photo->width * (size_t)photo->height;
    if (values > scores->byte_capacity) {
        sgsi_free(scores->bytes);
        scores->bytes = sgsi_alloc(values, 1);
        scores->byte_capacity = scores->bytes ? values : 0;
    }
    for (size_t k = 0; k < values && scores->bytes; ++k)
        scores->bytes[k] =
            (uint8_t)(255.0f * fmaxf(fminf(photo_value(photo, k), 1.0f), 0.0f) + 0.5f);
    return scores->bytes;
}

// The mean over channels of |image - photograph|, both in [0, 1], over the plane of the red
// gradient, which is free by then.
static sgsi_scored_image error_image(const step_state *step, const uint8_t *bytes, float *error)
{
    const sgsi_planes *planes = &step->planes;
    sgsi_scored_image image = {.width = planes->width,
                               .height = planes->height,
                               .stride = planes->stride,
                               .error = error,
                               .error_min = INFINITY,
                               .error_max = -INFINITY,
                               .pixels = bytes};
    const size_t pixels = (size_t)image.width * (size_t)image.height;
    const bool alpha = step->target->channels == 4;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const size_t at = (size_t)y * image.stride + (size_t)x,
                         from = (size_t)y * (size_t)image.width + (size_t)x;
            const float opaque = alpha ? photo_value(step->target, 3 * pixels + from) : 1.0f;
            float sum = 0.0f;
            for (int c = 0; c < 3; ++c) {
                const float drawn =
                    planes->color[c][at] + planes->transmittance[at] * step->background[c];
                const float photo = opaque * photo_value(step->target, (size_t)c * pixels + from) +
                                    (1.0f - opaque) * step->background[c];
                sum += fabsf(fminf(fmaxf(drawn, 0.0f), step->target->is_hdr ? INFINITY : 1.0f) -
                             photo);
            }
            error[at] = sgsi_photo_counts(step->target, x, y) ? sum / 3.0f : 0.0f;
            image.error_min = fminf(image.error_min, error[at]);
            image.error_max = fmaxf(image.error_max, error[at]);
        }
    return image;
}

static sgs_status score_one(sgs_trainer *trainer, int iteration, size_t view)
{
    sgsi_trainer_scores *scores = &trainer->scores;
    const size_t n = trainer->model->count;
    step_state step = {.iteration = iteration, .view_index = view, .statistics = &scores->view};
    sgsi_statistics_clear(&scores->view, scores->capacity);
    sgs_status status = sgsi_trainer_fetch(trainer, &step);
    if (!status)
        status = sgsi_trainer_draw(trainer, &step);
    if (status)
        return status;
    column_job job = {trainer, scores, &step};
    sgsi_parallel_ranges(n, 4096, fill_view, &job);
    const uint8_t *bytes = photo_bytes(scores, step.target);
    if (!bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for an image of %dx%d pixels",
                         step.target->width, step.target->height);
    const sgsi_scored_image image = error_image(&step, bytes, step.d_color[0]);
    status = trainer->pipeline->pixel_weights(&image, &trainer->options, step.d_color[1]);
    if (status)
        return status;
    for (int y = 0; y < image.height && step.target->valid_mask; ++y)
        for (int x = 0; x < image.width; ++x)
            if (!sgsi_photo_counts(step.target, x, y))
                step.d_color[1][(size_t)y * image.stride + (size_t)x] = 0.0f;
    const sgsi_score_planes planes = {.weight = step.d_color[1], .centers = scores->centers};
    status = sgsi_tracer_score(trainer->tracer, &step.view, &step.planes, &planes);
    const sgsi_scored_view scored = {.count = n,
                                     .loss = step.loss.loss,
                                     .sums = sgsi_tracer_grad_sums(trainer->tracer),
                                     .touched = sgsi_tracer_touched(trainer->tracer),
                                     .depth = scores->depth,
                                     .radius = scores->view.radius_max,
                                     .gradient = scores->gradient,
                                     .opacity = scores->opacity,
                                     .volume = scores->volume};
    if (!status)
        trainer->pipeline->score_view(&scored, scores->importance, scores->prune_score);
    return status;
}

sgs_status sgsi_trainer_score(sgs_trainer *trainer, int iteration)
{
    const sgsi_pipeline *pipeline = trainer->pipeline;
    const sgs_train_seconds seconds =
        trainer->progress.seconds; // all of this counts as density control
    size_t order[64];
    const size_t n = trainer->train_view_count;
    const size_t wanted = (size_t)pipeline->score_views < n ? (size_t)pipeline->score_views : n;
    sgs_status status = reserve(&trainer->scores, trainer->model->capacity);
    if (status)
        return status;
    column_job job = {trainer, &trainer->scores, NULL};
    sgsi_parallel_ranges(trainer->model->count, 4096, fill_columns, &job);
    const uint64_t seed = sgsi_random_bits(trainer->options.seed ^ 0x5C08E, (uint64_t)iteration);
    for (size_t k = 0; k < wanted && !status;
         ++k) { // distinct views: draw again what was drawn before
        for (uint64_t attempt = 0, fresh = 0; !fresh; ++attempt) {
            order[k] = (size_t)(sgsi_random_uniform(seed, 4096 * k + attempt) * (double)n);
            fresh = order[k] < n;
            for (size_t j = 0; j < k; ++j)
                fresh = fresh && order[j] != order[k];
        }
        status = score_one(trainer, iteration, order[k]);
    }
    if (!status && pipeline->finish_scores)
        pipeline->finish_scores(trainer->model->count, (int)wanted, trainer->scores.importance,
                                trainer->scores.prune_score);
    trainer->progress.seconds = seconds;
    return status;
}
