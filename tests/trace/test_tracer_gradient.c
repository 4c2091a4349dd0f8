// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Gradients in single precision against the oracle's in double precision, which
// test_reference_gradient.c checks against finite differences: each instruction set, lens and
// filter, gradients of colour and transmittance. Per group of parameters, the largest error is at
// most 1e-4 of the largest gradient. The error of each primitive with at least a tenth of the
// largest gradient is at most 1e-4 of its own. The comparison must detect planted errors. A
// repeated training step must not allocate.
//
// Gradients are discontinuous at fragile hits (see test_tracer_oracle.c). Their pixels have no
// incoming gradient here, in both renderers.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "reference/reference.h"
#include "support/tracer_support.h"

// ---- Pixels whose hit list may differ in single precision ----

static int by_distance(const void *a, const void *b)
{
    const sgs_hit *x = a, *y = b;
    return x->t < y->t   ? -1
           : x->t > y->t ? 1
                         : (x->primitive > y->primitive) - (x->primitive < y->primitive);
}

static bool is_fragile(const sgsi_reference_view *view, const double direction[3], sgs_hit *hits)
{
    size_t found = 0;
    for (size_t i = 0; i < view->count; ++i) {
        double rho2, t;
        sgsi_reference_response(&view->primitives[i], direction, &rho2, &t);
        const double alpha = view->primitives[i].opacity * exp(-0.5 * rho2);
        if (!(alpha * 255 >= 1 - 1e-4) || !(t > view->near_distance * (1 - 1e-5)))
            continue;
        if (alpha * 255 < 1 + 1e-4 || t < view->near_distance * (1 + 1e-5))
            return true;
        hits[found++] = (sgs_hit){(uint32_t)i, t, fmin(alpha, 0.99), 0};
    }
    qsort(hits, found, sizeof *hits, by_distance);
    double transmittance = 1;
    for (size_t k = 0; k < found; ++k) {
        transmittance *= 1 - hits[k].alpha;
        if (fabs(transmittance / 1e-4 - 1) < 1e-3 ||
            (k && hits[k].t != hits[k - 1].t && hits[k].t - hits[k - 1].t < 1e-5 * hits[k].t))
            return true;
        if (transmittance < 1e-4)
            return false;
    }
    return false;
}

// ---- Incoming gradients, the same floats for both renderers ----

typedef struct incoming {
    sgsi_planes single;
    double *planes[4];
    size_t fragile;
} incoming;

// colors, transmittance: which of them is nonzero.
static incoming make_incoming(const oracle_scene *scene, const traced_view *traced, bool colors,
                              bool transmittance)
{
    const sgs_camera *camera = &traced->camera;
    incoming in = {.single = traced_planes_create(camera->width, camera->height)};
    sgsi_reference_view view;
    assert_int_equal(sgsi_reference_view_create(scene->params, scene->count, camera, &traced->pose,
                                                &traced->options, &view),
                     SGS_STATUS_OK);
    sgs_hit *hits = oracle_memory(scene->count, sizeof *hits);
    float *const single[4] = {in.single.color[0], in.single.color[1], in.single.color[2],
                              in.single.transmittance};
    for (int k = 0; k < 4; ++k)
        in.planes[k] =
            oracle_memory((size_t)camera->width * (size_t)camera->height, sizeof(double));
    oracle_random random = {5, 0};
    for (int y = 0; y < camera->height; ++y) {
        for (int x = 0; x < camera->width; ++x) {
            double direction[3];
            const bool fragile =
                sgsi_reference_ray(&view, x, y, direction) && is_fragile(&view, direction, hits);
            in.fragile += fragile;
            for (int k = 0; k < 4; ++k) {
                const bool wanted = !fragile && (k < 3 ? colors : transmittance);
                const float value = (float)oracle_normal(&random);
                single[k][(size_t)y * in.single.stride + (size_t)x] = wanted ? value : 0.0f;
                in.planes[k][(size_t)y * (size_t)camera->width + (size_t)x] = wanted ? value : 0.0f;
            }
        }
    }
    free(hits);
    sgsi_reference_view_free(&view);
    return in;
}

