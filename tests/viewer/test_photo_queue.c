// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Photos that wait for their turn when the viewer ends are not decoded. Thumbnails are decoded
// once. Beside a training, photos wait so that decoding has its share of the time.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <time.h>

#include <cmocka.h>

#include "cli/progress.h"
#include "viewer/photo_queue.h"

enum { WAITING = 3 };

static sgs_scene *scene;
static const camera_list no_views;
static _Atomic double whole = 1;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 4;
    options.load_images = false;
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

typedef struct visitor {
    photo_queue *queue;
    photo_answer answer;
} visitor;

static void *visit(void *argument)
{
    visitor *own = argument;
    encoded_picture picture = {0};
    own->answer = photo_queue_get(own->queue, 0, PHOTO_WHOLE, &picture);
    encoded_picture_free(&picture);
    return NULL;
}

static void photos_that_wait_are_not_decoded_at_the_end(void **state)
{
    (void)state;
    view_hub hub;
    view_source source = {.scene = scene, .drawing = {.white_point = 1}};
    photo_queue queue;
    visitor all[WAITING + 1];
    pthread_t threads[WAITING];
    view_hub_open(&hub, &no_views);
    photo_queue_open(&queue, &hub, &source, &whole);
    all[WAITING] = (visitor){&queue, PHOTO_STOPPED};
    visit(&all[WAITING]);
    assert_int_equal(all[WAITING].answer, PHOTO_MADE);
    pthread_mutex_lock(&queue.turn); // another photo is decoded
    for (int k = 0; k < WAITING; ++k) {
        all[k] = (visitor){&queue, PHOTO_MADE};
        assert_int_equal(pthread_create(&threads[k], NULL, visit, &all[k]), 0);
    }
    nanosleep(&(struct timespec){.tv_nsec = 200000000}, NULL); // they wait
    view_hub_stop(&hub);
    pthread_mutex_unlock(&queue.turn);
    for (int k = 0; k < WAITING; ++k) {
        pthread_join(threads[k], NULL);
        assert_int_equal(all[k].answer, PHOTO_STOPPED);
    }
    photo_queue_close(&queue);
    view_hub_close(&hub);
}

static photo_answer get(photo_queue *queue, size_t index, photo_use use)
{
    encoded_picture picture = {0};
    const photo_answer answer = photo_queue_get(queue, index, use, &picture);
    assert_true((answer == PHOTO_MADE) == (picture.size > 0));
    encoded_picture_free(&picture);
    return answer;
}

// The file of a thumbnail is read once; a page that opens again gets the same bytes.
static void thumbnails_are_kept_within_a_limit(void **state)
{
    (void)state;
    view_hub hub;
    view_source source = {.scene = scene, .drawing = {.white_point = 1}};
    photo_queue queue;
    encoded_picture first = {0}, again = {0};
    view_hub_open(&hub, &no_views);
    photo_queue_open(&queue, &hub, &source, &whole);
    assert_int_equal(photo_queue_get(&queue, 0, PHOTO_THUMBNAIL, &first), PHOTO_MADE);
    char *path = scene->views[0].image_path;
    scene->views[0].image_path = (char *)"moved away";
    assert_int_equal(photo_queue_get(&queue, 0, PHOTO_THUMBNAIL, &again), PHOTO_MADE);
    assert_int_equal(get(&queue, 0, PHOTO_WHOLE), PHOTO_UNREADABLE);
    scene->views[0].image_path = path;
    assert_int_equal(first.size, again.size);
    assert_memory_equal(first.bytes, again.bytes, first.size);
    assert_int_equal(queue.thumbnail_bytes, first.size);
    queue.thumbnail_bytes = THUMBNAIL_BYTES; // full
    assert_int_equal(get(&queue, 1, PHOTO_THUMBNAIL), PHOTO_MADE);
    assert_int_equal(queue.thumbnail_bytes, THUMBNAIL_BYTES);
    assert_int_equal(queue.thumbnails[1].size, 0);
    encoded_picture_free(&first);
    encoded_picture_free(&again);
    photo_queue_close(&queue);
    view_hub_close(&hub);
}

static void photos_wait_for_their_share(void **state)
{
    (void)state;
    static _Atomic double share = 0.02;
    view_hub hub;
    view_source source = {.scene = scene, .drawing = {.white_point = 1}};
    photo_queue queue;
    view_hub_open(&hub, &no_views);
    photo_queue_open(&queue, &hub, &source, &share);
    assert_int_equal(get(&queue, 0, PHOTO_WHOLE), PHOTO_MADE);
    const double seconds = atomic_load(&source.photo_seconds), start = clock_seconds();
    assert_true(seconds > 0);
    assert_int_equal(get(&queue, 1, PHOTO_WHOLE), PHOTO_MADE);
    assert_true(clock_seconds() - start >= fmin(0.9 * 49 * seconds, 9));
    photo_queue_close(&queue);
    view_hub_close(&hub);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(photos_that_wait_are_not_decoded_at_the_end),
        cmocka_unit_test(thumbnails_are_kept_within_a_limit),
        cmocka_unit_test(photos_wait_for_their_share),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
