// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The mathematics of relocation (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain
// Monte Carlo", equation 9): how n equal copies replace one primitive without changing the image,
// and draws with replacement. Pure functions on numbers.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

// Opacity of each of n >= 1 coincident primitives that together are as opaque in the centre as one
// of `opacity` in (0, 1): 1 - (1 - opacity)^(1/n).
double sgsi_relocation_opacity(double opacity, uint32_t n);

// Factor on the scales of these n primitives (equation 9).
double sgsi_relocation_scale(double opacity, uint32_t n);

// The opacity, limited to the range after a relocation: 0.005 to 1 - 2^-23.
double sgsi_relocation_clamp(double opacity);

// Draws rows with replacement, with probabilities proportional to weight [count] (>= 0). drawn
// [draws] receives the rows in the order of the draws; `seed` names the draw. *drew is false, and
// drawn untouched, when all weights are 0. Fails with OUT_OF_MEMORY.
sgs_status sgsi_draw_rows(const double *weight, size_t count, size_t draws, uint64_t seed,
                          uint32_t *drawn, bool *drew);
