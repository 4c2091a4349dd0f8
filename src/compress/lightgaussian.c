// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// LightGaussian (Fan et al. 2024), section 3.4: the SH coefficients of the least significant
// primitives are replaced by entries of a codebook (VecTree quantisation). Constants are those of
// the authors' released code; pruning and the distillation to a lower SH degree (distill.h)
// are options. Fine-tuning after pruning uses the learning rates of pipeline 3dgs, not the released
// ones (opacity 0.05, all rates times 0.95 every 400 iterations).
//
// The codebook starts uniform in +-sqrt(6 / (K dim)). In each of 1000 steps, 80 000 rows are drawn
// with replacement, with weights w proportional to the significance and mean 1, and assigned to the
// nearest code. With the EMA sizes n (decay 0.8) and their smoothed form
// n' = (n + 1e-5) / (sum n + K 1e-5) sum n, code = 0.8 code + 0.2 (sum w x) / n', as released: the
// sum of the batch over the size of all batches. Then the ten codes of smallest n become the ten
// rows of largest weight.
//
// The sections hold floats of 32 bits, or of 16 with option `half`; halves below 6.1e-5 become 0.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "compress/bit_stream.h"
#include "compress/compress_method.h"
#include "compress/distill.h"
#include "compress/importance.h"
#include "compress/vq.h"
#include "image/half.h"
#include "sparegs/prune.h"
#include "prune/scores.h"

enum { BATCH = 80000, REPLACED = 10, FINETUNE = 5000 };
static const double DECAY = 0.8, SMOOTHING = 1e-5;

typedef struct light_header {
    uint32_t codes, dim, quantised, half;
} light_header;

// ---- Floats of 32 or 16 bits ----

static uint16_t to_half(float x)
{
    return (uint16_t)(sgsi_half_from_float(fabsf(x)) | (signbit(x) ? 0x8000 : 0));
}

static float from_half(uint16_t h)
{
    const float x = sgsi_half_to_float(h & 0x7fff);
    return h & 0x8000 ? -x : x;
}

static void add_values(sgsi_packer *out, const char *name, const float *values, size_t count,
                       bool half)
{
    if (!half) {
        sgsi_packer_add(out, name, values, count * sizeof *values, true);
        return;
    }
    uint16_t *halves = sgsi_alloc(count + 1, sizeof *halves);
    if (!halves) {
        out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu values", count);
        return;
    }
    for (size_t i = 0; i < count; ++i)
        halves[i] = to_half(values[i]);
    sgsi_packer_add(out, name, halves, count * sizeof *halves, true);
    sgsi_free(halves);
}

static float value_at(const uint8_t *bytes, size_t i, bool half)
{
    if (half) {
        uint16_t h;
        memcpy(&h, bytes + 2 * i, sizeof h);
        return from_half(h);
    }
    float x;
    memcpy(&x, bytes + 4 * i, sizeof x);
    return x;
}

// ---- Codebook ----

typedef struct light_training {
    const sgsi_compress_job *job;
    const float *data; // SH of all rows: data + row * SGS_PARAM_COUNT
    const double *importance;
    const uint32_t *quantised; // [count] rows
    size_t count;
    sgsi_codebook codebook;
    double *sizes, *sums;                             // [K], [K][dim]
    uint32_t *slots, *drawn, *times, *rows, *nearest; // rows of the batch
} light_training;

static sgs_status training_create(light_training *t, size_t codes, size_t dim)
{
    sgs_status status = sgsi_codebook_create(codes, dim, &t->codebook);
    const size_t batch = t->count < BATCH ? t->count : BATCH;
    t->sizes = sgsi_calloc(codes, sizeof *t->sizes);
    t->sums = sgsi_calloc(codes, dim * sizeof *t->sums);
    t->slots = sgsi_alloc(t->count + 1, sizeof *t->slots);
    t->drawn = sgsi_alloc(batch + 1, sizeof *t->drawn);
    t->times = sgsi_alloc(batch + 1, sizeof *t->times);
    t->rows = sgsi_alloc(batch + 1, sizeof *t->rows);
    t->nearest = sgsi_alloc(t->count + 1, sizeof *t->nearest);
    if (!status &&
        !(t->sizes && t->sums && t->slots && t->drawn && t->times && t->rows && t->nearest))
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a codebook");
    if (status)
        return status;
    memset(t->slots, 0xff, t->count * sizeof *t->slots);
    const double bound = sqrt(6 / ((double)codes * (double)dim));
    for (size_t k = 0; k < codes * dim; ++k)
        t->codebook.codes[k] =
            (float)(bound * (2 * sgsi_random_uniform(t->job->options->seed ^ 0xC0DE, k) - 1));
    return SGS_STATUS_OK;
}

