// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Predicted speed-up on other machines, for `train` and `bench`.

#include <jansson.h>

#include "sparegs/bench.h"

// A machine to predict for.
typedef struct scaling_target {
    int cores;
    double memory_gbs;
} scaling_target;

// 8, 32 and 64 cores with 5 GB/s of memory bandwidth each, a conservative value for a fully used
// server socket.
enum { SCALING_TARGETS = 3 };
extern const scaling_target scaling_targets[SCALING_TARGETS];

// [{"cores":8,"memory_gbs":40,"speedup":7.5}, ...]
json_t *scaling_json(const sgs_scaling *scaling);

// Adds serial_seconds, waiting_seconds, bytes_per_iteration, bytes and predicted_speedup to the
// summary of a training run.
void scaling_add_training(json_t *summary, const sgs_train_seconds *seconds,
                          const sgs_train_bytes *bytes);
