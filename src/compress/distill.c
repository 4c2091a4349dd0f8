// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// LightGaussian (Fan et al. 2024), section 3.3, with the constants of the released code. The
// teacher is the model, the student its copy without band 3. The student learns the renders of the
// teacher: every third step in a training view, otherwise in a pseudo view, a training view whose
// centre is moved by normal noise of 0.05 world units per axis; each view is drawn once per epoch.
// Opacities are fixed; the rest is trained by AdamW with decay 0.01. The learning rate of the
// positions continues that of 3DGS, extended to 40000 iterations, from iteration 30000 on; the
// others decay by 0.9 every 500 steps.

#include "compress/distill.h"

#include <math.h>
#include <string.h>

#include "compress/adam.h"
#include "compress/importance.h"
#include "compress/view_gradient.h"
#include "image/half.h"

enum { DEGREE = 2, PSEUDO_PERIOD = 3, DECAY_INTERVAL = 500, TRAINED = SGS_PARAM_SH_REST + 24 };
enum { FIRST = 30000, LAST = 40000 }; // iterations of the teacher and of both
static const double NOISE = 0.05, DECAY = 0.9, WEIGHT_DECAY = 0.01;
static const double LR_MEAN_FIRST = 1.6e-4, LR_MEAN_LAST = 1.6e-6;

typedef struct distilling {
    const sgsi_compress_job *job;
    sgs_gaussians *teacher, *student;
    sgs_renderer *renderer; // of the teacher
    sgs_frame frame;
    uint16_t *halves;
    sgsi_view_gradient views;
    float *m, *v; // [count][TRAINED]
} distilling;

double sgsi_distill_rate(int param, int step, double extent)
{
    if (param < SGS_PARAM_ROTATION) {
        const double at = fmin((double)(FIRST + step) / LAST, 1);
        return extent * LR_MEAN_FIRST * pow(LR_MEAN_LAST / LR_MEAN_FIRST, at);
    }
    const double rate = param < SGS_PARAM_SCALE     ? 1e-3
                        : param < SGS_PARAM_OPACITY ? 5e-3
                        : param < SGS_PARAM_SH_DC   ? 0
                        : param < SGS_PARAM_SH_REST ? 2.5e-3
                                                    : 2.5e-3 / 20;
    return rate * pow(DECAY, step / DECAY_INTERVAL);
}

// The teacher's render, composited over the background, as a photo.
static sgs_status render_teacher(distilling *d, const sgs_camera *camera, const sgs_pose *pose,
                                 sgs_photo *photo)
{
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    sgs_status status = SGS_STATUS_OK;
    if (d->frame.width != camera->width || d->frame.height != camera->height) {
        sgs_frame_free(&d->frame);
        sgsi_free(d->halves);
        d->halves = sgsi_alloc(pixels, 3 * sizeof *d->halves);
        status = d->halves ? sgs_frame_create_with(camera->width, camera->height, 0, &d->frame)
                           : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for an image");
    }
    if (!status)
        status = sgs_renderer_render(d->renderer, camera, pose, &d->job->render, &d->frame);
    const bool is_hdr = d->job->options->scene->space == SGS_SPACE_LINEAR;
    for (size_t c = 0; c < 3 && !status; ++c)
        for (size_t i = 0; i < pixels; ++i)
            d->halves[c * pixels + i] = sgsi_half_from_float(fminf(
                d->frame.color[c][i] + d->frame.transmittance[i] * d->job->options->background[c],
                is_hdr ? SGSI_HALF_MAX : 1.0f));
    *photo = (sgs_photo){.width = camera->width,
                         .height = camera->height,
                         .channels = 3,
                         .kept = pixels,
                         .halves = d->halves,
                         .is_hdr = is_hdr};
    return status;
}

