// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Embree 3.13 and 4.x behind one set of names. The differences that concern us: the query context
// became an argument struct, and its flags moved there. The build says which one it links: where
// the headers of both are installed, looking for them could take the other's.

#include <stdbool.h>
#include <string.h>

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
// Where the processor has no packets of sixteen, Embree 4 (seen in 4.4.1) would ask ray by ray, and
// write each ray back with a hit behind the end of `rays`. Two packets of eight are what it has
// instead; they have room for hits, because a processor without those is treated likewise.
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
// Splits packets by itself.
static inline void sgsi_rtc_occluded16(const int *valid, RTCScene scene, sgsi_rtc_context *context,
                                       struct RTCRay16 *rays, bool native)
{
    (void)native;
    rtcOccluded16(valid, scene, context, rays);
}
#endif
