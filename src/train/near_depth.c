// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "train/near_depth.h"

#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "base/core.h"

enum { MAX_POINTS = 2048, MAX_VIEWS = 256 };
// The median depth of a subject in the middle of the cameras is about 0.9 extents, so that this
// changes nothing there.
#define MEDIAN_SHARE 0.45

// Depth of a point as growth measures it: along the axis, or the distance for fisheye lenses and
// panoramas. 0 if the image does not contain the point.
static double depth_in(const sgs_view *view, const float *point)
{
    double p[3], pixel[2];
    const double *m = view->pose.rotation, *t = view->pose.translation;
    for (int k = 0; k < 3; ++k)
        p[k] = m[3 * k] * (double)point[0] + m[3 * k + 1] * (double)point[1] +
               m[3 * k + 2] * (double)point[2] + t[k];
    if (!sgs_camera_project(&view->camera, p, pixel) || pixel[0] < 0.0 || pixel[1] < 0.0 ||
        pixel[0] > view->camera.width || pixel[1] > view->camera.height)
        return 0.0;
    return sgs_camera_is_fisheye(view->camera.model) ? sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
                                                     : p[2];
}

// Depths of the points in the training views: depths [MAX_POINTS * MAX_VIEWS]. Returns their
// number.
static size_t collect_depths(const sgs_scene *scene, double *depths)
{
    size_t training = 0, order = 0, count = 0;
    for (size_t v = 0; v < scene->view_count; ++v)
        training += scene->views[v].split == SGS_SPLIT_TRAIN;
    const size_t point_step = scene->point_count / MAX_POINTS + 1,
                 view_step = training / MAX_VIEWS + 1;
    for (size_t v = 0; v < scene->view_count; ++v) {
        if (scene->views[v].split != SGS_SPLIT_TRAIN || order++ % view_step)
            continue;
        for (size_t i = 0; i < scene->point_count; i += point_step) {
            const double depth = depth_in(&scene->views[v], scene->points + 3 * i);
            if (depth > 0.0)
                depths[count++] = depth;
        }
    }
    return count;
}

sgs_status sgsi_near_depth_limit(const sgs_scene *scene, double *limit)
{
    double *depths = sgsi_alloc((size_t)MAX_POINTS * MAX_VIEWS, sizeof *depths);
    if (!depths)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the depths of points");
    const size_t count = collect_depths(scene, depths);
    *limit = 0.0;
    if (count && scene->extent > 0.0) {
        qsort(depths, count, sizeof *depths, sgsi_compare_doubles);
        *limit = MEDIAN_SHARE * depths[count / 2] / scene->extent;
    }
    sgsi_free(depths);
    return SGS_STATUS_OK;
}
