// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Paths around a scene. What the views look at is the point nearest to all their axes: with axes
// c_i + s d_i it solves sum (I - d_i d_i^T) (x - c_i) = 0. "Up" is the mean of the views' up. The
// spiral is that of Mildenhall et al., "Local Light Field Fusion", 2019.

#include "cameras/camera_path.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"

#define PI 3.14159265358979323846

static const double SPIRAL_WIDTH = 0.15; // at most, of the distance to what it looks at

typedef struct vec {
    double x[3];
} vec;

static double dot(vec a, vec b)
{
    return a.x[0] * b.x[0] + a.x[1] * b.x[1] + a.x[2] * b.x[2];
}

static vec along(vec a, vec b, double s) // a + s b
{
    return (vec){{a.x[0] + s * b.x[0], a.x[1] + s * b.x[1], a.x[2] + s * b.x[2]}};
}

static vec cross(vec a, vec b)
{
    return (vec){{a.x[1] * b.x[2] - a.x[2] * b.x[1], a.x[2] * b.x[0] - a.x[0] * b.x[2],
                  a.x[0] * b.x[1] - a.x[1] * b.x[0]}};
}

static vec unit(vec a)
{
    const double length = sqrt(dot(a, a));
    return length > 0 ? along((vec){{0, 0, 0}}, a, 1 / length) : a;
}

static vec axis(const sgs_pose *pose, int row)
{
    return (vec){
        {pose->rotation[3 * row], pose->rotation[3 * row + 1], pose->rotation[3 * row + 2]}};
}

static vec center(const sgs_pose *pose)
{
    vec c;
    sgs_pose_center(pose, c.x);
    return c;
}

// What the views of a scene have in common.
typedef struct view_group {
    vec middle, up; // means; up is a unit vector
    vec target;     // what the views look at
    bool converge;  // the target lies in front of them
    double spread;  // mean distance from the middle
} view_group;

// Solves the symmetric system m x = b by Cramer's rule; false when it is singular.
static bool solve(const double m[3][3], vec b, vec *x)
{
    const vec rows[3] = {{{m[0][0], m[0][1], m[0][2]}},
                         {{m[1][0], m[1][1], m[1][2]}},
                         {{m[2][0], m[2][1], m[2][2]}}};
    const double det = dot(rows[0], cross(rows[1], rows[2]));
    if (!(fabs(det) > 1e-9))
        return false;
    x->x[0] = dot(b, cross(rows[1], rows[2])) / det;
    x->x[1] = dot(b, cross(rows[2], rows[0])) / det;
    x->x[2] = dot(b, cross(rows[0], rows[1])) / det;
    return true;
}

static view_group group_views(const sgs_scene *scene)
{
    view_group group = {.converge = false};
    double m[3][3] = {{0}};
    vec b = {{0, 0, 0}};
    const double share = 1 / (double)scene->view_count;
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_pose *pose = &scene->views[v].pose;
        const vec c = center(pose), d = axis(pose, 2);
        group.middle = along(group.middle, c, share);
        group.up = along(group.up, axis(pose, 1), -1);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const double entry = ((i == j) - d.x[i] * d.x[j]) * share;
                m[i][j] += entry;
                b.x[i] += entry * c.x[j];
            }
    }
    group.up = unit(group.up);
    group.converge = solve((const double(*)[3])m, b, &group.target);
    double ahead = 0;
    for (size_t v = 0; v < scene->view_count; ++v) {
        const vec c = center(&scene->views[v].pose), offset = along(c, group.middle, -1);
        group.spread += share * sqrt(dot(offset, offset));
        ahead += dot(along(group.target, c, -1), axis(&scene->views[v].pose, 2));
    }
    group.converge = group.converge && ahead > 0;
    return group;
}

