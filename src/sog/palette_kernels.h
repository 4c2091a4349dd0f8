// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The nearest entry of each of a range of vectors: the inner loop of k-means, once per instruction
// set. All give the same bits.

#include <stddef.h>
#include <stdint.h>

enum { SGSI_PALETTE_GROUP = 16 };

typedef struct sgsi_nearest {
    const float *vectors; // [][dimensions]
    const uint32_t *rows; // of the vectors
    size_t dimensions;
    const float *groups; // [group_count][dimensions][16]: entries, 16 together, 64-byte aligned
    size_t group_count;
    uint32_t *labels; // out: the first of the nearest entries
    float *errors;    // out: squared distances
} sgsi_nearest;

typedef void (*sgsi_nearest_fn)(const sgsi_nearest *job, size_t begin, size_t end);

void sgsi_palette_nearest_baseline(const sgsi_nearest *job, size_t begin, size_t end);
void sgsi_palette_nearest_avx2(const sgsi_nearest *job, size_t begin, size_t end);
void sgsi_palette_nearest_avx512(const sgsi_nearest *job, size_t begin, size_t end);
