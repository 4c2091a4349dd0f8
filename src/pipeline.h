// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The interface of a base pipeline's density control, and what pipelines share: which rows to clone, split
// and remove is decided from columns of the old rows; weights and the redundancy mask of SPARE-GS are among the columns.
// The trainer, spare/ and the machinery of density.c know pipelines through this table only.

#include "density.h"
#include "sparegs/trainer.h"

typedef enum sgsi_action { SGSI_ACTION_KEEP, SGSI_ACTION_CLONE, SGSI_ACTION_SPLIT } sgsi_action;

// Columns of the old rows of one structural update, [count] each.
typedef struct sgsi_density_columns {
    size_t count;
    float *x, *y, *z, *opacity, *scale_max;
    float *score;       // a / d, 0 where unseen
    float *absolute;    // the same over absolute values, 0 where unseen or not collected
    float *weight;      // w of SPARE-GS, 1 without BMD
    uint8_t *redundant; // RAP's mask, 0 without
    uint8_t *degenerate; // a parameter is not finite: the row goes, whatever is decided; its columns above are 0
    // decided by the pipeline; all 0 before
    uint8_t *action;    // sgsi_action
    uint8_t *removed;   // the native rule removes the row
    uint8_t *barren;    // the native rule removes the row's clone or children at once
    float *priority;    // who may grow first when the cap leaves no room for all
    void *workspace;
} sgsi_density_columns;

typedef struct sgsi_pipeline {
    const char *name;
    // Milestones of the 30 000-iteration schedule.
    int densify_until, densify_interval;
    sgs_status (*decide)(const sgsi_density_options *options, sgsi_density_columns *columns, sgsi_density_result *result);
} sgsi_pipeline;

// Never NULL for a pipeline of the enumeration.
const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline);

extern const sgsi_pipeline sgsi_pipeline_3dgs;

// ---- What pipelines share ----

// 3DGS's rule on one row: fainter than opacity_min or, where size pruning is on, longer than size_max.
static inline bool sgsi_density_outlived(const sgsi_density_options *options, float opacity, float scale_max)
{
    return opacity < (float)options->opacity_min || scale_max > (float)options->size_max;
}

// Counts a decision that w reversed.
static inline void sgsi_density_count_reversal(bool native, bool weighted, sgsi_density_result *result)
{
    result->bmd_suppressed += native && !weighted;
    result->bmd_boosted += !native && weighted;
}

// Marks (1, else 0) the `wanted` rows of largest score among those with eligible[i] (NULL: all); of equal scores the
// lower row. Fails with OUT_OF_MEMORY.
sgs_status sgsi_select_best(const double *score, const uint8_t *eligible, size_t count, size_t wanted, uint8_t *chosen);
