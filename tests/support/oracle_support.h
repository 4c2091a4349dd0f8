// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Scenes, cameras and comparisons for tests that use the oracle. Header only, without cmocka;
// helpers abort if out of memory. A scene holds the same model twice, as doubles for the oracle and
// as floats for the fast kernels. The doubles are exactly the floats, so all differences come from
// arithmetic.
//
// Scenes surround the origin; cameras look at it from a few units away (oracle_pose_look_at).

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/render.h"

// ---- Random numbers: one counter per stream, the same on all machines ----

typedef struct oracle_random {
    uint64_t seed, counter;
} oracle_random;

static inline double oracle_uniform(oracle_random *random, double low, double high)
{
    return low + (high - low) * sgsi_random_uniform(random->seed, random->counter++);
}

static inline double oracle_normal(oracle_random *random)
{
    const double value = sgsi_random_normal(random->seed, random->counter);
    random->counter += 2;
    return value;
}

// ---- Options ----

static inline sgs_render_options oracle_render_options(sgs_filter filter, int sh_degree,
                                                       const float *filter_3d)
{
    sgs_render_options options = sgs_render_options_default();
    options.filter = filter;
    options.sh_degree = sh_degree;
    options.filter_3d = filter_3d;
    return options;
}

// ---- Scenes ----

typedef struct oracle_scene {
    size_t count;
    double *params;       // [count][SGS_PARAM_COUNT], each value exactly a float
    float *filter_3d;     // [count], for SGS_FILTER_MIP
    sgs_gaussians *model; // the same values
} oracle_scene;

// Distribution of random primitives; lengths in world units.
typedef struct oracle_range {
    double spread;                    // means: uniform in the cube [-spread, spread]^3
    double scale_low, scale_high;     // log-uniform per axis
    double opacity_low, opacity_high; // uniform
    double sh;                        // standard deviation of the SH coefficients of the bands 1..3
} oracle_range;

static inline oracle_range oracle_range_default(void)
{
    return (oracle_range){1.0, 0.05, 0.4, 0.05, 0.95, 0.15};
}

static inline void *oracle_memory(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block)
        abort();
    return block;
}

static inline double *oracle_primitive(const oracle_scene *scene, size_t i)
{
    return scene->params + i * SGS_PARAM_COUNT;
}

static inline void oracle_set_scales(double *primitive, double x, double y, double z)
{
    primitive[SGS_PARAM_SCALE] = log(x);
    primitive[SGS_PARAM_SCALE + 1] = log(y);
    primitive[SGS_PARAM_SCALE + 2] = log(z);
}

static inline void oracle_set_mean(double *primitive, double x, double y, double z)
{
    primitive[SGS_PARAM_MEAN] = x;
    primitive[SGS_PARAM_MEAN + 1] = y;
    primitive[SGS_PARAM_MEAN + 2] = z;
}

static inline void oracle_set_opacity(double *primitive, double opacity)
{
    primitive[SGS_PARAM_OPACITY] = log(opacity / (1 - opacity));
}

// Band 0 of a colour that does not depend on direction.
static inline void oracle_set_color(double *primitive, double r, double g, double b)
{
    const double color[3] = {r, g, b};
    for (int c = 0; c < 3; ++c)
        primitive[SGS_PARAM_SH_DC + c] = (color[c] - 0.5) / 0.28209479177387814;
}

// An isotropic primitive: unit rotation, colour from band 0 only.
static inline void oracle_set_ball(double *primitive, double x, double y, double z, double scale,
                                   double opacity)
{
    memset(primitive, 0, SGS_PARAM_COUNT * sizeof *primitive);
    primitive[SGS_PARAM_ROTATION] = 1;
    oracle_set_mean(primitive, x, y, z);
    oracle_set_scales(primitive, scale, scale, scale);
    oracle_set_opacity(primitive, opacity);
    oracle_set_color(primitive, 0.8, 0.5, 0.25);
}

