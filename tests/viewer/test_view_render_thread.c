// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The last picture of a view at rest is lossless once the model stops changing, also if a memory
// limit makes it smaller than requested.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "support/oracle_support.h"
#include "cli/progress.h"
#include "viewer/view_render_thread.h"

enum { WIDTH = 160, HEIGHT = 120 };

static named_camera cameras[1] = {
    {.name = (char *)"a.png",
     .camera = {SGS_CAMERA_PINHOLE, WIDTH, HEIGHT, {150, 150, WIDTH / 2, HEIGHT / 2}},
     .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 4}}}};
static const camera_list views = {.cameras = cameras, .count = 1};

static json_t *greeting(void *context)
{
    (void)context;
    return json_pack("{s:s}", "type", "hello");
}

// What the page has received.
typedef struct page {
    pthread_mutex_t lock;
    int width, height, lossless, limited; // of the last picture
    view_client *client;
} page;

static bool take(void *connection, bool binary, const void *bytes, size_t size)
{
    page *to = connection;
    const unsigned char *at = bytes;
    if (!binary)
        return true;
    const size_t length = at[0] | (size_t)at[1] << 8;
    assert_true(length + 4 <= size);
    json_t *head = json_loadb((const char *)at + 4, length, 0, NULL);
    pthread_mutex_lock(&to->lock);
    assert_int_equal(json_unpack(head, "{s:i,s:i,s:b}", "width", &to->width, "height", &to->height,
                                 "lossless", &to->lossless),
                     0);
    to->limited = json_is_true(json_object_get(head, "limited"));
    char text[80];
    snprintf(text, sizeof text, "{\"type\":\"ack\",\"number\":%d}",
             (int)json_integer_value(json_object_get(head, "frame")));
    pthread_mutex_unlock(&to->lock);
    json_decref(head);
    return view_hub_receive(to->client, text, strlen(text));
}

// Waits for a picture of this width, with or without loss.
static void expect(page *from, int width, bool lossless, bool limited)
{
    for (int k = 0; k < 1000; ++k) {
        pthread_mutex_lock(&from->lock);
        const bool found = from->width == width && from->lossless == lossless;
        const int found_limited = from->limited;
        pthread_mutex_unlock(&from->lock);
        if (found) {
            assert_int_equal(found_limited, limited);
            return;
        }
        nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
    }
    fail_msg("no picture of width %d that is %s; last: %d", width, lossless ? "lossless" : "lossy",
             from->width);
}

// A training run with a viewer, whose model then stays as it is: a pause, or the end.
static void look(size_t picture_bytes, int width, bool limited)
{
    static const char camera[] = "{\"type\":\"camera\",\"serial\":1,\"width\":160,\"height\":120,"
                                 "\"view\":0}";
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model",
                          .drawing = {.compact_box = 1, .white_point = 1},
                          .picture_bytes = picture_bytes};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_copy(model, scene.model), SGS_STATUS_OK);
    assert_true(view_source_open(&source, model, NULL, 0));
    view_hub hub;
    view_hub_open(&hub, &views);
    hub.greet = greeting;
    view_render_thread render = {.hub = &hub, .source = &source, .is_live = true};
    atomic_store(&render.share, 0.9);
    page shown = {.lock = PTHREAD_MUTEX_INITIALIZER};
    shown.client = view_hub_join(&hub, take, &shown);
    assert_non_null(shown.client);
    assert_true(view_hub_receive(shown.client, camera, sizeof camera - 1));
    assert_true(view_render_thread_start(&render));
    expect(&shown, width, false, limited);
    nanosleep(&(struct timespec){.tv_nsec = 300000000}, NULL); // nothing is left to draw
    atomic_store(&render.share, 1);
    view_hub_wake(&hub);
    expect(&shown, width, true, limited);
    view_hub_stop(&hub);
    view_render_thread_join(&render);
    view_hub_leave(shown.client);
    view_hub_close(&hub);
    view_source_close(&source);
    oracle_scene_free(&scene);
}

static void the_picture_of_a_pause_is_lossless(void **state)
{
    (void)state;
    look(0, WIDTH, false);
}

// A quarter of the pixels: half the width.
static void so_is_the_largest_one_that_the_memory_permits(void **state)
{
    (void)state;
    look((size_t)WIDTH / 2 * (HEIGHT / 2) * PICTURE_PIXEL_BYTES, WIDTH / 2, true);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_picture_of_a_pause_is_lossless),
        cmocka_unit_test(so_is_the_largest_one_that_the_memory_permits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
