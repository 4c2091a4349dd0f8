// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// CPU and memory limits of the Linux cgroups of this process. Containers, batch systems and
// systemd units set limits there that neither the affinity mask nor the size of the machine shows.

typedef struct sgsi_group_limits {
    double cores;              // CPU seconds per second; 0 = unlimited
    unsigned long long memory; // bytes; 0 = unlimited
} sgsi_group_limits;

// The lowest limits of the groups that `membership` lists and of their ancestors. membership: in
// the format of /proc/self/cgroup; root: the mount point, /sys/fs/cgroup; version 1, 2 or both.
// Unreadable files set no limit.
sgsi_group_limits sgsi_group_limits_read(const char *membership, const char *root);

// The limits of this process, read now.
sgsi_group_limits sgsi_group_limits_own(void);