static inline void oracle_random_primitive(oracle_random *random, const oracle_range *range,
                                           double *primitive)
{
    for (int k = 0; k < 3; ++k) {
        primitive[SGS_PARAM_MEAN + k] = oracle_uniform(random, -range->spread, range->spread);
        primitive[SGS_PARAM_SCALE + k] =
            oracle_uniform(random, log(range->scale_low), log(range->scale_high));
        primitive[SGS_PARAM_SH_DC + k] =
            oracle_uniform(random, -2, 1.6); // colours from -0.06 to 0.95
    }
    // Not unit quaternions: normalisation is tested too.
    for (int k = 0; k < 4; ++k)
        primitive[SGS_PARAM_ROTATION + k] = oracle_normal(random);
    oracle_set_opacity(primitive, oracle_uniform(random, range->opacity_low, range->opacity_high));
    for (int k = SGS_PARAM_SH_REST; k < SGS_PARAM_COUNT; ++k)
        primitive[k] = range->sh * oracle_normal(random);
}

static inline oracle_scene oracle_scene_create(size_t count)
{
    oracle_scene scene = {.count = count};
    scene.params = oracle_memory(count * SGS_PARAM_COUNT, sizeof *scene.params);
    scene.filter_3d = oracle_memory(count, sizeof *scene.filter_3d);
    if (sgs_gaussians_create(count, &scene.model) != SGS_STATUS_OK ||
        sgs_gaussians_resize(scene.model, count) != SGS_STATUS_OK)
        abort();
    scene.model->sh_degree = 3;
    return scene;
}

// Rounds the parameters to floats, in both copies. Call after editing params.
static inline void oracle_scene_round(oracle_scene *scene)
{
    for (size_t i = 0; i < scene->count; ++i) {
        float rounded[SGS_PARAM_COUNT];
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            rounded[k] = (float)oracle_primitive(scene, i)[k];
            oracle_primitive(scene, i)[k] = rounded[k];
        }
        sgs_gaussians_set(scene->model, i, rounded);
    }
}

static inline void oracle_scene_free(oracle_scene *scene)
{
    free(scene->params);
    free(scene->filter_3d);
    sgs_gaussians_destroy(scene->model);
    *scene = (oracle_scene){0};
}

// sgs_reference_hits, which must succeed. Returns the number of hits.
static inline size_t oracle_hits(const double *params, size_t count, const sgs_camera *camera,
                                 const sgs_pose *pose, const sgs_render_options *options, int x,
                                 int y, sgs_hit *hits, size_t capacity)
{
    size_t found;
    if (sgs_reference_hits(params, count, camera, pose, options, x, y, hits, capacity, &found))
        abort();
    return found;
}

// `count` random primitives; range NULL: oracle_range_default().
static inline oracle_scene oracle_random_model(uint64_t seed, size_t count,
                                               const oracle_range *range)
{
    const oracle_range fallback = oracle_range_default();
    oracle_random random = {.seed = seed};
    oracle_scene scene = oracle_scene_create(count);
    for (size_t i = 0; i < count; ++i) {
        oracle_random_primitive(&random, range ? range : &fallback, oracle_primitive(&scene, i));
        scene.filter_3d[i] = (float)oracle_uniform(&random, 0.01, 0.1);
    }
    oracle_scene_round(&scene);
    return scene;
}

// ---- Adversarial scenes, to be viewed from (0, 0, -4) with oracle_pose_look_at() ----

typedef enum oracle_adversary {
    ORACLE_COPLANAR,   // discs 1e-3 thick in the plane z = 0: nearly equal depths on a ray
    ORACLE_NESTED,     // one mean, growing scales: each ray passes all of them near one point
    ORACLE_THIN,       // discs 1e-6 thick at any angle, also edge-on
    ORACLE_LARGE,      // 1e4 wide, mostly behind or around the camera
    ORACLE_INSIDE,     // the camera at (0, 0, -4) is inside all of them
    ORACLE_DUPLICATES, // each primitive four times, with distant ids: t equal to the last bit
    ORACLE_NEEDLES,    // 1e-4 thick, up to 10 long, some along the line of sight
    ORACLE_ADVERSARY_COUNT
} oracle_adversary;

