// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Deep samples: equal to the oracle's hits without merging; composited, equal to the flat image
// with any merging; and deep EXR files as read by another program.

#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/files_support.h"
#include "support/fragile_support.h"
#include "support/oracle_support.h"
#include "sparegs/image.h"
#include "sparegs/runtime.h"

// Three bands of macrotiles and a partial one.
enum { WIDTH = 61, HEIGHT = 83, PIXELS = WIDTH * HEIGHT };

// All outputs of a deep render.
typedef struct deep_picture {
    sgs_frame frame;
    uint32_t counts[PIXELS];
    size_t first[PIXELS + 1];
    sgs_deep_sample *samples;
    int next_row;
} deep_picture;

static sgs_deep_options deep_options(double tolerance, int max_samples)
{
    sgs_deep_options options = sgs_deep_options_default();
    options.tolerance = tolerance;
    options.max_samples = max_samples;
    return options;
}

static sgs_status take_rows(void *context, int y, int rows, const uint32_t *counts,
                            const sgs_deep_sample *samples)
{
    deep_picture *picture = context;
    assert_int_equal(y, picture->next_row);
    assert_true(rows > 0 && y + rows <= HEIGHT);
    picture->next_row = y + rows;
    for (size_t i = (size_t)y * WIDTH; i < (size_t)(y + rows) * WIDTH; ++i) {
        picture->counts[i] = counts[i - (size_t)y * WIDTH];
        picture->first[i + 1] = picture->first[i] + picture->counts[i];
    }
    const size_t begin = picture->first[y * WIDTH], end = picture->first[(y + rows) * WIDTH];
    picture->samples = realloc(picture->samples, (end + 1) * sizeof *samples);
    assert_non_null(picture->samples);
    memcpy(picture->samples + begin, samples, (end - begin) * sizeof *samples);
    return SGS_STATUS_OK;
}

static deep_picture *picture_create(const sgs_gaussians *model, const sgs_camera *camera,
                                    const sgs_pose *pose, const sgs_render_options *options,
                                    const sgs_deep_options *deep)
{
    deep_picture *picture = oracle_memory(1, sizeof *picture);
    sgs_renderer *renderer;
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(WIDTH, HEIGHT, &picture->frame), SGS_STATUS_OK);
    if (sgs_renderer_render_deep(renderer, camera, pose, options, deep, &picture->frame, take_rows,
                                 picture))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(picture->next_row, HEIGHT);
    sgs_renderer_destroy(renderer);
    return picture;
}

static void picture_free(deep_picture *picture)
{
    sgs_frame_free(&picture->frame);
    free(picture->samples);
    free(picture);
}

static const sgs_pose *view_pose(void)
{
    static sgs_pose pose;
    pose = oracle_pose_look_at(1.2, -0.7, -3.6);
    return &pose;
}

static sgs_camera view_camera(sgs_camera_model model)
{
    return oracle_camera(model, WIDTH, HEIGHT);
}

// Composites each pixel's samples with `over` and compares with the flat planes; checks order,
// overlap and first distance. Returns the largest error.
static double check_pixel(const deep_picture *picture, size_t i, const sgs_deep_options *deep)
{
    double through = 1, color[3] = {0, 0, 0}, worst = 0, behind = 0;
    assert_true(picture->counts[i] <= (uint32_t)deep->max_samples);
    for (size_t k = picture->first[i]; k < picture->first[i + 1]; ++k) {
        const sgs_deep_sample *s = &picture->samples[k];
        assert_true(s->z > behind && s->z_back >= s->z && s->alpha > 0 && s->alpha <= 1);
        behind = s->z_back;
        for (int c = 0; c < 3; ++c) {
            assert_true(s->color[c] >= 0);
            color[c] += through * s->color[c];
        }
        through *= 1 - s->alpha;
    }
    for (int c = 0; c < 3; ++c)
        worst = fmax(worst, fabs(color[c] - picture->frame.color[c][i]));
    worst = fmax(worst, fabs(through - picture->frame.transmittance[i]));
    const float first = picture->counts[i] ? picture->samples[picture->first[i]].z : 0;
    assert_true(first == picture->frame.depth_first[i]);
    assert_int_equal(picture->counts[i] > 0, picture->frame.hits[i] > 0);
    return worst;
}

