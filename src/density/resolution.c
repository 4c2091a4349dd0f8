// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// DashGaussian's resolution schedule (Chen et al. 2025, the resolution scheduler).
//
// An image reduced by s keeps the central 1/s of its spectrum in each direction. M is the magnitude
// of the spectrum, W(s) the sum of M over that window. The first scale keeps a quarter of the
// energy and is at most 8: E_0 = W(s_max). 32 levels divide the rest of the energy E evenly; level
// i is rendered at the s_i with W(s_i) = E_i and begins at iteration T ln(E_(i-1) / E_0) / ln(E /
// E_0). Between levels the area is interpolated linearly. The scale in use is a whole number.
//
// The paper assumes one image size; here the images of the most frequent size define the mean
// spectrum. Reduced photos are rounded to 8 bits.

#include "density/resolution.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "density/fourier.h"

enum { SCALE_MAX = 8, BISECTIONS = 64 };
static const double start_share = 0.25;

void sgsi_spectrum_free(sgsi_spectrum *spectrum)
{
    sgsi_free(spectrum->magnitude);
    sgsi_free(spectrum->table);
    *spectrum = (sgsi_spectrum){0};
}

static sgs_status spectrum_create(int width, int height, sgsi_spectrum *spectrum)
{
    *spectrum = (sgsi_spectrum){.width = width, .height = height};
    spectrum->magnitude = sgsi_calloc_shared((size_t)width * (size_t)height, sizeof(double));
    spectrum->table =
        sgsi_calloc_shared((size_t)(width + 1) * (size_t)(height + 1), sizeof(double));
    if (spectrum->magnitude && spectrum->table)
        return SGS_STATUS_OK;
    sgsi_spectrum_free(spectrum);
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for the spectrum of an image of %dx%d pixels", width,
                     height);
}

// Sums along each row, from left to right.
static void sum_row(void *context, size_t y, int thread)
{
    (void)thread;
    const sgsi_spectrum *s = context;
    const size_t width = (size_t)s->width;
    const double *magnitude = s->magnitude + y * width;
    double *sums = s->table + (y + 1) * (width + 1) + 1, sum = 0.0;
    for (size_t x = 0; x < width; ++x) {
        sum += magnitude[x];
        sums[x] = sum;
    }
}

// Adds them from top to bottom.
static void sum_columns(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sgsi_spectrum *s = context;
    const size_t pitch = (size_t)s->width + 1;
    for (size_t y = 1; y < (size_t)s->height; ++y)
        for (size_t x = begin + 1; x <= end; ++x)
            s->table[(y + 1) * pitch + x] += s->table[y * pitch + x];
}

static void fill_table(sgsi_spectrum *s)
{
    sgsi_parallel_for((size_t)s->height, 8, sum_row, s);
    sgsi_parallel_ranges((size_t)s->width, 64, sum_columns, s);
}

// Two-dimensional transform of real numbers: all rows, then the columns of one half, which the
// other half mirrors.
typedef struct transform2d {
    const sgs_image8 *image;
    int channel, half_width;
    sgsi_fourier *row, *column;
    double (*half)[2];       // [height][half_width]
    double *magnitude;       // [height][width]
    double *lines, *scratch; // per thread
    size_t line_size, scratch_size;
} transform2d;

static void transform_row(void *context, size_t y, int thread)
{
    const transform2d *t = context;
    const size_t w = (size_t)t->image->width, h = (size_t)t->image->height;
    const uint8_t *pixels = t->image->pixels + ((size_t)t->channel * h + y) * w;
    double *line = t->lines + (size_t)thread * t->line_size;
    for (size_t x = 0; x < w; ++x) {
        line[2 * x] = (double)pixels[x] / 255.0;
        line[2 * x + 1] = 0.0;
    }
    sgsi_fourier_transform(t->row, line, t->scratch + (size_t)thread * t->scratch_size);
    memcpy(t->half[y * (size_t)t->half_width], line, (size_t)t->half_width * sizeof *t->half);
}

static void transform_column(void *context, size_t x, int thread)
{
    const transform2d *t = context;
    const size_t h = (size_t)t->image->height, pitch = (size_t)t->half_width;
    double *line = t->lines + (size_t)thread * t->line_size;
    for (size_t y = 0; y < h; ++y)
        memcpy(line + 2 * y, t->half[y * pitch + x], sizeof *t->half);
    sgsi_fourier_transform(t->column, line, t->scratch + (size_t)thread * t->scratch_size);
    for (size_t y = 0; y < h; ++y)
        memcpy(t->half[y * pitch + x], line + 2 * y, sizeof *t->half);
}

