// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The limit on photos that are decoded at the same time: it is kept and reached, one photo is
// always decoded, and loading a scene obeys it.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <stdatomic.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/threads.h"
#include "image/decode_limit.h"
#include "image/photo.h"
#include "support/scene_support.h"
#include "sparegs/runtime.h"

typedef struct crowd {
    sgsi_decode_limit *limit;
    size_t bytes;
    int expected; // number that is awaited, for at most two seconds
    atomic_int inside, most;
} crowd;

static void enter(void *context, size_t item, int thread)
{
    (void)item;
    (void)thread;
    crowd *c = context;
    sgsi_decode_begin(c->limit, c->bytes);
    const int now = atomic_fetch_add(&c->inside, 1) + 1;
    int most = atomic_load(&c->most);
    while (now > most && !atomic_compare_exchange_weak(&c->most, &most, now))
        ;
    for (int k = 0; k < 2000 && atomic_load(&c->most) < c->expected; ++k)
        usleep(1000);
    usleep(500);
    atomic_fetch_sub(&c->inside, 1);
    sgsi_decode_end(c->limit, c->bytes);
}

static void as_many_are_admitted_as_fit(void **state)
{
    (void)state;
    // Bytes of each; how many of eight threads are inside at the same time; peak of the bytes.
    static const size_t rows[][3] = {
        {10, 2, 20}, {25, 1, 25}, {26, 1, 26}, {SIZE_MAX, 1, SIZE_MAX}, {5, 5, 25}};
    sgsi_threads_set(8);
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k) {
        crowd c = {.limit = sgsi_decode_limit_create(25),
                   .bytes = rows[k][0],
                   .expected = (int)rows[k][1]};
        sgsi_parallel_for(64, 1, enter, &c);
        assert_int_equal(atomic_load(&c.inside), 0);
        assert_int_equal(atomic_load(&c.most), rows[k][1]);
        assert_int_equal(sgsi_decode_limit_peak(c.limit), rows[k][2]);
        sgsi_decode_limit_destroy(c.limit);
    }
    crowd open = {.bytes = 10}; // no limit
    sgsi_parallel_for(64, 1, enter, &open);
    assert_int_equal(atomic_load(&open.inside), 0);
    sgsi_decode_limit_destroy(NULL);
    sgsi_threads_set(0);
}

// A photo is counted while it is decoded, also if that fails.
static void loading_a_photo_uses_the_limit(void **state)
{
    (void)state;
    sgsi_decode_limit *limit = sgsi_decode_limit_create(100);
    sgsi_photo_source source = {.image_path = SGSI_TEST_DATA "/room/images/0001.jpg",
                                .width = 120,
                                .height = 67,
                                .white_point = 1,
                                .decode_limit = limit,
                                .decode_bytes = 60};
    sgs_photo photo;
    sgsi_photo_report report;
    assert_int_equal(sgsi_photo_load(&source, &photo, &report), SGS_STATUS_OK);
    sgsi_photo_free(&photo);
    assert_int_equal(sgsi_decode_limit_peak(limit), 60);
    source.image_path = SGSI_TEST_DATA "/room/images/none.jpg";
    assert_int_equal(sgsi_photo_load(&source, &photo, &report), SGS_STATUS_IO);
    sgsi_decode_begin(limit, 100); // returns: both loads have ended
    sgsi_decode_end(limit, 100);
    assert_int_equal(sgsi_decode_limit_peak(limit), 100);
    sgsi_decode_limit_destroy(limit);
}

// 480 x 270 pixels, three channels: 3.5 bytes per pixel, known before the photos are loaded. The
// photos are the same if only one is decoded at a time.
static void a_scene_knows_its_limit(void **state)
{
    (void)state;
    sgs_scene *scenes[2];
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    for (int k = 0; k < 2; ++k) {
        options.decode_memory = k ? 1 : 0;
        for (int images = 0; images < 2; ++images) {
            options.load_images = images;
            assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scenes[k]),
                             SGS_STATUS_OK);
            assert_int_equal(scenes[k]->decode_bytes, 480 * 270 * 7 / 2);
            assert_true(scenes[k]->decode_limit == (k ? 1 : sgs_machine_memory() / 8));
            if (!images)
                sgs_scene_destroy(scenes[k]);
        }
    }
    for (size_t i = 0; i < scenes[0]->view_count; ++i)
        assert_memory_equal(scenes[0]->views[i].image.pixels, scenes[1]->views[i].image.pixels,
                            3 * 60 * 33);
    sgs_scene_destroy(scenes[0]);
    sgs_scene_destroy(scenes[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(as_many_are_admitted_as_fit),
        cmocka_unit_test(loading_a_photo_uses_the_limit),
        cmocka_unit_test(a_scene_knows_its_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