static void flattened_samples_equal_the_flat_image(void **state)
{
    (void)state;
    const sgs_deep_options choices[] = {deep_options(0, 256),  deep_options(0.01, 32),
                                        deep_options(0.05, 8), deep_options(0, 3),
                                        deep_options(1, 1),    deep_options(0, 1)};
    const sgs_render_options options = sgs_render_options_default();
    oracle_scene scenes[2] = {oracle_random_model(3, 600, NULL),
                              oracle_adversarial_model(ORACLE_DUPLICATES, 11, 400)};
    for (int n = 0; n < 2; ++n) {
        const sgs_camera camera = view_camera(SGS_CAMERA_OPENCV);
        for (size_t k = 0; k < sizeof choices / sizeof *choices; ++k) {
            deep_picture *picture =
                picture_create(scenes[n].model, &camera, view_pose(), &options, &choices[k]);
            double worst = 0;
            for (size_t i = 0; i < PIXELS; ++i)
                worst = fmax(worst, check_pixel(picture, i, &choices[k]));
            print_message("tolerance %g, at most %d: %zu samples, worst %.2g\n",
                          choices[k].tolerance, choices[k].max_samples, picture->first[PIXELS],
                          worst);
            assert_true(worst <= 1e-5);
            picture_free(picture);
        }
        oracle_scene_free(&scenes[n]);
    }
}

static void samples_equal_the_hits_of_the_oracle(void **state)
{
    (void)state;
    const sgs_deep_options deep = deep_options(0, 256);
    size_t compared = 0;
    oracle_scene scene = oracle_random_model(8, 200, NULL);
    for (int run = 0; run < 4; ++run) {
        sgs_camera camera = view_camera(run % 2 ? SGS_CAMERA_OPENCV_FISHEYE : SGS_CAMERA_PINHOLE);
        sgs_render_options options = sgs_render_options_default();
        options.axis_depth = run >= 2;
        if (options.axis_depth && run % 2) // less than 90 degrees to each side
            camera.params[0] = camera.params[1] = WIDTH;
        deep_picture *picture = picture_create(scene.model, &camera, view_pose(), &options, &deep);
        sgsi_reference_view view;
        assert_int_equal(sgsi_reference_view_create(scene.params, scene.count, &camera, view_pose(),
                                                    &options, &view),
                         SGS_STATUS_OK);
        sgs_hit *hits = oracle_memory(scene.count, sizeof *hits);
        for (int i = 0; i < PIXELS; ++i) {
            double direction[3];
            assert_true(sgsi_reference_ray(&view, i % WIDTH, i / WIDTH, direction));
            const pixel_truth truth = judge(&view, direction, hits);
            if (truth.fragile)
                continue;
            assert_int_equal(picture->counts[i], truth.count);
            const double *axis = view.pose->rotation + 6;
            const double unit =
                options.axis_depth
                    ? axis[0] * direction[0] + axis[1] * direction[1] + axis[2] * direction[2]
                    : 1;
            for (size_t k = 0; k < truth.count; ++k) {
                const sgs_deep_sample *s = &picture->samples[picture->first[i] + k];
                assert_true(fabs(s->z - unit * hits[k].t) <= 2e-5 * hits[k].t && s->z_back == s->z);
                assert_true(fabs(s->alpha - hits[k].alpha) <= 1e-5);
                for (int c = 0; c < 3; ++c)
                    assert_true(fabs(s->color[c] -
                                     hits[k].alpha * view.primitives[hits[k].primitive].color[c]) <=
                                2e-5);
                ++compared;
            }
        }
        free(hits);
        sgsi_reference_view_free(&view);
        picture_free(picture);
    }
    oracle_scene_free(&scene);
    assert_true(compared > 50000);
}

