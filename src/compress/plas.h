// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Parallel linear assignment sorting (Morgenstern et al. 2024, section 3.2): arranges feature
// vectors on a square grid so that neighbours are similar.

#include <stdint.h>

#include "sparegs/status.h"

enum { SGSI_PLAS_CHANNELS = 12 }; // unused ones are 0

typedef struct sgsi_plas {
    int side;
    // [side * side][SGSI_PLAS_CHANNELS], reordered with `order`.
    float *features;
    uint32_t *order; // [side * side]: the element at each cell
    uint64_t seed;
    double improvement_break; // relative improvement below which passes stop: 1e-4
    sgs_progress_fn progress; // of the radii, before every pass; or NULL
    void *progress_user;
} sgsi_plas;

// Shuffles, then sorts. The result depends on the seed, not on the number of threads. Fails with
// OUT_OF_MEMORY or CANCELLED.
sgs_status sgsi_plas_sort(sgsi_plas *plas);
