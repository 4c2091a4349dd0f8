// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// MesonGS (Xie et al. 2024), section 3: RAHT of opacity, Euler angles and band 0, and quantisation
// to 8 bits in blocks of consecutive coefficients. For a block with range [low, high] around 0:
//
//     scale = (high - low) / 255, zero = round(255 - high / scale),
//     code = round(clamp(zero + x / scale, 0, 255)), decoded scale (code - zero).
//
// Rotation by Euler angles: R = Rz(yaw) Ry(pitch) Rx(roll).

#include "compress/meson_codec.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/morton.h"
#include "base/threads.h"
#include "compress/portable_math.h"

static const int transformed = SGSI_MESON_TRANSFORMED, channels = SGSI_MESON_CHANNELS;

sgs_status sgsi_meson_prepare(sgsi_meson *meson)
{
    const size_t most = meson->count > 1 ? meson->count - 1 : 1;
    meson->blocks = meson->blocks < most ? meson->blocks : most;
    meson->ranges = sgsi_calloc(meson->blocks, (size_t)channels * sizeof *meson->ranges);
    meson->codes = sgsi_calloc(meson->count, (size_t)channels);
    meson->channels = sgsi_calloc(meson->count, (size_t)channels * sizeof *meson->channels);
    if (!meson->ranges || !meson->codes || !meson->channels)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu cells", meson->count);
    return sgsi_raht_create(meson->cells, meson->count, 3 * meson->depth, &meson->raht);
}

void sgsi_meson_free(sgsi_meson *meson)
{
    sgsi_free(meson->cells);
    sgsi_free(meson->values);
    sgsi_free(meson->labels);
    sgsi_codebook_free(&meson->codebook);
    sgsi_raht_free(&meson->raht);
    sgsi_free(meson->ranges);
    sgsi_free(meson->codes);
    sgsi_free(meson->channels);
    *meson = (sgsi_meson){0};
}

// Elements [*begin, *end) of a channel that block b quantises.
static void block_range(const sgsi_meson *meson, int channel, size_t b, size_t *begin, size_t *end)
{
    const size_t first = channel < transformed ? 1 : 0; // DC is stored as a float
    const size_t count = meson->count - first, size = count / meson->blocks,
                 longer = count % meson->blocks;
    *begin = first + b * size + (b < longer ? b : longer);
    *end = *begin + size + (b < longer);
}

