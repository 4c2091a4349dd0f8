// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// FLIP, the difference evaluator for images seen in alternation (Andersson, Nilsson,
// Akenine-Moller, Oskarsson, Astrom and Fairchild, "FLIP: A Difference Evaluator for Alternating
// Images", HPG 2020), for low dynamic range:
//
// 1. Both images go from sRGB to YCxCz and through contrast sensitivity filters (section 4.1).
// 2. Filtered colours go to L*a*b* with Hunt's adjustment; their HyAB distance to the power 0.7 is
//    mapped to [0, 1] (section 4.1.3).
// 3. Edges and points of the unfiltered luminance are found by derivatives of a Gaussian; their
//    difference amplifies the colour error (sections 4.2 and 4.3): error = colour^(1 - feature).
//
// All filters are separable and repeat the border pixel. Computed in double, row by row, so the
// result does not depend on the number of threads.

#include "sparegs/metrics.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "image/mask.h"

#define PI 3.14159265358979323846

enum {
    MAX_RADIUS = 512,
    TAPS = 2 * MAX_RADIUS + 1,
    COLOR_FILTERS = 4,   // Y, Cx, and the two Gaussians of Cz
    FEATURE_FILTERS = 3, // Gaussian, its first and its second derivative
};

static const double reference_white[3] = {0.950428545, 1.0, 1.088900371}; // D65

typedef struct filters {
    int color_radius, feature_radius;
    double color[COLOR_FILTERS][TAPS];
    double feature[FEATURE_FILTERS][TAPS];
} filters;

typedef struct flip_job {
    int width, height;
    const sgs_image8 *images[2];
    const uint16_t *valid_mask;
    filters filters;
    double *ycxcz[2];    // [3][height][width]
    double *rows[2];     // [COLOR_FILTERS + FEATURE_FILTERS][height][width]: filtered along x
    double color_max;    // HyAB distance of green and blue to the power 0.7
    float *map;          // [height][width]
    double decoded[256]; // sRGB to linear
} flip_job;

static const double to_xyz[9] = {
    10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0,
    2613072.0 / 12288897.0,  8788810.0 / 12288897.0, 887015.0 / 12288897.0,
    1425312.0 / 73733382.0,  8788810.0 / 73733382.0, 70074185.0 / 73733382.0};

static void multiply(const double matrix[9], const double in[3], double out[3])
{
    for (int i = 0; i < 3; ++i)
        out[i] = matrix[3 * i] * in[0] + matrix[3 * i + 1] * in[1] + matrix[3 * i + 2] * in[2];
}

