// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The bytes that one iteration moves, counted from what it did. Counted is what streams through
// arrays of the size of the model, of the image or of the tiles' lists, each access once; scratch
// that stays in a core's caches is not.

#include "sparegs/trainer.h"
#include "trace/tracer.h"

typedef struct sgsi_traffic {
    const sgsi_tracer *tracer; // after its backward pass
    size_t primitives, pixels, tiles, macrotiles;
    int sh_degree;     // bands in use
    int channels;      // bytes per pixel of the photograph
    bool collects;     // statistics of the density control
    bool steps, dense; // the optimiser steps; every row
} sgsi_traffic;

// Adds one iteration and its bytes.
void sgsi_traffic_add(const sgsi_traffic *traffic, sgs_train_bytes *bytes);
