// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "storage/model_rows.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "model/opacity.h"
#include "model/similarity.h"

// For scales of 0: exp(-30) is 1e-13 world units.
static const float MIN_LOG_SCALE = -30.0f;

// The model names neither the file nor a remedy that applies to reading.
static sgs_status fail_rows(const sgsi_rows *rows, sgs_status status, size_t count)
{
    return status == SGS_STATUS_OUT_OF_MEMORY
               ? sgsi_fail(status, "%s: not enough memory for its %zu primitives", rows->path,
                           count)
               : sgsi_fail(status, "%s: %s", rows->path, sgs_last_error());
}

sgs_status sgsi_rows_begin(sgsi_rows *rows, const char *path, size_t total, int sh_degree,
                           bool drop_zero_quaternions)
{
    *rows =
        (sgsi_rows){.path = path, .total = total, .drop_zero_quaternions = drop_zero_quaternions};
    sgs_status status = sgs_gaussians_create(total, &rows->model);
    if (!status)
        status = sgs_gaussians_resize(rows->model, total);
    if (status) {
        sgsi_rows_abort(rows);
        return fail_rows(rows, status, total);
    }
    rows->model->sh_degree = sh_degree;
    return SGS_STATUS_OK;
}

sgs_status sgsi_rows_expect(sgsi_rows *rows, size_t added, size_t most)
{
    const size_t needed = rows->kept + added, doubled = 2 * rows->model->capacity,
                 ahead = doubled < most ? doubled : most;
    sgs_status status = SGS_STATUS_OK;
    if (needed > rows->model->capacity)
        status = sgs_gaussians_reserve(rows->model, needed > ahead ? needed : ahead);
    if (!status)
        status = sgs_gaussians_resize(rows->model, needed);
    if (status)
        return fail_rows(rows, status, needed);
    rows->total += added;
    return SGS_STATUS_OK;
}

void sgsi_rows_add(sgsi_rows *rows, float params[SGS_PARAM_COUNT])
{
    bool usable = true;
    params[SGS_PARAM_OPACITY] = sgsi_finite_logit(params[SGS_PARAM_OPACITY]);
    for (int k = 0; k < 3; ++k) // 0 in linear scale: a disc or line
        if (params[SGS_PARAM_SCALE + k] == -INFINITY)
            params[SGS_PARAM_SCALE + k] = MIN_LOG_SCALE;
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        usable = usable && isfinite(params[k]);
    for (int k = 0; k < 3; ++k)
        usable = usable && params[SGS_PARAM_SCALE + k] <= SGSI_MAX_LOG_SCALE;
    float *q = params + SGS_PARAM_ROTATION;
    const double norm =
        sqrt((double)q[0] * q[0] + (double)q[1] * q[1] + (double)q[2] * q[2] + (double)q[3] * q[3]);
    if (usable && !(norm > 0.0)) {
        ++rows->unrotated;
        usable = !rows->drop_zero_quaternions;
    }
    if (!usable) {
        ++rows->dropped;
        return;
    }
    if (!(norm >= 1e-12 && norm <= 1e12))
        for (int k = 0; k < 4; ++k)
            q[k] = norm > 0.0 ? (float)(q[k] / norm) : (float)(k == 0);
    sgs_gaussians_set(rows->model, rows->kept++, params);
}

void sgsi_rows_warn(const sgsi_rows *rows)
{
    if (rows->drop_zero_quaternions && rows->dropped) {
        sgsi_warn("%s: %zu of %zu primitives are not finite or have rotation 0 0 0 0 and were "
                  "dropped",
                  rows->path, rows->dropped, rows->total);
    } else {
        if (rows->dropped)
            sgsi_warn("%s: %zu of %zu primitives are not finite and were dropped", rows->path,
                      rows->dropped, rows->total);
        if (rows->unrotated)
            sgsi_warn("%s: %zu primitives have rotation 0 0 0 0; the identity is used", rows->path,
                      rows->unrotated);
    }
}

