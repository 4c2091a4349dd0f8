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
// All filters are separable and repeat the border pixel. Each thread filters tiles of the image
// whose intermediate rows stay in its cache. Computed in double; a pixel does not depend on its
// tile, so the result does not depend on the number of threads.

#include "sparegs/metrics.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "image/mask.h"

#define PI 3.14159265358979323846

enum {
    MAX_RADIUS = 500, // of the filters at MAX_PIXELS_PER_DEGREE
    MAX_PIXELS_PER_DEGREE = 3700,
    COLOR_FILTERS = 4,   // Y, Cx, and the two Gaussians of Cz
    FEATURE_FILTERS = 3, // Gaussian, its first and its second derivative
    PLANES = COLOR_FILTERS + FEATURE_FILTERS,
    TILE = 64,   // columns of a tile, and its least number of rows
    BATCH = 8,   // pixels whose sums stay in registers
    SIGNALS = 5, // of a filtered pixel: Hunt's L*a*b*, strength of edge and of point
};

static const double reference_white[3] = {0.950428545, 1.0, 1.088900371}; // D65

// Weights at distance 0 to radius. The first derivative is odd, all other filters are even.
typedef struct filters {
    int color_radius, feature_radius;
    double color[COLOR_FILTERS][MAX_RADIUS + 1];
    double feature[FEATURE_FILTERS][MAX_RADIUS + 1];
} filters;

typedef struct flip_job {
    int width, height;
    int radius, tile_rows; // of the larger filter; of a tile
    size_t tiles_across;
    const sgs_image8 *images[2];
    const uint16_t *valid_mask;
    filters filters;
    double from_xyz[9];          // XYZ to linear RGB
    double color_max;            // HyAB distance of green and blue to the power 0.7
    double converted[3][256][3]; // share of a channel's value in YCxCz
    double *scratch;             // per thread, see tile_memory
    size_t scratch_size;
    float *map;       // [height][width]
    double *row_sums; // [height], of the map
} flip_job;

static const double to_xyz[9] = {
    10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0,
    2613072.0 / 12288897.0,  8788810.0 / 12288897.0, 887015.0 / 12288897.0,
    1425312.0 / 73733382.0,  8788810.0 / 73733382.0, 70074185.0 / 73733382.0};

static inline void multiply(const double matrix[9], const double in[3], double out[3])
{
    for (int i = 0; i < 3; ++i)
        out[i] = matrix[3 * i] * in[0] + matrix[3 * i + 1] * in[1] + matrix[3 * i + 2] * in[2];
}

