// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Image quality as measured in the 3DGS papers: the render is rounded to 8 bits, as if saved as
// PNG, and compared with the 8-bit photo by PSNR and SSIM over three channels.
//
// SSIM uses the window of the training loss: 11 x 11 Gaussian, sigma 1.5, zero outside the image
// and not renormalised there, C1 = 1e-4, C2 = 9e-4 for values in [0, 1]. Its values are therefore
// slightly higher than those of tools that only use complete windows. It is computed in double
// precision by two separable passes, in strips of rows whose sums are added in order, so the result
// does not depend on the number of threads.

#include "sparegs/metrics.h"

#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "base/core.h"
#include "image/mask.h"
#include "base/threads.h"

enum { RADIUS = 5, STRIP_ROWS = 16, WINDOW_ROWS = STRIP_ROWS + 2 * RADIUS, MOMENTS = 5 };
enum { PIXELS_AT_ONCE = 1 << 16 }; // by one thread

// -------------------------------------------------------------------------------------------------
// Quantisation.

typedef struct quantise_job {
    const float *const *color;
    const float *transmittance, *background;
    size_t plane;
    uint8_t *pixels;
    bool encodes; // from linear light
} quantise_job;

// floor(clamp(255 v + 0.5, 0, 255)) in float; NaN becomes 0.
static inline uint8_t quantise(float value)
{
    const float scaled = value * 255.0f + 0.5f;
    return scaled > 0.0f ? scaled < 255.0f ? (uint8_t)scaled : 255 : 0;
}

static void quantise_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const quantise_job *job = context;
    for (int c = 0; c < 3; ++c) {
        const float background = job->background ? job->background[c] : 0.0f;
        const float *const color = job->color[c];
        uint8_t *const out = job->pixels + (size_t)c * job->plane;
        for (size_t i = begin; i < end; ++i) {
            const float value =
                job->transmittance ? color[i] + job->transmittance[i] * background : color[i];
            out[i] = quantise(job->encodes ? sgs_srgb_encode(value) : value);
        }
    }
}

sgs_status sgs_image8_from_render(const float *const color[3], const float *transmittance,
                                  const float background[3], sgs_space space, int width, int height,
                                  sgs_image8 *out)
{
    *out = (sgs_image8){0};
    if (width < 1 || height < 1 || !color || !color[0] || !color[1] || !color[2] ||
        (transmittance && !background))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "quantising an image of %d x %d pixels: a plane is missing", width,
                         height);
    const size_t plane = (size_t)width * (size_t)height;
    uint8_t *pixels = sgsi_alloc(3, plane);
    if (!pixels)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for an image of %d x %d pixels", width, height);
    quantise_job job = {color, transmittance, background, plane, pixels, space == SGS_SPACE_LINEAR};
    sgsi_parallel_ranges(plane, PIXELS_AT_ONCE, quantise_range, &job);
    *out = (sgs_image8){width, height, 3, pixels};
    return SGS_STATUS_OK;
}

sgs_status sgs_image8_from_planes(const float *const color[3], const float *transmittance,
                                  const float background[3], int width, int height, sgs_image8 *out)
{
    return sgs_image8_from_render(color, transmittance, background, SGS_SPACE_SRGB, width, height,
                                  out);
}

typedef struct flatten_job {
    const sgs_photo *photo;
    const float *background;
    float *planes;
} flatten_job;

static void flatten_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const flatten_job *job = context;
    const sgs_photo *photo = job->photo;
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    for (size_t i = begin; i < end; ++i) {
        const float alpha = photo->channels > 3 ? sgs_photo_value(photo, 3 * pixels + i) : 1.0f;
        for (size_t c = 0; c < 3; ++c)
            job->planes[c * pixels + i] = alpha * sgs_photo_value(photo, c * pixels + i) +
                                          (1.0f - alpha) * job->background[c];
    }
}

void sgs_photo_flatten(const sgs_photo *photo, const float background[3], float *planes)
{
    flatten_job job = {photo, background, planes};
    sgsi_parallel_ranges((size_t)photo->width * (size_t)photo->height, PIXELS_AT_ONCE,
                         flatten_range, &job);
}

