// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What Linux's control groups leave to this process: containers, batch systems and systemd units
// limit processor time and memory there, and the affinity mask and the size of the machine do not
// show it.

typedef struct sgsi_group_limits {
    double cores;              // seconds of processor time per second; 0 = not limited
    unsigned long long memory; // bytes; 0 = not limited
} sgsi_group_limits;

// The least limits of the groups that `membership` lists and of those around them. `membership`: as
// /proc/self/cgroup; `root`: where the groups are mounted, /sys/fs/cgroup; version 1, 2, or both.
// What cannot be read does not limit.
sgsi_group_limits sgsi_group_limits_read(const char *membership, const char *root);

// Of this process, now.
sgsi_group_limits sgsi_group_limits_own(void);
