// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The eleven camera models of COLMAP 3.8 (defined by its documentation and camera_models.h),
// evaluated as one lens.
//
// Every model first maps a point to a plane vector x: (X/Z, Y/Z) for the perspective models, theta
// (X, Y)/R with R = |(X, Y)| and theta = atan2(R, Z) for the fisheye models. The lens then distorts
// it,
//     y = x g(s) + (2 p1 uv + p2 (s + 2u^2), 2 p2 uv + p1 (s + 2v^2)) + s (sx1, sy1),
// with x = (u, v), s = |x|^2 and g = N(s) / D(s), and the pixel is (fx y0 + cx, fy y1 + cy).
// Coefficients that a model lacks are 0. FOV is the exception: g = atan(2 r tan(omega / 2)) / (r
// omega), with a closed inverse.
//
// Differences from COLMAP: its fisheye models divide by Z and end at 90 degrees; here theta extends
// to 180. Its FOV model switches to Taylor series below 1e-4; atan(x)/x needs none. Its inversion
// runs a fixed number of Newton steps and never fails; here points and pixels outside the domain of
// the lens are rejected.
//
// Domain. Strong barrel distortion folds: beyond some radius y decreases again. The domain is the
// largest disc |x| < limit on which the symmetric part of the Jacobian is positive definite; on a
// convex set that makes the map injective. With h = d(r g)/dr the Jacobian of the radial part has
// the eigenvalues h (radial) and g (tangential). The tangential part adds 2 r (p e' + e p' + (p.e)
// I), e = x/r, p = (p2, p1), whose smallest eigenvalue is -6 r |p|, at e = -p/|p|. The thin prism
// adds r (t e' + e t') with smallest eigenvalue -2 r |t|. So limit is the first root of h - q r or
// of g - q r, q = 6 |p| + 2 |t|: polynomials in r.

#include "sparegs/camera.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "rays/rotation.h"

#define PI 3.14159265358979323846
#define EXACT_ROTATION 1e-12 // of poses that need no correction

enum { MAX_SIZE = 65536, MAX_DEGREE = 13 };

typedef struct lens_kind {
    const char *name;
    int param_count;
    int focal_count;
    bool fisheye;
} lens_kind;

static const lens_kind models[SGS_CAMERA_MODEL_COUNT] = {
    [SGS_CAMERA_SIMPLE_PINHOLE] = {"SIMPLE_PINHOLE", 3, 1, false},
    [SGS_CAMERA_PINHOLE] = {"PINHOLE", 4, 2, false},
    [SGS_CAMERA_SIMPLE_RADIAL] = {"SIMPLE_RADIAL", 4, 1, false},
    [SGS_CAMERA_RADIAL] = {"RADIAL", 5, 1, false},
    [SGS_CAMERA_OPENCV] = {"OPENCV", 8, 2, false},
    [SGS_CAMERA_OPENCV_FISHEYE] = {"OPENCV_FISHEYE", 8, 2, true},
    [SGS_CAMERA_FULL_OPENCV] = {"FULL_OPENCV", 12, 2, false},
    [SGS_CAMERA_FOV] = {"FOV", 5, 2, false},
    [SGS_CAMERA_SIMPLE_RADIAL_FISHEYE] = {"SIMPLE_RADIAL_FISHEYE", 4, 1, true},
    [SGS_CAMERA_RADIAL_FISHEYE] = {"RADIAL_FISHEYE", 5, 1, true},
    [SGS_CAMERA_THIN_PRISM_FISHEYE] = {"THIN_PRISM_FISHEYE", 12, 2, true},
};

typedef struct lens {
    sgs_camera_model model; // with `params`, the cache key of lens_of
    double params[12];
    bool fisheye, tangential;
    double fx, fy, cx, cy;
    double numerator[5], denominator[4]; // of g, by powers of s
    double p1, p2, sx1, sy1;
    double fov_scale, omega; // FOV: 2 tan(omega / 2), omega; fov_scale 0 for every other model
    double limit;            // radius of the domain
} lens;

static bool model_known(sgs_camera_model model)
{
    return ((int)model >= 0 && (int)model < SGS_CAMERA_MODEL_COUNT) ||
           model == SGS_CAMERA_EQUIRECTANGULAR;
}

