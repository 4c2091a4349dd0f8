// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Static transforms of OpenUSD prims: the xformOps that xformOpOrder lists, and the similarity that
// the product of such transforms is. Matrices act on row vectors, as in OpenUSD: p M. No animation.

#include <locale.h>
#include <stdbool.h>

#include "model/similarity.h"

enum { SGSI_USD_NAME = 63, SGSI_USD_OPERATIONS = 32 };

typedef enum sgsi_usd_fault {
    SGSI_USD_SOUND,
    SGSI_USD_ANIMATED, // a listed operation has time samples
    SGSI_USD_INVALID,  // one has an unknown type or no valid value
    SGSI_USD_CROWDED   // more than SGSI_USD_OPERATIONS
} sgsi_usd_fault;

typedef struct sgsi_usd_operation {
    char name[SGSI_USD_NAME + 1]; // of the attribute
    double values[16];
    int count;
    bool given, animated;
} sgsi_usd_operation;

typedef struct sgsi_usd_transform {
    sgsi_usd_operation operations[SGSI_USD_OPERATIONS];
    struct {
        char name[SGSI_USD_NAME + 1];
        bool inverse;
    } order[SGSI_USD_OPERATIONS]; // xformOpOrder
    int count, listed;
    bool resets;  // ignores the prims above
    bool crowded; // has more operations
} sgsi_usd_transform;

// A prim without operations.
void sgsi_usd_transform_begin(sgsi_usd_transform *transform);
// The attribute `name`, "xformOp:..." or "xformOp:....timeSamples", with the text after its '=',
// which ends with NUL.
void sgsi_usd_transform_set(sgsi_usd_transform *transform, const char *name, const char *text,
                            locale_t c_locale);
// The text after "xformOpOrder =".
void sgsi_usd_transform_order(sgsi_usd_transform *transform, const char *text);
// The matrix of the prim in its parent. Attributes that are not listed have no effect, nor have
// listed ones without attribute. `matrix` is undefined after a fault.
sgsi_usd_fault sgsi_usd_transform_matrix(const sgsi_usd_transform *transform, double matrix[4][4]);

void sgsi_usd_identity(double matrix[4][4]);
// left = left right: `left` acts first.
void sgsi_usd_multiply(double left[4][4], const double right[4][4]);

// mirrored: the points change their signs first. False if the matrix is no similarity.
bool sgsi_usd_similarity(const double matrix[4][4], sgsi_similarity *similarity, bool *mirrored);
