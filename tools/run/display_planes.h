// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Renders over their background.

#include "sparegs/render.h"

enum { PIXELS_AT_ONCE = 1 << 16 }; // by one thread

// Adds the background, multiplied by the transmittance, to the colours.
void frame_add_background(sgs_frame *frame, const float background[3]);