// Adjugate over determinant of to_xyz.
static void xyz_to_linear(const double xyz[3], double linear[3])
{
    const double *m = to_xyz;
    const double inverse[9] = {
        m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
        m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
        m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    const double determinant = m[0] * inverse[0] + m[1] * inverse[3] + m[2] * inverse[6];
    multiply(inverse, xyz, linear);
    for (int i = 0; i < 3; ++i)
        linear[i] /= determinant;
}

static double lab_curve(double t)
{
    const double delta = 6.0 / 29.0;
    return t > delta * delta * delta ? cbrt(t) : t / (3.0 * delta * delta) + 4.0 / 29.0;
}

// L*a*b* with Hunt's adjustment: chroma fades with luminance.
static void linear_to_hunt_lab(const double linear[3], double lab[3])
{
    double xyz[3], f[3];
    multiply(to_xyz, linear, xyz);
    for (int i = 0; i < 3; ++i)
        f[i] = lab_curve(xyz[i] / reference_white[i]);
    lab[0] = 116.0 * f[1] - 16.0;
    lab[1] = 0.01 * lab[0] * 500.0 * (f[0] - f[1]);
    lab[2] = 0.01 * lab[0] * 200.0 * (f[1] - f[2]);
}

static double hyab(const double a[3], const double b[3])
{
    return fabs(a[0] - b[0]) + hypot(a[1] - b[1], a[2] - b[2]);
}

static double largest_color_distance(void)
{
    const double green[3] = {0, 1, 0}, blue[3] = {0, 0, 1};
    double a[3], b[3];
    linear_to_hunt_lab(green, a);
    linear_to_hunt_lab(blue, b);
    return pow(hyab(a, b), 0.7);
}

// Contrast sensitivity as sums of Gaussians, x in degrees (table 1 of the paper).
static void make_color_filters(filters *f, double pixels_per_degree)
{
    static const double a[COLOR_FILTERS] = {1.0, 1.0, 34.1, 13.5},
                        b[COLOR_FILTERS] = {0.0047, 0.0053, 0.04, 0.025};
    const int radius = f->color_radius;
    double sum[COLOR_FILTERS] = {0};
    for (int x = -radius; x <= radius; ++x) {
        const double degrees = x / pixels_per_degree;
        for (int k = 0; k < COLOR_FILTERS; ++k) {
            // Along one axis a filter carries the root of its amplitude.
            const double w =
                sqrt(a[k] * sqrt(PI / b[k])) * exp(-PI * PI * degrees * degrees / b[k]);
            f->color[k][radius + x] = w;
            sum[k] += w;
        }
    }
    const double cz = hypot(sum[2], sum[3]); // both Gaussians of Cz together have weight 1
    for (int k = 0; k < COLOR_FILTERS; ++k)
        for (int x = 0; x <= 2 * radius; ++x)
            f->color[k][x] /= k < 2 ? sum[k] : cz;
}

// The positive weights of a derivative sum to 1, the negative ones to -1.
static void make_feature_filters(filters *f, double sigma)
{
    const int radius = f->feature_radius;
    double sum = 0.0, positive[2] = {0}, negative[2] = {0};
    for (int x = -radius; x <= radius; ++x) {
        const double g = exp(-x * x / (2.0 * sigma * sigma));
        const double derivative[2] = {-x * g, (x * x / (sigma * sigma) - 1.0) * g};
        f->feature[0][radius + x] = g;
        sum += g;
        for (int k = 0; k < 2; ++k) {
            f->feature[1 + k][radius + x] = derivative[k];
            *(derivative[k] > 0.0 ? &positive[k] : &negative[k]) += fabs(derivative[k]);
        }
    }
    for (int x = 0; x <= 2 * radius; ++x) {
        f->feature[0][x] /= sum;
        for (int k = 0; k < 2; ++k)
            f->feature[1 + k][x] /= f->feature[1 + k][x] > 0.0 ? positive[k] : negative[k];
    }
}

static void convert_row(void *context, size_t item, int thread)
{
    (void)thread;
    const flip_job *job = context;
    const size_t row = item % (size_t)job->height, width = (size_t)job->width,
                 plane = width * (size_t)job->height;
    const size_t which = item / (size_t)job->height;
    for (size_t x = 0; x < width; ++x) {
        const size_t at = row * width + x;
        const bool valid = sgs_mask_is_valid(job->valid_mask, job->width, (int)x, (int)row);
        double linear[3] = {0}, xyz[3];
        for (size_t c = 0; valid && c < 3; ++c)
            linear[c] = job->decoded[job->images[which]->pixels[c * plane + at]];
        multiply(to_xyz, linear, xyz);
        for (int i = 0; i < 3; ++i)
            xyz[i] /= reference_white[i];
        double *out = job->ycxcz[which] + at;
        out[0] = 116.0 * xyz[1] - 16.0;
        out[plane] = 500.0 * (xyz[0] - xyz[1]);
        out[2 * plane] = 200.0 * (xyz[1] - xyz[2]);
    }
}

static int clamp_index(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

// All seven filters along one row.
static void filter_row(void *context, size_t item, int thread)
{
    (void)thread;
    static const int channel[COLOR_FILTERS] = {0, 1, 2, 2};
    const flip_job *job = context;
    const filters *f = &job->filters;
    const size_t row = item % (size_t)job->height, which = item / (size_t)job->height;
    const size_t width = (size_t)job->width, plane = width * (size_t)job->height;
    const double *in = job->ycxcz[which] + row * width;
    double *out = job->rows[which] + row * width;
    for (int x = 0; x < job->width; ++x) {
        double sum[COLOR_FILTERS + FEATURE_FILTERS] = {0};
        for (int k = -f->color_radius; k <= f->color_radius; ++k) {
            const double *pixel = in + clamp_index(x + k, job->width);
            for (int i = 0; i < COLOR_FILTERS; ++i)
                sum[i] += f->color[i][f->color_radius + k] * pixel[(size_t)channel[i] * plane];
        }
        for (int k = -f->feature_radius; k <= f->feature_radius; ++k) {
            const double y = (in[clamp_index(x + k, job->width)] + 16.0) / 116.0;
            for (int i = 0; i < FEATURE_FILTERS; ++i)
                sum[COLOR_FILTERS + i] += f->feature[i][f->feature_radius + k] * y;
        }
        for (size_t i = 0; i < COLOR_FILTERS + FEATURE_FILTERS; ++i)
            out[i * plane + (size_t)x] = sum[i];
    }
}

// A filtered pixel of one image: colour in Hunt's L*a*b*, strength of edge and point.
typedef struct filtered {
    double lab[3], edge, point;
} filtered;

static filtered filter_down(const flip_job *job, size_t which, int x, int y)
{
    const filters *f = &job->filters;
    const size_t width = (size_t)job->width, plane = width * (size_t)job->height;
    const double *in = job->rows[which] + x;
    double color[COLOR_FILTERS] = {0}, dx = 0, dy = 0, dxx = 0, dyy = 0;
    for (int k = -f->color_radius; k <= f->color_radius; ++k) {
        const double *pixel = in + (size_t)clamp_index(y + k, job->height) * width;
        for (int i = 0; i < COLOR_FILTERS; ++i)
            color[i] += f->color[i][f->color_radius + k] * pixel[(size_t)i * plane];
    }
    for (int k = -f->feature_radius; k <= f->feature_radius; ++k) {
        const double *pixel =
            in + COLOR_FILTERS * plane + (size_t)clamp_index(y + k, job->height) * width;
        const int tap = f->feature_radius + k;
        dx += f->feature[0][tap] * pixel[plane];
        dxx += f->feature[0][tap] * pixel[2 * plane];
        dy += f->feature[1][tap] * pixel[0];
        dyy += f->feature[2][tap] * pixel[0];
    }
    const double luminance = (color[0] + 16.0) / 116.0;
    const double ratio[3] = {luminance + color[1] / 500.0, luminance,
                             luminance - (color[2] + color[3]) / 200.0};
    double xyz[3], linear[3];
    for (int i = 0; i < 3; ++i)
        xyz[i] = ratio[i] * reference_white[i];
    xyz_to_linear(xyz, linear);
    for (int i = 0; i < 3; ++i)
        linear[i] = fmin(fmax(linear[i], 0.0), 1.0);
    filtered out = {.edge = hypot(dx, dy), .point = hypot(dxx, dyy)};
    linear_to_hunt_lab(linear, out.lab);
    return out;
}

static void compare_row(void *context, size_t item, int thread)
{
    (void)thread;
    const flip_job *job = context;
    const double knee = 0.4 * job->color_max, knee_error = 0.95;
    for (int x = 0; x < job->width; ++x) {
        const filtered a = filter_down(job, 0, x, (int)item), b = filter_down(job, 1, x, (int)item);
        double color = pow(hyab(a.lab, b.lab), 0.7);
        color = color < knee
                    ? color * knee_error / knee
                    : knee_error + (color - knee) / (job->color_max - knee) * (1.0 - knee_error);
        const double feature =
            sqrt(fmax(fabs(a.edge - b.edge), fabs(a.point - b.point)) / sqrt(2.0));
        job->map[item * (size_t)job->width + (size_t)x] = (float)pow(color, 1.0 - feature);
    }
}

static double mean_error(const flip_job *job)
{
    double sum = 0.0;
    size_t count = 0;
    for (int y = 0; y < job->height; ++y)
        for (int x = 0; x < job->width; ++x) {
            float *error = &job->map[(size_t)y * (size_t)job->width + (size_t)x];
            if (sgs_mask_is_valid(job->valid_mask, job->width, x, y)) {
                sum += (double)*error;
                ++count;
            } else {
                *error = 0.0f;
            }
        }
    return count ? sum / (double)count : NAN;
}

sgs_status sgs_flip(const sgs_image8 *reference, const sgs_image8 *test, const uint16_t *valid_mask,
                    double pixels_per_degree, float *map, double *mean)
{
    *mean = NAN;
    if (!reference->pixels || !test->pixels || reference->width != test->width ||
        reference->height != test->height || reference->width < 1 || reference->height < 1 ||
        reference->channels < 3 || test->channels < 3)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "FLIP: images differ in size or lack colour");
    const double radius = ceil(3.0 * sqrt(0.04 / (2.0 * PI * PI)) * pixels_per_degree);
    if (!(pixels_per_degree > 0.0) || !(radius <= MAX_RADIUS))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "FLIP: %g pixels per degree are out of range (0, 3700]",
                         pixels_per_degree);
    flip_job *job = sgsi_calloc(1, sizeof *job);
    const size_t pixels = (size_t)reference->width * (size_t)reference->height;
    const size_t planes = 2 * (3 + COLOR_FILTERS + FEATURE_FILTERS);
    double *memory = sgsi_alloc(pixels, planes * sizeof(double) + (map ? 0 : sizeof(float)));
    if (!job || !memory) {
        sgsi_free(job);
        sgsi_free(memory);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for the FLIP error of %dx%d pixels",
                         reference->width, reference->height);
    }
    job->width = reference->width;
    job->height = reference->height;
    job->images[0] = reference;
    job->images[1] = test;
    job->valid_mask = valid_mask;
    for (size_t k = 0; k < 2; ++k) {
        job->ycxcz[k] = memory + 3 * k * pixels;
        job->rows[k] = memory + (6 + (COLOR_FILTERS + FEATURE_FILTERS) * k) * pixels;
    }
    job->map = map ? map : (float *)(memory + planes * pixels);
    job->color_max = largest_color_distance();
    for (int i = 0; i < 256; ++i)
        job->decoded[i] =
            i / 255.0 <= 0.04045 ? i / 255.0 / 12.92 : pow((i / 255.0 + 0.055) / 1.055, 2.4);
    const double sigma = 0.5 * 0.082 * pixels_per_degree;
    job->filters.color_radius = (int)radius;
    job->filters.feature_radius = (int)ceil(3.0 * sigma);
    make_color_filters(&job->filters, pixels_per_degree);
    make_feature_filters(&job->filters, sigma);
    sgsi_parallel_for(2 * (size_t)job->height, 4, convert_row, job);
    sgsi_parallel_for(2 * (size_t)job->height, 1, filter_row, job);
    sgsi_parallel_for((size_t)job->height, 1, compare_row, job);
    *mean = mean_error(job);
    sgsi_free(memory);
    sgsi_free(job);
    return SGS_STATUS_OK;
}

