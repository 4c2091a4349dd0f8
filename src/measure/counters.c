// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Hardware counters through perf_event_open(2). Inherited by threads; user space only, which the
// usual perf_event_paranoid of 2 permits.

#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"
#include "sparegs/profile.h"

enum { EVENTS = 5 };

// What read(2) returns for an event. If there are more events than counters, the kernel multiplexes
// them: the event was counted for `running` of `enabled` nanoseconds.
typedef struct reading {
    uint64_t count, enabled, running;
} reading;

struct sgs_counters {
    int files[EVENTS]; // -1: not available
    reading start[EVENTS];
};

#ifdef __linux__
#include <linux/perf_event.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>

sgs_counters *sgs_counters_open(void)
{
    static const uint64_t events[EVENTS] = {
        PERF_COUNT_HW_CPU_CYCLES, PERF_COUNT_HW_INSTRUCTIONS, PERF_COUNT_HW_CACHE_REFERENCES,
        PERF_COUNT_HW_CACHE_MISSES, PERF_COUNT_HW_BRANCH_MISSES};
    sgs_counters *counters = sgsi_calloc(1, sizeof *counters);
    bool any = false;
    int reason = ENOMEM;
    for (int i = 0; counters && i < EVENTS; ++i) {
        struct perf_event_attr attributes = {.type = PERF_TYPE_HARDWARE,
                                             .size = sizeof attributes,
                                             .config = events[i],
                                             .read_format = PERF_FORMAT_TOTAL_TIME_ENABLED |
                                                            PERF_FORMAT_TOTAL_TIME_RUNNING,
                                             .disabled = 1,
                                             .inherit = 1,
                                             .exclude_kernel = 1,
                                             .exclude_hv = 1};
        counters->files[i] = (int)syscall(SYS_perf_event_open, &attributes, 0, -1, -1, 0);
        reason = counters->files[i] < 0 ? errno : reason;
        any = any || counters->files[i] >= 0;
    }
    if (any)
        return counters;
    sgsi_free(counters);
    sgsi_record_error(
        "hardware counters unavailable: %s (perf_event_paranoid above 2, or a virtual "
        "machine without counters)",
        strerror(reason));
    return NULL;
}

static void control(sgs_counters *counters, unsigned long request)
{
    for (int i = 0; i < EVENTS; ++i)
        if (counters->files[i] >= 0)
            ioctl(counters->files[i], request, 0);
}

static bool read_event(const sgs_counters *counters, int i, reading *to)
{
    *to = (reading){0};
    return counters->files[i] >= 0 && read(counters->files[i], to, sizeof *to) == sizeof *to;
}

void sgs_counters_start(sgs_counters *counters)
{
    for (int i = 0; i < EVENTS; ++i)
        (void)read_event(counters, i, &counters->start[i]);
    control(counters, PERF_EVENT_IOC_ENABLE);
}

sgs_counter_values sgs_counters_stop(sgs_counters *counters)
{
    sgs_counter_values values;
    double *const to[EVENTS] = {&values.cycles, &values.instructions, &values.cache_references,
                                &values.cache_misses, &values.branch_misses};
    control(counters, PERF_EVENT_IOC_DISABLE);
    for (int i = 0; i < EVENTS; ++i) {
        reading now;
        const reading *start = &counters->start[i];
        const bool counted =
            read_event(counters, i, &now) && now.running > start->running; // at least once
        *to[i] = counted
                     ? (double)(now.count - start->count) * (double)(now.enabled - start->enabled) /
                           (double)(now.running - start->running)
                     : -1.0;
    }
    return values;
}
#else
sgs_counters *sgs_counters_open(void)
{
    sgsi_record_error("hardware counters are supported on Linux only");
    return NULL;
}

void sgs_counters_start(sgs_counters *counters)
{
    (void)counters;
}

sgs_counter_values sgs_counters_stop(sgs_counters *counters)
{
    (void)counters;
    return (sgs_counter_values){-1.0, -1.0, -1.0, -1.0, -1.0};
}
#endif

void sgs_counters_close(sgs_counters *counters)
{
    if (!counters)
        return;
    for (int i = 0; i < EVENTS; ++i)
        if (counters->files[i] >= 0)
            close(counters->files[i]);
    sgsi_free(counters);
}