// Adds the magnitudes of one row of frequencies to the centred ones.
static void add_magnitudes(void *context, size_t row, int thread)
{
    (void)thread;
    const transform2d *t = context;
    const int w = t->image->width, h = t->image->height, ky = (int)row, y = (ky + h / 2) % h;
    double *magnitude = t->magnitude + (size_t)y * (size_t)w;
    for (int kx = 0; kx < w; ++kx) {
        const bool mirrored = kx >= t->half_width;
        const int fx = mirrored ? w - kx : kx, fy = mirrored ? (h - ky) % h : ky;
        const double *z = t->half[(size_t)fy * (size_t)t->half_width + (size_t)fx];
        magnitude[(kx + w / 2) % w] += sqrt(z[0] * z[0] + z[1] * z[1]);
    }
}

static void add_channel(transform2d *t, int channel)
{
    const size_t h = (size_t)t->image->height;
    t->channel = channel;
    sgsi_parallel_for(h, 8, transform_row, t);
    sgsi_parallel_for((size_t)t->half_width, 8, transform_column, t);
    sgsi_parallel_for(h, 8, add_magnitudes, t);
}

sgs_status sgsi_spectrum_of(const sgs_image8 *image, sgsi_spectrum *spectrum)
{
    sgs_status status = spectrum_create(image->width, image->height, spectrum);
    if (status)
        return status;
    const int longer = image->width > image->height ? image->width : image->height;
    const size_t threads = (size_t)sgsi_threads();
    transform2d t = {.image = image,
                     .half_width = image->width / 2 + 1,
                     .row = sgsi_fourier_create(image->width),
                     .column = sgsi_fourier_create(image->height),
                     .magnitude = spectrum->magnitude,
                     .line_size = 2 * (size_t)longer};
    if (t.row && t.column) {
        const size_t of_rows = sgsi_fourier_scratch(t.row),
                     of_columns = sgsi_fourier_scratch(t.column);
        t.scratch_size = of_rows > of_columns ? of_rows : of_columns;
        t.half = sgsi_alloc((size_t)image->height * (size_t)t.half_width, sizeof *t.half);
        t.lines = sgsi_alloc(threads * t.line_size, sizeof *t.lines);
        t.scratch = sgsi_alloc(threads * t.scratch_size, sizeof *t.scratch);
    }
    if (t.half && t.lines && t.scratch) {
        for (int c = 0; c < 3; ++c)
            add_channel(&t, c);
        fill_table(spectrum);
    } else {
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for the spectrum of an image of %dx%d pixels",
                           image->width, image->height);
        sgsi_spectrum_free(spectrum);
    }
    sgsi_fourier_destroy(t.row);
    sgsi_fourier_destroy(t.column);
    sgsi_free(t.half);
    sgsi_free(t.lines);
    sgsi_free(t.scratch);
    return status;
}

static int clamped(int value, int most)
{
    return value < 0 ? 0 : value > most ? most : value;
}

double sgsi_spectrum_window(const sgsi_spectrum *s, double scale)
{
    const int h = (int)(s->height / scale), w = (int)(s->width / scale), cy = (s->height + 1) / 2,
              cx = (s->width + 1) / 2;
    const int top = clamped(cy - h / 2, s->height), bottom = clamped(cy + h / 2, s->height);
    const int left = clamped(cx - w / 2, s->width), right = clamped(cx + w / 2, s->width);
    const size_t pitch = (size_t)s->width + 1;
    const double *t = s->table;
    return t[(size_t)bottom * pitch + (size_t)right] - t[(size_t)top * pitch + (size_t)right] -
           t[(size_t)bottom * pitch + (size_t)left] + t[(size_t)top * pitch + (size_t)left];
}

static double whole(const sgsi_spectrum *s)
{
    return s->table[(size_t)(s->width + 1) * (size_t)(s->height + 1) - 1];
}

// The scale whose window contains the energy `target`.
static double solve(const sgsi_spectrum *s, double target)
{
    double low = 0.0, high = 1.0, middle = 1.0;
    for (int i = 0; i < BISECTIONS; ++i) {
        middle = 0.5 * (low + high);
        if (sgsi_spectrum_window(s, 1.0 / middle) < target)
            low = middle;
        else
            high = middle;
    }
    return 1.0 / middle;
}