static void incoming_free(incoming *in)
{
    traced_planes_free(&in->single);
    for (int k = 0; k < 4; ++k)
        free(in->planes[k]);
}

// ---- Both gradients and their comparison ----

enum { GROUP_COUNT = 6 };
static const int group_begin[GROUP_COUNT + 1] = {
    SGS_PARAM_MEAN,  SGS_PARAM_ROTATION, SGS_PARAM_SCALE, SGS_PARAM_OPACITY,
    SGS_PARAM_SH_DC, SGS_PARAM_SH_REST,  SGS_PARAM_COUNT};
static const char *const group_names[GROUP_COUNT] = {"mean",    "rotation", "scale",
                                                     "opacity", "sh_dc",    "sh_rest"};

typedef struct gradients {
    size_t count;
    double *expected; // [count][SGS_PARAM_COUNT]
    double *actual;
} gradients;

// dL/dparameter from the optimiser kernel: [capacity][SGS_PARAM_COUNT] in model layout.
static float *single_gradients(const sgs_gaussians *model, const traced_view *traced)
{
    float *out = sgsi_calloc(model->capacity, SGS_PARAM_COUNT * sizeof *out);
    assert_non_null(out);
    const sgsi_optimize input = {.params = model->data,
                                 .count = model->count,
                                 .view = traced->view,
                                 .sums = sgsi_tracer_grad_sums(traced->tracer),
                                 .touched = sgsi_tracer_touched(traced->tracer),
                                 .gradients = out};
    sgsi_optimize_blocks(&input, 0, (model->count + SGS_LANES - 1) / SGS_LANES);
    return out;
}

