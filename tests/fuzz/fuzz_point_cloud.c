// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Point clouds as PLY. Checks that errors name the file, points are finite, and a write and read
// gives the same points.

#include "fuzz_support.h"
#include "ply/point_cloud.h"
#include "sparegs/gaussians.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file("input", data, size);
    size_t count, count_again;
    float *points, *points_again;
    uint8_t *colors, *colors_again;
    if (sgsi_point_cloud_read(path, &count, &points, &colors)) {
        fuzz_check_refusal(path);
        return 0;
    }
    FUZZ_REQUIRE(count <= size);
    fuzz_check_finite(points, 3 * count);
    const char *again = fuzz_path("again");
    if (count) {
        FUZZ_REQUIRE(!sgs_ply_write_points(again, points, colors, count));
        FUZZ_REQUIRE(!sgsi_point_cloud_read(again, &count_again, &points_again, &colors_again));
        FUZZ_REQUIRE(count == count_again &&
                     !memcmp(points, points_again, count * 3 * sizeof(float)) &&
                     !memcmp(colors, colors_again, count * 3));
        sgsi_free(points_again);
        sgsi_free(colors_again);
    }
    sgsi_free(points);
    sgsi_free(colors);
    return 0;
}
