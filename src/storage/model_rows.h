// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the readers and writers of models share: adding decoded rows to a model, activated values of
// a row, axes, and the activations of opacity and colour.

#include <math.h>
#include <stdint.h>

#include "base/sh.h"
#include "sparegs/gaussians.h"

enum { SGSI_REST_COEFFICIENTS = 15 };

// Number of coefficients per channel above degree 0: 0, 3, 8, 15.
static inline int sgsi_rest_coefficients(int sh_degree)
{
    return (sh_degree + 1) * (sh_degree + 1) - 1;
}

// ---- Reading ----

typedef struct sgsi_rows {
    const char *path; // borrowed, for messages
    sgs_gaussians *model;
    size_t kept, total;
    size_t dropped, unrotated;
    bool drop_zero_quaternions;
} sgsi_rows;

// Creates a model for `total` rows, whose data the caller has seen. Fails with OUT_OF_MEMORY or
// LIMIT.
sgs_status sgsi_rows_begin(sgsi_rows *rows, const char *path, size_t total, int sh_degree,
                           bool drop_zero_quaternions);

// Makes room for `added` more rows, whose data the caller has seen. most: rows of the finished
// model, as far as known; room grows geometrically up to it. Fails with OUT_OF_MEMORY or LIMIT.
sgs_status sgsi_rows_expect(sgsi_rows *rows, size_t added, size_t most);

// Adds a row unless it has unusable values: not finite, or scales whose squares exceed float.
// Infinite logits and log scales of -infinity become finite. A zero quaternion becomes the identity
// (or the row is dropped), one whose square leaves the range of float is normalised.
void sgsi_rows_add(sgsi_rows *rows, float params[SGS_PARAM_COUNT]);

// Warns about dropped and changed rows.
void sgsi_rows_warn(const sgsi_rows *rows);

// Warns and hands the model over. On failure (OUT_OF_MEMORY) it is destroyed.
sgs_status sgsi_rows_end(sgsi_rows *rows, sgs_gaussians **model);
// Destroys the model after a failure.
void sgsi_rows_abort(sgsi_rows *rows);

// Logit of an opacity, which is clamped to [1e-6, 1 - 1e-6].
float sgsi_logit(double opacity);

// Stored scale of a linear one; 0 is a disc or line and becomes the smallest scale that kernels can
// invert, a negative value is NaN.
float sgsi_log_scale(double scale);

// Coefficient of degree 0 of a colour value, and back.
static inline double sgsi_dc_from_color(double color)
{
    return (color - 0.5) / SGSI_SH_C0;
}

static inline double sgsi_color_from_dc(double coefficient)
{
    return 0.5 + SGSI_SH_C0 * coefficient;
}

// ---- Writing ----

// Warns if the colour of more than one percent of the primitives exceeds `most`, the largest that
// `format` holds, by a quarter: the file clips highlights, as of linear light.
void sgsi_warn_clipped_colors(const char *path, const char *format, const sgs_gaussians *model,
                              double most);

// Warns if more than one percent of the primitives have an SH coefficient of degree 1 to 3 outside
// [-most, most], the range that `format` holds.
void sgsi_warn_clipped_harmonics(const char *path, const char *format, const sgs_gaussians *model,
                                 double most);

// A row with activated opacity and unit quaternion.
typedef struct sgsi_splat {
    float mean[3], log_scale[3], dc[3];
    float rest[3 * SGSI_REST_COEFFICIENTS]; // [coefficient][channel]
    double rotation[4];                     // w, x, y, z
    double opacity;                         // 0..1
} sgsi_splat;

sgsi_splat sgsi_splat_get(const sgs_gaussians *model, size_t i);

// Byte of a value in [0, 1], rounded and clamped; NaN is 0.
static inline uint8_t sgsi_unorm8(double value)
{
    return value > 0.0 ? (value < 1.0 ? (uint8_t)(value * 255.0 + 0.5) : 255) : 0;
}

// exp(sum of log scales) * opacity: the importance of a primitive without a view.
double sgsi_splat_importance(const sgs_gaussians *model, size_t i);

// ---- Axes ----

// PLY: x right, y down, z front. The other axes differ by signs only, so a change of axes is exact
// and its own inverse. The values are sets of axes that change their signs: 1 is x, 2 y, 4 z.
typedef enum sgsi_axes {
    SGSI_AXES_PLY = 0,
    SGSI_AXES_RUB = 2 | 4, // x right, y up, z back
    SGSI_AXES_LUF = 1 | 2, // x left, y up, z front
    SGSI_AXES_MAX = 7
} sgsi_axes;

void sgsi_change_axes(sgsi_axes axes, float params[SGS_PARAM_COUNT]);
void sgsi_splat_change_axes(sgsi_axes axes, sgsi_splat *splat);
// Standard deviations along x, y and z.
void sgsi_splat_deviation(const sgsi_splat *splat, double deviation[3]);

// ---- Little-endian values ----

static inline uint16_t sgsi_load_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

static inline uint32_t sgsi_load_u32(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static inline uint64_t sgsi_load_u64(const uint8_t *at)
{
    return (uint64_t)sgsi_load_u32(at) | (uint64_t)sgsi_load_u32(at + 4) << 32;
}

static inline float sgsi_load_float(const uint8_t *at)
{
    const union {
        uint32_t bits;
        float value;
    } both = {.bits = sgsi_load_u32(at)};
    return both.value;
}

static inline void sgsi_store_u16(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

static inline void sgsi_store_u32(uint8_t *at, uint32_t value)
{
    sgsi_store_u16(at, value);
    sgsi_store_u16(at + 2, value >> 16);
}

static inline void sgsi_store_u64(uint8_t *at, uint64_t value)
{
    sgsi_store_u32(at, (uint32_t)value);
    sgsi_store_u32(at + 4, (uint32_t)(value >> 32));
}

static inline void sgsi_store_float(uint8_t *at, float value)
{
    const union {
        float value;
        uint32_t bits;
    } both = {.value = value};
    sgsi_store_u32(at, both.bits);
}

// IEEE 754 binary16 with sign and subnormals; rounds to nearest, ties to even.
uint16_t sgsi_float16_from(float value);
float sgsi_float16_to(uint16_t half);
