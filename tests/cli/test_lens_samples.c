// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Samples of the lens for depth of field.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "cameras/lens_samples.h"

static void the_focal_plane_is_sharp(void **state)
{
    (void)state;
    static const sgs_camera lenses[] = {
        {SGS_CAMERA_PINHOLE, 480, 270, {200, 200, 240, 135}},
        {SGS_CAMERA_PINHOLE, 480, 270, {400, 200, 240, 135}},
        {SGS_CAMERA_OPENCV, 480, 270, {200, 201, 240, 135, 0.1, 0.02, 0, 0}},
        {SGS_CAMERA_FOV, 480, 270, {200, 200, 240, 135, 0.9}}, // its scale on the axis is not fx
    };
    const double focus = 4, subject[3] = {0, 0, focus}, aperture = 1e-3; // distortion is negligible
    for (size_t i = 0; i < sizeof lenses / sizeof *lenses; ++i)
        for (int k = 0; k < 16; ++k) {
            sgs_camera lens = lenses[i], still = lenses[i];
            sgs_pose place = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}}, same = place;
            lens_sample(k, aperture, focus, &lens, &place);
            lens_sample(k, 0, focus, &still, &same);
            double point[3], pixel[2], middle[2];
            for (int c = 0; c < 3; ++c)
                point[c] = subject[c] + place.translation[c];
            assert_true(sgs_camera_project(&lens, point, pixel) &&
                        sgs_camera_project(&still, subject, middle));
            assert_true(hypot(place.translation[0], place.translation[1]) > 0);
            if (!(hypot(pixel[0] - middle[0], pixel[1] - middle[1]) < 1e-6))
                fail_msg("lens %zu, sample %d: %g %g", i, k, pixel[0] - middle[0],
                         pixel[1] - middle[1]);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_focal_plane_is_sharp)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