sgs_status sgsi_rows_end(sgsi_rows *rows, sgs_gaussians **model)
{
    const sgs_status status = sgs_gaussians_resize(rows->model, rows->kept);
    if (status) {
        sgsi_rows_abort(rows);
        return fail_rows(rows, status, rows->kept);
    }
    sgsi_rows_warn(rows);
    *model = rows->model;
    rows->model = NULL;
    return SGS_STATUS_OK;
}

void sgsi_rows_abort(sgsi_rows *rows)
{
    sgs_gaussians_destroy(rows->model);
    rows->model = NULL;
}

float sgsi_logit(double opacity)
{
    const double held = fmin(fmax(opacity, 1e-6), 1.0 - 1e-6);
    // NaN stays, so that the row is dropped.
    return isnan(opacity) ? NAN : (float)log(held / (1.0 - held));
}

float sgsi_log_scale(double scale)
{
    return scale == 0.0 ? MIN_LOG_SCALE : (float)log(scale);
}

sgsi_splat sgsi_splat_get(const sgs_gaussians *model, size_t i)
{
    float params[SGS_PARAM_COUNT];
    sgsi_splat splat;
    double norm = 0.0;
    sgs_gaussians_get(model, i, params);
    memcpy(splat.mean, params + SGS_PARAM_MEAN, sizeof splat.mean);
    memcpy(splat.log_scale, params + SGS_PARAM_SCALE, sizeof splat.log_scale);
    memcpy(splat.dc, params + SGS_PARAM_SH_DC, sizeof splat.dc);
    memcpy(splat.rest, params + SGS_PARAM_SH_REST, sizeof splat.rest);
    for (int k = 0; k < 4; ++k) {
        splat.rotation[k] = (double)params[SGS_PARAM_ROTATION + k];
        norm += splat.rotation[k] * splat.rotation[k];
    }
    norm = sqrt(norm);
    for (int k = 0; k < 4; ++k)
        splat.rotation[k] = norm > 0.0 ? splat.rotation[k] / norm : (double)(k == 0);
    splat.opacity = 1.0 / (1.0 + exp(-(double)sgs_gaussians_opacity_logit(model, i)));
    return splat;
}

