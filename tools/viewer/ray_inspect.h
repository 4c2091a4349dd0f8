// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The primitives along the ray of one pixel, in blending order: exactly those of the brute-force
// reference renderer, in double precision.

#include <jansson.h>

#include "viewer/view_message.h"
#include "viewer/view_source.h"

// {"type": "ray", "x", "y", "count", "transmittance", "hits": [{"id", "t", "alpha", "transmittance"
// (in front of the hit), "weight", "scale" [3], "opacity", "region"}]} with at most RAY_HITS hits.
// Without primitives that the crop of the request hides. NULL if out of memory, or for a pixel
// outside of the image. Requires the source's lock.
enum { RAY_HITS = 1024 };
json_t *ray_inspect(view_source *source, const view_request *request, int x, int y);

// Counted hits of the ray, as sgs_reference_hits over the rows that `keep` flags; NULL: all. *hits:
// [*count], release with free(). False if out of memory.
bool ray_hits(const sgs_gaussians *model, const unsigned char *keep, const sgs_camera *camera,
              const sgs_pose *pose, const sgs_render_options *options, int x, int y, sgs_hit **hits,
              size_t *count);