static void hits_merge_only_within_the_tolerance(void **state)
{
    (void)state;
    const sgs_deep_options fine = deep_options(0, 256), coarse = deep_options(0.03, 256);
    const sgs_render_options options = sgs_render_options_default();
    const sgs_camera camera = view_camera(SGS_CAMERA_PINHOLE);
    oracle_scene scene = oracle_random_model(8, 300, NULL);
    deep_picture *all = picture_create(scene.model, &camera, view_pose(), &options, &fine);
    deep_picture *some = picture_create(scene.model, &camera, view_pose(), &options, &coarse);
    for (size_t i = 0; i < PIXELS; ++i) {
        size_t k = all->first[i];
        for (size_t j = some->first[i]; j < some->first[i + 1]; ++j) {
            const sgs_deep_sample *s = &some->samples[j];
            assert_true(s->z_back <= s->z * (1.03 + 1e-6));
            assert_true(s->z == all->samples[k].z);
            while (k < all->first[i + 1] && all->samples[k].z <= s->z_back)
                ++k; // hits in this sample
            // Samples are not smaller than the tolerance permits.
            assert_true(k == all->first[i + 1] || all->samples[k].z >= s->z * (1.03 - 1e-6));
        }
        assert_true(k == all->first[i + 1]);
    }
    assert_true(some->first[PIXELS] * 2 < all->first[PIXELS]);
    picture_free(all);
    picture_free(some);
    oracle_scene_free(&scene);
}

static void bits_do_not_depend_on_threads_or_samples(void **state)
{
    (void)state;
    const sgs_deep_options deep = sgs_deep_options_default();
    const sgs_render_options options = sgs_render_options_default();
    const sgs_camera camera = view_camera(SGS_CAMERA_OPENCV);
    oracle_scene scene = oracle_random_model(21, 500, NULL);
    sgs_threads_set(1);
    deep_picture *one = picture_create(scene.model, &camera, view_pose(), &options, &deep);
    sgs_threads_set(3);
    deep_picture *three = picture_create(scene.model, &camera, view_pose(), &options, &deep);
    sgs_threads_set(0);
    assert_memory_equal(one->counts, three->counts, sizeof one->counts);
    assert_memory_equal(one->samples, three->samples, one->first[PIXELS] * sizeof *one->samples);
    sgs_renderer *renderer;
    sgs_frame flat;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(WIDTH, HEIGHT, &flat), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(renderer, &camera, view_pose(), &options, &flat),
                     SGS_STATUS_OK);
    for (int c = 0; c < 3; ++c)
        assert_memory_equal(flat.color[c], one->frame.color[c], PIXELS * sizeof(float));
    assert_memory_equal(flat.depth_median, one->frame.depth_median, PIXELS * sizeof(float));
    sgs_frame_free(&flat);
    sgs_renderer_destroy(renderer);
    picture_free(one);
    picture_free(three);
    oracle_scene_free(&scene);
}

static sgs_status refuse_rows(void *context, int y, int rows, const uint32_t *counts,
                              const sgs_deep_sample *samples)
{
    (void)rows, (void)counts, (void)samples;
    *(int *)context += 1;
    return y ? SGS_STATUS_INTERNAL : SGS_STATUS_IO;
}

