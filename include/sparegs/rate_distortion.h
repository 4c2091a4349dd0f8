// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Bjontegaard deltas: how two rate-distortion curves differ on average, in size at equal quality
// and in quality at equal size. Pure functions.
//
// Threads: all functions may be called from any thread at any time.

#include <stddef.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// One operating point.
typedef struct sgs_rd_point {
    double size; // > 0, in any unit that both curves share
    double psnr; // dB, finite
} sgs_rd_point;

typedef struct sgs_bd {
    double rate_percent; // mean change in size at equal PSNR, percent; < 0 is smaller. NaN = N/A
    double psnr_db;      // mean change in PSNR at equal size, dB; > 0 is better. NaN = N/A
    const char *rate_reason, *psnr_reason; // why a figure is N/A, or NULL; owned by the library
    // Points moved by 1e-9 because another point of their curve has the same PSNR or size.
    size_t ties;
    // Width in dB of the common range of PSNR, over which the rate is a mean; 0 = none, or the
    // curves were not compared. Below 0.02, the rate depends on the rounding of the points.
    double common_psnr_db;
} sgs_bd;

// Compares `test` with `anchor` (Bjontegaard, VCEG-M33, 2001). The curves are interpolated by
// monotone cubic Hermite polynomials (PCHIP: Fritsch and Butland 1984) of ln(size) over PSNR for
// the rate, and of PSNR over ln(size) for the PSNR, and integrated over the common range. The
// points may be in any order.
//
// N/A: fewer than three points; a smaller file that is better by more than 0.02 dB (the curve is
// not monotone); for the rate, no common range of PSNR; for the PSNR, a common range of sizes with
// largest / smallest below 1.04.
//
// Fails with INVALID_ARGUMENT (a size is not positive, or a value is not finite) or OUT_OF_MEMORY;
// both figures are then NaN.
SGS_API sgs_status sgs_bd_compute(const sgs_rd_point *anchor, size_t anchor_count,
                                  const sgs_rd_point *test, size_t test_count, sgs_bd *bd);

#ifdef __cplusplus
}
#endif
