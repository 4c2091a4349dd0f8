// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of AOVs. A new one is a row here, its planes in sgs_frame and sgs_reference_frame, and
// its computation in trace/kernel_aov.inl and reference/reference_render.c.

#include <string.h>

#include "sparegs/aov_descriptors.h"

#define PLANES(member)                                                                             \
    .offset = offsetof(sgs_frame, member), .reference_offset = offsetof(sgs_reference_frame, member)

static const sgs_aov table[] = {
    {.name = "color",
     .channels = 3,
     .filter = SGS_AOV_FILTER_PREMULTIPLIED,
     PLANES(color),
     .help = "blended colour without background"},
    {.name = "transmittance",
     .channels = 1,
     .filter = SGS_AOV_FILTER_PREMULTIPLIED,
     PLANES(transmittance),
     .help = "transmittance after the last hit, 1 - alpha"},
    {.name = "depth_mean",
     .bit = SGS_AOV_DEPTH_MEAN,
     .channels = 1,
     .filter = SGS_AOV_FILTER_NORMALIZED,
     PLANES(depth_mean),
     .help = "mean distance of the hits, weighted by their blending weights"},
    {.name = "depth_median",
     .bit = SGS_AOV_DEPTH_MEDIAN,
     .channels = 1,
     .filter = SGS_AOV_FILTER_NEAREST,
     PLANES(depth_median),
     .help = "distance of the hit that takes the transmittance to 0.5"},
    {.name = "depth_first",
     .bit = SGS_AOV_DEPTH_FIRST,
     .channels = 1,
     .filter = SGS_AOV_FILTER_NEAREST,
     PLANES(depth_first),
     .help = "distance of the first hit"},
    {.name = "hits",
     .bit = SGS_AOV_HITS,
     .channels = 1,
     .type = SGS_AOV_TYPE_COUNT,
     .filter = SGS_AOV_FILTER_NEAREST,
     PLANES(hits),
     .help = "number of hits"},
    {.name = "normal",
     .bit = SGS_AOV_NORMAL,
     .channels = 3,
     .filter = SGS_AOV_FILTER_NORMALIZED,
     PLANES(normal),
     .help = "unit normal in world axes"},
    {.name = "position",
     .bit = SGS_AOV_POSITION,
     .channels = 3,
     .filter = SGS_AOV_FILTER_NORMALIZED,
     PLANES(position),
     .help = "mean point of the hits in world coordinates"},
    {.name = "primitive",
     .bit = SGS_AOV_PRIMITIVE,
     .channels = 1,
     .type = SGS_AOV_TYPE_UINT,
     .filter = SGS_AOV_FILTER_NEAREST,
     PLANES(primitive),
     .help = "row of the primitive with the largest contribution"},
    {.name = "candidates",
     .bit = SGS_AOV_CANDIDATES,
     .channels = 1,
     .type = SGS_AOV_TYPE_COUNT,
     .filter = SGS_AOV_FILTER_NEAREST,
     PLANES(candidates),
     .help = "number of primitives that rays of the pixel's tile of 16x16 pixels may hit"},
};

const sgs_aov *sgs_aov_descriptors(size_t *count)
{
    *count = sizeof table / sizeof *table;
    return table;
}

const sgs_aov *sgs_aov_find(const char *name)
{
    for (size_t i = 0; i < sizeof table / sizeof *table; ++i)
        if (!strcmp(table[i].name, name))
            return &table[i];
    return NULL;
}

void *sgs_aov_plane(const sgs_aov *aov, const sgs_frame *frame, int channel)
{
    void *plane;
    memcpy(&plane, (const char *)frame + aov->offset + (size_t)channel * sizeof plane,
           sizeof plane);
    return plane;
}

double *sgs_aov_reference_plane(const sgs_aov *aov, const sgs_reference_frame *frame, int channel)
{
    double *plane;
    memcpy(&plane, (const char *)frame + aov->reference_offset + (size_t)channel * sizeof plane,
           sizeof plane);
    return plane;
}
