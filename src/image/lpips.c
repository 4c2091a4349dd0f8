// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The forward pass of LPIPS (Zhang et al. 2018, equation 1): both images go through the
// convolutions of VGG16 or AlexNet; at five of them the features, divided by their length over the
// channels, are subtracted, squared, weighted by the head, and averaged over the image.
//
// A block consists of the convolutions between two poolings. VGG16 runs each block in bands of
// rows, because the full-size feature maps of the first blocks would take a gigabyte for a
// megapixel. Features at the border of a band are computed again by the next band, with the same
// bits. Sums of a tap are kept per row and added in the order of the rows: the result depends
// neither on the bands nor on the number of threads. Convolutions are in float, comparisons in
// double.

#include "image/lpips.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "image/mask.h"
#include "simd/kernel_variants.h"

enum {
    IMAGES = 2,
    SLACK = 48, // elements that a kernel may read and write past a row
    CHUNK = 32, // columns that a tap compares together
    ROWS = 4,   // of a work item
};
size_t sgsi_lpips_band_bytes = (size_t)64 << 20;

// Feature maps, rows `first` to first + rows - 1, with zeros outside of the image. Columns are
// split into `phases` planes for a strided consumer: padded column u lies in plane u % phases.
typedef struct planes {
    float *data; // [channels][phases][rows][pitch]
    int channels, width, height;
    int first, rows, padding, phases;
    size_t pitch;
} planes;

typedef struct distance_job {
    const sgs_lpips *lpips;
    sgsi_lpips_kernel kernel;
    const uint16_t *valid_mask;
    int image_width, image_height;
    double distance;
    // Of the running loop.
    int layer, from, to; // rows of the convolution's output
    const planes *in;
    planes *out;
    size_t *offsets;
    const planes *tapped[IMAGES];
    const float *head;
    double *sums, *shares; // [height]
} distance_job;

static bool planes_create(planes *p, int rows, int channels, int width, int height, int padding,
                          int phases)
{
    *p = (planes){.channels = channels,
                  .width = width,
                  .height = height,
                  .rows = rows,
                  .padding = padding,
                  .phases = phases};
    p->pitch = (size_t)(width + 2 * padding + phases - 1) / (size_t)phases + SLACK;
    p->data =
        sgsi_calloc((size_t)channels * (size_t)phases * (size_t)rows, p->pitch * sizeof(float));
    return p->data != NULL;
}

static size_t plane_size(const planes *p)
{
    return (size_t)p->phases * (size_t)p->rows * p->pitch;
}

static float *row_of(const planes *p, int channel, int y)
{
    return p->data + (size_t)channel * plane_size(p) + (size_t)(y - p->first) * p->pitch;
}

static int output_size(const lpips_convolution *c, int size)
{
    return (size + 2 * c->padding - c->kernel) / c->stride + 1;
}

// ---- Convolution ----

// A few rows of LPIPS_GROUP channels.
static void convolve_item(void *context, size_t item, int thread)
{
    (void)thread;
    const distance_job *job = context;
    const lpips_convolution *c = &job->lpips->network->convolutions[job->layer];
    const planes *in = job->in, *out = job->out;
    const size_t pieces = (size_t)(job->to - job->from + ROWS - 1) / ROWS;
    const int group = (int)(item / pieces), begin = job->from + (int)(item % pieces) * ROWS;
    const size_t taps = (size_t)c->in * (size_t)c->kernel * (size_t)c->kernel;
    for (int y = begin; y < begin + ROWS && y < job->to; ++y) {
        float *to = row_of(out, group * LPIPS_GROUP, y);
        const bool inside = y >= 0 && y < out->height;
        if (inside)
            job->kernel(&(sgsi_lpips_row){
                .in = row_of(in, 0, y * c->stride - c->padding),
                .weights = job->lpips->weights[job->layer] + (size_t)group * taps * LPIPS_GROUP,
                .bias = job->lpips->bias[job->layer] + group * LPIPS_GROUP,
                .offsets = job->offsets,
                .taps = taps,
                .out = to + out->padding,
                .out_plane = plane_size(out),
                .width = out->width});
        for (size_t k = 0; k < LPIPS_GROUP; ++k) {
            float *line = to + k * plane_size(out);
            const size_t end = inside ? (size_t)(out->padding + out->width) : 0;
            memset(line + end, 0, (out->pitch - end) * sizeof *line);
        }
    }
}

