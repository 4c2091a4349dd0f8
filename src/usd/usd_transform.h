// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Transforms of OpenUSD prims: the xformOps that xformOpOrder lists, also at a time code, and the
// product of such transforms. Matrices act on row vectors, as in OpenUSD: p M.

#include "model/affine.h"
#include "usd/usd_value.h"

enum { SGSI_USD_OPERATIONS = 32 };

typedef enum sgsi_usd_fault {
    SGSI_USD_SOUND,
    SGSI_USD_ANIMATED, // a listed operation has time samples, or a spline that is in use
    SGSI_USD_INVALID,  // one has an unknown type or no valid value
    SGSI_USD_CROWDED   // more than SGSI_USD_OPERATIONS
} sgsi_usd_fault;

typedef struct sgsi_usd_operation {
    char name[SGSI_USD_NAME + 1]; // of the attribute
    sgsi_usd_value value;
} sgsi_usd_operation;

typedef struct sgsi_usd_transform {
    sgsi_usd_operation *operations; // [count]
    struct {
        int operation;
        bool inverse;
    } order[SGSI_USD_OPERATIONS]; // xformOpOrder
    int count, listed;
    bool resets;  // ignores the prims above
    bool crowded; // has more operations
    bool keeps;   // keeps the time samples of its operations
} sgsi_usd_transform;

// A prim without operations. Those of an earlier prim must have been released.
void sgsi_usd_transform_begin(sgsi_usd_transform *transform, bool keeps);
void sgsi_usd_transform_free(sgsi_usd_transform *transform);
// The attribute `name`, "xformOp:..." or "xformOp:....timeSamples", with the text after its '='.
// False without memory.
bool sgsi_usd_transform_set(sgsi_usd_transform *transform, const char *name, sgsi_usd_text text);
// The text after "xformOpOrder =". False without memory.
bool sgsi_usd_transform_order(sgsi_usd_transform *transform, sgsi_usd_text text);
// The matrix of the prim in its parent. Attributes that are not listed have no effect, nor have
// listed ones without attribute or value. `matrix` is undefined after a fault. Time samples are a
// fault.
sgsi_usd_fault sgsi_usd_transform_matrix(const sgsi_usd_transform *transform, double matrix[4][4]);
// The same at a time code, of a transform that keeps its samples. *between becomes true if a matrix
// is between two samples, which need not be a similarity even if they are; else it is unchanged.
sgsi_usd_fault sgsi_usd_transform_at(const sgsi_usd_transform *transform, double time,
                                     double matrix[4][4], bool *between);

void sgsi_usd_identity(double matrix[4][4]);
// left = left right: `left` acts first.
void sgsi_usd_multiply(double left[4][4], const double right[4][4]);
// From a world with z up to one with y up.
void sgsi_usd_turn_y_up(double matrix[4][4]);

// False if the matrix is singular, projective or not finite.
bool sgsi_usd_affine(const double matrix[4][4], sgsi_affine *affine);
