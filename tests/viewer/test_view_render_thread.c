// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The last picture of a view at rest is lossless once the model stops changing, also if a memory
// limit makes it smaller than requested. Pictures and files do not delay the end of a run,
// and long pictures no other page.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "support/files_support.h"
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
    double seconds;                       // that it took
    double arrived, gap;                  // its time, and since the picture before
    json_t *reply;                        // the last message but for the greeting; owned
    view_client *client;
} page;

static void take_reply(page *to, const void *bytes, size_t size)
{
    json_t *reply = json_loadb(bytes, size, 0, NULL);
    assert_non_null(reply);
    pthread_mutex_lock(&to->lock);
    if (strcmp(json_string_value(json_object_get(reply, "type")), "hello") != 0) {
        json_decref(to->reply);
        to->reply = json_incref(reply);
    }
    pthread_mutex_unlock(&to->lock);
    json_decref(reply);
}

static bool take(void *connection, bool binary, const void *bytes, size_t size)
{
    page *to = connection;
    const unsigned char *at = bytes;
    if (!binary) {
        take_reply(to, bytes, size);
        return true;
    }
    const size_t length = at[0] | (size_t)at[1] << 8;
    assert_true(length + 4 <= size);
    json_t *head = json_loadb((const char *)at + 4, length, 0, NULL);
    pthread_mutex_lock(&to->lock);
    assert_int_equal(json_unpack(head, "{s:i,s:i,s:b,s:f}", "width", &to->width, "height",
                                 &to->height, "lossless", &to->lossless, "seconds", &to->seconds),
                     0);
    to->gap = clock_seconds() - to->arrived;
    to->arrived += to->gap;
    to->limited = json_is_true(json_object_get(head, "limited"));
    char text[80];
    snprintf(text, sizeof text, "{\"type\":\"ack\",\"number\":%d}",
             (int)json_integer_value(json_object_get(head, "frame")));
    pthread_mutex_unlock(&to->lock);
    json_decref(head);
    return view_hub_receive(to->client, text, strlen(text));
}

static void pause_ms(int ms)
{
    nanosleep(&(struct timespec){.tv_nsec = ms * 1000000L}, NULL);
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
        pause_ms(10);
    }
    fail_msg("no picture of width %d that is %s; last: %d", width, lossless ? "lossless" : "lossy",
             from->width);
}

// Waits for a message of this type; release it with json_decref.
static json_t *expect_reply(page *from, const char *type)
{
    for (int k = 0; k < 1000; ++k) {
        pthread_mutex_lock(&from->lock);
        json_t *reply = from->reply;
        from->reply = NULL;
        pthread_mutex_unlock(&from->lock);
        if (reply && !strcmp(json_string_value(json_object_get(reply, "type")), type))
            return reply;
        json_decref(reply);
        pause_ms(10);
    }
    fail_msg("no message '%s'", type);
    return NULL;
}

static void say(page *from, const char *text)
{
    assert_true(view_hub_receive(from->client, text, strlen(text)));
}

// ---- A viewer with one page ----

typedef struct stage {
    oracle_scene scene;
    temp_folder folder;
    view_source source;
    view_hub hub;
    view_render_thread render;
    page shown;
} stage;

// The render thread does not run yet.
static void stage_open(stage *s, double share, size_t picture_bytes)
{
    *s = (stage){.scene = oracle_random_model(5, 40, NULL), .folder = temp_folder_make()};
    s->source = (view_source){.name = "model",
                              .drawing = {.compact_box = 1, .white_point = 1},
                              .picture_bytes = picture_bytes};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(s->scene.count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_copy(model, s->scene.model), SGS_STATUS_OK);
    assert_true(view_source_open(&s->source, model, NULL, 10));
    s->source.folder = strdup(s->folder.path);
    view_hub_open(&s->hub, &views);
    s->hub.greet = greeting;
    s->render = (view_render_thread){.hub = &s->hub, .source = &s->source, .is_live = true};
    atomic_store(&s->render.share, share);
    pthread_mutex_init(&s->shown.lock, NULL);
    s->shown.client = view_hub_join(&s->hub, take, &s->shown, NULL);
    assert_non_null(s->shown.client);
}

static void stage_start(stage *s)
{
    assert_true(view_render_thread_start(&s->render));
}

// Ends what is being drawn.
static void stage_stop(stage *s)
{
    view_hub_stop(&s->hub);
    view_render_thread_join(&s->render);
}

static void stage_close(stage *s)
{
    if (s->shown.client)
        view_hub_leave(s->shown.client);
    view_hub_close(&s->hub);
    view_source_close(&s->source);
    oracle_scene_free(&s->scene);
    temp_folder_remove(&s->folder);
    json_decref(s->shown.reply);
}