// Adjugate over determinant of to_xyz.
static void invert_to_xyz(double inverse[9])
{
    const double *m = to_xyz;
    const double adjugate[9] = {
        m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
        m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
        m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    const double determinant = m[0] * adjugate[0] + m[1] * adjugate[3] + m[2] * adjugate[6];
    for (int i = 0; i < 9; ++i)
        inverse[i] = adjugate[i] / determinant;
}

// Cube root of t in (0.008, 1.1] to 2e-14: a guess from the exponent bits, two steps of Halley.
static inline double cube_root(double t)
{
    const float single = (float)t;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    bits = bits / 3 + 0x2a5119f2;
    float guess;
    memcpy(&guess, &bits, sizeof guess);
    double y = (double)guess;
    for (int step = 0; step < 2; ++step) {
        const double cube = y * y * y;
        y *= (cube + 2.0 * t) / (2.0 * cube + t);
    }
    return y;
}

static inline double lab_curve(double t)
{
    const double delta = 6.0 / 29.0, knee = delta * delta * delta;
    const double line = t / (3.0 * delta * delta) + 4.0 / 29.0, root = cube_root(t);
    return t > knee ? root : line;
}

// L*a*b* with Hunt's adjustment: chroma fades with luminance.
static inline void linear_to_hunt_lab(const double linear[3], double lab[3])
{
    double xyz[3], f[3];
    multiply(to_xyz, linear, xyz);
    for (int i = 0; i < 3; ++i)
        f[i] = lab_curve(xyz[i] / reference_white[i]);
    lab[0] = 116.0 * f[1] - 16.0;
    lab[1] = 0.01 * lab[0] * 500.0 * (f[0] - f[1]);
    lab[2] = 0.01 * lab[0] * 200.0 * (f[1] - f[2]);
}

static inline double length(double x, double y)
{
    return sqrt(x * x + y * y);
}

static inline double hyab(const double a[3], const double b[3])
{
    return fabs(a[0] - b[0]) + length(a[1] - b[1], a[2] - b[2]);
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
    double sum[COLOR_FILTERS] = {0};
    for (int x = 0; x <= f->color_radius; ++x) {
        const double degrees = x / pixels_per_degree;
        for (int k = 0; k < COLOR_FILTERS; ++k) {
            // Along one axis a filter carries the root of its amplitude.
            const double w =
                sqrt(a[k] * sqrt(PI / b[k])) * exp(-PI * PI * degrees * degrees / b[k]);
            f->color[k][x] = w;
            sum[k] += x ? 2.0 * w : w;
        }
    }
    const double cz = length(sum[2], sum[3]); // both Gaussians of Cz together have weight 1
    for (int k = 0; k < COLOR_FILTERS; ++k)
        for (int x = 0; x <= f->color_radius; ++x)
            f->color[k][x] /= k < 2 ? sum[k] : cz;
}

// The positive weights of a derivative sum to 1, the negative ones to -1.
static void make_feature_filters(filters *f, double sigma)
{
    double sum = 0.0, slope = 0.0, positive = 0.0, negative = 0.0;
    for (int x = 0; x <= f->feature_radius; ++x) {
        const double g = exp(-x * x / (2.0 * sigma * sigma)), both = x ? 2.0 : 1.0;
        const double second = (x * x / (sigma * sigma) - 1.0) * g;
        f->feature[0][x] = g;
        f->feature[1][x] = x * g; // of the pixel after minus the pixel before; sign without effect
        f->feature[2][x] = second;
        sum += both * g;
        slope += x * g;
        *(second > 0.0 ? &positive : &negative) += both * fabs(second);
    }
    for (int x = 0; x <= f->feature_radius; ++x) {
        f->feature[0][x] /= sum;
        f->feature[1][x] /= slope;
        f->feature[2][x] /= f->feature[2][x] > 0.0 ? positive : negative;
    }
}

static int clamp_index(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

// TILE sums over taps that are `step` apart: w[0] p[0] + sum of w[k] (p[k] + p[-k]).
static void filter_even(const double *in, size_t step, const double *weights, int radius,
                        double *out)
{
    for (size_t x = 0; x < TILE; x += BATCH) {
        double sum[BATCH];
        for (size_t i = 0; i < BATCH; ++i)
            sum[i] = weights[0] * in[x + i];
        for (int k = 1; k <= radius; ++k) {
            const double w = weights[k], *after = in + x + (size_t)k * step,
                         *before = in + x - (size_t)k * step;
            for (size_t i = 0; i < BATCH; ++i)
                sum[i] += w * (after[i] + before[i]);
        }
        memcpy(out + x, sum, sizeof sum);
    }
}

// The same for an odd filter: sum of w[k] (p[k] - p[-k]).
static void filter_odd(const double *in, size_t step, const double *weights, int radius,
                       double *out)
{
    for (size_t x = 0; x < TILE; x += BATCH) {
        double sum[BATCH] = {0};
        for (int k = 1; k <= radius; ++k) {
            const double w = weights[k], *after = in + x + (size_t)k * step,
                         *before = in + x - (size_t)k * step;
            for (size_t i = 0; i < BATCH; ++i)
                sum[i] += w * (after[i] - before[i]);
        }
        memcpy(out + x, sum, sizeof sum);
    }
}

// The scratch memory of a thread.
typedef struct tile_memory {
    double *line;       // [3][TILE + 2 radius]: YCxCz of a row
    double *rows;       // [PLANES][tile_rows + 2 radius][TILE]: filtered along x
    double *signals[2]; // [SIGNALS][tile_rows][TILE] of an image
} tile_memory;

typedef struct tile_sizes {
    size_t line, rows, signals; // doubles
} tile_sizes;

static tile_sizes sizes_of(const flip_job *job)
{
    const size_t halo = 2 * (size_t)job->radius, tile_rows = (size_t)job->tile_rows;
    return (tile_sizes){3 * (TILE + halo), PLANES * (tile_rows + halo) * TILE,
                        SIGNALS * tile_rows * TILE};
}

static tile_memory divide_scratch(const flip_job *job, double *at)
{
    const tile_sizes size = sizes_of(job);
    double *const signals = at + size.line + size.rows;
    return (tile_memory){at, at + size.line, {signals, signals + size.signals}};
}

// A row of an image from column `x0 - radius` on as YCxCz.
static void convert_line(const flip_job *job, size_t which, int x0, int row, double *line)
{
    const size_t width = (size_t)job->width, plane = width * (size_t)job->height,
                 pitch = TILE + 2 * (size_t)job->radius;
    const uint8_t *pixels = job->images[which]->pixels + (size_t)row * width;
    for (size_t i = 0; i < pitch; ++i) {
        const int x = clamp_index(x0 - job->radius + (int)i, job->width);
        const bool valid = sgs_mask_is_valid(job->valid_mask, job->width, x, row);
        const double *part[3];
        for (size_t c = 0; c < 3; ++c)
            part[c] = job->converted[c][valid ? pixels[c * plane + (size_t)x] : 0];
        for (size_t k = 0; k < 3; ++k)
            line[k * pitch + i] = part[0][k] + part[1][k] + part[2][k];
    }
}

// All filters along a row. Those of the features see Y instead of the luminance (Y + 16) / 116;
// finish_line compensates for it.
static void filter_across(const flip_job *job, const double *line, double *out, size_t plane)
{
    static const size_t channel[COLOR_FILTERS] = {0, 1, 2, 2};
    const filters *f = &job->filters;
    const double *in = line + job->radius;
    for (size_t i = 0; i < COLOR_FILTERS; ++i)
        filter_even(in + channel[i] * (TILE + 2 * (size_t)job->radius), 1, f->color[i],
                    f->color_radius, out + i * plane);
    out += COLOR_FILTERS * plane;
    filter_even(in, 1, f->feature[0], f->feature_radius, out);
    filter_odd(in, 1, f->feature[1], f->feature_radius, out + plane);
    filter_even(in, 1, f->feature[2], f->feature_radius, out + 2 * plane);
}

enum { DX = COLOR_FILTERS, DY, DXX, DYY, SUMS }; // after the colours

// All filters down to one row.
static void filter_down(const flip_job *job, const double *in, size_t plane,
                        double sums[SUMS][TILE])
{
    const filters *f = &job->filters;
    for (size_t i = 0; i < COLOR_FILTERS; ++i)
        filter_even(in + i * plane, TILE, f->color[i], f->color_radius, sums[i]);
    const double *smooth = in + COLOR_FILTERS * plane;
    filter_even(smooth + plane, TILE, f->feature[0], f->feature_radius, sums[DX]);
    filter_even(smooth + 2 * plane, TILE, f->feature[0], f->feature_radius, sums[DXX]);
    filter_odd(smooth, TILE, f->feature[1], f->feature_radius, sums[DY]);
    filter_even(smooth, TILE, f->feature[2], f->feature_radius, sums[DYY]);
}

// Filtered YCxCz to L*a*b*, after clipping at the display's gamut.
static void finish_line(const flip_job *job, double sums[SUMS][TILE], double *out, size_t plane)
{
    for (size_t x = 0; x < TILE; ++x) {
        const double luminance = (sums[0][x] + 16.0) / 116.0;
        const double xyz[3] = {
            (luminance + sums[1][x] / 500.0) * reference_white[0], luminance * reference_white[1],
            (luminance - (sums[2][x] + sums[3][x]) / 200.0) * reference_white[2]};
        double linear[3], lab[3];
        multiply(job->from_xyz, xyz, linear);
        for (int i = 0; i < 3; ++i)
            linear[i] = linear[i] < 0.0 ? 0.0 : linear[i] > 1.0 ? 1.0 : linear[i];
        linear_to_hunt_lab(linear, lab);
        out[x] = lab[0];
        out[plane + x] = lab[1];
        out[2 * plane + x] = lab[2];
    }
    for (size_t x = 0; x < TILE; ++x) {
        out[3 * plane + x] = length(sums[DX][x], sums[DY][x]) / 116.0;
        out[4 * plane + x] = length(sums[DXX][x], sums[DYY][x]) / 116.0;
    }
}

static void filter_tile(const flip_job *job, size_t which, int x0, int y0,
                        const tile_memory *memory)
{
    const int rows = job->tile_rows + 2 * job->radius;
    const size_t plane = (size_t)rows * TILE;
    for (int r = 0; r < rows; ++r) {
        const int y = clamp_index(y0 - job->radius + r, job->height);
        convert_line(job, which, x0, y, memory->line);
        filter_across(job, memory->line, memory->rows + (size_t)r * TILE, plane);
    }
    for (int r = 0; r < job->tile_rows && y0 + r < job->height; ++r) {
        double sums[SUMS][TILE] = {{0.0}};
        filter_down(job, memory->rows + (size_t)(r + job->radius) * TILE, plane, sums);
        finish_line(job, sums, memory->signals[which] + (size_t)r * TILE,
                    (size_t)job->tile_rows * TILE);
    }
}

static void compare_tile(void *context, size_t item, int thread)
{
    const flip_job *job = context;
    const double knee = 0.4 * job->color_max, knee_error = 0.95;
    const int x0 = (int)(item % job->tiles_across) * TILE,
              y0 = (int)(item / job->tiles_across) * job->tile_rows;
    const tile_memory memory =
        divide_scratch(job, job->scratch + (size_t)thread * job->scratch_size);
    filter_tile(job, 0, x0, y0, &memory);
    filter_tile(job, 1, x0, y0, &memory);
    const size_t plane = (size_t)job->tile_rows * TILE;
    for (int y = 0; y < job->tile_rows && y0 + y < job->height; ++y)
        for (int x = 0; x < TILE && x0 + x < job->width; ++x) {
            double s[2][SIGNALS];
            for (size_t i = 0; i < 2 * SIGNALS; ++i)
                s[i / SIGNALS][i % SIGNALS] =
                    memory.signals[i / SIGNALS][i % SIGNALS * plane + (size_t)(y * TILE + x)];
            double color = pow(hyab(s[0], s[1]), 0.7);
            color = color < knee ? color * knee_error / knee
                                 : knee_error + (color - knee) / (job->color_max - knee) *
                                                    (1.0 - knee_error);
            const double edge = fabs(s[0][3] - s[1][3]), point = fabs(s[0][4] - s[1][4]);
            const double feature = sqrt((edge > point ? edge : point) / sqrt(2.0));
            job->map[(size_t)(y0 + y) * (size_t)job->width + (size_t)(x0 + x)] =
                (float)pow(color, 1.0 - feature);
        }
}

// Clears the errors of invalid pixels and sums those of a row.
static void sum_row(void *context, size_t y, int thread)
{
    (void)thread;
    const flip_job *job = context;
    double sum = 0.0;
    for (int x = 0; x < job->width; ++x) {
        float *error = &job->map[y * (size_t)job->width + (size_t)x];
        if (!sgs_mask_is_valid(job->valid_mask, job->width, x, (int)y))
            *error = 0.0f;
        sum += (double)*error;
    }
    job->row_sums[y] = sum;
}

static double mean_error(flip_job *job)
{
    const size_t count = sgsi_mask_count(job->valid_mask, job->width, job->height);
    double sum = 0.0;
    sgsi_parallel_for((size_t)job->height, 16, sum_row, job);
    for (int y = 0; y < job->height; ++y)
        sum += job->row_sums[y];
    return count ? sum / (double)count : NAN;
}

// YCxCz is an affine function of linear RGB. The red channel carries the constant.
static void make_conversion(flip_job *job)
{
    for (int v = 0; v < 256; ++v)
        for (int c = 0; c < 3; ++c) {
            const double s = v / 255.0;
            const double linear = s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4);
            double xyz[3];
            for (int i = 0; i < 3; ++i)
                xyz[i] = to_xyz[3 * i + c] * linear / reference_white[i];
            job->converted[c][v][0] = 116.0 * xyz[1] - (c ? 0.0 : 16.0);
            job->converted[c][v][1] = 500.0 * (xyz[0] - xyz[1]);
            job->converted[c][v][2] = 200.0 * (xyz[1] - xyz[2]);
        }
}

// Sizes, constants and memory. False if out of memory.
static bool prepare(flip_job *job, const sgs_image8 *reference, int color_radius,
                    int feature_radius, bool needs_map)
{
    job->width = reference->width;
    job->height = reference->height;
    job->filters.color_radius = color_radius;
    job->filters.feature_radius = feature_radius;
    job->radius = color_radius > feature_radius ? color_radius : feature_radius;
    // Rows of the halo are filtered again by the next tile: at most half of all.
    job->tile_rows = TILE + 2 * job->radius;
    job->tiles_across = ((size_t)job->width + TILE - 1) / TILE;
    job->color_max = largest_color_distance();
    invert_to_xyz(job->from_xyz);
    make_conversion(job);
    const tile_sizes size = sizes_of(job);
    job->scratch_size = size.line + size.rows + 2 * size.signals;
    const size_t threads = (size_t)sgsi_threads() * job->scratch_size, rows = (size_t)job->height,
                 pixels = (size_t)job->width * rows;
    job->scratch = sgsi_alloc(threads + rows + (needs_map ? (pixels + 1) / 2 : 0), sizeof(double));
    if (!job->scratch)
        return false;
    job->row_sums = job->scratch + threads;
    if (needs_map)
        job->map = (void *)(job->row_sums + rows);
    return true;
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
    if (!(pixels_per_degree > 0.0) || !(pixels_per_degree <= MAX_PIXELS_PER_DEGREE))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "FLIP: %g pixels per degree are out of range (0, %d]", pixels_per_degree,
                         MAX_PIXELS_PER_DEGREE);
    const double sigma = 0.5 * 0.082 * pixels_per_degree;
    flip_job *job = sgsi_calloc(1, sizeof *job);
    const bool ready = job && prepare(job, reference, (int)radius, (int)ceil(3.0 * sigma), !map);
    if (!ready) {
        sgsi_free(job);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the FLIP error of %dx%d pixels", reference->width,
                         reference->height);
    }
    job->images[0] = reference;
    job->images[1] = test;
    job->valid_mask = valid_mask;
    if (map)
        job->map = map;
    make_color_filters(&job->filters, pixels_per_degree);
    make_feature_filters(&job->filters, sigma);
    const size_t tiles_down =
        ((size_t)job->height + (size_t)job->tile_rows - 1) / (size_t)job->tile_rows;
    sgsi_parallel_for(job->tiles_across * tiles_down, 1, compare_tile, job);
    *mean = mean_error(job);
    sgsi_free(job->scratch);
    sgsi_free(job);
    return SGS_STATUS_OK;
}

