// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads one COLMAP model (cameras, images, points3D; binary preferred over text). Looks at no
// photograph.

#include "scene/dataset.h"

// True when FOLDER holds cameras.bin and images.bin, or cameras.txt and images.txt.
bool sgsi_colmap_present(const char *folder);

// Number of registered images, for choosing among several models; 0 when the files are unusable
// (the reason then comes from sgsi_colmap_read).
size_t sgsi_colmap_image_count(const char *folder);

// Reads the model in FOLDER. Points that are not finite are dropped with one warning; points3D may
// be missing or empty. On failure *dataset is empty and the error names file, byte or line, and the
// fix.
sgs_status sgsi_colmap_read(const char *folder, sgsi_dataset *dataset);