static const lens_kind *kind_of(sgs_camera_model model)
{
    static const lens_kind equirectangular = {"EQUIRECTANGULAR", 4, 2, true};
    return model == SGS_CAMERA_EQUIRECTANGULAR ? &equirectangular : &models[model];
}

int sgs_camera_param_count(sgs_camera_model model)
{
    return model_known(model) ? kind_of(model)->param_count : 0;
}

const char *sgs_camera_model_name(sgs_camera_model model)
{
    return model_known(model) ? kind_of(model)->name : NULL;
}

bool sgs_camera_model_from_name(const char *name, sgs_camera_model *model)
{
    for (int i = 0; i < SGS_CAMERA_MODEL_COUNT; ++i) {
        if (!strcmp(models[i].name, name)) {
            *model = (sgs_camera_model)i;
            return true;
        }
    }
    return false;
}

bool sgs_camera_is_fisheye(sgs_camera_model model)
{
    return model_known(model) && kind_of(model)->fisheye;
}

sgs_status sgs_camera_validate(const sgs_camera *camera)
{
    if (!model_known(camera->model))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown camera model %d",
                         (int)camera->model);
    if (camera->width < 1 || camera->height < 1 || camera->width > MAX_SIZE ||
        camera->height > MAX_SIZE)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "camera size %d x %d is not within 1 to %d pixels", camera->width,
                         camera->height, MAX_SIZE);
    const int focal_count = kind_of(camera->model)->focal_count;
    for (int i = 0; i < kind_of(camera->model)->param_count; ++i) {
        if (!isfinite(camera->params[i]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "parameter %d of the %s camera is not finite", i + 1,
                             kind_of(camera->model)->name);
        if (i < focal_count && !(camera->params[i] > 0))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "focal length %g of the %s camera is not positive", camera->params[i],
                             kind_of(camera->model)->name);
    }
    if (camera->model == SGS_CAMERA_FOV && !(fabs(camera->params[4]) < PI))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "field-of-view parameter %g of the FOV camera is not less than pi",
                         camera->params[4]);
    return SGS_STATUS_OK;
}

// Compares bits: -0 differs from 0, and NaN equals itself.
static bool params_equal(const double *a, const double *b)
{
    // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison,cert-*)
    return !memcmp(a, b, sizeof((sgs_camera *)0)->params);
}

bool sgs_camera_equal(const sgs_camera *a, const sgs_camera *b)
{
    return a->model == b->model && a->width == b->width && a->height == b->height &&
           params_equal(a->params, b->params);
}

void sgs_camera_intrinsics(const sgs_camera *camera, double *fx, double *fy, double *cx, double *cy)
{
    const double *p = camera->params;
    const int second =
        model_known(camera->model) && kind_of(camera->model)->focal_count == 2 ? 1 : 0;
    *fx = p[0];
    *fy = p[second];
    *cx = p[second + 1];
    *cy = p[second + 2];
}

// The model with separate fx and fy that generalises a one-focal model.
static sgs_camera_model two_focal_model(sgs_camera_model model)
{
    switch (model) {
    case SGS_CAMERA_SIMPLE_PINHOLE:
        return SGS_CAMERA_PINHOLE;
    case SGS_CAMERA_SIMPLE_RADIAL:
    case SGS_CAMERA_RADIAL:
        return SGS_CAMERA_OPENCV;
    case SGS_CAMERA_SIMPLE_RADIAL_FISHEYE:
    case SGS_CAMERA_RADIAL_FISHEYE:
        return SGS_CAMERA_OPENCV_FISHEYE;
    default:
        return model;
    }
}

sgs_camera sgs_camera_resized(const sgs_camera *camera, int width, int height)
{
    sgs_camera out = *camera;
    const double sx = (double)width / camera->width, sy = (double)height / camera->height;
    const bool uniform = (long long)width * camera->height == (long long)height * camera->width;
    double *p = out.params;
    out.width = width;
    out.height = height;
    if (two_focal_model(camera->model) != camera->model) {
        if (uniform) {
            p[0] *= sx;
            p[1] *= sx;
            p[2] *= sx;
            return out;
        }
        // f, cx, cy, k... becomes fx, fy, cx, cy, k...; k1 and k2 come next in all these models.
        out.model = two_focal_model(camera->model);
        memmove(p + 1, p, 11 * sizeof *p);
    }
    p[0] *= sx;
    p[1] *= uniform ? sx : sy;
    p[2] *= sx;
    p[3] *= uniform ? sx : sy;
    return out;
}