static void training_free(light_training *t)
{
    sgsi_codebook_free(&t->codebook);
    sgsi_free(t->sizes);
    sgsi_free(t->sums);
    sgsi_free(t->slots);
    sgsi_free(t->drawn);
    sgsi_free(t->times);
    sgsi_free(t->rows);
    sgsi_free(t->nearest);
}

// Codes of smallest EMA size become the rows of largest weight.
static void replace_codes(light_training *t, size_t distinct)
{
    uint32_t best[REPLACED];
    size_t chosen = 0;
    for (size_t k = 0; k < distinct; ++k) { // insertion into the sorted list of the largest
        const double w = t->importance[t->rows[k]];
        size_t at = chosen;
        while (at > 0 && w > t->importance[best[at - 1]])
            --at;
        if (at == REPLACED)
            continue;
        chosen += chosen < REPLACED;
        memmove(best + at + 1, best + at, (chosen - at - 1) * sizeof *best);
        best[at] = t->rows[k];
    }
    const size_t dim = t->codebook.dim;
    size_t least[REPLACED], found = 0;
    for (size_t k = 0; k < t->codebook.count; ++k) {
        size_t at = found;
        while (at > 0 && t->sizes[k] < t->sizes[least[at - 1]])
            --at;
        if (at == REPLACED)
            continue;
        found += found < REPLACED;
        memmove(least + at + 1, least + at, (found - at - 1) * sizeof *least);
        least[at] = k;
    }
    for (size_t k = 0; k < chosen && k < found; ++k)
        memcpy(t->codebook.codes + least[k] * dim, t->data + (size_t)best[k] * SGS_PARAM_COUNT,
               dim * sizeof(float));
}

static void train_step(light_training *t, uint64_t step)
{
    const size_t codes = t->codebook.count, dim = t->codebook.dim;
    const size_t distinct = sgsi_draw_batch(t->count, BATCH, t->job->options->seed ^ 0xBA7C, step,
                                            t->slots, t->drawn, t->times);
    double total = 0, sum = 0;
    for (size_t k = 0; k < distinct; ++k) {
        t->rows[k] = t->quantised[t->drawn[k]];
        total += t->times[k] * t->importance[t->rows[k]];
    }
    const double scale = total > 0 ? BATCH / total : 0;
    sgsi_codebook_assign(&t->codebook, t->data, SGS_PARAM_COUNT, t->rows, distinct, t->nearest);
    memset(t->sums, 0, codes * dim * sizeof *t->sums);
    for (size_t k = 0; k < codes; ++k)
        t->sizes[k] *= DECAY;
    for (size_t k = 0; k < distinct; ++k) {
        const double w = t->times[k] * t->importance[t->rows[k]] * scale;
        const float *x = t->data + (size_t)t->rows[k] * SGS_PARAM_COUNT;
        double *into = t->sums + t->nearest[k] * dim;
        t->sizes[t->nearest[k]] += (1 - DECAY) * w;
        for (size_t d = 0; d < dim; ++d)
            into[d] += w * (double)x[d];
    }
    for (size_t k = 0; k < codes; ++k)
        sum += t->sizes[k];
    for (size_t k = 0; k < codes; ++k) {
        const double size = (t->sizes[k] + SMOOTHING) / (sum + (double)codes * SMOOTHING) * sum;
        float *code = t->codebook.codes + k * dim;
        for (size_t d = 0; d < dim; ++d)
            code[d] = (float)(DECAY * (double)code[d] +
                              (size > 0 ? (1 - DECAY) * t->sums[k * dim + d] / size : 0));
    }
    replace_codes(t, distinct);
}