static void callback_failure_stops_the_render(void **state)
{
    (void)state;
    const sgs_deep_options deep = sgs_deep_options_default(),
                           bad[] = {deep_options(-1, 4), deep_options(2, 4), deep_options(NAN, 4),
                                    deep_options(0, 0), deep_options(0, 257)};
    const sgs_render_options options = sgs_render_options_default();
    const sgs_camera camera = view_camera(SGS_CAMERA_PINHOLE);
    oracle_scene scene = oracle_random_model(2, 20, NULL);
    sgs_renderer *renderer;
    sgs_frame frame;
    int calls = 0;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(WIDTH, HEIGHT, &frame), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render_deep(renderer, &camera, view_pose(), &options, &deep,
                                              &frame, refuse_rows, &calls),
                     SGS_STATUS_IO);
    assert_int_equal(calls, 1);
    for (size_t k = 0; k < sizeof bad / sizeof *bad; ++k)
        assert_int_equal(sgs_renderer_render_deep(renderer, &camera, view_pose(), &options, &bad[k],
                                                  &frame, refuse_rows, &calls),
                         SGS_STATUS_INVALID_ARGUMENT);
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    oracle_scene_free(&scene);
}

// ---- Files ----

enum { SMALL_WIDTH = 5, SMALL_HEIGHT = 40, MOST = 32 };

// Random samples, some pixels empty, with values that print exactly in decimal.
static size_t random_samples(uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT], sgs_deep_sample *samples)
{
    oracle_random random = {.seed = 4};
    size_t total = 0;
    for (size_t i = 0; i < SMALL_WIDTH * SMALL_HEIGHT; ++i) {
        counts[i] = (uint32_t)oracle_uniform(&random, 0, 7);
        for (uint32_t k = 0; k < counts[i]; ++k) {
            const float z = (float)k + 1 + 0.25f * (float)(i % 3);
            samples[total++] = (sgs_deep_sample){
                z, z + 0.125f, (float)(k + 1) / 64, {0.5f, (float)(i % 16) / 16, 0.25f}};
        }
    }
    return total;
}

static sgs_status write_file(const char *path, sgs_exr_compression compression,
                             const uint32_t *counts, const sgs_deep_sample *samples)
{
    const sgs_exr_info info = {.width = SMALL_WIDTH,
                               .height = SMALL_HEIGHT,
                               .view_name = "deep",
                               .compression = compression};
    sgs_exr_deep *deep;
    sgs_status status = sgs_exr_deep_open(path, &info, 7, &deep);
    if (status)
        return status;
    static const int bands[] = {1, 0, 3, 36}; // rows per call
    for (size_t k = 0; k < sizeof bands / sizeof *bands && !status; ++k) {
        status = sgs_exr_deep_write(deep, bands[k], counts, samples);
        for (int i = 0; i < bands[k] * SMALL_WIDTH; ++i)
            samples += *counts++;
    }
    if (!status)
        return sgs_exr_deep_close(deep);
    sgs_exr_deep_abort(deep);
    return status;
}

static void deep_files_are_readable_by_another_program(void **state)
{
    (void)state;
    static uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT];
    static sgs_deep_sample samples[7 * SMALL_WIDTH * SMALL_HEIGHT];
    static char output[1 << 20];
    random_samples(counts, samples);
    const temp_folder folder = temp_folder_make();
    for (int run = 0; run < 2; ++run) {
        const char *path = temp_path(&folder, "deep.exr");
        if (write_file(path, run ? SGS_EXR_NONE : SGS_EXR_ZIP, counts, samples))
            fail_msg("%s", sgs_last_error());
        const char *const dump[] = {"oiiotool", "--info", "-v", "--dumpdata", path, NULL};
        const int status = run_program(dump, output, sizeof output);
        assert_int_equal(status, 0);
        assert_non_null(strstr(output, run ? "compression: \"none\"" : "compression: \"zips\""));
        assert_non_null(strstr(output, "deep float"));
        size_t k = 0;
        for (int i = 0; i < SMALL_WIDTH * SMALL_HEIGHT; ++i) {
            char expected[1024];
            int length = snprintf(expected, sizeof expected, "Pixel (%d, %d): %u samples",
                                  i % SMALL_WIDTH, i / SMALL_WIDTH, counts[i]);
            for (uint32_t j = 0; j < counts[i]; ++j, ++k)
                length += snprintf(expected + length, sizeof expected - (size_t)length,
                                   "%s R=%g G=%g B=%g A=%g Z=%g ZBack=%g", j ? " / " : " :",
                                   samples[k].color[0], samples[k].color[1], samples[k].color[2],
                                   samples[k].alpha, samples[k].z, samples[k].z_back);
            if (!strstr(output, expected))
                fail_msg("oiiotool does not say '%s' but:\n%.2000s", expected, output);
        }
    }
    temp_folder_remove(&folder);
}

