// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Options, train/test split, lookup of views by name, and the extent of the scene: 1.1 times the
// largest distance of a training camera from their mean, as in 3DGS.

#include "scene/scene_split.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "scene/similar_name.h"
#include "base/compare.h"
#include "base/base_name.h"
#include "base/core.h"

// Rounding of positions that causes a warning: pixels of a photo from a distance of the
// scene's size.
static const double COARSE_STEP = 0.1;

sgs_status sgsi_scene_no_memory(const char *path)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the scene", path);
}

sgs_status sgsi_scene_cancelled(const char *path)
{
    return sgsi_fail(SGS_STATUS_CANCELLED, "%s: loading was cancelled", path);
}

int sgs_view_name_match(const char *view_name, const char *name)
{
    const char *base = sgsi_base_name(view_name);
    const char *dot = strrchr(base, '.');
    if (!strcmp(view_name, name))
        return 0;
    if (!strcmp(base, name))
        return 1;
    if (!dot)
        return -1;
    const size_t length = strlen(name);
    const bool full = (size_t)(dot - view_name) == length && !strncmp(view_name, name, length);
    const bool short_form = (size_t)(dot - base) == length && !strncmp(base, name, length);
    return full || short_form ? 2 : -1;
}

ptrdiff_t sgs_scene_find_view(const sgs_scene *scene, const char *name)
{
    for (int level = 0; level < 3; ++level) {
        for (size_t i = 0; i < scene->view_count; ++i) {
            if (sgs_view_name_match(scene->views[i].name, name) == level)
                return (ptrdiff_t)i;
        }
    }
    return -1;
}

// Levenshtein distance of truncated strings, for suggestions.
static size_t edit_distance(const char *a, const char *b)
{
    enum { MAX_LENGTH = 128 };
    size_t row[MAX_LENGTH + 1];
    const size_t n = strnlen(a, MAX_LENGTH), m = strnlen(b, MAX_LENGTH);
    for (size_t j = 0; j <= m; ++j)
        row[j] = j;
    for (size_t i = 1; i <= n; ++i) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= m; ++j) {
            const size_t replaced = diagonal + (a[i - 1] != b[j - 1]);
            const size_t shorter = (row[j] < row[j - 1] ? row[j] : row[j - 1]) + 1;
            diagonal = row[j];
            row[j] = replaced < shorter ? replaced : shorter;
        }
    }
    return row[m];
}

static sgs_status unknown_test_image(const sgs_scene *scene, const char *name)
{
    const char *nearest[3] = {NULL};
    size_t distances[3] = {SIZE_MAX, SIZE_MAX, SIZE_MAX};
    for (size_t i = 0; i < scene->view_count; ++i) {
        const char *candidate = scene->views[i].name;
        size_t distance = edit_distance(name, sgsi_base_name(candidate));
        for (int k = 0; k < 3; ++k) {
            if (distance < distances[k]) {
                const char *text = nearest[k];
                const size_t number = distances[k];
                nearest[k] = candidate;
                distances[k] = distance;
                candidate = text;
                distance = number;
            }
        }
    }
    char text[1024] = "";
    for (size_t k = 0, used = 0; k < 3 && nearest[k] && used < sizeof text; ++k) {
        const int n =
            snprintf(text + used, sizeof text - used, "%s'%.300s'", k ? ", " : "", nearest[k]);
        used += n > 0 ? (size_t)n : 0;
    }
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                     "%s: no view named '%.200s' to hold out; the nearest names are %s",
                     scene->path, name, text);
}

static sgs_status hold_out(sgs_scene *scene, const char *name)
{
    const ptrdiff_t found = sgs_scene_find_view(scene, name);
    if (found < 0)
        return unknown_test_image(scene, name);
    // A name without folder may match several views; all of them are held out.
    const int level = sgs_view_name_match(scene->views[found].name, name);
    for (size_t i = 0; i < scene->view_count; ++i) {
        if (sgs_view_name_match(scene->views[i].name, name) == level)
            scene->views[i].split = SGS_SPLIT_TEST;
    }
    return SGS_STATUS_OK;
}

