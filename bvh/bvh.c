// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One Embree device for all trees, one scene with one user geometry per tree. The bounds callback
// copies boxes that a SIMD pass has computed, which is five times faster than computing them in the
// callback. The occlusion callback only records the primitive id and reports no hit, so traversal
// continues to the end of the ray.
//
// Refitting requires the two-level builder: a scene of quality LOW whose geometry had quality REFIT
// at its first commit. In any other scene Embree silently rebuilds. A geometry that becomes REFIT
// later is built a second time by its first refit (500 k boxes: 0.12 s Morton build plus 0.27 s SAH
// build in that refit, instead of 0.27 s build and 0.027 s refit). Embree never rebuilds a REFIT
// geometry, so every build creates a new one.

#include "bvh/bvh.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "base/core.h"
#include "bvh/embree_include.h"
#include "base/threads.h"

struct sgsi_bvh {
    RTCScene scene;
    RTCGeometry geometry;
    const sgsi_bounds *bounds;
    size_t count;
    sgsi_bvh_quality quality;
    atomic_int error; // first error of any thread in the last commit
};

typedef struct gather_context {
    sgsi_rtc_context base; // first member: Embree passes this address to the callback
    sgsi_gather_list *list;
    bool failed;
} gather_context;

// Exists as long as any tree exists, so that trees created after a change of the thread count share
// it.
static RTCDevice device;
static size_t device_users;
static pthread_mutex_t device_lock = PTHREAD_MUTEX_INITIALIZER;
static bool native_packets; // packets of sixteen rays
static atomic_llong device_bytes;

static bool count_bytes(void *user, ssize_t bytes, bool post)
{
    (void)user;
    (void)post;
    atomic_fetch_add_explicit(&device_bytes, (long long)bytes, memory_order_relaxed);
    return true;
}

static bool acquire_device(void)
{
    pthread_mutex_lock(&device_lock);
    if (!device_users) {
        // Our threads join the builds, see commit(): all slots are for them, none for workers of
        // TBB. The number limits every TBB loop of the process, the caller's, too, so it is never
        // less than TBB's own default.
        const int cores = sgsi_affine_cores(), own = sgsi_threads(), n = own > cores ? own : cores;
        char config[64];
        snprintf(config, sizeof config, "threads=%d,user_threads=%d", n, n);
        device = rtcNewDevice(config);
        if (device) {
            rtcSetDeviceMemoryMonitorFunction(device, count_bytes, NULL);
            native_packets =
                rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
        }
    }
    const bool acquired = device != NULL;
    device_users += acquired;
    pthread_mutex_unlock(&device_lock);
    return acquired;
}

static void release_device(void)
{
    pthread_mutex_lock(&device_lock);
    if (!--device_users) {
        rtcReleaseDevice(device);
        device = NULL;
    }
    pthread_mutex_unlock(&device_lock);
}

static sgs_status embree_failure(int error, const char *doing)
{
    switch (error) {
    case RTC_ERROR_NONE:
        return SGS_STATUS_OK;
    case RTC_ERROR_OUT_OF_MEMORY:
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "Embree ran out of memory while %s", doing);
    case RTC_ERROR_UNSUPPORTED_CPU:
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "Embree does not support this processor");
    default:
        return sgsi_fail(SGS_STATUS_INTERNAL, "Embree failed while %s", doing);
    }
}

sgs_status sgsi_embree_device_failure(void)
{
    const int error = (int)rtcGetDeviceError(NULL);
    return embree_failure(error == RTC_ERROR_NONE ? RTC_ERROR_UNKNOWN : error, "creating a device");
}

// Embree's two-level builder opens the boxes of up to four primitives. It ends the program if all
// are the same point, as those of primitives that the view cannot see.
enum { FEW = 8 };

static void widen_point(float lower[3], float upper[3])
{
    for (int k = 0; k < 3; ++k)
        upper[k] = fmaxf(upper[k], lower[k] + fmaxf(1e-6f * fabsf(lower[k]), 1e-30f));
}