static gradients compute_gradients(const oracle_scene *scene, traced_view *traced, incoming *in)
{
    gradients g = {.count = scene->count};
    g.expected = oracle_memory(scene->count * SGS_PARAM_COUNT, sizeof *g.expected);
    g.actual = oracle_memory(scene->count * SGS_PARAM_COUNT, sizeof *g.actual);
    const double *const d_color[3] = {in->planes[0], in->planes[1], in->planes[2]};
    assert_int_equal(sgs_reference_backward(scene->params, scene->count, &traced->camera,
                                            &traced->pose, &traced->options, d_color, in->planes[3],
                                            g.expected, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgsi_tracer_backward(traced->tracer, &traced->view, &traced->planes,
                                          in->single.color, in->single.transmittance),
                     SGS_STATUS_OK);
    float *single = single_gradients(scene->model, traced);
    for (size_t i = 0; i < scene->count; ++i)
        for (size_t k = 0; k < SGS_PARAM_COUNT; ++k)
            g.actual[i * SGS_PARAM_COUNT + k] =
                single[((i / SGS_LANES) * SGS_PARAM_COUNT + k) * SGS_LANES + i % SGS_LANES];
    sgsi_free(single);
    return g;
}

static void gradients_free(gradients *g)
{
    free(g->expected);
    free(g->actual);
}

typedef struct agreement {
    double group[GROUP_COUNT]; // largest error / largest gradient
    // Largest |error| / |gradient| of significant primitives, over all groups.
    double primitive;
    size_t significant;
} agreement;

static agreement compare_gradients(const gradients *g)
{
    agreement result = {0};
    for (int group = 0; group < GROUP_COUNT; ++group) {
        double worst = 0, largest = 0;
        for (size_t i = 0; i < g->count; ++i)
            for (int k = group_begin[group]; k < group_begin[group + 1]; ++k) {
                const double error = fabs(g->actual[i * SGS_PARAM_COUNT + (size_t)k] -
                                          g->expected[i * SGS_PARAM_COUNT + (size_t)k]);
                worst = traced_worse(worst, error);
                largest = fmax(largest, fabs(g->expected[i * SGS_PARAM_COUNT + (size_t)k]));
            }
        result.group[group] = largest > 0 || worst != 0 ? worst / largest : 0;
        for (size_t i = 0; i < g->count; ++i) {
            double error = 0, size = 0;
            for (int k = group_begin[group]; k < group_begin[group + 1]; ++k) {
                const double expected = g->expected[i * SGS_PARAM_COUNT + (size_t)k];
                const double difference = g->actual[i * SGS_PARAM_COUNT + (size_t)k] - expected;
                error += difference * difference;
                size += expected * expected;
            }
            if (error == 0 || size < 0.01 * largest * largest) // below a tenth of the largest
                continue;
            ++result.significant;
            const double relative = sqrt(error / size);
            result.primitive = traced_worse(result.primitive, relative);
        }
    }
    return result;
}

static bool agrees(const agreement *a, double group_limit, double primitive_limit)
{
    for (int k = 0; k < GROUP_COUNT; ++k)
        if (!(a->group[k] <= group_limit))
            return false;
    return a->primitive <= primitive_limit;
}

static void print_agreement(const char *what, const agreement *a)
{
    print_message("%s:", what);
    for (int k = 0; k < GROUP_COUNT; ++k)
        print_message(" %s %.1e", group_names[k], a->group[k]);
    print_message("; per primitive %.1e of %zu\n", a->primitive, a->significant);
}

typedef struct case_options {
    sgs_camera camera;
    sgs_pose pose;
    sgs_filter filter;
    bool colors, transmittance;
    int sh_degree;
    bool aovs; // the forward pass computes depths
} case_options;

static agreement run_case(const oracle_scene *scene, const case_options *options, gradients *keep)
{
    traced_view traced = traced_create(scene->model, &options->camera, &options->pose,
                                       options->filter, 2, SGSI_BVH_REFIT);
    traced.options.sh_degree = options->sh_degree;
    sgsi_view_set(&traced.view, traced.rays, &traced.pose, &traced.options);
    traced_project(&traced, scene->model, true, SGSI_BVH_REFIT);
    traced_forward(&traced, NULL);
    if (!options->aovs) { // as in training: lists are then shorter
        sgsi_planes colors = traced.planes;
        colors.depth_mean = colors.depth_median = colors.depth_first = colors.hits = NULL;
        assert_int_equal(sgsi_tracer_forward(traced.tracer, &traced.view, &colors, NULL, true),
                         SGS_STATUS_OK);
    }
    incoming in = make_incoming(scene, &traced, options->colors, options->transmittance);
    assert_true(in.fragile * 4 < (size_t)(options->camera.width * options->camera.height));
    gradients g = compute_gradients(scene, &traced, &in);
    const agreement result = compare_gradients(&g);
    if (keep)
        *keep = g;
    else
        gradients_free(&g);
    incoming_free(&in);
    traced_destroy(&traced);
    return result;
}

static case_options default_case(sgs_camera_model lens)
{
    return (case_options){oracle_camera(lens, 63, 47),
                          oracle_pose_look_at(1.9, -1.2, -3.3),
                          SGS_FILTER_3DGS,
                          true,
                          true,
                          3,
                          false};
}

static void gradients_equal_the_oracle_on_every_isa_lens_and_filter(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(41, 200, NULL);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
            for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
                case_options options = default_case(traced_lenses[lens]);
                options.filter = (sgs_filter)filter;
                const agreement a = run_case(&scene, &options, NULL);
                print_agreement(sgs_isa_name((sgs_isa)isa), &a);
                assert_true(agrees(&a, 1e-4, 1e-4));
                assert_true(a.significant > 100);
            }
        }
    }
    oracle_scene_free(&scene);
}

static void colour_and_transmittance_gradients_equal_the_oracle_separately(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(42, 200, NULL);
    for (int part = 0; part < 2; ++part) {
        case_options options = default_case(SGS_CAMERA_PINHOLE);
        options.colors = part == 0;
        options.transmittance = part == 1;
        gradients g;
        const agreement a = run_case(&scene, &options, &g);
        print_agreement(part ? "transmittance" : "colour", &a);
        for (size_t i = 0; part == 1 && i < g.count; ++i) // colours do not affect T
            for (int k = SGS_PARAM_SH_DC; k < SGS_PARAM_COUNT; ++k)
                assert_true(g.actual[i * SGS_PARAM_COUNT + (size_t)k] == 0 &&
                            g.expected[i * SGS_PARAM_COUNT + (size_t)k] == 0);
        assert_true(agrees(&a, 1e-4, 1e-4));
        gradients_free(&g);
    }
    oracle_scene_free(&scene);
}