static double luma(const sgs_image8 *image, size_t at)
{
    const size_t plane = (size_t)image->width * (size_t)image->height;
    return 0.299 * image->pixels[at] + 0.587 * image->pixels[plane + at] +
           0.114 * image->pixels[2 * plane + at];
}

double sgs_sharpness(const sgs_image8 *render, const sgs_image8 *photo, const uint16_t *valid_mask)
{
    if (!render->pixels || !photo->pixels || render->width != photo->width ||
        render->height != photo->height || render->channels < 3 || photo->channels < 3)
        return NAN;
    const int width = photo->width, height = photo->height;
    double energy[2] = {0};
    for (int y = 1; y < height - 1; ++y)
        for (int x = 1; x < width - 1; ++x) {
            bool valid = true;
            for (int k = -1; k <= 1 && valid; ++k)
                valid = sgs_mask_is_valid(valid_mask, width, x + k, y) &&
                        sgs_mask_is_valid(valid_mask, width, x, y + k);
            const size_t at = (size_t)y * (size_t)width + (size_t)x;
            for (int k = 0; k < 2 && valid; ++k) {
                const sgs_image8 *image = k ? photo : render;
                const double laplacian = luma(image, at - 1) + luma(image, at + 1) +
                                         luma(image, at - (size_t)width) +
                                         luma(image, at + (size_t)width) - 4.0 * luma(image, at);
                energy[k] += laplacian * laplacian;
            }
        }
    return energy[1] > 0.0 ? energy[0] / energy[1] : NAN;
}
