// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What `sparegs profile` found: a table, JSON, pictures, and the answer in words.

#include <jansson.h>
#include <stdbool.h>

#include "cameras/camera_file.h"
#include "sparegs/bench.h"
#include "sparegs/profile.h"

// Means over the views that were profiled. The maps in it are NULL.
typedef struct profile_report {
    sgs_profile mean;
    size_t views;
    int refits;
    double tile_slowest;       // seconds of the slowest tile over the mean tile
    sgs_bench_sample training; // an iteration over the same views; all 0 when it was not measured
    bool counted;              // counters are valid
    sgs_counter_values counters;
    const char *no_counters; // why not
} profile_report;

// Adds one view; call profile_report_finish when all are in.
void profile_report_add(profile_report *report, const sgs_profile *profile);
void profile_report_finish(profile_report *report);

void profile_print(const profile_report *report);
json_t *profile_json(const profile_report *report);

// FOLDER/STEM.profile.exr and STEM.tiles.exr with all maps; STEM.hits.png, STEM.block_hits.png,
// STEM.tile_candidates.png and STEM.tile_cost.png. Prints the paths on `stream`. False after
// printing the error.
bool profile_write_maps(const char *folder, const named_camera *view, const sgs_profile *profile,
                        FILE *stream);
