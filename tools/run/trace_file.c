// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Trace events in the JSON object format: complete events ("ph":"X") with start and duration in
// microseconds, and counters ("ph":"C"). Events are streamed, so that memory does not grow with the
// run.

#include "run/trace_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/runtime.h"

struct trace_file {
    sgs_output_file file;
    double zero; // time of the first event
    bool any;
};

trace_file *trace_open(const char *path)
{
    trace_file *trace = calloc(1, sizeof *trace);
    if (!trace || !open_output(path, &trace->file)) {
        free(trace);
        return NULL;
    }
    fputs("{\"displayTimeUnit\":\"ms\",\"traceEvents\":[", trace->file.stream);
    return trace;
}

static void begin_event(trace_file *trace, double time)
{
    if (!trace->any)
        trace->zero = time;
    fputs(trace->any ? ",\n" : "\n", trace->file.stream);
    trace->any = true;
}

static void put_span(trace_file *trace, const char *name, int thread, double time, double seconds)
{
    begin_event(trace, time);
    fprintf(trace->file.stream,
            "{\"name\":\"%s\",\"ph\":\"X\",\"pid\":1,\"tid\":%d,\"ts\":%.3f,\"dur\":%.3f}", name,
            thread, 1e6 * (time - trace->zero), 1e6 * seconds);
}

void trace_iteration(trace_file *trace, int iteration, double start, double seconds,
                     const sgs_train_seconds *before, const sgs_train_seconds *after)
{
    const struct {
        const char *name;
        double seconds;
    } phases[] = {{"density", after->density - before->density},
                  {"spare", after->spare - before->spare},
                  {"bvh_build", after->bvh_build - before->bvh_build},
                  {"bvh_refit", after->bvh_refit - before->bvh_refit},
                  {"gather", after->gather - before->gather},
                  {"forward", after->forward - before->forward},
                  {"loss", after->loss - before->loss},
                  {"backward", after->backward - before->backward},
                  {"optimizer", after->optimizer - before->optimizer}};
    char name[32];
    snprintf(name, sizeof name, "iteration %d", iteration);
    put_span(trace, name, 1, start, seconds);
    double time = start;
    for (size_t i = 0; i < sizeof phases / sizeof *phases; ++i) {
        if (!(phases[i].seconds > 0))
            continue;
        put_span(trace, phases[i].name, 1, time, phases[i].seconds);
        time += phases[i].seconds;
    }
}

void trace_span(trace_file *trace, const char *name, double start, double seconds)
{
    put_span(trace, name, 1, start, seconds);
}

// Adds a counter value.
static void add_count(trace_file *trace, const char *name, double time, double value)
{
    if (!isfinite(value))
        return;
    begin_event(trace, time);
    fprintf(trace->file.stream,
            "{\"name\":\"%s\",\"ph\":\"C\",\"pid\":1,\"ts\":%.3f,\"args\":{\"%s\":%.9g}}", name,
            1e6 * (time - trace->zero), name, value);
}

bool trace_close(trace_file *trace, bool keep)
{
    if (!trace)
        return true;
    bool written = true;
    if (keep) {
        fputs("\n]}\n", trace->file.stream);
        written = !sgs_output_file_commit(&trace->file);
        if (!written)
            fail_library();
    } else {
        sgs_output_file_abort(&trace->file);
    }
    free(trace);
    return written;
}

void trace_step(trace_file *trace, const sgs_trainer *trainer, double start,
                const sgs_train_seconds *before, const sgs_step_info *info)
{
    const sgs_train_seconds after = sgs_trainer_seconds(trainer);
    trace_iteration(trace, info->iteration, start, after.total - before->total, before, &after);
    add_count(trace, "loss", start, info->loss);
    add_count(trace, "gaussians", start, (double)info->gaussians);
    add_count(trace, "bvh_callbacks", start, (double)info->callbacks);
    add_count(trace, "tile_candidates", start, (double)info->candidates);
    add_count(trace, "fallback_gathers", start, (double)info->fallback_gathers);
    add_count(trace, "rss_mb", start, 1e-6 * (double)sgs_rss_current());
}
