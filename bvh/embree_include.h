// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Embree 3.13 and 4.x behind one set of names. The differences that concern us: the query context became
// an argument struct, and its flags moved there. The build says which one it links: where the headers of both are
// installed, looking for them could take the other's.

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
static inline void sgsi_rtc_occluded16(const int *valid, RTCScene scene, sgsi_rtc_context *context,
                                       struct RTCRay16 *rays)
{
    struct RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = context;
    arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    rtcOccluded16(valid, scene, rays, &arguments);
}
#else
typedef struct RTCIntersectContext sgsi_rtc_context;
static inline void sgsi_rtc_init_context(sgsi_rtc_context *context)
{
    rtcInitIntersectContext(context);
    context->flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
}
static inline void sgsi_rtc_occluded16(const int *valid, RTCScene scene, sgsi_rtc_context *context,
                                       struct RTCRay16 *rays)
{
    rtcOccluded16(valid, scene, context, rays);
}
#endif