// Until the thread has begun to draw or to answer.
static void await_work(stage *s)
{
    while (!pthread_mutex_trylock(&s->source.lock)) {
        pthread_mutex_unlock(&s->source.lock);
        nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
    }
}

#define CAMERA "{\"type\":\"camera\",\"serial\":1,\"view\":0,"

// A training run with a viewer, whose model then stays as it is: a pause, or the end.
static void look(size_t picture_bytes, int width, bool limited)
{
    stage s;
    stage_open(&s, 0.9, picture_bytes);
    say(&s.shown, CAMERA "\"width\":160,\"height\":120}");
    stage_start(&s);
    expect(&s.shown, width, false, limited);
    pause_ms(300); // nothing is left to draw
    atomic_store(&s.render.share, 1);
    view_hub_wake(&s.hub);
    expect(&s.shown, width, true, limited);
    stage_stop(&s);
    stage_close(&s);
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

// ---- The end of a run ----

enum { END_STOP, END_LAST, END_LEAVE, ENDS };

// The program ends, the last model of the training follows, or the page leaves, while a file of
// more than a million pixels is rendered: it is given up at once.
static void a_file_does_not_delay_the_end_of_a_run(void **state)
{
    (void)state;
    for (int end = END_STOP; end < ENDS; ++end) {
        stage s;
        stage_open(&s, 1, 0);
        say(&s.shown, CAMERA "\"width\":1600,\"height\":1200}");
        say(&s.shown, "{\"type\":\"exr\"}");
        stage_start(&s);
        await_work(&s);
        if (end == END_LAST) {
            view_source_expect_last(&s.source);
            json_t *reply = expect_reply(&s.shown, "error");
            assert_non_null(strstr(json_string_value(json_object_get(reply, "text")),
                                   "was not written because training has ended"));
            json_decref(reply);
            assert_true(view_source_replace(&s.source, s.scene.model, NULL, 11));
        } else if (end == END_LEAVE) {
            view_hub_leave(s.shown.client);
            s.shown.client = NULL;
            pthread_mutex_lock(&s.source.lock); // the thread has finished
            pthread_mutex_unlock(&s.source.lock);
        }
        stage_stop(&s);
        assert_true(access(temp_path(&s.folder, "view_0001.exr"), F_OK));
        stage_close(&s);
    }
}

// While the results are saved, nothing is drawn.
static void nothing_is_drawn_before_the_last_model(void **state)
{
    (void)state;
    stage s;
    stage_open(&s, 1, 0);
    view_source_expect_last(&s.source);
    say(&s.shown, CAMERA "\"width\":160,\"height\":120}");
    say(&s.shown, "{\"type\":\"exr\"}");
    stage_start(&s);
    pause_ms(300);
    pthread_mutex_lock(&s.hub.lock);
    assert_int_equal(s.shown.client->job_count, 1);
    assert_int_equal(s.shown.client->frame, 0);
    pthread_mutex_unlock(&s.hub.lock);
    assert_true(view_source_replace(&s.source, s.scene.model, NULL, 11));
    view_hub_wake(&s.hub);
    json_decref(expect_reply(&s.shown, "saved"));
    expect(&s.shown, WIDTH, true, false);
    stage_stop(&s);
    stage_close(&s);
}

static void a_moving_picture_does_not_delay_the_end(void **state)
{
    (void)state;
    stage s;
    stage_open(&s, 1, 0);
    say(&s.shown, CAMERA "\"width\":4000,\"height\":3000,\"moving\":true}");
    stage_start(&s);
    await_work(&s);
    stage_stop(&s);
    assert_int_equal(s.shown.client->frame, 0);
    stage_close(&s);
}

// ---- Regions ----

// The model of iteration 10 is older than the last update, whose grid numbers regions differently.
static void a_region_is_numbered_by_the_grid_of_the_shown_model(void **state)
{
    (void)state;
    const sgs_region early[] = {{.voxel = 7, .count = 3}}, // centre (5, 5, 5)
        late[] = {{.voxel = 7, .count = 1}, {.voxel = 63, .count = 2}};
    const sgs_regions updates[] = {{.iteration = 5,
                                    .grid = 2,
                                    .low = {-10, -10, -10},
                                    .voxel_size = {10, 10, 10},
                                    .count = 1,
                                    .regions = early},
                                   {.iteration = 20,
                                    .grid = 4,
                                    .low = {-10, -10, -10},
                                    .voxel_size = {5, 5, 5},
                                    .count = 2,
                                    .regions = late}};
    stage s;
    stage_open(&s, 1, 0);
    s.source.is_run = true;
    for (int u = 0; u < 2; ++u)
        view_source_add_regions(&s.source, &updates[u]);
    say(&s.shown, "{\"type\":\"region\",\"number\":7}");
    stage_start(&s);
    json_t *reply = expect_reply(&s.shown, "region"), *found[2];
    int voxels[2], iterations[2];
    assert_int_equal(json_unpack(reply, "{s:[o,o!]}", "updates", &found[0], &found[1]), 0);
    for (int u = 0; u < 2; ++u)
        assert_int_equal(
            json_unpack(found[u], "{s:i,s:i}", "voxel", &voxels[u], "iteration", &iterations[u]),
            0);
    assert_int_equal(iterations[0], 5);
    assert_int_equal(voxels[0], 7);
    assert_int_equal(iterations[1], 20);
    assert_int_equal(voxels[1], 63);
    json_decref(reply);
    stage_stop(&s);
    stage_close(&s);
}

// ---- Waiting for others ----

// A picture of many samples takes seconds; neither clicks nor another page wait for its end.
static void a_long_picture_gives_way(void **state)
{
    (void)state;
    for (int moves = 0; moves < 2; ++moves) {
        stage s;
        page other = {.lock = PTHREAD_MUTEX_INITIALIZER};
        stage_open(&s, 1, 0);
        other.client = view_hub_join(&s.hub, take, &other, NULL);
        assert_non_null(other.client);
        say(&s.shown, CAMERA "\"width\":1600,\"height\":1200,\"samples\":64}");
        stage_start(&s);
        expect(&s.shown, 800, false, false); // then the one with samples
        if (moves) {
            say(&other, CAMERA "\"width\":64,\"height\":48,\"moving\":true}");
            expect(&other, 32, false, false);
        } else {
            say(&s.shown, "{\"type\":\"ray\",\"x\":1,\"y\":1}");
            json_decref(expect_reply(&s.shown, "ray"));
        }
        pthread_mutex_lock(&s.shown.lock);
        assert_int_equal(s.shown.width, 800);
        pthread_mutex_unlock(&s.shown.lock);
        stage_stop(&s);
        view_hub_leave(other.client);
        stage_close(&s);
    }
}

// The status line shows the cost of a picture, without the sleep that leaves the cores to the
// training.
static void the_seconds_of_a_picture_are_those_of_its_work(void **state)
{
    (void)state;
    stage s;
    stage_open(&s, 0.1, 0);
    say(&s.shown, CAMERA "\"width\":800,\"height\":600}");
    stage_start(&s);
    expect(&s.shown, 800, false, false);
    pthread_mutex_lock(&s.shown.lock);
    if (!(s.shown.seconds > 0 && s.shown.seconds < 0.4 * s.shown.gap))
        fail_msg("%g of %g seconds are reported as work", s.shown.seconds, s.shown.gap);
    pthread_mutex_unlock(&s.shown.lock);
    stage_stop(&s);
    stage_close(&s);
}

// ---- Errors ----

json_t *__real_ray_inspect(view_source *source, const view_request *request, int x, int y);
json_t *__wrap_ray_inspect(view_source *source, const view_request *request, int x, int y);
static bool no_memory;

json_t *__wrap_ray_inspect(view_source *source, const view_request *request, int x, int y)
{
    return no_memory ? NULL : __real_ray_inspect(source, request, x, y);
}

static void expect_error(stage *s, const char *text)
{
    json_t *reply = expect_reply(&s->shown, "error");
    assert_string_equal(json_string_value(json_object_get(reply, "text")), text);
    json_decref(reply);
}

static void a_request_without_an_answer_names_the_reason(void **state)
{
    (void)state;
    stage s;
    stage_open(&s, 1, 0);
    stage_start(&s);
    say(&s.shown, "{\"type\":\"exr\"}");
    expect_error(&s, "the page has not sent a camera yet");
    say(&s.shown, CAMERA "\"width\":64,\"height\":48}");
    say(&s.shown, "{\"type\":\"ray\",\"x\":64,\"y\":1}");
    expect_error(&s, "the pixel is outside of the view");
    say(&s.shown, "{\"type\":\"probe\",\"x\":1,\"y\":48}");
    expect_error(&s, "the pixel is outside of the view");
    no_memory = true;
    say(&s.shown, "{\"type\":\"ray\",\"x\":1,\"y\":1}");
    expect_error(&s, "not enough memory to answer the request");
    no_memory = false;
    stage_stop(&s);
    stage_close(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_picture_of_a_pause_is_lossless),
        cmocka_unit_test(so_is_the_largest_one_that_the_memory_permits),
        cmocka_unit_test(a_file_does_not_delay_the_end_of_a_run),
        cmocka_unit_test(nothing_is_drawn_before_the_last_model),
        cmocka_unit_test(a_moving_picture_does_not_delay_the_end),
        cmocka_unit_test(a_region_is_numbered_by_the_grid_of_the_shown_model),
        cmocka_unit_test(a_long_picture_gives_way),
        cmocka_unit_test(the_seconds_of_a_picture_are_those_of_its_work),
        cmocka_unit_test(a_request_without_an_answer_names_the_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