// ---- Sharpness ----

typedef struct sharpness_job {
    const sgs_image8 *images[2];
    const uint16_t *valid_mask;
    // Energies, in 1e-6 squared units of a pixel, as low + 2^32 high: exact, so the order of the
    // rows does not matter.
    _Atomic uint64_t low[2], high[2];
} sharpness_job;

// 1000 times the Laplacian of the luma, of the pixels from index `at` on.
static void laplacians(const sgs_image8 *image, size_t at, size_t count, int32_t out[TILE])
{
    static const int32_t weights[3] = {299, 587, 114};
    const size_t width = (size_t)image->width, plane = width * (size_t)image->height;
    memset(out, 0, count * sizeof *out);
    for (size_t c = 0; c < 3; ++c) {
        const uint8_t *const p = image->pixels + c * plane + at, *const above = p - width,
                             *const below = p + width, *const left = p - 1, *const right = p + 1;
        for (size_t x = 0; x < count; ++x)
            out[x] += weights[c] * (left[x] + right[x] + above[x] + below[x] - 4 * p[x]);
    }
}

static bool has_valid_stencil(const uint16_t *valid_mask, int width, int x, int y)
{
    bool valid = true;
    for (int k = -1; k <= 1 && valid; ++k)
        valid = sgs_mask_is_valid(valid_mask, width, x + k, y) &&
                sgs_mask_is_valid(valid_mask, width, x, y + k);
    return valid;
}