// Rows [out->first, out->first + out->rows) of a convolution.
static bool convolve(distance_job *job, int layer, const planes *in, planes *out)
{
    const lpips_convolution *c = &job->lpips->network->convolutions[layer];
    const int taps = c->in * c->kernel * c->kernel;
    job->offsets = sgsi_alloc((size_t)taps, sizeof *job->offsets);
    if (!job->offsets)
        return false;
    for (int t = 0; t < taps; ++t) {
        const int channel = t / (c->kernel * c->kernel), ky = t / c->kernel % c->kernel,
                  kx = t % c->kernel;
        job->offsets[t] = (size_t)channel * plane_size(in) +
                          ((size_t)(kx % in->phases) * (size_t)in->rows + (size_t)ky) * in->pitch +
                          (size_t)(kx / in->phases);
    }
    job->layer = layer;
    job->in = in;
    job->out = out;
    job->from = out->first;
    job->to = out->first + out->rows;
    const size_t pieces = (size_t)(out->rows + ROWS - 1) / ROWS;
    sgsi_parallel_for((size_t)(c->out / LPIPS_GROUP) * pieces, 1, convolve_item, job);
    sgsi_free(job->offsets);
    return true;
}

// ---- Comparison ----

// Share of the valid pixels in the cell of the image that belongs to a feature.
static double valid_share(const distance_job *job, int width, int height, int x, int y)
{
    if (!job->valid_mask)
        return 1.0;
    const int64_t w = job->image_width, h = job->image_height;
    int64_t valid = 0, count = 0;
    for (int64_t v = y * h / height; v < (y + 1) * h / height; ++v)
        for (int64_t u = x * w / width; u < (x + 1) * w / width; ++u, ++count)
            valid += sgs_mask_is_valid(job->valid_mask, job->image_width, (int)u, (int)v);
    return count ? (double)valid / (double)count : 0.0;
}

static void compare_row(void *context, size_t item, int thread)
{
    (void)thread;
    const distance_job *job = context;
    const planes *p = job->tapped[0];
    const int y = job->from + (int)item;
    double sum = 0.0, shares = 0.0;
    for (int x0 = 0; x0 < p->width; x0 += CHUNK) {
        double scale[IMAGES][CHUNK] = {{0}}, difference[CHUNK] = {0};
        for (int k = 0; k < IMAGES; ++k) {
            for (int c = 0; c < p->channels; ++c) {
                const float *f = row_of(job->tapped[k], c, y) + p->padding + x0;
                for (int i = 0; i < CHUNK; ++i)
                    scale[k][i] += (double)f[i] * (double)f[i];
            }
            for (int i = 0; i < CHUNK; ++i)
                scale[k][i] = 1.0 / (sqrt(scale[k][i]) + 1e-10);
        }
        for (int c = 0; c < p->channels; ++c) {
            const float *f = row_of(job->tapped[0], c, y) + p->padding + x0,
                        *g = row_of(job->tapped[1], c, y) + p->padding + x0;
            const double weight = (double)job->head[c];
            for (int i = 0; i < CHUNK; ++i) {
                const double d = (double)f[i] * scale[0][i] - (double)g[i] * scale[1][i];
                difference[i] += weight * (d * d);
            }
        }
        for (int i = 0; i < CHUNK && x0 + i < p->width; ++i) {
            const double share = valid_share(job, p->width, p->height, x0 + i, y);
            sum += share * difference[i];
            shares += share;
        }
    }
    job->sums[y] = sum;
    job->shares[y] = shares;
}

// ---- Pooling ----

static void pool_item(void *context, size_t item, int thread)
{
    (void)thread;
    const distance_job *job = context;
    const int window = job->lpips->network->pool;
    const planes *in = job->in, *out = job->out;
    const int count = job->to - job->from, channel = (int)(item / (size_t)count),
              y = job->from + (int)(item % (size_t)count);
    float *to = row_of(out, channel, y) + out->padding;
    for (int x = 0; x < out->width; ++x) {
        float largest = 0.0F; // features are not negative
        for (int v = 0; v < window; ++v) {
            const float *from = row_of(in, channel, 2 * y + v) + in->padding + 2 * x;
            for (int u = 0; u < window; ++u)
                largest = from[u] > largest ? from[u] : largest;
        }
        to[x] = largest;
    }
}

static void pool_band(distance_job *job, const planes *in, planes *out, int begin, int end)
{
    job->in = in;
    job->out = out;
    job->from = begin / 2;
    job->to = end == in->height ? out->height : end / 2;
    if (job->to > job->from)
        sgsi_parallel_for((size_t)in->channels * (size_t)(job->to - job->from), 0, pool_item, job);
}

// ---- Blocks ----

