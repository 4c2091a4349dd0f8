// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Codebooks for quantisation: k-means of vectors and of single values. The results do not depend on
// the number of threads.

#include <stddef.h>
#include <stdint.h>

#include "base/progress_calls.h"
#include "sparegs/status.h"

enum { SGSI_CODES = 256 };

// Least-squares codebook of scalar values (Lloyd, 1982), ascending; unused entries repeat the last
// one. Sorts `values`.
void sgsi_codebook_fit(float *values, size_t count, float codebook[SGSI_CODES]);

// Index of the nearest entry.
uint8_t sgsi_codebook_index(const float codebook[SGSI_CODES], float value);

typedef struct sgsi_palette {
    int dimensions;
    size_t size;      // entries
    float *entries;   // [size][dimensions]
    uint32_t *labels; // [count]
} sgsi_palette;

// Steps of progress that sgsi_palette_train counts.
enum { SGSI_PALETTE_STEPS = 65 };

// k-means of `count` vectors with at most `size` (<= 65536) entries, in two levels: about the
// square root of `size` clusters first, then a share of the entries within each. Vectors of which
// at most `size` are different become the entries themselves. Free it with
// sgsi_palette_free, after a failure too. Fails with OUT_OF_MEMORY or CANCELLED.
sgs_status sgsi_palette_train(const float *vectors, size_t count, int dimensions, size_t size,
                              int iterations, sgsi_progress *progress, sgsi_palette *palette);
void sgsi_palette_free(sgsi_palette *palette);
