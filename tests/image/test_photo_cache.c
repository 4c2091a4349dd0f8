// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The image cache: same photos and same model as without a limit, the limit is kept, photos are
// decoded as seldom as the order of their use allows and by several threads, and files that
// disappear are reported.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <unistd.h>

#include <cmocka.h>

#include "scene/scene_store.h"
#include "support/rest.h"
#include "support/scene_support.h"
#include "support/task_support.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "train/trainer_state.h"

static sgs_scene *load_split_room(size_t limit, int test_every)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    options.test_every = test_every;
    options.image_cache = limit;
    sgs_scene *scene;
    if (sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

static sgs_scene *load_room(size_t limit)
{
    return load_split_room(limit, 0);
}

static sgsi_photo_cache_counts counts_of(const sgs_scene *scene)
{
    return sgsi_photo_cache_count(sgsi_scene_store_cache(scene->store));
}

// The limit of a cache for `share` of the photos of the room.
static size_t share_of_room(double share)
{
    sgs_scene *scene = load_room(0);
    const size_t bytes = (size_t)((double)scene->photo_bytes * share);
    sgs_scene_destroy(scene);
    return bytes;
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
    const size_t peak = counts_of(some).peak;
    print_message("%zu bytes in all, at most %zu held\n", bytes_of(all), peak);
    assert_true(peak <= bytes_of(all) / 4 && peak > bytes_of(all) / 8);
    sgs_scene_destroy(all);
    sgs_scene_destroy(some);
}

// Limit below the size of one photo: all can still be read, with or without prefetch.
// A handler of the program runs on a thread of the program, also if that blocks the signal later.
static void the_decoding_thread_blocks_signals(void **state)
{
    (void)state;
    // Libraries of OpenImageIO have threads of their own.
    const int before = task_count(0), usr1 = task_count(SIGUSR1), fault = task_count(SIGSEGV);
    sgs_threads_set(1);
    sgs_scene *scene = load_room(100000);
    sgs_threads_set(0);
    assert_non_null(scene->store);
    assert_int_equal(task_count(0), before + 1);
    rest(0.1); // a new thread blocks all signals until it has its mask
    assert_int_equal(task_count(SIGUSR1), usr1 + 1);
    assert_int_equal(task_count(SIGSEGV), fault);
    sgs_scene_destroy(scene);
    assert_int_equal(task_count(0), before);
}

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
    assert_true(counts_of(none).peak < bytes_of(all) / 5);
    sgs_scene_destroy(all);
    sgs_scene_destroy(none);
}

// Fetches the training views in a random order, or in theirs.
static void pass_over(const sgs_scene *scene, uint64_t epoch, bool shuffled)
{
    const sgs_photo *photo;
    size_t order[64];
    size_t n = 0;
    for (size_t v = 0; v < scene->view_count; ++v)
        if (scene->views[v].split == SGS_SPLIT_TRAIN)
            order[n++] = v;
    for (size_t i = n; shuffled && i-- > 1;) {
        const size_t k = (size_t)(sgsi_random_bits(epoch, i) % (i + 1)), kept = order[i];
        order[i] = order[k];
        order[k] = kept;
    }
    for (size_t i = 0; i < n; ++i)
        assert_int_equal(sgs_scene_photo(scene, order[i], &photo), SGS_STATUS_OK);
}

// A simulation of 300 views gives 0.50 and 0.10 decodes per view for a cache of 50 % and 90 % of
// the photos, in random and in fixed order. If the least recently used photo were evicted: 0.85 and
// 0.33 in random order, 1 in fixed order.
static void few_photos_are_decoded_in_each_pass(void **state)
{
    (void)state;
    static const struct {
        double share;
        bool shuffled;
        double low, high;
    } cases[] = {{0.5, true, 0.46, 0.58},
                 {0.9, true, 0.07, 0.16},
                 {0.5, false, 0.46, 0.56},
                 {0.9, false, 0.07, 0.16}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_scene *scene = load_room(share_of_room(cases[k].share));
        const size_t n = scene->view_count, epochs = 12;
        pass_over(scene, 100, cases[k].shuffled);
        const size_t before = counts_of(scene).decodes;
        for (size_t epoch = 0; epoch < epochs; ++epoch)
            pass_over(scene, epoch, cases[k].shuffled);
        const double mean = (double)(counts_of(scene).decodes - before) / (double)(n * epochs);
        print_message("cache of %.1f, %s order: %.3f decodes per view\n", cases[k].share,
                      cases[k].shuffled ? "random" : "fixed", mean);
        assert_true(mean >= cases[k].low && mean <= cases[k].high);
        sgs_scene_destroy(scene);
    }
}

static void training_rarely_redecodes_photos(void **state)
{
    (void)state;
    sgs_scene *scene = load_room(share_of_room(0.5));
    sgs_train_options options = sgs_train_options_default();
    sgs_trainer *trainer;
    sgs_step_info info = {0};
    options.iterations = 5 * (int)scene->view_count;
    options.max_gaussians = 500;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    const double mean = (double)counts_of(scene).decodes / options.iterations;
    print_message("%.3f decodes per iteration\n", mean);
    assert_true(mean <= 0.6);
    sgs_scene_destroy(scene);
}

// Half of the views are held out; the photos of the others fit.
static void photos_that_are_not_used_any_more_are_evicted(void **state)
{
    (void)state;
    sgs_scene *scene = load_split_room(share_of_room(0.55), 2);
    for (uint64_t epoch = 0; epoch < 6; ++epoch)
        pass_over(scene, epoch, true);
    const size_t decodes = counts_of(scene).decodes;
    for (uint64_t epoch = 6; epoch < 9; ++epoch)
        pass_over(scene, epoch, true);
    assert_int_equal(counts_of(scene).decodes, decodes);
    sgs_scene_destroy(scene);
}

