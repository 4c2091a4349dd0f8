// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// sgs_ply_write for a model that arrives in parts, in the order of its rows.

#include <stdbool.h>

#include "sparegs/gaussians.h"

typedef struct sgsi_ply_parts sgsi_ply_parts;

// For `count` rows of the SH degree of `like`. Fails as sgs_ply_write; *parts is then NULL.
sgs_status sgsi_ply_parts_begin(const char *path, const sgs_gaussians *like, size_t count,
                                sgsi_ply_parts **parts);
// A failure is that of sgsi_ply_parts_end.
void sgsi_ply_parts_add(sgsi_ply_parts *parts, const sgs_gaussians *rows);
// Puts the file in place or, unless it is complete, removes it. Frees `parts`.
sgs_status sgsi_ply_parts_end(sgsi_ply_parts *parts, bool complete);
