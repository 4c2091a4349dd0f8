// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// MesonGS (Xie et al. 2024): pruning by importance, an octree of the positions, a codebook for the
// bands above 0, RAHT and 8-bit blocks for the rest (meson_codec.h), and fine-tuning through the
// quantiser (meson_finetune.h). Constants are those of the authors' released code.
//
// Importance: sum over the training views of the blending weights, times (volume / v90)^0.1, v90
// the volume at rank int(0.9 N) from above. Without a scene the opacity replaces the sum.
// Primitives of one octree cell are merged by plain means. The codebook starts uniform in the range
// of all entries; in each of 1000 steps 262144 rows are drawn and code = 0.8 code + 0.2 (sum w x) /
// (sum w + 1e-5), w the importance over its maximum, so that unused codes decay, as released.
//
// Differences: cells are stored in Morton order, as differences in 7-bit groups; the cell of the
// largest position is 2^depth - 1. w is the largest importance in a cell; the release passes the
// importance in the order before the octree sorts and merges the points, so that its weights belong
// to other points.

#include <math.h>
#include <string.h>

#include "base/morton.h"
#include "base/keyed_rows.h"
#include "compress/bit_stream.h"
#include "compress/cell_codes.h"
#include "compress/importance.h"
#include "compress/meson_codec.h"
#include "compress/meson_finetune.h"
#include "sparegs/prune.h"
#include "prune/scores.h"

enum { BATCH = 262144, FINETUNE = 8000, DEPTH = 20, BLOCKS = 57, CODES = 2048, MAX_DEPTH = 21 };
static const double DECAY = 0.8, SMOOTHING = 1e-5;

typedef struct meson_header {
    uint32_t depth, blocks, codes, center;
    float bounds[2][3];
    float dc[SGSI_MESON_TRANSFORMED];
    uint32_t reserved;
} meson_header;

// ---- Pruning ----

// Keeps the share `keep`; `importance` stays aligned with the rows.
static sgs_status prune(sgsi_compress_job *job, double *importance)
{
    bool *keep = sgsi_alloc(job->count, sizeof *keep);
    size_t kept = 0;
    sgs_status status = keep ? sgs_prune_select(SGS_PRUNE_LIGHTGAUSSIAN, importance, job->count,
                                                sgsi_other_share(job->options->keep), keep, &kept)
                             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                         "not enough memory for %zu primitives", job->count);
    if (!status && kept) { // equal scores may remove all: keep all instead
        for (size_t i = 0, k = 0; i < job->count; ++i)
            if (keep[i])
                importance[k++] = importance[i];
        sgsi_rows_keep(job, keep);
    } else if (!status && job->options->scene && job->options->keep < 1) {
        sgsi_warn("all %zu primitives have the same importance; option keep has no effect",
                  job->count);
    }
    sgsi_free(keep);
    return status;
}

// ---- Octree ----

static void set_bounds(const sgsi_compress_job *job, sgsi_meson *meson)
{
    for (int k = 0; k < 3; ++k)
        meson->bounds[0][k] = meson->bounds[1][k] = job->rows[k];
    for (size_t i = 0; i < job->count; ++i)
        for (int k = 0; k < 3; ++k) {
            const float x = job->rows[i * SGS_PARAM_COUNT + (size_t)k];
            meson->bounds[0][k] = x < meson->bounds[0][k] ? x : meson->bounds[0][k];
            meson->bounds[1][k] = x > meson->bounds[1][k] ? x : meson->bounds[1][k];
        }
}

static uint64_t code_of(const sgsi_meson *meson, const float *row)
{
    const double cells = (double)(UINT64_C(1) << meson->depth);
    uint64_t code = 0;
    for (int k = 0; k < 3; ++k) {
        const double low = (double)meson->bounds[0][k], span = (double)meson->bounds[1][k] - low;
        const double at = span > 0 ? floor(((double)row[k] - low) / span * cells) : 0;
        code |= sgsi_spread_bits((uint64_t)(at < cells - 1 ? at : cells - 1)) << (2 - k);
    }
    return code;
}

