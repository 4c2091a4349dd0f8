// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Synthetic bench scenes, reproducible by seed. They imitate a trained model seen from a training
// view: thin discs cover the surfaces, with sizes that follow the pixel grid because densification
// works in screen space, including surfaces hidden from this view; the background is a shell of
// large, distant primitives; a few floaters are in between; half of the primitives are nearly
// transparent. Primitives are drawn per direction: a ray of the middle camera, spread slightly
// beyond its image, is intersected with spheres, a floor and a wall, and one of the intersections
// is chosen at random.

#include <math.h>
#include <string.h>

#include "base/sh.h"
#include "base/core.h"
#include "sparegs/bench.h"
#include "base/threads.h"

typedef struct recipe {
    const char *name, *text;
    size_t count;
    double pixels;     // median standard deviation of a disc, in pixels
    int width, height; // pixels
    bool by_name_only; // takes minutes or gigabytes
} recipe;

static const recipe recipes[] = {
    {"sparse-32k", "32 thousand primitives, typical of a short training run at low resolution",
     32768, 6.0, 800, 608, false},
    {"dense-500k", "500 thousand primitives, typical of a full training run", 500000, 1.75, 800,
     608, false},
    {"dense-2m",
     "2 million primitives, mostly hidden: about 300 hits per ray without early termination",
     2000000, 1.38, 800, 608, false},
    {"dense-1m-1.3mp", "1 million primitives and 1.3 megapixels, a full training run at full size",
     1000000, 2.0, 1312, 992, true},
    {"dense-1m-8mp", "1 million primitives and 8 megapixels", 1000000, 5.0, 3232, 2464, true},
    {"dense-2m-8mp", "2 million primitives and 8 megapixels", 2000000, 3.5, 3232, 2464, true},
    {"dense-5m", "5 million primitives and 1.3 megapixels, about 5 GB of memory", 5000000, 1.38,
     1312, 992, true},
    {"dense-5m-8mp", "5 million primitives and 8 megapixels, about 7 GB of memory", 5000000, 3.4,
     3232, 2464, true},
};

enum { RECIPE_COUNT = sizeof recipes / sizeof *recipes, DRAWS = 128, SPHERES = 6 };

static const double focal_per_width = 0.85, floor_y = 0.0, wall_radius = 6.0, wall_height = 2.4,
                    shell_radius = 60.0;
static const double camera_radius = 4.6, camera_y = -1.5, target_y = -0.5;
// x, y, z, radius; y points down
static const double spheres[SPHERES][4] = {{0, -0.7, 0, 0.7},         {-1.3, -0.45, 0.4, 0.45},
                                           {1.2, -0.5, -0.3, 0.5},    {0.5, -0.3, -1.4, 0.3},
                                           {-0.7, -0.25, -1.2, 0.25}, {2.2, -0.9, 1.6, 0.9}};

const char *sgs_bench_scene_name(size_t index)
{
    return index < RECIPE_COUNT ? recipes[index].name : NULL;
}

const char *sgs_bench_scene_text(size_t index)
{
    return index < RECIPE_COUNT ? recipes[index].text : NULL;
}

bool sgs_bench_scene_by_name_only(size_t index)
{
    return index < RECIPE_COUNT && recipes[index].by_name_only;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; ++k)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static void normalize(double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; ++k)
        v[k] /= length;
}

// Pose of the camera at `angle` on the arc (radians from the middle camera), looking at the scene.
static sgs_pose arc_pose(double angle)
{
    const double down[3] = {0, 1, 0},
                 center[3] = {camera_radius * sin(angle), camera_y, -camera_radius * cos(angle)};
    double right[3], below[3], forward[3] = {-center[0], target_y - center[1], -center[2]};
    normalize(forward);
    cross(down, forward, right);
    normalize(right);
    cross(forward, right, below);
    sgs_pose pose;
    for (int k = 0; k < 3; ++k) {
        pose.rotation[k] = right[k];
        pose.rotation[3 + k] = below[k];
        pose.rotation[6 + k] = forward[k];
    }
    for (int row = 0; row < 3; ++row)
        pose.translation[row] =
            -(pose.rotation[3 * row] * center[0] + pose.rotation[3 * row + 1] * center[1] +
              pose.rotation[3 * row + 2] * center[2]);
    return pose;
}

typedef struct surface_point {
    double position[3], normal[3], distance;
} surface_point;