// ---- Half floats ----

// A deep file with half floats.
static void write_halves(const char *path, int width, int height, const uint32_t *counts,
                         const sgs_deep_sample *samples)
{
    const sgs_exr_info info = {.width = width, .height = height, .deep_half = true};
    sgs_exr_deep *deep;
    if (sgs_exr_deep_open(path, &info, MOST, &deep) ||
        sgs_exr_deep_write(deep, height, counts, samples) || sgs_exr_deep_close(deep))
        fail_msg("%s", sgs_last_error());
}

static void write_flat(const char *path, float planes[4][PIXELS], bool half)
{
    const sgs_exr_info info = {.width = WIDTH, .height = HEIGHT};
    const sgs_exr_channel channels[4] = {{.name = "R", .floats = planes[0], .half = half},
                                         {.name = "G", .floats = planes[1], .half = half},
                                         {.name = "B", .floats = planes[2], .half = half},
                                         {.name = "A", .floats = planes[3], .half = half}};
    if (sgs_exr_write(path, &info, channels, 4))
        fail_msg("%s", sgs_last_error());
}

// True if no channel of the flattened file differs by more than `most` from the flat one, according
// to oiiotool.
static bool flattens_to(const char *deep, const char *flat, const char *names, double most)
{
    static char output[1 << 14];
    char limit[40];
    snprintf(limit, sizeof limit, "%.9g", most);
    const char *const compare[] = {"oiiotool", "--fail", limit,  deep,  "--flatten", "--ch",
                                   names,      flat,     "--ch", names, "--diff",    NULL};
    const int status = run_program(compare, output, sizeof output);
    if (!strstr(output, "Computing diff") || !status != !strstr(output, "FAILURE"))
        fail_msg("oiiotool ends with %d: %s", status, output);
    return !status;
}

// Flattened, a single sample has its own values. OpenEXR itself has rounded those of the flat file.
static void half_samples_round_as_openexr_does(void **state)
{
    (void)state;
    static float planes[4][PIXELS];
    static sgs_deep_sample samples[PIXELS];
    static uint32_t counts[PIXELS];
    oracle_random random = {.seed = 12};
    for (size_t i = 0; i < PIXELS; ++i) {
        for (int c = 0; c < 4; ++c) {
            const int power =
                (int)floor(oracle_uniform(&random, c < 3 ? -28 : -24, c < 3 ? 18 : 0));
            samples[i].color[0] = (float)ldexp(oracle_uniform(&random, 1, 2), power);
            if (i % 5 == 0) // a tie, for normal numbers
                samples[i].color[0] =
                    (float)ldexp(1024.5 + floor(oracle_uniform(&random, 0, 1023)), power - 10);
            planes[c][i] = fminf(samples[i].color[0], 65504); // as in flat files of `render`
            if (c < 3 && i % 3 == 0)
                planes[c][i] = -planes[c][i];
        }
        samples[i] = (sgs_deep_sample){.z = 1, .z_back = 1, .alpha = planes[3][i]};
        for (int c = 0; c < 3; ++c) // 65504 stands for all that is larger
            samples[i].color[c] =
                planes[c][i] * (fabsf(planes[c][i]) < 65504 ? 1 : 1 + (float)(i % 7));
        counts[i] = 1;
    }
    const temp_folder folder = temp_folder_make();
    char deep[300], flat[300];
    snprintf(deep, sizeof deep, "%s", temp_path(&folder, "deep.exr"));
    snprintf(flat, sizeof flat, "%s", temp_path(&folder, "flat.exr"));
    write_halves(deep, WIDTH, HEIGHT, counts, samples);
    write_flat(flat, planes, true);
    assert_true(flattens_to(deep, flat, "R,G,B,A", 0));
    write_flat(flat, planes, false);
    assert_false(flattens_to(deep, flat, "R,G,B,A", 0));
    temp_folder_remove(&folder);
}