static size_t count_commas(const char *name)
{
    size_t count = 0;
    for (; *name; ++name)
        count += *name == ',';
    return count;
}

// The end of the first `parts` parts of a list.
static const char *end_of_parts(const char *list, size_t parts)
{
    while (*list && (*list != ',' || --parts))
        ++list;
    return list;
}

// Holds out the first name of a list; *rest: the others. The name may contain `commas` commas: the
// longest text that names a view counts.
static sgs_status hold_out_first(sgs_scene *scene, const char *list, size_t commas,
                                 const char **rest)
{
    sgs_status status = SGS_STATUS_OK;
    const char *last = NULL;
    list += strspn(list, " ");
    bool found = false;
    for (size_t parts = commas + 1; parts && !found; --parts) {
        const char *end = end_of_parts(list, parts);
        if (end == last && parts > 1)
            continue; // the list has fewer parts
        last = end;
        *rest = end + (*end == ',');
        while (end > list && end[-1] == ' ')
            --end;
        char *name = sgsi_format("%.*s", (int)(end > list ? end - list : 0), list);
        if (!name)
            return sgsi_scene_no_memory(scene->path);
        found = parts == 1 || sgs_scene_find_view(scene, name) >= 0;
        if (found && *name)
            status = hold_out(scene, name);
        sgsi_free(name);
    }
    return status;
}

static sgs_status split_by_names(sgs_scene *scene, const char *list)
{
    size_t commas = 0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const size_t own = count_commas(scene->views[i].name);
        commas = own > commas ? own : commas;
        scene->views[i].split = SGS_SPLIT_TRAIN;
    }
    sgs_status status = SGS_STATUS_OK;
    while (*list && !status)
        status = hold_out_first(scene, list, commas, &list);
    return status;
}

static ptrdiff_t find_exact(const sgs_scene *scene, const char *name)
{
    for (size_t i = 0; i < scene->view_count && name; ++i)
        if (!strcmp(scene->views[i].name, name))
            return (ptrdiff_t)i;
    return -1;
}

// The only view whose name differs from `name` by folders, or -1.
static ptrdiff_t find_in_other_folder(const sgs_scene *scene, const char *name)
{
    ptrdiff_t found = -1;
    for (size_t i = 0; i < scene->view_count && name; ++i) {
        if (!sgsi_name_differs_by_folders(scene->views[i].name, name))
            continue;
        if (found >= 0)
            return -1;
        found = (ptrdiff_t)i;
    }
    return found;
}

void sgs_scene_find_recorded(const sgs_scene *scene, const char *const *names, size_t count,
                             ptrdiff_t *views)
{
    bool exact = false;
    for (size_t k = 0; k < count; ++k) {
        views[k] = find_exact(scene, names[k]);
        exact |= views[k] >= 0;
    }
    if (exact)
        return;
    // A view that several names denote is kept as -2 - view until the end.
    for (size_t k = 0; k < count; ++k) {
        const ptrdiff_t view = find_in_other_folder(scene, names[k]), shared = -2 - view;
        views[k] = view;
        for (size_t j = 0; j < k && view >= 0; ++j)
            if (views[j] == view || views[j] == shared)
                views[j] = views[k] = shared;
    }
    for (size_t k = 0; k < count; ++k)
        views[k] = views[k] < 0 ? -1 : views[k];
}

