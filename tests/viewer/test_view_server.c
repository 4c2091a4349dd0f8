// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Errors of the server: why a port cannot be opened, and, for the page that asks, why a photo is
// not shown.

#include <arpa/inet.h>
#include <errno.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>

#include "cli/progress.h"
#include "viewer/view_server.h"

// Without file descriptors no socket can be created.
static void a_port_that_cannot_be_opened_has_the_reason_of_the_system(void **state)
{
    (void)state;
    const view_address address = {.host = "127.0.0.1"};
    struct rlimit before, none;
    assert_true(view_address_is_free(&address));
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &before), 0);
    none = (struct rlimit){.rlim_cur = 0, .rlim_max = before.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    const bool is_free = view_address_is_free(&address);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &before), 0);
    assert_false(is_free);
    assert_non_null(strstr(last_error_text(), "port 0 of 127.0.0.1 cannot be opened: "));
    assert_non_null(strstr(last_error_text(), strerror(EMFILE)));
}

// The answer to a GET request.
static void get(int port, const char *path, char answer[4096])
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    const int fd = socket(AF_INET, SOCK_STREAM, 0);
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    assert_int_equal(connect(fd, (const struct sockaddr *)&to, sizeof to), 0);
    dprintf(fd, "GET %s HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", path);
    size_t size = 0;
    for (ssize_t count = 1; count > 0 && size < 4095; size += (size_t)count)
        count = read(fd, answer + size, 4095 - size);
    answer[size] = 0;
    close(fd);
}

static json_t *greeting(void *context)
{
    (void)context;
    return json_pack("{s:s}", "type", "hello");
}

static bool swallow(void *connection, bool binary, const void *bytes, size_t size)
{
    (void)binary;
    (void)bytes;
    (void)size;
    ++*(atomic_int *)connection;
    return true;
}

// The other pages are not told.
static void a_photo_that_exceeds_the_memory_says_so_to_its_page(void **state)
{
    (void)state;
    sgs_scene *scene;
    sgs_scene_options load = sgs_scene_options_default();
    load.downscale = 4;
    load.load_images = false;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &load, &scene), SGS_STATUS_OK);
    static const camera_list no_views;
    static const _Atomic double share = 1;
    view_source source = {.scene = scene, .photo_bytes = 3000000};
    view_hub hub;
    atomic_int received = 0;
    view_hub_open(&hub, &no_views);
    hub.greet = greeting;
    view_client *client = view_hub_join(&hub, swallow, &received, NULL);
    assert_non_null(client);
    scene->decode_bytes = 79000000;
    const view_server_options options = {
        .address = {.host = "127.0.0.1"}, .hub = &hub, .source = &source, .share = &share};
    view_server *server = view_server_start(&options);
    assert_non_null(server);
    char answer[4096];
    get(atoi(strrchr(view_server_url(server), ':') + 1), "/photo/0", answer);
    assert_int_equal(strncmp(answer, "HTTP/1.1 507 ", 13), 0);
    assert_non_null(strstr(answer, "the photo is not shown: it takes about 79 MB"));
    assert_non_null(strstr(answer, "more than the 3 MB that --max-memory of the training leaves"));
    pthread_mutex_lock(&hub.lock);
    assert_true(client->queued + received <= 1); // the greeting
    pthread_mutex_unlock(&hub.lock);
    view_hub_stop(&hub);
    view_server_stop(server);
    view_hub_leave(client);
    view_hub_close(&hub);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_port_that_cannot_be_opened_has_the_reason_of_the_system),
        cmocka_unit_test(a_photo_that_exceeds_the_memory_says_so_to_its_page),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