// Sorts the rows by cell and merges those of one cell by their means; job->count becomes the number
// of cells.
static sgs_status build_octree(sgsi_compress_job *job, sgsi_meson *meson, double *importance)
{
    const size_t n = job->count;
    set_bounds(job, meson);
    sgsi_warn_about_cells(job, meson->bounds[0], meson->bounds[1], meson->depth);
    sgsi_keyed_row *keys = sgsi_alloc(2 * n, sizeof *keys);
    float *rows = sgsi_alloc(n, SGS_PARAM_COUNT * sizeof *rows);
    double *scores = sgsi_alloc(n, sizeof *scores);
    meson->cells = sgsi_alloc(n, sizeof *meson->cells);
    const bool memory = keys && rows && scores && meson->cells;
    size_t count = 0;
    for (size_t i = 0; i < n && memory; ++i)
        keys[i] = (sgsi_keyed_row){code_of(meson, job->rows + i * SGS_PARAM_COUNT), (uint32_t)i};
    if (memory)
        sgsi_sort_rows(keys, keys + n, n);
    for (size_t i = 0; i < n && memory; ++count) {
        double sum[SGS_PARAM_COUNT] = {0};
        const size_t begin = i;
        scores[count] = 0;
        for (; i < n && keys[i].key == keys[begin].key; ++i) {
            for (size_t k = 0; k < SGS_PARAM_COUNT; ++k)
                sum[k] += (double)job->rows[keys[i].row * (size_t)SGS_PARAM_COUNT + k];
            scores[count] = fmax(scores[count], importance[keys[i].row]);
        }
        for (size_t k = 0; k < SGS_PARAM_COUNT; ++k)
            rows[count * SGS_PARAM_COUNT + k] = (float)(sum[k] / (double)(i - begin));
        meson->cells[count] = keys[begin].key;
    }
    if (memory) {
        memcpy(job->rows, rows, count * SGS_PARAM_COUNT * sizeof *rows);
        memcpy(importance, scores, count * sizeof *scores);
        job->count = meson->count = count;
    }
    sgsi_free(keys);
    sgsi_free(rows);
    sgsi_free(scores);
    return memory ? SGS_STATUS_OK
                  : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", n);
}

static sgs_status set_values(const sgsi_compress_job *job, sgsi_meson *meson)
{
    meson->values = sgsi_alloc(job->count, SGSI_MESON_VALUES * sizeof *meson->values);
    if (!meson->values)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu cells", job->count);
    for (size_t i = 0; i < job->count; ++i) {
        const float *row = job->rows + i * SGS_PARAM_COUNT;
        float *v = meson->values + i * SGSI_MESON_VALUES;
        v[0] = row[SGS_PARAM_OPACITY];
        memcpy(v + 1, row + SGS_PARAM_ROTATION, 4 * sizeof *v);
        memcpy(v + 5, row + SGS_PARAM_SH_DC, 3 * sizeof *v);
        memcpy(v + 8, row + SGS_PARAM_SCALE, 3 * sizeof *v);
        double length = 0; // unit quaternions: the rate of the rotation refers to them
        for (int k = 1; k < 5; ++k)
            length += (double)v[k] * v[k];
        for (int k = 1; k < 5 && length > 0; ++k)
            v[k] = (float)(v[k] / sqrt(length));
    }
    return SGS_STATUS_OK;
}

// ---- Codebook ----

typedef struct meson_training {
    uint32_t *slots, *rows, *times, *nearest;
    double *sums, *weights;
} meson_training;

static void start_codebook(const sgsi_compress_job *job, sgsi_codebook *codebook)
{
    float low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < job->count; ++i)
        for (size_t d = 0; d < codebook->dim; ++d) {
            const float x = job->rows[i * SGS_PARAM_COUNT + SGS_PARAM_SH_REST + d];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
    for (size_t k = 0; k < codebook->count * codebook->dim; ++k)
        codebook->codes[k] =
            (float)((double)low + ((double)high - (double)low) *
                                      sgsi_random_uniform(job->options->seed ^ 0xC0DE, k));
}

