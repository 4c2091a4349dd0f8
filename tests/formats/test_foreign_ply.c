// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PLY models as other programs write them: marks of antialiasing, Mip-Splatting's filter.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/model_bytes.h"

static void ply_is_read_with_its_filter_and_mark(void **state)
{
    (void)state;
    static const char head[] = "ply\nformat ascii 1.0\n";
    static const char body[] =
        "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float "
        "opacity\n"
        "property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float "
        "rot_0\n"
        "property float rot_1\nproperty float rot_2\nproperty float rot_3\n";
    static const char row[] = "end_header\n1 2 3 0 0 0 0 0 -1 -2 1 0 0 0\n";
    static const struct {
        const char *comments;
        bool antialiased;
    } cases[] = {{"", false},
                 {"comment SplatRenderMode: mip\n", true},
                 {"comment splatrendermode: MIP\n", true},
                 {"comment SplatRenderMode: mip\ncomment SplatRenderMode: default\n", false},
                 {"comment antialiased 1\n", true},
                 {"comment antialiased 0\n", false},
                 {"comment antialiased 10\n", false},
                 {"comment Postshot v1.0.0\ncomment postshot.anti_aliasing=1\n", true},
                 {"comment postshot.anti_aliasing=0\n", false},
                 {"comment postshot.anti_aliasing=1\ncomment SplatRenderMode: default\n", false},
                 {"comment SplatRenderMode: default\ncomment postshot.anti_aliasing=1\n", true},
                 {"comment antialiased 1\ncomment postshot.anti_aliasing=0\n", false},
                 {"comment postshot.anti_aliasing=10\n", false},
                 {"comment no postshot.anti_aliasing=1\n", false},
                 {"comment not SplatRenderMode: mip\n", false}};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model;
    sgs_model_info info;
    char text[2048];
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sprintf(text, "%s%s%s%s", head, cases[k].comments, body, row);
        file_put(temp_path(&folder, "a.ply"), text, strlen(text));
        assert_int_equal(sgs_model_read(temp_path(&folder, "a.ply"), NULL, &model, &info),
                         SGS_STATUS_OK);
        assert_int_equal(info.antialiased, cases[k].antialiased);
        assert_false(info.fused_filter);
        sgs_gaussians_destroy(model);
    }
    sprintf(text, "%s%sproperty float filter_3D\nend_header\n1 2 3 0 0 0 0 0 -1 -2 1 0 0 0 0.5\n",
            head, body);
    file_put(temp_path(&folder, "a.ply"), text, strlen(text));
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.ply"), NULL, &model, &info),
                     SGS_STATUS_OK);
    assert_true(info.fused_filter && info.antialiased);
    double factor = 1;
    for (int k = 0; k < 3; ++k) { // s^2 + f^2, and the factor on the opacity
        const double s = exp(-k), fused = sqrt(s * s + 0.25);
        expect(model, 0, SGS_PARAM_SCALE + k, log(fused));
        factor *= s / fused;
    }
    expect(model, 0, SGS_PARAM_OPACITY, logit(0.5 * factor));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_is_read_with_its_filter_and_mark),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
