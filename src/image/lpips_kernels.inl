// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The convolution kernel of LPIPS: sums of a block of channels and columns stay in registers. Every
// output is one chain of fused multiply-adds in the order of the taps, so the size of the block
// has no influence on its bits.

#include "image/lpips.h"

#if SGSI_ISA == 2
enum { CHANNELS = 8, VECTORS = 2 }; // 16 sums of one register
#elif SGSI_ISA == 1
enum { CHANNELS = 4, VECTORS = 1 }; // 4 sums of two registers
#else
enum { CHANNELS = 2, VECTORS = 1 };
#endif

void SGSI_KERNEL(sgsi_lpips_row)(const sgsi_lpips_row *row)
{
    for (int x = 0; x < row->width; x += 16 * VECTORS)
        for (int first = 0; first < LPIPS_GROUP; first += CHANNELS) {
            vf sum[CHANNELS][VECTORS];
            for (int c = 0; c < CHANNELS; ++c)
                for (int v = 0; v < VECTORS; ++v)
                    sum[c][v] = vf_set1(row->bias[first + c]);
            for (size_t t = 0; t < row->taps; ++t) {
                const float *in = row->in + row->offsets[t] + x;
                const float *weights = row->weights + t * LPIPS_GROUP + first;
                vf value[VECTORS];
                for (int v = 0; v < VECTORS; ++v)
                    value[v] = vf_load_u(in + 16 * v);
                for (int c = 0; c < CHANNELS; ++c) {
                    const vf weight = vf_set1(weights[c]);
                    for (int v = 0; v < VECTORS; ++v)
                        sum[c][v] = vf_fma(weight, value[v], sum[c][v]);
                }
            }
            for (int c = 0; c < CHANNELS; ++c)
                for (int v = 0; v < VECTORS; ++v)
                    vf_store_u(row->out + (size_t)(first + c) * row->out_plane + x + 16 * v,
                               vf_max(sum[c][v], vf_zero()));
        }
}