static void train_step(const sgsi_compress_job *job, sgsi_codebook *codebook, meson_training *t,
                       const double *importance, double most, uint64_t step)
{
    const size_t dim = codebook->dim;
    const float *data = job->rows + SGS_PARAM_SH_REST;
    const size_t distinct = sgsi_draw_batch(job->count, BATCH, job->options->seed ^ 0xBA7C, step,
                                            t->slots, t->rows, t->times);
    sgsi_codebook_assign(codebook, data, SGS_PARAM_COUNT, t->rows, distinct, t->nearest);
    memset(t->sums, 0, codebook->count * dim * sizeof *t->sums);
    memset(t->weights, 0, codebook->count * sizeof *t->weights);
    for (size_t k = 0; k < distinct; ++k) {
        const double w = t->times[k] * (most > 0 ? importance[t->rows[k]] / most : 1);
        const float *x = data + (size_t)t->rows[k] * SGS_PARAM_COUNT;
        t->weights[t->nearest[k]] += w;
        for (size_t d = 0; d < dim; ++d)
            t->sums[t->nearest[k] * dim + d] += w * (double)x[d];
    }
    for (size_t k = 0; k < codebook->count; ++k)
        for (size_t d = 0; d < dim; ++d) {
            float *code = &codebook->codes[k * dim + d];
            *code = (float)(DECAY * (double)*code +
                            (1 - DECAY) * t->sums[k * dim + d] / (t->weights[k] + SMOOTHING));
        }
}

static sgs_status train_codebook(const sgsi_compress_job *job, sgsi_meson *meson,
                                 const double *importance)
{
    const size_t dim = 3 * (size_t)sgsi_sh_rest_count(job->sh_degree);
    const size_t codes = (size_t)job->options->codebook, n = job->count;
    if (!dim)
        return SGS_STATUS_OK;
    sgs_status status = sgsi_codebook_create(codes, dim, &meson->codebook);
    meson_training t = {.slots = sgsi_alloc(n, sizeof *t.slots),
                        .rows = sgsi_alloc(n, sizeof *t.rows),
                        .times = sgsi_alloc(n, sizeof *t.times),
                        .nearest = sgsi_alloc(n, sizeof *t.nearest),
                        .sums = sgsi_alloc(codes, dim * sizeof *t.sums),
                        .weights = sgsi_alloc(codes, sizeof *t.weights)};
    if (!status && !(t.slots && t.rows && t.times && t.nearest && t.sums && t.weights))
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a codebook");
    const size_t steps = (size_t)job->options->vq_steps;
    double most = 0;
    if (!status) {
        memset(t.slots, 0xff, n * sizeof *t.slots);
        start_codebook(job, &meson->codebook);
        for (size_t i = 0; i < n; ++i)
            most = fmax(most, importance[i]);
    }
    for (size_t step = 0; step < steps && !status; ++step) {
        status = sgsi_compress_progress(job, "training the codebook", step, steps);
        if (!status)
            train_step(job, &meson->codebook, &t, importance, most, step);
    }
    if (!status) {
        for (size_t i = 0; i < n; ++i)
            t.rows[i] = (uint32_t)i;
        sgsi_codebook_assign(&meson->codebook, job->rows + SGS_PARAM_SH_REST, SGS_PARAM_COUNT,
                             t.rows, n, t.nearest);
        meson->labels = t.nearest;
        t.nearest = NULL;
    }
    sgsi_free(t.slots);
    sgsi_free(t.rows);
    sgsi_free(t.times);
    sgsi_free(t.nearest);
    sgsi_free(t.sums);
    sgsi_free(t.weights);
    return status;
}

// ---- Sections ----

static void add_codebook(sgsi_packer *out, const sgsi_meson *meson)
{
    const int bits = sgsi_bit_width(meson->codebook.count);
    const size_t size = sgsi_bit_bytes(meson->count, bits);
    uint8_t *labels = sgsi_calloc(size, 1);
    if (!labels) {
        out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu cells", meson->count);
        return;
    }
    for (size_t i = 0; i < meson->count; ++i)
        sgsi_bits_put(labels, i, bits, meson->labels[i]);
    sgsi_packer_add(out, "labels", labels, size, true);
    sgsi_packer_add(out, "codebook", meson->codebook.codes,
                    meson->codebook.count * meson->codebook.dim * sizeof(float), true);
    sgsi_free(labels);
}