// A training view, with its centre moved for pseudo views.
static sgs_pose pose_of(const distilling *d, const sgs_view *view, int step)
{
    sgs_pose pose = view->pose;
    if (step % PSEUDO_PERIOD == 0)
        return pose;
    for (int k = 0; k < 3; ++k) {
        const double noise = NOISE * sgsi_random_normal(d->job->options->seed ^ 0xD157,
                                                        6 * (uint64_t)step + 2 * (uint64_t)k);
        for (int row = 0; row < 3; ++row)
            pose.translation[row] -= pose.rotation[3 * row + k] * noise;
    }
    return pose;
}

static void update_student(distilling *d, int step)
{
    const sgsi_adam_step adam = sgsi_adam_begin(step);
    double rates[TRAINED];
    for (int k = 0; k < TRAINED; ++k)
        rates[k] = sgsi_distill_rate(k, step, d->job->options->scene->extent);
    for (size_t i = 0; i < d->student->count; ++i)
        for (int k = 0; k < TRAINED; ++k) {
            const size_t at = i * TRAINED + (size_t)k;
            float *value = sgs_gaussians_at(d->student, i, k);
            if (!(rates[k] > 0))
                continue;
            *value = (float)((double)*value * (1 - rates[k] * WEIGHT_DECAY));
            sgsi_adam_update(&adam, (double)*sgs_gaussians_at(d->views.d_model, i, k), rates[k],
                             value, &d->m[at], &d->v[at]);
        }
}

static sgs_status distill_steps(distilling *d, int iterations)
{
    sgs_status status = SGS_STATUS_OK;
    for (int step = 1; step <= iterations && !status; ++step) {
        status = sgsi_compress_progress(d->job, "distilling", (size_t)step - 1, (size_t)iterations);
        const size_t k = sgsi_view_gradient_next(&d->views, d->job->options->seed ^ 0xD15, step);
        const sgs_view *view = &d->job->options->scene->views[d->views.views[k]];
        const sgs_pose pose = pose_of(d, view, step);
        sgs_photo photo;
        double mse;
        if (!status)
            status = render_teacher(d, &view->camera, &pose, &photo);
        if (!status)
            status =
                sgsi_view_gradient_compare(&d->views, &view->camera, &pose, &photo, true, &mse);
        if (status)
            break;
        update_student(d, step);
        status = sgs_renderer_refit(d->views.renderer);
    }
    return status;
}

static sgs_status prepare(distilling *d)
{
    sgs_status status = sgsi_rows_model(d->job, &d->teacher);
    if (!status)
        status = sgsi_rows_model(d->job, &d->student);
    if (!status)
        status = sgs_renderer_create(d->teacher, &d->renderer);
    if (status)
        return status;
    d->student->sh_degree = DEGREE;
    for (size_t i = 0; i < d->student->count; ++i)
        for (int k = TRAINED; k < SGS_PARAM_COUNT; ++k)
            *sgs_gaussians_at(d->student, i, k) = 0;
    d->m = sgsi_calloc(d->student->count, TRAINED * sizeof *d->m);
    d->v = sgsi_calloc(d->student->count, TRAINED * sizeof *d->v);
    if (!d->m || !d->v)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to distil %zu primitives",
                         d->student->count);
    return sgsi_view_gradient_create(d->job, d->student, false, &d->views);
}

sgs_status sgsi_distill(sgsi_compress_job *job, int iterations)
{
    if (!job->options->scene)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the distillation requires a scene");
    if (job->sh_degree <= DEGREE) {
        sgsi_warn("option distill has no effect: the SH degree is already %d", job->sh_degree);
        return SGS_STATUS_OK;
    }
    distilling d = {.job = job};
    sgs_status status = prepare(&d);
    if (!status)
        status = distill_steps(&d, iterations);
    if (!status) {
        sgsi_rows_set(job, d.student);
        job->sh_degree = DEGREE;
    }
    sgsi_view_gradient_free(&d.views);
    sgs_renderer_destroy(d.renderer);
    sgs_frame_free(&d.frame);
    sgs_gaussians_destroy(d.teacher);
    sgs_gaussians_destroy(d.student);
    sgsi_free(d.halves);
    sgsi_free(d.m);
    sgsi_free(d.v);
    return status;
}
