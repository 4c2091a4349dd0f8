// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One set of names for Embree 3.13 and 4.x. In 4.x the query context became an argument struct and
// took over the flags. The build defines the major version that it links; testing for the header
// could find the other version.

#include <stdbool.h>
#include <string.h>

#include "sparegs/status.h"

#if SGSI_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#if SGSI_EMBREE_MAJOR >= 4
typedef struct RTCRayQueryContext sgsi_rtc_context;
static inline void sgsi_rtc_init_context(sgsi_rtc_context *context)
{
    rtcInitRayQueryContext(context);
}
// Without native packets of sixteen, Embree 4 (observed in 4.4.1) traces ray by ray and writes a
// hit past the end of `rays`. Two packets of eight avoid that: RTCRayHit8 has room for hits,
// because a processor without packets of eight writes them as well.
static inline void sgsi_rtc_occluded16(const int *valid, RTCScene scene, sgsi_rtc_context *context,
                                       struct RTCRay16 *rays, bool native)
{
    enum { FIELDS = sizeof *rays / sizeof rays->org_x, HALF = sizeof rays->org_x / 2 };
    struct RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = context;
    arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    if (native) {
        rtcOccluded16(valid, scene, rays, &arguments);
        return;
    }
    for (int half = 0; half < 2; ++half) {
        struct RTCRayHit8 part = {0};
        RTC_ALIGN(32) int part_valid[8];
        memcpy(part_valid, valid + 8 * half, sizeof part_valid);
        for (int i = 0; i < FIELDS; ++i)
            memcpy((char *)&part.ray + i * HALF, (const char *)rays + (2 * i + half) * HALF, HALF);
        rtcOccluded8(part_valid, scene, &part.ray, &arguments);
    }
}
#else
typedef struct RTCIntersectContext sgsi_rtc_context;
static inline void sgsi_rtc_init_context(sgsi_rtc_context *context)
{
    rtcInitIntersectContext(context);
    context->flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
}
// Embree 3 splits packets itself.
static inline void sgsi_rtc_occluded16(const int *valid, RTCScene scene, sgsi_rtc_context *context,
                                       struct RTCRay16 *rays, bool native)
{
    (void)native;
    rtcOccluded16(valid, scene, context, rays);
}
#endif

// Why rtcNewDevice returned NULL to this thread: fails with OUT_OF_MEMORY, UNSUPPORTED (processor)
// or INTERNAL.
sgs_status sgsi_embree_device_failure(void);