static void add_point(surface_point *points, int *count, const double origin[3],
                      const double direction[3], double t, const double center[3])
{
    surface_point *p = &points[(*count)++];
    p->distance = t;
    for (int k = 0; k < 3; ++k) {
        p->position[k] = origin[k] + t * direction[k];
        p->normal[k] = p->position[k] - center[k];
    }
    normalize(p->normal);
}

// Near and far intersection with a sphere, or with a vertical cylinder if `upright`. False if
// missed.
static bool intersect_round(const double origin[3], const double direction[3],
                            const double center[3], double radius, bool upright, double t[2])
{
    double a = 0, b = 0, c = -radius * radius;
    for (int k = 0; k < 3; ++k) {
        if (upright && k == 1)
            continue;
        const double to = origin[k] - center[k];
        a += direction[k] * direction[k];
        b += direction[k] * to;
        c += to * to;
    }
    const double root = b * b - a * c;
    if (root <= 0)
        return false;
    t[0] = (-b - sqrt(root)) / a;
    t[1] = (-b + sqrt(root)) / a;
    return t[1] > 0;
}

// All intersections of a ray with the scene except the shell.
static int intersect_surfaces(const double origin[3], const double direction[3],
                              surface_point points[2 * SPHERES + 2])
{
    int count = 0;
    double t[2];
    for (int s = 0; s < SPHERES; ++s)
        if (intersect_round(origin, direction, spheres[s], spheres[s][3], false, t)) {
            add_point(points, &count, origin, direction, t[0], spheres[s]);
            add_point(points, &count, origin, direction, t[1], spheres[s]);
        }
    const double axis[3] = {0, 0, 0};
    if (intersect_round(origin, direction, axis, wall_radius, true, t)) {
        const double y = origin[1] + t[1] * direction[1];
        if (y < floor_y && y > -wall_height)
            add_point(points, &count, origin, direction, t[1], (double[3]){0, y, 0});
    }
    const double down = (floor_y - origin[1]) / direction[1];
    if (direction[1] > 0 && down > 0) {
        const double x = origin[0] + down * direction[0], z = origin[2] + down * direction[2];
        if (x * x + z * z < wall_radius * wall_radius)
            add_point(points, &count, origin, direction, down, (double[3]){x, 1.0, z});
    }
    return count;
}

// Random numbers of one primitive.
typedef struct dice {
    uint64_t seed, counter;
} dice;

static double uniform(dice *d)
{
    return sgsi_random_uniform(d->seed, d->counter++);
}

static double normal(dice *d)
{
    d->counter += 2;
    return sgsi_random_normal(d->seed, d->counter - 2);
}

// A disc facing along `axis`, rotated by `turn` around it.
static void set_rotation(float params[SGS_PARAM_COUNT], const double axis[3], double turn)
{
    const double other[3] = {fabs(axis[0]) < 0.7, fabs(axis[0]) >= 0.7, 0};
    double u[3], v[3], quaternion[4];
    cross(axis, other, u);
    normalize(u);
    cross(axis, u, v);
    sgs_pose frame = {{0}, {0}};
    for (int k = 0; k < 3; ++k) { // columns
        frame.rotation[3 * k] = cos(turn) * u[k] + sin(turn) * v[k];
        frame.rotation[3 * k + 1] = cos(turn) * v[k] - sin(turn) * u[k];
        frame.rotation[3 * k + 2] = axis[k];
    }
    sgs_pose_quaternion(&frame, quaternion);
    for (int k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] = (float)quaternion[k];
}

// Colour waves over the position, and faint view dependence in all SH bands.
static void set_color(float params[SGS_PARAM_COUNT], const double position[3], double frequency,
                      dice *d)
{
    for (int c = 0; c < 3; ++c) {
        const double wave =
            sin(frequency * position[c] + 2.0 * c) * cos(frequency * position[(c + 1) % 3] + c);
        const double color = fmin(fmax(0.5 + 0.35 * wave + 0.05 * normal(d), 0.02), 0.98);
        params[SGS_PARAM_SH_DC + c] = (float)((color - 0.5) / SGSI_SH_C0);
    }
    for (int k = SGS_PARAM_SH_REST; k < SGS_PARAM_COUNT; ++k)
        params[k] = (float)(0.02 * normal(d));
}

typedef struct scene_job {
    sgs_gaussians *model;
    const recipe *recipe;
    uint64_t seed;
    double focal;  // pixels
    sgs_pose pose; // of the middle camera
    double origin[3];
} scene_job;