// Roll, pitch, yaw of a quaternion of any length.
static void euler_of(const float q[4], double euler[3])
{
    double length = 0;
    for (int k = 0; k < 4; ++k)
        length += (double)q[k] * q[k];
    length = length > 0 ? sqrt(length) : 1;
    const double w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
    const double sine = 2 * (w * y - x * z);
    euler[0] = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
    euler[1] = 2 * atan2(sqrt(fmax(1 + sine, 0)), sqrt(fmax(1 - sine, 0))) - 1.5707963267948966;
    euler[2] = atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

static void quaternion_of_euler(const double euler[3], float q[4])
{
    double s[3], c[3];
    for (int k = 0; k < 3; ++k)
        sgsi_portable_sincos(0.5 * euler[k], &s[k], &c[k]);
    q[0] = (float)(c[0] * c[1] * c[2] + s[0] * s[1] * s[2]);
    q[1] = (float)(s[0] * c[1] * c[2] - c[0] * s[1] * s[2]);
    q[2] = (float)(c[0] * s[1] * c[2] + s[0] * c[1] * s[2]);
    q[3] = (float)(c[0] * c[1] * s[2] - s[0] * s[1] * c[2]);
}

static void fill_channels(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sgsi_meson *meson = context;
    const size_t n = meson->count;
    for (size_t i = begin; i < end; ++i) {
        const float *v = meson->values + i * SGSI_MESON_VALUES;
        double euler[3], *at = meson->channels + i;
        euler_of(v + 1, euler);
        at[0] = (double)v[0];
        for (size_t k = 0; k < 3; ++k) {
            at[(1 + k) * n] = isfinite(euler[k]) ? euler[k] : 0;
            at[(4 + k) * n] = (double)v[5 + k];
            at[(7 + k) * n] = (double)v[8 + k];
        }
    }
}

static void set_block(sgsi_meson_block *block, double low, double high)
{
    block->low = low < block->low ? (float)low : block->low;
    block->high = high > block->high ? (float)high : block->high;
    block->scale = (float)(((double)block->high - (double)block->low) / 255);
    const double zero = block->scale > 0 ? 255 - (double)block->high / (double)block->scale : 0;
    block->zero = (uint8_t)(fmin(fmax(zero, 0), 255) + 0.5);
}

static void quantise_channel(void *context, size_t channel, int thread)
{
    (void)thread;
    sgsi_meson *meson = context;
    double *x = meson->channels + channel * meson->count;
    uint8_t *codes = meson->codes + channel * meson->count;
    if ((int)channel < transformed) {
        sgsi_raht_forward(&meson->raht, x);
        meson->dc[channel] = (float)x[0];
    }
    for (size_t b = 0; b < meson->blocks; ++b) {
        sgsi_meson_block *block = &meson->ranges[channel * meson->blocks + b];
        size_t begin, end;
        block_range(meson, (int)channel, b, &begin, &end);
        double low = 0, high = 0;
        for (size_t i = begin; i < end; ++i) {
            low = x[i] < low ? x[i] : low;
            high = x[i] > high ? x[i] : high;
        }
        set_block(block, low, high);
        for (size_t i = begin; i < end; ++i) {
            const double code = block->scale > 0 ? block->zero + x[i] / (double)block->scale : 0;
            codes[i] = (uint8_t)(fmin(fmax(code, 0), 255) + 0.5);
        }
    }
}

void sgsi_meson_quantise(sgsi_meson *meson)
{
    sgsi_parallel_ranges(meson->count, 1024, fill_channels, meson);
    sgsi_parallel_for((size_t)channels, 1, quantise_channel, meson);
}

static void dequantise_channel(void *context, size_t channel, int thread)
{
    (void)thread;
    sgsi_meson *meson = context;
    double *x = meson->channels + channel * meson->count;
    const uint8_t *codes = meson->codes + channel * meson->count;
    for (size_t b = 0; b < meson->blocks; ++b) {
        const sgsi_meson_block *block = &meson->ranges[channel * meson->blocks + b];
        size_t begin, end;
        block_range(meson, (int)channel, b, &begin, &end);
        for (size_t i = begin; i < end; ++i)
            x[i] = (double)block->scale * (double)((int)codes[i] - (int)block->zero);
    }
    if ((int)channel < transformed) {
        x[0] = (double)meson->dc[channel];
        sgsi_raht_inverse(&meson->raht, x);
    }
}

static void reconstruct_rows(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    sgs_gaussians *model = ((void **)context)[1];
    const sgsi_meson *meson = ((void **)context)[0];
    const size_t n = meson->count, dim = meson->codebook.dim;
    const double cells = (double)(UINT64_C(1) << meson->depth);
    for (size_t i = begin; i < end; ++i) {
        float row[SGS_PARAM_COUNT] = {0};
        const double *at = meson->channels + i;
        for (int k = 0; k < 3; ++k) {
            const double low = (double)meson->bounds[0][k], high = (double)meson->bounds[1][k];
            const uint64_t cell = sgsi_gather_bits(meson->cells[i] >> (2 - k));
            row[SGS_PARAM_MEAN + k] =
                (float)(low + ((double)cell + (meson->center ? 0.5 : 0)) * ((high - low) / cells));
            row[SGS_PARAM_SH_DC + k] = (float)at[(size_t)(4 + k) * n];
            row[SGS_PARAM_SCALE + k] = (float)at[(size_t)(7 + k) * n];
        }
        const double euler[3] = {at[n], at[2 * n], at[3 * n]};
        quaternion_of_euler(euler, row + SGS_PARAM_ROTATION);
        row[SGS_PARAM_OPACITY] = (float)at[0];
        if (dim)
            memcpy(row + SGS_PARAM_SH_REST, meson->codebook.codes + meson->labels[i] * dim,
                   dim * sizeof *row);
        sgs_gaussians_set(model, i, row);
    }
}

void sgsi_meson_reconstruct(sgsi_meson *meson, sgs_gaussians *model)
{
    void *context[2] = {meson, model};
    sgsi_parallel_for((size_t)channels, 1, dequantise_channel, meson);
    sgsi_parallel_ranges(meson->count, 1024, reconstruct_rows, context);
}