typedef struct block {
    int begin, count;  // convolutions
    int band;          // rows of the last convolution per band
    planes in[IMAGES]; // complete
    planes maps[IMAGES][LPIPS_CONVOLUTIONS];
    double *sums[LPIPS_CONVOLUTIONS]; // of tapped convolutions: sums, then shares per row
} block;

static void block_free(block *b)
{
    for (int k = 0; k < IMAGES; ++k) {
        sgsi_free(b->in[k].data);
        for (int i = 0; i < b->count; ++i)
            sgsi_free(b->maps[k][i].data);
    }
    for (int i = 0; i < b->count; ++i)
        sgsi_free(b->sums[i]);
}

// Output rows of convolution i of a block that rows [begin, end) of the last one need.
static void needed_rows(const lpips_network *network, const block *b, int i, int begin, int end,
                        int *first, int *count)
{
    int low = begin, high = end;
    for (int k = b->count - 1; k > i; --k) {
        const lpips_convolution *c = &network->convolutions[b->begin + k];
        low = low * c->stride - c->padding;
        high = (high - 1) * c->stride - c->padding + c->kernel;
    }
    *first = low;
    *count = high - low;
}

// Allocates the maps of a block whose input is known.
static bool block_create(const lpips_network *network, block *b)
{
    int width = b->in[0].width, height = b->in[0].height;
    size_t row_bytes = 0;
    for (int i = 0; i < b->count; ++i) {
        const lpips_convolution *c = &network->convolutions[b->begin + i];
        width = output_size(c, width);
        height = output_size(c, height);
        row_bytes += IMAGES * (size_t)c->out * ((size_t)width + SLACK + 2) * sizeof(float);
    }
    b->band = height;
    if (network->pool == 2) { // even bands keep the windows of the pooling together
        const size_t rows = sgsi_lpips_band_bytes / row_bytes / 2 * 2;
        b->band = rows < 8 ? 8 : rows < (size_t)height ? (int)rows : height;
    }
    width = b->in[0].width;
    height = b->in[0].height;
    for (int i = 0; i < b->count; ++i) {
        const lpips_convolution *c = &network->convolutions[b->begin + i];
        const int padding = i + 1 < b->count ? c[1].padding : 0;
        int first, rows;
        needed_rows(network, b, i, 0, b->band, &first, &rows);
        width = output_size(c, width);
        height = output_size(c, height);
        for (int k = 0; k < IMAGES; ++k)
            if (!planes_create(&b->maps[k][i], rows, c->out, width, height, padding, 1))
                return false;
        b->sums[i] = c->tapped ? sgsi_calloc(2 * (size_t)height, sizeof(double)) : NULL;
        if (c->tapped && !b->sums[i])
            return false;
    }
    return true;
}

// Compares the tapped convolutions of a band. Rows that another band covers too get equal values.
static void compare_band(distance_job *job, block *b, int tap)
{
    for (int i = 0; i < b->count; ++i) {
        const lpips_convolution *c = &job->lpips->network->convolutions[b->begin + i];
        const planes *p = &b->maps[0][i];
        if (!c->tapped)
            continue;
        job->tapped[0] = p;
        job->tapped[1] = &b->maps[1][i];
        job->head = job->lpips->heads[tap++];
        job->sums = b->sums[i];
        job->shares = b->sums[i] + p->height;
        job->from = p->first > 0 ? p->first : 0;
        const int end = p->first + p->rows < p->height ? p->first + p->rows : p->height;
        sgsi_parallel_for((size_t)(end - job->from), 1, compare_row, job);
    }
}

// Runs a block and pools its output into the complete maps `next` (NULL: the last block).
static bool run_block(distance_job *job, block *b, int tap, planes next[IMAGES])
{
    const int height = b->maps[0][b->count - 1].height;
    for (int begin = 0; begin < height; begin += b->band) {
        const int end = begin + b->band < height ? begin + b->band : height;
        for (int k = 0; k < IMAGES; ++k) {
            const planes *in = &b->in[k];
            for (int i = 0; i < b->count; ++i) {
                planes *out = &b->maps[k][i];
                needed_rows(job->lpips->network, b, i, begin, end, &out->first, &out->rows);
                if (!convolve(job, b->begin + i, in, out))
                    return false;
                in = out;
            }
            if (next)
                pool_band(job, in, &next[k], begin, end);
        }
        compare_band(job, b, tap);
    }
    for (int i = 0; i < b->count; ++i) {
        double sum = 0.0, shares = 0.0;
        for (int y = 0; b->sums[i] && y < b->maps[0][i].height; ++y) {
            sum += b->sums[i][y];
            shares += b->sums[i][b->maps[0][i].height + y];
        }
        if (b->sums[i])
            job->distance += sum / shares; // NaN where no pixel is valid
    }
    return true;
}

