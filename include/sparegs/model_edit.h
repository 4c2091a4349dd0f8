// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Changes to a model after training: similarity transforms, fewer SH bands, and the selection of
// primitives. A selection is an array of flags, keep[count]; a function clears the flags of the
// primitives that it rejects and leaves the others.
//
// Coordinates are those of the model (the axes of the PLY and of the data set).
//
// Threads: a call that changes a model must be the only one on it.

#include "sparegs/gaussians.h"

#ifdef __cplusplus
extern "C" {
#endif

// x -> scale R x + translation. SH are rotated too.
typedef struct sgs_similarity {
    double scale;          // > 0
    double rotation[4];    // w, x, y, z, of any positive norm
    double translation[3]; // world units
} sgs_similarity;

// Fails with INVALID_ARGUMENT (scale, rotation or translation), or with LIMIT if a centre or a
// scale would leave the range of float; the model is then unchanged.
SGS_API sgs_status sgs_gaussians_transform(sgs_gaussians *model, const sgs_similarity *similarity);

// Reduces the SH degree; coefficients above it are set to 0. No effect if the degree is not lower.
// A negative degree counts as 0. Cannot fail.
SGS_API void sgs_gaussians_limit_sh(sgs_gaussians *model, int sh_degree);

// Removes the primitives without a flag; the others keep their order. Cannot fail.
SGS_API void sgs_selection_apply(sgs_gaussians *model, const unsigned char *keep);

// Centres within a box or a sphere, borders included; none are within a negative radius. Cannot
// fail.
SGS_API void sgs_select_box(const sgs_gaussians *model, const double low[3], const double high[3],
                            unsigned char *keep);
SGS_API void sgs_select_sphere(const sgs_gaussians *model, const double center[3], double radius,
                               unsigned char *keep);

typedef enum sgs_comparison {
    SGS_LESS,
    SGS_LESS_EQUAL,
    SGS_GREATER,
    SGS_GREATER_EQUAL,
    SGS_EQUAL,
    SGS_NOT_EQUAL
} sgs_comparison;

// Primitives whose property compares as requested. property: a name of the PLY. opacity, scale_N
// and f_dc_N are activated (opacity 0 to 1, world units, colour); with the suffix _raw they are as
// stored. Fails with INVALID_ARGUMENT (unknown property, sh_degree).
SGS_API sgs_status sgs_select_value(const sgs_gaussians *model, const char *property,
                                    sgs_comparison comparison, double value, unsigned char *keep);

// All finite and >= 0. Unlike other structs of options it has no struct_size.
typedef struct sgs_floater_options {
    double voxel;   // world units; 0: four times the median distance to the third nearest neighbour
    double opacity; // fainter primitives neither occupy voxels nor count
    double share;   // of the counted primitives: smallest component that is kept
} sgs_floater_options;

// Rejects floaters. Voxels that contain the centre of a primitive of at least the given opacity are
// occupied; occupied voxels that touch (26 neighbours) form components. Primitives are rejected if
// their component holds less than `share` of the counted ones, or if they are in no occupied voxel.
// options NULL = voxel 0, opacity 0.1, share 0.01. Fails with OUT_OF_MEMORY, LIMIT or
// INVALID_ARGUMENT (options).
SGS_API sgs_status sgs_select_connected(const sgs_gaussians *model,
                                        const sgs_floater_options *options, unsigned char *keep);

#ifdef __cplusplus
}
#endif