static void gradients_equal_the_oracle_for_each_sh_degree(void **state)
{
    (void)state;
    const oracle_range range = {1, 0.05, 0.4, 0.05, 0.95, 0.6}; // strong SH: many clamped channels
    oracle_scene scene = oracle_random_model(43, 150, &range);
    for (int degree = 0; degree <= 3; ++degree) {
        case_options options = default_case(SGS_CAMERA_OPENCV);
        options.sh_degree = degree;
        gradients g;
        const agreement a = run_case(&scene, &options, &g);
        print_agreement("SH degree", &a);
        assert_true(agrees(&a, 1e-4, 1e-4));
        for (size_t i = 0; i < g.count; ++i)
            for (int k = SGS_PARAM_SH_DC + 3 * (degree + 1) * (degree + 1); k < SGS_PARAM_COUNT;
                 ++k)
                assert_true(g.actual[i * SGS_PARAM_COUNT + (size_t)k] == 0);
        gradients_free(&g);
    }
    oracle_scene_free(&scene);
}

// Opacities up to 1 - 1e-6: alpha is clamped at 0.99 inside many primitives, and rays end early.
static void gradients_equal_the_oracle_in_opaque_scenes(void **state)
{
    (void)state;
    const oracle_range range = {1, 0.08, 0.5, 0.9, 0.999999, 0.15};
    oracle_scene scene = oracle_random_model(44, 200, &range);
    const case_options options = default_case(SGS_CAMERA_PINHOLE);
    const agreement a = run_case(&scene, &options, NULL);
    print_agreement("opaque", &a);
    assert_true(agrees(&a, 1e-4, 1e-4));
    oracle_scene_free(&scene);
}

// Primitives of about a pixel: the hit that ends a ray often counts in no other ray of its block.
static void gradients_equal_the_oracle_where_rays_end_at_small_primitives(void **state)
{
    (void)state;
    const oracle_range range = {0.5, 0.01, 0.06, 0.9, 0.999, 0.15};
    oracle_scene scene = oracle_random_model(46, 4000, &range);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        case_options options = default_case(SGS_CAMERA_PINHOLE);
        for (int aovs = 0; aovs < 2; ++aovs) {
            options.aovs = aovs != 0;
            const agreement a = run_case(&scene, &options, NULL);
            print_agreement(aovs ? "small, with depths" : "small", &a);
            assert_true(agrees(&a, 1e-4, 1e-4));
        }
    }
    oracle_scene_free(&scene);
}

// The camera is between primitives, inside some and in front of many, with a fisheye of 130 degrees
// and a pinhole.
static void gradients_equal_the_oracle_inside_the_scene(void **state)
{
    (void)state;
    const oracle_range range = {3, 0.1, 1, 0.05, 0.9, 0.15};
    oracle_scene scene = oracle_random_model(45, 200, &range);
    for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
        case_options options = default_case(traced_lenses[lens]);
        options.pose = oracle_pose_look_at(0.2, 0.1, -0.4);
        const agreement a = run_case(&scene, &options, NULL);
        print_agreement("inside", &a);
        assert_true(agrees(&a, 1e-4, 1e-4));
    }
    oracle_scene_free(&scene);
}

static void gradients_equal_the_oracle_far_from_the_origin(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(41, 200, NULL);
    oracle_scene_move(&scene, oracle_far_away);
    for (int run = 0; run < 2 * TRACED_LENS_COUNT; ++run) {
        case_options options = default_case(traced_lenses[run / 2]);
        options.pose = oracle_pose_move(options.pose, oracle_far_away);
        options.filter = run % 2 ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
        const agreement a = run_case(&scene, &options, NULL);
        print_agreement("far", &a);
        assert_true(agrees(&a, 1e-4, 1e-4));
    }
    oracle_scene_free(&scene);
}

