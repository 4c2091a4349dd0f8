// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Camera models that COLMAP added after version 3.8.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "scene/colmap.h"
#include "support/scene_support.h"

// Ids, names and parameters after src/colmap/sensor/models.h of COLMAP 4.1.
static const struct {
    int id, param_count;
    const char *name;
    double params[4];
    double pixel[2]; // of the direction (1, 1, sqrt(2)): 45 degrees from the axis, 45 from x
} later_models[] = {
    {14,
     3,
     "SIMPLE_FISHEYE",
     {40, 33, 25},
     {33 + 40 * 0.5553603672697958, 25 + 22.214414690791832}},
    {15,
     4,
     "FISHEYE",
     {40, 20, 33, 25},
     {33 + 40 * 0.5553603672697958, 25 + 20 * 0.5553603672697958}}, // pi / 4 sqrt(1/2)
    // Longitude atan(1 / sqrt(2)), latitude -30 degrees.
    {17, 2, "EQUIRECTANGULAR", {64, 48}, {64 * (0.5 + 0.09795663800765182), 48 * (0.5 + 1.0 / 6)}}};

static void later_cameras_are_read(void **state)
{
    (void)state;
    for (size_t m = 0; m < sizeof later_models / sizeof *later_models; ++m) {
        for (int binary = 0; binary < 2; ++binary) {
            const temp_folder folder = temp_folder_make();
            const model base = model_make(); // its cameras are replaced
            model_put(&folder, "", &base, binary);
            static buffer b;
            sgsi_dataset d;
            double pixel[2];
            b.size = 0;
            if (binary)
                put_integer(&b, 3, 8);
            for (unsigned id = 2; id <= 9; id += 2 + 3 * (id == 2)) { // 2, 7 and 9
                if (binary) {
                    put_integer(&b, id, 4);
                    put_integer(&b, (uint64_t)later_models[m].id, 4);
                    put_integer(&b, 64, 8);
                    put_integer(&b, 48, 8);
                } else {
                    put_text(&b, "%u %s 64 48", id, later_models[m].name);
                }
                for (int k = 0; k < later_models[m].param_count; ++k)
                    binary ? put_double(&b, later_models[m].params[k])
                           : put_text(&b, " %g", later_models[m].params[k]);
                if (!binary)
                    put_text(&b, "\n");
            }
            tree_put(&folder, binary ? "cameras.bin" : "cameras.txt", b.data, b.size);
            if (sgsi_colmap_read(folder.path, &d))
                fail_msg("%s: %s", later_models[m].name, sgs_last_error());
            assert_true(sgs_camera_project(&d.frames[0].camera, (double[]){1, 1, sqrt(2)}, pixel));
            for (int k = 0; k < 2; ++k)
                if (!(fabs(pixel[k] - later_models[m].pixel[k]) <= 1e-9))
                    fail_msg("%s: pixel %d is %.12g, expected %.12g", later_models[m].name, k,
                             pixel[k], later_models[m].pixel[k]);
            sgsi_dataset_free(&d);
            tree_remove(&folder);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(later_cameras_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
