// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// AOVs besides colour: normals, positions, dominant primitives and axis distances. The renderer is
// compared with the oracle, and both with surfaces of known distance, normal and position.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/fragile_support.h"
#include "support/oracle_support.h"
#include "sparegs/aov_descriptors.h"
#include "sparegs/runtime.h"

static const sgs_pose identity = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};

static double worse(double worst, double error)
{
    return isnan(worst) || error <= worst ? worst : error;
}

static sgs_frame drawn(const sgs_gaussians *model, const sgs_camera *camera, const sgs_pose *pose,
                       const sgs_render_options *options, unsigned planes)
{
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(camera->width, camera->height, planes, &frame),
                     SGS_STATUS_OK);
    if (sgs_renderer_render(renderer, camera, pose, options, &frame))
        fail_msg("%s", sgs_last_error());
    sgs_renderer_destroy(renderer);
    return frame;
}

// ---- Against the oracle ----

// Decisions that single precision may take differently in a pixel: the list of hits, the larger of
// two nearly equal weights, and the visible side of a primitive seen edge-on. `length` is that of
// the mean normal before normalisation.
typedef struct aov_truth {
    bool fragile, primitive_fragile, normal_fragile;
    double length;
} aov_truth;

static aov_truth judge_aov(const sgsi_reference_view *view, const double direction[3],
                           sgs_hit *hits)
{
    const pixel_truth list = judge(view, direction, hits);
    aov_truth truth = {.fragile = list.fragile || list.median_fragile};
    double sum[3] = {0, 0, 0}, weights = 0, largest = 0, second = 0;
    for (size_t k = 0; k < list.count; ++k) {
        const double w = hits[k].transmittance * hits[k].alpha;
        const sgsi_reference_primitive *primitive = &view->primitives[hits[k].primitive];
        double normal[3], along = 0;
        sgsi_reference_normal(primitive, normal);
        for (int c = 0; c < 3; ++c) {
            sum[c] += w * normal[c];
            along += normal[c] * primitive->direction[c];
        }
        truth.normal_fragile |= fabs(along) < 1e-5;
        weights += w;
        second = w > largest ? largest : fmax(second, w);
        largest = fmax(largest, w);
    }
    truth.length =
        weights > 0 ? sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]) / weights : 0;
    truth.primitive_fragile = second > largest * (1 - 1e-4);
    return truth;
}

typedef struct aov_errors {
    float least_candidates; // of a tile
    double normal, position, distance;
    size_t compared, identified;
} aov_errors;

static void compare_pixel(const sgs_frame *frame, const sgs_reference_frame *exact, size_t i,
                          const aov_truth *truth, aov_errors *errors)
{
    const double far = exact->hits[i] > 0 ? fabs(exact->depth_first[i]) + 1 : 1;
    for (int c = 0; c < 3; ++c) {
        if (!truth->normal_fragile && truth->length > 0.01)
            errors->normal = worse(errors->normal,
                                   truth->length * fabs(frame->normal[c][i] - exact->normal[c][i]));
        errors->position =
            worse(errors->position, fabs(frame->position[c][i] - exact->position[c][i]) / far);
    }
    const float *const depths[] = {frame->depth_mean, frame->depth_median, frame->depth_first};
    const double *const exacts[] = {exact->depth_mean, exact->depth_median, exact->depth_first};
    for (int k = 0; k < 3; ++k)
        errors->distance = worse(errors->distance, fabs(depths[k][i] - exacts[k][i]) / far);
    if (!truth->primitive_fragile) {
        assert_true(frame->primitive[i] ==
                    (exact->primitive[i] < 0 ? SGS_NO_PRIMITIVE : (uint32_t)exact->primitive[i]));
        ++errors->identified;
    }
    assert_true((double)frame->candidates[i] >= exact->candidates[i]);
    ++errors->compared;
}

// Tiles have one number of candidates. Returns the smallest one.
static float check_candidates(const sgs_frame *frame, size_t primitives)
{
    float least = INFINITY;
    for (int y = 0; y < frame->height; ++y)
        for (int x = 0; x < frame->width; ++x) {
            const float own = frame->candidates[y * frame->width + x],
                        of_tile = frame->candidates[y / 16 * 16 * frame->width + x / 16 * 16];
            assert_true(own == of_tile && own >= 0 && own <= (float)primitives);
            least = fminf(least, own);
        }
    return least;
}

