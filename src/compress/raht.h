// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Region-adaptive hierarchical transform (de Queiroz and Chou 2016): an orthonormal Haar transform
// on the occupied cells of an octree. Additions, multiplications, divisions and square roots in a
// fixed order: the same bits on every machine.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

// lo = a left + b right, hi = -b left + a right.
typedef struct sgsi_raht_merge {
    uint32_t left, right; // slots
    double a, b;
} sgsi_raht_merge;

typedef struct sgsi_raht {
    size_t count; // cells; count - 1 merges
    sgsi_raht_merge *merges;
} sgsi_raht;

// cells: Morton codes of `bits` bits, strictly ascending. Fails with OUT_OF_MEMORY.
sgs_status sgsi_raht_create(const uint64_t *cells, size_t count, int bits, sgsi_raht *raht);
void sgsi_raht_free(sgsi_raht *raht);

// In place over one channel [count]. Slot 0 becomes the mean times sqrt(count).
void sgsi_raht_forward(const sgsi_raht *raht, double *channel);
void sgsi_raht_inverse(const sgsi_raht *raht, double *channel);
