// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Fragile pixels. The list of hits is a discontinuous function. Single precision may decide
// differently where two hits are within 1e-5 of each other in t, alpha is within 1e-4 of 1/255, T
// (1 - alpha) is within 1e-3 of 1e-4, or t is within 1e-5 of the near distance (all relative). In
// these pixels the image may differ by as much as one decision allows. In all others the ordered
// lists must be identical.

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "reference/reference.h"

typedef struct pixel_truth {
    size_t count; // counted hits, in order
    bool fragile;
    bool median_fragile; // some T (1 - alpha) within 1e-4 of 0.5
} pixel_truth;

static inline int fragile_by_distance(const void *a, const void *b)
{
    const sgs_hit *x = a, *y = b;
    return x->t < y->t   ? -1
           : x->t > y->t ? 1
                         : (x->primitive > y->primitive) - (x->primitive < y->primitive);
}

// Hits of a ray, with the margins above. `hits`: room for all primitives.
static inline pixel_truth judge(const sgsi_reference_view *view, const double direction[3],
                                sgs_hit *hits)
{
    const double close = 1e-5, faint = 1e-4;
    pixel_truth truth = {0};
    size_t found = 0;
    for (size_t i = 0; i < view->count; ++i) {
        double rho2, t;
        sgsi_reference_response(&view->primitives[i], direction, &rho2, &t);
        const double alpha = view->primitives[i].opacity * exp(-0.5 * rho2);
        if (!(alpha * 255 >= 1 - faint) || !(t > view->near_distance * (1 - close)))
            continue;
        truth.fragile |= alpha * 255 < 1 + faint || t < view->near_distance * (1 + close);
        if (alpha * 255 >= 1 && t > view->near_distance)
            hits[found++] = (sgs_hit){(uint32_t)i, t, fmin(alpha, 0.99), 0};
    }
    qsort(hits, found, sizeof *hits, fragile_by_distance);
    double transmittance = 1;
    for (size_t k = 0; k < found; ++k) {
        const double next = transmittance * (1 - hits[k].alpha);
        hits[k].transmittance = transmittance;
        truth.fragile |= fabs(next / 1e-4 - 1) < 1e-3;
        truth.median_fragile |= fabs(next - 0.5) < 1e-4;
        if (k && hits[k].t != hits[k - 1].t)
            truth.fragile |= hits[k].t - hits[k - 1].t < close * hits[k].t;
        if (next < 1e-4)
            return truth;
        transmittance = next;
        ++truth.count;
    }
    return truth;
}
