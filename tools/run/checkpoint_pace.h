// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Which periodic checkpoints to save if --checkpoint-every is not given, so that they take at most
// about 5 % of the time.

#include <stdbool.h>

typedef struct checkpoint_pace {
    double elapsed; // seconds of training, with the checkpoints
    double spent;   // of these, on checkpoints
    double age;     // seconds since the last checkpoint, or since the start of the training
    int intervals;  // between periodic checkpoints since then, with the one that ends now
} checkpoint_pace;

// Whether to save now. False while checkpoints have taken more than 5 % of the time, unless the
// last one is 30 minutes or 10 intervals old.
bool checkpoint_pace_allows(const checkpoint_pace *pace);
