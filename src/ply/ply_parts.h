// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// sgs_ply_write and sgs_ply_read for a model in parts, in the order of its rows.

#include <stdbool.h>

#include "sparegs/gaussians.h"
#include "sparegs/image.h"

typedef struct sgsi_ply_parts sgsi_ply_parts;

typedef enum sgsi_ply_kind {
    SGSI_PLY_PLAIN,
    SGSI_PLY_ANTIALIASED, // with the comment of models trained with Mip-Splatting's filters
    SGSI_PLY_FILTER_3D,   // with a column filter_3D, as sgs_ply_write_filter_3d
    SGSI_PLY_POINTS       // centres and base colours, as sgs_ply_write_points
} sgsi_ply_kind;

typedef struct sgsi_ply_contents {
    sgsi_ply_kind kind;
    sgs_model_colors colors; // all zero: no comment
} sgsi_ply_contents;

// For `count` rows of the SH degree of `like`. Fails as sgs_ply_write; *parts is then NULL.
sgs_status sgsi_ply_parts_begin(const char *path, const sgs_gaussians *like, size_t count,
                                const sgsi_ply_contents *contents, sgsi_ply_parts **parts);
// filter_3d [rows->count]: the column, NULL without it. A failure is that of sgsi_ply_parts_end.
void sgsi_ply_parts_add(sgsi_ply_parts *parts, const sgs_gaussians *rows, const float *filter_3d);
// Puts the file in place or, unless it is complete, removes it. Frees `parts`.
sgs_status sgsi_ply_parts_end(sgsi_ply_parts *parts, bool complete);

typedef struct sgsi_ply_source sgsi_ply_source;

// The number of rows and the SH degree of a file. `path` must outlive the source. Fails as
// sgs_ply_read; *source is then NULL.
sgs_status sgsi_ply_source_open(const char *path, sgsi_ply_source **source, size_t *count,
                                int *sh_degree);
// Replaces the first rows of `rows`, which are inert, by the next rows->count ones of the file.
// Those that sgs_ply_read drops are left out, and inert rows remain at the end. A failure is that
// of sgsi_ply_source_close.
void sgsi_ply_source_next(sgsi_ply_source *source, sgs_gaussians *rows);
// Warns of dropped rows and frees `source`.
sgs_status sgsi_ply_source_close(sgsi_ply_source *source);
