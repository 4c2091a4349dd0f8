// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Photos that wait for their turn when the viewer ends are not decoded.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include <cmocka.h>

#include "viewer/photo_queue.h"

enum { WAITING = 3 };

static sgs_scene *scene;
static const camera_list no_views;

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
    encoded_picture picture;
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
    photo_queue_open(&queue, &hub, &source);
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(photos_that_wait_are_not_decoded_at_the_end),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