double sgsi_splat_importance(const sgs_gaussians *model, size_t i)
{
    double log_volume = 0.0;
    for (int k = 0; k < 3; ++k)
        log_volume += (double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
    return exp(log_volume) / (1.0 + exp(-(double)sgs_gaussians_opacity_logit(model, i)));
}

// ---- Axes ----

// Axes in which the basis functions of degrees 1 to 3 are odd: y, z, x; xy, yz, 1, xz, 1; y, xyz,
// y, z, x, z, x. The vector of a quaternion is a pseudovector: its x is odd in y and z.
enum { X = 1, Y = 2, Z = 4 };
static const uint8_t odd_mean[] = {X, Y, Z};
static const uint8_t odd_rotation[] = {0, Y | Z, X | Z, X | Y};
static const uint8_t odd_rest[SGSI_REST_COEFFICIENTS] = {Y, Z,         X, X | Y, Y | Z, 0, X | Z, 0,
                                                         Y, X | Y | Z, Y, Z,     X,     Z, X};

static bool changes_sign(sgsi_axes axes, unsigned odd)
{
    return __builtin_parity((unsigned)axes & odd);
}

// Without -0, so that unused coefficients stay 0.
static void flip(float *values, const uint8_t *odd, int count, int repeat, sgsi_axes axes)
{
    for (int k = 0; k < count; ++k)
        if (changes_sign(axes, odd[k / repeat]))
            values[k] = 0.0f - values[k];
}

void sgsi_change_axes(sgsi_axes axes, float params[SGS_PARAM_COUNT])
{
    flip(params + SGS_PARAM_MEAN, odd_mean, 3, 1, axes);
    flip(params + SGS_PARAM_ROTATION, odd_rotation, 4, 1, axes);
    flip(params + SGS_PARAM_SH_REST, odd_rest, 3 * SGSI_REST_COEFFICIENTS, 3, axes);
}

void sgsi_splat_change_axes(sgsi_axes axes, sgsi_splat *splat)
{
    flip(splat->mean, odd_mean, 3, 1, axes);
    flip(splat->rest, odd_rest, 3 * SGSI_REST_COEFFICIENTS, 3, axes);
    for (int k = 0; k < 4; ++k)
        if (changes_sign(axes, odd_rotation[k]))
            splat->rotation[k] = 0.0 - splat->rotation[k];
}

// ---- binary16 ----

uint16_t sgsi_float16_from(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const uint32_t sign = bits >> 16 & 0x8000;
    bits &= 0x7FFFFFFF;
    if (bits > 0x7F800000) // NaN
        return (uint16_t)(sign | 0x7E00);
    if (bits >= 0x477FF000) // rounds to 65536 or more
        return (uint16_t)(sign | 0x7C00);
    if (bits < 0x38800000) { // below 2^-14: multiples of 2^-24
        float magnitude;
        memcpy(&magnitude, &bits, sizeof magnitude);
        return (uint16_t)(sign | (uint32_t)lrintf(magnitude * 0x1p24f));
    }
    bits += 0x0FFF + (bits >> 13 & 1);
    return (uint16_t)(sign | ((bits >> 13) - (112u << 10)));
}

float sgsi_float16_to(uint16_t half)
{
    const uint32_t exponent = half >> 10 & 31, mantissa = half & 1023;
    float value;
    if (exponent == 31) {
        const uint32_t bits = 0x7F800000 | mantissa << 13;
        memcpy(&value, &bits, sizeof value);
    } else {
        value = exponent ? ldexpf((float)(1024 + mantissa), (int)exponent - 25)
                         : ldexpf((float)mantissa, -24);
    }
    return half & 0x8000 ? -value : value;
}

void sgsi_splat_deviation(const sgsi_splat *splat, double deviation[3])
{
    double rotation[3][3];
    sgsi_rotation_matrix(splat->rotation, rotation);
    for (int j = 0; j < 3; ++j) {
        double variance = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double axis = rotation[j][k] * exp((double)splat->log_scale[k]);
            variance += axis * axis;
        }
        deviation[j] = sqrt(variance);
    }
}

static bool is_brighter(const sgs_gaussians *model, size_t i, double most)
{
    for (int k = 0; k < 3; ++k)
        if (sgsi_color_from_dc((double)*sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + k)) >
            most + 0.25)
            return true;
    return false;
}

static bool has_larger_harmonic(const sgs_gaussians *model, size_t i, double most)
{
    const int rest = 3 * sgsi_rest_coefficients(model->sh_degree);
    for (int k = 0; k < rest; ++k)
        if (fabs((double)*sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + k)) > most)
            return true;
    return false;
}

// `text`: the values that the file holds, and what a clipped primitive is or has.
static void warn_clipped(const char *path, const char *format, const sgs_gaussians *model,
                         double most,
                         bool (*is_clipped)(const sgs_gaussians *model, size_t i, double most),
                         const char *const text[2])
{
    size_t clipped = 0;
    for (size_t i = 0; i < model->count; ++i)
        clipped += is_clipped(model, i, most);
    if (clipped > model->count / 100)
        sgsi_warn("%s: %s holds %s up to %.3g; %zu of %zu primitives %s clipped; write a .ply, "
                  ".glb or .usda",
                  path, format, text[0], most, clipped, model->count, text[1]);
}

void sgsi_warn_clipped_colors(const char *path, const char *format, const sgs_gaussians *model,
                              double most)
{
    static const char *const text[] = {"colours", "are brighter and are"};
    warn_clipped(path, format, model, most, is_brighter, text);
}

void sgsi_warn_clipped_harmonics(const char *path, const char *format, const sgs_gaussians *model,
                                 double most)
{
    static const char *const text[] = {"SH coefficients", "have larger ones, which are"};
    warn_clipped(path, format, model, most, has_larger_harmonic, text);
}
