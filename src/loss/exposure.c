// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// With I = color + T background the image, A the 3 x 3 part of the map and b its last column:
//
//   I' = A I + b
//   dL/dI = A^T dL/dI',   dL/dA = sum over pixels of dL/dI' I^T,   dL/db = sum over pixels of
//   dL/dI'
//
// and dL/dcolor = dL/dI, dL/dT = background . dL/dI (plus the alpha term, which does not pass
// through the map). The background of a photo with an alpha channel does not have the exposure
// of the photo, so it is added after the map:
//
//   I' = A color + b (1 - T) + T background
//   dL/dcolor = A^T dL/dI',   dL/dT = (background - b) . dL/dI',   dL/dA = sum of dL/dI' color^T,
//   dL/db = sum of dL/dI' (1 - T)
//
// The sums are computed per cell of the image (base/image_cells.h) and added along the curve of the
// cells, in double precision: the result does not depend on the number of threads.

#include "loss/exposure.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/image_cells.h"
#include "base/threads.h"

typedef struct exposure_state {
    double map[SGSI_EXPOSURE], m[SGSI_EXPOSURE], v[SGSI_EXPOSURE], steps;
} exposure_state;

struct sgsi_exposure {
    size_t count;
    exposure_state *states;
    float *mapped[3], *zeros;      // planes; `zeros` is 0
    sgsi_cells cells;              // of the last image
    double (*sums)[SGSI_EXPOSURE]; // one per cell
    size_t sums_count;
    double gradient[SGSI_EXPOSURE];
};

void sgsi_exposure_destroy(sgsi_exposure *exposure)
{
    if (!exposure)
        return;
    sgsi_free(exposure->states);
    sgsi_free(exposure->zeros); // first plane of the block
    sgsi_cells_free(&exposure->cells);
    sgsi_free(exposure->sums);
    sgsi_free(exposure);
}

sgs_status sgsi_exposure_create(size_t count, size_t plane_floats, sgsi_exposure **exposure)
{
    *exposure = NULL;
    sgsi_exposure *made = sgsi_calloc(1, sizeof *made);
    if (made) {
        made->count = count;
        made->states = sgsi_calloc(count, sizeof *made->states);
        made->zeros = sgsi_calloc(plane_floats, 4 * sizeof(float));
    }
    if (!made || !made->states || !made->zeros) {
        sgsi_exposure_destroy(made);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the exposure of %zu images", count);
    }
    for (size_t c = 0; c < 3; ++c)
        made->mapped[c] = made->zeros + (c + 1) * plane_floats;
    for (size_t i = 0; i < count; ++i)
        made->states[i].map[0] = made->states[i].map[5] = made->states[i].map[10] = 1;
    *exposure = made;
    return SGS_STATUS_OK;
}

typedef struct exposure_job {
    sgsi_exposure *exposure;
    const double *map;
    const sgsi_loss_input *image;
    sgsi_loss_output *output;
    size_t first; // cell
} exposure_job;

static inline bool has_alpha(const sgsi_loss_input *image)
{
    return image->target->channels == 4;
}

// What the map multiplies: the image, or the primitives alone, and the factor of its last column.
static inline float value_at(const sgsi_loss_input *image, bool alpha, int c, size_t at)
{
    return alpha ? image->color[c][at]
                 : image->color[c][at] + image->transmittance[at] * image->background[c];
}

static inline double one_at(const sgsi_loss_input *image, bool alpha, size_t at)
{
    return alpha ? 1 - (double)image->transmittance[at] : 1;
}

static void forward_row(void *context, size_t y, int thread)
{
    (void)thread;
    const exposure_job *job = context;
    float map[SGSI_EXPOSURE];
    const sgsi_loss_input *image = job->image;
    const bool alpha = has_alpha(image);
    for (int i = 0; i < SGSI_EXPOSURE; ++i)
        map[i] = (float)job->map[i];
    for (size_t at = y * image->stride; at < y * image->stride + (size_t)image->width; ++at) {
        float value[3];
        for (int c = 0; c < 3; ++c)
            value[c] = value_at(image, alpha, c, at);
        const float one = (float)one_at(image, alpha, at);
        for (int c = 0; c < 3; ++c)
            job->exposure->mapped[c][at] = map[4 * c] * value[0] + map[4 * c + 1] * value[1] +
                                           map[4 * c + 2] * value[2] + map[4 * c + 3] * one;
    }
}

void sgsi_exposure_forward(sgsi_exposure *exposure, size_t index, sgsi_loss_input *input)
{
    exposure_job job = {.exposure = exposure, .map = exposure->states[index].map, .image = input};
    sgsi_parallel_for((size_t)input->height, 8, forward_row, &job);
    if (!has_alpha(input)) {
        input->alpha_transmittance = input->transmittance;
        input->transmittance = exposure->zeros;
    }
    for (int c = 0; c < 3; ++c)
        input->color[c] = exposure->mapped[c];
}