static void the_first_photos_stay_after_loading(void **state)
{
    (void)state;
    const size_t limit = share_of_room(0.5);
    sgs_scene *scene = load_room(limit);
    const sgs_photo *photo;
    const size_t n = scene->view_count, kept = n * limit / scene->photo_bytes;
    assert_true(counts_of(scene).peak <= limit && counts_of(scene).peak > limit * 9 / 10);
    for (size_t v = 0; v < n; ++v) {
        assert_null(scene->views[v].image.pixels); // the cache has them
        assert_true(scene->views[v].image.kept > 0);
    }
    for (size_t v = 0; v < kept; ++v)
        assert_int_equal(sgs_scene_photo(scene, v, &photo), SGS_STATUS_OK);
    assert_int_equal(counts_of(scene).decodes, 0);
    assert_int_equal(sgs_scene_photo(scene, kept, &photo), SGS_STATUS_OK);
    assert_int_equal(counts_of(scene).decodes, 1);
    sgs_scene_destroy(scene);
}

enum { SIDE = 16, COUNT = 8 };

static void fill_sources(const temp_folder *folder, sgsi_decode_limit *limit,
                         sgsi_photo_source sources[COUNT], size_t bytes[COUNT])
{
    static const uint8_t grey[3] = {90, 100, 110};
    for (int i = 0; i < COUNT; ++i) {
        char name[16];
        snprintf(name, sizeof name, "%d.png", i);
        tree_put_picture(folder, name, SIDE, SIDE, 3, grey);
        bytes[i] = 3 * SIDE * SIDE;
        sources[i] = (sgsi_photo_source){.image_path = temp_path(folder, name),
                                         .file_width = SIDE,
                                         .file_height = SIDE,
                                         .width = SIDE,
                                         .height = SIDE,
                                         .white_point = 1,
                                         .decode_limit = limit,
                                         .decode_bytes = 1};
    }
}

// Waits up to ten seconds until `decoding` photos are decoded at the same time.
static bool decodes_together(sgsi_photo_cache *cache, size_t decoding)
{
    for (int k = 0; k < 1000; ++k) {
        if (sgsi_photo_cache_count(cache).decoding == decoding)
            return true;
        usleep(10000);
    }
    return false;
}

// The test holds the decode limit, so that decoding cannot end.
static void several_threads_decode(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_decode_limit *limit = sgsi_decode_limit_create(4);
    sgsi_photo_source sources[COUNT];
    size_t bytes[COUNT];
    fill_sources(&folder, limit, sources, bytes);
    for (int decoders = 1; decoders <= 4; decoders += 3) {
        // The last time, there is space for three photos only.
        for (int narrow = 0; narrow < 2; ++narrow) {
            sgsi_photo_cache *cache;
            const sgs_photo *photo;
            const size_t most = narrow && decoders > 3 ? 3 : (size_t)decoders;
            assert_int_equal(sgsi_photo_cache_create(sources, bytes, COUNT,
                                                     (narrow ? 3 : COUNT) * bytes[0], decoders,
                                                     &cache),
                             SGS_STATUS_OK);
            assert_int_equal(sgsi_photo_cache_ahead(cache), decoders + 1);
            sgsi_decode_begin(limit, 4);
            for (size_t i = 0; i < COUNT; ++i)
                sgsi_photo_cache_prefetch(cache, i);
            assert_true(decodes_together(cache, most));
            sgsi_decode_end(limit, 4);
            for (size_t i = 0; i < COUNT; ++i) {
                assert_int_equal(sgsi_photo_cache_get(cache, i, &photo), SGS_STATUS_OK);
                assert_int_equal(photo->width, SIDE);
            }
            const sgsi_photo_cache_counts counts = sgsi_photo_cache_count(cache);
            assert_true(counts.peak <= (narrow ? 3 : COUNT) * bytes[0]);
            if (!narrow)
                assert_int_equal(counts.decodes, COUNT); // none twice
            sgsi_photo_cache_destroy(cache);
        }
    }
    sgsi_decode_limit_destroy(limit);
    tree_remove(&folder);
}

static void the_number_of_decoding_threads_follows_that_of_threads(void **state)
{
    (void)state;
    static const int rows[][2] = {{1, 1},  {2, 1},  {4, 2},    {16, 2},
                                  {24, 3}, {64, 8}, {128, 16}, {4096, 16}};
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k)
        assert_int_equal(sgsi_photo_decoders(rows[k][0]), rows[k][1]);
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
    model_put_pictures(&folder, "images", &m, (picture){64, 48, 3, grey});
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
        cmocka_unit_test(the_decoding_thread_blocks_signals),
        cmocka_unit_test(cache_smaller_than_one_photo_works),
        cmocka_unit_test(few_photos_are_decoded_in_each_pass),
        cmocka_unit_test(training_rarely_redecodes_photos),
        cmocka_unit_test(photos_that_are_not_used_any_more_are_evicted),
        cmocka_unit_test(the_first_photos_stay_after_loading),
        cmocka_unit_test(several_threads_decode),
        cmocka_unit_test(the_number_of_decoding_threads_follows_that_of_threads),
        cmocka_unit_test(the_model_does_not_depend_on_the_cache),
        cmocka_unit_test_setup(deleted_photo_is_an_error, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