sgs_status sgs_image8_from_photo(const sgs_photo *photo, const float background[3], sgs_space space,
                                 sgs_image8 *out)
{
    *out = (sgs_image8){0};
    if (photo->width < 1 || photo->height < 1)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "quantising a photo of %d x %d pixels: it has no pixels", photo->width,
                         photo->height);
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    float *planes = sgsi_alloc(3 * pixels, sizeof *planes);
    if (!planes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to compare a photo of %d x %d", photo->width,
                         photo->height);
    sgs_photo_flatten(photo, background, planes);
    const float *const color[3] = {planes, planes + pixels, planes + 2 * pixels};
    const sgs_status status =
        sgs_image8_from_render(color, NULL, NULL, space, photo->width, photo->height, out);
    sgsi_free(planes);
    return status;
}

// -------------------------------------------------------------------------------------------------
// PSNR.

static bool comparable(const sgs_image8 *a, const sgs_image8 *b)
{
    return a->pixels && b->pixels && a->width == b->width && a->height == b->height &&
           a->width > 0 && a->height > 0 && a->channels >= 3 && b->channels >= 3;
}

typedef struct psnr_job {
    const sgs_image8 *a, *b;
    const uint16_t *valid_mask;
    _Atomic uint64_t sum; // exact: the order does not matter
} psnr_job;

static void add_squares(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    psnr_job *job = context;
    const size_t width = (size_t)job->a->width, plane = width * (size_t)job->a->height;
    uint64_t sum = 0;
    for (size_t y = begin; y < end; ++y)
        for (size_t c = 0; c < 3; ++c) {
            const uint8_t *const a = job->a->pixels + c * plane + y * width, *const b =
                                                                                 job->b->pixels +
                                                                                 c * plane +
                                                                                 y * width;
            for (size_t x = 0; x < width; ++x) {
                const int difference = (int)a[x] - (int)b[x];
                if (sgs_mask_is_valid(job->valid_mask, job->a->width, (int)x, (int)y))
                    sum += (uint64_t)(difference * difference);
            }
        }
    job->sum += sum;
}

double sgs_psnr_masked(const sgs_image8 *a, const sgs_image8 *b, const uint16_t *valid_mask)
{
    if (!comparable(a, b))
        return NAN;
    psnr_job job = {.a = a, .b = b, .valid_mask = valid_mask};
    sgsi_parallel_ranges((size_t)a->height, STRIP_ROWS, add_squares, &job);
    const uint64_t sum = job.sum, values = 3 * sgsi_mask_count(valid_mask, a->width, a->height);
    if (!values)
        return NAN;
    return sum ? 10.0 * log10(255.0 * 255.0 * (double)values / (double)sum) : INFINITY;
}

double sgs_psnr(const sgs_image8 *a, const sgs_image8 *b)
{
    return sgs_psnr_masked(a, b, NULL);
}

// -------------------------------------------------------------------------------------------------
// SSIM.

typedef struct ssim_job {
    const sgs_image8 *a, *b;
    const uint16_t *valid_mask;
    double window[RADIUS + 1];
    size_t pitch;    // doubles per padded row
    size_t strips;   // per channel
    double *scratch; // per thread: MOMENTS padded lines, then [MOMENTS][WINDOW_ROWS] filtered rows
    double *sums;    // per item
} ssim_job;

static size_t scratch_size(size_t pitch)
{
    return MOMENTS * pitch * (1 + WINDOW_ROWS);
}

// x, y, x^2, y^2 and x y of one row, with RADIUS zeros on each side.
static void load_lines(const ssim_job *job, size_t row, double *lines)
{
    const size_t width = (size_t)job->a->width, pitch = job->pitch;
    const uint8_t *const a = job->a->pixels + row * width, *const b = job->b->pixels + row * width;
    for (size_t m = 0; m < MOMENTS; ++m)
        for (size_t k = 0; k < RADIUS; ++k)
            lines[m * pitch + k] = lines[m * pitch + RADIUS + width + k] = 0.0;
    const int y = (int)(row % (size_t)job->a->height);
    for (size_t x = 0; x < width; ++x) {
        const bool counts = sgs_mask_is_valid(job->valid_mask, job->a->width, (int)x, y);
        const double p = counts ? a[x] / 255.0 : 0.0, q = counts ? b[x] / 255.0 : 0.0;
        double *at = lines + RADIUS + x;
        at[0] = p;
        at[pitch] = q;
        at[2 * pitch] = p * p;
        at[3 * pitch] = q * q;
        at[4 * pitch] = p * q;
    }
}

static void smooth_line(const double window[RADIUS + 1], const double *line, size_t width,
                        double *out)
{
    for (size_t x = 0; x < width; ++x) {
        double sum = window[0] * line[x + RADIUS];
        for (size_t k = 1; k <= RADIUS; ++k)
            sum += window[k] * (line[x + RADIUS - k] + line[x + RADIUS + k]);
        out[x] = sum;
    }
}