static void make_levels(const sgsi_spectrum *mean, double scale_max, int until,
                        sgsi_resolution *plan)
{
    enum { LAST = SGSI_RESOLUTION_LEVELS - 1 };
    const double total = whole(mean), least = sgsi_spectrum_window(mean, scale_max);
    *plan = (sgsi_resolution){.until = until, .decay_begin = 0};
    for (int i = 0; i <= LAST; ++i)
        plan->scale[i] = 1.0;
    plan->begin[LAST + 1] = until;
    if (!(scale_max > 1.0 && least > 0.0 && total > least))
        return; // full resolution throughout
    double energy[SGSI_RESOLUTION_LEVELS];
    for (int i = 0; i <= LAST; ++i) {
        energy[i] = least + (total - least) * i / LAST;
        plan->scale[i] = i == 0 ? scale_max : i == LAST ? 1.0 : solve(mean, energy[i]);
    }
    for (int i = 1; i <= LAST; ++i)
        plan->begin[i] = (int)(until * log(energy[i - 1] / least) / log(total / least));
    int level = 0;
    while (level < LAST && plan->scale[level] >= 2.0)
        ++level;
    plan->decay_begin = plan->begin[level];
}

// The most frequent size; returns how many images have it.
static size_t frequent_size(const sgsi_image_source *images, int *width, int *height)
{
    size_t most = 0;
    for (size_t i = 0; i < images->count; ++i) {
        int w, h, other_w, other_h;
        size_t same = 0;
        images->size(images->context, i, &w, &h);
        for (size_t k = 0; k < images->count; ++k) {
            images->size(images->context, k, &other_w, &other_h);
            same += w == other_w && h == other_h;
        }
        if (same > most) {
            most = same;
            *width = w;
            *height = h;
        }
    }
    return most;
}

typedef struct mean_job {
    const double *from;
    double *mean, count;
} mean_job;

static void add_share(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const mean_job *job = context;
    for (size_t k = begin; k < end; ++k)
        job->mean[k] += job->from[k] / job->count;
}

sgs_status sgsi_resolution_plan(const sgsi_image_source *images, int until, sgsi_resolution *plan)
{
    int width = 1, height = 1;
    const size_t most = frequent_size(images, &width, &height);
    sgsi_spectrum mean;
    sgs_status status = spectrum_create(width, height, &mean);
    double scale_max = SCALE_MAX;
    for (size_t i = 0; i < images->count && !status; ++i) {
        sgs_image8 image;
        sgsi_spectrum one = {0};
        status = images->get(images->context, i, &image);
        if (!status)
            status = sgsi_spectrum_of(&image, &one);
        if (status)
            break;
        scale_max = fmin(scale_max, solve(&one, start_share * whole(&one)));
        mean_job job = {one.magnitude, mean.magnitude, (double)most};
        if (one.width == mean.width && one.height == mean.height)
            sgsi_parallel_ranges((size_t)one.width * (size_t)one.height, 1 << 14, add_share, &job);
        sgsi_spectrum_free(&one);
        if (images->advance)
            status = images->advance(images->context);
    }
    if (!status) {
        fill_table(&mean);
        make_levels(&mean, scale_max, until, plan);
    }
    sgsi_spectrum_free(&mean);
    return status;
}

sgsi_resolution sgsi_resolution_half(int until)
{
    return (sgsi_resolution){.until = until, .scale = {2.0}, .begin = {0, until}};
}

int sgsi_resolution_at(const sgsi_resolution *plan, int iteration)
{
    if (iteration >= plan->until)
        return 1;
    int i = 1;
    while (i < SGSI_RESOLUTION_LEVELS - 1 && iteration >= plan->begin[i + 1])
        ++i;
    if (iteration < plan->begin[1])
        return (int)plan->scale[0];
    const double before = 1.0 / (plan->scale[i - 1] * plan->scale[i - 1]),
                 after = 1.0 / (plan->scale[i] * plan->scale[i]);
    const int span = plan->begin[i + 1] - plan->begin[i];
    const double share = span > 0 ? (double)(iteration - plan->begin[i]) / span : 1.0;
    const int scale = (int)(1.0 / sqrt(before + share * (after - before)));
    return scale < 1 ? 1 : scale;
}

// Weights of one output sample over the inputs first .. first + taps - 1.
typedef struct triangle {
    int first, taps;
    float weights[4 * SCALE_MAX + 4];
} triangle;

static triangle triangle_at(int out, double scale, int size)
{
    const double center = (out + 0.5) * scale;
    int begin = (int)floor(center - scale), end = (int)ceil(center + scale);
    begin = begin < 0 ? 0 : begin;
    end = end > size ? size : end;
    double sum = 0.0, value[4 * SCALE_MAX + 4];
    for (int i = begin; i < end; ++i) {
        value[i - begin] = fmax(0.0, 1.0 - fabs((i + 0.5 - center) / scale));
        sum += value[i - begin];
    }
    triangle filter = {.first = begin, .taps = end - begin};
    for (int i = begin; i < end; ++i)
        filter.weights[i - begin] = (float)(value[i - begin] / sum);
    return filter;
}