static void compare_with_oracle(const oracle_scene *scene, const sgs_camera *camera,
                                const sgs_pose *pose, const sgs_render_options *options,
                                aov_errors *errors)
{
    sgs_frame frame = drawn(scene->model, camera, pose, options, SGS_AOVS_ALL);
    sgs_reference_frame exact;
    sgsi_reference_view view;
    assert_int_equal(sgs_reference_frame_create(camera->width, camera->height, &exact),
                     SGS_STATUS_OK);
    assert_int_equal(
        sgs_reference_render(scene->params, scene->count, camera, pose, options, &exact),
        SGS_STATUS_OK);
    assert_int_equal(
        sgsi_reference_view_create(scene->params, scene->count, camera, pose, options, &view),
        SGS_STATUS_OK);
    sgs_hit *hits = oracle_memory(scene->count, sizeof *hits);
    for (int y = 0; y < camera->height; ++y)
        for (int x = 0; x < camera->width; ++x) {
            const size_t i = (size_t)y * (size_t)camera->width + (size_t)x;
            double direction[3];
            aov_truth truth = {0};
            if (sgsi_reference_ray(&view, x, y, direction))
                truth = judge_aov(&view, direction, hits);
            if (!truth.fragile)
                compare_pixel(&frame, &exact, i, &truth, errors);
        }
    errors->least_candidates = check_candidates(&frame, scene->count);
    free(hits);
    sgsi_reference_view_free(&view);
    sgs_reference_frame_free(&exact);
    sgs_frame_free(&frame);
}

static void aovs_equal_the_oracle_on_every_isa_and_lens(void **state)
{
    (void)state;
    static const sgs_camera_model lenses[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV,
                                              SGS_CAMERA_OPENCV_FISHEYE};
    const sgs_isa best = sgs_isa_get();
    const sgs_pose pose = oracle_pose_look_at(2.1, -1.3, -3.2);
    oracle_scene scene = oracle_random_model(31, 300, NULL);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        aov_errors errors = {0};
        size_t pixels = 0;
        for (int run = 0; run < 12; ++run) {
            const sgs_camera camera = oracle_camera(lenses[run % 3], 61, 45);
            sgs_render_options options = sgs_render_options_default();
            options.filter = run / 3 % 2 ? SGS_FILTER_NONE : SGS_FILTER_3DGS;
            options.axis_depth = run >= 6;
            compare_with_oracle(&scene, &camera, &pose, &options, &errors);
            assert_true(errors.least_candidates < 0.5f * (float)scene.count);
            pixels += 61 * 45;
        }
        print_message("%s: normal %.2g, position %.2g, distance %.2g, %zu of %zu pixels\n",
                      sgs_isa_name((sgs_isa)isa), errors.normal, errors.position, errors.distance,
                      errors.compared, pixels);
        assert_true(errors.normal <= 2e-5 && errors.position <= 2e-5 && errors.distance <= 2e-5);
        assert_true(errors.compared * 10 > pixels * 9 && errors.identified * 10 > pixels * 9);
    }
    sgs_isa_set(best);
    oracle_scene_free(&scene);
}

static void adversarial_aovs_equal_the_oracle(void **state)
{
    (void)state;
    // Without the scenes whose hits single precision cannot distinguish (see test_tracer_oracle.c).
    static const oracle_adversary kinds[] = {ORACLE_COPLANAR, ORACLE_NESTED, ORACLE_INSIDE,
                                             ORACLE_DUPLICATES};
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
        oracle_scene scene = oracle_adversarial_model(kinds[k], 11, 120);
        const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 61, 45);
        const sgs_render_options options = sgs_render_options_default();
        aov_errors errors = {0};
        compare_with_oracle(&scene, &camera, &pose, &options, &errors);
        print_message("%s: normal %.2g, position %.2g, distance %.2g, %zu pixels\n",
                      oracle_adversary_name(kinds[k]), errors.normal, errors.position,
                      errors.distance, errors.compared);
        assert_true(errors.normal <= 2e-5 && errors.position <= 2e-5 && errors.distance <= 2e-5);
        assert_true(errors.compared > 100);
        oracle_scene_free(&scene);
    }
}

