// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Camera paths around a scene.
//
// The subject is the point nearest to all viewing axes: with axes c_i + s d_i it solves
// sum (I - d_i d_i^T) (x - c_i) = 0.
//
// Up is the direction most perpendicular to the right vectors r_i of all views, because people hold
// cameras level more often than upright: the minimum of sum (u . r_i)^2 - w (u . m)^2 over unit
// vectors u, where m is the mean up vector of the views. The small weight w matters only if the
// right vectors do not determine u, for example if all views look in the same direction.
//
// An orbit covers the photographed arc: the circle without the widest gap between two neighbouring
// views, or the whole circle if that gap is less than a quarter. Its distance and height follow the
// views near each angle.
//
// The spiral is that of Mildenhall et al., "Local Light Field Fusion", 2019.

#include "cameras/camera_path.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cameras/lens_scale.h"
#include "cli/output.h"
#include "cli/progress.h"

#define PI 3.14159265358979323846

static const double SPIRAL_WIDTH = 0.15;  // at most, as a share of the distance to the subject
static const double UP_WEIGHT = 1e-3;     // w above
static const double CIRCLE_GAP = PI / 2;  // with smaller gaps the orbit is a full circle
static const double ORBIT_SIGMA = PI / 9; // of the weights of neighbouring views, radians

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

// Right and up of a view as the camera was held, by the Exif orientation of its photo.
static void held_axes(const sgs_pose *pose, int orientation, vec *right, vec *up)
{
    const vec zero = {{0, 0, 0}}, x = axis(pose, 0), y = axis(pose, 1);
    const vec left = along(zero, x, -1), above = along(zero, y, -1);
    switch (orientation) {
    case 3:
    case 4: // 2, 4, 5 and 7 are mirrored
        *right = left;
        *up = y;
        break;
    case 5:
    case 6:
        *right = above;
        *up = left;
        break;
    case 7:
    case 8:
        *right = y;
        *up = x;
        break;
    default:
        *right = x;
        *up = above;
    }
}

static vec center(const sgs_pose *pose)
{
    vec c;
    sgs_pose_center(pose, c.x);
    return c;
}

// Common geometry of the views of a scene.
typedef struct view_group {
    vec middle;    // mean centre
    vec up;        // unit
    vec target;    // the subject
    bool converge; // the subject lies in front of the views
    double spread; // mean distance from the middle
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

// Unit eigenvector of the smallest eigenvalue of a symmetric matrix, by Jacobi rotations.
static vec smallest_eigenvector(double m[3][3])
{
    double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 20; ++sweep)
        for (int p = 0; p < 2; ++p)
            for (int q = p + 1; q < 3; ++q) {
                if (fabs(m[p][q]) < 1e-300)
                    continue;
                const double angle = 0.5 * atan2(2 * m[p][q], m[q][q] - m[p][p]);
                const double c = cos(angle), s = sin(angle);
                for (int k = 0; k < 3; ++k) {
                    const double a = m[k][p], b = m[k][q];
                    m[k][p] = c * a - s * b;
                    m[k][q] = s * a + c * b;
                }
                for (int k = 0; k < 3; ++k) {
                    const double a = m[p][k], b = m[q][k], x = v[k][p], y = v[k][q];
                    m[p][k] = c * a - s * b;
                    m[q][k] = s * a + c * b;
                    v[k][p] = c * x - s * y;
                    v[k][q] = s * x + c * y;
                }
            }
    int smallest = 0;
    for (int k = 1; k < 3; ++k)
        if (m[k][k] < m[smallest][smallest])
            smallest = k;
    return unit((vec){{v[0][smallest], v[1][smallest], v[2][smallest]}});
}

// Sums over the views for find_up.
typedef struct held_sums {
    double right[3][3]; // products of the right axes
    vec up;
    size_t count;
} held_sums;

static void add_held(held_sums *sums, const sgs_pose *pose, int orientation)
{
    vec right, up;
    held_axes(pose, orientation, &right, &up);
    sums->up = along(sums->up, up, 1);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            sums->right[i][j] += right.x[i] * right.x[j];
    ++sums->count;
}

// COLMAP's up, -y, without views.
static vec find_up(const held_sums *sums)
{
    if (!sums->count)
        return (vec){{0, -1, 0}};
    const double share = 1 / (double)sums->count;
    const vec mean = along((vec){{0, 0, 0}}, sums->up, share);
    double m[3][3];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            m[i][j] = share * sums->right[i][j] - UP_WEIGHT * mean.x[i] * mean.x[j];
    const vec up = smallest_eigenvector(m);
    return dot(up, mean) < 0 ? along((vec){{0, 0, 0}}, up, -1) : up;
}

static held_sums sum_held(const sgs_scene *scene)
{
    held_sums sums = {0};
    for (size_t v = 0; v < scene->view_count; ++v)
        add_held(&sums, &scene->views[v].pose, scene->views[v].orientation);
    return sums;
}