static bool allocate(const sgs_scene *scene, int count, camera_list *list)
{
    *list = (camera_list){0};
    if (!scene->view_count) {
        fail_run("%s: has no view to make a path from", scene->path);
        return false;
    }
    list->cameras = calloc((size_t)count, sizeof *list->cameras);
    if (!list->cameras)
        fail_run("%s: no memory for a path of %d cameras", scene->path, count);
    list->count = list->cameras ? (size_t)count : 0;
    return list->cameras != NULL;
}

// A camera at `eye` that looks at `target`.
static void look(named_camera *camera, vec eye, vec target, vec up)
{
    const vec forward = unit(along(target, eye, -1)), right = unit(cross(forward, up)),
              down = cross(forward, right);
    const vec rows[3] = {right, down, forward};
    for (int i = 0; i < 3; ++i) {
        memcpy(camera->pose.rotation + 3 * i, rows[i].x, sizeof rows[i].x);
        camera->pose.translation[i] = -dot(rows[i], eye);
    }
}

bool camera_path_orbit(const sgs_scene *scene, int count, camera_list *list)
{
    if (!allocate(scene, count, list))
        return false;
    const view_group group = group_views(scene);
    if (!group.converge) {
        fail_run(
            scene->view_count < 2
                ? "%s: has one view, which looks at no certain point to orbit; use render --spiral"
                : "%s: its views look away from each other, so there is nothing to orbit; use "
                  "render --spiral",
            scene->path);
        camera_list_free(list);
        return false;
    }
    double height = 0, radius = 0;
    for (size_t v = 0; v < scene->view_count; ++v) {
        const vec offset = along(center(&scene->views[v].pose), group.target, -1);
        const double up = dot(offset, group.up);
        height += up / (double)scene->view_count;
        radius += sqrt(fmax(dot(offset, offset) - up * up, 0)) / (double)scene->view_count;
    }
    const vec first = along(center(&scene->views[0].pose), group.target, -1);
    const vec start = unit(along(first, group.up, -dot(first, group.up))),
              side = cross(group.up, start);
    const vec hub = along(group.target, group.up, height);
    for (int i = 0; i < count; ++i) {
        const double turn = 2 * PI * i / count;
        list->cameras[i].name = format_text("orbit_%05d", i);
        list->cameras[i].camera = scene->views[0].camera;
        look(&list->cameras[i],
             along(along(hub, start, radius * cos(turn)), side, radius * sin(turn)), group.target,
             group.up);
    }
    return true;
}

// The view whose centre is nearest to the middle of all.
static const sgs_pose *middle_view(const sgs_scene *scene, const view_group *group)
{
    size_t nearest = 0;
    double least = HUGE_VAL;
    for (size_t v = 0; v < scene->view_count; ++v) {
        const vec offset = along(center(&scene->views[v].pose), group->middle, -1);
        if (dot(offset, offset) < least) {
            least = dot(offset, offset);
            nearest = v;
        }
    }
    return &scene->views[nearest].pose;
}

bool camera_path_spiral(const sgs_scene *scene, int count, camera_list *list)
{
    if (!allocate(scene, count, list))
        return false;
    const view_group group = group_views(scene);
    const sgs_pose *base = middle_view(scene, &group);
    const vec hub = center(base), right = axis(base, 0), forward = axis(base, 2);
    const vec up = along((vec){{0, 0, 0}}, axis(base, 1), -1);
    const double ahead = group.converge ? dot(along(group.target, hub, -1), forward) : 0;
    const double distance = ahead > 0 ? ahead : 4 * group.spread + 1e-6;
    const double radius = fmin(0.5 * group.spread, SPIRAL_WIDTH * distance);
    const vec target = along(hub, forward, distance);
    for (int i = 0; i < count; ++i) {
        const double turn = 4 * PI * i / count;
        const vec eye = along(along(along(hub, right, radius * cos(turn)), up, radius * sin(turn)),
                              forward, radius * sin(0.5 * turn));
        list->cameras[i].name = format_text("spiral_%05d", i);
        list->cameras[i].camera = scene->views[0].camera;
        look(&list->cameras[i], eye, target, up);
    }
    return true;
}