// The bound that the header states. Every second pixel attains it nearly: its alphas are all
// rounded down and its colours up, by half a unit.
static void flattened_half_samples_are_near_the_exact_ones(void **state)
{
    (void)state;
    const double brightest = 8;
    static float planes[4][PIXELS];
    static sgs_deep_sample samples[MOST * PIXELS];
    static uint32_t counts[PIXELS];
    oracle_random random = {.seed = 7};
    size_t total = 0;
    for (size_t i = 0; i < PIXELS; ++i) {
        double through = 1, color[3] = {0};
        counts[i] = i % 2 ? MOST : (uint32_t)oracle_uniform(&random, 1, MOST + 1);
        for (uint32_t k = 0; k < counts[i]; ++k) {
            const float z = (float)k + 1;
            sgs_deep_sample *s = &samples[total++];
            *s = (sgs_deep_sample){.z = z, .z_back = z};
            s->alpha = i % 2   ? 0.125f * (1 + 0.99f * 0x1p-11f)
                       : k % 5 ? (float)exp2(oracle_uniform(&random, -12, 0))
                               : 1 - (float)exp2(oracle_uniform(&random, -14, 0));
            for (int c = 0; c < 3; ++c) {
                s->color[c] = i % 2 ? 1 + 1.01f * 0x1p-11f
                                    : s->alpha * (float)oracle_uniform(&random, 0, brightest);
                color[c] += through * (double)s->color[c];
            }
            through *= 1 - (double)s->alpha;
        }
        for (int c = 0; c < 3; ++c)
            planes[c][i] = (float)color[c];
        planes[3][i] = (float)(1 - through);
    }
    const temp_folder folder = temp_folder_make();
    char deep[300], flat[300];
    snprintf(deep, sizeof deep, "%s", temp_path(&folder, "deep.exr"));
    snprintf(flat, sizeof flat, "%s", temp_path(&folder, "flat.exr"));
    write_halves(deep, WIDTH, HEIGHT, counts, samples);
    write_flat(flat, planes, false);
    assert_true(flattens_to(deep, flat, "R,G,B", 0x1p-10 * brightest + 1e-5));
    assert_false(flattens_to(deep, flat, "R,G,B", 0.8 * 0x1p-10 * brightest));
    assert_true(flattens_to(deep, flat, "A", 0x1p-11));
    assert_false(flattens_to(deep, flat, "A", 0.2 * 0x1p-11));
    temp_folder_remove(&folder);
}