static void backward_pixel(const exposure_job *job, bool alpha, size_t at,
                           double sums[SGSI_EXPOSURE])
{
    const sgsi_loss_input *image = job->image;
    sgsi_loss_output *output = job->output;
    const float mapped[3] = {output->d_color[0][at], output->d_color[1][at],
                             output->d_color[2][at]};
    float through = 0, before = 0;
    double offset = 0;
    for (int k = 0; k < 3; ++k) {
        const float value = value_at(image, alpha, k, at);
        double sum = 0;
        for (int c = 0; c < 3; ++c) {
            sums[4 * c + k] += (double)mapped[c] * (double)value;
            sum += job->map[4 * c + k] * (double)mapped[c];
        }
        sums[4 * k + 3] += (double)mapped[k] * one_at(image, alpha, at);
        output->d_color[k][at] = (float)sum;
        offset += job->map[4 * k + 3] * (double)mapped[k];
        through += image->background[k] * (float)sum;
        before += image->background[k] * mapped[k];
    }
    // The loss has written background . dL/dI' here, plus the alpha term.
    output->d_transmittance[at] += alpha ? -(float)offset : through - before;
}

static void backward_cell(void *context, size_t item, int thread)
{
    (void)thread;
    const exposure_job *job = context;
    const sgsi_cell_rect rect = sgsi_cell_at(&job->exposure->cells, job->first + item);
    double *sums = job->exposure->sums[job->first + item];
    const bool alpha = has_alpha(job->image);
    memset(sums, 0, SGSI_EXPOSURE * sizeof *sums);
    for (int y = rect.y; y < rect.y + rect.height; ++y)
        for (int x = rect.x; x < rect.x + rect.width; ++x)
            backward_pixel(job, alpha, (size_t)y * job->image->stride + (size_t)x, sums);
}

static sgs_status reserve_cells(sgsi_exposure *exposure, const sgsi_loss_input *image)
{
    bool reserved = sgsi_cells_set(&exposure->cells, image->width, image->height);
    const size_t cells = exposure->cells.count;
    if (reserved && cells > exposure->sums_count) {
        reserved = sgsi_grow((void **)&exposure->sums, 0, cells, sizeof *exposure->sums);
        exposure->sums_count = reserved ? cells : exposure->sums_count;
    }
    return reserved ? SGS_STATUS_OK
                    : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                "not enough memory for the exposure of a %d x %d image",
                                image->width, image->height);
}

sgs_status sgsi_exposure_cells(sgsi_exposure *exposure, size_t index, const sgsi_loss_input *image,
                               size_t first, size_t last, sgsi_loss_output *output,
                               double (**sums)[SGSI_EXPOSURE])
{
    const sgs_status status = reserve_cells(exposure, image);
    if (status)
        return status;
    exposure_job job = {.exposure = exposure,
                        .map = exposure->states[index].map,
                        .image = image,
                        .output = output,
                        .first = first};
    sgsi_parallel_for(last - first, 1, backward_cell, &job);
    *sums = exposure->sums;
    return SGS_STATUS_OK;
}

void sgsi_exposure_total(sgsi_exposure *exposure)
{
    memset(exposure->gradient, 0, sizeof exposure->gradient);
    for (size_t cell = 0; cell < exposure->cells.count; ++cell)
        for (int i = 0; i < SGSI_EXPOSURE; ++i)
            exposure->gradient[i] += exposure->sums[cell][i];
}

sgs_status sgsi_exposure_backward(sgsi_exposure *exposure, size_t index,
                                  const sgsi_loss_input *image, sgsi_loss_output *output)
{
    double(*sums)[SGSI_EXPOSURE];
    sgs_status status = reserve_cells(exposure, image);
    if (!status)
        status =
            sgsi_exposure_cells(exposure, index, image, 0, exposure->cells.count, output, &sums);
    if (!status)
        sgsi_exposure_total(exposure);
    return status;
}

void sgsi_exposure_step(sgsi_exposure *exposure, size_t index, double rate)
{
    exposure_state *state = &exposure->states[index];
    state->steps += 1;
    for (int i = 0; i < SGSI_EXPOSURE; ++i) {
        const double g = exposure->gradient[i];
        if (!isfinite(g))
            continue;
        state->m[i] = 0.9 * state->m[i] + 0.1 * g;
        state->v[i] = 0.999 * state->v[i] + 0.001 * g * g;
        const double m = state->m[i] / (1 - pow(0.9, state->steps)),
                     v = state->v[i] / (1 - pow(0.999, state->steps));
        state->map[i] -= rate * m / (sqrt(v) + 1e-8);
    }
}

double sgsi_exposure_lr(int iteration, int iterations)
{
    return 0.01 * pow(0.1, fmin((double)iteration / iterations, 1));
}

double *sgsi_exposure_state(sgsi_exposure *exposure, size_t *count)
{
    *count = exposure->count * sizeof *exposure->states / sizeof(double);
    return (double *)exposure->states;
}

const double *sgsi_exposure_map(const sgsi_exposure *exposure, size_t index)
{
    return exposure->states[index].map;
}

const double *sgsi_exposure_gradient(const sgsi_exposure *exposure)
{
    return exposure->gradient;
}
