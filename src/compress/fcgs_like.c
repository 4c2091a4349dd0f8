// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A codec with the structure of FCGS (Chen et al. 2025) but without its trained network: figures
// measured with it are not those of FCGS.
//
// Positions are cells of 16 bits per axis in Morton order. The other attributes are quantised
// uniformly. Primitives are coded in four groups of 1/6, 1/6, 2/6 and 2/6. The context of a value
// is the mean and the variance of the values that were already coded in the same cell of a grid
// (the finest level with at least eight primitives per occupied cell on average; its parent while
// the cell has fewer than two). The difference from the mean has a Laplace distribution per
// attribute and class of variance, i.e. its magnitude is geometric; share of zeros and decay are
// fitted to the model and stored, and start the adaptive models of a binary range coder. Only
// integers are used until the values are scaled by their steps.
//
// Layout 1 had 12 classes and truncated the mean in the variance; it is refused.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/morton.h"
#include "base/keyed_rows.h"
#include "compress/cell_codes.h"
#include "compress/compress_method.h"
#include "compress/range_coder.h"

enum {
    POSITION_BITS = 16,
    MAX_VALUES = SGS_PARAM_COUNT - 3,
    CLASSES = 20, // 0 to 17: variance; one neighbour; none
    CLASS_ONE = 18,
    CLASS_NONE = 19,
    UNARY = 16,
    EXPONENTS = 24,
    CELL_PRIMITIVES = 8,
    MAX_CELL_COUNT = 4096, // later values do not change the context
    GROUPS = 4
};
static const int32_t MAX_VALUE = 1 << 20;

// ---- Quantiser ----

// Step of parameter 3 + v at scale 1.
static double step_of(int v)
{
    const int param = v + 3;
    if (param < SGS_PARAM_SCALE)
        return 0.02;
    if (param < SGS_PARAM_OPACITY)
        return 0.08;
    if (param == SGS_PARAM_OPACITY)
        return 0.25;
    if (param < SGS_PARAM_SH_REST)
        return 0.04;
    const int coefficient = (param - SGS_PARAM_SH_REST) / 3;
    return coefficient < 3 ? 0.05 : coefficient < 8 ? 0.075 : 0.1;
}

// ---- Models ----

typedef struct value_model {
    sgsi_bit_model zero, sign, unary[UNARY], exponent[EXPONENTS];
} value_model;

// What is stored of a class: probabilities in 1 / 256.
typedef struct class_start {
    uint8_t zero, decay;
} class_start;

typedef struct fitting {
    uint64_t count, zeros, magnitude; // magnitude: sum of |difference|
} fitting;

typedef enum walk_mode { WALK_FIT, WALK_ENCODE, WALK_DECODE } walk_mode;

typedef struct fcgs_walk {
    walk_mode mode;
    size_t count;
    int value_count;
    const uint64_t *cells;
    int32_t *values;                    // [count][value_count]
    uint32_t *nodes[2], nodes_count[2]; // per primitive: its cell and the parent
    int32_t *counts[2];                 // [nodes]
    int64_t *sums[2], *squares[2];      // [nodes][value_count]
    fitting (*fits)[CLASSES];           // [value_count]
    value_model (*models)[CLASSES];
    sgsi_range_encoder encoder;
    sgsi_range_decoder decoder;
} fcgs_walk;

// Numbers the runs of equal codes without their lowest 3 * level bits.
static uint32_t number_nodes(const fcgs_walk *walk, int level, uint32_t *nodes)
{
    uint32_t count = 0;
    for (size_t i = 0; i < walk->count; ++i) {
        count += i && walk->cells[i] >> 3 * level != walk->cells[i - 1] >> 3 * level;
        nodes[i] = count;
    }
    return count + 1;
}