void camera_path_up(const sgs_scene *scene, const camera_list *list, double up[3])
{
    held_sums sums = {0};
    if (scene)
        sums = sum_held(scene);
    for (size_t i = 0; !scene && i < list->count; ++i)
        add_held(&sums, &list->cameras[i].pose, list->cameras[i].orientation);
    const vec found = find_up(&sums);
    memcpy(up, found.x, sizeof found.x);
}

// Sums over the views for find_target.
typedef struct axis_sums {
    double m[3][3]; // projections off the axis
    vec b;          // projected centres
    vec axes;
    double ahead; // products of centre and axis
    size_t count;
} axis_sums;

static void add_axis(axis_sums *sums, const sgs_pose *pose)
{
    const vec c = center(pose), d = axis(pose, 2);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const double entry = (i == j) - d.x[i] * d.x[j];
            sums->m[i][j] += entry;
            sums->b.x[i] += entry * c.x[j];
        }
    sums->axes = along(sums->axes, d, 1);
    sums->ahead += dot(c, d);
    ++sums->count;
}

// The point with the least squared distance to all optical axes. False if the axes are parallel or
// it lies behind the views.
static bool find_target(const axis_sums *sums, vec *target)
{
    const double share = 1 / (double)sums->count;
    double m[3][3];
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            m[i][j] = share * sums->m[i][j];
    return solve((const double(*)[3])m, along((vec){{0, 0, 0}}, sums->b, share), target) &&
           dot(*target, sums->axes) > sums->ahead;
}

bool camera_path_target(const camera_list *list, double target[3])
{
    axis_sums sums = {0};
    vec found;
    for (size_t i = 0; i < list->count; ++i)
        add_axis(&sums, &list->cameras[i].pose);
    if (!sums.count || !find_target(&sums, &found))
        return false;
    memcpy(target, found.x, sizeof found.x);
    return true;
}

static view_group group_views(const sgs_scene *scene)
{
    const held_sums held = sum_held(scene);
    view_group group = {.up = find_up(&held)};
    axis_sums axes = {0};
    const double share = 1 / (double)scene->view_count;
    for (size_t v = 0; v < scene->view_count; ++v) {
        group.middle = along(group.middle, center(&scene->views[v].pose), share);
        add_axis(&axes, &scene->views[v].pose);
    }
    group.converge = find_target(&axes, &group.target);
    for (size_t v = 0; v < scene->view_count; ++v) {
        const vec offset = along(center(&scene->views[v].pose), group.middle, -1);
        group.spread += share * sqrt(dot(offset, offset));
    }
    return group;
}

