// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Exact nearest neighbours in a point cloud: distances to the three nearest other points, or the
// indices of any number.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

enum { SGSI_KNN_NEIGHBOURS = 3 };

// points [n][3], finite. distances [n][3] receives the squared Euclidean distances to the three
// nearest other points, ascending; missing neighbours (n < 4) are +infinity. Coincident points
// count, at distance 0. O(n log n), parallel; the same bits with any number of threads. Fails with
// OUT_OF_MEMORY, or LIMIT for n >= 2^32 - 1.
sgs_status sgsi_knn(const float *points, size_t n, double *distances);

// A search tree over a cloud, for any number of neighbours.
typedef struct sgsi_knn_tree sgsi_knn_tree;

enum { SGSI_KNN_MAX = 256 };

// points [n][3]; copied. Fails as sgsi_knn; *made is then NULL. With coordinates that are not
// finite the search is safe, but which neighbours it finds is unspecified.
sgs_status sgsi_knn_tree_create(const float *points, size_t n, sgsi_knn_tree **made);
void sgsi_knn_tree_destroy(sgsi_knn_tree *t); // accepts NULL

// The k nearest other points, k <= SGSI_KNN_MAX and k < n, of the points at places [begin, end)
// of the tree's own order, in which neighbours are near each other: neighbours[i][k] of point i
// receives their indices by ascending distance. Which of several points at the distance of the last
// one is chosen is unspecified, but the same with any number of threads. Parallel; cannot fail.
void sgsi_knn_tree_search(const sgsi_knn_tree *t, size_t begin, size_t end, size_t k,
                          uint32_t *neighbours);