static void half_samples_keep_depth_and_alpha(void **state)
{
    (void)state;
    enum { CASES = 6, VALUES = 6 };
    static const sgs_deep_sample samples[CASES] = {
        {4097.5f, 4098.25f, 0.5f, {1e6f, INFINITY, -1e6f}},
        {2, 2, 1e-9f, {1e-9f, 1e-8f, 1e-7f}},
        {3, 3, 0x1p-25f, {0x1p-25f, 0.5f, 0}},
        {4, 4, 1e-40f, {0.25f, 0, 0}},
        {5, 5, 0, {0.5f, 0, 0}}, // light alone, as given
        {6, 6, 0.9999f, {0.9999f, 0, 0}},
    };
    static const double expected[CASES][VALUES] = {// R G B A Z ZBack
                                                   {65504, 65504, -65504, 0.5, 4097.5, 4098.25},
                                                   {0, 0, 0x1p-23, 0x1p-24, 2, 2},
                                                   {0, 0.5, 0, 0x1p-24, 3, 3},
                                                   {0.25, 0, 0, 0x1p-24, 4, 4},
                                                   {0.5, 0, 0, 0, 5, 5},
                                                   {1, 0, 0, 1, 6, 6}};
    static const uint32_t counts[CASES] = {1, 1, 1, 1, 1, 1};
    static char output[1 << 14];
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "deep.exr");
    write_halves(path, CASES, 1, counts, samples);
    const char *const dump[] = {"oiiotool", "--info", "-v", "--dumpdata", path, NULL};
    assert_int_equal(run_program(dump, output, sizeof output), 0);
    assert_non_null(
        strstr(output, "R (half), G (half), B (half), A (half), Z (float), ZBack (float)"));
    for (int k = 0; k < CASES; ++k) {
        char pixel[40];
        double v[VALUES];
        snprintf(pixel, sizeof pixel, "Pixel (%d, 0): 1 sample", k);
        const char *line = strstr(output, pixel), *values = line ? strstr(line, "R=") : NULL;
        assert_true(values && sscanf(values, "R=%lf G=%lf B=%lf A=%lf Z=%lf ZBack=%lf", &v[0],
                                     &v[1], &v[2], &v[3], &v[4], &v[5]) == VALUES);
        for (int c = 0; c < VALUES; ++c)
            if (!(fabs(v[c] - expected[k][c]) <= 1e-5 * fabs(expected[k][c])))
                fail_msg("pixel %d, value %d: %.9g instead of %.9g", k, c, v[c], expected[k][c]);
    }
    temp_folder_remove(&folder);
}

// Each thread has a compressor of its own.
static void threads_may_grow_while_a_deep_file_is_open(void **state)
{
    (void)state;
    static uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT];
    static sgs_deep_sample samples[7 * SMALL_WIDTH * SMALL_HEIGHT];
    random_samples(counts, samples);
    const temp_folder folder = temp_folder_make();
    const sgs_exr_info info = {.width = SMALL_WIDTH, .height = SMALL_HEIGHT};
    uint8_t *bytes[2];
    size_t sizes[2];
    for (int run = 0; run < 2; ++run) {
        const char *path = temp_path(&folder, "deep.exr");
        sgs_exr_deep *deep;
        sgs_threads_set(1);
        assert_int_equal(sgs_exr_deep_open(path, &info, 7, &deep), SGS_STATUS_OK);
        sgs_threads_set(run ? 8 : 1);
        assert_int_equal(sgs_exr_deep_write(deep, SMALL_HEIGHT, counts, samples), SGS_STATUS_OK);
        assert_int_equal(sgs_exr_deep_close(deep), SGS_STATUS_OK);
        assert_int_equal(sgsi_file_read(path, 0, &bytes[run], &sizes[run]), SGS_STATUS_OK);
    }
    sgs_threads_set(0);
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(bytes[0], bytes[1], sizes[0]);
    for (int run = 0; run < 2; ++run)
        sgsi_free(bytes[run]);
    temp_folder_remove(&folder);
}