static bool allocate(const sgs_scene *scene, const path_options *options, camera_list *list)
{
    const int count = options->count;
    *list = (camera_list){.first = options->first, .is_numbered = true};
    if (!scene->view_count) {
        fail_run("%s: no views to create a camera path from", scene->path);
        return false;
    }
    list->cameras = calloc((size_t)count, sizeof *list->cameras);
    if (!list->cameras)
        fail_run("%s: not enough memory for a path of %d cameras", scene->path, count);
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

// The lens of the path: that of the first view, or a pinhole with its vertical field of view and
// pixel aspect ratio.
static sgs_camera path_lens(const sgs_scene *scene, const path_options *options)
{
    const sgs_camera *first = &scene->views[0].camera;
    double fx, fy, cx, cy;
    if (options->keep_lens)
        return *first;
    camera_paraxial(first, &fx, &fy, &cx, &cy);
    return (sgs_camera){
        SGS_CAMERA_PINHOLE,
        first->width,
        first->height,
        {fy / camera_pixel_aspect(first), fy, 0.5 * first->width, 0.5 * first->height}};
}

// Where a view was taken: its angle around the subject, distance from the axis and height.
typedef struct station {
    double angle, radius, height;
} station;

// The stations of all views, sorted by angle, around the axis through the subject.
typedef struct orbit {
    vec subject, up, start, side; // up, start, side: orthonormal; angle 0 is along start
    station *stations;            // [count]
    size_t count;
    double first, arc; // radians: where the orbit begins, and its length
} orbit;

static int compare_stations(const void *a, const void *b)
{
    const station *x = a, *y = b;
    return (x->angle > y->angle) - (x->angle < y->angle);
}

// The photographed arc: the circle without the widest gap between neighbouring views.
static void find_arc(orbit *path)
{
    const station *s = path->stations;
    double gap = s[0].angle + 2 * PI - s[path->count - 1].angle;
    path->first = s[0].angle;
    for (size_t v = 1; v < path->count; ++v)
        if (s[v].angle - s[v - 1].angle > gap) {
            gap = s[v].angle - s[v - 1].angle;
            path->first = s[v].angle;
        }
    path->arc = 2 * PI - gap;
    if (gap < CIRCLE_GAP) {
        path->arc = 2 * PI;
        path->first = 0; // at the first view
    }
}

static bool orbit_find(const sgs_scene *scene, const view_group *group, orbit *path)
{
    const vec first = along(center(&scene->views[0].pose), group->target, -1);
    *path = (orbit){.subject = group->target, .up = group->up, .count = scene->view_count};
    path->start = unit(along(first, path->up, -dot(first, path->up)));
    path->side = cross(path->up, path->start);
    path->stations = malloc(path->count * sizeof *path->stations);
    if (!path->stations) {
        fail_run("%s: not enough memory for the stations of %zu views", scene->path, path->count);
        return false;
    }
    for (size_t v = 0; v < path->count; ++v) {
        const vec offset = along(center(&scene->views[v].pose), path->subject, -1);
        const double x = dot(offset, path->start), y = dot(offset, path->side);
        path->stations[v] = (station){atan2(y, x), hypot(x, y), dot(offset, path->up)};
    }
    qsort(path->stations, path->count, sizeof *path->stations, compare_stations);
    find_arc(path);
    return true;
}

// The camera centre at an angle. Distance and height are means over the views, weighted by the
// distance of their angles, so that the orbit stays near the photos.
static vec orbit_eye(const orbit *path, double angle)
{
    double sum = 0, radius = 0, height = 0;
    for (size_t v = 0; v < path->count; ++v) {
        const double turn = remainder(angle - path->stations[v].angle, 2 * PI);
        // With this minimum, angles far from every view use the mean of all.
        const double weight = exp(-0.5 * turn * turn / (ORBIT_SIGMA * ORBIT_SIGMA)) + 1e-6;
        sum += weight;
        radius += weight * path->stations[v].radius;
        height += weight * path->stations[v].height;
    }
    const vec hub = along(path->subject, path->up, height / sum);
    return along(along(hub, path->start, radius / sum * cos(angle)), path->side,
                 radius / sum * sin(angle));
}

bool camera_path_orbit(const sgs_scene *scene, const path_options *options, camera_list *list)
{
    if (!allocate(scene, options, list))
        return false;
    const view_group group = group_views(scene);
    orbit path;
    if (!group.converge) {
        fail_run(scene->view_count < 2
                     ? "%s: one view does not define a point to orbit; use render --spiral"
                     : "%s: the views do not look at a common point; use render --spiral",
                 scene->path);
        camera_list_free(list);
        return false;
    }
    if (!orbit_find(scene, &group, &path)) {
        camera_list_free(list);
        return false;
    }
    if (options->arc > 0) { // centred on what was photographed
        const double arc = options->arc * PI / 180;
        path.first += path.arc < 2 * PI ? 0.5 * (path.arc - arc) : 0;
        path.arc = arc;
    }
    const int count = options->count;
    const bool closed = path.arc > 2 * PI - 1e-6;
    const sgs_camera lens = path_lens(scene, options);
    for (int i = 0; i < count; ++i) {
        const double step = path.arc / (closed ? count : fmax(count - 1, 1));
        list->cameras[i].name = format_text("orbit_%05d", options->first + i);
        list->cameras[i].camera = lens;
        if (options->keep_lens)
            list->cameras[i].file_camera = scene->views[0].file_camera;
        look(&list->cameras[i], orbit_eye(&path, path.first + step * i), path.subject, path.up);
    }
    list->arc = closed ? 0 : path.arc * 180 / PI;
    free(path.stations);
    return true;
}

// The view whose centre is nearest to the mean centre.
static const sgs_view *middle_view(const sgs_scene *scene, const view_group *group)
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
    return &scene->views[nearest];
}

bool camera_path_spiral(const sgs_scene *scene, const path_options *options, camera_list *list)
{
    const int count = options->count;
    if (!allocate(scene, options, list))
        return false;
    const view_group group = group_views(scene);
    const sgs_view *base = middle_view(scene, &group);
    const vec hub = center(&base->pose), forward = axis(&base->pose, 2);
    vec right, up;
    held_axes(&base->pose, base->orientation, &right, &up);
    // Cameras at one point: the extent is that of the points.
    const double spread = group.spread > 1e-6 * scene->extent ? group.spread : 0.25 * scene->extent;
    const double ahead = group.converge ? dot(along(group.target, hub, -1), forward) : 0;
    const double distance = ahead > 0 ? ahead : 4 * spread;
    const double radius = fmin(0.5 * spread, SPIRAL_WIDTH * distance);
    const vec target = along(hub, forward, distance);
    const sgs_camera lens = path_lens(scene, options);
    for (int i = 0; i < count; ++i) {
        const double turn = 4 * PI * i / count;
        const vec eye = along(along(along(hub, right, radius * cos(turn)), up, radius * sin(turn)),
                              forward, radius * sin(0.5 * turn));
        list->cameras[i].name = format_text("spiral_%05d", options->first + i);
        list->cameras[i].camera = lens;
        if (options->keep_lens)
            list->cameras[i].file_camera = scene->views[0].file_camera;
        look(&list->cameras[i], eye, target, up);
    }
    return true;
}
