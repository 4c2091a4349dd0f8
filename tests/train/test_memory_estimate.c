// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Terms of the memory estimate that are not those of the training itself: decoding of the photos
// and evaluation. Memory that the program reserves for itself.

#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/trainer_support.h"

#define GIB ((size_t)1 << 30)

static sgs_view one_view(int width, int height)
{
    return (sgs_view){.camera = {.model = SGS_CAMERA_PINHOLE,
                                 .width = width,
                                 .height = height,
                                 .params = {width, width, width / 2.0, height / 2.0}}};
}

static size_t estimate(const sgs_scene *scene, size_t image_cache, size_t gaussians)
{
    const sgs_train_options options = sgs_train_options_default();
    return sgs_train_memory(scene, &options, image_cache, gaussians);
}

// While the photos are loaded, every thread decodes one, up to the limit; at least one is decoded.
static void photos_are_decoded_by_every_thread(void **state)
{
    (void)state;
    static const size_t rows[][4] = {// photo, limit, threads; bytes; all but threads in GiB
                                     {1, 100, 4, 4},
                                     {1, 100, 64, 64},
                                     {1, 10, 64, 10},
                                     {20, 10, 64, 20},
                                     {20, 0, 2, 20}};
    sgs_view view = one_view(64, 64);
    sgs_scene scene = {.view_count = 1, .views = &view, .extent = 1};
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k) {
        size_t bytes[2];
        sgs_threads_set((int)rows[k][2]);
        for (size_t i = 0; i < 2; ++i) { // the difference of two photos
            scene.decode_bytes = rows[k][0] * GIB << i;
            scene.decode_limit = rows[k][1] * GIB << i;
            bytes[i] = estimate(&scene, 0, 0);
        }
        assert_true(bytes[1] - bytes[0] == rows[k][3] * GIB);
    }
    sgs_threads_set(0);
}

// Counts that no machine holds: the largest size, which exceeds every limit, not a small remainder.
static void estimates_saturate(void **state)
{
    (void)state;
    sgs_view view = one_view(640, 480);
    const sgs_scene scene = {.view_count = 1, .views = &view, .extent = 1};
    sgs_train_options options = sgs_train_options_default();
    for (size_t count = (size_t)1 << 50; count; count <<= 1)
        for (int ranks = 1; ranks <= 3; ++ranks) {
            const size_t bytes =
                sgs_train_memory_per_rank(&scene, &options, 0, count, ranks, SIZE_MAX);
            // Columns of 150 bytes and more of all ranks.
            assert_true(bytes / 100 >= count || bytes == SIZE_MAX);
        }
    assert_true(sgs_train_memory(&scene, &options, 0, SIZE_MAX) == SIZE_MAX);
    options.spare = SGS_SPARE_BMD;
    options.spare_grid = INT_MAX;
    assert_true(sgs_train_memory(&scene, &options, 0, 1000) == SIZE_MAX);
}

// With a cache, photos are also decoded beside the training: by its threads and the caller.
static void decoding_adds_to_the_training_only_with_a_cache(void **state)
{
    (void)state;
    sgs_view view = one_view(8192, 4096);
    sgs_scene scene = {.view_count = 1, .views = &view, .extent = 1, .photo_bytes = GIB};
    size_t bytes[2][2];
    sgs_threads_set(16);
    for (int cached = 0; cached < 2; ++cached)
        for (int decodes = 0; decodes < 2; ++decodes) {
            scene.decode_bytes = decodes ? 1000 : 0;
            scene.decode_limit = GIB;
            bytes[cached][decodes] = estimate(&scene, cached ? GIB / 2 : 0, 1000000);
        }
    assert_int_equal(bytes[0][1], bytes[0][0]);
    assert_int_equal(bytes[1][1] - bytes[1][0], 3000);
    assert_int_equal(bytes[0][0] - bytes[1][0], GIB / 2);
    sgs_threads_set(0);
}

// 5 moments of 1 + 26 rows in double precision for each thread, 6 MB of other memory. With many
// primitives, the training has the peak.
static void the_scratch_of_the_evaluation_is_estimated(void **state)
{
    (void)state;
    sgs_view view = one_view(65536, 16);
    const sgs_scene scene = {.view_count = 1, .views = &view, .extent = 1};
    size_t bytes[2][2];
    for (int many = 0; many < 2; ++many)
        for (int k = 0; k < 2; ++k) {
            sgs_threads_set(k ? 8 : 4);
            bytes[many][k] = estimate(&scene, 0, many ? 1000000 : 0);
        }
    assert_int_equal(bytes[0][1] - bytes[0][0], 4 * (6000000 + 5 * 27 * 8 * 65536));
    sgs_threads_set(8);
    sgs_view narrow = one_view(16, 65536);
    const sgs_scene other = {.view_count = 1, .views = &narrow, .extent = 1};
    assert_int_equal(bytes[1][1], estimate(&other, 0, 1000000));
    sgs_threads_set(0);
}

// A reserve of the whole limit refuses the first update that adds primitives, and changes nothing;
// without it the run is the one without a limit.
static void reserved_memory_counts_against_the_limit(void **state)
{
    (void)state;
    enum { STEPS = 100 };
    const size_t limit = 64 * GIB;
    sgs_scene *scene;
    char hex[3][17];
    sgs_train_options options = sgs_train_options_default();
    options.iterations = STEPS;
    assert_int_equal(room_load(16, &scene), 0);
    for (int k = 0; k < 2; ++k) { // bytes of the program, then of each primitive
        sgs_step_info info;
        sgs_trainer *trainer = trainer_create(scene, &options),
                    *unlimited = trainer_create(scene, &options);
        size_t count = 0;
        sgs_trainer_memory_limit_set(trainer, limit, 0);
        sgs_trainer_memory_reserve_set(trainer, k ? 0 : limit, k ? limit / 100 : 0);
        sgs_status status = SGS_STATUS_OK;
        int made = 0;
        for (; made < STEPS && !status; made += !status) {
            assert_false(sgs_trainer_update_refused(trainer));
            sgs_gaussians_hash(sgs_trainer_model(trainer), hex[0]);
            count = sgs_trainer_count(trainer);
            status = sgs_trainer_step(trainer, &info);
        }
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
        assert_true(sgs_trainer_update_refused(trainer) && sgs_trainer_is_consistent(trainer));
        assert_true(made > 0 && sgs_trainer_iteration(trainer) == made);
        assert_int_equal(sgs_trainer_count(trainer), count);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hex[1]);
        assert_string_equal(hex[0], hex[1]);
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OUT_OF_MEMORY); // again
        sgs_trainer_memory_reserve_set(trainer, 0, 0);
        trainer_run(trainer, 1);
        assert_false(sgs_trainer_update_refused(trainer));
        assert_true(sgs_trainer_count(trainer) > count);
        trainer_run(unlimited, made + 1);
        sgs_gaussians_hash(sgs_trainer_model(trainer), hex[1]);
        sgs_gaussians_hash(sgs_trainer_model(unlimited), hex[2]);
        assert_string_equal(hex[1], hex[2]);
        sgs_trainer_destroy(trainer);
        sgs_trainer_destroy(unlimited);
    }
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(photos_are_decoded_by_every_thread),
        cmocka_unit_test(decoding_adds_to_the_training_only_with_a_cache),
        cmocka_unit_test(estimates_saturate),
        cmocka_unit_test(the_scratch_of_the_evaluation_is_estimated),
        cmocka_unit_test(reserved_memory_counts_against_the_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
