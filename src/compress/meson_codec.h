// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The transform and the quantiser of MesonGS, shared by encoder, fine-tuning and decoder: cells of
// an octree with values, their coefficients in 8 bits, and the model that they decode to.

#include <stdint.h>

#include "compress/raht.h"
#include "compress/vq.h"
#include "sparegs/gaussians.h"

enum {
    SGSI_MESON_TRANSFORMED = 7, // opacity logit, roll, pitch, yaw, 3 x band 0
    SGSI_MESON_CHANNELS = 10,   // and 3 logs of the scale, not transformed
    // What is trained, per cell: opacity logit, quaternion, band 0, logs of the scale.
    SGSI_MESON_VALUES = 11
};

typedef struct sgsi_meson_block {
    float low, high; // range of the encoder, including 0; it only grows
    float scale;
    uint8_t zero;
} sgsi_meson_block;

typedef struct sgsi_meson {
    size_t count; // cells
    int depth, sh_degree;
    bool center;
    size_t blocks;          // per channel
    float bounds[2][3];     // least and largest position
    uint64_t *cells;        // [count] Morton codes, x in the most significant bit
    float *values;          // [count][SGSI_MESON_VALUES]; encoder only
    uint32_t *labels;       // [count] of the codebook; NULL for degree 0
    sgsi_codebook codebook; // of the bands above 0
    sgsi_raht raht;
    sgsi_meson_block *ranges; // [SGSI_MESON_CHANNELS][blocks]
    float dc[SGSI_MESON_TRANSFORMED];
    uint8_t *codes;   // [SGSI_MESON_CHANNELS][count]; slot 0 of a transformed channel is unused
    double *channels; // [SGSI_MESON_CHANNELS][count] scratch
} sgsi_meson;

// Allocates codes, ranges, channels and the transform for the cells, which are set. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_meson_prepare(sgsi_meson *meson);
void sgsi_meson_free(sgsi_meson *meson);

// values -> codes: transform, growing ranges, quantisation.
void sgsi_meson_quantise(sgsi_meson *meson);
// codes -> model of `count` primitives, with all parameters.
void sgsi_meson_reconstruct(sgsi_meson *meson, sgs_gaussians *model);
