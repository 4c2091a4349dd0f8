// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Photos and renders as displayed, and as compared by `eval`: composited over the background,
// display-encoded, 8 bits.

#include "sparegs/render.h"
#include "sparegs/scene.h"

enum { PIXELS_AT_ONCE = 1 << 16 }; // by one thread

// The photo composited over `background` (both in the photo's space): three planes
// [height][width] in one block, to be released with free(). NULL if out of memory.
float *photo_flatten(const sgs_photo *photo, const float background[3]);

// Adds the background, multiplied by the transmittance, to the colours.
void frame_add_background(sgs_frame *frame, const float background[3]);

// Display-encodes colours of `space` in place, clamps and quantises them. color: planes
// [height][width]. Release with sgs_image8_free. Fails like sgs_image8_from_planes.
sgs_status planes_quantise(float *const color[3], sgs_space space, int width, int height,
                           sgs_image8 *out);
