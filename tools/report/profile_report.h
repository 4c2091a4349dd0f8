// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Results of `sparegs profile`: table, JSON, heat maps and conclusions.

#include <jansson.h>
#include <stdbool.h>

#include "cameras/camera_file.h"
#include "sparegs/bench.h"
#include "sparegs/profile.h"

// Means over the profiled views. Its maps are NULL.
typedef struct profile_report {
    sgs_profile mean;
    size_t views, sampled_views; // sampled: with a ray in a sampled pixel
    bool built_elsewhere;        // refitted and aged trees were built for another camera
    int refits, repeat;
    const char *model, *scene; // as given to the command
    json_t *per_view;          // owned: an object for each view
    double tile_slowest;       // seconds of the slowest tile over the mean tile
    sgs_bench_sample training; // iteration over the same views; 0 if not measured
    bool counted;              // counters are valid
    sgs_counter_values counters;
    const char *no_counters; // reason why counters are unavailable
} profile_report;

// Adds one view. built_for: name of the view that its refitted and aged trees were built for, NULL
// for itself. Call profile_report_finish after the last one.
void profile_report_add(profile_report *report, const char *name, const char *built_for,
                        const sgs_profile *profile);
void profile_report_finish(profile_report *report);

// to += share * from. A counter that is missing (-1) in one of the values is missing in the sum.
void profile_counters_add(sgs_counter_values *to, const sgs_counter_values *from, double share);

void profile_print(const profile_report *report);
json_t *profile_json(const profile_report *report);

// FOLDER/STEM.profile.exr and STEM.tiles.exr with all maps; STEM.hits.png, STEM.block_hits.png,
// STEM.tile_candidates.png and STEM.tile_cost.png. Prints the paths to `stream`. False after
// printing the error.
bool profile_write_maps(const char *folder, const named_camera *view, const sgs_profile *profile,
                        FILE *stream);
