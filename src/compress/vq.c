// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "compress/vq.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "compress/vq_kernel.h"
#include "simd/kernel_variants.h"

enum { LANES = SGSI_VQ_LANES, GRAIN = 64 };

static size_t block_count(const sgsi_codebook *codebook)
{
    return (codebook->count + LANES - 1) / LANES;
}

sgs_status sgsi_codebook_create(size_t count, size_t dim, sgsi_codebook *codebook)
{
    *codebook = (sgsi_codebook){.count = count, .dim = dim};
    codebook->codes = sgsi_calloc(count, dim * sizeof(float));
    codebook->blocks = sgsi_calloc(block_count(codebook), dim * LANES * sizeof(float));
    codebook->halves = sgsi_calloc(block_count(codebook), LANES * sizeof(float));
    if (codebook->codes && codebook->blocks && codebook->halves)
        return SGS_STATUS_OK;
    sgsi_codebook_free(codebook);
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a codebook of %zu entries",
                     count);
}

void sgsi_codebook_free(sgsi_codebook *codebook)
{
    sgsi_free(codebook->codes);
    sgsi_free(codebook->blocks);
    sgsi_free(codebook->halves);
    *codebook = (sgsi_codebook){0};
}

static void fill_blocks(sgsi_codebook *codebook)
{
    for (size_t k = 0; k < block_count(codebook) * LANES; ++k) {
        const float *code = codebook->codes + k * codebook->dim;
        double norm = 0;
        for (size_t d = 0; d < codebook->dim; ++d) {
            const float x = k < codebook->count ? code[d] : 0;
            codebook->blocks[(k / LANES * codebook->dim + d) * LANES + k % LANES] = x;
            norm += (double)x * x;
        }
        codebook->halves[k] = k < codebook->count ? (float)(0.5 * norm) : INFINITY;
    }
}

static void (*const kernels[SGS_ISA_COUNT])(const sgsi_vq_job *, size_t,
                                            size_t) = SGSI_VARIANTS(sgsi_vq_nearest);

static void assign_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sgsi_vq_job *job = context;
    kernels[sgs_isa_get()](job, begin, end);
}

void sgsi_codebook_assign(sgsi_codebook *codebook, const float *data, size_t stride,
                          const uint32_t *rows, size_t count, uint32_t *nearest)
{
    fill_blocks(codebook);
    sgsi_vq_job job = {.blocks = codebook->blocks,
                       .halves = codebook->halves,
                       .block_count = block_count(codebook),
                       .dim = codebook->dim,
                       .data = data,
                       .stride = stride,
                       .rows = rows,
                       .nearest = nearest};
    sgsi_parallel_ranges(count, GRAIN, assign_range, &job);
}

size_t sgsi_draw_batch(size_t count, size_t draws, uint64_t seed, uint64_t step, uint32_t *slots,
                       uint32_t *rows, uint32_t *times)
{
    size_t distinct = 0;
    for (size_t k = 0; k < draws; ++k) {
        const uint64_t bits = sgsi_random_bits(seed, step * draws + k) >> 32;
        const uint32_t row = (uint32_t)(bits * count >> 32);
        if (slots[row] == UINT32_MAX) {
            slots[row] = (uint32_t)distinct;
            rows[distinct] = row;
            times[distinct++] = 0;
        }
        ++times[slots[row]];
    }
    for (size_t k = 0; k < distinct; ++k)
        slots[rows[k]] = UINT32_MAX;
    return distinct;
}