// ---- Planted errors are detected ----

typedef enum plant {
    PLANT_SIGN,
    PLANT_FACTOR,
    PLANT_TRANSPOSED,
    PLANT_SWAPPED,
    PLANT_NAN,
    PLANT_ONE_PRIMITIVE,
    PLANT_COUNT
} plant;

// Gradient of the rotation as if R were transposed: the sign of the quaternion's vector part
// changes.
static void plant_error(gradients *g, plant kind, int group)
{
    for (size_t i = 0; i < g->count; ++i) {
        double *d = g->actual + i * SGS_PARAM_COUNT + group_begin[group];
        const int size = group_begin[group + 1] - group_begin[group];
        for (int k = 0; k < size; ++k) {
            if (kind == PLANT_SIGN)
                d[k] = -d[k];
            if (kind == PLANT_FACTOR)
                d[k] *= 2;
            if (kind == PLANT_TRANSPOSED && k)
                d[k] = -d[k];
        }
        if (kind == PLANT_SWAPPED && size > 1) {
            const double first = d[0];
            d[0] = d[1];
            d[1] = first;
        }
        if (kind == PLANT_NAN && i == g->count / 2)
            d[0] = NAN;
    }
}

// One significant primitive of a group with an error of 1 %.
static void plant_one(gradients *g, int group)
{
    size_t best = 0;
    for (size_t i = 0; i < g->count; ++i)
        if (fabs(g->expected[i * SGS_PARAM_COUNT + (size_t)group_begin[group]]) >
            fabs(g->expected[best * SGS_PARAM_COUNT + (size_t)group_begin[group]]))
            best = i;
    g->actual[best * SGS_PARAM_COUNT + (size_t)group_begin[group]] *= 1.01;
}

static void comparison_detects_planted_errors(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(41, 200, NULL);
    const case_options options = default_case(SGS_CAMERA_PINHOLE);
    gradients g;
    agreement a = run_case(&scene, &options, &g);
    assert_true(agrees(&a, 1e-4, 1e-4));
    double *kept = oracle_memory(g.count * SGS_PARAM_COUNT, sizeof *kept);
    memcpy(kept, g.actual, g.count * SGS_PARAM_COUNT * sizeof *kept);
    for (int group = 0; group < GROUP_COUNT; ++group) {
        for (int kind = 0; kind < PLANT_COUNT; ++kind) {
            const bool single = group_begin[group + 1] - group_begin[group] == 1;
            if ((kind == PLANT_TRANSPOSED && group != 1) || (kind == PLANT_SWAPPED && single))
                continue;
            memcpy(g.actual, kept, g.count * SGS_PARAM_COUNT * sizeof *kept);
            if (kind == PLANT_ONE_PRIMITIVE)
                plant_one(&g, group);
            else
                plant_error(&g, (plant)kind, group);
            a = compare_gradients(&g);
            if (agrees(&a, 1e-4, 1e-4))
                fail_msg("planted error %d in %s passes", kind, group_names[group]);
        }
    }
    free(kept);
    gradients_free(&g);
    oracle_scene_free(&scene);
}

// ---- A complete step ----

typedef struct step_state {
    oracle_scene scene;
    traced_view traced;
    float *m, *v, *gradient_sum, *depth_bound, *radius_max;
    uint32_t *visible_count;
    sgsi_planes d;
} step_state;

