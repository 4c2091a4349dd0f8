// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "bvh/bvh_cost.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/core.h"
#include "bvh/embree_include.h"
#include "base/threads.h"

// As in Embree's BVHNBuilderSAH for user geometry. Its heuristic counts primitives in blocks of the
// number of children of a node, so a REFIT tree has a leaf wherever its primitives fit into one
// block.
enum { BRANCHES = 8, BRANCHES_SSE = 4 };

typedef struct box {
    float lower[3], upper[3];
} box;

typedef struct tree_node {
    box bounds;
    unsigned child_count, primitive_count; // exactly one is non-zero
    union {
        struct tree_node *children[BRANCHES];
        unsigned primitives[2 * BRANCHES];
    };
} tree_node;

static void *create_node(RTCThreadLocalAllocator allocator, unsigned child_count, void *user)
{
    (void)user;
    tree_node *node = rtcThreadLocalAlloc(allocator, sizeof *node, 16);
    node->child_count = child_count;
    node->primitive_count = 0;
    return node;
}

static void set_children(void *pointer, void **children, unsigned child_count, void *user)
{
    (void)user;
    tree_node *node = pointer;
    for (unsigned i = 0; i < child_count; ++i)
        node->children[i] = children[i];
}

static void ignore_bounds(void *node, const struct RTCBounds **bounds, unsigned child_count,
                          void *user)
{
    (void)node;
    (void)bounds;
    (void)child_count;
    (void)user;
}

static void *create_leaf(RTCThreadLocalAllocator allocator,
                         const struct RTCBuildPrimitive *primitives, size_t count, void *user)
{
    (void)user;
    tree_node *node = rtcThreadLocalAlloc(allocator, sizeof *node, 16);
    node->child_count = 0;
    node->primitive_count = (unsigned)count;
    for (size_t i = 0; i < count; ++i)
        node->primitives[i] = primitives[i].primID;
    return node;
}

static double area(const box *b)
{
    const double x = fmax((double)b->upper[0] - (double)b->lower[0], 0),
                 y = fmax((double)b->upper[1] - (double)b->lower[1], 0);
    const double z = fmax((double)b->upper[2] - (double)b->lower[2], 0);
    return 2.0 * (x * y + y * z + z * x);
}

static void widen(box *b, const float lower[3], const float upper[3])
{
    for (int k = 0; k < 3; ++k) {
        b->lower[k] = fminf(b->lower[k], lower[k]);
        b->upper[k] = fmaxf(b->upper[k], upper[k]);
    }
}

// Surface area of the intersection of two boxes; 0 when they are disjoint.
static double shared_area(const box *a, const box *b)
{
    box both;
    for (int k = 0; k < 3; ++k) {
        both.lower[k] = fmaxf(a->lower[k], b->lower[k]);
        both.upper[k] = fminf(a->upper[k], b->upper[k]);
        if (!(both.lower[k] <= both.upper[k]))
            return 0;
    }
    return area(&both);
}

typedef struct measure_sums {
    const sgsi_bounds *bounds;
    double leaf, shared, inner; // areas; leaf: times the primitives
    sgsi_bvh_cost *cost;
} measure_sums;

// Sets the bounds of the node and of those below it.
static void measure_node(measure_sums *sums, tree_node *node, int depth)
{
    box own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    ++sums->cost->nodes;
    sums->cost->depth = depth > sums->cost->depth ? depth : sums->cost->depth;
    if (!node->child_count) {
        ++sums->cost->leaves;
        ++sums->cost->leaf_sizes[node->primitive_count];
        for (unsigned i = 0; i < node->primitive_count; ++i)
            widen(&own, sums->bounds[node->primitives[i]].lower,
                  sums->bounds[node->primitives[i]].upper);
        sums->leaf += area(&own) * node->primitive_count;
        node->bounds = own;
        return;
    }
    for (unsigned i = 0; i < node->child_count; ++i) {
        const box *child = &node->children[i]->bounds;
        measure_node(sums, node->children[i], depth + 1);
        widen(&own, child->lower, child->upper);
        for (unsigned j = 0; j < i; ++j)
            sums->shared += shared_area(child, &node->children[j]->bounds);
    }
    sums->inner += area(&own);
    node->bounds = own;
}

// ---- Traversal ----

typedef struct packet_work {
    uint64_t nodes, boxes, primitives;
} packet_work;

typedef struct traversal {
    const tree_node *root;
    const sgsi_packet *packets;
    packet_work *work; // [packets]
} traversal;

// True if a valid ray crosses the box. A NaN, from a ray within the plane of a side, leaves the
// interval unchanged.
static bool crosses(const sgsi_packet *packet, const float inverse[3][16], const box *b)
{
    uint32_t lanes = 0;
    for (int i = 0; i < 16; ++i) {
        float enter = 0, leave = packet->far[i];
        for (int k = 0; k < 3; ++k) {
            const float t0 = (b->lower[k] - packet->origin[k]) * inverse[k][i],
                        t1 = (b->upper[k] - packet->origin[k]) * inverse[k][i];
            enter = fmaxf(enter, fminf(t0, t1));
            leave = fminf(leave, fmaxf(t0, t1));
        }
        lanes |= (uint32_t)(enter <= leave * (1 + 4e-7f)) << i;
    }
    return (lanes & packet->valid) != 0;
}

