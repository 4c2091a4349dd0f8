// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Measures the machine peaks, which the bench compares its results with. Each peak is the
// best of several short trials.

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"
#include "measure/limit_kernels.h"
#include "simd/kernel_variants.h"
#include "sparegs/bench.h"
#include "base/threads.h"

enum {
    TRIALS = 5,
    ROUNDS = 400000,
    L2_DEFAULT = 1 << 20,
    MEMORY_MIN = 256 << 20,
    MEMORY_PER_THREAD = 64 << 20
};

const sgsi_limit_kernels *sgsi_limit_kernels_get(void)
{
    static const sgsi_limit_kernels *const tables[SGS_ISA_COUNT] =
        SGSI_VARIANTS(&sgsi_limit_kernels);
    return tables[sgs_isa_get()];
}

#ifdef __x86_64__
#include <x86intrin.h>
static double measure_tsc(void)
{
    const double start = sgsi_seconds();
    const unsigned long long from = __rdtsc();
    double now = start;
    while (now - start < 0.02)
        now = sgsi_seconds();
    return (double)(__rdtsc() - from) / (now - start) * 1e-9;
}
#else
static double measure_tsc(void)
{
    return 0.0;
}
#endif

static double measure_multiply_add(const sgsi_limit_kernels *kernels)
{
    _Alignas(64) float chains[16 * SGSI_LIMIT_CHAINS], out[16];
    double best = INFINITY;
    for (size_t i = 0; i < sizeof chains / sizeof *chains; ++i)
        chains[i] = 1.0f + (float)i;
    for (int trial = 0; trial < TRIALS; ++trial) {
        const double start = sgsi_seconds();
        kernels->multiply_add(ROUNDS, chains, 0.999999f, 1e-6f, out);
        best = fmin(best, sgsi_seconds() - start);
    }
    return 2.0 * 16.0 * SGSI_LIMIT_CHAINS * ROUNDS / best * 1e-9;
}

static double measure_l2(const sgsi_limit_kernels *kernels, float *data, size_t bytes)
{
    _Alignas(64) float out[16];
    const size_t floats = bytes / sizeof *data / 128 * 128, passes = (64 << 20) / bytes + 1;
    double best = INFINITY;
    for (int trial = 0; trial < TRIALS; ++trial) {
        const double start = sgsi_seconds();
        for (size_t pass = 0; pass < passes; ++pass)
            kernels->read(data, floats, out);
        best = fmin(best, sgsi_seconds() - start);
    }
    return (double)(passes * floats * sizeof *data) / best * 1e-9;
}

typedef struct stream_job {
    const sgsi_limit_kernels *kernels;
    float *data;
    bool writes;
} stream_job;

static void stream_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const stream_job *job = context;
    _Alignas(64) float out[16];
    if (job->writes)
        job->kernels->update(job->data + begin, end - begin);
    else
        job->kernels->read(job->data + begin, end - begin, out);
}

static void touch_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const stream_job *job = context;
    memset(job->data + begin, 0, (end - begin) * sizeof *job->data);
}

static double measure_stream(stream_job *job, size_t floats, bool writes)
{
    double best = INFINITY;
    job->writes = writes;
    for (int trial = 0; trial < TRIALS; ++trial) {
        const double start = sgsi_seconds();
        sgsi_parallel_ranges(floats, 1 << 18, stream_range, job);
        best = fmin(best, sgsi_seconds() - start);
    }
    return (double)(floats * sizeof *job->data) * (writes ? 2.0 : 1.0) / best * 1e-9;
}

sgs_status sgs_machine_limits_measure(sgs_machine_limits *limits)
{
    *limits = (sgs_machine_limits){0};
    const sgsi_limit_kernels *kernels = sgsi_limit_kernels_get();
    const long l2 = sysconf(_SC_LEVEL2_CACHE_SIZE);
    size_t bytes = (size_t)sgsi_threads() * MEMORY_PER_THREAD;
    if (bytes < MEMORY_MIN)
        bytes = MEMORY_MIN;
    const size_t floats = bytes / sizeof(float);
    stream_job job = {.kernels = kernels, .data = sgsi_alloc(floats, sizeof(float))};
    if (!job.data)
        return sgsi_fail(
            SGS_STATUS_OUT_OF_MEMORY,
            "not enough memory for the %zu MB that the memory bandwidth is measured on",
            bytes >> 20);
    sgsi_parallel_ranges(floats, 1 << 18, touch_range, &job);
    limits->l2_bytes = l2 > 0 ? (size_t)l2 : L2_DEFAULT;
    limits->tsc_ghz = measure_tsc();
    limits->fma_gflops = measure_multiply_add(kernels);
    limits->l2_gbs = measure_l2(kernels, job.data, limits->l2_bytes / 2);
    limits->memory_read_gbs = measure_stream(&job, floats, false);
    limits->memory_update_gbs = measure_stream(&job, floats, true);
    limits->memory_gbs = fmax(limits->memory_read_gbs, limits->memory_update_gbs);
    sgsi_free(job.data);
    return SGS_STATUS_OK;
}
