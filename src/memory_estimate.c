// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// How much memory a training will take, before any of it is asked for. A sum of what is known exactly (parameters,
// moments, statistics, records, bounds, sums; photographs; image planes) and of what depends on the scene (BVH, lists
// of hits, one gradient record per tile and primitive). The latter are rules of thumb, and photographs count one byte per
// channel: half-float ones take twice that.

#include "sparegs/trainer.h"
#include "threads.h"

enum {
    PROGRAM_BYTES = 120 << 20, // code, libraries, what they keep
    THREAD_BYTES = 6 << 20,    // scratch and stack
    ROW_BYTES = 1024,          // per primitive: 708 parameters and moments, 180 tracing and statistics, BVH
    PIXEL_BYTES = 32 + 64,     // of the largest view: planes of image and gradient, loss
    LIST_BYTES = 260,          // of the largest view: hits and gradient records
    RAY_BYTES = 24             // of every camera of its own, kept up to RAY_LIMIT
};
static const size_t RAY_LIMIT = (size_t)1 << 30;

size_t sgs_train_memory(const sgs_scene *scene, const sgs_train_options *options, size_t image_cache, size_t gaussians)
{
    size_t photographs = 0, largest = 0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        const size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
        photographs += pixels * (scene->has_alpha ? 4 : 3);
        largest = pixels > largest ? pixels : largest;
    }
    if (image_cache && photographs > image_cache)
        photographs = image_cache;
    const size_t cap = options->max_gaussians;
    const size_t rows = cap && cap < gaussians ? cap : gaussians;
    const size_t rays = largest * RAY_BYTES * scene->view_count;
    return PROGRAM_BYTES + (size_t)sgsi_threads() * THREAD_BYTES + photographs + largest * (PIXEL_BYTES + LIST_BYTES) +
           (rays < RAY_LIMIT ? rays : RAY_LIMIT) + rows * ROW_BYTES;
}