static sgs_status walk_create(fcgs_walk *walk)
{
    const size_t values = (size_t)walk->value_count;
    for (int k = 0; k < 2; ++k)
        walk->nodes[k] = sgsi_alloc(walk->count, sizeof(uint32_t));
    walk->fits = sgsi_calloc(values, sizeof *walk->fits);
    walk->models = sgsi_calloc(values, sizeof *walk->models);
    if (!walk->nodes[0] || !walk->nodes[1] || !walk->fits || !walk->models)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         walk->count);
    int level = 0;
    uint32_t count = number_nodes(walk, 0, walk->nodes[0]);
    while (level < POSITION_BITS && count > walk->count / CELL_PRIMITIVES + 1)
        count = number_nodes(walk, ++level, walk->nodes[0]);
    walk->nodes_count[0] = count;
    walk->nodes_count[1] =
        number_nodes(walk, level < POSITION_BITS ? level + 1 : level, walk->nodes[1]);
    for (int k = 0; k < 2; ++k) {
        walk->counts[k] = sgsi_calloc(walk->nodes_count[k], sizeof(int32_t));
        walk->sums[k] = sgsi_calloc(walk->nodes_count[k], values * sizeof(int64_t));
        walk->squares[k] = sgsi_calloc(walk->nodes_count[k], values * sizeof(int64_t));
        if (!walk->counts[k] || !walk->sums[k] || !walk->squares[k])
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                             walk->count);
    }
    return SGS_STATUS_OK;
}

static void walk_free(fcgs_walk *walk)
{
    for (int k = 0; k < 2; ++k) {
        sgsi_free(walk->nodes[k]);
        sgsi_free(walk->counts[k]);
        sgsi_free(walk->sums[k]);
        sgsi_free(walk->squares[k]);
    }
    sgsi_free(walk->fits);
    sgsi_free(walk->models);
    sgsi_free(walk->encoder.bytes);
}

// The fitted starts, or their inverse, to the models of the coder.
static void set_models(fcgs_walk *walk, const class_start *starts)
{
    for (int v = 0; v < walk->value_count; ++v)
        for (int c = 0; c < CLASSES; ++c) {
            value_model *model = &walk->models[v][c];
            const class_start *start = &starts[v * CLASSES + c];
            model->zero = (uint16_t)(start->zero << 8 | 128);
            model->sign = 32768;
            for (int k = 0; k < UNARY; ++k)
                model->unary[k] = (uint16_t)(start->decay << 8 | 128);
            for (int k = 0; k < EXPONENTS; ++k)
                model->exponent[k] = 32768;
        }
}

static uint8_t share(uint64_t part, uint64_t total)
{
    const uint64_t scaled = total ? part * 256 / total : 128;
    return (uint8_t)(scaled < 4 ? 4 : scaled > 251 ? 251 : scaled);
}

// Zero: share of zeros. Decay: probability that a magnitude above 0 ends, 1 / its mean.
static void fit_starts(const fcgs_walk *walk, class_start *starts)
{
    for (int v = 0; v < walk->value_count; ++v)
        for (int c = 0; c < CLASSES; ++c) {
            const fitting *fit = &walk->fits[v][c];
            starts[v * CLASSES + c] = (class_start){share(fit->zeros, fit->count),
                                                    share(fit->count - fit->zeros, fit->magnitude)};
        }
}

// ---- One value ----

// Mean and class of the coded neighbours.
static int context_of(const fcgs_walk *walk, size_t i, int v, int32_t *mean)
{
    const int k = walk->counts[0][walk->nodes[0][i]] >= 2 ? 0 : 1;
    const size_t node = walk->nodes[k][i], at = node * (size_t)walk->value_count + (size_t)v;
    const int64_t count = walk->counts[k][node];
    *mean = 0;
    if (!count)
        return CLASS_NONE;
    const int64_t sum = walk->sums[k][at], twice = 2 * sum + count;
    *mean = (int32_t)(twice >= 0 ? twice / (2 * count) : -((-twice + 2 * count - 1) / (2 * count)));
    if (count == 1)
        return CLASS_ONE;
    // 16 times the variance, in integers of less than 2^57: |sum| is at most 2^32, count 2^12.
    const int64_t remainder = sum % count * sum / count; // of sum^2 / count
    int64_t variance = (walk->squares[k][at] - sum / count * sum - remainder) * 16 / count;
    int class = 0;
    for (; variance > 1 && class < CLASS_ONE - 1; variance >>= 1)
        ++class;
    return class;
}

