// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The splats of an OpenUSD file: the values of each prim as the text gives them, and their
// conversion to one model. Does not parse.

#include "sparegs/status.h"
#include "storage/model_rows.h"
#include "usd/usd_transform.h"

typedef enum sgsi_usd_values {
    SGSI_USD_POSITIONS,
    SGSI_USD_ORIENTATIONS,
    SGSI_USD_SCALES,
    SGSI_USD_OPACITIES,
    SGSI_USD_SH,
    SGSI_USD_VALUES
} sgsi_usd_values;

// Attributes of the schema: float and half variant, numbers per value.
typedef struct sgsi_usd_attribute {
    const char *name, *half;
    size_t components;
} sgsi_usd_attribute;

extern const sgsi_usd_attribute sgsi_usd_attributes[SGSI_USD_VALUES];

// One prim with splats.
typedef struct sgsi_usd_splats {
    int line;      // of its brace
    int sh_degree; // -1: not given
    float *values[SGSI_USD_VALUES];
    size_t counts[SGSI_USD_VALUES], capacities[SGSI_USD_VALUES];
    bool animated[SGSI_USD_VALUES]; // has time samples
    bool absent[SGSI_USD_VALUES];   // after the check: the fallback is used
    double world[4][4];
    bool placed;          // the prims above have no effect
    sgsi_usd_fault fault; // of its transform
    double white_point;
    char color_space[SGSI_USD_NAME + 1]; // "" if no prim has one
} sgsi_usd_splats;

// Checks the prims, replaces missing values by the fallbacks of the schema, with a warning for each
// kind of value. total: splats of all prims; sh_degree: the highest. Fails with FORMAT or
// UNSUPPORTED.
sgs_status sgsi_usd_splats_check(const char *path, sgsi_usd_splats *prims, size_t count,
                                 size_t *total, int *sh_degree);

// Appends the splats of a checked prim. Fails with UNSUPPORTED if its transform is invalid.
sgs_status sgsi_usd_splats_decode(const sgsi_usd_splats *prim, bool z_up, sgsi_rows *rows);
