// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Exact nearest neighbours by a balanced kd-tree (Friedman, Bentley, Finkel, "An Algorithm
// for Finding Best Matches in Logarithmic Expected Time", 1977), with tight boxes instead of split
// planes.
//
// The tree is implicit and complete: node k of level d owns the points [n k / 2^d, n (k+1) / 2^d),
// so only boxes are stored. A level is built by a parallel loop over its nodes, each of which
// computes its box and partitions its points about the median along the longest side. Splitting by
// rank instead of position keeps O(n log n) for clusters, distant outliers and duplicates, which
// degrade a grid or a Morton order.
//
// The search is exact in floating point: the distance to a box uses the operations of the distance
// to a point in the same order, and rounding is monotonic, so the former never exceeds the latter
// for a point inside the box.

#include "model/knn.h"

#include <math.h>
#include <stdint.h>

#include "base/core.h"
#include "base/threads.h"

enum { LEAF_POINTS = 8, MANY_LEAF_POINTS = 24, MAX_LEVELS = 32, QUERY_GRAIN = 1024 };

typedef struct tree_point {
    float position[3];
    uint32_t index;
} tree_point;

typedef struct tree_box {
    float low[3], high[3];
} tree_box;

typedef struct sgsi_knn_tree {
    size_t count;
    int levels;         // the leaves are at this level; the root is level 0
    tree_point *points; // in leaf order after the build
    tree_box *boxes;    // node k of level d is boxes[2^d + k]
    double *distances;  // of sgsi_knn
} tree;

typedef struct tree_level {
    tree *owner;
    int level;
} tree_level;

static size_t node_begin(const tree *t, int level, size_t node)
{
    return (size_t)(((uint64_t)t->count * node) >> level); // count < 2^32, node <= 2^30
}

static void swap_points(tree_point *a, tree_point *b)
{
    const tree_point kept = *a;
    *a = *b;
    *b = kept;
}

// Quickselect with three-way partition and hashed pivots (quadratic time is improbable for any
// input). Afterwards points[begin, rank) <= points[rank, end) along `axis`.
static void select_rank(tree_point *points, size_t begin, size_t end, size_t rank, int axis)
{
    for (uint64_t round = 0; end - begin > 1; ++round) {
        const size_t chosen =
            begin + (size_t)(sgsi_random_bits(end - begin, round) % (end - begin));
        const float pivot = points[chosen].position[axis];
        size_t below = begin, at = begin, above = end;
        while (at < above) {
            const float value = points[at].position[axis];
            if (value < pivot)
                swap_points(&points[below++], &points[at++]);
            else if (value > pivot)
                swap_points(&points[--above], &points[at]);
            else
                ++at;
        }
        if (rank < below)
            end = below;
        else if (rank >= above)
            begin = above;
        else
            return;
    }
}

static void build_node(void *context, size_t node, int thread)
{
    (void)thread;
    const tree_level *level = context;
    tree *t = level->owner;
    const size_t begin = node_begin(t, level->level, node);
    const size_t end = node_begin(t, level->level, node + 1);
    tree_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = begin; i < end; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            const float value = t->points[i].position[axis];
            box.low[axis] = value < box.low[axis] ? value : box.low[axis];
            box.high[axis] = value > box.high[axis] ? value : box.high[axis];
        }
    }
    t->boxes[((size_t)1 << level->level) + node] = box;
    if (level->level == t->levels)
        return;
    int longest = 0;
    double length = -1.0;
    for (int axis = 0; axis < 3; ++axis) {
        const double side = (double)box.high[axis] - box.low[axis];
        if (side > length) {
            length = side;
            longest = axis;
        }
    }
    select_rank(t->points, begin, end, node_begin(t, level->level + 1, 2 * node + 1), longest);
}

static double squared_distance(const float a[3], const float b[3])
{
    const double x = (double)a[0] - b[0], y = (double)a[1] - b[1], z = (double)a[2] - b[2];
    return x * x + y * y + z * z;
}

