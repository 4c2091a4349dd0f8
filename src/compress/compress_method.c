// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Services that the methods share. compress.c calls the methods, and they call these.

#include "compress/compress_method.h"

#include <math.h>
#include <string.h>

sgs_status sgsi_compress_progress(const sgsi_compress_job *job, const char *stage, size_t done,
                                  size_t total)
{
    const sgs_compress_options *options = job->options;
    if (!options->progress || options->progress(options->progress_user, stage, done, total))
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_CANCELLED, "compression was cancelled");
}

// Positions in cells of `side` units; `is_log`: of `side` in the log domain.
static void warn_about_cells(const sgsi_compress_job *job, double side, bool is_log)
{
    double largest = is_log ? 0 : side;
    size_t coarse = 0;
    for (size_t i = 0; i < job->count; ++i) {
        const float *row = job->rows + i * SGS_PARAM_COUNT, *scale = row + SGS_PARAM_SCALE;
        const double size = exp((double)fmaxf(scale[0], fmaxf(scale[1], scale[2])));
        const double far = (double)fmaxf(fabsf(row[0]), fmaxf(fabsf(row[1]), fabsf(row[2])));
        const double cell = is_log ? side * exp(far) : side; // d/dx ln(1 + |x|) = 1 / (1 + |x|)
        if (!(cell > size))
            continue;
        ++coarse;
        largest = fmax(largest, cell);
    }
    const bool more_bits = is_log && job->options->position_bits < SGSI_SOG_MAX_BITS;
    if (coarse > job->count / 100)
        sgsi_warn("positions have cells of %s%.3g units, more than the size of %zu of %zu "
                  "primitives; %sremove the primitives that are far from the others",
                  is_log ? "up to " : "", largest, coarse, job->count,
                  more_bits ? "increase option position_bits, or " : "");
}

void sgsi_warn_about_cells(const sgsi_compress_job *job, const float low[3], const float high[3],
                           int bits)
{
    double side = 0;
    for (int k = 0; k < 3; ++k)
        side = fmax(side, ldexp((double)high[k] - (double)low[k], -bits));
    warn_about_cells(job, side, false);
}

void sgsi_warn_about_log_cells(const sgsi_compress_job *job, double step)
{
    warn_about_cells(job, step, true);
}

sgs_status sgsi_decoded_create(const sgsi_container *in, sgs_gaussians **model)
{
    sgs_status status = sgs_gaussians_create(in->header.count, model);
    if (!status)
        status = sgs_gaussians_resize(*model, in->header.count);
    if (!status)
        (*model)->sh_degree = (int)in->header.sh_degree;
    return status;
}

void sgsi_pack_floats(sgsi_packer *out, const char *name, const float *rows, size_t count,
                      int param, int param_count, bool deflate)
{
    float *planes = sgsi_alloc(count * (size_t)param_count + 1, sizeof *planes);
    if (!planes) {
        out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", count);
        return;
    }
    for (size_t k = 0; k < (size_t)param_count; ++k)
        for (size_t i = 0; i < count; ++i)
            planes[k * count + i] = rows[i * SGS_PARAM_COUNT + (size_t)param + k];
    sgsi_packer_add(out, name, planes, count * (size_t)param_count * sizeof *planes, deflate);
    sgsi_free(planes);
}

sgs_status sgsi_unpack_floats(sgsi_container *in, const char *name, size_t count, int param_count,
                              const uint8_t **planes)
{
    return sgsi_container_take(in, name, (int64_t)(count * (size_t)param_count * sizeof(float)),
                               planes, NULL);
}

void sgsi_planes_apply(const uint8_t *planes, int param, int param_count, sgs_gaussians *model)
{
    for (int k = 0; k < param_count; ++k)
        for (size_t i = 0; i < model->count; ++i)
            memcpy(sgs_gaussians_at(model, i, param + k),
                   planes + ((size_t)k * model->count + i) * sizeof(float), sizeof(float));
}