sgs_camera sgs_camera_reframed(const sgs_camera *camera, int width, int height)
{
    sgs_camera out = *camera;
    const int focal_count = model_known(camera->model) ? kind_of(camera->model)->focal_count : 1;
    const double scale = (double)height / camera->height;
    double *p = out.params;
    for (int i = 0; i < focal_count; ++i)
        p[i] *= scale;
    p[focal_count] = (p[focal_count] - 0.5 * camera->width) * scale + 0.5 * width;
    p[focal_count + 1] *= scale;
    out.width = width;
    out.height = height;
    return out;
}

sgs_camera sgs_camera_shifted(const sgs_camera *camera, double dx, double dy)
{
    sgs_camera out = *camera;
    const int focal_count = model_known(camera->model) ? kind_of(camera->model)->focal_count : 1;
    out.params[focal_count] += dx;
    out.params[focal_count + 1] += dy;
    return out;
}

static double polynomial(const double *c, int degree, double x)
{
    double value = c[degree];
    for (int i = degree - 1; i >= 0; --i)
        value = value * x + c[i];
    return value;
}

// Sorted sign changes of a polynomial in (0, end). Between the roots of its derivative it is
// monotonic.
static int polynomial_roots(const double *c, int degree, double end, double *roots)
{
    while (degree > 0 && c[degree] == 0)
        --degree;
    if (degree == 0)
        return 0;
    double derivative[MAX_DEGREE] = {0}, cuts[MAX_DEGREE + 1];
    for (int i = 1; i <= degree; ++i)
        derivative[i - 1] = i * c[i];
    int cut_count = polynomial_roots(derivative, degree - 1, end, cuts);
    cuts[cut_count++] = end;
    int count = 0;
    double low = 0;
    for (int i = 0; i < cut_count; ++i) {
        double a = low, b = cuts[i];
        const bool sign = polynomial(c, degree, a) > 0;
        low = b;
        if ((polynomial(c, degree, b) > 0) == sign)
            continue;
        for (int step = 0; step < 200 && a < b; ++step) {
            const double middle = 0.5 * (a + b);
            if (middle <= a || middle >= b)
                break;
            *((polynomial(c, degree, middle) > 0) == sign ? &a : &b) = middle;
        }
        roots[count++] = a;
    }
    return count;
}

static double first_root(const double *c, int degree, double end)
{
    double roots[MAX_DEGREE + 1];
    return polynomial_roots(c, degree, end, roots) ? roots[0] : end;
}

// The first root of D, of (h - q r) D^2 and of (g - q r) D; see the top of the file.
static double domain_limit(const lens *l)
{
    const double end = l->fisheye ? PI : 1e6;
    const double q = 6 * hypot(l->p1, l->p2) + 2 * hypot(l->sx1, l->sy1);
    double pole[7] = {0}, fold[MAX_DEGREE + 1] = {0}, side[9] = {0};
    for (int i = 0; i < 5; ++i) {
        side[2 * i] += l->numerator[i];
        if (i < 4) {
            pole[2 * i] = l->denominator[i];
            side[2 * i + 1] -= q * l->denominator[i];
        }
        // N D + 2 s (N' D - N D') by powers of s: coefficient (1 + 2i - 2j) for N_i D_j. Only
        // FULL_OPENCV has j > 0, and it has no N_4, so the degree stays at 6.
        for (int j = 0; j < 4 && i + j <= 6; ++j)
            fold[2 * (i + j)] += (1 + 2 * i - 2 * j) * l->numerator[i] * l->denominator[j];
    }
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j)
            fold[2 * (i + j) + 1] -= q * l->denominator[i] * l->denominator[j];
    }
    const double limit =
        fmin(first_root(pole, 6, end), fmin(first_root(fold, 13, end), first_root(side, 8, end)));
    return limit >= end && !l->fisheye ? INFINITY : limit;
}