static double box_distance(const tree_box *box, const float p[3])
{
    double side[3];
    for (int axis = 0; axis < 3; ++axis) {
        const double under = (double)box->low[axis] - p[axis],
                     over = (double)p[axis] - box->high[axis];
        const double outside = under > over ? under : over;
        side[axis] = outside > 0.0 ? outside : 0.0;
    }
    return side[0] * side[0] + side[1] * side[1] + side[2] * side[2];
}

static void search_leaf(const tree *t, size_t node, const tree_point *query, double best[3])
{
    const size_t end = node_begin(t, t->levels, node + 1);
    for (size_t i = node_begin(t, t->levels, node); i < end; ++i) {
        const double d = squared_distance(query->position, t->points[i].position);
        if (d >= best[2] || t->points[i].index == query->index)
            continue;
        best[2] = d < best[1] ? best[1] : d;
        best[1] = d < best[0] ? best[0] : d < best[1] ? d : best[1];
        best[0] = d < best[0] ? d : best[0];
    }
}

typedef struct visit {
    double distance;
    size_t node; // index into tree.boxes
    int level;
} visit;

// Pushes the children of an inner node, the nearer one last. Returns the new depth.
static inline int push_children(const tree *t, const visit *at, const tree_point *query,
                                visit *stack, int depth)
{
    const tree_box *boxes = &t->boxes[2 * at->node];
    visit near = {box_distance(&boxes[0], query->position), 2 * at->node, at->level + 1};
    visit far = {box_distance(&boxes[1], query->position), 2 * at->node + 1, at->level + 1};
    if (far.distance < near.distance) {
        const visit kept = near;
        near = far;
        far = kept;
    }
    stack[depth++] = far;
    stack[depth++] = near;
    return depth;
}

static void search(const tree *t, const tree_point *query, double best[3])
{
    visit stack[MAX_LEVELS + 2]; // each level pushes at most its farther child
    int depth = 0;
    stack[depth++] = (visit){0.0, 1, 0};
    while (depth) {
        const visit at = stack[--depth];
        if (at.distance >= best[2])
            continue;
        if (at.level == t->levels) {
            search_leaf(t, at.node - ((size_t)1 << at.level), query, best);
            continue;
        }
        depth = push_children(t, &at, query, stack, depth);
    }
}

static void search_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const tree *t = context;
    for (size_t i = begin; i < end; ++i) {
        double best[3] = {INFINITY, INFINITY, INFINITY};
        search(t, &t->points[i], best);
        for (int k = 0; k < SGSI_KNN_NEIGHBOURS; ++k)
            t->distances[(size_t)t->points[i].index * SGSI_KNN_NEIGHBOURS + (size_t)k] = best[k];
    }
}

static void free_tree(tree *t)
{
    sgsi_free(t->points);
    sgsi_free(t->boxes);
}

// Builds the tree of n > 0 points; free it also after a failure.
static sgs_status build(const float *points, size_t n, size_t leaf_points, tree *t)
{
    if (n >= UINT32_MAX)
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "a cloud of %zu points is too large; the limit is 4294967294", n);
    t->count = n;
    while (((n - 1) >> t->levels) + 1 > leaf_points)
        ++t->levels;
    t->points = sgsi_alloc(n, sizeof *t->points);
    t->boxes = sgsi_alloc((size_t)2 << t->levels, sizeof *t->boxes);
    if (!t->points || !t->boxes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the neighbour search over %zu points", n);
    for (size_t i = 0; i < n; ++i)
        t->points[i] =
            (tree_point){{points[3 * i], points[3 * i + 1], points[3 * i + 2]}, (uint32_t)i};
    for (int level = 0; level <= t->levels; ++level) {
        tree_level context = {t, level};
        sgsi_parallel_for((size_t)1 << level, level > 8 ? (size_t)1 << (level - 8) : 1, build_node,
                          &context);
    }
    return SGS_STATUS_OK;
}

sgs_status sgsi_knn(const float *points, size_t n, double *distances)
{
    if (!n)
        return SGS_STATUS_OK;
    tree t = {.distances = distances};
    const sgs_status status = build(points, n, LEAF_POINTS, &t);
    if (!status)
        sgsi_parallel_ranges(n, QUERY_GRAIN, search_range, &t);
    free_tree(&t);
    return status;
}