// Applies the window down eleven filtered rows that start at `rows`.
static inline double smooth_down(const double window[RADIUS + 1], const double *rows, size_t pitch)
{
    double sum = window[0] * rows[RADIUS * pitch];
    for (size_t k = 1; k <= RADIUS; ++k)
        sum += window[k] * (rows[(RADIUS - k) * pitch] + rows[(RADIUS + k) * pitch]);
    return sum;
}

static inline double similarity(double m1, double m2, double square1, double square2,
                                double product)
{
    const double c1 = 1e-4, c2 = 9e-4;
    const double variance1 = square1 - m1 * m1, variance2 = square2 - m2 * m2,
                 covariance = product - m1 * m2;
    return (2.0 * m1 * m2 + c1) * (2.0 * covariance + c2) /
           ((m1 * m1 + m2 * m2 + c1) * (variance1 + variance2 + c2));
}

// Work item: a strip of rows of one channel.
static void ssim_strip(void *context, size_t item, int thread)
{
    const ssim_job *job = context;
    const ptrdiff_t height = job->a->height, first = (ptrdiff_t)(item % job->strips) * STRIP_ROWS;
    const size_t channel = item / job->strips, width = (size_t)job->a->width, pitch = job->pitch;
    double *const lines = job->scratch + (size_t)thread * scratch_size(pitch);
    double *const smooth = lines + MOMENTS * pitch;
    const size_t moment_size = WINDOW_ROWS * pitch;
    for (ptrdiff_t r = 0; r < WINDOW_ROWS; ++r) {
        const ptrdiff_t y = first - RADIUS + r;
        const bool inside = y >= 0 && y < height;
        if (inside)
            load_lines(job, channel * (size_t)height + (size_t)y, lines);
        for (size_t m = 0; m < MOMENTS; ++m) {
            double *const out = smooth + m * moment_size + (size_t)r * pitch;
            if (inside)
                smooth_line(job->window, lines + m * pitch, width, out);
            for (size_t x = 0; !inside && x < width; ++x)
                out[x] = 0.0;
        }
    }
    double sum = 0.0;
    for (ptrdiff_t r = 0; r < STRIP_ROWS && first + r < height; ++r)
        for (size_t x = 0; x < width; ++x) {
            if (!sgs_mask_is_valid(job->valid_mask, job->a->width, (int)x, (int)(first + r)))
                continue;
            const double *const at = smooth + (size_t)r * pitch + x;
            double moment[MOMENTS];
            for (size_t m = 0; m < MOMENTS; ++m)
                moment[m] = smooth_down(job->window, at + m * moment_size, pitch);
            sum += similarity(moment[0], moment[1], moment[2], moment[3], moment[4]);
        }
    job->sums[item] = sum;
}

static void make_window(double window[RADIUS + 1])
{
    double sum = 0.0;
    for (int k = 0; k <= RADIUS; ++k) {
        window[k] = exp(-k * k / 4.5);
        sum += k ? 2.0 * window[k] : window[k];
    }
    for (int k = 0; k <= RADIUS; ++k)
        window[k] /= sum;
}

double sgs_ssim(const sgs_image8 *a, const sgs_image8 *b)
{
    return sgs_ssim_masked(a, b, NULL);
}

double sgs_ssim_masked(const sgs_image8 *a, const sgs_image8 *b, const uint16_t *valid_mask)
{
    if (!comparable(a, b))
        return NAN;
    ssim_job job = {.a = a, .b = b, .valid_mask = valid_mask};
    job.pitch = ((size_t)a->width + 2 * RADIUS + 7) / 8 * 8;
    job.strips = ((size_t)a->height + STRIP_ROWS - 1) / STRIP_ROWS;
    make_window(job.window);
    const size_t items = 3 * job.strips, scratch = (size_t)sgsi_threads() * scratch_size(job.pitch);
    job.scratch = sgsi_alloc(scratch + items, sizeof(double));
    if (!job.scratch) {
        sgsi_record_error("not enough memory for the SSIM of %d x %d pixels", a->width, a->height);
        return NAN;
    }
    job.sums = job.scratch + scratch;
    sgsi_parallel_for(items, 1, ssim_strip, &job);
    double sum = 0.0;
    for (size_t item = 0; item < items; ++item)
        sum += job.sums[item];
    sgsi_free(job.scratch);
    const size_t kept = sgsi_mask_count(valid_mask, a->width, a->height);
    return kept ? sum / (3.0 * (double)kept) : NAN;
}