static void lens_init(lens *l, const sgs_camera *camera)
{
    const double *p = camera->params;
    const bool known = model_known(camera->model);
    *l = (lens){.model = camera->model, .fisheye = known && kind_of(camera->model)->fisheye};
    memcpy(l->params, p, sizeof l->params);
    sgs_camera_intrinsics(camera, &l->fx, &l->fy, &l->cx, &l->cy);
    double *k = l->numerator + 1;
    l->numerator[0] = l->denominator[0] = 1;
    switch (camera->model) {
    case SGS_CAMERA_RADIAL:
    case SGS_CAMERA_RADIAL_FISHEYE:
        k[1] = p[4]; // fall through
    case SGS_CAMERA_SIMPLE_RADIAL:
    case SGS_CAMERA_SIMPLE_RADIAL_FISHEYE:
        k[0] = p[3];
        break;
    case SGS_CAMERA_OPENCV_FISHEYE:
        memcpy(k, p + 4, 4 * sizeof *k);
        break;
    case SGS_CAMERA_FULL_OPENCV:
        k[2] = p[8];
        memcpy(l->denominator + 1, p + 9, 3 * sizeof *p);
        // fall through
    case SGS_CAMERA_OPENCV:
    case SGS_CAMERA_THIN_PRISM_FISHEYE:
        k[0] = p[4];
        k[1] = p[5];
        l->p1 = p[6];
        l->p2 = p[7];
        if (camera->model == SGS_CAMERA_THIN_PRISM_FISHEYE) {
            k[2] = p[8];
            k[3] = p[9];
            l->sx1 = p[10];
            l->sy1 = p[11];
        }
        break;
    case SGS_CAMERA_FOV:
        l->omega = fabs(p[4]); // the model is even in omega
        l->fov_scale = 2 * tan(0.5 * l->omega);
        break;
    default:
        break;
    }
    l->tangential = l->p1 != 0 || l->p2 != 0 || l->sx1 != 0 || l->sy1 != 0;
    l->limit = domain_limit(l);
}

// The domain takes microseconds to find, a projection nanoseconds: each thread caches its last
// lens.
static const lens *lens_of(const sgs_camera *camera)
{
    static _Thread_local lens memo = {.model = SGS_CAMERA_MODEL_COUNT};
    if (memo.model != camera->model || !params_equal(memo.params, camera->params))
        lens_init(&memo, camera);
    return &memo;
}

// g and dg/ds at s.
static double radial_factor(const lens *l, double s, double *slope)
{
    const double *n = l->numerator, *d = l->denominator;
    const double num = (((n[4] * s + n[3]) * s + n[2]) * s + n[1]) * s + n[0];
    const double num_slope = ((4 * n[4] * s + 3 * n[3]) * s + 2 * n[2]) * s + n[1];
    if (l->model != SGS_CAMERA_FULL_OPENCV) {
        *slope = num_slope;
        return num;
    }
    const double den = ((d[3] * s + d[2]) * s + d[1]) * s + d[0];
    const double den_slope = (3 * d[3] * s + 2 * d[2]) * s + d[1];
    *slope = (num_slope - num / den * den_slope) / den;
    return num / den;
}

// y(x) and its Jacobian, row-major.
static void distort(const lens *l, const double x[2], double y[2], double jacobian[4])
{
    const double u = x[0], v = x[1], s = u * u + v * v;
    double slope;
    const double g = radial_factor(l, s, &slope);
    y[0] = u * g + 2 * l->p1 * u * v + l->p2 * (s + 2 * u * u) + l->sx1 * s;
    y[1] = v * g + 2 * l->p2 * u * v + l->p1 * (s + 2 * v * v) + l->sy1 * s;
    const double mixed = 2 * u * v * slope + 2 * l->p1 * u + 2 * l->p2 * v;
    jacobian[0] = g + 2 * u * u * slope + 2 * l->p1 * v + 6 * l->p2 * u + 2 * l->sx1 * u;
    jacobian[1] = mixed + 2 * l->sx1 * v;
    jacobian[2] = mixed + 2 * l->sy1 * u;
    jacobian[3] = g + 2 * v * v * slope + 2 * l->p2 * u + 6 * l->p1 * v + 2 * l->sy1 * v;
}