// ---- Any number of neighbours ----

typedef struct candidate {
    double distance;
    uint32_t index;
} candidate;

// The best candidates so far, a heap with the worst one on top.
typedef struct candidate_heap {
    size_t count, wanted;
    candidate items[SGSI_KNN_MAX];
} candidate_heap;

static bool is_worse(const candidate *a, const candidate *b)
{
    return a->distance > b->distance || (a->distance == b->distance && a->index > b->index);
}

// Moves `item` down from the top of a heap of `count`.
static void sift_down(candidate *items, size_t count, candidate item)
{
    size_t at = 0;
    for (size_t child = 1; child < count; child = 2 * at + 1) {
        if (child + 1 < count && is_worse(&items[child + 1], &items[child]))
            ++child;
        if (!is_worse(&items[child], &item))
            break;
        items[at] = items[child];
        at = child;
    }
    items[at] = item;
}

static void offer(candidate_heap *heap, candidate item)
{
    if (heap->count == heap->wanted) {
        if (is_worse(&heap->items[0], &item))
            sift_down(heap->items, heap->count, item);
        return;
    }
    size_t at = heap->count++;
    for (; at && is_worse(&item, &heap->items[(at - 1) / 2]); at = (at - 1) / 2)
        heap->items[at] = heap->items[(at - 1) / 2];
    heap->items[at] = item;
}

// Infinite distances compare, too: only a full heap excludes points.
static bool excludes(const candidate_heap *heap, double distance)
{
    return heap->count == heap->wanted && distance >= heap->items[0].distance;
}

static void search_many(const tree *t, const tree_point *query, candidate_heap *heap)
{
    visit stack[MAX_LEVELS + 2]; // each level pushes at most its farther child
    int depth = 0;
    stack[depth++] = (visit){0.0, 1, 0};
    while (depth) {
        const visit at = stack[--depth];
        if (excludes(heap, at.distance))
            continue;
        if (at.level == t->levels) {
            const size_t leaf = at.node - ((size_t)1 << at.level);
            const size_t end = node_begin(t, t->levels, leaf + 1);
            for (size_t i = node_begin(t, t->levels, leaf); i < end; ++i)
                if (t->points[i].index != query->index)
                    offer(heap,
                          (candidate){squared_distance(query->position, t->points[i].position),
                                      t->points[i].index});
            continue;
        }
        depth = push_children(t, &at, query, stack, depth);
    }
}

typedef struct search_job {
    const tree *owner;
    size_t first, wanted;
    uint32_t *neighbours;
} search_job;

static void search_many_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const search_job *job = context;
    for (size_t place = job->first + begin; place < job->first + end; ++place) {
        const tree_point *query = &job->owner->points[place];
        candidate_heap heap = {.wanted = job->wanted};
        search_many(job->owner, query, &heap);
        uint32_t *out = job->neighbours + (size_t)query->index * job->wanted;
        while (heap.count) { // the worst goes to the end
            out[heap.count - 1] = heap.items[0].index;
            --heap.count;
            sift_down(heap.items, heap.count, heap.items[heap.count]);
        }
    }
}

sgs_status sgsi_knn_tree_create(const float *points, size_t n, sgsi_knn_tree **made)
{
    *made = NULL;
    tree *t = sgsi_calloc(1, sizeof *t);
    if (!t)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a neighbour search");
    const sgs_status status = n ? build(points, n, MANY_LEAF_POINTS, t) : SGS_STATUS_OK;
    if (status) {
        sgsi_knn_tree_destroy(t);
        return status;
    }
    *made = t;
    return SGS_STATUS_OK;
}

void sgsi_knn_tree_destroy(sgsi_knn_tree *t)
{
    if (!t)
        return;
    free_tree(t);
    sgsi_free(t);
}

void sgsi_knn_tree_search(const sgsi_knn_tree *t, size_t begin, size_t end, size_t k,
                          uint32_t *neighbours)
{
    search_job job = {t, begin, k, neighbours};
    sgsi_parallel_ranges(end - begin, QUERY_GRAIN, search_many_range, &job);
}
