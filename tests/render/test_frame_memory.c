// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Frames and rays beyond the memory of the machine are refused before they are allocated: the
// system would grant them and end the process later.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmocka.h>

#include "rays/rays.h"
#include "sparegs/gaussians.h"
#include "sparegs/render.h"
#include "sparegs/runtime.h"
#include "support/bad_input.h"
#include "support/skip_support.h"

enum { WIDTH = 65536 };

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) // they reserve address space
static rlim_t address_space(void)
{
    unsigned long long pages = 0;
    FILE *stream = fopen("/proc/self/statm", "r");
    assert_non_null(stream);
    assert_int_equal(fscanf(stream, "%llu", &pages), 1);
    fclose(stream);
    return pages * (rlim_t)sysconf(_SC_PAGESIZE);
}
#endif

static struct rlimit unlimited;

// Permits 1 GiB more of address space. Without the checks, allocations then fail, with other
// messages, instead of taking the memory of the machine.
static void limit_memory(void)
{
    assert_int_equal(getrlimit(RLIMIT_AS, &unlimited), 0);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    struct rlimit limited = unlimited;
    limited.rlim_cur = address_space() + ((rlim_t)1 << 30);
    assert_int_equal(setrlimit(RLIMIT_AS, &limited), 0);
#endif
}

// Height of an image of this width whose pixels have the memory of the machine if each takes this.
static int filling_height(double bytes_per_pixel)
{
    const double machine = (double)sgs_machine_memory();
    const double height = machine / bytes_per_pixel / WIDTH;
    if (!(height <= WIDTH)) // the limit of a camera
        skip_because("the memory of the machine is unknown, or holds the largest image");
    return (int)height;
}

// 16 bytes of planes per pixel, 12 for its direction and more than 8 for its ray (u and v).
static void frames_include_their_rays(void **state)
{
    (void)state;
    sgs_frame frame;
    const int height = filling_height(24); // the planes alone have two thirds of the memory
    limit_memory();
    const sgs_status status = sgs_frame_create_with(WIDTH, height, 0, &frame);
    assert_int_equal(setrlimit(RLIMIT_AS, &unlimited), 0);
    assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    assert_null(frame.color[0]);
    assert_non_null(strstr(sgs_last_error(), "requires more than"));
    assert_non_null(strstr(sgs_last_error(), "use a smaller size"));
    bad_input();
    const int few = filling_height(64);
    assert_true(sgs_frame_memory(WIDTH, few, 0, 1) < sgs_machine_memory());
    assert_true(sgs_frame_memory(WIDTH, few, 0, 4) > sgs_machine_memory());
}

static void rays_are_refused_before_they_are_allocated(void **state)
{
    (void)state;
    const int height = filling_height(15);
    const sgs_camera camera = {
        SGS_CAMERA_PINHOLE, WIDTH, height, {WIDTH, WIDTH, WIDTH / 2.0, height / 2.0}};
    limit_memory();
    sgsi_rays *rays;
    const sgs_status status = sgsi_rays_create(&camera, 4, &rays);
    assert_int_equal(setrlimit(RLIMIT_AS, &unlimited), 0);
    assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    assert_null(rays);
    assert_non_null(strstr(sgs_last_error(), "but the machine has"));
    bad_input();
}

// The resident memory of a rendering without primitives. 3 channels of normals and one of
// transmittance are added to the colours.
static void the_estimate_is_that_of_a_rendering(void **state)
{
    (void)state;
    enum { SIDE = 1600 };
    assert_int_equal(sgs_frame_memory(0, 5, 0, 1), 0);
    assert_true(sgs_frame_memory(INT32_MAX, INT32_MAX, SGS_AOVS_ALL, 9) == UINT64_MAX);
    const double bytes = (double)sgs_frame_memory(SIDE, SIDE, SGS_AOV_NORMAL, 1),
                 pixels = SIDE * SIDE;
    const uint64_t two = sgs_frame_memory(SIDE, SIDE, SGS_AOV_NORMAL, 2);
    assert_true((double)two - bytes == pixels * 4 * (3 + 1 + 3));
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    skip_because("sanitizers use memory of their own");
#endif
    const sgs_camera camera = {
        SGS_CAMERA_PINHOLE, SIDE, SIDE, {SIDE, SIDE, SIDE / 2.0, SIDE / 2.0}};
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    const sgs_render_options options = sgs_render_options_default();
    sgs_gaussians *model;
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(sgs_gaussians_create(16, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    sgs_threads_set(1); // stacks and scratch grow with the threads
    const double before = (double)sgs_rss_current();
    assert_int_equal(sgs_frame_create_with(SIDE, SIDE, SGS_AOV_NORMAL, &frame), SGS_STATUS_OK);
    for (int c = 0; c < 3; ++c) // pages are resident once they are written
        memset(frame.normal[c], 1, (size_t)pixels * sizeof *frame.normal[c]);
    assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, &options, &frame),
                     SGS_STATUS_OK);
    const double used = (double)sgs_rss_peak() - before;
    if (!(bytes >= 0.9 * used && bytes <= 1.1 * used))
        fail_msg("%.1f MiB are estimated, %.1f MiB used", bytes / 0x1p20, used / 0x1p20);
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);
    sgs_threads_set(0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_estimate_is_that_of_a_rendering),
        cmocka_unit_test(frames_include_their_rays),
        cmocka_unit_test(rays_are_refused_before_they_are_allocated),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