static double fov_factor(const lens *l, double r)
{
    const double x = r * l->fov_scale;
    const double per_omega = l->omega > 0 ? l->fov_scale / l->omega : 1;
    return per_omega * (x > 0 ? atan(x) / x : 1);
}

// ---- Equirectangular: longitude and latitude as image axes. No inversion needed. ----

sgs_camera sgs_camera_equirectangular(int width, int height)
{
    return (sgs_camera){SGS_CAMERA_EQUIRECTANGULAR,
                        width,
                        height,
                        {width / (2 * PI), height / PI, 0.5 * width, 0.5 * height}};
}

static bool project_around(const double params[4], const double point[3], double pixel[2])
{
    const double across = hypot(point[0], point[2]);
    if (!(across > 0) && !(fabs(point[1]) > 0))
        return false;
    pixel[0] = params[0] * atan2(point[0], point[2]) + params[2];
    pixel[1] = params[1] * atan2(point[1], across) + params[3];
    return isfinite(pixel[0]) && isfinite(pixel[1]);
}

static bool unproject_around(const double params[4], const double pixel[2], double direction[3])
{
    static const double pole = 0.5 * PI * (1 + 1e-12); // rounding of the upper and lower edge
    const double longitude = (pixel[0] - params[2]) / params[0],
                 latitude = (pixel[1] - params[3]) / params[1];
    if (!isfinite(longitude) || !(fabs(latitude) <= pole))
        return false;
    direction[0] = cos(latitude) * sin(longitude);
    direction[1] = sin(latitude);
    direction[2] = cos(latitude) * cos(longitude);
    return true;
}

bool sgs_camera_project(const sgs_camera *camera, const double point[3], double pixel[2])
{
    if (!isfinite(point[0]) || !isfinite(point[1]) || !isfinite(point[2]))
        return false;
    if (camera->model == SGS_CAMERA_EQUIRECTANGULAR)
        return project_around(camera->params, point, pixel);
    const lens *l = lens_of(camera);
    const double across = hypot(point[0], point[1]);
    double scale;
    if (l->fisheye) {
        const double theta = atan2(across, point[2]);
        if (across == 0 && !(point[2] > 0))
            return false; // the azimuth is undefined on the backward axis
        scale = across > 0 ? theta / across : 1;
    } else {
        if (!(point[2] > 0))
            return false;
        scale = 1 / point[2];
    }
    const double x[2] = {point[0] * scale, point[1] * scale};
    const double r = across * scale;
    if (!(r <= l->limit))
        return false;
    double y[2], jacobian[4];
    if (l->model == SGS_CAMERA_FOV) {
        const double g = fov_factor(l, r);
        y[0] = x[0] * g;
        y[1] = x[1] * g;
    } else {
        distort(l, x, y, jacobian);
    }
    pixel[0] = l->fx * y[0] + l->cx;
    pixel[1] = l->fy * y[1] + l->cy;
    return isfinite(pixel[0]) && isfinite(pixel[1]);
}

// r with r g(r^2) = target, by Newton steps inside a bracket; bisection where Newton leaves it or
// does not end: it can jump between two points while the bracket barely shrinks.
static bool invert_radial(const lens *l, double target, double *r)
{
    enum { NEWTON_STEPS = 60, STEPS = 200 };
    double low = 0, high = isinf(l->limit) ? 1e6 : l->limit, slope;
    if (!(high * radial_factor(l, high * high, &slope) >= target))
        return false;
    double x = fmin(target, high);
    for (int step = 0; step < STEPS; ++step) {
        const double g = radial_factor(l, x * x, &slope);
        const double error = x * g - target;
        *(error > 0 ? &high : &low) = x;
        if (fabs(error) <= 2e-16 * target)
            break;
        const double h = g + 2 * x * x * slope;
        double next = x - error / h;
        if (h > 0 && fabs(next - x) <= 2e-16 * x && fabs(error) <= 1e-12 * target)
            break; // tiny steps near a pole do not mean convergence
        if (!(h > 0) || !(next > low && next < high) || step >= NEWTON_STEPS)
            next = 0.5 * (low + high);
        x = next;
    }
    *r = x;
    return true;
}