// Split by recorded names, independent of views that were removed since.
static sgs_status split_by_record(sgs_scene *scene, const sgs_scene_options *options)
{
    const size_t count = options->held_out_count;
    ptrdiff_t *found = sgsi_alloc(count ? count : 1, sizeof *found);
    if (!found)
        return sgsi_scene_no_memory(scene->path);
    for (size_t i = 0; i < scene->view_count; ++i)
        scene->views[i].split = SGS_SPLIT_TRAIN;
    sgs_scene_find_recorded(scene, options->held_out, count, found);
    for (size_t k = 0; k < count; ++k)
        if (found[k] >= 0)
            scene->views[found[k]].split = SGS_SPLIT_TEST;
    sgsi_free(found);
    return SGS_STATUS_OK;
}

sgs_status sgsi_scene_options_check(const char *path, const sgs_scene_options *options)
{
    const sgs_scene_options *o = options;
    const char *wrong = NULL;
    if (o->downscale < 0)
        wrong = "downscale is negative";
    else if (o->test_every < 0)
        wrong = "test_every is negative";
    else if ((unsigned)o->alpha > SGS_ALPHA_IGNORE)
        wrong = "alpha is unknown";
    else if ((unsigned)o->space > SGS_SPACE_LINEAR)
        wrong = "space is unknown";
    else if (!(o->white_point >= 0 && isfinite(o->white_point)))
        wrong = "white_point is negative or not finite";
    else if (o->view_width < 0 || o->view_height < 0)
        wrong = "view_width or view_height is negative";
    return wrong ? sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: option %s", path, wrong)
                 : SGS_STATUS_OK;
}

sgs_status sgsi_scene_split(sgs_scene *scene, const sgs_scene_options *options, bool has_split)
{
    const int every = options->test_every;
    sgs_status status = SGS_STATUS_OK;
    if (options->held_out)
        status = split_by_record(scene, options);
    else if (options->test_images)
        status = split_by_names(scene, options->test_images);
    else if (has_split && (every || options->use_dataset_split)) {
        if (every && !options->use_dataset_split)
            sgsi_warn("%s: using the scene's own test views; test_every %d is ignored", scene->path,
                      every);
    } else {
        for (size_t i = 0; i < scene->view_count; ++i)
            scene->views[i].split =
                every && i % (size_t)every == 0 ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN;
    }
    if (status)
        return status;
    for (size_t i = 0; i < scene->view_count; ++i) {
        if (scene->views[i].split == SGS_SPLIT_TRAIN)
            return SGS_STATUS_OK;
    }
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: all %zu views are held out; hold out fewer",
                     scene->path, scene->view_count);
}

// The median distance of the points to the center; 0 without points.
static sgs_status median_distance(const sgs_scene *scene, double *median)
{
    *median = 0;
    if (scene->point_count == 0)
        return SGS_STATUS_OK;
    double *distances = sgsi_alloc(scene->point_count, sizeof *distances);
    if (!distances)
        return sgsi_scene_no_memory(scene->path);
    for (size_t i = 0; i < scene->point_count; ++i) {
        const float *p = scene->points + 3 * i;
        distances[i] =
            hypot(hypot(p[0] - scene->center[0], p[1] - scene->center[1]), p[2] - scene->center[2]);
    }
    qsort(distances, scene->point_count, sizeof *distances, sgsi_compare_doubles);
    *median = distances[scene->point_count / 2];
    sgsi_free(distances);
    return SGS_STATUS_OK;
}

// If the cameras coincide, the extent is half the median distance of the points, about the radius
// of a camera path around an object. Without points it is 1.
static sgs_status extent_from_points(sgs_scene *scene)
{
    double median;
    const sgs_status status = median_distance(scene, &median);
    scene->extent = median > 0 && isfinite(median) ? 0.5 * median : 1;
    return status;
}

static double longest_focal_length(const sgs_scene *scene)
{
    double longest = 0, fx, fy, cx, cy;
    for (size_t i = 0; i < scene->view_count; ++i) {
        sgs_camera_intrinsics(&scene->views[i].camera, &fx, &fy, &cx, &cy);
        longest = fmax(longest, fx);
    }
    return longest;
}

