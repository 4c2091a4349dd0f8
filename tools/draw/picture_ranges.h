// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Ranges of the values that PNG files show as colours. All frames of a call share them, so that
// equal values have equal colours in a sequence.

#include <jansson.h>
#include <stdbool.h>

#include "draw/aov_list.h"
#include "draw/colormap.h"

// By row of aov_rows, and by channel. All rows of depth have the range of AOV_DEPTH.
typedef struct picture_ranges {
    value_range of[AOV_ROWS][3];
} picture_ranges;

enum { AOV_DEPTHS = AOV_DEPTH | AOV_DEPTH_MEDIAN | AOV_DEPTH_FIRST };

// The values of some frames, collected to measure their ranges.
typedef struct value_samples {
    float *values; // [count]
    size_t count, capacity;
} value_samples;

typedef struct range_samples {
    value_samples rows[AOV_ROWS][3];
} range_samples;

// The AOVs (AOV_ bits) of `aovs` whose pictures have a range.
unsigned ranged_aovs(unsigned aovs);

// The planes (SGS_AOV_ bits) of a frame that the ranges of `aovs` are measured on.
unsigned range_planes(unsigned aovs);
// Adds the values of a frame with these planes. False when out of memory.
bool range_samples_add(range_samples *samples, unsigned aovs, const sgs_frame *frame);
// Those of `aovs` that have no sample.
unsigned range_samples_missing(const range_samples *samples, unsigned aovs);
// Sets the ranges of `aovs` to the 1 % and 99 % quantiles of the samples.
void range_samples_finish(range_samples *samples, unsigned aovs, picture_ranges *ranges);
void range_samples_free(range_samples *samples);

// {"depth": [low, high], "position": [[low, high], ...]}
json_t *picture_ranges_json(const picture_ranges *ranges, unsigned aovs);