static void copy_bounds(const struct RTCBoundsFunctionArguments *arguments)
{
    const sgsi_bvh *bvh = arguments->geometryUserPtr;
    sgsi_bounds box = bvh->bounds[arguments->primID];
    if (bvh->count < FEW)
        widen_point(box.lower, box.upper);
    memcpy(arguments->bounds_o, &box, sizeof box);
}

static void note_primitive(const struct RTCOccludedFunctionNArguments *arguments)
{
    gather_context *context = (gather_context *)arguments->context;
    sgsi_gather_list *list = context->list;
    if (list->count == list->capacity) {
        const size_t capacity = list->capacity ? 2 * list->capacity : 4096;
        if (!sgsi_grow((void **)&list->ids, list->count, capacity, sizeof *list->ids)) {
            context->failed = true;
            return;
        }
        list->capacity = capacity;
    }
    if (list->rows)
        __builtin_prefetch((const char *)list->rows + arguments->primID * list->row_bytes);
    list->ids[list->count++] = arguments->primID;
}

sgs_status sgsi_bvh_create(sgsi_bvh **bvh)
{
    *bvh = NULL;
    sgsi_bvh *created = sgsi_calloc(1, sizeof *created);
    if (!created)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a BVH");
    if (!acquire_device()) {
        sgsi_free(created);
        return sgsi_embree_device_failure();
    }
    *bvh = created;
    return SGS_STATUS_OK;
}

static void release_scene(sgsi_bvh *bvh)
{
    if (bvh->geometry)
        rtcReleaseGeometry(bvh->geometry);
    if (bvh->scene)
        rtcReleaseScene(bvh->scene);
    bvh->geometry = NULL;
    bvh->scene = NULL;
}

void sgsi_bvh_destroy(sgsi_bvh *bvh)
{
    if (!bvh)
        return;
    release_scene(bvh);
    sgsi_free(bvh);
    release_device();
}

// Embree stores errors per thread: any thread of a commit may hold the only one.
static void note_error(sgsi_bvh *bvh)
{
    int none = RTC_ERROR_NONE;
    const int error = (int)rtcGetDeviceError(device);
    if (error != RTC_ERROR_NONE)
        atomic_compare_exchange_strong(&bvh->error, &none, error);
}

static void join_commit(void *context, size_t item, int thread)
{
    (void)item;
    (void)thread;
    sgsi_bvh *bvh = context;
    rtcJoinCommitScene(bvh->scene);
    note_error(bvh);
}

// The first thread starts the commit, the others join it. Embree's own workers would compete with
// our team, whose members spin between loops: on two cores a refit with two threads was slower than
// with one.
static sgs_status commit(sgsi_bvh *bvh, const char *doing)
{
    atomic_store(&bvh->error, RTC_ERROR_NONE);
    rtcCommitGeometry(bvh->geometry);
    note_error(bvh);
    sgsi_parallel_parts((size_t)sgsi_threads(), SGSI_THREADS_MAX, join_commit, bvh);
    return embree_failure(atomic_load(&bvh->error), doing);
}

// Both or none. A missing object is a failure, also if Embree stored no error.
static sgs_status create_scene(sgsi_bvh *bvh)
{
    bvh->scene = rtcNewScene(device);
    bvh->geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    if (bvh->scene && bvh->geometry)
        return SGS_STATUS_OK;
    const int error = (int)rtcGetDeviceError(device);
    release_scene(bvh);
    return embree_failure(error == RTC_ERROR_NONE ? RTC_ERROR_UNKNOWN : error, "creating a scene");
}