static void train_like_step(step_state *s, int step)
{
    const sgs_gaussians *model = s->scene.model;
    assert_int_equal(sgsi_tracer_project(s->traced.tracer, model, &s->traced.view, s->visible_count,
                                         s->radius_max),
                     SGS_STATUS_OK);
    assert_int_equal(sgsi_tracer_commit(s->traced.tracer, step == 0, SGSI_BVH_REFIT),
                     SGS_STATUS_OK);
    assert_int_equal(sgsi_tracer_forward(s->traced.tracer, &s->traced.view, &s->traced.planes,
                                         s->depth_bound, true),
                     SGS_STATUS_OK);
    assert_int_equal(sgsi_tracer_backward(s->traced.tracer, &s->traced.view, &s->traced.planes,
                                          s->d.color, s->d.transmittance),
                     SGS_STATUS_OK);
    const sgsi_optimize input = {.params = model->data,
                                 .m = s->m,
                                 .v = s->v,
                                 .count = model->count,
                                 .view = s->traced.view,
                                 .sums = sgsi_tracer_grad_sums(s->traced.tracer),
                                 .touched = sgsi_tracer_touched(s->traced.tracer),
                                 .apply = true,
                                 .lr_mean = 1e-5f,
                                 .lr_rotation = 1e-4f,
                                 .lr_scale = 1e-4f,
                                 .lr_opacity = 1e-3f,
                                 .lr_dc = 1e-3f,
                                 .lr_rest = 1e-4f,
                                 .beta1 = 0.9f,
                                 .beta2 = 0.999f,
                                 .epsilon = 1e-15f,
                                 .correction1 = 1,
                                 .correction2 = 1,
                                 .gradient_sum = s->gradient_sum,
                                 .tan_half_x = 0.5f,
                                 .tan_half_y = 0.4f};
    const size_t blocks = (model->count + SGS_LANES - 1) / SGS_LANES;
    assert_int_equal(sgsi_optimize_blocks(&input, 0, blocks).broken, 0);
}

static void repeated_steps_allocate_nothing(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 3; ++threads) {
        sgsi_threads_set(threads);
        step_state s = {.scene = oracle_random_model(46, 2000, NULL)};
        const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 120, 90);
        const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
        s.traced = traced_create(s.scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        s.d = traced_planes_create(camera.width, camera.height);
        for (size_t i = 0; i < 4 * s.d.stride * (size_t)s.d.height; ++i)
            s.d.color[0][i] = 1e-3f * (float)(sgsi_random_uniform(6, i) - 0.5);
        const size_t capacity = s.scene.model->capacity;
        s.m = sgsi_calloc(capacity * SGS_PARAM_COUNT, sizeof *s.m);
        s.v = sgsi_calloc(capacity * SGS_PARAM_COUNT, sizeof *s.v);
        s.gradient_sum = sgsi_calloc(capacity, sizeof *s.gradient_sum);
        s.radius_max = sgsi_calloc(capacity, sizeof *s.radius_max);
        s.visible_count = sgsi_calloc(capacity, sizeof *s.visible_count);
        s.depth_bound = sgsi_calloc(4096, sizeof *s.depth_bound);
        for (int i = 0; i < 4096; ++i)
            s.depth_bound[i] = INFINITY;
        for (int step = 0; step < 2; ++step)
            train_like_step(&s, step);
        const size_t before = sgsi_allocation_count();
        for (int step = 2; step < 12; ++step)
            train_like_step(&s, step);
        const size_t made = sgsi_allocation_count() - before;
        print_message("%d threads: %zu allocations in ten steps\n", threads, made);
        assert_int_equal(made, 0);
        void *const arrays[] = {s.m,          s.v, s.gradient_sum, s.radius_max, s.visible_count,
                                s.depth_bound};
        for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
            sgsi_free(arrays[i]);
        traced_planes_free(&s.d);
        traced_destroy(&s.traced);
        oracle_scene_free(&s.scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(gradients_equal_the_oracle_on_every_isa_lens_and_filter,
                                  traced_restore),
        cmocka_unit_test(colour_and_transmittance_gradients_equal_the_oracle_separately),
        cmocka_unit_test(gradients_equal_the_oracle_for_each_sh_degree),
        cmocka_unit_test(gradients_equal_the_oracle_in_opaque_scenes),
        cmocka_unit_test_teardown(gradients_equal_the_oracle_where_rays_end_at_small_primitives,
                                  traced_restore),
        cmocka_unit_test(gradients_equal_the_oracle_inside_the_scene),
        cmocka_unit_test(gradients_equal_the_oracle_far_from_the_origin),
        cmocka_unit_test(comparison_detects_planted_errors),
        cmocka_unit_test_teardown(repeated_steps_allocate_nothing, traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
