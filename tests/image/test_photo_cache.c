// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The image cache: same photos and same model as without a limit, the limit is kept, and files
// that disappear are reported.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "scene/scene_store.h"
#include "support/scene_support.h"
#include "sparegs/trainer.h"
#include "train/trainer_state.h"

static sgs_scene *load_room(size_t limit)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    options.image_cache = limit;
    sgs_scene *scene;
    if (sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

static size_t bytes_of(const sgs_scene *scene)
{
    size_t bytes = 0;
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_photo *photo = &scene->views[v].image;
        bytes += (size_t)photo->height *
                 (3 * (size_t)photo->width + 2 * (((size_t)photo->width + 15) / 16));
    }
    return bytes;
}

static void assert_same_photo(const sgs_photo *a, const sgs_photo *b)
{
    assert_true(a->width == b->width && a->height == b->height && a->channels == b->channels &&
                a->kept == b->kept);
    assert_memory_equal(a->pixels, b->pixels,
                        (size_t)a->width * (size_t)a->height * (size_t)a->channels);
}

static void cache_of_a_quarter_returns_the_same_photos(void **state)
{
    (void)state;
    sgs_scene *all = load_room(0), *some = load_room(bytes_of(all) / 4);
    assert_null(all->store);
    assert_non_null(some->store);
    for (uint64_t k = 0; k < 300; ++k) {
        const size_t v = (size_t)(sgsi_random_bits(1, k) % all->view_count);
        const sgs_photo *a, *b;
        // A third of the accesses have no prefetch.
        for (uint64_t ahead = 1; ahead < 4 && k % 3; ++ahead)
            sgs_scene_prefetch(some, (size_t)(sgsi_random_bits(1, k + ahead) % all->view_count));
        assert_int_equal(sgs_scene_photo(all, v, &a), SGS_STATUS_OK);
        assert_int_equal(sgs_scene_photo(some, v, &b), SGS_STATUS_OK);
        assert_same_photo(a, b);
    }
    const size_t peak = sgsi_photo_cache_peak(sgsi_scene_store_cache(some->store));
    print_message("%zu bytes in all, at most %zu held\n", bytes_of(all), peak);
    assert_true(peak <= bytes_of(all) / 4 && peak > bytes_of(all) / 8);
    sgs_scene_destroy(all);
    sgs_scene_destroy(some);
}

// Limit below the size of one photo: all can still be read, with or without prefetch.
static void cache_smaller_than_one_photo_works(void **state)
{
    (void)state;
    sgs_scene *all = load_room(0), *none = load_room(1);
    for (size_t v = 0; v < all->view_count; ++v) {
        const sgs_photo *a, *b;
        sgs_scene_prefetch(none, (v + 1) % all->view_count);
        sgs_scene_prefetch(none, (v + 2) % all->view_count);
        assert_int_equal(sgs_scene_photo(all, v, &a), SGS_STATUS_OK);
        assert_int_equal(sgs_scene_photo(none, v, &b), SGS_STATUS_OK);
        assert_same_photo(a, b);
    }
    assert_true(sgsi_photo_cache_peak(sgsi_scene_store_cache(none->store)) < bytes_of(all) / 5);
    sgs_scene_destroy(all);
    sgs_scene_destroy(none);
}

static void trained_hash(const sgs_scene *scene, sgs_pipeline pipeline, char hex[17])
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 90;
    options.pipeline = pipeline;
    sgs_trainer *trainer;
    sgs_step_info info = {0};
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
    const sgsi_small_images *images = &trainer->views.small_images;
    assert_int_equal(images->count, pipeline != SGS_PIPELINE_DASH ? 0
                                    : scene->store                ? 1
                                                                  : scene->view_count);
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    sgs_gaussians_hash(sgs_trainer_model(trainer), hex);
    sgs_trainer_destroy(trainer);
}

// Nor with DashGaussian, which begins with reduced photos.
static void the_model_does_not_depend_on_the_cache(void **state)
{
    (void)state;
    char hashes[2][2][17];
    for (int k = 0; k < 2; ++k) {
        sgs_scene *scene = load_room(k ? 60000 : 0);
        assert_int_equal(scene->store != NULL, k);
        trained_hash(scene, SGS_PIPELINE_3DGS, hashes[0][k]);
        trained_hash(scene, SGS_PIPELINE_DASH, hashes[1][k]);
        sgs_scene_destroy(scene);
    }
    assert_string_equal(hashes[0][0], hashes[0][1]);
    assert_string_equal(hashes[1][0], hashes[1][1]);
}

static void deleted_photo_is_an_error(void **state)
{
    (void)state;
    static const uint8_t grey[3] = {90, 100, 110};
    const temp_folder folder = temp_folder_make();
    const model m = model_make();
    model_put(&folder, "sparse/0/", &m, true);
    for (int i = 0; i < m.image_count; ++i) {
        char name[64];
        snprintf(name, sizeof name, "images/%s", m.images[i].name);
        tree_put_picture(&folder, name, 64, 48, 3, grey);
    }
    sgs_scene_options options = sgs_scene_options_default();
    options.image_cache = 100;
    sgs_scene *scene;
    const sgs_photo *photo;
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
    assert_int_equal(remove(temp_path(&folder, "images/b.png")), 0);
    sgs_scene_prefetch(scene, 1);
    for (int k = 0; k < 3; ++k) {
        assert_int_equal(sgs_scene_photo(scene, 0, &photo), SGS_STATUS_OK);
        assert_int_equal(sgs_scene_photo(scene, 1, &photo), SGS_STATUS_IO);
        assert_null(photo);
        assert_holds(sgs_last_error(), "images/b.png: no such file");
    }
    tree_put_picture(&folder, "images/b.png", 64, 48, 3, grey); // the file is restored
    assert_int_equal(sgs_scene_photo(scene, 1, &photo), SGS_STATUS_OK);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cache_of_a_quarter_returns_the_same_photos),
        cmocka_unit_test(cache_smaller_than_one_photo_works),
        cmocka_unit_test(the_model_does_not_depend_on_the_cache),
        cmocka_unit_test_setup(deleted_photo_is_an_error, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
