// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What `sparegs bench` measured, as a table for people, as JSON and as CSV. Every figure is a
// median over the repetitions. Figures per hit and per megapixel are core time: wall clock times
// threads.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/bench.h"

typedef struct bench_measure {
    sgs_bench_sample sample;
    double total; // gather, forward and backward
} bench_measure;

// One scene under one setting.
typedef struct bench_result {
    const char *name;
    sgs_isa isa;
    int threads;
    sgs_machine_limits limits; // of this number of threads
    size_t repeat;
    bench_measure *measures; // [repeat]
    sgs_bench_counts counts;
} bench_result;

typedef struct bench_report {
    bench_result *results;
    size_t count;
} bench_report;

void bench_print_table(const bench_report *report);
void bench_print_csv(const bench_report *report);
// False after printing the error.
bool bench_print_json(const bench_report *report);