static inline const char *oracle_adversary_name(oracle_adversary kind)
{
    static const char *const names[] = {"coplanar", "nested",     "thin",   "large",
                                        "inside",   "duplicates", "needles"};
    return names[kind];
}

static inline void oracle_adversarial_primitive(oracle_adversary kind, oracle_random *random,
                                                size_t i, double *primitive)
{
    switch (kind) {
    case ORACLE_COPLANAR: {
        const double half_turn = oracle_uniform(random, 0, 3.14159);
        primitive[SGS_PARAM_MEAN + 2] = 0;
        primitive[SGS_PARAM_ROTATION] = cos(half_turn);
        primitive[SGS_PARAM_ROTATION + 1] = primitive[SGS_PARAM_ROTATION + 2] = 0;
        primitive[SGS_PARAM_ROTATION + 3] = sin(half_turn);
        oracle_set_scales(primitive, oracle_uniform(random, 0.1, 0.6),
                          oracle_uniform(random, 0.1, 0.6), 1e-3);
        break;
    }
    case ORACLE_NESTED: {
        const double size = 0.02 * pow(1.25, (double)(i % 24));
        oracle_set_mean(primitive, 0.1, -0.05, 0.2);
        oracle_set_scales(primitive, size, 1.3 * size, 0.8 * size);
        oracle_set_opacity(primitive, 0.3);
        break;
    }
    case ORACLE_THIN:
        oracle_set_scales(primitive, oracle_uniform(random, 0.1, 0.5), 1e-6,
                          oracle_uniform(random, 0.1, 0.5));
        break;
    case ORACLE_LARGE:
        for (int k = 0; k < 3; ++k)
            primitive[SGS_PARAM_MEAN + k] *= 1e4;
        oracle_set_scales(primitive, 1e4, oracle_uniform(random, 1e3, 1e4),
                          oracle_uniform(random, 1, 1e4));
        oracle_set_opacity(primitive, oracle_uniform(random, 0.02, 0.3));
        break;
    case ORACLE_INSIDE:
        primitive[SGS_PARAM_MEAN + 2] -= 4;
        oracle_set_scales(primitive, oracle_uniform(random, 0.7, 2), oracle_uniform(random, 0.7, 2),
                          oracle_uniform(random, 0.7, 2));
        oracle_set_opacity(primitive, oracle_uniform(random, 0.02, 0.4));
        break;
    case ORACLE_NEEDLES:
        oracle_set_scales(primitive, oracle_uniform(random, 0.5, 10), 1e-4, 1e-4);
        if (i % 4 == 0) { // rotate local x to world z
            primitive[SGS_PARAM_ROTATION] = primitive[SGS_PARAM_ROTATION + 2] = 0.70710678;
            primitive[SGS_PARAM_ROTATION + 1] = primitive[SGS_PARAM_ROTATION + 3] = 0;
        }
        break;
    default:
        break;
    }
}

static inline oracle_scene oracle_adversarial_model(oracle_adversary kind, uint64_t seed,
                                                    size_t count)
{
    oracle_scene scene = oracle_random_model(seed, count, NULL);
    oracle_random random = {.seed = seed + 0x5eed};
    for (size_t i = 0; i < count; ++i)
        oracle_adversarial_primitive(kind, &random, i, oracle_primitive(&scene, i));
    const size_t originals = (count + 3) / 4;
    for (size_t i = originals; kind == ORACLE_DUPLICATES && i < count; ++i)
        memcpy(oracle_primitive(&scene, i), oracle_primitive(&scene, i % originals),
               SGS_PARAM_COUNT * sizeof(double));
    for (size_t i = originals; kind == ORACLE_DUPLICATES && i < count; ++i)
        scene.filter_3d[i] = scene.filter_3d[i % originals];
    oracle_scene_round(&scene);
    return scene;
}