// Trains the codebook and assigns all rows to `nearest`.
static sgs_status train_codebook(light_training *t)
{
    const int steps = t->job->options->vq_steps;
    for (int step = 0; step < steps && t->count; ++step) {
        const sgs_status status =
            sgsi_compress_progress(t->job, "training the codebook", (size_t)step, (size_t)steps);
        if (status)
            return status;
        train_step(t, (uint64_t)step);
    }
    // Decoders see the codes as 16-bit floats.
    for (size_t k = 0; k < t->codebook.count * t->codebook.dim; ++k)
        t->codebook.codes[k] = from_half(to_half(t->codebook.codes[k]));
    sgsi_codebook_assign(&t->codebook, t->data, SGS_PARAM_COUNT, t->quantised, t->count,
                         t->nearest);
    return SGS_STATUS_OK;
}

// ---- Encoding ----

typedef struct score_key {
    double score;
    uint32_t row;
} score_key;

static int by_score(const void *a, const void *b)
{
    const score_key *x = a, *y = b;
    return x->score != y->score ? (x->score > y->score) - (x->score < y->score)
                                : (x->row > y->row) - (x->row < y->row);
}

// The `count` rows of smallest importance, in ascending order of the rows; `exact`: [job->count].
static sgs_status choose_quantised(const sgsi_compress_job *job, const double *importance,
                                   size_t count, uint32_t *rows, bool *exact)
{
    score_key *keys = sgsi_alloc(job->count, sizeof *keys);
    if (!keys)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         job->count);
    for (size_t i = 0; i < job->count; ++i)
        keys[i] = (score_key){importance[i], (uint32_t)i};
    qsort(keys, job->count, sizeof *keys, by_score);
    for (size_t i = 0; i < job->count; ++i)
        exact[keys[i].row] = i >= count;
    sgsi_free(keys);
    for (size_t i = 0, k = 0; i < job->count; ++i)
        if (!exact[i])
            rows[k++] = (uint32_t)i;
    return SGS_STATUS_OK;
}

// Values of some parameters, planar: [param_count][rows with the flag].
static void add_planes(const sgsi_compress_job *job, const char *name, int param, int param_count,
                       const bool *keep, bool half)
{
    float *values = sgsi_alloc(job->count * (size_t)param_count + 1, sizeof *values);
    size_t count = 0;
    if (!values) {
        job->out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", job->count);
        return;
    }
    for (int k = 0; k < param_count; ++k)
        for (size_t i = 0; i < job->count; ++i)
            if (!keep || keep[i])
                values[count++] = job->rows[i * SGS_PARAM_COUNT + (size_t)(param + k)];
    add_values(job->out, name, values, count, half);
    sgsi_free(values);
}

// Quaternions of other programs may have any length; the components of a short one would become 0
// as halves.
static void normalise_rotations(const sgsi_compress_job *job)
{
    for (size_t i = 0; i < job->count; ++i) {
        float *q = job->rows + i * SGS_PARAM_COUNT + SGS_PARAM_ROTATION;
        const double length = sqrt((double)q[0] * q[0] + (double)q[1] * q[1] + (double)q[2] * q[2] +
                                   (double)q[3] * q[3]);
        for (int k = 0; k < 4 && length > 0 && !(length >= 0.0625 && length <= 16); ++k)
            q[k] = (float)(q[k] / length);
    }
}

static void add_sections(const sgsi_compress_job *job, const light_training *t, const bool *exact)
{
    const bool half = job->options->half;
    const size_t dim = t->codebook.dim;
    const light_header header = {(uint32_t)t->codebook.count, (uint32_t)dim, (uint32_t)t->count,
                                 half};
    const int bits = sgsi_bit_width(t->codebook.count);
    uint8_t *mask = sgsi_calloc(sgsi_bit_bytes(job->count, 1) + 1, 1);
    uint8_t *indices = sgsi_calloc(sgsi_bit_bytes(t->count, bits) + 1, 1);
    if (!mask || !indices) {
        job->out->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", job->count);
    } else {
        for (size_t i = 0; i < job->count; ++i)
            sgsi_bits_put(mask, i, 1, exact[i]);
        for (size_t k = 0; k < t->count; ++k)
            sgsi_bits_put(indices, k, bits, t->nearest[k]);
        sgsi_packer_add(job->out, "header", &header, sizeof header, false);
        add_planes(job, "mean", SGS_PARAM_MEAN, 3, NULL, false);
        add_planes(job, "rotation", SGS_PARAM_ROTATION, 4, NULL, half);
        add_planes(job, "scale", SGS_PARAM_SCALE, 3, NULL, half);
        add_planes(job, "opacity", SGS_PARAM_OPACITY, 1, NULL, half);
        sgsi_packer_add(job->out, "exact", mask, sgsi_bit_bytes(job->count, 1), true);
        add_planes(job, "sh", SGS_PARAM_SH_DC, (int)dim, exact, half);
        sgsi_packer_add(job->out, "indices", indices, sgsi_bit_bytes(t->count, bits), true);
        add_values(job->out, "codebook", t->codebook.codes, t->codebook.count * dim, true);
    }
    sgsi_free(mask);
    sgsi_free(indices);
}