static void add_blocks(sgsi_packer *out, const sgsi_meson *meson)
{
    const size_t count = meson->blocks * SGSI_MESON_CHANNELS;
    float *scales = sgsi_alloc(count, sizeof *scales);
    uint8_t *zeros = sgsi_alloc(count, 1);
    for (size_t k = 0; k < count && scales && zeros; ++k) {
        scales[k] = meson->ranges[k].scale;
        zeros[k] = meson->ranges[k].zero;
    }
    if (scales && zeros) {
        sgsi_packer_add(out, "block_scales", scales, count * sizeof *scales, true);
        sgsi_packer_add(out, "block_zeros", zeros, count, true);
    } else {
        out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu blocks", count);
    }
    sgsi_free(scales);
    sgsi_free(zeros);
}

static void add_sections(sgsi_packer *out, const sgsi_meson *meson)
{
    meson_header header = {.depth = (uint32_t)meson->depth,
                           .blocks = (uint32_t)meson->blocks,
                           .codes = (uint32_t)meson->codebook.count,
                           .center = meson->center};
    memcpy(header.bounds, meson->bounds, sizeof header.bounds);
    memcpy(header.dc, meson->dc, sizeof header.dc);
    sgsi_packer_add(out, "header", &header, sizeof header, false);
    sgsi_pack_cells(out, meson->cells, meson->count);
    add_blocks(out, meson);
    sgsi_packer_add(out, "codes", meson->codes, meson->count * SGSI_MESON_CHANNELS, true);
    if (meson->codebook.dim)
        add_codebook(out, meson);
}

// ---- The method ----

static void defaults(sgs_compress_options *options)
{
    static const double keep[] = {0.7, 0.5, 0.3};
    if (options->keep == 0)
        options->keep = keep[options->preset - 1];
    if (options->codebook == 0)
        options->codebook = CODES;
    if (options->vq_steps == 0)
        options->vq_steps = 1000;
    if (options->depth == 0)
        options->depth = DEPTH;
    if (options->blocks == 0)
        options->blocks = BLOCKS;
}

static sgs_status encode(sgsi_compress_job *job)
{
    const sgs_compress_options *options = job->options;
    int iterations;
    sgs_status status = sgsi_finetune_iterations(job, FINETUNE, &iterations);
    if (status)
        return status;
    sgsi_meson meson = {.depth = options->depth,
                        .sh_degree = job->sh_degree,
                        .center = options->cell_center,
                        .blocks = (size_t)options->blocks};
    double *importance = sgsi_alloc(job->count, sizeof *importance);
    status = importance ? sgsi_blending_importance(job, importance)
                        : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                    "not enough memory for %zu primitives", job->count);
    if (!status)
        status = prune(job, importance);
    if (!status)
        status = build_octree(job, &meson, importance);
    if (!status)
        status = set_values(job, &meson);
    if (!status)
        status = train_codebook(job, &meson, importance);
    if (!status)
        status = sgsi_meson_prepare(&meson);
    if (!status && iterations)
        status = sgsi_meson_finetune(job, &meson, iterations);
    else if (!status)
        sgsi_meson_quantise(&meson);
    if (!status) {
        job->out->header.count = meson.count;
        add_sections(job->out, &meson);
        status = job->out->status;
    }
    sgsi_meson_free(&meson);
    sgsi_free(importance);
    return status;
}

