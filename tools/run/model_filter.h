// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The filters of `convert` and of the viewer's crop: which primitives of a model are kept.

#include <stdbool.h>
#include <stdint.h>

#include "sparegs/model_edit.h"

typedef struct model_condition {
    char name[32];
    sgs_comparison comparison;
    double value;
} model_condition;

typedef struct model_filter {
    const double *box;    // low x, y, z, high x, y, z; NULL = none
    const double *sphere; // x, y, z, radius; NULL = none
    const model_condition *conditions;
    int condition_count;
    double opacity; // smallest one kept
    // SPARE-GS regions of the primitives; NULL = no filter by region.
    const uint32_t *region;
    const float *slack;
    int64_t only_region;                 // -1 = any
    double slack_low;                    // smallest one kept; -INFINITY = any
    const sgs_floater_options *floaters; // of the primitives that the others kept; NULL = none
} model_filter;

// Sets keep[count] to 1 for the primitives that pass all filters, else 0. False after printing the
// error.
bool model_filter_select(const model_filter *filter, const sgs_gaussians *model,
                         unsigned char *keep);