static void visit(packet_work *work, const sgsi_packet *packet, const float inverse[3][16],
                  const tree_node *node)
{
    ++work->nodes;
    work->primitives += node->primitive_count;
    work->boxes += node->child_count;
    for (unsigned i = 0; i < node->child_count; ++i)
        if (crosses(packet, inverse, &node->children[i]->bounds))
            visit(work, packet, inverse, node->children[i]);
}

static void traverse(void *context, size_t item, int thread)
{
    (void)thread;
    const traversal *t = context;
    const sgsi_packet *packet = &t->packets[item];
    float inverse[3][16];
    for (int k = 0; k < 3; ++k)
        for (int i = 0; i < 16; ++i)
            inverse[k][i] = 1 / packet->direction[k][i];
    t->work[item] = (packet_work){0};
    if (packet->valid)
        visit(&t->work[item], packet, inverse, t->root);
}

// False if out of memory.
static bool count_visits(sgsi_bvh_visits *visits, const tree_node *root)
{
    packet_work *work = sgsi_alloc(visits->count ? visits->count : 1, sizeof *work);
    traversal job = {.root = root, .packets = visits->packets, .work = work};
    if (!work)
        return false;
    sgsi_parallel_for(visits->count, 1, traverse, &job);
    for (size_t i = 0; i < visits->count; ++i) {
        visits->nodes += work[i].nodes;
        visits->boxes += work[i].boxes;
        visits->primitives += work[i].primitives;
    }
    sgsi_free(work);
    return true;
}

// Omits boxes from the tree that are not finite, inverted or beyond 1e18.
static struct RTCBuildPrimitive *list_primitives(const sgsi_bounds *bounds, size_t count,
                                                 size_t *listed)
{
    struct RTCBuildPrimitive *list = sgsi_alloc(count ? count : 1, sizeof *list);
    *listed = 0;
    for (size_t i = 0; list && i < count; ++i) {
        bool sane = true;
        for (int k = 0; k < 3; ++k)
            sane = sane && bounds[i].lower[k] <= bounds[i].upper[k] &&
                   fabsf(bounds[i].lower[k]) < 1e18f && fabsf(bounds[i].upper[k]) < 1e18f;
        if (!sane)
            continue;
        struct RTCBuildPrimitive *to = &list[(*listed)++];
        memset(to, 0, sizeof *to);
        to->lower_x = bounds[i].lower[0], to->lower_y = bounds[i].lower[1],
        to->lower_z = bounds[i].lower[2];
        to->upper_x = bounds[i].upper[0], to->upper_y = bounds[i].upper[1],
        to->upper_z = bounds[i].upper[2];
        to->primID = (unsigned)i;
    }
    return list;
}

sgs_status sgsi_bvh_cost_measure(const sgsi_bounds *built, const sgsi_bounds *bounds, size_t count,
                                 sgsi_bvh_quality quality, sgsi_bvh_visits *visits,
                                 sgsi_bvh_cost *cost)
{
    *cost = (sgsi_bvh_cost){0};
    if (visits)
        visits->nodes = visits->boxes = visits->primitives = 0;
    size_t listed;
    struct RTCBuildPrimitive *primitives = list_primitives(built, count, &listed);
    // rtcBuildBVH cannot be joined: it runs on Embree's own threads, as many as ours unless another
    // device allows more.
    char config[32];
    snprintf(config, sizeof config, "threads=%d", sgsi_threads());
    RTCDevice device = rtcNewDevice(config);
    if (!device) {
        sgsi_free(primitives);
        return sgsi_embree_device_failure();
    }
    RTCBVH tree = rtcNewBVH(device);
    tree_node *root = NULL;
    bool counted = true;
    if (primitives && tree && listed) {
        struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
        arguments.buildQuality =
            quality == SGSI_BVH_LOW ? RTC_BUILD_QUALITY_LOW : RTC_BUILD_QUALITY_MEDIUM;
        const bool wide =
            rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0;
        arguments.maxBranchingFactor = wide ? BRANCHES : BRANCHES_SSE;
        arguments.sahBlockSize = arguments.maxBranchingFactor;
        arguments.minLeafSize = 1;
        arguments.maxLeafSize = quality == SGSI_BVH_REFIT ? SGSI_BVH_LEAF_MAX : 1;
        arguments.bvh = tree;
        arguments.primitives = primitives;
        arguments.primitiveCount = listed;
        arguments.primitiveArrayCapacity = listed;
        arguments.createNode = create_node;
        arguments.setNodeChildren = set_children;
        arguments.setNodeBounds = ignore_bounds;
        arguments.createLeaf = create_leaf;
        root = rtcBuildBVH(&arguments);
    }
    if (root) {
        measure_sums sums = {.bounds = bounds, .cost = cost};
        measure_node(&sums, root, 1);
        const double surface = area(&root->bounds);
        cost->cost = surface > 0 ? (sums.inner + sums.leaf) / surface : 0;
        cost->primitives = surface > 0 ? sums.leaf / surface : 0;
        cost->overlap = sums.inner > 0 ? sums.shared / sums.inner : 0;
        counted = !visits || count_visits(visits, root);
    }
    const bool failed = !primitives || !tree || (listed && !root) || !counted;
    if (tree)
        rtcReleaseBVH(tree);
    rtcReleaseDevice(device);
    sgsi_free(primitives);
    return failed ? sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                              "not enough memory to measure a tree over %zu boxes", count)
                  : SGS_STATUS_OK;
}
