// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scores from whole views, by their effect on training.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "sparegs/image.h"
#include "sparegs/scene.h"
#include "sparegs/trainer.h"
#include "support/trainer_support.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    return room_load(8, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

// Three views whose left half is transparent, over invisible colours: black, or noise.
static sgs_scene *cut_out(bool noise)
{
    enum { VIEWS = 3 };
    sgs_view_source sources[VIEWS];
    uint8_t *bytes[VIEWS];
    for (size_t v = 0; v < VIEWS; ++v) {
        const sgs_view *view = &scene->views[7 * v];
        const size_t width = (size_t)view->image.width, plane = width * (size_t)view->image.height;
        bytes[v] = calloc(4 * plane, 1);
        for (size_t i = 0; i < plane; ++i) {
            const bool opaque = i % width >= width / 2;
            for (size_t c = 0; c < 3; ++c) {
                const float value = sgs_photo_value(&view->image, c * plane + i);
                bytes[v][4 * i + c] = opaque  ? (uint8_t)(255.0f * value + 0.5f)
                                      : noise ? (uint8_t)(i * i % 251)
                                              : 0;
            }
            bytes[v][4 * i + 3] = opaque ? 255 : 0;
        }
        sources[v] = (sgs_view_source){.camera = view->camera,
                                       .pose = view->pose,
                                       .pixel_type = SGS_PIXEL_UINT8,
                                       .channels = 4,
                                       .pixels = bytes[v]};
    }
    const sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *made;
    if (sgs_scene_create(sources, VIEWS, scene->points, scene->colors, scene->point_count, &options,
                         &made))
        fail_msg("%s", sgs_last_error());
    for (size_t v = 0; v < VIEWS; ++v)
        free(bytes[v]);
    return made;
}

static void colours_of_transparent_pixels_have_no_effect(void **state)
{
    (void)state;
    char hashes[2][17];
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p) {
        for (int noise = 0; noise < 2; ++noise) {
            sgs_scene *made = cut_out(noise);
            sgs_train_options options = sgs_train_options_default();
            options.iterations = 100;
            options.pipeline = (sgs_pipeline)p;
            options.background[1] = 0.5f;
            sgs_trainer *trainer = trainer_create(made, &options);
            trainer_run(trainer, 45);
            sgs_gaussians_hash(sgs_trainer_model(trainer), hashes[noise]);
            sgs_trainer_destroy(trainer);
            sgs_scene_destroy(made);
        }
        if (strcmp(hashes[0], hashes[1]) != 0)
            fail_msg("pipeline %d: %s and %s", p, hashes[0], hashes[1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(colours_of_transparent_pixels_have_no_effect),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