static void encode_difference(sgsi_range_encoder *e, value_model *model, int32_t difference)
{
    sgsi_range_encode(e, &model->zero, difference != 0);
    if (!difference)
        return;
    sgsi_range_encode(e, &model->sign, difference < 0);
    uint32_t rest = (uint32_t)abs(difference) - 1;
    for (int k = 0; k < UNARY; ++k) {
        sgsi_range_encode(e, &model->unary[k], rest > (uint32_t)k);
        if (rest == (uint32_t)k)
            return;
    }
    rest -= UNARY; // Exp-Golomb: the number of bits in unary, then the bits
    int bits = 0;
    while ((rest + 1) >> (bits + 1))
        ++bits;
    for (int k = 0; k < bits; ++k)
        sgsi_range_encode(e, &model->exponent[k], 1);
    sgsi_range_encode(e, &model->exponent[bits], 0);
    for (int k = bits; k-- > 0;) {
        sgsi_bit_model even = 32768;
        sgsi_range_encode(e, &even, (int)((rest + 1) >> k & 1));
    }
}

static int32_t decode_difference(sgsi_range_decoder *d, value_model *model)
{
    if (!sgsi_range_decode(d, &model->zero))
        return 0;
    const bool negative = sgsi_range_decode(d, &model->sign);
    uint32_t rest = 0;
    while (rest < UNARY && sgsi_range_decode(d, &model->unary[rest]))
        ++rest;
    if (rest == UNARY) {
        int bits = 0;
        while (bits < EXPONENTS - 1 && sgsi_range_decode(d, &model->exponent[bits]))
            ++bits;
        uint32_t value = 1;
        for (int k = 0; k < bits; ++k) {
            sgsi_bit_model even = 32768;
            value = value << 1 | (uint32_t)sgsi_range_decode(d, &even);
        }
        rest += value - 1;
    }
    const int32_t magnitude = (int32_t)rest + 1;
    return negative ? -magnitude : magnitude;
}

static void visit_value(fcgs_walk *walk, size_t i, int v)
{
    int32_t mean, *value = &walk->values[i * (size_t)walk->value_count + (size_t)v];
    const int class = context_of(walk, i, v, &mean);
    if (walk->mode == WALK_DECODE) {
        const int64_t sum =
            (int64_t)mean + decode_difference(&walk->decoder, &walk->models[v][class]);
        *value = (int32_t)(sum > MAX_VALUE ? MAX_VALUE : sum < -MAX_VALUE ? -MAX_VALUE : sum);
    } else if (walk->mode == WALK_ENCODE) {
        encode_difference(&walk->encoder, &walk->models[v][class], *value - mean);
    } else {
        fitting *fit = &walk->fits[v][class];
        ++fit->count;
        fit->zeros += *value == mean;
        fit->magnitude += (uint64_t)llabs((long long)*value - mean);
    }
}

static void add_to_grid(fcgs_walk *walk, size_t i)
{
    const size_t values = (size_t)walk->value_count;
    for (int k = 0; k < 2; ++k) {
        const size_t node = walk->nodes[k][i];
        if (walk->counts[k][node] >= MAX_CELL_COUNT)
            continue;
        ++walk->counts[k][node];
        for (size_t v = 0; v < values; ++v) {
            const int64_t x = walk->values[i * values + v];
            walk->sums[k][node * values + v] += x;
            walk->squares[k][node * values + v] += x * x;
        }
    }
}

static void clear_grid(fcgs_walk *walk)
{
    const size_t values = (size_t)walk->value_count;
    for (int k = 0; k < 2; ++k) {
        memset(walk->counts[k], 0, walk->nodes_count[k] * sizeof(int32_t));
        memset(walk->sums[k], 0, walk->nodes_count[k] * values * sizeof(int64_t));
        memset(walk->squares[k], 0, walk->nodes_count[k] * values * sizeof(int64_t));
    }
}

// The group of a primitive: 1/6, 1/6, 2/6, 2/6 of them.
static int group_of(size_t i)
{
    static const uint8_t groups[6] = {0, 1, 2, 2, 3, 3};
    return groups[sgsi_random_bits(1, i) % 6];
}

static void walk_all(fcgs_walk *walk, walk_mode mode)
{
    walk->mode = mode;
    clear_grid(walk);
    for (int group = 0; group < GROUPS; ++group)
        for (size_t i = 0; i < walk->count && !walk->decoder.overrun; ++i) {
            if (group_of(i) != group)
                continue;
            for (int v = 0; v < walk->value_count; ++v)
                visit_value(walk, i, v);
            add_to_grid(walk, i);
        }
}

// ---- Encoding ----

