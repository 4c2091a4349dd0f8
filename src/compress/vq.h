// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Codebooks of vectors: nearest code of many rows by the sixteen-lane kernels, and batches of rows
// for the training of a codebook. How codes move is up to the methods.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

enum { SGSI_VQ_LANES = 16 };

typedef struct sgsi_codebook {
    size_t count; // codes
    size_t dim;
    float *codes;  // [count][dim]
    float *blocks; // [ceil(count / 16)][dim][16], made by sgsi_codebook_assign
    float *halves; // [ceil(count / 16)][16] half the squared norm; infinite beyond `count`
} sgsi_codebook;

sgs_status sgsi_codebook_create(size_t count, size_t dim, sgsi_codebook *codebook);
void sgsi_codebook_free(sgsi_codebook *codebook);

// nearest[k] = the code nearest to row rows[k] of `data` [.][stride floats]; of equal ones the
// first. Parallel; the result does not depend on the number of threads.
void sgsi_codebook_assign(sgsi_codebook *codebook, const float *data, size_t stride,
                          const uint32_t *rows, size_t count, uint32_t *nearest);

// Draws `draws` times from [0, count) with replacement: the distinct rows in the order of their
// first draw, and how often each was drawn. rows, times: [min(count, draws)]; slots: [count], all
// UINT32_MAX before and after. Returns the number of distinct rows.
size_t sgsi_draw_batch(size_t count, size_t draws, uint64_t seed, uint64_t step, uint32_t *slots,
                       uint32_t *rows, uint32_t *times);