static sgs_status take_header(sgsi_container *in, sgsi_meson *meson)
{
    const uint8_t *bytes;
    meson_header header;
    const sgs_status status = sgsi_container_take(in, "header", sizeof header, &bytes, NULL);
    if (status)
        return status;
    memcpy(&header, bytes, sizeof header);
    const size_t dim = 3 * (size_t)sgsi_sh_rest_count((int)in->header.sh_degree);
    const uint64_t most = in->header.count > 1 ? in->header.count - 1 : 1;
    if (header.depth < 1 || header.depth > MAX_DEPTH || header.blocks < 1 ||
        header.blocks > 65536 || header.blocks > most || header.center > 1 ||
        header.codes > 65536 || (header.codes > 0) != (dim > 0))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section 'header': depth %u, %u blocks or %u codes are invalid",
                         in->path, header.depth, header.blocks, header.codes);
    *meson = (sgsi_meson){.count = in->header.count,
                          .depth = (int)header.depth,
                          .sh_degree = (int)in->header.sh_degree,
                          .center = header.center,
                          .blocks = header.blocks,
                          .codebook = {.count = header.codes, .dim = dim}};
    memcpy(meson->bounds, header.bounds, sizeof meson->bounds);
    memcpy(meson->dc, header.dc, sizeof meson->dc);
    return SGS_STATUS_OK;
}

static sgs_status take_codebook(sgsi_container *in, sgsi_meson *meson)
{
    const uint8_t *labels, *codes;
    const size_t codes_count = meson->codebook.count, dim = meson->codebook.dim;
    if (!dim)
        return SGS_STATUS_OK;
    const int bits = sgsi_bit_width(codes_count);
    sgs_status status = sgsi_container_take(
        in, "labels", (int64_t)sgsi_bit_bytes(meson->count, bits), &labels, NULL);
    if (!status)
        status = sgsi_container_take(in, "codebook", (int64_t)(codes_count * dim * sizeof(float)),
                                     &codes, NULL);
    if (!status)
        status = sgsi_codebook_create(codes_count, dim, &meson->codebook);
    if (status)
        return status;
    memcpy(meson->codebook.codes, codes, codes_count * dim * sizeof(float));
    meson->labels = sgsi_alloc(meson->count, sizeof *meson->labels);
    if (!meson->labels)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu cells", in->path,
                         meson->count);
    for (size_t i = 0; i < meson->count; ++i) {
        meson->labels[i] = sgsi_bits_get(labels, i, bits);
        if (meson->labels[i] >= codes_count)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: section 'labels': entry %zu is beyond the codebook", in->path, i);
    }
    return SGS_STATUS_OK;
}

static sgs_status take_codes(sgsi_container *in, sgsi_meson *meson)
{
    const uint8_t *scales, *zeros, *codes;
    const size_t count = meson->blocks * SGSI_MESON_CHANNELS;
    sgs_status status =
        sgsi_container_take(in, "block_scales", (int64_t)(count * sizeof(float)), &scales, NULL);
    if (!status)
        status = sgsi_container_take(in, "block_zeros", (int64_t)count, &zeros, NULL);
    if (!status)
        status = sgsi_container_take(in, "codes", (int64_t)(meson->count * SGSI_MESON_CHANNELS),
                                     &codes, NULL);
    if (!status)
        status = sgsi_container_finish(in);
    if (!status)
        status = sgsi_meson_prepare(meson);
    if (status)
        return status;
    memcpy(meson->codes, codes, meson->count * SGSI_MESON_CHANNELS);
    for (size_t k = 0; k < count; ++k) {
        memcpy(&meson->ranges[k].scale, scales + k * sizeof(float), sizeof(float));
        meson->ranges[k].zero = zeros[k];
    }
    return SGS_STATUS_OK;
}

static sgs_status decode(sgsi_container *in, sgs_gaussians **model)
{
    sgsi_meson meson = {0};
    sgs_status status = take_header(in, &meson);
    if (!status)
        status = sgsi_unpack_cells(in, meson.count, 3 * meson.depth, true, &meson.cells);
    if (!status)
        status = take_codebook(in, &meson);
    if (!status)
        status = take_codes(in, &meson);
    if (!status)
        status = sgsi_decoded_create(in, model);
    if (!status)
        sgsi_meson_reconstruct(&meson, *model);
    sgsi_meson_free(&meson);
    return status;
}

const sgsi_compress_method sgsi_method_mesongs = {
    .name = "mesongs", .version = 1, .defaults = defaults, .encode = encode, .decode = decode};