// Positions differ by half a step of the floats of world coordinates, 5e-4, and the distances
// divide them by 3 and more.
static void aovs_far_from_the_origin_equal_the_oracle(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_move(oracle_pose_look_at(2.1, -1.3, -3.2), oracle_far_away);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 61, 45);
    const sgs_render_options options = sgs_render_options_default();
    oracle_scene scene = oracle_random_model(31, 300, NULL);
    oracle_scene_move(&scene, oracle_far_away);
    aov_errors errors = {0};
    compare_with_oracle(&scene, &camera, &pose, &options, &errors);
    print_message("far: normal %.2g, position %.2g, distance %.2g, %zu pixels\n", errors.normal,
                  errors.position, errors.distance, errors.compared);
    assert_true(errors.normal <= 2e-5 && errors.position <= 1.7e-4 && errors.distance <= 2e-5);
    assert_true(errors.compared > 61 * 45 * 9 / 10);
    oracle_scene_free(&scene);
}

// ---- Known surfaces ----

// A flat disc whose thin axis is `side` (unit, either sign).
static void set_tile(double *primitive, const double at[3], const double side[3], double radius)
{
    const double sign = side[2] < 0 ? -1 : 1,
                 normal[3] = {sign * side[0], sign * side[1], sign * side[2]};
    oracle_set_ball(primitive, at[0], at[1], at[2], radius, 0.995);
    oracle_set_scales(primitive, radius, radius, radius / 50);
    // Rotation from z to the normal: axis z x n, by half angles.
    const double w = sqrt(0.5 * (1 + normal[2]));
    primitive[SGS_PARAM_ROTATION] = w;
    primitive[SGS_PARAM_ROTATION + 1] = -normal[1] / (2 * w);
    primitive[SGS_PARAM_ROTATION + 2] = normal[0] / (2 * w);
    primitive[SGS_PARAM_ROTATION + 3] = 0;
}

typedef struct surface_errors {
    // Largest errors. Depth and position: relative to the distance; normal: angle in radians.
    double depth, normal, position;
    size_t pixels;
} surface_errors;

// Compares the three depths with `distance` [pixels] (0: skip), and the normal and the position.
static surface_errors judge_surface(const oracle_scene *scene, const sgs_camera *camera,
                                    sgs_filter filter, bool axis, const double *distance,
                                    const double (*normals)[3])
{
    sgs_render_options options = sgs_render_options_default();
    options.filter = filter;
    options.axis_depth = axis;
    sgs_frame frame = drawn(scene->model, camera, &identity, &options, SGS_AOVS_ALL);
    surface_errors errors = {0};
    for (size_t i = 0; i < (size_t)camera->width * (size_t)camera->height; ++i) {
        const double pixel[2] = {(double)(i % (size_t)camera->width) + 0.5,
                                 (double)(i / (size_t)camera->width) + 0.5};
        double d[3];
        if (!(distance[i] > 0) || !sgs_camera_unproject(camera, pixel, d))
            continue;
        const double truth = axis ? distance[i] * d[2] : distance[i];
        const float depths[] = {frame.depth_mean[i], frame.depth_median[i], frame.depth_first[i]};
        double along = 0, off = 0;
        for (int k = 0; k < 2 + (filter == SGS_FILTER_NONE);
             ++k) // the first hit of a widened primitive is its rim
            errors.depth = worse(errors.depth, fabs(depths[k] / truth - 1));
        for (int c = 0; c < 3; ++c) {
            along += frame.normal[c][i] * normals[i][c];
            off += pow(frame.position[c][i] - distance[i] * d[c], 2);
        }
        errors.normal = worse(errors.normal, acos(fmin(along, 1)));
        errors.position = worse(errors.position, sqrt(off) / distance[i]);
        ++errors.pixels;
    }
    sgs_frame_free(&frame);
    return errors;
}