sgs_status sgsi_bvh_build(sgsi_bvh *bvh, const sgsi_bounds *bounds, size_t count,
                          sgsi_bvh_quality quality)
{
    static const enum RTCBuildQuality qualities[SGSI_BVH_QUALITY_COUNT] = {
        [SGSI_BVH_LOW] = RTC_BUILD_QUALITY_LOW,
        [SGSI_BVH_MEDIUM] = RTC_BUILD_QUALITY_MEDIUM,
        [SGSI_BVH_HIGH] = RTC_BUILD_QUALITY_HIGH,
        [SGSI_BVH_REFIT] = RTC_BUILD_QUALITY_REFIT,
    };
    const bool two_level = quality == SGSI_BVH_LOW || quality == SGSI_BVH_REFIT;
    if (count > UINT32_MAX - 1)
        return sgsi_fail(SGS_STATUS_LIMIT, "%zu primitives exceed the capacity of a BVH", count);
    bvh->bounds = bounds;
    bvh->count = count;
    if (bvh->quality != quality || quality == SGSI_BVH_REFIT)
        release_scene(bvh);
    bvh->quality = quality;
    if (!bvh->scene) {
        const sgs_status status = create_scene(bvh);
        if (status)
            return status;
        rtcSetSceneBuildQuality(bvh->scene, two_level ? RTC_BUILD_QUALITY_LOW : qualities[quality]);
        // ROBUST: box tests without the rounding of the fast mode, so that padded bounds are never
        // missed.
        rtcSetSceneFlags(bvh->scene, (two_level ? RTC_SCENE_FLAG_DYNAMIC : RTC_SCENE_FLAG_NONE) |
                                         RTC_SCENE_FLAG_ROBUST);
        rtcSetGeometryUserData(bvh->geometry, bvh);
        rtcSetGeometryBoundsFunction(bvh->geometry, copy_bounds, NULL);
        rtcSetGeometryOccludedFunction(bvh->geometry, note_primitive);
        rtcAttachGeometry(bvh->scene, bvh->geometry);
    }
    rtcSetGeometryBuildQuality(bvh->geometry, qualities[quality]);
    rtcSetGeometryUserPrimitiveCount(bvh->geometry, (unsigned)count);
    return commit(bvh, "building the BVH");
}

sgs_status sgsi_bvh_refit(sgsi_bvh *bvh)
{
    return commit(bvh, "refitting the BVH");
}

sgs_status sgsi_bvh_gather(const sgsi_bvh *bvh, const sgsi_packet *packet, sgsi_gather_list *list)
{
    gather_context context = {.list = list};
    sgsi_rtc_init_context(&context.base);
    RTC_ALIGN(64) struct RTCRay16 rays;
    RTC_ALIGN(64) int valid[16];
    for (int i = 0; i < 16; ++i) {
        valid[i] = packet->valid >> i & 1 ? -1 : 0;
        rays.org_x[i] = packet->origin[0];
        rays.org_y[i] = packet->origin[1];
        rays.org_z[i] = packet->origin[2];
        rays.tnear[i] = 0.0f;
        rays.dir_x[i] = packet->direction[0][i];
        rays.dir_y[i] = packet->direction[1][i];
        rays.dir_z[i] = packet->direction[2][i];
        rays.time[i] = 0.0f;
        // Without native packets of sixteen (AVX-512), Embree 3.13.5 ignores `valid`.
        rays.tfar[i] = valid[i] ? packet->far[i] : -INFINITY;
        rays.mask[i] = ~0u;
        rays.id[i] = 0;
        rays.flags[i] = 0;
    }
    sgsi_rtc_occluded16(valid, bvh->scene, &context.base, &rays, native_packets);
    if (context.failed)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu tile candidates",
                         2 * list->capacity);
    return SGS_STATUS_OK;
}

size_t sgsi_bvh_bytes(void)
{
    const long long bytes = atomic_load(&device_bytes);
    return bytes > 0 ? (size_t)bytes : 0;
}

static char version_text[32];
static pthread_once_t version_once = PTHREAD_ONCE_INIT;

static void make_version_text(void)
{
    const bool acquired = acquire_device();
    const ssize_t version =
        acquired ? rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION) : RTC_VERSION;
    if (acquired)
        release_device();
    snprintf(version_text, sizeof version_text, "Embree %d.%d.%d", (int)(version / 10000),
             (int)(version / 100 % 100), (int)(version % 100));
}

const char *sgsi_bvh_version(void)
{
    pthread_once(&version_once, make_version_text);
    return version_text;
}