// Removes the least significant primitives and trains the others; `importance` is scratch.
static sgs_status prune(sgsi_compress_job *job, double *importance)
{
    bool *keep = sgsi_alloc(job->count, sizeof *keep);
    size_t kept = 0;
    sgs_status status = keep ? sgsi_significance(job, importance)
                             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                         "not enough memory for %zu primitives", job->count);
    if (!status)
        status = sgs_prune_select(SGS_PRUNE_LIGHTGAUSSIAN, importance, job->count,
                                  sgsi_other_share(job->options->keep), keep, &kept);
    if (!status && !kept)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "pruning removes all %zu primitives; keep a larger share", job->count);
    if (!status)
        sgsi_rows_keep(job, keep);
    sgsi_free(keep);
    return status ? status : sgsi_rows_finetune(job, FINETUNE);
}

static void defaults(sgs_compress_options *options)
{
    static const double ratio[] = {0.3, 0.5, 0.7};
    if (options->vq_ratio == 0)
        options->vq_ratio = ratio[options->preset - 1];
    if (options->codebook == 0)
        options->codebook = 8192;
    if (options->vq_steps == 0)
        options->vq_steps = 1000;
    if (options->keep == 0)
        options->keep = 1;
}

static sgs_status encode(sgsi_compress_job *job)
{
    double *importance = sgsi_alloc(job->count, sizeof *importance);
    bool *exact = sgsi_alloc(job->count, sizeof *exact);
    uint32_t *rows = sgsi_alloc(job->count, sizeof *rows);
    int iterations;
    sgs_status status = sgsi_finetune_iterations(job, FINETUNE, &iterations);
    if (!status && job->options->finetune > 0 && !(job->options->keep < 1))
        sgsi_warn("option finetune has no effect on LightGaussian unless keep is below 1");
    if (!status && (!importance || !exact || !rows))
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", job->count);
    if (!status && job->options->keep < 1 && !job->options->scene)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "option keep requires a scene, which gives the importance");
    if (!status && job->options->keep < 1)
        status = prune(job, importance);
    if (!status && job->options->distill)
        status = sgsi_distill(job, job->options->distill);
    if (!status) // of the final model, as released; the training has changed its order, too
        status = sgsi_significance(job, importance);
    light_training t = {.job = job,
                        .data = job->rows + SGS_PARAM_SH_DC,
                        .importance = importance,
                        .quantised = rows,
                        .count = (size_t)(job->options->vq_ratio * (double)job->count)};
    if (!status)
        status = choose_quantised(job, importance, t.count, rows, exact);
    if (!status)
        status = training_create(&t, (size_t)job->options->codebook,
                                 3 + 3 * (size_t)sgsi_sh_rest_count(job->sh_degree));
    if (!status)
        status = train_codebook(&t);
    if (!status) {
        job->out->header.count = job->count;
        job->out->header.sh_degree = (uint32_t)job->sh_degree;
        if (job->options->half)
            normalise_rotations(job);
        add_sections(job, &t, exact);
        status = job->out->status;
    }
    training_free(&t);
    sgsi_free(importance);
    sgsi_free(exact);
    sgsi_free(rows);
    return status;
}

// ---- Decoding ----

typedef struct light_sections {
    light_header header;
    const uint8_t *mean, *rotation, *scale, *opacity, *exact, *sh, *indices, *codebook;
    int bits;
} light_sections;

