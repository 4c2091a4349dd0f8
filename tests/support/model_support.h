// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Random models whose primitives can be recognised after a format changed their order: x increases
// by a step above every quantum. Include after cmocka.h.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/gaussians.h"
#include "sparegs/model_file.h"
#include "support/bad_input.h"

// The file is refused with this status and one line that begins with its path and has the message.
// what: the case, for the failure of the test.
static inline void model_refused(const char *path, sgs_status expected, const char *message,
                                 const char *what)
{
    sgs_gaussians *model = (sgs_gaussians *)path;
    const sgs_status status = sgs_model_read(path, NULL, &model, NULL);
    if (status != expected || strncmp(sgs_last_error(), path, strlen(path)) ||
        !strstr(sgs_last_error(), message) || strchr(sgs_last_error(), '\n'))
        fail_msg("%s: status %d with '%s', expected %d with '%s'", what, status, sgs_last_error(),
                 expected, message);
    assert_null(model);
    bad_input();
}

static inline sgs_gaussians *model_random(size_t count, int sh_degree)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    model->sh_degree = sh_degree;
    const int used = SGS_PARAM_SH_REST + 3 * ((sh_degree + 1) * (sh_degree + 1) - 1);
    for (size_t i = 0; i < count; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        double norm = 0.0;
        p[0] = 0.37f * (float)i - 40.0f;
        for (int k = 1; k < used; ++k)
            p[k] = (float)sgsi_random_normal(i, (uint64_t)k);
        for (int k = 0; k < 3; ++k)
            p[SGS_PARAM_SCALE + k] -= 3.0f;
        for (int k = SGS_PARAM_SH_REST; k < used; ++k)
            p[k] = (float)(1.8 * sgsi_random_uniform(i, (uint64_t)k) - 0.95);
        for (int k = 0; k < 3; ++k)
            p[SGS_PARAM_SH_DC + k] = (float)(3.0 * sgsi_random_uniform(i, 100 + (uint64_t)k) - 1.5);
        for (int k = 0; k < 4; ++k)
            norm += (double)p[SGS_PARAM_ROTATION + k] * (double)p[SGS_PARAM_ROTATION + k];
        for (int k = 0; k < 4; ++k)
            p[SGS_PARAM_ROTATION + k] /= (float)sqrt(norm);
        sgs_gaussians_set(model, i, p);
    }
    return model;
}

static inline float model_value(const sgs_gaussians *model, size_t i, int param)
{
    return *sgs_gaussians_at(model, i, param);
}

// Colour in a unit direction before the offset: the basis of 3DGS, with its constants.
static inline double model_radiance(const sgs_gaussians *model, size_t i, const double d[3],
                                    int channel)
{
    const double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    const double basis[16] = {0.28209479177387814,
                              -0.4886025119029199 * y,
                              0.4886025119029199 * z,
                              -0.4886025119029199 * x,
                              1.0925484305920792 * x * y,
                              -1.0925484305920792 * y * z,
                              0.31539156525252005 * (2 * zz - xx - yy),
                              -1.0925484305920792 * x * z,
                              0.5462742152960396 * (xx - yy),
                              -0.5900435899266435 * y * (3 * xx - yy),
                              2.890611442640554 * x * y * z,
                              -0.4570457994644658 * y * (4 * zz - xx - yy),
                              0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                              -0.4570457994644658 * x * (4 * zz - xx - yy),
                              1.445305721320277 * z * (xx - yy),
                              -0.5900435899266435 * x * (xx - 3 * yy)};
    double sum = 0;
    for (int k = 0; k < 16; ++k)
        sum += basis[k] * (double)model_value(model, i, SGS_PARAM_SH_DC + 3 * k + channel);
    return sum;
}

static inline double model_opacity(const sgs_gaussians *model, size_t i)
{
    return 1.0 / (1.0 + exp(-(double)model_value(model, i, SGS_PARAM_OPACITY)));
}

// Index of each primitive of the other model: its x is nearest. [count], free().
static inline size_t *model_match(const sgs_gaussians *model, const sgs_gaussians *other)
{
    size_t *match = malloc(model->count * sizeof *match);
    assert_non_null(match);
    for (size_t i = 0; i < model->count; ++i) {
        match[i] = 0;
        for (size_t j = 1; j < other->count; ++j)
            if (fabsf(model_value(other, j, 0) - model_value(model, i, 0)) <
                fabsf(model_value(other, match[i], 0) - model_value(model, i, 0)))
                match[i] = j;
    }
    return match;
}

// Covariance of a primitive: scales squared about the axes of its quaternion.
static inline void model_covariance(const double q[4], const double scales[3], double out[3][3])
{
    const double n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[3][3] = {
        {w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)},
        {2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)},
        {2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z}};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            out[i][j] = 0;
            for (int k = 0; k < 3; ++k)
                out[i][j] += r[i][k] * r[j][k] / (n * n) * scales[k] * scales[k];
        }
}