static void depth_of_planes_is_true(void **state)
{
    (void)state;
    enum { SIDE = 96, TILES = 70 };
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, SIDE, SIDE, {110, 110, 47, 49}};
    static const double slants[][3] = {
        {0, 0, -1}, {0.5, 0, -0.8660254037844386}, {-0.24, 0.32, -0.9165151389911680}};
    static double distance[SIDE * SIDE], normals[SIDE * SIDE][3];
    for (size_t n = 0; n < sizeof slants / sizeof *slants; ++n) {
        const double *normal = slants[n], at[3] = {0, 0, 4};
        oracle_scene scene = oracle_scene_create(TILES * TILES);
        for (int i = 0; i < TILES * TILES; ++i) { // a grid in x and y, projected onto the plane
            double point[3] = {-3.5 + 7.0 * (i % TILES) / (TILES - 1),
                               -3.5 + 7.0 * (double)(i / TILES) / (TILES - 1.0), 0};
            point[2] = at[2] - (normal[0] * point[0] + normal[1] * point[1]) / normal[2];
            set_tile(oracle_primitive(&scene, (size_t)i), point, normal, 0.12);
        }
        oracle_scene_round(&scene);
        for (int i = 0; i < SIDE * SIDE; ++i) {
            double d[3];
            assert_true(sgs_camera_unproject(
                &camera, (double[2]){i % SIDE + 0.5, (double)(i / SIDE) + 0.5}, d));
            distance[i] =
                normal[2] * at[2] / (normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]);
            memcpy(normals[i], normal, sizeof normals[i]);
        }
        for (int run = 0; run < 4; ++run) {
            const surface_errors e =
                judge_surface(&scene, &camera, run % 2 ? SGS_FILTER_3DGS : SGS_FILTER_NONE,
                              run >= 2, distance, (const double(*)[3])normals);
            print_message("plane %zu: depth %.3f %%, normal %.2g rad, position %.3f %%\n", n,
                          100 * e.depth, e.normal, 100 * e.position);
            assert_true(e.depth <= 0.005 && e.normal <= 1e-3 && e.position <= 0.005 &&
                        e.pixels == SIDE * SIDE);
        }
        oracle_scene_free(&scene);
    }
}

static void depth_of_spheres_is_true(void **state)
{
    (void)state;
    enum { SIDE = 256, TILES = 16000 };
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, SIDE, SIDE, {300, 300, 128, 128}};
    static double distance[SIDE * SIDE], normals[SIDE * SIDE][3];
    const double radius = 1.2, at[3] = {0.2, -0.1, 4};
    oracle_scene scene = oracle_scene_create(TILES / 2);
    for (int i = 0; i < TILES / 2; ++i) { // the near half of a Fibonacci lattice: opaque
        const double z = (2 * i + 1.0) / TILES - 1, turn = i * 2.399963229728653,
                     flat = sqrt(1 - z * z);
        const double normal[3] = {flat * cos(turn), flat * sin(turn), z};
        set_tile(
            oracle_primitive(&scene, (size_t)i),
            (double[3]){at[0] + radius * normal[0], at[1] + radius * normal[1], at[2] + radius * z},
            normal, 0.025);
    }
    oracle_scene_round(&scene);
    size_t inside = 0;
    for (int i = 0; i < SIDE * SIDE; ++i) {
        double d[3];
        assert_true(sgs_camera_unproject(&camera,
                                         (double[2]){i % SIDE + 0.5, (double)(i / SIDE) + 0.5}, d));
        const double b = d[0] * at[0] + d[1] * at[1] + d[2] * at[2];
        const double c = at[0] * at[0] + at[1] * at[1] + at[2] * at[2] - radius * radius,
                     root = b * b - c;
        distance[i] = 0;
        if (root < pow(0.5 * radius, 2)) // near the silhouette, discs are seen edge-on
            continue;
        distance[i] = b - sqrt(root);
        for (int k = 0; k < 3; ++k)
            normals[i][k] = (distance[i] * d[k] - at[k]) / radius;
        ++inside;
    }
    for (int run = 0; run < 4; ++run) {
        const surface_errors e =
            judge_surface(&scene, &camera, run % 2 ? SGS_FILTER_3DGS : SGS_FILTER_NONE, run >= 2,
                          distance, (const double(*)[3])normals);
        print_message("sphere: depth %.3f %%, normal %.2g rad, position %.3f %% on %zu pixels\n",
                      100 * e.depth, e.normal, 100 * e.position, e.pixels);
        assert_true(e.depth <= 0.005 && e.normal <= 0.05 && e.position <= 0.005 &&
                    e.pixels == inside);
    }
    assert_true(inside > 15000);
    oracle_scene_free(&scene);
}

// ---- Frames ----

