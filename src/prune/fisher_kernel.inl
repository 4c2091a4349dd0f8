// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fisher matrices of the primitives of one block of 16 rays, in double precision. Compiled once per
// instruction set; all of them perform the same operations, so the bits are equal.
//
// Let m = p + t g be the vector from the mean to the point of largest response, in the primitive's
// metric, so that rho^2 = |m|^2. As t maximises the response,
//     -1/2 d rho^2 / d mean = M^T m + (sum over k of m_k^2 / v''_k) 1/2 d eps^2 / d mean,
//     -1/2 d rho^2 / d log s_k = m_k^2 s_k^2 / v''_k,
// with v'' = s''^2 and eps^2 the pixel filter's variance. With u these six values plus the gradient
// of ln o'', alpha = o'' exp(-rho^2 / 2) has the gradient alpha u (the clamp at 0.99 is ignored,
// as in 3DGS), and the channel c of the pixel
//     g_c = v_c u + T alpha d color_c / d mean,  v_c = alpha (T color_c - behind_c / (1 - alpha)),
// behind_c what the hits behind this one and the background add to the pixel.

#include <math.h>
#include <string.h>

#include "prune/fisher.h"

#define ALPHA_MIN (1.0 / 255)
#define ALPHA_MAX 0.99
#define TRANSMITTANCE_MIN 1e-4

typedef double v8 __attribute__((vector_size(64)));
typedef int64_t i8 __attribute__((vector_size(64)));

static inline v8 load8(const double *from)
{
    v8 value;
    memcpy(&value, __builtin_assume_aligned(from, 64), sizeof value);
    return value;
}

static inline void store8(double *to, v8 value)
{
    memcpy(__builtin_assume_aligned(to, 64), &value, sizeof value);
}

static inline v8 keep8(i8 mask, v8 value) // 0 elsewhere
{
    return (v8)(mask & (i8)value);
}

// Fixed order, for equal bits.
static inline double sum8(v8 x)
{
    return ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
}

// e^x for x in [-700, 0]: 2^n times the Taylor series of the rest, |rest| <= ln(2) / 2, to 4e-18.
static inline v8 exp8(v8 x)
{
    static const double inverse_factorial[12] = {
        1.0 / 6227020800, 1.0 / 479001600, 1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880, 1.0 / 40320,
        1.0 / 5040,       1.0 / 720,       1.0 / 120,      1.0 / 24,      1.0 / 6,      0.5};
    const double shift = 0x1.8p52; // rounds, and leaves the integer in the low bits
    const v8 shifted = x * 1.4426950408889634 + shift, n = shifted - shift;
    // ln 2 in two parts; the first has zeros at its end, so that its product is exact.
    const v8 rest = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    v8 sum = rest * inverse_factorial[0] + inverse_factorial[1];
    for (int k = 2; k < 12; ++k)
        sum = sum * rest + inverse_factorial[k];
    sum = (sum * rest + 1.0) * rest + 1.0;
    return (v8)((i8)sum + ((i8)shifted << 52));
}

// Response, distance and m of an entry; response 0 and distance infinite without a hit.
static inline void evaluate(const sgsi_fisher_block *block, uint32_t i)
{
    const sgsi_fisher_primitive *p = &block->primitives[block->entries[i]];
    const double *matrix = p->matrix;
    for (int half = 0; half < 16; half += 8) {
        const v8 x = load8(block->direction[0] + half), y = load8(block->direction[1] + half),
                 z = load8(block->direction[2] + half);
        v8 g[3], g2 = {0}, along = {0}, rho2 = {0};
        for (int k = 0; k < 3; ++k) {
            g[k] = x * matrix[3 * k] + y * matrix[3 * k + 1] + z * matrix[3 * k + 2];
            g2 += g[k] * g[k];
            along += g[k] * p->offset[k];
        }
        const v8 t = -along / g2; // NaN without a ray: no comparison holds
        for (int k = 0; k < 3; ++k) {
            const v8 m = t * g[k] + p->offset[k];
            rho2 += m * m;
            store8(block->m + 48 * (size_t)i + 16 * k + half, m);
        }
        const i8 inside = rho2 < 1400.0;
        const v8 response = exp8(keep8(inside, rho2) * -0.5) * p->opacity;
        const i8 hit = (response >= ALPHA_MIN) & (t > block->near_distance) & inside;
        store8(block->response + 16 * (size_t)i + half, keep8(hit, response));
        store8(block->t + 16 * (size_t)i + half, keep8(hit, t));
    }
}