static sgs_status take_header(sgsi_container *in, light_header *header)
{
    const uint8_t *bytes;
    const sgs_status status = sgsi_container_take(in, "header", sizeof *header, &bytes, NULL);
    if (status)
        return status;
    memcpy(header, bytes, sizeof *header);
    const uint32_t dim = 3 + 3 * (uint32_t)sgsi_sh_rest_count((int)in->header.sh_degree);
    if (header->codes < 1 || header->codes > 65536 || header->dim != dim || header->half > 1 ||
        header->quantised > in->header.count)
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: section 'header': %u codes of %u values for %u primitives are invalid", in->path,
            header->codes, header->dim, header->quantised);
    return SGS_STATUS_OK;
}

static sgs_status take_sections(sgsi_container *in, light_sections *s)
{
    sgs_status status = take_header(in, &s->header);
    if (status)
        return status;
    const int64_t count = (int64_t)in->header.count, width = s->header.half ? 2 : 4;
    const int64_t dim = s->header.dim, quantised = s->header.quantised;
    s->bits = sgsi_bit_width(s->header.codes);
    const struct {
        const char *name;
        int64_t bytes;
        const uint8_t **data;
    } sections[] = {{"mean", 12 * count, &s->mean},
                    {"rotation", 4 * width * count, &s->rotation},
                    {"scale", 3 * width * count, &s->scale},
                    {"opacity", width * count, &s->opacity},
                    {"exact", (int64_t)sgsi_bit_bytes((size_t)count, 1), &s->exact},
                    {"sh", dim * width * (count - quantised), &s->sh},
                    {"indices", (int64_t)sgsi_bit_bytes((size_t)quantised, s->bits), &s->indices},
                    {"codebook", 2 * dim * (int64_t)s->header.codes, &s->codebook}};
    for (size_t k = 0; k < sizeof sections / sizeof *sections && !status; ++k)
        status =
            sgsi_container_take(in, sections[k].name, sections[k].bytes, sections[k].data, NULL);
    if (!status)
        status = sgsi_container_finish(in);
    size_t exact = 0;
    for (size_t i = 0; i < (size_t)count && !status; ++i)
        exact += sgsi_bits_get(s->exact, i, 1);
    if (!status && exact != (size_t)(count - quantised))
        status =
            sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'exact' marks %zu primitives instead of %lld",
                      in->path, exact, (long long)(count - quantised));
    for (size_t k = 0; k < (size_t)quantised && !status; ++k)
        if (sgsi_bits_get(s->indices, k, s->bits) >= s->header.codes)
            status =
                sgsi_fail(SGS_STATUS_FORMAT,
                          "%s: section 'indices': entry %zu is beyond the codebook", in->path, k);
    return status;
}

static sgs_status decode(sgsi_container *in, sgs_gaussians **model)
{
    light_sections s;
    sgs_status status = take_sections(in, &s);
    if (!status)
        status = sgsi_decoded_create(in, model);
    if (status)
        return status;
    const bool half = s.header.half;
    const size_t count = (*model)->count, exact = count - s.header.quantised, dim = s.header.dim;
    size_t next_exact = 0, next_code = 0;
    for (size_t i = 0; i < count; ++i) {
        float row[SGS_PARAM_COUNT] = {0};
        for (size_t k = 0; k < 3; ++k) {
            row[SGS_PARAM_MEAN + k] = value_at(s.mean, k * count + i, false);
            row[SGS_PARAM_SCALE + k] = value_at(s.scale, k * count + i, half);
        }
        for (size_t k = 0; k < 4; ++k)
            row[SGS_PARAM_ROTATION + k] = value_at(s.rotation, k * count + i, half);
        row[SGS_PARAM_OPACITY] = value_at(s.opacity, i, half);
        if (sgsi_bits_get(s.exact, i, 1)) {
            for (size_t k = 0; k < dim; ++k)
                row[SGS_PARAM_SH_DC + k] = value_at(s.sh, k * exact + next_exact, half);
            ++next_exact;
        } else {
            const size_t code = sgsi_bits_get(s.indices, next_code++, s.bits);
            for (size_t k = 0; k < dim; ++k)
                row[SGS_PARAM_SH_DC + k] = value_at(s.codebook, code * dim + k, true);
        }
        sgs_gaussians_set(*model, i, row);
    }
    return SGS_STATUS_OK;
}

const sgsi_compress_method sgsi_method_lightgaussian = {.name = "lightgaussian",
                                                        .version = 1,
                                                        .defaults = defaults,
                                                        .encode = encode,
                                                        .decode = decode};
