// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Photographs as JPEG files for the page.

#include "sparegs/scene.h"
#include "viewer/frame_encoder.h"

// The photograph of a view at the size of its camera, reduced to at most `side` pixels wide and
// high. Transparent pixels are composited over `background` (display values). Reads the image file:
// another thread may use the scene. False if it cannot be read.
bool photo_picture(const sgs_view *view, const float background[3], int side, encoded_picture *out);
