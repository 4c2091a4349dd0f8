// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The root layer of an OpenUSD text file or package, for readers of prims of one type: finds the
// prims that are part of the scene, with their transforms. No composition. Prims below a class and
// inactive ones are not part of the scene.

#include <stdint.h>

#include "sparegs/status.h"
#include "usd/usd_transform.h"

enum { SGSI_USD_DEPTH = 64 };

#define SGSI_USD_NONE SIZE_MAX

// A prim whose brace is open.
typedef struct sgsi_usd_scope {
    sgsi_usd_transform transform;
    const char *name; // of the prim, in the text; not terminated
    size_t name_length;
    size_t first;                            // prims of the type that began before it
    size_t own;                              // its index if it is of the type, else SGSI_USD_NONE
    bool is_hidden, is_variants, is_referer; // or one above is; referer: refers to other prims
    char color_space[SGSI_USD_NAME + 1];     // "" if it has none
} sgsi_usd_scope;

// The metadata of the layer; NaN: not given.
typedef struct sgsi_usd_times {
    double start, end, codes_per_second, frames_per_second;
} sgsi_usd_times;

typedef struct sgsi_usd_layer {
    const char *path;
    sgsi_usd_text text;
    int depth;                                 // of braces
    sgsi_usd_scope scopes[SGSI_USD_DEPTH + 1]; // [depth + 1]: the root and the open prims
    size_t prim_count;                         // of the type, so far
    bool z_up;
    bool is_package;
    bool has_references; // to other layers or prims, in some prim or in the layer
    bool has_sublayers;
    sgsi_usd_times times;
    uint8_t *bytes; // internal: the text
    struct {
        const char *name;
        size_t name_length;
        bool of_type, is_hidden, is_variants, is_referer;
    } next;         // internal: what the words before a brace say about its prim
    bool has_prims; // internal: the metadata of the layer have ended
} sgsi_usd_layer;

// What is read. The functions fail with a status and a message.
typedef struct sgsi_usd_visitor {
    const char *type;   // of the prims
    const char *plural; // "the splats are", in messages
    bool animates;      // transforms keep their time samples
    // A prim of the type begins: the innermost scope, whose index is layer->prim_count - 1.
    sgs_status (*begin)(void *context, sgsi_usd_layer *layer);
    // After "NAME =" in the innermost scope, which is such a prim. The function may read the value.
    sgs_status (*value)(void *context, sgsi_usd_layer *layer, const char *name);
    // The innermost scope ends; it is a prim of the type or has some in it: first to prim_count -
    // 1. All attributes are known. The function may take the operations of its transform.
    sgs_status (*end)(void *context, sgsi_usd_layer *layer);
} sgsi_usd_visitor;

// Opens the file and reads it. Close the layer also after a failure. Fails with IO, FORMAT,
// UNSUPPORTED (also for binary files) or OUT_OF_MEMORY, or as the visitor.
sgs_status sgsi_usd_layer_read(const char *path, const sgsi_usd_visitor *visitor, void *context,
                               sgsi_usd_layer **layer);
// Accepts NULL.
void sgsi_usd_layer_close(sgsi_usd_layer *layer);

// Fails with FORMAT, with the line.
sgs_status sgsi_usd_fail_line(const sgsi_usd_layer *layer, const char *what);
