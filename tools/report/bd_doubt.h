// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Why Bjontegaard deltas depend on the rounding of the points: warnings of `bd` and `report`.

#include "sparegs/rate_distortion.h"

// The k-th reason from 0, or NULL after the last one. Release with free().
char *bd_doubt(const sgs_bd *bd, int k);
