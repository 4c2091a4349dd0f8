// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Photos as image files for the page.

#include "sparegs/scene.h"
#include "viewer/frame_encoder.h"

// A thumbnail is a JPEG file; a whole photo a PNG file, because differences from renders are
// shown many times enlarged.
typedef enum photo_use { PHOTO_THUMBNAIL, PHOTO_WHOLE } photo_use;

// The photo of a view as `eval` compares it with renders: in the space of the scene,
// composited over `background` (in that space), display-encoded. At the size of the view's camera,
// reduced to at most 160 pixels wide and high (thumbnail) or 4096. Reads the image file: another
// thread may use the scene. False if it cannot be read.
bool photo_picture(const sgs_scene *scene, size_t index, const float background[3], photo_use use,
                   encoded_picture *out);
// The memory that this takes, at most.
size_t photo_picture_bytes(const sgs_scene *scene, size_t index, photo_use use);
// The media type of its file.
const char *photo_media_type(photo_use use);