// Reduction of an image: rows are independent of each other. Colours are weighted by alpha, and
// pixels by their validity, so that transparent and masked pixels do not mix in.
typedef struct triangle_job {
    const sgs_image8 *image;
    const uint16_t *valid_mask; // or NULL
    sgs_image8 *out;
    triangle *columns; // [width of out]
    float *rows;       // [threads][3][width of the image]
} triangle_job;

static const uint8_t *alpha_of(const sgs_image8 *image)
{
    const size_t pixels = (size_t)image->width * (size_t)image->height;
    return image->channels == 4 ? image->pixels + 3 * pixels : NULL;
}

// Vertical filter of `plane` (NULL: of ones) times alpha, if it is not NULL, at valid pixels.
static void filter_rows(const triangle_job *job, const uint8_t *plane, const uint8_t *alpha,
                        const triangle *filter, float *row)
{
    const int width = job->image->width;
    memset(row, 0, (size_t)width * sizeof *row);
    for (int k = 0; k < filter->taps; ++k) {
        const int y = filter->first + k;
        const size_t at = (size_t)y * (size_t)width;
        for (int x = 0; x < width; ++x) {
            const float value = plane ? (float)plane[at + (size_t)x] : 1.0f;
            if (sgs_mask_is_valid(job->valid_mask, width, x, y))
                row[x] +=
                    filter->weights[k] * value * (alpha ? (float)alpha[at + (size_t)x] : 1.0f);
        }
    }
}

static float filter_columns(const triangle *filter, const float *row)
{
    float sum = 0.0f;
    for (int k = 0; k < filter->taps; ++k)
        sum += filter->weights[k] * row[filter->first + k];
    return sum;
}

// Row y of channel c. share: sums of the weights of colours and of alpha; NULL: they are 1.
static void reduce_row(const triangle_job *job, size_t y, int c, const triangle *filter,
                       const float *share, float *row)
{
    const sgs_image8 *image = job->image;
    sgs_image8 *out = job->out;
    const size_t from = (size_t)image->width * (size_t)image->height, width = (size_t)out->width,
                 to = width * (size_t)out->height;
    filter_rows(job, image->pixels + (size_t)c * from, c < 3 ? alpha_of(image) : NULL, filter, row);
    for (size_t x = 0; x < width; ++x) {
        float sum = filter_columns(&job->columns[x], row);
        const float weight = share ? filter_columns(&job->columns[x], share) : 0.0f;
        sum = weight > 0.0f ? sum / weight : sum;
        out->pixels[(size_t)c * to + y * width + x] =
            (uint8_t)fminf(fmaxf(sum + 0.5f, 0.0f), 255.0f);
    }
}

static void reduce_rows(void *context, size_t begin, size_t end, int thread)
{
    const triangle_job *job = context;
    const sgs_image8 *image = job->image;
    const uint8_t *const alpha = alpha_of(image);
    const size_t width = (size_t)image->width;
    float *const row = job->rows + 3 * (size_t)thread * width, *const share = row + width,
                 *const valid = share + width;
    for (size_t y = begin; y < end; ++y) {
        const triangle filter =
            triangle_at((int)y, (double)image->height / job->out->height, image->height);
        if (alpha)
            filter_rows(job, alpha, NULL, &filter, share);
        if (job->valid_mask)
            filter_rows(job, NULL, NULL, &filter, valid);
        for (int c = 0; c < image->channels; ++c)
            reduce_row(job, y, c, &filter,
                       alpha && c < 3    ? share
                       : job->valid_mask ? valid
                                         : NULL,
                       row);
    }
}

sgs_status sgsi_image8_triangle(const sgs_image8 *image, const uint16_t *valid_mask, int scale,
                                sgs_image8 *out)
{
    const int width = image->width / scale > 0 ? image->width / scale : 1,
              height = image->height / scale > 0 ? image->height / scale : 1;
    *out = (sgs_image8){.width = width, .height = height, .channels = image->channels};
    out->pixels = sgsi_alloc((size_t)width * (size_t)height, (size_t)image->channels);
    triangle_job job = {
        .image = image,
        .valid_mask = valid_mask,
        .out = out,
        .columns = sgsi_alloc((size_t)width, sizeof *job.columns),
        .rows = sgsi_alloc(3 * (size_t)image->width * (size_t)sgsi_threads(), sizeof *job.rows)};
    const bool complete = out->pixels && job.columns && job.rows;
    if (complete) {
        for (int x = 0; x < width; ++x)
            job.columns[x] = triangle_at(x, (double)image->width / width, image->width);
        sgsi_parallel_ranges((size_t)height, 16, reduce_rows, &job);
    }
    sgsi_free(job.columns);
    sgsi_free(job.rows);
    if (complete)
        return SGS_STATUS_OK;
    sgsi_free(out->pixels);
    *out = (sgs_image8){0};
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for an image of %dx%d pixels",
                     width, height);
}
