// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// sgs_gaussians_hash of a model that arrives in parts.

#include "sparegs/gaussians.h"

typedef struct sgsi_gaussians_hasher sgsi_gaussians_hasher;

// For a model of `count` rows. NULL if out of memory; release it with sgsi_gaussians_hash_end.
sgsi_gaussians_hasher *sgsi_gaussians_hash_begin(size_t count, int sh_degree);
// The next rows, in order.
void sgsi_gaussians_hash_rows(sgsi_gaussians_hasher *hasher, const sgs_gaussians *rows);
// Writes the hash and frees the hasher; accepts NULL, and leaves `hex` then.
void sgsi_gaussians_hash_end(sgsi_gaussians_hasher *hasher, char hex[17]);
