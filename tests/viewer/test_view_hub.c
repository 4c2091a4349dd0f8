// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages of a page, in the order in which they arrive.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "viewer/view_hub.h"

static named_camera cameras[1] = {{.name = (char *)"a.png",
                                   .camera = {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}},
                                   .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}}}};
static const camera_list views = {.cameras = cameras, .count = 1};

static json_t *greeting(void *context)
{
    (void)context;
    return json_pack("{s:s}", "type", "hello");
}

static bool swallow(void *connection, bool binary, const void *bytes, size_t size)
{
    (void)connection;
    (void)binary;
    (void)bytes;
    (void)size;
    return true;
}

static void receive(view_client *client, const char *text)
{
    assert_true(view_hub_receive(client, text, strlen(text)));
}

// What a page asks for is answered for the camera that it showed then, however long it waits.
static void a_job_keeps_the_camera_before_it(void **state)
{
    (void)state;
    view_hub hub;
    view_hub_open(&hub, &views);
    hub.greet = greeting;
    view_client *client = view_hub_join(&hub, swallow, NULL, NULL);
    assert_non_null(client);
    receive(client, "{\"type\":\"exr\"}");
    assert_int_equal(client->jobs[0].request.camera.width, 0); // no camera yet
    receive(client, "{\"type\":\"camera\",\"serial\":1,\"width\":64,\"height\":48,\"view\":0}");
    receive(client, "{\"type\":\"ray\",\"x\":1,\"y\":2}");
    receive(client, "{\"type\":\"probe\",\"x\":1,\"y\":2}");
    receive(client, "{\"type\":\"camera\",\"serial\":2,\"width\":32,\"height\":24,\"view\":0}");
    receive(client, "{\"type\":\"exr\"}");
    assert_int_equal(client->job_count, 3);
    assert_int_equal(client->jobs[1].type, MESSAGE_RAY);
    assert_int_equal(client->jobs[1].request.serial, 1);
    assert_int_equal(client->jobs[1].request.camera.width, 64);
    assert_int_equal(client->jobs[2].request.serial, 1);
    // A second press of the button while the first one waits: one file, of the newer camera.
    assert_int_equal(client->jobs[0].type, MESSAGE_EXR);
    assert_int_equal(client->jobs[0].request.serial, 2);
    // A newer pixel takes the place of one that waits, with its own camera.
    receive(client, "{\"type\":\"probe\",\"x\":3,\"y\":4}");
    assert_int_equal(client->job_count, 3);
    assert_int_equal(client->jobs[2].x, 3);
    assert_int_equal(client->jobs[2].request.serial, 2);
    // The crop to save is that of the message, not of the last camera that was accepted.
    receive(client, "{\"type\":\"crop\",\"crop\":{\"opacity\":0.5}}");
    assert_int_equal(client->jobs[3].request.serial, 2);
    assert_true(client->jobs[3].request.crop.opacity == 0.5);
    // The page asks for the history again and again; one request waits.
    for (int k = 0; k < 2 * HUB_JOBS; ++k)
        receive(client, "{\"type\":\"history\"}");
    assert_int_equal(client->job_count, 5);
    // The primitives along a ray take long in a large model; only the last click counts.
    for (int k = 0; k < 2 * HUB_JOBS; ++k)
        receive(client, "{\"type\":\"ray\",\"x\":7,\"y\":8}");
    assert_int_equal(client->job_count, 5);
    assert_int_equal(client->jobs[1].type, MESSAGE_RAY);
    assert_int_equal(client->jobs[1].x, 7);
    assert_int_equal(client->jobs[1].request.serial, 2);
    for (int k = 0; k < 2 * HUB_JOBS; ++k)
        receive(client, "{\"type\":\"region\",\"number\":1}");
    assert_int_equal(client->job_count, HUB_JOBS);
    view_hub_stop(&hub);
    view_hub_leave(client);
    view_hub_close(&hub);
}