typedef struct fcgs_header {
    float low[3], high[3], step_scale;
    uint32_t reserved;
} fcgs_header;

static void set_bounds(const sgsi_compress_job *job, fcgs_header *header)
{
    for (int k = 0; k < 3; ++k) {
        header->low[k] = header->high[k] = job->rows[k];
        for (size_t i = 0; i < job->count; ++i) {
            const float x = job->rows[i * SGS_PARAM_COUNT + (size_t)k];
            header->low[k] = x < header->low[k] ? x : header->low[k];
            header->high[k] = x > header->high[k] ? x : header->high[k];
        }
    }
}

static void fill_keys(const sgsi_compress_job *job, const fcgs_header *header, sgsi_keyed_row *keys)
{
    const double side = (double)(1 << POSITION_BITS);
    for (size_t i = 0; i < job->count; ++i) {
        keys[i] = (sgsi_keyed_row){.row = (uint32_t)i};
        for (int k = 0; k < 3; ++k) {
            const double low = (double)header->low[k], span = (double)header->high[k] - low;
            const double x = (double)job->rows[i * SGS_PARAM_COUNT + (size_t)k];
            const double at = span > 0 ? floor((x - low) / span * side) : 0;
            keys[i].key |= sgsi_spread_bits((uint64_t)(at < side - 1 ? at : side - 1)) << (2 - k);
        }
    }
    sgsi_sort_rows(keys, keys + job->count, job->count);
}

static void quantise_row(const float *row, double step_scale, int value_count, int32_t *values)
{
    double length = 0;
    for (int k = 0; k < 4; ++k)
        length += (double)row[SGS_PARAM_ROTATION + k] * (double)row[SGS_PARAM_ROTATION + k];
    length = length > 0 ? (row[SGS_PARAM_ROTATION] < 0 ? -1 : 1) / sqrt(length) : 0;
    for (int v = 0; v < value_count; ++v) {
        const double x = (double)row[v + 3] * (v < 4 ? length : 1);
        const double level = floor(x / (step_of(v) * step_scale) + 0.5);
        values[v] = (int32_t)fmin(fmax(level, -MAX_VALUE), MAX_VALUE);
    }
}

static sgs_status encode_values(sgsi_compress_job *job, fcgs_walk *walk)
{
    class_start starts[MAX_VALUES * CLASSES];
    sgs_status status = walk_create(walk);
    if (!status)
        status = sgsi_compress_progress(job, "coding", 0, 2);
    if (status)
        return status;
    walk_all(walk, WALK_FIT);
    status = sgsi_compress_progress(job, "coding", 1, 2);
    if (status)
        return status;
    fit_starts(walk, starts);
    set_models(walk, starts);
    sgsi_range_encode_begin(&walk->encoder);
    walk_all(walk, WALK_ENCODE);
    sgsi_range_encode_end(&walk->encoder);
    if (walk->encoder.failed)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         job->count);
    sgsi_packer_add(job->out, "classes", starts,
                    (size_t)walk->value_count * CLASSES * sizeof *starts, true);
    sgsi_packer_add(job->out, "values", walk->encoder.bytes, walk->encoder.size, false);
    return job->out->status;
}

static void defaults(sgs_compress_options *options)
{
    static const double scales[] = {1.0, 1.4, 1.95};
    if (options->step_scale == 0)
        options->step_scale = scales[options->preset - 1];
}

static sgs_status encode(sgsi_compress_job *job)
{
    fcgs_header header = {.step_scale = (float)job->options->step_scale};
    fcgs_walk walk = {.count = job->count,
                      .value_count =
                          SGS_PARAM_SH_REST - 3 + 3 * sgsi_sh_rest_count(job->sh_degree)};
    sgsi_keyed_row *keys = sgsi_alloc(2 * job->count, sizeof *keys);
    uint64_t *cells = sgsi_alloc(job->count, sizeof *cells);
    walk.values = sgsi_alloc(job->count, (size_t)walk.value_count * sizeof *walk.values);
    sgs_status status = SGS_STATUS_OK;
    if (!keys || !cells || !walk.values)
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", job->count);
    if (!status) {
        set_bounds(job, &header);
        sgsi_warn_about_cells(job, header.low, header.high, POSITION_BITS);
        fill_keys(job, &header, keys);
        for (size_t i = 0; i < job->count; ++i) {
            cells[i] = keys[i].key;
            quantise_row(job->rows + keys[i].row * (size_t)SGS_PARAM_COUNT,
                         (double)header.step_scale, walk.value_count,
                         walk.values + i * (size_t)walk.value_count);
        }
        walk.cells = cells;
        sgsi_packer_add(job->out, "header", &header, sizeof header, false);
        sgsi_pack_cells(job->out, cells, job->count);
        status = encode_values(job, &walk);
    }
    walk_free(&walk);
    sgsi_free(walk.values);
    sgsi_free(keys);
    sgsi_free(cells);
    return status;
}

