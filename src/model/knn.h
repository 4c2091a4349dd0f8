// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Exact distances to the three nearest other points of a point cloud.

#include <stddef.h>

#include "sparegs/status.h"

enum { SGSI_KNN_NEIGHBOURS = 3 };

// points [n][3], finite. distances [n][3] receives the squared Euclidean distances to the three
// nearest other points, ascending; missing neighbours (n < 4) are +infinity. Coincident points
// count, at distance 0. O(n log n), parallel; the same bits with any number of threads. Fails with
// OUT_OF_MEMORY, or LIMIT for n >= 2^32.
sgs_status sgsi_knn(const float *points, size_t n, double *distances);
