// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A range is that from the 1 % to the 99 % quantile of the values in all sampled frames, so that a
// few stray primitives do not change it.

#include "draw/picture_ranges.h"

#include <math.h>
#include <stdlib.h>

#include "sparegs/aov_descriptors.h"

static int channels_of(int k)
{
    return aov_rows[k].picture == AOV_PICTURE_POSITIONS ? 3
           : aov_rows[k].picture == AOV_PICTURE_RAMP    ? 1
                                                        : 0;
}

// The row whose range a row uses.
static int group_of(int k)
{
    return 1 << k & AOV_DEPTHS ? AOV_INDEX_DEPTH : k;
}

static unsigned measured_rows(unsigned aovs)
{
    unsigned rows = 0;
    for (int k = 0; k < AOV_ROWS; ++k)
        rows |= aovs >> k & 1 && channels_of(k) ? 1U << group_of(k) : 0;
    return rows;
}

unsigned ranged_aovs(unsigned aovs)
{
    unsigned ranged = 0;
    for (int k = 0; k < AOV_ROWS; ++k)
        ranged |= channels_of(k) ? aovs & 1U << k : 0;
    return ranged;
}

static bool add_plane(range_samples *samples, int k, int c, const sgs_frame *frame)
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    const float *plane = sgs_aov_plane(sgs_aov_find(aov_rows[k].source), frame, c);
    const bool is_ramp = aov_rows[k].picture == AOV_PICTURE_RAMP; // its values are positive
    value_samples *to = &samples->rows[k][c];
    if (to->count + pixels > to->capacity) {
        const size_t capacity = 2 * to->capacity + pixels;
        float *values = realloc(to->values, capacity * sizeof *values);
        if (!values)
            return false;
        to->values = values;
        to->capacity = capacity;
    }
    for (size_t i = 0; i < pixels; ++i)
        if (isfinite(plane[i]) && (is_ramp ? plane[i] > 0 : frame->transmittance[i] < 1))
            to->values[to->count++] = plane[i];
    return true;
}

unsigned range_planes(unsigned aovs)
{
    return aov_planes(measured_rows(aovs));
}

bool range_samples_add(range_samples *samples, unsigned aovs, const sgs_frame *frame)
{
    for (int k = 0; k < AOV_ROWS; ++k)
        for (int c = 0; measured_rows(aovs) >> k & 1 && c < channels_of(k); ++c)
            if (!add_plane(samples, k, c, frame))
                return false;
    return true;
}

unsigned range_samples_missing(const range_samples *samples, unsigned aovs)
{
    unsigned missing = 0;
    for (int k = 0; k < AOV_ROWS; ++k)
        if (aovs >> k & 1 && channels_of(k) && !samples->rows[group_of(k)][0].count)
            missing |= 1U << k;
    return missing;
}

void range_samples_finish(range_samples *samples, unsigned aovs, picture_ranges *ranges)
{
    for (int k = 0; k < AOV_ROWS; ++k)
        for (int c = 0; aovs >> k & 1 && c < channels_of(k); ++c) {
            const value_samples *from = &samples->rows[group_of(k)][c];
            ranges->of[k][c] = sorted_range(from->values, from->count);
        }
}

void range_samples_free(range_samples *samples)
{
    for (int k = 0; k < AOV_ROWS; ++k)
        for (int c = 0; c < 3; ++c)
            free(samples->rows[k][c].values);
    *samples = (range_samples){0};
}

static json_t *range_json(value_range range)
{
    return json_pack("[f, f]", (double)range.low, (double)range.high);
}

json_t *picture_ranges_json(const picture_ranges *ranges, unsigned aovs)
{
    json_t *root = json_object();
    for (int k = 0; k < AOV_ROWS; ++k) {
        if (!(ranged_aovs(aovs) >> k & 1))
            continue;
        json_t *value = channels_of(k) == 1 ? range_json(ranges->of[k][0]) : json_array();
        for (int c = 0; channels_of(k) > 1 && c < channels_of(k); ++c)
            json_array_append_new(value, range_json(ranges->of[k][c]));
        json_object_set_new(root, aov_words[k], value);
    }
    return root;
}
