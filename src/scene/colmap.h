// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads a COLMAP model: cameras, images and points3D, binary (preferred) or text. Does not access
// photos.

#include "scene/dataset.h"

// True if `folder` holds cameras.bin and images.bin, or cameras.txt and images.txt.
bool sgsi_colmap_present(const char *folder);

// Number of registered images, to choose among several models. 0 if the files are unusable;
// sgsi_colmap_read then reports the reason.
size_t sgsi_colmap_image_count(const char *folder);

// Reads the model in `folder`. Non-finite points are dropped with one warning; points3D may be
// missing or empty. On failure *dataset is empty.
sgs_status sgsi_colmap_read(const char *folder, sgsi_dataset *dataset);