// ---- Decoding ----

static void fill_model(const fcgs_header *header, const fcgs_walk *walk, sgs_gaussians *model)
{
    const double side = (double)(1 << POSITION_BITS);
    for (size_t i = 0; i < walk->count; ++i) {
        float row[SGS_PARAM_COUNT] = {0};
        for (int k = 0; k < 3; ++k) {
            const double low = (double)header->low[k], span = (double)header->high[k] - low;
            row[k] = (float)(low + ((double)sgsi_gather_bits(walk->cells[i] >> (2 - k)) + 0.5) *
                                       span / side);
        }
        for (int v = 0; v < walk->value_count; ++v)
            row[v + 3] = (float)((double)walk->values[i * (size_t)walk->value_count + (size_t)v] *
                                 (step_of(v) * (double)header->step_scale));
        sgs_gaussians_set(model, i, row);
    }
}

static sgs_status decode_values(sgsi_container *in, fcgs_walk *walk)
{
    const uint8_t *starts, *bytes;
    class_start classes[MAX_VALUES * CLASSES];
    const size_t starts_bytes = (size_t)walk->value_count * CLASSES * sizeof *classes;
    size_t size;
    sgs_status status = sgsi_container_take(in, "classes", (int64_t)starts_bytes, &starts, NULL);
    if (!status)
        status = sgsi_container_take(in, "values", SGSI_ANY_SIZE, &bytes, &size);
    if (!status)
        status = sgsi_container_finish(in);
    if (status)
        return status;
    memcpy(classes, starts, starts_bytes);
    for (size_t k = 0; k < (size_t)walk->value_count * CLASSES; ++k)
        if (classes[k].zero < 4 || classes[k].zero > 251 || classes[k].decay < 4 ||
            classes[k].decay > 251)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: section 'classes': entry %zu is not in [4, 251]", in->path, k);
    walk->values = sgsi_alloc(walk->count, (size_t)walk->value_count * sizeof *walk->values);
    if (!walk->values)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu primitives",
                         in->path, walk->count);
    status = walk_create(walk);
    if (status)
        return status;
    set_models(walk, classes);
    sgsi_range_decode_begin(&walk->decoder, bytes, size);
    walk_all(walk, WALK_DECODE);
    if (walk->decoder.overrun || walk->decoder.at != size)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'values' does not contain %zu primitives",
                         in->path, walk->count);
    return SGS_STATUS_OK;
}

static sgs_status decode(sgsi_container *in, sgs_gaussians **model)
{
    const uint8_t *bytes;
    fcgs_header header;
    fcgs_walk walk = {.count = in->header.count,
                      .value_count = SGS_PARAM_SH_REST - 3 +
                                     3 * sgsi_sh_rest_count((int)in->header.sh_degree)};
    uint64_t *cells = NULL;
    sgs_status status = sgsi_container_take(in, "header", sizeof header, &bytes, NULL);
    if (status)
        return status;
    memcpy(&header, bytes, sizeof header);
    if (!(header.step_scale > 0 && header.step_scale <= 1000))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section 'header': scale %g of the steps is invalid", in->path,
                         (double)header.step_scale);
    status = sgsi_unpack_cells(in, walk.count, 3 * POSITION_BITS, false, &cells);
    walk.cells = cells;
    if (!status)
        status = decode_values(in, &walk);
    if (!status)
        status = sgsi_decoded_create(in, model);
    if (!status)
        fill_model(&header, &walk, *model);
    walk_free(&walk);
    sgsi_free(walk.values);
    sgsi_free(cells);
    return status;
}

const sgsi_compress_method sgsi_method_fcgs_like = {
    .name = "fcgs-like", .version = 2, .defaults = defaults, .encode = encode, .decode = decode};