// The header's maximum is true.
static void counts_above_the_maximum_are_refused(void **state)
{
    (void)state;
    static uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT];
    static sgs_deep_sample samples[8 * SMALL_WIDTH * SMALL_HEIGHT];
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "deep.exr");
    const sgs_exr_info info = {.width = SMALL_WIDTH, .height = SMALL_HEIGHT};
    sgs_exr_deep *deep;
    static const int none[] = {0, -1, INT_MIN};
    for (size_t k = 0; k < sizeof none / sizeof *none; ++k) {
        assert_int_equal(sgs_exr_deep_open(path, &info, none[k], &deep),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_null(deep);
        assert_non_null(strstr(sgs_last_error(), "deep.exr: max_samples"));
    }
    counts[5 * SMALL_WIDTH + 3] = 7;
    counts[5 * SMALL_WIDTH + 4] = 8;
    assert_int_equal(sgs_exr_deep_open(path, &info, 7, &deep), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_write(deep, 2, counts, samples), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_write(deep, 4, counts + 2 * SMALL_WIDTH, samples),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(
        strstr(sgs_last_error(), "deep.exr: pixel 4 of row 5 has 8 samples, max_samples is 7"));
    assert_int_equal(sgs_exr_deep_close(deep), SGS_STATUS_INVALID_ARGUMENT);
    counts[5 * SMALL_WIDTH + 4] = 7;
    assert_int_equal(sgs_exr_deep_open(path, &info, 7, &deep), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_write(deep, SMALL_HEIGHT, counts, samples), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_close(deep), SGS_STATUS_OK);
    temp_folder_remove(&folder);
}

static void deep_write_failure_leaves_no_file(void **state)
{
    (void)state;
    static uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT];
    static sgs_deep_sample samples[7 * SMALL_WIDTH * SMALL_HEIGHT];
    random_samples(counts, samples);
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "deep.exr");
    static const size_t limits[] = {0, 100, 900, 2500};
    for (size_t k = 0; k < sizeof limits / sizeof *limits; ++k) {
        files_limited(limits[k]);
        const sgs_status status = write_file(path, SGS_EXR_NONE, counts, samples);
        files_unlimited();
        assert_int_equal(status, SGS_STATUS_IO);
        assert_non_null(strstr(sgs_last_error(), "deep.exr: cannot be written: File too large"));
        assert_int_equal(temp_folder_count(&folder), 0);
    }
    // An incomplete file is removed.
    const sgs_exr_info info = {.width = SMALL_WIDTH, .height = SMALL_HEIGHT};
    sgs_exr_deep *deep;
    assert_int_equal(sgs_exr_deep_open(path, &info, 7, &deep), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_write(deep, 7, counts, samples), SGS_STATUS_OK);
    assert_int_equal(sgs_exr_deep_write(deep, SMALL_HEIGHT, counts, samples),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_not_equal(sgs_exr_deep_close(deep), SGS_STATUS_OK);
    sgs_exr_deep_abort(NULL);
    assert_int_equal(temp_folder_count(&folder), 0);
    temp_folder_remove(&folder);
}

static void deep_write_reports_failed_allocations(void **state)
{
    (void)state;
    static uint32_t counts[SMALL_WIDTH * SMALL_HEIGHT];
    static sgs_deep_sample samples[7 * SMALL_WIDTH * SMALL_HEIGHT];
    random_samples(counts, samples);
    const temp_folder folder = temp_folder_make();
    char path[300];
    snprintf(path, sizeof path, "%s", temp_path(&folder, "deep.exr"));
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    size_t n = 0;
    while (status) {
        sgsi_fail_allocation(++n);
        status = write_file(path, SGS_EXR_ZIP, counts, samples);
        if (status && status != SGS_STATUS_OUT_OF_MEMORY)
            fail_msg("allocation %zu: %s", n, sgs_last_error());
        assert_int_equal(temp_folder_count(&folder), status ? 0 : 1);
    }
    sgsi_fail_allocation(0);
    assert_true(n > 10);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flattened_samples_equal_the_flat_image),
        cmocka_unit_test(samples_equal_the_hits_of_the_oracle),
        cmocka_unit_test(hits_merge_only_within_the_tolerance),
        cmocka_unit_test(bits_do_not_depend_on_threads_or_samples),
        cmocka_unit_test(callback_failure_stops_the_render),
        cmocka_unit_test(deep_files_are_readable_by_another_program),
        cmocka_unit_test(half_samples_round_as_openexr_does),
        cmocka_unit_test(flattened_half_samples_are_near_the_exact_ones),
        cmocka_unit_test(half_samples_keep_depth_and_alpha),
        cmocka_unit_test(threads_may_grow_while_a_deep_file_is_open),
        cmocka_unit_test(deep_write_failure_leaves_no_file),
        cmocka_unit_test(counts_above_the_maximum_are_refused),
        cmocka_unit_test(deep_write_reports_failed_allocations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
