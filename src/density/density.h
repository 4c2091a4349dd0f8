// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Structural updates: clone, split and remove primitives by the rules of a base pipeline, weighted
// and pruned by SPARE-GS. Works on the model, its moments and its statistics; independent of images
// and BVH.

#include "base/row_groups.h"
#include "density/density_columns.h"
#include "sparegs/gaussians.h"

struct sgsi_pipeline;

// Per primitive, since the last structural update (Kerbl et al. 2023, section 5.2; a_i, d_i and
// rho_i of the SPARE-GS paper, equations 16 to 18). 64-byte aligned columns, `capacity` long.
typedef struct sgsi_statistics {
    float *gradient_sum;     // a_i
    float *abs_grad_sum;     // sum of absolute per-pixel gradients; 0 unless the run uses it
    uint32_t *visible_count; // d_i
    float *radius_max;       // rho_i, pixels
    size_t capacity;
} sgsi_statistics;

// Grows the columns; if it does, all of them are zeroed. Fails with OUT_OF_MEMORY.
sgs_status sgsi_statistics_reserve(sgsi_statistics *statistics, size_t capacity);
void sgsi_statistics_clear(sgsi_statistics *statistics, size_t count);
// Scales the radii, which are in pixels, after a change of the image size by `factor`. Gradients
// are per half image width and do not change.
void sgsi_statistics_resize_images(sgsi_statistics *statistics, size_t count, float factor);
void sgsi_statistics_free(sgsi_statistics *statistics);

// Processes that share the rows in groups (base/row_groups.h). All make the same calls in the same
// order.
typedef struct sgsi_row_peers {
    void *context;
    int rank, ranks;
    // Places `own`, `size` bytes for each row of this process, and those of all others in whole
    // [rows][size].
    sgs_status (*gather)(void *context, sgs_status status, const void *own, size_t size,
                         size_t rows, void *whole);
    // Memory for `items` of 64 bytes; NULL if there is none. _exchange sends the first to[0] of
    // them to process 0, the next to[1] to process 1, ...; *got receives from[r] of each.
    float *(*room)(void *context, size_t items);
    sgs_status (*exchange)(void *context, sgs_status status, const size_t *to, const size_t *from,
                           const float **got);
} sgsi_row_peers;

// What an update changes. m and v are moments in the model's layout and capacity; both may be
// reallocated.
typedef struct sgsi_density_rows {
    sgs_gaussians *model;
    float **m, **v;
    sgsi_statistics *statistics;
    size_t fixed; // number of rows at the end that keep their values and their order
    // NULL: one process, which has all rows. Else model, moments and statistics are those of this
    // process; `fixed` counts the rows of all.
    const sgsi_row_peers *peers;
    size_t *count; // rows of all processes: read, then replaced
} sgsi_density_rows;

// One structural update by the rules of a pipeline. Moments move with their rows; those of new rows
// are 0. The new rows are in Morton order of their means. Clears the statistics. Fails with
// OUT_OF_MEMORY, or as options.compare; unless result->unchanged the model is then unusable.
sgs_status sgsi_density_update(const sgsi_density_rows *rows, const struct sgsi_pipeline *pipeline,
                               const sgsi_density_options *options, sgsi_density_result *result);

// Opacity reset: logit <- logit(min(o, ceiling)), its moments <- 0. With filter_3d ([count], or
// NULL) the ceiling applies to the opacity after Mip-Splatting's filter.
void sgsi_density_reset_opacity(sgs_gaussians *model, float *m, float *v, double ceiling,
                                const float *filter_3d);

// Sorts the rows of a new model without moments into Morton order. Fails with OUT_OF_MEMORY.
sgs_status sgsi_density_sort(sgs_gaussians *model);
