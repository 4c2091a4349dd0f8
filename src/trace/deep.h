// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Collects the hits of a band of pixel rows as deep samples while the kernels blend, and merges
// hits that are close to each other. Independent of file formats.

#include "trace/kernels.h"

// Samples of the pixel rows [first_row, first_row + rows). Each pixel has its own slots, so threads
// need no lock.
typedef struct sgsi_deep {
    sgs_deep_options options;
    int width, first_row, rows;
    size_t row_capacity;      // capacity of the arrays, in rows
    uint32_t *counts;         // [rows][width]
    sgs_deep_sample *samples; // [rows][width][max_samples]
} sgsi_deep;

// Makes room for `rows` rows of `width` pixels. Initialise the struct to zero. Fails with
// OUT_OF_MEMORY; the struct is then zeroed.
sgs_status sgsi_deep_reserve(sgsi_deep *deep, const sgs_deep_options *options, int width, int rows);
void sgsi_deep_free(sgsi_deep *deep);

// Starts the band at first_row: all pixels are empty.
void sgsi_deep_begin(sgsi_deep *deep, int first_row, int rows);

// Callback for sgsi_aov.visit; context is the sgsi_deep.
void sgsi_deep_visit(void *context, const sgsi_block_hits *hits);

// Compacts the samples to the front of `samples`, in row-major pixel order. Returns their number.
size_t sgsi_deep_pack(sgsi_deep *deep);
