// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The views that MesonGS's fine-tuning and LightGaussian's distillation train in: all once per
// epoch, and for the distillation also those without a photo.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compress/view_gradient.h"
#include "support/compress_support.h"
#include "support/files_support.h"
#include "support/oracle_support.h"

enum { VIEWS = 3, SIDE = 32, SEEDS = 8 };

// Views from near the origin outwards, 120 degrees apart, with a field of view of 50 degrees.
static sgs_scene *outward_scene(bool photos)
{
    static const uint8_t black[3 * SIDE * SIDE];
    sgs_view_source sources[VIEWS] = {0};
    for (int k = 0; k < VIEWS; ++k) {
        const double angle = 2.0943951023931953 * k;
        sources[k] =
            (sgs_view_source){.camera = oracle_camera(SGS_CAMERA_PINHOLE, SIDE, SIDE),
                              .pose = oracle_pose_look_at(-0.2 * cos(angle), 0, -0.2 * sin(angle)),
                              .split = SGS_SPLIT_TRAIN,
                              .channels = 3,
                              .pixels = photos ? black : NULL};
    }
    sgs_scene *scene;
    if (sgs_scene_create(sources, VIEWS, NULL, NULL, 0, NULL, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

// A bright primitive in each view, which no other view sees.
static sgs_gaussians *outward_model(int sh_degree)
{
    sgs_gaussians *model = pack_model(VIEWS, sh_degree, 1);
    for (size_t i = 0; i < VIEWS; ++i) {
        const double angle = 2.0943951023931953 * (double)i;
        *sgs_gaussians_at(model, i, 0) = (float)(3 * cos(angle));
        *sgs_gaussians_at(model, i, 1) = 0;
        *sgs_gaussians_at(model, i, 2) = (float)(3 * sin(angle));
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = 1;
        for (int k = 0; k < 3; ++k) {
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -1.5f;
            *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + k) = 1;
        }
    }
    return model;
}

static sgs_gaussians *through(const sgs_gaussians *model, const sgs_compress_options *options)
{
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *decoded;
    if (sgs_compress(model, options, temp_path(&folder, "pack"), NULL) ||
        sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL))
        fail_msg("%s", sgs_last_error());
    temp_folder_remove(&folder);
    return decoded;
}

// The primitives whose parameter has changed by more than `least`: those of views that were used.
static size_t trained(const sgs_gaussians *model, const sgs_gaussians *decoded, int param,
                      double least)
{
    size_t count = 0;
    for (size_t i = 0; i < VIEWS; ++i) {
        double nearest = INFINITY, change = 0;
        for (size_t j = 0; j < VIEWS; ++j) { // MesonGS sorts them
            const double x =
                (double)*sgs_gaussians_at(model, i, 0) - (double)*sgs_gaussians_at(decoded, j, 0);
            const double z =
                (double)*sgs_gaussians_at(model, i, 2) - (double)*sgs_gaussians_at(decoded, j, 2);
            if (hypot(x, z) < nearest) {
                nearest = hypot(x, z);
                change = fabs((double)*sgs_gaussians_at(model, i, param) -
                              (double)*sgs_gaussians_at(decoded, j, param));
            }
        }
        count += change > least;
    }
    return count;
}

static void every_epoch_has_all_views(void **state)
{
    (void)state;
    enum { COUNT = 7, EPOCHS = 50 };
    uint32_t order[COUNT], first[COUNT];
    sgsi_view_gradient views = {.count = COUNT, .order = order};
    size_t repeated = 0, at_start[COUNT] = {0};
    for (int epoch = 0; epoch < EPOCHS; ++epoch) {
        bool seen[COUNT] = {false};
        uint32_t drawn[COUNT];
        for (int k = 0; k < COUNT; ++k) {
            const size_t view = sgsi_view_gradient_next(&views, 5, epoch * COUNT + k + 1);
            assert_true(view < COUNT && !seen[view]);
            seen[view] = true;
            drawn[k] = (uint32_t)view;
        }
        if (!epoch)
            memcpy(first, drawn, sizeof first);
        repeated += epoch && !memcmp(first, drawn, sizeof first);
        ++at_start[drawn[0]];
    }
    assert_int_equal(repeated, 0); // of 5040 orders
    for (int k = 0; k < COUNT; ++k)
        assert_in_range(at_start[k], 1, 20); // 7.1 +- 2.5
    // Another seed, another order.
    size_t equal = 0;
    for (int k = 0; k < COUNT; ++k)
        equal += sgsi_view_gradient_next(&views, 6, k + 1) == first[k];
    assert_true(equal < COUNT);
}

// As many steps as views. Views drawn with replacement would miss one in 7 of 9 runs.
static void fine_tuning_uses_all_views(void **state)
{
    (void)state;
    sgs_scene *scene = outward_scene(true);
    sgs_gaussians *model = outward_model(0);
    for (uint64_t seed = 0; seed < SEEDS; ++seed) {
        sgs_compress_options options = sgs_compress_options_default();
        options.method = SGS_COMPRESS_MESONGS;
        options.scene = scene;
        options.seed = seed;
        options.keep = 1;
        options.finetune = VIEWS; // each decreases an opacity by 0.4 * 0.05
        sgs_gaussians *decoded = through(model, &options);
        assert_int_equal(trained(model, decoded, SGS_PARAM_OPACITY, 0.01), VIEWS);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

static void distillation_uses_all_views_also_without_photos(void **state)
{
    (void)state;
    sgs_gaussians *model = outward_model(3);
    for (int photos = 0; photos < 2; ++photos) {
        sgs_scene *scene = outward_scene(photos);
        for (uint64_t seed = 0; seed < SEEDS; ++seed) {
            sgs_compress_options options = sgs_compress_options_default();
            options.method = SGS_COMPRESS_LIGHTGAUSSIAN;
            options.scene = scene;
            options.seed = seed;
            options.vq_ratio = 0.001; // none of three
            options.codebook = options.vq_steps = 1;
            options.distill = VIEWS; // each changes a colour by 0.0025, the decay by 0.000025
            sgs_gaussians *decoded = through(model, &options);
            assert_int_equal(trained(model, decoded, SGS_PARAM_SH_DC, 0.001), VIEWS);
            sgs_gaussians_destroy(decoded);
        }
        sgs_scene_destroy(scene);
    }
    sgs_gaussians_destroy(model);
}

static void fine_tuning_requires_photos(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_scene *scene = outward_scene(false);
    sgs_gaussians *model = outward_model(0);
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_MESONGS;
    options.scene = scene;
    options.finetune = 1;
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "no training view with an image"));
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_epoch_has_all_views),
        cmocka_unit_test(fine_tuning_uses_all_views),
        cmocka_unit_test(distillation_uses_all_views_also_without_photos),
        cmocka_unit_test(fine_tuning_requires_photos),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
