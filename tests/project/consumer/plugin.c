// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A plug-in that contains or links the library; plugin_host.c loads it.

#include <sparegs/gaussians.h>
#include <sparegs/runtime.h>

// Runs loops on three threads. Returns 0 if that succeeds.
__attribute__((visibility("default"))) int plugin_run(void)
{
    sgs_gaussians *model = NULL;
    sgs_threads_set(3);
    const int failed = sgs_gaussians_create(100000, &model) ||
                       sgs_gaussians_resize(model, 100000) || sgs_gaussians_resize(model, 0);
    sgs_gaussians_destroy(model);
    return failed;
}
