// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Blocks of a scene (sparegs/blocks.h). The plan depends on poses, points and intrinsics relative
// to the size of the images, not on the number of threads.
//
// Work of a block: iterations in proportion to its views, times primitives in proportion to its
// points. In a scene of uniform density both grow with the size of the cell, so their geometric
// mean is what a side with twice the blocks should have twice of.

#include "sparegs/blocks.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/progress_calls.h"
#include "base/threads.h"

enum { PLANES = 1024 };

typedef struct planner {
    const sgs_scene *scene;
    sgs_block_options options;
    sgs_blocks *blocks;
    float *centers;        // [view_count][3]
    float low[3], high[3]; // box of the cameras
    sgs_box *grown;        // [blocks]
    uint8_t *member;       // [view_count][blocks]
    sgsi_progress progress;
} planner;

void sgs_block_options_init(sgs_block_options *options, size_t size)
{
    const sgs_block_options defaults = {.count = 2, .margin = 0.2, .share = 0.1};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

void sgs_blocks_free(sgs_blocks *blocks)
{
    for (size_t i = 0; i < blocks->count; ++i)
        sgsi_free(blocks->blocks[i].views);
    sgsi_free(blocks->blocks);
    *blocks = (sgs_blocks){0};
}

// Extends a box, low > high at first, by points.
static void extend(const float *points, size_t count, float low[3], float high[3])
{
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < 3; ++k) {
            low[k] = fminf(low[k], points[3 * i + k]);
            high[k] = fmaxf(high[k], points[3 * i + k]);
        }
}

static sgs_status find_cameras(planner *p)
{
    const sgs_scene *scene = p->scene;
    p->centers = sgsi_alloc(scene->view_count, 3 * sizeof *p->centers);
    if (!p->centers)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to plan blocks",
                         scene->path);
    for (size_t v = 0; v < scene->view_count; ++v) {
        double center[3];
        sgs_pose_center(&scene->views[v].pose, center);
        for (size_t k = 0; k < 3; ++k)
            p->centers[3 * v + k] = (float)center[k];
    }
    for (int k = 0; k < 3; ++k) {
        p->low[k] = INFINITY;
        p->high[k] = -INFINITY;
    }
    extend(p->centers, scene->view_count, p->low, p->high);
    const float side =
        fmaxf(p->high[0] - p->low[0], fmaxf(p->high[1] - p->low[1], p->high[2] - p->low[2]));
    if (!(side > 0.0f)) // all photos from one place
        extend(scene->points, scene->point_count, p->low, p->high);
    return SGS_STATUS_OK;
}

// ---- Cells ----

// Bounds of the part of a cell within the box of the cameras.
static void finite_part(const planner *p, const sgs_box *cell, float low[3], float high[3])
{
    for (int k = 0; k < 3; ++k) {
        low[k] = fmaxf(cell->low[k], p->low[k]);
        high[k] = fminf(cell->high[k], p->high[k]);
    }
}

// bins[i + 1]: number of points in the cell and below plane i + 1 of `axis`.
static void count_below(const float *points, size_t count, const sgs_box *cell, int axis,
                        const float *planes, size_t bins[PLANES + 1])
{
    memset(bins, 0, (PLANES + 1) * sizeof *bins);
    const float low = planes[0], step = planes[1] - planes[0];
    for (size_t i = 0; i < count; ++i) {
        const float x = points[3 * i + (size_t)axis];
        if (!sgs_box_contains(cell, points + 3 * i))
            continue;
        const float guess = step > 0.0f ? (x - low) / step : 0.0f;
        size_t bin = guess > 0.0f ? (size_t)fminf(guess, PLANES - 1) : 0;
        while (bin > 0 && x < planes[bin])
            --bin;
        while (bin < PLANES - 1 && x >= planes[bin + 1])
            ++bin;
        ++bins[bin + 1]; // below plane bin + 1, except after the last one
    }
    for (size_t i = 0; i < PLANES; ++i)
        bins[i + 1] += bins[i];
}

static double work(size_t views, size_t points)
{
    return sqrt((double)views * (double)points);
}

