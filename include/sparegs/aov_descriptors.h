// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One descriptor per quantity of a rendered frame (arbitrary output variable, AOV): name, planes,
// type, and how its pixels may be combined. Frames of the tracer and of the reference are allocated
// from this table; writers of files can walk it.
//
// Threads: all functions may be called from any thread at any time.

#include <stddef.h>

#include "sparegs/export.h"
#include "sparegs/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_aov_type {
    SGS_AOV_TYPE_FLOAT = 0, // float
    SGS_AOV_TYPE_COUNT,     // float, a whole number
    SGS_AOV_TYPE_UINT       // uint32_t
} sgs_aov_type;

// How pixels are combined, for example the samples of one pixel or the tiles of a smaller image.
typedef enum sgs_aov_filter {
    SGS_AOV_FILTER_PREMULTIPLIED = 0, // sums over the hits: the mean of pixels is right
    SGS_AOV_FILTER_NORMALIZED,        // divided by alpha: weight pixels by alpha, then normalise
    SGS_AOV_FILTER_NEAREST            // of one hit or a count: choose one pixel, do not average
} sgs_aov_filter;

typedef struct sgs_aov {
    const char *name; // unique: "depth_mean"
    unsigned bit;     // SGS_AOV_ bit that requests it; 0: always present
    int channels;     // planes: 1 or 3
    sgs_aov_type type;
    sgs_aov_filter filter;
    size_t offset;           // of the first plane's pointer in sgs_frame; the others follow it
    size_t reference_offset; // likewise in sgs_reference_frame, where planes are double
    const char *help;
} sgs_aov;

// The table, [*count] in the order of sgs_frame; static. Cannot fail.
SGS_API const sgs_aov *sgs_aov_descriptors(size_t *count);

// The row of a name, or NULL.
SGS_API const sgs_aov *sgs_aov_find(const char *name);

// Plane `channel` (0 to aov->channels - 1, not checked) of the frame, float or uint32_t as the type
// requires; NULL if the frame lacks it. Owned by the frame. Cannot fail.
SGS_API void *sgs_aov_plane(const sgs_aov *aov, const sgs_frame *frame, int channel);
// The same for a frame of the reference, whose planes are double.
SGS_API double *sgs_aov_reference_plane(const sgs_aov *aov, const sgs_reference_frame *frame,
                                        int channel);

#ifdef __cplusplus
}
#endif