static void unrequested_planes_are_null(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 60, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 33, 21);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_render_options options = sgs_render_options_default();
    sgs_frame all = drawn(scene.model, &camera, &pose, &options, SGS_AOVS_ALL);
    const struct {
        unsigned bit;
        const void *whole;
    } planes[] = {{SGS_AOV_DEPTH_MEAN, all.depth_mean},   {SGS_AOV_DEPTH_MEDIAN, all.depth_median},
                  {SGS_AOV_DEPTH_FIRST, all.depth_first}, {SGS_AOV_HITS, all.hits},
                  {SGS_AOV_NORMAL, all.normal[1]},        {SGS_AOV_POSITION, all.position[2]},
                  {SGS_AOV_PRIMITIVE, all.primitive},     {SGS_AOV_CANDIDATES, all.candidates}};
    for (size_t k = 0; k < sizeof planes / sizeof *planes; ++k) {
        sgs_frame one = drawn(scene.model, &camera, &pose, &options, planes[k].bit);
        const void *const own[] = {one.depth_mean, one.depth_median, one.depth_first,
                                   one.hits,       one.normal[1],    one.position[2],
                                   one.primitive,  one.candidates};
        for (size_t j = 0; j < sizeof own / sizeof *own; ++j) {
            assert_int_equal(own[j] != NULL, j == k);
            if (j == k)
                assert_memory_equal(own[j], planes[k].whole, 33 * 21 * sizeof(float));
        }
        assert_memory_equal(one.color[0], all.color[0], 33 * 21 * sizeof(float));
        assert_memory_equal(one.transmittance, all.transmittance, 33 * 21 * sizeof(float));
        sgs_frame_free(&one);
    }
    sgs_frame_free(&all);
    oracle_scene_free(&scene);
}

// Components of normal and position are planes of their own.
static void each_component_is_rendered_alone(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(9, 200, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 33, 21);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_render_options options = sgs_render_options_default();
    sgs_frame all = drawn(scene.model, &camera, &pose, &options, SGS_AOVS_ALL), frame;
    sgs_renderer *renderer;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(33, 21, SGS_AOV_NORMAL | SGS_AOV_POSITION, &frame),
                     SGS_STATUS_OK);
    for (int k = 0; k < 6; ++k) {
        const int c = k % 3;
        sgs_frame one = frame;
        memset(one.normal, 0, sizeof one.normal);
        memset(one.position, 0, sizeof one.position);
        float **plane = k < 3 ? &one.normal[c] : &one.position[c];
        *plane = k < 3 ? frame.normal[c] : frame.position[c];
        assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, &options, &one),
                         SGS_STATUS_OK);
        assert_memory_equal(*plane, k < 3 ? all.normal[c] : all.position[c],
                            33 * 21 * sizeof(float));
    }
    sgs_frame_free(&frame);
    sgs_frame_free(&all);
    sgs_renderer_destroy(renderer);
    oracle_scene_free(&scene);
}

// A frame with other values, as one that is used again.
static void an_empty_model_overwrites_every_plane(void **state)
{
    (void)state;
    const size_t pixels = 33 * 21;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 33, 21);
    const sgs_render_options options = sgs_render_options_default();
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    sgs_gaussians *empty;
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(sgs_gaussians_create(0, &empty), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(empty, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(33, 21, SGS_AOVS_ALL, &frame), SGS_STATUS_OK);
    for (size_t a = 0; a < count; ++a)
        for (int c = 0; c < aovs[a].channels; ++c)
            memset(sgs_aov_plane(&aovs[a], &frame, c), 0x41, pixels * sizeof(float)); // 12.08
    assert_int_equal(sgs_renderer_render(renderer, &camera, &identity, &options, &frame),
                     SGS_STATUS_OK);
    for (size_t a = 0; a < count; ++a)
        for (int c = 0; c < aovs[a].channels; ++c) {
            const float *plane = sgs_aov_plane(&aovs[a], &frame, c);
            for (size_t i = 0; i < pixels; ++i) {
                const uint32_t *ids = sgs_aov_plane(&aovs[a], &frame, c);
                const bool right = aovs[a].type == SGS_AOV_TYPE_UINT ? ids[i] == SGS_NO_PRIMITIVE
                                   : plane == frame.transmittance    ? plane[i] == 1.0f
                                                                     : plane[i] == 0.0f;
                if (!right)
                    fail_msg("pixel %zu of %s is %g", i, aovs[a].name, (double)plane[i]);
            }
        }
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(empty);
}

// The tree of an earlier view, or of the model before it moved, has other boxes.
static void bits_do_not_depend_on_earlier_renderings(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(9, 1500, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 90, 70);
    const sgs_render_options options = sgs_render_options_default();
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(90, 70, SGS_AOVS_ALL, &frame), SGS_STATUS_OK);
    for (int k = 0; k < 5; ++k) {
        const sgs_pose pose = oracle_pose_look_at(1 - k, 2 - k, -4 + 2 * k);
        for (size_t i = 0; k == 3 && i < scene.count; ++i)
            *sgs_gaussians_at(scene.model, i, SGS_PARAM_MEAN) += i % 2 ? 0.5f : -0.5f;
        sgs_renderer_refit(renderer);
        assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, &options, &frame),
                         SGS_STATUS_OK);
        sgs_frame alone = drawn(scene.model, &camera, &pose, &options, SGS_AOVS_ALL);
        size_t count;
        const sgs_aov *aovs = sgs_aov_descriptors(&count);
        for (size_t a = 0; a < count; ++a)
            for (int c = 0; c < aovs[a].channels; ++c)
                assert_memory_equal(sgs_aov_plane(&aovs[a], &frame, c),
                                    sgs_aov_plane(&aovs[a], &alone, c), 90 * 70 * sizeof(float));
        sgs_frame_free(&alone);
    }
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    oracle_scene_free(&scene);
}