// The plane across the longest side that divides the work as `first` to `second`. False if no plane
// has points on both sides.
static bool find_plane(const planner *p, const sgs_box *cell, int first, int second, int *axis,
                       float *plane)
{
    float low[3], high[3], planes[PLANES];
    size_t views[PLANES + 1], points[PLANES + 1];
    finite_part(p, cell, low, high);
    *axis = 0;
    for (int k = 1; k < 3; ++k)
        *axis = high[k] - low[k] > high[*axis] - low[*axis] ? k : *axis;
    for (int i = 0; i < PLANES; ++i)
        planes[i] = low[*axis] + (high[*axis] - low[*axis]) * (float)i / PLANES;
    count_below(p->centers, p->scene->view_count, cell, *axis, planes, views);
    count_below(p->scene->points, p->scene->point_count, cell, *axis, planes, points);
    double best = INFINITY;
    for (int i = 1; i < PLANES; ++i) {
        const size_t all_views = views[PLANES], all_points = points[PLANES];
        const double error = fabs(work(views[i], points[i]) * second -
                                  work(all_views - views[i], all_points - points[i]) * first);
        if (!points[i] || points[i] == all_points || !(planes[i] > cell->low[*axis]) ||
            !(error < best))
            continue;
        best = error;
        *plane = planes[i];
    }
    return best < INFINITY;
}

static sgs_status bisect(planner *p, const sgs_box *cell, int count)
{
    if (count == 1) {
        p->blocks->blocks[p->blocks->count++].box = *cell;
        return SGS_STATUS_OK;
    }
    const int first = count / 2;
    int axis;
    float plane;
    if (!find_plane(p, cell, first, count - first, &axis, &plane))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: a cell has too few sparse points to be divided; choose fewer blocks "
                         "than %d",
                         p->scene->path, p->options.count);
    sgs_box left = *cell, right = *cell;
    left.high[axis] = right.low[axis] = plane;
    const sgs_status status = bisect(p, &left, first);
    return status ? status : bisect(p, &right, count - first);
}

// ---- Views ----

static sgs_box grow(const planner *p, const sgs_box *cell)
{
    sgs_box grown = *cell;
    float low[3], high[3];
    finite_part(p, cell, low, high);
    for (int k = 0; k < 3; ++k) {
        const float margin = (float)p->options.margin * fmaxf(high[k] - low[k], 0.0f);
        grown.low[k] -= margin; // infinite ones stay infinite
        grown.high[k] += margin;
    }
    return grown;
}

static bool sees(const sgs_view *view, const float *point)
{
    double camera[3], pixel[2];
    for (int row = 0; row < 3; ++row) {
        camera[row] = view->pose.translation[row];
        for (int k = 0; k < 3; ++k)
            camera[row] += view->pose.rotation[3 * row + k] * (double)point[k];
    }
    return sgs_camera_project(&view->camera, camera, pixel) && pixel[0] >= 0.0 &&
           pixel[0] < view->camera.width && pixel[1] >= 0.0 && pixel[1] < view->camera.height;
}

// True if the line of sight from a camera's centre to a point passes the box.
static bool passes(const sgs_box *box, const float *center, const float *point)
{
    float begin = 0.0f, end = 1.0f; // of the part in the box
    for (int k = 0; k < 3; ++k) {
        const float step = point[k] - center[k];
        if (step == 0.0f) {
            if (!(box->low[k] <= center[k] && center[k] < box->high[k]))
                return false;
            continue;
        }
        const float a = (box->low[k] - center[k]) / step, b = (box->high[k] - center[k]) / step;
        begin = fmaxf(begin, fminf(a, b));
        end = fminf(end, fmaxf(a, b));
    }
    return begin <= end;
}

// Counts the lines of sight of a view to every `step`-th point, and adds those that pass each cell
// to `in`.
static size_t count_sights(const planner *p, size_t v, size_t step, size_t in[SGS_BLOCKS_MAX])
{
    const sgs_scene *scene = p->scene;
    size_t seen = 0;
    for (size_t i = 0; i < scene->point_count; i += step) {
        if (!sees(&scene->views[v], scene->points + 3 * i))
            continue;
        ++seen;
        for (size_t b = 0; b < p->blocks->count; ++b)
            in[b] += passes(&p->grown[b], p->centers + 3 * v, scene->points + 3 * i);
    }
    return seen;
}

