// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Bytes moved by one iteration, from its counters: accesses to arrays of the size of the model, the
// image or the tiles' lists, each counted once. Scratch memory in a core's caches is excluded.

#include "sparegs/trainer.h"
#include "trace/tracer.h"

typedef struct sgsi_traffic {
    const sgsi_tracer *tracer; // after its backward pass
    const sgsi_tracer *rows;   // of the rows that the optimiser visits
    size_t primitives, pixels, tiles, macrotiles;
    int sh_degree;     // bands in use
    int channels;      // of the photo; each counts as one byte per pixel
    bool collects;     // collects statistics for density control
    bool steps, dense; // the optimiser steps; steps every row
} sgsi_traffic;

// Adds one iteration and its bytes.
void sgsi_traffic_add(const sgsi_traffic *traffic, sgs_train_bytes *bytes);
