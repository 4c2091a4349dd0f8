// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PLY models as other programs write them: marks of antialiasing, Mip-Splatting's filter, flat
// primitives, SH of degree 4.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/model_bytes.h"
#include "support/warning_support.h"

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

// Reads a.ply of the folder; its warnings are in `warnings`.
static sgs_gaussians *read_text(const temp_folder *folder, const char *text)
{
    sgs_gaussians *model;
    file_put(temp_path(folder, "a.ply"), text, strlen(text));
    warnings_begin(NULL);
    const sgs_status status = sgs_model_read(temp_path(folder, "a.ply"), NULL, &model, NULL);
    warnings_end();
    if (status)
        fail_msg("%s", sgs_last_error());
    return model;
}

#define UP_TO_SCALE                                                                                \
    "property float x\nproperty float y\nproperty float z\n"                                       \
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float "         \
    "opacity\n"                                                                                    \
    "property float scale_0\nproperty float scale_1\n"
#define ROTATION                                                                                   \
    "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n"

// splat-transform writes a scale of 0 as ln 0, and a third one to models of 2DGS.
static void flat_primitives_are_kept(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model =
        read_text(&folder, "ply\nformat ascii 1.0\nelement vertex 4\n" UP_TO_SCALE
                           "property float scale_2\n" ROTATION "end_header\n"
                           "1 2 3 0 0 0 0 -1 -2 -inf 1 0 0 0\n"
                           "4 5 6 0 0 0 0 -inf -2 -inf 1 0 0 0\n"
                           "7 8 9 0 0 0 0 inf -2 -1 1 0 0 0\n"
                           "7 8 9 0 0 0 0 nan -2 -1 1 0 0 0\n");
    assert_int_equal(model->count, 2);
    expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){-1, -2, -30});
    expect_row(model, 1, SGS_PARAM_SCALE, 3, (double[]){-30, -2, -30});
    assert_non_null(strstr(warnings, "a.ply: 2 of 4 primitives are not finite and were dropped"));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void a_model_of_2dgs_has_discs(void **state)
{
    (void)state;
    static const char text[] = "ply\nformat ascii 1.0\ncomment SplatRenderMode: 2dgs\n"
                               "element vertex 2\n" UP_TO_SCALE ROTATION "end_header\n"
                               "1 2 3 0 0 0 0 -1 -2 0.5 0.5 0.5 0.5\n"
                               "4 5 6 0 0 0 0 -3 -4 1 0 0 0\n";
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = read_text(&folder, text);
    assert_int_equal(model->count, 2);
    expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){-1, -2, -30});
    expect_row(model, 0, SGS_PARAM_ROTATION, 4, (double[]){0.5, 0.5, 0.5, 0.5});
    expect_row(model, 1, SGS_PARAM_SCALE, 3, (double[]){-3, -4, -30});
    assert_non_null(strstr(warnings, "a.ply: has no property 'scale_2', like models of 2DGS"));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// f_rest is channel-major: red has the first 24.
static void the_band_of_degree_4_is_dropped(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    bytes file = {.size = 0};
    put_text(&file, "ply\nformat ascii 1.0\nelement vertex 1\n" UP_TO_SCALE
                    "property float scale_2\n" ROTATION);
    for (int k = 0; k < 72; ++k)
        put_text(&file, "property float f_rest_%d\n", k);
    put_text(&file, "end_header\n1 2 3 0.5 0.25 0.125 -1 -2 -3 -4 0.5 0.5 0.5 0.5");
    for (int channel = 0; channel < 3; ++channel)
        for (int k = 0; k < 24; ++k)
            put_text(&file, " %d", 100 * channel + k);
    put_u8(&file, '\n');
    put_u8(&file, 0);
    sgs_gaussians *model = read_text(&folder, (const char *)file.data);
    assert_int_equal(model->sh_degree, 3);
    expect_row(model, 0, SGS_PARAM_SH_DC, 3, (double[]){0.5, 0.25, 0.125});
    for (int k = 0; k < 15; ++k)
        expect_row(model, 0, SGS_PARAM_SH_REST + 3 * k, 3, (double[]){k, 100 + k, 200 + k});
    expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){-2, -3, -4});
    assert_non_null(strstr(warnings, "a.ply: SH of degree 4 are ignored"));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_is_read_with_its_filter_and_mark),
        cmocka_unit_test(flat_primitives_are_kept),
        cmocka_unit_test(a_model_of_2dgs_has_discs),
        cmocka_unit_test(the_band_of_degree_4_is_dropped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
