// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The networks of LPIPS, their weights in memory and the interface to the convolution kernel.
// Included by src/image/ only.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/metrics.h"

enum {
    LPIPS_CONVOLUTIONS = 13, // at most
    LPIPS_TAPS = 5,
    LPIPS_GROUP = 8, // output channels that a kernel call computes; divides every count
};

typedef struct lpips_convolution {
    int in, out, kernel, stride, padding;
    bool after_pool; // max-pooling in front of it
    bool tapped;     // its output is compared
} lpips_convolution;

typedef struct lpips_network {
    const char *name;
    int count;    // of convolutions
    int pool;     // window of the pooling, stride 2
    int smallest; // width and height that reach the last convolution
    lpips_convolution convolutions[LPIPS_CONVOLUTIONS];
} lpips_network;

struct sgs_lpips {
    const lpips_network *network;
    float *memory;
    // [out / LPIPS_GROUP][in * kernel * kernel][LPIPS_GROUP]
    const float *weights[LPIPS_CONVOLUTIONS];
    const float *bias[LPIPS_CONVOLUTIONS];
    const float *heads[LPIPS_TAPS];
};

// One row of LPIPS_GROUP output channels: out[c * out_plane + x] = max(0, bias[c] + sum over t of
// weights[t * LPIPS_GROUP + c] * in[offsets[t] + x]). Reads and writes up to 31 elements past
// `width`.
typedef struct sgsi_lpips_row {
    const float *in, *weights, *bias;
    const size_t *offsets;
    size_t taps;
    float *out;
    size_t out_plane;
    int width;
} sgsi_lpips_row;

typedef void (*sgsi_lpips_kernel)(const sgsi_lpips_row *row);
void sgsi_lpips_row_baseline(const sgsi_lpips_row *row);
void sgsi_lpips_row_avx2(const sgsi_lpips_row *row);
void sgsi_lpips_row_avx512(const sgsi_lpips_row *row);

// Approximate memory of the bands, 64 MB. Variable for tests; it does not affect the result.
extern size_t sgsi_lpips_band_bytes;
