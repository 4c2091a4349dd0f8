// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads a coloured point cloud from a PLY file, for example the ply_file_path of nerfstudio.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

// points [count][3]: finite (others are dropped with one warning); colors [count][3]: grey if the
// file has none. The caller releases both with sgsi_free. On failure both are NULL and *count is 0.
sgs_status sgsi_point_cloud_read(const char *path, size_t *count, float **points, uint8_t **colors);

// Warns that `count` points with NaN or infinite coordinates were dropped, the first one at `place`
// (a byte, line or vertex, named by `unit`) of the file. No effect for count 0.
void sgsi_point_cloud_warn_dropped(const char *path, const char *unit, unsigned long long place,
                                   size_t count);
