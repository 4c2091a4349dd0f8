// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/cgroup_limits.h"

#include <stdio.h>
#include <string.h>

enum { LONGEST_PATH = 4096 };

// Reads up to `wanted` numbers from a file, stopping at "max". Returns how many were read.
static int read_numbers(const char *folder, const char *name, int wanted, double *numbers)
{
    char path[2 * LONGEST_PATH];
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path)
        return 0;
    FILE *stream = fopen(path, "r");
    if (!stream)
        return 0;
    int count = 0;
    while (count < wanted && fscanf(stream, "%lf", &numbers[count]) == 1)
        ++count;
    fclose(stream);
    return count;
}

static void allow_cores(sgsi_group_limits *limits, double quota, double period)
{
    if (quota > 0.0 && period > 0.0 && (limits->cores == 0.0 || quota / period < limits->cores))
        limits->cores = quota / period;
}

static void allow_memory(sgsi_group_limits *limits, double bytes)
{
    // Version 1 reports "no limit" as the largest number.
    if (bytes > 0.0 && bytes < 0x1p60 && (!limits->memory || bytes < (double)limits->memory))
        limits->memory = (unsigned long long)bytes;
}

static void read_group(const char *folder, sgsi_group_limits *limits)
{
    double numbers[2], period;
    if (read_numbers(folder, "cpu.max", 2, numbers) == 2)
        allow_cores(limits, numbers[0], numbers[1]);
    if (read_numbers(folder, "cpu.cfs_quota_us", 1, numbers) &&
        read_numbers(folder, "cpu.cfs_period_us", 1, &period))
        allow_cores(limits, numbers[0], period);
    if (read_numbers(folder, "memory.max", 1, numbers) ||
        read_numbers(folder, "memory.limit_in_bytes", 1, numbers))
        allow_memory(limits, numbers[0]);
}

// Reads the group `path` below `hierarchy` and its ancestors. In a container the path may be that
// of the host while the mount starts at the container's own group, which is then the outermost.
static void read_groups(const char *root, const char *hierarchy, const char *path,
                        sgsi_group_limits *limits)
{
    char folder[LONGEST_PATH];
    const int length = snprintf(folder, sizeof folder, "%s/%s%s", root, hierarchy, path);
    if (length >= (int)sizeof folder)
        return;
    const size_t outermost = (size_t)length - strlen(path);
    for (;;) {
        read_group(folder, limits);
        if (strlen(folder) <= outermost)
            return;
        *strrchr(folder, '/') = '\0';
    }
}

static int lists(const char *controllers, const char *wanted)
{
    const size_t length = strlen(wanted);
    for (const char *at = controllers; at; at = strchr(at, ',')) {
        at += *at == ',';
        if (!strncmp(at, wanted, length) && (!at[length] || at[length] == ','))
            return 1;
    }
    return 0;
}

sgsi_group_limits sgsi_group_limits_read(const char *membership, const char *root)
{
    sgsi_group_limits limits = {0};
    FILE *stream = fopen(membership, "r");
    if (!stream)
        return limits;
    char line[LONGEST_PATH]; // "number:controllers:/path"
    while (fgets(line, sizeof line, stream)) {
        line[strcspn(line, "\n")] = '\0';
        char *controllers = strchr(line, ':');
        char *path = controllers ? strchr(controllers + 1, ':') : NULL;
        if (!path)
            continue;
        ++controllers;
        *path++ = '\0';
        if (!*controllers) {
            read_groups(root, "", path, &limits);
            read_groups(root, "unified", path, &limits);
        } else if (lists(controllers, "cpu") || lists(controllers, "memory")) {
            read_groups(root, controllers, path, &limits);
        }
    }
    fclose(stream);
    return limits;
}

sgsi_group_limits sgsi_group_limits_own(void)
{
    return sgsi_group_limits_read("/proc/self/cgroup", "/sys/fs/cgroup");
}
