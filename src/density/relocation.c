// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Kheradmand et al. 2024, equation 9 and its derivation in the appendix. n coincident Gaussians of
// opacity o' and scale s' have the profile 1 - (1 - o' g)^n with g = exp(-x^2 / (2 s'^2)) on a line
// through the centre. Its value at the centre and its integral must be those of one Gaussian of
// opacity o and scale s:
//
//   1 - (1 - o')^n = o                              =>  o' = 1 - (1 - o)^(1/n)
//   s' sqrt(2 pi) D = o s sqrt(2 pi)                =>  s' = s o / D
//   D = sum_{j=1..n} C(n, j) (-1)^(j-1) o'^j / sqrt(j)
//
// because (1 - o' g)^n = sum C(n, j) (-o' g)^j and the integral of g^j is s' sqrt(2 pi / j). The
// paper writes D as the double sum over i = 1..n, k = 0..i-1 of C(i-1, k) (-1)^k o'^(k+1) /
// sqrt(k+1); summed over i first, C(i-1, k) gives C(n, k+1). The magnitudes of the terms add up to
// (1 + o')^n - 1 < 1 / (1 - o), so that doubles suffice for every n; the released code stops at 51.

#include "density/relocation.h"

#include <math.h>

#include "base/core.h"

static const double MIN_OPACITY = 0.005, MAX_OPACITY = 1.0 - 0x1p-23;

double sgsi_relocation_clamp(double opacity)
{
    return fmin(fmax(opacity, MIN_OPACITY), MAX_OPACITY);
}

double sgsi_relocation_opacity(double opacity, uint32_t n)
{
    return -expm1(log1p(-fmin(opacity, MAX_OPACITY)) / n);
}

double sgsi_relocation_scale(double opacity, uint32_t n)
{
    const double whole = fmin(opacity, MAX_OPACITY), part = sgsi_relocation_opacity(whole, n);
    double term = 1.0, sum = 0.0; // term: C(n, j) part^j
    for (uint32_t j = 1; j <= n && term > 0.0; ++j) {
        term *= part * (double)(n - j + 1) / j;
        sum += (j & 1 ? term : -term) / sqrt(j);
    }
    return whole / sum;
}

// First row whose prefix sum exceeds `value`.
static size_t find_row(const double *prefix, size_t count, double value)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (prefix[middle] > value)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

sgs_status sgsi_draw_rows(const double *weight, size_t count, size_t draws, uint64_t seed,
                          uint32_t *drawn, bool *drew)
{
    *drew = false;
    double *prefix = sgsi_alloc(count ? count : 1, sizeof *prefix);
    if (!prefix)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to draw from %zu primitives",
                         count);
    double total = 0.0;
    size_t last = 0;
    for (size_t i = 0; i < count; ++i) {
        total += weight[i];
        prefix[i] = total;
        last = weight[i] > 0.0 ? i : last;
    }
    *drew = total > 0.0;
    for (size_t j = 0; j < draws && *drew; ++j) {
        const size_t row = find_row(prefix, count, sgsi_random_uniform(seed, j) * total);
        drawn[j] = (uint32_t)(row > last ? last : row); // where u rounds to 1
    }
    sgsi_free(prefix);
    return SGS_STATUS_OK;
}