// ---- Cameras ----

// PINHOLE, OPENCV or OPENCV_FISHEYE with an off-centre principal point and two focal lengths; the
// fisheye spans about 130 degrees, the others about 50.
static inline sgs_camera oracle_camera(sgs_camera_model model, int width, int height)
{
    sgs_camera camera = {.model = model, .width = width, .height = height};
    const bool fisheye = model == SGS_CAMERA_OPENCV_FISHEYE;
    camera.params[0] = (fisheye ? 0.44 : 1.06) * width;
    camera.params[1] = (fisheye ? 0.45 : 1.10) * width;
    camera.params[2] = 0.503 * width;
    camera.params[3] = 0.489 * height;
    const double opencv[4] = {-0.12, 0.03, 0.0011, -0.0007},
                 angular[4] = {0.02, -0.004, 0.001, -0.0002};
    if (model == SGS_CAMERA_OPENCV)
        memcpy(camera.params + 4, opencv, sizeof opencv);
    if (fisheye)
        memcpy(camera.params + 4, angular, sizeof angular);
    return camera;
}

static inline void oracle_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void oracle_normalize(double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; ++k)
        v[k] /= length;
}

// Camera at (x, y, z) looking at the origin, with world y down in the image. (x, y, z) must not be
// on the y axis.
static inline sgs_pose oracle_pose_look_at(double x, double y, double z)
{
    const double eye[3] = {x, y, z}, world_down[3] = {0, 1, 0};
    double forward[3] = {-x, -y, -z}, right[3], down[3];
    oracle_normalize(forward);
    oracle_cross(world_down, forward, right);
    oracle_normalize(right);
    oracle_cross(forward, right, down);
    sgs_pose pose;
    memcpy(pose.rotation, right, sizeof right);
    memcpy(pose.rotation + 3, down, sizeof down);
    memcpy(pose.rotation + 6, forward, sizeof forward);
    for (int row = 0; row < 3; ++row) {
        const double *r = pose.rotation + 3 * row;
        pose.translation[row] = -(r[0] * eye[0] + r[1] * eye[1] + r[2] * eye[2]);
    }
    return pose;
}

// ---- Far from the origin ----

// A float has steps of 1e-3 there, and no value for the centre of a camera that has moved along.
static const double oracle_far_away[3] = {1e4, -7e3, 1.3e4};

// Rounds the moved means to floats.
static inline void oracle_scene_move(oracle_scene *scene, const double offset[3])
{
    for (size_t i = 0; i < scene->count; ++i)
        for (int k = 0; k < 3; ++k)
            oracle_primitive(scene, i)[SGS_PARAM_MEAN + k] += offset[k];
    oracle_scene_round(scene);
}

static inline sgs_pose oracle_pose_move(sgs_pose pose, const double offset[3])
{
    for (int row = 0; row < 3; ++row)
        for (int k = 0; k < 3; ++k)
            pose.translation[row] -= pose.rotation[3 * row + k] * offset[k];
    return pose;
}

// ---- Comparison ----

// a - b| relative to max(|a|, |b|, scale); infinite if either is NaN, 0 if both are equal.
static inline double oracle_error(double a, double b, double scale)
{
    if (a == b)
        return 0;
    const double error = fabs(a - b) / fmax(fmax(fabs(a), fabs(b)), scale);
    return error >= 0 ? error : HUGE_VAL;
}

static inline double oracle_worst_error(const double *a, const double *b, size_t count,
                                        double scale)
{
    double worst = 0;
    for (size_t i = 0; i < count; ++i)
        worst = fmax(worst, oracle_error(a[i], b[i], scale));
    return worst;
}
