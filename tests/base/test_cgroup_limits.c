// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Limits of control groups, read from file trees as Linux presents them (kernel documentation:
// cgroup-v2, "cpu.max" and "memory.max"; scheduler/sched-bwc for version 1).

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/cgroup_limits.h"
#include "support/scene_support.h"

static sgsi_group_limits limits_of(const temp_folder *folder, const char *membership)
{
    tree_put_text(folder, "self", membership);
    return sgsi_group_limits_read(temp_path(folder, "self"), temp_path(folder, "sys"));
}

static void assert_limits(sgsi_group_limits limits, double cores, unsigned long long memory)
{
    if (limits.cores != cores || limits.memory != memory)
        fail_msg("%g cores, %llu bytes instead of %g, %llu", limits.cores, limits.memory, cores,
                 memory);
}

static void the_least_limit_on_the_way_to_the_root_holds(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "sys/cpu.max", "max 100000\n");
    tree_put_text(&folder, "sys/job/cpu.max", "250000 100000\n");
    tree_put_text(&folder, "sys/job/memory.max", "max\n");
    tree_put_text(&folder, "sys/job/step/cpu.max", "400000 100000\n");
    tree_put_text(&folder, "sys/job/step/memory.max", "8589934592\n");
    tree_put_text(&folder, "sys/other/cpu.max", "1000 100000\n");
    assert_limits(limits_of(&folder, "0::/job/step\n"), 2.5, 8589934592ULL);
    assert_limits(limits_of(&folder, "0::/job\n"), 2.5, 0);
    assert_limits(limits_of(&folder, "0::/\n"), 0, 0);
    tree_remove(&folder);
}

// A container sees the path of the host next to a mount of its own group.
static void a_path_from_outside_ends_at_the_mounted_group(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "sys/cpu.max", "50000 100000\n");
    tree_put_text(&folder, "sys/memory.max", "1048576\n");
    assert_limits(limits_of(&folder, "0::/docker/0123abcd\n"), 0.5, 1048576);
    tree_remove(&folder);
}

static void version_1_and_both_at_once_are_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "sys/cpu,cpuacct/a/cpu.cfs_quota_us", "300000\n");
    tree_put_text(&folder, "sys/cpu,cpuacct/a/cpu.cfs_period_us", "100000\n");
    tree_put_text(&folder, "sys/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
    tree_put_text(&folder, "sys/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
    tree_put_text(&folder, "sys/memory/memory.limit_in_bytes", "9223372036854771712\n");
    tree_put_text(&folder, "sys/memory/b/memory.limit_in_bytes", "2097152\n");
    const char *membership = "3:cpuset:/c\n2:memory:/b\n1:cpu,cpuacct:/a\n0::/d\n";
    assert_limits(limits_of(&folder, membership), 3, 2097152);
    assert_limits(limits_of(&folder, "2:memory:/\n1:cpu,cpuacct:/\n0::/\n"), 0, 0);
    tree_put_text(&folder, "sys/unified/d/cpu.max", "100000 100000\n");
    assert_limits(limits_of(&folder, membership), 1, 2097152);
    tree_remove(&folder);
}

static void what_cannot_be_read_does_not_limit(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    assert_limits(sgsi_group_limits_read(temp_path(&folder, "none"), folder.path), 0, 0);
    assert_limits(limits_of(&folder, ""), 0, 0);
    assert_limits(limits_of(&folder, "0::/a\n"), 0, 0);
    tree_put_text(&folder, "sys/a/cpu.max", "many 100000\n");
    tree_put_text(&folder, "sys/a/memory.max", "-5\n");
    assert_limits(limits_of(&folder, "nothing\n1:cpu\n:\n0::/a\n0::\n0::a\n"), 0, 0);
    tree_put_text(&folder, "sys/a/cpu.max", "100000 0\n");
    assert_limits(limits_of(&folder, "0::/a\n"), 0, 0);
    char line[6000];
    memset(line, '/', sizeof line);
    memcpy(line, "0::/a", 5);
    line[sizeof line - 1] = '\0';
    tree_put_text(&folder, "sys/a/cpu.max", "100000 100000\n");
    limits_of(&folder, line); // must not crash
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_least_limit_on_the_way_to_the_root_holds),
        cmocka_unit_test(a_path_from_outside_ends_at_the_mounted_group),
        cmocka_unit_test(version_1_and_both_at_once_are_read),
        cmocka_unit_test(what_cannot_be_read_does_not_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