// x with y(x) = target, by damped Newton steps from the solution of the radial part.
static bool invert_tangential(const lens *l, const double target[2], double x[2])
{
    const double size = hypot(target[0], target[1]), goal = 1e-15 * (1 + size);
    double y[2], jacobian[4];
    distort(l, x, y, jacobian);
    double e[2] = {target[0] - y[0], target[1] - y[1]};
    double error = hypot(e[0], e[1]);
    for (int step = 0; step < 100 && error > goal; ++step) {
        const double det = jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2];
        const double dx[2] = {(jacobian[3] * e[0] - jacobian[1] * e[1]) / det,
                              (jacobian[0] * e[1] - jacobian[2] * e[0]) / det};
        double next[2], next_jacobian[4], next_error = INFINITY, share = 1;
        for (int halving = 0; halving < 40; ++halving, share *= 0.5) {
            next[0] = x[0] + share * dx[0];
            next[1] = x[1] + share * dx[1];
            if (!(hypot(next[0], next[1]) <= l->limit))
                continue;
            distort(l, next, y, next_jacobian);
            next_error = hypot(target[0] - y[0], target[1] - y[1]);
            if (next_error < error)
                break;
        }
        if (!(next_error < error))
            break;
        memcpy(x, next, sizeof next);
        memcpy(jacobian, next_jacobian, sizeof next_jacobian);
        e[0] = target[0] - y[0];
        e[1] = target[1] - y[1];
        error = next_error;
    }
    return error <= 1e-12 * (1 + size);
}

static bool undistort(const lens *l, const double target[2], double x[2])
{
    const double size = hypot(target[0], target[1]);
    double r = 0;
    if (!isfinite(size))
        return false;
    if (l->model == SGS_CAMERA_FOV) {
        const double angle = size * l->omega;
        if (!(angle < 0.5 * PI))
            return false;
        r = l->fov_scale > 0 ? tan(angle) / l->fov_scale : size;
    } else if (!invert_radial(l, size, &r)) {
        // The tangential part can extend the lens slightly beyond its radial part.
        if (!l->tangential || isinf(l->limit))
            return false;
        r = 0.999 * l->limit;
    }
    x[0] = size > 0 ? target[0] * (r / size) : 0;
    x[1] = size > 0 ? target[1] * (r / size) : 0;
    return !l->tangential || invert_tangential(l, target, x);
}

bool sgs_camera_unproject(const sgs_camera *camera, const double pixel[2], double direction[3])
{
    if (camera->model == SGS_CAMERA_EQUIRECTANGULAR)
        return unproject_around(camera->params, pixel, direction);
    const lens *l = lens_of(camera);
    const double y[2] = {(pixel[0] - l->cx) / l->fx, (pixel[1] - l->cy) / l->fy};
    double x[2];
    if (!undistort(l, y, x))
        return false;
    if (l->fisheye) {
        const double r = hypot(x[0], x[1]), scale = r > 0 ? sin(r) / r : 1;
        direction[0] = x[0] * scale;
        direction[1] = x[1] * scale;
        direction[2] = cos(r);
    } else {
        const double square = x[0] * x[0] + x[1] * x[1] + 1, scale = 1 / sqrt(square);
        if (!isfinite(square))
            return false;
        direction[0] = x[0] * scale;
        direction[1] = x[1] * scale;
        direction[2] = scale;
    }
    return isfinite(direction[0]) && isfinite(direction[1]) && isfinite(direction[2]);
}

void sgs_pose_center(const sgs_pose *pose, double center[3])
{
    const double *m = pose->rotation, *t = pose->translation;
    for (int i = 0; i < 3; ++i)
        center[i] = -(m[i] * t[0] + m[3 + i] * t[1] + m[6 + i] * t[2]);
}

// Largest entry of R R^T - I; NaN counts as infinite.
static double shear(const double r[9])
{
    double most = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const double error = fabs(r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] +
                                      r[3 * i + 2] * r[3 * j + 2] - (i == j));
            most = error <= most ? most : isnan(error) ? INFINITY : error;
        }
    return most;
}

