// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The noise term of stochastic gradient Langevin dynamics on the means of a model (Kheradmand et
// al. 2024, arXiv 2404.09591).

#include <stdint.h>

#include "sparegs/gaussians.h"

// Rows of a larger opacity get no noise: the gate is below 5.1e-7 there.
#define SGSI_NOISE_OPACITY_MAX 0.15

// g(o) = 1 / (1 + exp(100 (o - 0.005))): noise is for faint primitives.
double sgsi_position_noise_gate(double opacity);

// mean += scale g(o) Sigma xi with xi ~ N(0, 1)^3 for every row, Sigma = R S^2 R^T. xi is a
// function of seed, iteration and row alone. The model has the rows of `rank` of `ranks`
// (base/row_groups.h; 0 of 1: all). Moments stay. Parallel; cannot fail.
void sgsi_position_noise_add(sgs_gaussians *model, int rank, int ranks, double scale, uint64_t seed,
                             int iteration);