static void add_energies(void *context, size_t row, int thread)
{
    (void)thread;
    sharpness_job *job = context;
    const size_t width = (size_t)job->images[0]->width, y = row + 1;
    for (int k = 0; k < 2; ++k) {
        uint64_t energy = 0;
        for (size_t x = 1; x + 1 < width; x += TILE) {
            const size_t count = width - 1 - x < TILE ? width - 1 - x : TILE;
            int32_t values[TILE];
            laplacians(job->images[k], y * width + x, count, values);
            for (size_t i = 0; i < count; ++i)
                if (has_valid_stencil(job->valid_mask, (int)width, (int)(x + i), (int)y))
                    energy += (uint64_t)((int64_t)values[i] * values[i]);
        }
        job->low[k] += energy & UINT32_MAX;
        job->high[k] += energy >> 32;
    }
}

double sgs_sharpness(const sgs_image8 *render, const sgs_image8 *photo, const uint16_t *valid_mask)
{
    if (!render->pixels || !photo->pixels || render->width != photo->width ||
        render->height != photo->height || render->channels < 3 || photo->channels < 3)
        return NAN;
    sharpness_job job = {.images = {render, photo}, .valid_mask = valid_mask};
    if (photo->height > 2)
        sgsi_parallel_for((size_t)photo->height - 2, 16, add_energies, &job);
    double energy[2];
    for (int k = 0; k < 2; ++k)
        energy[k] = (double)job.high[k] * 0x1p32 + (double)job.low[k];
    return energy[1] > 0.0 ? energy[0] / energy[1] : NAN;
}
