// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The hits of a band of pixels as deep samples: collected while the kernels blend, merged where
// they are close. Knows no files.

#include "trace/kernels.h"

// Samples of the pixel rows [first_row, first_row + rows). Every pixel has its own slots, so
// threads need no lock.
typedef struct sgsi_deep {
    sgs_deep_options options;
    int width, first_row, rows;
    size_t row_capacity;      // rows that the arrays have room for
    uint32_t *counts;         // [rows][width]
    sgs_deep_sample *samples; // [rows][width][max_samples]
} sgsi_deep;

// Room for `rows` rows of `width` pixels; grows only. sgsi_deep_free accepts a zeroed struct.
sgs_status sgsi_deep_reserve(sgsi_deep *deep, const sgs_deep_options *options, int width, int rows);
void sgsi_deep_free(sgsi_deep *deep);

// Opens the band that begins at first_row: no pixel has samples.
void sgsi_deep_begin(sgsi_deep *deep, int first_row, int rows);

// A sgsi_aov.visit; context is the sgsi_deep.
void sgsi_deep_visit(void *context, const sgsi_block_hits *hits);

// Moves the samples together, row by row and pixel by pixel, to the front of `samples`. Returns how
// many there are.
size_t sgsi_deep_pack(sgsi_deep *deep);