// ---- Input ----

static bool image_planes(const lpips_convolution *c, sgs_lpips_input input, const sgs_image8 *image,
                         const uint16_t *valid_mask, planes *out)
{
    static const double mean[3] = {-0.030, -0.088, -0.188}, deviation[3] = {0.458, 0.448, 0.450};
    if (!planes_create(out, image->height + 2 * c->padding, 3, image->width, image->height,
                       c->padding, c->stride))
        return false;
    out->first = -c->padding;
    const size_t plane = (size_t)image->width * (size_t)image->height;
    for (int channel = 0; channel < 3; ++channel)
        for (int y = 0; y < image->height; ++y)
            for (int x = 0; x < image->width; ++x) {
                const int u = x + c->padding;
                const uint8_t *pixel = image->pixels + (size_t)channel * plane +
                                       (size_t)y * (size_t)image->width + (size_t)x;
                const bool valid = sgs_mask_is_valid(valid_mask, image->width, x, y);
                const double value = valid ? *pixel / 255.0 : 0.0;
                const double scaled = input == SGS_LPIPS_SIGNED ? 2.0 * value - 1.0 : value;
                row_of(out, channel, y)[(size_t)(u % out->phases) * (size_t)out->rows * out->pitch +
                                        (size_t)(u / out->phases)] =
                    (float)((scaled - mean[channel]) / deviation[channel]);
            }
    return true;
}

// Allocates the input of the block after `b`.
static bool next_input(const lpips_network *network, const block *b, planes next[IMAGES])
{
    const planes *last = &b->maps[0][b->count - 1];
    const int padding = network->convolutions[b->begin + b->count].padding;
    const int width = (last->width - network->pool) / 2 + 1,
              height = (last->height - network->pool) / 2 + 1;
    for (int k = 0; k < IMAGES; ++k) {
        if (!planes_create(&next[k], height + 2 * padding, last->channels, width, height, padding,
                           1))
            return false;
        next[k].first = -padding;
    }
    return true;
}

static bool run_network(distance_job *job, planes input[IMAGES])
{
    const lpips_network *network = job->lpips->network;
    bool done = true;
    int tap = 0;
    for (int begin = 0; begin < network->count && done;) {
        block b = {.begin = begin, .count = 1};
        while (begin + b.count < network->count &&
               !network->convolutions[begin + b.count].after_pool)
            ++b.count;
        memcpy(b.in, input, sizeof b.in);
        memset(input, 0, sizeof b.in);
        const bool last = begin + b.count == network->count;
        done = block_create(network, &b) && (last || next_input(network, &b, input)) &&
               run_block(job, &b, tap, last ? NULL : input);
        for (int i = 0; i < b.count; ++i)
            tap += network->convolutions[begin + i].tapped;
        begin += b.count;
        block_free(&b);
    }
    return done;
}

static const sgsi_lpips_kernel kernels[SGS_ISA_COUNT] = SGSI_VARIANTS(sgsi_lpips_row);

sgs_status sgs_lpips_distance(const sgs_lpips *lpips, sgs_lpips_input input, const sgs_image8 *a,
                              const sgs_image8 *b, const uint16_t *valid_mask, double *distance)
{
    *distance = NAN;
    const lpips_network *network = lpips->network;
    if (!a->pixels || !b->pixels || a->width != b->width || a->height != b->height ||
        a->channels < 3 || b->channels < 3)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "LPIPS: images differ in size or lack colour");
    if (a->width < network->smallest || a->height < network->smallest)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "LPIPS: the image has %d x %d pixels; the network %s requires at least %d "
                         "in both directions",
                         a->width, a->height, network->name, network->smallest);
    distance_job job = {.lpips = lpips,
                        .kernel = kernels[sgs_isa_get()],
                        .valid_mask = valid_mask,
                        .image_width = a->width,
                        .image_height = a->height};
    planes planes_of[IMAGES] = {{0}};
    const lpips_convolution *first = &network->convolutions[0];
    const bool done = image_planes(first, input, a, valid_mask, &planes_of[0]) &&
                      image_planes(first, input, b, valid_mask, &planes_of[1]) &&
                      run_network(&job, planes_of);
    for (int k = 0; k < IMAGES; ++k)
        sgsi_free(planes_of[k].data);
    if (!done)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the LPIPS of %d x %d pixels", a->width, a->height);
    *distance = job.distance;
    return SGS_STATUS_OK;
}
