// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/memory_check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_path.h"
#include "arguments/model_reader.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "processes/rank_group.h"
#include "sparegs/model_file.h"
#include "sparegs/runtime.h"

size_t memory_first_count(const sgs_scene *scene, const train_values *values, size_t continued)
{
    size_t count = continued;
    model_path located;
    // Read errors are reported later, when the file is used.
    if (!count && values->init && file_exists(values->init) && model_is(values->init) &&
        model_locate(values->init, &located)) {
        if (model_reader_count(located.ply_path, &count))
            count = 0;
        model_path_free(&located);
    }
    if (count)
        return count;
    return scene->point_count ? scene->point_count
                              : sgs_train_random_points(scene, &values->options);
}

// Decimals, at least two, with which the printed numbers differ.
static int distinct_digits(double a, double b)
{
    char x[32], y[32];
    int digits = 1;
    do {
        ++digits;
        snprintf(x, sizeof x, "%.*f", digits, a);
        snprintf(y, sizeof y, "%.*f", digits, b);
    } while (digits < 9 && !strcmp(x, y));
    return digits;
}

memory_reserve memory_of_view(const train_values *values)
{
    // Per primitive: 236 parameters, and up to 220 for tracing and BVH (measured). Fixed: ray
    // tables (VIEWER_RAY_BYTES), a picture, a photo, thumbnails and encoded pictures; per thread as
    // in training.
    enum {
        VIEW_ROW_BYTES = 460,
        VIEW_BYTES = 80000000 + VIEW_PICTURE_BYTES + VIEW_PHOTO_BYTES,
        VIEW_THREAD_BYTES = 6000000
    };
    if (!values->view || !group_leads())
        return (memory_reserve){0};
    return (memory_reserve){VIEW_BYTES + (size_t)sgs_threads_get() * VIEW_THREAD_BYTES,
                            VIEW_ROW_BYTES};
}

uint64_t memory_of_process(uint64_t max_memory)
{
    const uint64_t machine = sgs_machine_memory();
    if (max_memory || machine == UINT64_MAX) // unknown
        return max_memory ? max_memory : machine;
    return machine / (uint64_t)group_machine_ranks();
}

bool memory_check(const sgs_scene *scene, const sgs_train_options *options, size_t image_cache,
                  size_t count, memory_reserve reserve, uint64_t max_memory)
{
    const int ranks = group_count();
    const int neighbours = group_machine_ranks();
    const uint64_t memory = memory_of_process(max_memory);
    const size_t rays = sgs_train_ray_limit(memory);
    const double without =
        (double)(sgs_train_memory_per_rank(scene, options, image_cache, 0, ranks, rays) +
                 reserve.bytes);
    const double required =
        (double)(sgs_train_memory_per_rank(scene, options, image_cache, count, ranks, rays) +
                 reserve.bytes + count * reserve.row_bytes);
    const double limit = (double)memory;
    if (required <= limit)
        return true;
    char *name = max_memory ? format_text("--max-memory")
                 : neighbours > 1
                     ? format_text("the memory of the machine divided by %d ranks", neighbours)
                     : format_text("the memory of the machine");
    const int digits = distinct_digits(required / 0x1p30, limit / 0x1p30);
    fail_run("%s: training requires about %.*f GiB (images and program %.*f GiB, initial model of "
             "%zu primitives %.*f GiB), more than %s (%.*f GiB); reduce --image-cache or "
             "--max-gaussians, use --downscale%s%s",
             scene->path, digits, required / 0x1p30, digits, without / 0x1p30, count, digits,
             (required - without) / 0x1p30, name, digits, limit / 0x1p30,
             reserve.bytes ? ", omit --view" : "",
             max_memory ? "" : ", or allow it with a larger --max-memory");
    free(name);
    return false;
}