static void assign_view(void *context, size_t v, int thread)
{
    (void)thread;
    planner *p = context;
    const size_t blocks = p->blocks->count;
    const size_t step =
        (p->scene->point_count + SGS_BLOCKS_MAX_SIGHT_LINES - 1) / SGS_BLOCKS_MAX_SIGHT_LINES;
    size_t in[SGS_BLOCKS_MAX] = {0};
    if (sgsi_progress_cancelled(&p->progress))
        return;
    size_t seen = count_sights(p, v, step, in);
    if (!seen && step > 1)
        seen = count_sights(p, v, 1, in);
    sgsi_progress_advance(&p->progress);
    uint8_t *member = p->member + v * blocks;
    for (size_t b = 0; b < blocks; ++b)
        member[b] = seen ? (double)in[b] >= p->options.share * (double)seen
                         : sgs_box_contains(&p->blocks->blocks[b].box, p->centers + 3 * v);
}

static sgs_status assign_views(planner *p)
{
    const size_t blocks = p->blocks->count, views = p->scene->view_count;
    p->grown = sgsi_alloc(blocks, sizeof *p->grown);
    p->member = sgsi_calloc(views, blocks);
    if (!p->grown || !p->member)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to plan blocks",
                         p->scene->path);
    for (size_t b = 0; b < blocks; ++b)
        p->grown[b] = grow(p, &p->blocks->blocks[b].box);
    sgsi_progress_begin(&p->progress, p->options.progress, p->options.progress_user, views);
    sgsi_parallel_for(views, 1, assign_view, p);
    const bool cancelled = sgsi_progress_cancelled(&p->progress);
    sgsi_progress_end(&p->progress);
    if (cancelled)
        return sgsi_fail(SGS_STATUS_CANCELLED, "%s: planning was cancelled", p->scene->path);
    for (size_t b = 0; b < blocks; ++b) {
        sgs_block *block = &p->blocks->blocks[b];
        for (size_t i = 0; i < p->scene->point_count; ++i)
            block->points += sgs_box_contains(&block->box, p->scene->points + 3 * i);
        block->views = sgsi_alloc(views, sizeof *block->views);
        if (!block->views)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to plan blocks",
                             p->scene->path);
        for (size_t v = 0; v < views; ++v)
            if (p->member[v * blocks + b])
                block->views[block->view_count++] = v;
        if (!block->view_count)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: no view shows enough of block %zu; choose fewer blocks than %d, "
                             "or a smaller share than %g",
                             p->scene->path, b, p->options.count, p->options.share);
    }
    return SGS_STATUS_OK;
}

static sgs_status check(const sgs_scene *scene, const sgs_block_options *o)
{
    if (o->count < 2 || o->count > SGS_BLOCKS_MAX)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the number of blocks must be 2 to %d",
                         SGS_BLOCKS_MAX);
    if (!(o->margin >= 0.0 && o->margin <= 10.0) || !(o->share >= 0.0 && o->share <= 1.0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "margin must be 0 to 10 and share 0 to 1; they are %g and %g", o->margin,
                         o->share);
    if (!scene->point_count || !scene->view_count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: blocks require sparse points, and the scene has none", scene->path);
    return SGS_STATUS_OK;
}

sgs_status sgs_blocks_plan(const sgs_scene *scene, const sgs_block_options *options,
                           sgs_blocks *blocks)
{
    planner p = {.scene = scene, .options = sgs_block_options_default(), .blocks = blocks};
    *blocks = (sgs_blocks){0};
    sgs_status status =
        sgsi_options_read(options, "sgs_block_options", &p.options, sizeof p.options);
    if (!status)
        status = check(scene, &p.options);
    if (status)
        return status;
    blocks->blocks = sgsi_calloc((size_t)p.options.count, sizeof *blocks->blocks);
    status = blocks->blocks ? find_cameras(&p)
                            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                        "%s: not enough memory to plan blocks", scene->path);
    const sgs_box whole = sgs_box_infinite();
    if (!status)
        status = bisect(&p, &whole, p.options.count);
    if (!status)
        status = assign_views(&p);
    sgsi_free(p.centers);
    sgsi_free(p.grown);
    sgsi_free(p.member);
    if (status)
        sgs_blocks_free(blocks);
    return status;
}