// Its memory limit has no room for the copy of the model that shows a crop, in pictures and values.
static void a_training_shows_no_crops(void **state)
{
    (void)state;
    for (int no_crop = 0; no_crop < 2; ++no_crop) {
        view_hub hub;
        view_hub_open(&hub, &views);
        hub.greet = greeting;
        hub.no_crop = no_crop;
        view_client *client = view_hub_join(&hub, swallow, NULL, NULL);
        assert_non_null(client);
        receive(client, "{\"type\":\"camera\",\"serial\":1,\"width\":64,\"height\":48,\"view\":0,"
                        "\"crop\":{\"preview\":\"hide\",\"opacity\":0.5}}");
        receive(client, "{\"type\":\"probe\",\"x\":1,\"y\":2}");
        const crop_show mode = no_crop ? CROP_OFF : CROP_HIDE;
        assert_int_equal(client->request.crop.preview, mode);
        assert_int_equal(client->jobs[0].request.crop.preview, mode);
        view_hub_stop(&hub);
        view_hub_leave(client);
        view_hub_close(&hub);
    }
}

// A page that is refused learns whether it is worth trying again later.
static void a_refused_page_learns_why(void **state)
{
    (void)state;
    view_hub hub;
    hub_refusal why;
    view_client *clients[HUB_CLIENTS];
    view_hub_open(&hub, &views);
    hub.greet = greeting;
    for (int i = 0; i < HUB_CLIENTS; ++i) {
        clients[i] = view_hub_join(&hub, swallow, NULL, &why);
        assert_non_null(clients[i]);
    }
    assert_null(view_hub_join(&hub, swallow, NULL, &why));
    assert_int_equal(why, HUB_FULL);
    view_hub_leave(clients[0]);
    clients[0] = view_hub_join(&hub, swallow, NULL, &why);
    assert_non_null(clients[0]);
    view_hub_stop(&hub);
    assert_null(view_hub_join(&hub, swallow, NULL, &why)); // with all places taken
    assert_int_equal(why, HUB_STOPPING);
    view_hub_leave(clients[0]);
    assert_null(view_hub_join(&hub, swallow, NULL, &why)); // with a free one
    assert_int_equal(why, HUB_STOPPING);
    for (int i = 1; i < HUB_CLIENTS; ++i)
        view_hub_leave(clients[i]);
    view_hub_close(&hub);
}

static char told[200]; // the last message but for the greeting

static bool remember(void *connection, bool binary, const void *bytes, size_t size)
{
    (void)connection;
    (void)binary;
    if (!memmem(bytes, size, "hello", 5))
        snprintf(told, sizeof told, "%.*s", (int)size, (const char *)bytes);
    return true;
}

static void a_camera_with_wrong_colours_is_drawn_and_reported(void **state)
{
    (void)state;
    view_hub hub;
    view_hub_open(&hub, &views);
    hub.greet = greeting;
    view_client *client = view_hub_join(&hub, remember, NULL, NULL);
    assert_non_null(client);
    receive(client, "{\"type\":\"camera\",\"serial\":5,\"width\":64,\"height\":48,\"view\":0,"
                    "\"aov\":\"depth\",\"range\":[0,5],\"log\":true}");
    assert_true(client->has_request);
    assert_int_equal(client->request.serial, 5);
    assert_int_equal(client->request.aov, AOV_INDEX_DEPTH);
    for (int k = 0, waiting = 1; k < 5000 && waiting; ++k) {
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
        pthread_mutex_lock(&hub.lock);
        waiting = client->queued;
        pthread_mutex_unlock(&hub.lock);
    }
    view_hub_stop(&hub);
    view_hub_leave(client);
    view_hub_close(&hub);
    assert_non_null(strstr(told, "a logarithmic range must be positive"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_job_keeps_the_camera_before_it),
        cmocka_unit_test(a_training_shows_no_crops), cmocka_unit_test(a_refused_page_learns_why),
        cmocka_unit_test(a_camera_with_wrong_colours_is_drawn_and_reported)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