static void draw_ray(const scene_job *job, dice *d, double direction[3])
{
    const double spread = 1.12;
    const double x = spread * (uniform(d) - 0.5) * job->recipe->width / job->focal,
                 y = spread * (uniform(d) - 0.5) * job->recipe->height / job->focal;
    for (int k = 0; k < 3; ++k)
        direction[k] =
            job->pose.rotation[k] * x + job->pose.rotation[3 + k] * y + job->pose.rotation[6 + k];
    normalize(direction);
}

static void make_primitive(const scene_job *job, size_t i)
{
    dice d = {job->seed ^ 0xBE9C4, DRAWS * (uint64_t)i};
    surface_point points[2 * SPHERES + 2], point;
    double direction[3];
    draw_ray(job, &d, direction);
    const double kind = uniform(&d), pick = uniform(&d);
    const int found = intersect_surfaces(job->origin, direction, points);
    double thin = 0.12, grow = 1.0, rough = 0.012, frequency = 3.0;
    const bool floats = kind < 0.015;
    if (floats) { // floater: in front of the wall, nearly round, faint
        int one = 0;
        add_point(&point, &one, job->origin, direction, 0.8 + 7.0 * pick, job->origin);
        thin = 0.7;
        grow = 1.5;
    } else if (!found || kind < 0.15) { // shell
        const double radius = shell_radius * (0.7 + 0.6 * pick);
        int one = 0;
        add_point(&point, &one, job->origin, direction, radius, job->origin);
        thin = 0.3;
        grow = 1.6;
        rough = 0.02;
        frequency = 0.08;
    } else {
        point = points[(int)(pick * found)];
    }
    const double offset = rough * point.distance * normal(&d);
    const double size = grow * job->recipe->pixels * point.distance / job->focal;
    float params[SGS_PARAM_COUNT];
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_MEAN + k] = (float)(point.position[k] + offset * point.normal[k]);
    set_rotation(params, point.normal, 6.283185307179586 * uniform(&d));
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] = (float)(log(size * (k == 2 ? thin : 1.0)) + 0.5 * normal(&d));
    const bool faint = uniform(&d) < 0.49 || floats;
    const double strength = uniform(&d);
    const double opacity = faint ? 0.01 * pow(10.0, strength) : 0.1 + 0.89 * strength;
    params[SGS_PARAM_OPACITY] = (float)log(opacity / (1.0 - opacity));
    set_color(params, point.position, frequency, &d);
    sgs_gaussians_set(job->model, i, params);
}

static void make_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    for (size_t i = begin; i < end; ++i)
        make_primitive(context, i);
}

sgs_status sgs_bench_scene_create(const char *name, uint64_t seed, sgs_bench_scene **scene)
{
    *scene = NULL;
    const recipe *chosen = NULL;
    for (int i = 0; i < RECIPE_COUNT; ++i)
        if (!strcmp(recipes[i].name, name))
            chosen = &recipes[i];
    if (!chosen)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown benchmark scene '%s'", name);
    sgs_bench_scene *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a benchmark scene");
    sgs_status status = sgs_gaussians_create(chosen->count, &made->model);
    if (!status)
        status = sgs_gaussians_resize(made->model, chosen->count);
    if (status) {
        sgs_bench_scene_destroy(made);
        return status;
    }
    made->name = chosen->name;
    made->model->sh_degree = 3;
    made->view_count = SGS_BENCH_VIEWS;
    const int width = chosen->width, height = chosen->height;
    const double focal = focal_per_width * width;
    static char *const view_names[SGS_BENCH_VIEWS] = {"left", "middle", "right"};
    for (int v = 0; v < SGS_BENCH_VIEWS; ++v) {
        made->views[v].name = view_names[v];
        made->views[v].camera = (sgs_camera){
            SGS_CAMERA_PINHOLE, width, height, {focal, focal, width / 2.0, height / 2.0}};
        made->views[v].pose = arc_pose(0.15 * (v - 1));
    }
    scene_job job = {
        .model = made->model, .recipe = chosen, .seed = seed, .focal = focal, .pose = arc_pose(0)};
    sgs_pose_center(&job.pose, job.origin);
    sgsi_parallel_ranges(chosen->count, 4096, make_range, &job);
    *scene = made;
    return SGS_STATUS_OK;
}

void sgs_bench_scene_destroy(sgs_bench_scene *scene)
{
    if (!scene)
        return;
    sgs_gaussians_destroy(scene->model);
    sgsi_free(scene);
}
