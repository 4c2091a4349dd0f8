// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The kernel of vector quantisation, once per instruction set.

#include <stddef.h>
#include <stdint.h>

typedef struct sgsi_vq_job {
    const float *blocks, *halves; // of sgsi_codebook
    size_t block_count, dim;
    const float *data;
    size_t stride;
    const uint32_t *rows;
    uint32_t *nearest;
} sgsi_vq_job;

// Rows [begin, end) of the job.
void sgsi_vq_nearest_baseline(const sgsi_vq_job *job, size_t begin, size_t end);
#ifdef SGSI_AVX_KERNELS
void sgsi_vq_nearest_avx2(const sgsi_vq_job *job, size_t begin, size_t end);
void sgsi_vq_nearest_avx512(const sgsi_vq_job *job, size_t begin, size_t end);
#endif