// The entries that a lane hits, by (distance, id). They are nearly sorted. Returns their number.
static inline uint32_t order_lane(const sgsi_fisher_block *block, uint32_t lane)
{
    uint32_t hits = 0, *order = block->order;
    for (uint32_t i = 0; i < block->count; ++i) {
        if (!(block->response[16 * (size_t)i + lane] > 0))
            continue;
        const double t = block->t[16 * (size_t)i + lane];
        const uint32_t id = block->ids[block->entries[i]];
        uint32_t at = hits++;
        for (; at > 0; --at) {
            const uint32_t before = order[at - 1];
            const double t_before = block->t[16 * (size_t)before + lane];
            if (t_before < t || (t_before == t && block->ids[block->entries[before]] < id))
                break;
            order[at] = before;
        }
        order[at] = i;
    }
    return hits;
}

// Weights T alpha and v of the counted hits of a lane; front to back for T, back to front for what
// lies behind.
static inline void blend_lane(const sgsi_fisher_block *block, uint32_t lane)
{
    const uint32_t hits = order_lane(block, lane);
    double transmittance = 1, behind[3];
    uint32_t counted = 0;
    for (; counted < hits; ++counted) {
        const size_t row = 16 * (size_t)block->order[counted] + lane;
        const double response = block->response[row];
        const double alpha = response < ALPHA_MAX ? response : ALPHA_MAX;
        if (transmittance * (1 - alpha) < TRANSMITTANCE_MIN)
            break;
        block->weight[row] = transmittance * alpha;
        transmittance *= 1 - alpha;
    }
    for (int c = 0; c < 3; ++c)
        behind[c] = transmittance * block->background[c];
    for (uint32_t k = counted; k-- > 0;) {
        const uint32_t i = block->order[k];
        const sgsi_fisher_primitive *p = &block->primitives[block->entries[i]];
        const size_t row = 16 * (size_t)i + lane;
        const double response = block->response[row], weight = block->weight[row];
        const double alpha = response < ALPHA_MAX ? response : ALPHA_MAX;
        const double front = weight / alpha;
        for (int c = 0; c < 3; ++c) {
            block->v[48 * (size_t)i + 16 * (size_t)c + lane] =
                response * (front * p->color[c] - behind[c] / (1 - alpha));
            behind[c] += weight * p->color[c];
        }
    }
}

// Adds the outer products of the three channels' gradients over the lanes of an entry.
static inline void add_entry(const sgsi_fisher_block *block, uint32_t i)
{
    const sgsi_fisher_primitive *p = &block->primitives[block->entries[i]];
    v8 total[SGSI_FISHER_ENTRIES] = {{0}};
    for (int half = 0; half < 16; half += 8) {
        const v8 weight = load8(block->weight + 16 * (size_t)i + half);
        v8 m[3], u[6], spread = {0};
        for (int k = 0; k < 3; ++k) {
            // Lanes without a ray hold NaN.
            m[k] = keep8(weight > 0.0, load8(block->m + 48 * (size_t)i + 16 * k + half));
            const v8 square = m[k] * m[k];
            spread += square * p->inv_variance[k];
            u[3 + k] = square * p->ratio[k] + p->d_log_opacity[3 + k];
        }
        for (int k = 0; k < 3; ++k)
            u[k] = m[0] * p->matrix[k] + m[1] * p->matrix[3 + k] + m[2] * p->matrix[6 + k] +
                   spread * p->depth[k] + p->d_log_opacity[k];
        for (int c = 0; c < 3; ++c) {
            const v8 v = load8(block->v + 48 * (size_t)i + 16 * c + half);
            v8 g[6];
            for (int k = 0; k < 3; ++k) {
                g[k] = v * u[k] + weight * p->d_color[c][k];
                g[3 + k] = v * u[3 + k];
            }
            int at = 0;
            for (int a = 0; a < 6; ++a)
                for (int b = a; b < 6; ++b, ++at)
                    total[at] += g[a] * g[b];
        }
    }
    double *sums = block->sums[block->entries[i]];
    for (int k = 0; k < SGSI_FISHER_ENTRIES; ++k)
        sums[k] += sum8(total[k]);
}

void SGSI_KERNEL(sgsi_fisher_block)(sgsi_fisher_block *block)
{
    memset(block->weight, 0, 16 * (size_t)block->count * sizeof *block->weight);
    memset(block->v, 0, 48 * (size_t)block->count * sizeof *block->v);
    for (uint32_t i = 0; i < block->count; ++i)
        evaluate(block, i);
    for (uint32_t lane = 0; lane < 16; ++lane)
        blend_lane(block, lane);
    for (uint32_t i = 0; i < block->count; ++i)
        add_entry(block, i);
}