sgs_status sgs_pose_validate(const sgs_pose *pose)
{
    double cofactors[9];
    if (!(shear(pose->rotation) <= 1e-3))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "pose.rotation is not orthonormal");
    if (sgsi_determinant(pose->rotation, cofactors) < 0)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "pose.rotation is mirrored; convert left-handed cameras to x right, y "
                         "down, z forward");
    for (int k = 0; k < 3; ++k)
        if (!isfinite(pose->translation[k]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "pose.translation is not finite");
    double center[3];
    sgs_pose_center(pose, center);
    if (!(fabs(center[0]) + fabs(center[1]) + fabs(center[2]) < SGSI_FARTHEST_CAMERA))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "camera position is out of range");
    return SGS_STATUS_OK;
}

void sgs_pose_orthonormalize(sgs_pose *pose)
{
    double *r = pose->rotation, *t = pose->translation, cofactors[9], center[3];
    if (shear(r) <= EXACT_ROTATION)
        return;
    const double det = sgsi_determinant(r, cofactors);
    for (int i = 0; i < 3; ++i)
        center[i] =
            -(cofactors[i] * t[0] + cofactors[3 + i] * t[1] + cofactors[6 + i] * t[2]) / det;
    sgsi_nearest_rotation(r);
    for (int i = 0; i < 3; ++i)
        t[i] = -(r[3 * i] * center[0] + r[3 * i + 1] * center[1] + r[3 * i + 2] * center[2]);
}

sgs_status sgs_pose_from_axes(const double axes[9], const double center[3], sgs_pose *pose)
{
    for (int i = 0; i < 3; ++i) {
        pose->translation[i] = 0;
        for (int j = 0; j < 3; ++j) {
            pose->rotation[3 * i + j] = axes[3 * j + i];
            pose->translation[i] -= axes[3 * j + i] * center[j];
        }
    }
    const sgs_status status = sgs_pose_validate(pose);
    if (!status)
        sgs_pose_orthonormalize(pose);
    return status;
}

sgs_status sgs_pose_from_quaternion(const double qvec[4], const double tvec[3], sgs_pose *pose)
{
    double largest = 0;
    for (int i = 0; i < 4; ++i) {
        if (!isfinite(qvec[i]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the rotation quaternion is not finite");
        largest = fmax(largest, fabs(qvec[i]));
    }
    if (largest == 0)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the rotation quaternion has norm 0");
    if (!isfinite(tvec[0]) || !isfinite(tvec[1]) || !isfinite(tvec[2]))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the translation is not finite");
    // Scale first: squares of very small or large components would underflow or overflow.
    double w = qvec[0] / largest, x = qvec[1] / largest, y = qvec[2] / largest,
           z = qvec[3] / largest;
    const double norm = sqrt(w * w + x * x + y * y + z * z);
    w /= norm, x /= norm, y /= norm, z /= norm;
    *pose = (sgs_pose){
        .rotation = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                     2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
        .translation = {tvec[0], tvec[1], tvec[2]},
    };
    return SGS_STATUS_OK;
}

void sgs_pose_quaternion(const sgs_pose *pose, double qvec[4])
{
    // Shepperd 1978: four times the square of each component; dividing by the largest one is safe.
    const double *m = pose->rotation;
    const double squares[4] = {1 + m[0] + m[4] + m[8], 1 + m[0] - m[4] - m[8],
                               1 - m[0] + m[4] - m[8], 1 - m[0] - m[4] + m[8]};
    const double products[4][4] = {
        {squares[0], m[7] - m[5], m[2] - m[6], m[3] - m[1]},
        {m[7] - m[5], squares[1], m[3] + m[1], m[2] + m[6]},
        {m[2] - m[6], m[3] + m[1], squares[2], m[7] + m[5]},
        {m[3] - m[1], m[2] + m[6], m[7] + m[5], squares[3]},
    };
    int best = 0;
    for (int i = 1; i < 4; ++i) {
        if (squares[i] > squares[best])
            best = i;
    }
    double norm = 0;
    for (int i = 0; i < 4; ++i)
        norm += products[best][i] * products[best][i];
    norm = copysign(sqrt(norm), products[best][0]);
    for (int i = 0; i < 4; ++i)
        qvec[i] = products[best][i] / norm;
}
