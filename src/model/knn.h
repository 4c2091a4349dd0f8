// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Exact distances to the three nearest other points of a cloud. Knows nothing of Gaussians.

#include <stddef.h>

#include "sparegs/status.h"

enum { SGSI_KNN_NEIGHBOURS = 3 };

// points [n][3], finite. distances [n][3] receives the squared Euclidean distances to the three
// nearest other points, ascending; neighbours that do not exist (n < 4) are +infinity. Another
// point at the same place counts, at distance 0. O(n log n), parallel; the same bits for every
// number of threads. Fails with OUT_OF_MEMORY, or LIMIT for n >= 2^32.
sgs_status sgsi_knn(const float *points, size_t n, double *distances);