// Primitives have coordinates in single precision. Far from the origin their steps are as large as
// details: georeferenced scenes train to a blurred model without any other symptom.
static sgs_status warn_far_from_origin(const sgs_scene *scene)
{
    float farthest = 0;
    double median = 0;
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; k < 3; ++k)
        farthest = fmaxf(farthest, (float)fabs(scene->center[k]));
    const double step = (double)nextafterf(farthest, INFINITY) - (double)farthest,
                 pixels = step * longest_focal_length(scene); // at a distance of 1
    if (pixels > COARSE_STEP * scene->extent)
        status = median_distance(scene, &median); // cameras may be close together, points far away
    const double size = fmax(scene->extent, median);
    if (!status && pixels > COARSE_STEP * size)
        sgsi_warn("%s: the cameras are %.3g units from the origin, where positions have steps of "
                  "%.2g units, about %.2g pixels of the photos; subtract the same offset from "
                  "all cameras and points",
                  scene->model_path, (double)farthest, step, pixels / size);
    return status;
}

static double farthest_from_center(const sgs_scene *scene)
{
    double largest = 0, center[3];
    for (size_t i = 0; i < scene->view_count; ++i) {
        if (scene->views[i].split != SGS_SPLIT_TRAIN)
            continue;
        sgs_pose_center(&scene->views[i].pose, center);
        const double distance =
            hypot(hypot(center[0] - scene->center[0], center[1] - scene->center[1]),
                  center[2] - scene->center[2]);
        largest = fmax(largest, distance);
    }
    return largest;
}

sgs_status sgsi_scene_measure_extent(sgs_scene *scene)
{
    size_t count = 0;
    double sum[3] = {0}, magnitude = 0, center[3];
    for (size_t i = 0; i < scene->view_count; ++i) {
        sgs_pose_center(&scene->views[i].pose, center);
        if (!(fabs(center[0]) + fabs(center[1]) + fabs(center[2]) < SGSI_FARTHEST_CAMERA))
            return sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: camera position of '%s' is out of range; the model may be damaged",
                scene->model_path, scene->views[i].name);
        if (scene->views[i].split != SGS_SPLIT_TRAIN)
            continue;
        for (int k = 0; k < 3; ++k)
            sum[k] += center[k];
        ++count;
    }
    for (int k = 0; k < 3; ++k) {
        scene->center[k] = sum[k] / (double)count;
        magnitude = fmax(magnitude, fabs(scene->center[k]));
    }
    scene->extent = 1.1 * farthest_from_center(scene);
    // Cameras closer than rounding errors coincide.
    sgs_status status = SGS_STATUS_OK;
    if (!(scene->extent > 1e-9 * (1e-3 + magnitude)))
        status = extent_from_points(scene);
    return status ? status : warn_far_from_origin(scene);
}

void sgsi_scene_warn_centers(const sgs_scene *scene)
{
    const sgs_view *first = NULL;
    size_t outside = 0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        double fx, fy, cx, cy;
        if (view->camera.width == 0) // a view without photo
            continue;
        sgs_camera_intrinsics(&view->camera, &fx, &fy, &cx, &cy);
        if (cx >= 0 && cx <= view->camera.width && cy >= 0 && cy <= view->camera.height)
            continue;
        ++outside;
        first = first ? first : view;
    }
    if (outside)
        sgsi_warn("%s: principal point of %zu image(s), first '%s', is outside of the image; do "
                  "the intrinsics belong to another image size ('w' and 'h' of a transforms.json)?",
                  scene->model_path, outside, first->name);
}

uint64_t sgsi_scene_digest(const sgs_scene *scene)
{
    uint64_t digest = XXH64(scene->points, scene->point_count * 3 * sizeof *scene->points, 0);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        digest = XXH64(view->name, strlen(view->name), digest);
        digest = XXH64(view->pose.rotation, sizeof view->pose.rotation, digest);
        digest = XXH64(view->pose.translation, sizeof view->pose.translation, digest);
    }
    return digest;
}
