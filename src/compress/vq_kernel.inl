// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Nearest code: the smallest |c|^2 / 2 - x.c, for four rows and sixteen codes at a time. Every
// value is one chain of fused multiply-adds in the order of the dimensions.

#include "compress/vq_kernel.h"

enum { VQ_ROWS = 4 };

static inline void vq_rows(const sgsi_vq_job *job, const float *const x[VQ_ROWS],
                           uint32_t nearest[VQ_ROWS])
{
    vf best[VQ_ROWS], at[VQ_ROWS];
    for (int r = 0; r < VQ_ROWS; ++r) {
        best[r] = vf_set1(3e38f);
        at[r] = vf_zero();
    }
    for (size_t b = 0; b < job->block_count; ++b) {
        const float *codes = job->blocks + b * job->dim * 16;
        vf sum[VQ_ROWS];
        for (int r = 0; r < VQ_ROWS; ++r)
            sum[r] = vf_load(job->halves + b * 16);
        for (size_t d = 0; d < job->dim; ++d) {
            const vf code = vf_load(codes + d * 16);
            for (int r = 0; r < VQ_ROWS; ++r)
                sum[r] = vf_fnma(vf_set1(x[r][d]), code, sum[r]);
        }
        const vf block = vf_set1((float)b);
        for (int r = 0; r < VQ_ROWS; ++r) {
            const vm smaller = vf_lt(sum[r], best[r]);
            best[r] = vf_select(smaller, sum[r], best[r]);
            at[r] = vf_select(smaller, block, at[r]);
        }
    }
    for (int r = 0; r < VQ_ROWS; ++r) {
        float values[16] __attribute__((aligned(64))), blocks[16] __attribute__((aligned(64)));
        vf_store(values, best[r]);
        vf_store(blocks, at[r]);
        uint32_t chosen = (uint32_t)blocks[0] * 16;
        float least = values[0];
        for (uint32_t lane = 1; lane < 16; ++lane) {
            const uint32_t code = (uint32_t)blocks[lane] * 16 + lane;
            if (values[lane] < least || (values[lane] == least && code < chosen)) {
                least = values[lane];
                chosen = code;
            }
        }
        nearest[r] = chosen;
    }
}

void SGSI_KERNEL(sgsi_vq_nearest)(const sgsi_vq_job *job, size_t begin, size_t end)
{
    for (size_t i = begin; i < end; i += VQ_ROWS) {
        const float *x[VQ_ROWS];
        uint32_t nearest[VQ_ROWS];
        for (size_t r = 0; r < VQ_ROWS; ++r)
            x[r] = job->data + job->rows[i + r < end ? i + r : end - 1] * job->stride;
        vq_rows(job, x, nearest);
        for (size_t r = 0; r < VQ_ROWS && i + r < end; ++r)
            job->nearest[i + r] = nearest[r];
    }
}
