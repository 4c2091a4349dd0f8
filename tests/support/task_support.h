// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The threads of this process, as Linux reports them. Include after cmocka.h.

#include <dirent.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// Number of threads. blocking: of those that block the signal `blocking`; 0 = all.
static inline int task_count(int blocking)
{
    int count = 0;
    DIR *tasks = opendir("/proc/self/task");
    assert_non_null(tasks);
    for (const struct dirent *entry = readdir(tasks); entry; entry = readdir(tasks)) {
        char path[300], line[256];
        uint64_t mask = 0;
        if (entry->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "/proc/self/task/%s/status", entry->d_name);
        FILE *status = fopen(path, "r");
        if (!status) // it has ended
            continue;
        while (fgets(line, sizeof line, status))
            (void)sscanf(line, "SigBlk: %" SCNx64, &mask);
        fclose(status);
        count += !blocking || (mask >> (blocking - 1) & 1);
    }
    closedir(tasks);
    return count;
}

// Time on a CPU of all threads but the first, in seconds.
static inline double task_seconds_of_others(void)
{
    double seconds = 0;
    DIR *tasks = opendir("/proc/self/task");
    assert_non_null(tasks);
    for (const struct dirent *entry = readdir(tasks); entry; entry = readdir(tasks)) {
        char path[300];
        double nanoseconds;
        if (entry->d_name[0] == '.' || atol(entry->d_name) == (long)getpid())
            continue;
        snprintf(path, sizeof path, "/proc/self/task/%s/schedstat", entry->d_name);
        FILE *times = fopen(path, "r");
        if (times && fscanf(times, "%lf", &nanoseconds) == 1)
            seconds += 1e-9 * nanoseconds;
        if (times)
            fclose(times);
    }
    closedir(tasks);
    return seconds;
}
