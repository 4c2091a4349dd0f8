// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Results of `sparegs bench` as text, JSON and CSV. All figures are medians over the repetitions.
// Figures per hit and per megapixel are core time: wall-clock time x threads.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/bench.h"

typedef struct bench_measure {
    sgs_bench_sample sample;
    double total; // gather, forward and backward
} bench_measure;

// One scene with one setting.
typedef struct bench_result {
    const char *name;
    sgs_isa isa;
    int threads;
    sgs_machine_limits limits; // for this number of threads
    size_t repeat;
    bench_measure *measures; // [repeat]
    sgs_bench_counts counts;
    sgs_rank_prediction *ranks; // [rank_count], or NULL
    size_t rank_count;
} bench_result;

typedef struct bench_report {
    bench_result *results;
    size_t count;
} bench_report;

void bench_print_table(const bench_report *report);
void bench_print_csv(const bench_report *report);
// False after printing the error.
bool bench_print_json(const bench_report *report);