static sgs_status ignore_rows(void *context, int y, int rows, const uint32_t *counts,
                              const sgs_deep_sample *samples)
{
    (void)context, (void)y, (void)rows, (void)counts, (void)samples;
    return SGS_STATUS_OK;
}

// A fisheye lens whose corners are 79 and 140 degrees from the axis.
static void distances_along_the_axis_require_rays_in_front_of_the_camera(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(9, 40, NULL);
    const sgs_pose pose = oracle_pose_look_at(1, 1, -4);
    sgs_render_options options = sgs_render_options_default();
    const sgs_deep_options deep = sgs_deep_options_default();
    sgs_renderer *renderer;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    for (int wide = 0; wide < 2; ++wide) {
        const int side = wide ? 70 : 40;
        const sgs_camera camera = {
            SGS_CAMERA_OPENCV_FISHEYE, side, side, {20, 20, side / 2, side / 2}};
        sgs_frame frame;
        sgs_reference_frame exact;
        assert_int_equal(sgs_frame_create(side, side, &frame), SGS_STATUS_OK);
        assert_int_equal(sgs_reference_frame_create(side, side, &exact), SGS_STATUS_OK);
        for (int axis = 0; axis < 2; ++axis) {
            options.axis_depth = axis;
            const sgs_status expected = wide && axis ? SGS_STATUS_UNSUPPORTED : SGS_STATUS_OK;
            const char *message = "option axis_depth is not defined for rays 90 degrees or more";
            assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, &options, &frame),
                             expected);
            assert_true(!expected || strstr(sgs_last_error(), message));
            assert_int_equal(sgs_renderer_render_deep(renderer, &camera, &pose, &options, &deep,
                                                      &frame, ignore_rows, NULL),
                             expected);
            assert_int_equal(
                sgs_reference_render(scene.params, scene.count, &camera, &pose, &options, &exact),
                expected);
            assert_true(!expected || strstr(sgs_last_error(), message));
        }
        sgs_frame_free(&frame);
        sgs_reference_frame_free(&exact);
    }
    sgs_renderer_destroy(renderer);
    oracle_scene_free(&scene);
}

static void bits_do_not_depend_on_threads(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(9, 400, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 90, 70);
    const sgs_pose pose = oracle_pose_look_at(1, 1, -4);
    const sgs_render_options options = sgs_render_options_default();
    const size_t bytes = 90 * 70 * sizeof(float);
    sgs_threads_set(1);
    sgs_frame one = drawn(scene.model, &camera, &pose, &options, SGS_AOVS_ALL);
    sgs_threads_set(3);
    sgs_frame three = drawn(scene.model, &camera, &pose, &options, SGS_AOVS_ALL);
    sgs_threads_set(0);
    for (int c = 0; c < 3; ++c) {
        assert_memory_equal(one.normal[c], three.normal[c], bytes);
        assert_memory_equal(one.position[c], three.position[c], bytes);
    }
    assert_memory_equal(one.primitive, three.primitive, bytes);
    assert_memory_equal(one.candidates, three.candidates, bytes);
    sgs_frame_free(&one);
    sgs_frame_free(&three);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(aovs_equal_the_oracle_on_every_isa_and_lens),
        cmocka_unit_test(adversarial_aovs_equal_the_oracle),
        cmocka_unit_test(aovs_far_from_the_origin_equal_the_oracle),
        cmocka_unit_test(depth_of_planes_is_true),
        cmocka_unit_test(depth_of_spheres_is_true),
        cmocka_unit_test(unrequested_planes_are_null),
        cmocka_unit_test(each_component_is_rendered_alone),
        cmocka_unit_test(an_empty_model_overwrites_every_plane),
        cmocka_unit_test(bits_do_not_depend_on_earlier_renderings),
        cmocka_unit_test(distances_along_the_axis_require_rays_in_front_of_the_camera),
        cmocka_unit_test(bits_do_not_depend_on_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
