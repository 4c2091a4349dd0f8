// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Gaussian Herding across Pens: the model is reduced as a Gaussian mixture. Constants are those of
// the authors' released code.
//
// Weights a_i = o_i / sum o. A balanced KD tree splits the primitives into 1024 blocks. Each block
// of n primitives is reduced to m components by the composite transportation distance with cost
//
//     c(i, j) = |mu_i - nu_j|^2 + |Sigma_i - Gamma_j|_F^2,
//
// alternating between the assignment of each i to its nearest j (ties share the weight) and the
// weighted means nu_j, Gamma_j, until one of both changes the objective by less than 1e-5. This is
// k-means in nine dimensions: mean and the six entries of the covariance, those off the diagonal
// multiplied by sqrt(2). The primitive nearest to a component supplies SH coefficients and opacity.
// With a scene the result is trained for 5000 iterations.
//
// Differences from the released code: the tree has fewer levels if the model has fewer than 8192
// primitives or fewer than 1024 remain, so that a block has at least 8 and keeps at least one.

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/threads.h"
#include "compress/compress_method.h"
#include "compress/eigen3.h"
#include "compress/importance.h"

enum { DIMENSIONS = 9, DEPTH = 10, MIN_BLOCK = 8, ITERATIONS = 100, FINETUNE = 5000 };
static const double TOLERANCE = 1e-5;
static const float SQRT2 = 1.41421356f;

typedef struct ghap_point {
    float at[DIMENSIONS];
    float weight;
} ghap_point;

typedef struct ghap_reduction {
    const sgsi_compress_job *job;
    ghap_point *points; // [count]
    uint32_t *order;    // [count] primitives by block
    size_t *begins;     // [blocks + 1] into `order`
    size_t *targets;    // [blocks] components requested
    size_t *results;    // [blocks] components made; written to rows at begins[]
    float *out;         // [count][SGS_PARAM_COUNT]: components of a block at its begin
    size_t blocks;
    bool *failed; // [blocks] out of memory
} ghap_reduction;

// ---- Balanced KD split ----

typedef struct split_key {
    float value;
    uint32_t index;
} split_key;

static bool key_before(split_key a, split_key b)
{
    return a.value < b.value || (a.value == b.value && a.index < b.index);
}

// Reorders keys so that the `middle` smallest come first.
static void select_smallest(split_key *keys, size_t count, size_t middle)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        const split_key pivot = keys[low + (high - low - 1) / 2];
        size_t i = low, j = high - 1;
        for (;;) {
            while (key_before(keys[i], pivot))
                ++i;
            while (key_before(pivot, keys[j]))
                --j;
            if (i >= j)
                break;
            const split_key swapped = keys[i];
            keys[i++] = keys[j];
            keys[j--] = swapped;
        }
        // keys[low..j] <= pivot <= keys[j+1..high)
        if (middle <= j)
            high = j + 1;
        else
            low = j + 1;
        if (low >= high)
            break;
    }
}

typedef struct split_level {
    ghap_reduction *reduction;
    const size_t *begins; // [nodes + 1]
    size_t *halves;       // [nodes] begin of the upper half
    split_key *keys;
    int axis;
} split_level;

static void split_node(void *context, size_t node, int thread)
{
    (void)thread;
    const split_level *level = context;
    const size_t begin = level->begins[node], count = level->begins[node + 1] - begin;
    split_key *keys = level->keys + begin;
    uint32_t *order = level->reduction->order + begin;
    for (size_t i = 0; i < count; ++i)
        keys[i] = (split_key){level->reduction->points[order[i]].at[level->axis], order[i]};
    select_smallest(keys, count, count / 2);
    for (size_t i = 0; i < count; ++i)
        order[i] = keys[i].index;
    level->halves[node] = begin + count / 2;
}

static sgs_status split_blocks(ghap_reduction *reduction, size_t count, size_t wanted)
{
    int depth = 0;
    while (depth < DEPTH && count >> (depth + 1) >= MIN_BLOCK && wanted >> (depth + 1))
        ++depth;
    reduction->blocks = (size_t)1 << depth;
    const size_t most = reduction->blocks;
    reduction->begins = sgsi_calloc(most + 1, sizeof *reduction->begins);
    size_t *halves = sgsi_calloc(most, sizeof *halves);
    split_key *keys = sgsi_alloc(count, sizeof *keys);
    const bool memory = reduction->begins && halves && keys;
    if (memory)
        reduction->begins[1] = count;
    for (int k = 0; k < depth && memory; ++k) {
        const size_t nodes = (size_t)1 << k;
        split_level level = {reduction, reduction->begins, halves, keys, k % 3};
        sgsi_parallel_for(nodes, 1, split_node, &level);
        for (size_t node = nodes; node-- > 0;) {
            reduction->begins[2 * node + 2] = reduction->begins[node + 1];
            reduction->begins[2 * node + 1] = halves[node];
        }
    }
    sgsi_free(halves);
    sgsi_free(keys);
    if (!memory)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", count);
    return SGS_STATUS_OK;
}

// ---- Reduction of a block ----

typedef struct ghap_block {
    size_t n, m;
    const uint32_t *members;
    float *centers[DIMENSIONS]; // [m] each
    double *sums;               // [m][DIMENSIONS]
    double *weights;            // [m]
    float *costs;               // [m]
    uint32_t *nearest;          // [n]
    double total;               // weight of the block
} ghap_block;

// Costs of one point against all components; returns the smallest.
static float point_costs(const ghap_block *block, const float at[DIMENSIONS])
{
    float *const costs = block->costs;
    const size_t m = block->m;
    for (size_t j = 0; j < m; ++j)
        costs[j] = 0;
    for (int d = 0; d < DIMENSIONS; ++d) {
        const float x = at[d], *center = block->centers[d];
        for (size_t j = 0; j < m; ++j)
            costs[j] += (x - center[j]) * (x - center[j]);
    }
    float least = costs[0];
    for (size_t j = 1; j < m; ++j)
        least = costs[j] < least ? costs[j] : least;
    return least;
}

// The nearest component of a point whose costs exceed single precision.
static size_t nearest_far(const ghap_block *block, const float at[DIMENSIONS])
{
    size_t nearest = 0;
    double least = INFINITY;
    for (size_t j = 0; j < block->m; ++j) {
        double cost = 0;
        for (int d = 0; d < DIMENSIONS; ++d) {
            const double difference = (double)at[d] - block->centers[d][j];
            cost += difference * difference;
        }
        if (cost < least) {
            least = cost;
            nearest = j;
        }
    }
    return nearest;
}

static void remove_empty(ghap_block *block)
{
    size_t kept = 0;
    for (size_t j = 0; j < block->m; ++j) {
        if (!(block->weights[j] > 0))
            continue;
        block->weights[kept] = block->weights[j];
        memmove(block->sums + kept * DIMENSIONS, block->sums + j * DIMENSIONS,
                DIMENSIONS * sizeof *block->sums);
        for (size_t d = 0; d < DIMENSIONS; ++d)
            block->centers[d][kept] = block->centers[d][j];
        ++kept;
    }
    block->m = kept;
}

// Assigns all points, accumulates the sums of the components and removes those without weight;
// returns the objective.
static double assign_points(const ghap_reduction *reduction, ghap_block *block)
{
    memset(block->sums, 0, block->m * DIMENSIONS * sizeof *block->sums);
    memset(block->weights, 0, block->m * sizeof *block->weights);
    double objective = 0;
    for (size_t i = 0; i < block->n; ++i) {
        const ghap_point *point = &reduction->points[block->members[i]];
        float least = point_costs(block, point->at);
        if (!isfinite(least)) {
            least = FLT_MAX;
            block->costs[nearest_far(block, point->at)] = least;
        }
        size_t ties = 0;
        for (size_t j = 0; j < block->m; ++j)
            ties += block->costs[j] == least;
        const double share = point->weight / block->total / (double)(ties ? ties : 1);
        for (size_t j = 0; j < block->m; ++j) {
            if (block->costs[j] != least)
                continue;
            block->weights[j] += share;
            block->nearest[i] = (uint32_t)j;
            for (int d = 0; d < DIMENSIONS; ++d)
                block->sums[j * DIMENSIONS + (size_t)d] += share * (double)point->at[d];
        }
        objective += point->weight / block->total * (double)least;
    }
    remove_empty(block);
    return objective;
}

// Moves the components to their means; returns by how much the objective decreases. The points of a
// component are nearer to their mean by the squared distance of the move, on average.
static double move_centers(ghap_block *block)
{
    double decrease = 0;
    for (size_t j = 0; j < block->m; ++j)
        for (size_t d = 0; d < DIMENSIONS; ++d) {
            const double mean = block->sums[j * DIMENSIONS + d] / block->weights[j];
            const double move = mean - (double)block->centers[d][j];
            decrease += block->weights[j] * move * move;
            block->centers[d][j] = (float)mean;
        }
    return decrease;
}

// Writes component j: Gamma to rotation and scales, the rest from the nearest member.
static void write_component(const ghap_reduction *reduction, const ghap_block *block, size_t j,
                            uint32_t member, float *row)
{
    float at[DIMENSIONS];
    for (int d = 0; d < DIMENSIONS; ++d)
        at[d] = block->centers[d][j];
    memcpy(row, reduction->job->rows + (size_t)member * SGS_PARAM_COUNT,
           SGS_PARAM_COUNT * sizeof *row);
    memcpy(row + SGS_PARAM_MEAN, at, 3 * sizeof *row);
    const double covariance[6] = {at[3], at[6] / SQRT2, at[7] / SQRT2, at[4], at[8] / SQRT2, at[5]};
    double values[3], q[4];
    sgsi_eigen3(covariance, values, q);
    for (int k = 0; k < 3; ++k)
        row[SGS_PARAM_SCALE + k] =
            (float)(0.5 * log(fmax(values[k], reduction->job->options->eig_min)));
    for (int k = 0; k < 4; ++k)
        row[SGS_PARAM_ROTATION + k] = (float)q[k];
}

static void write_block(const ghap_reduction *reduction, ghap_block *block, size_t begin)
{
    // The nearest member of each component: costs and members of the best ones so far.
    for (size_t j = 0; j < block->m; ++j)
        block->weights[j] = INFINITY;
    uint32_t *best = block->nearest; // m <= n
    for (size_t i = 0; i < block->n; ++i) {
        point_costs(block, reduction->points[block->members[i]].at);
        for (size_t j = 0; j < block->m; ++j)
            if (block->costs[j] < block->weights[j]) {
                block->weights[j] = block->costs[j];
                best[j] = block->members[i];
            }
    }
    for (size_t j = 0; j < block->m; ++j)
        write_component(reduction, block, j, best[j],
                        reduction->out + (begin + j) * SGS_PARAM_COUNT);
}

// m distinct members, by a random order.
static void choose_start(const ghap_reduction *reduction, ghap_block *block, uint64_t seed)
{
    for (size_t i = 0; i < block->n; ++i)
        block->nearest[i] = (uint32_t)i;
    for (size_t j = 0; j < block->m && j < block->n; ++j) { // m <= n
        const size_t left = block->n - j;
        const size_t other = j + (size_t)(sgsi_random_uniform(seed, j) * (double)left) % left;
        const uint32_t chosen = block->nearest[other];
        block->nearest[other] = block->nearest[j];
        block->nearest[j] = chosen;
        for (int d = 0; d < DIMENSIONS; ++d)
            block->centers[d][j] = reduction->points[block->members[chosen]].at[d];
    }
}

static void reduce_block(void *context, size_t b, int thread)
{
    (void)thread;
    const ghap_reduction *reduction = context;
    const size_t begin = reduction->begins[b];
    ghap_block block = {.n = reduction->begins[b + 1] - begin,
                        .m = reduction->targets[b],
                        .members = reduction->order + begin};
    const size_t room = block.m * (DIMENSIONS + 1);
    float *floats = sgsi_alloc(room, sizeof *floats);
    double *doubles = sgsi_alloc(room, sizeof *doubles);
    block.nearest = sgsi_alloc(block.n, sizeof *block.nearest);
    reduction->failed[b] = !floats || !doubles || !block.nearest;
    if (!reduction->failed[b]) {
        for (size_t d = 0; d < DIMENSIONS; ++d)
            block.centers[d] = floats + d * block.m;
        block.costs = floats + DIMENSIONS * block.m;
        block.sums = doubles;
        block.weights = doubles + DIMENSIONS * block.m;
        for (size_t i = 0; i < block.n; ++i)
            block.total += (double)reduction->points[block.members[i]].weight;
        choose_start(reduction, &block, reduction->job->options->seed ^ (begin + 1) << 32);
        double last = INFINITY;
        for (int k = 0; k < ITERATIONS; ++k) {
            const double objective = assign_points(reduction, &block);
            if (fabs(last - objective) < TOLERANCE)
                break;
            const double decrease = move_centers(&block);
            if (decrease < TOLERANCE)
                break;
            last = objective - decrease;
        }
        write_block(reduction, &block, begin);
        reduction->results[b] = block.m;
    }
    sgsi_free(floats);
    sgsi_free(doubles);
    sgsi_free(block.nearest);
}

// ---- The method ----

static void make_points(ghap_reduction *reduction)
{
    const sgsi_compress_job *job = reduction->job;
    for (size_t i = 0; i < job->count; ++i) {
        const float *row = job->rows + i * SGS_PARAM_COUNT;
        double s[6];
        sgsi_covariance3(row + SGS_PARAM_ROTATION, row + SGS_PARAM_SCALE, s);
        ghap_point *point = &reduction->points[i];
        *point = (ghap_point){.at = {row[0], row[1], row[2], (float)s[0], (float)s[3], (float)s[5],
                                     SQRT2 * (float)s[1], SQRT2 * (float)s[2], SQRT2 * (float)s[4]},
                              .weight = (float)(1 / (1 + exp(-(double)row[SGS_PARAM_OPACITY])))};
        if (!(point->weight > 1e-30f))
            point->weight = 1e-30f;
        reduction->order[i] = (uint32_t)i;
    }
}

static sgs_status reduce_all(ghap_reduction *reduction, size_t wanted)
{
    size_t left = wanted;
    const size_t blocks = reduction->blocks, portion = 64;
    for (size_t b = 0; b < blocks; ++b) {
        const size_t n = reduction->begins[b + 1] - reduction->begins[b];
        size_t target = left / (blocks - b);
        target = target > n ? n : target;
        left -= target;
        reduction->targets[b] = target ? target : 1;
    }
    for (size_t done = 0; done < blocks; done += portion) {
        const sgs_status status =
            sgsi_compress_progress(reduction->job, "reducing the mixture", done, blocks);
        if (status)
            return status;
        // The context of a portion begins at its first block.
        ghap_reduction part = *reduction;
        part.begins += done;
        part.targets += done;
        part.results += done;
        part.failed += done;
        sgsi_parallel_for(blocks - done < portion ? blocks - done : portion, 1, reduce_block,
                          &part);
    }
    for (size_t b = 0; b < blocks; ++b)
        if (reduction->failed[b])
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to reduce the mixture");
    return SGS_STATUS_OK;
}

// Moves the components of all blocks to the front of job->rows.
static void collect(const ghap_reduction *reduction, sgsi_compress_job *job)
{
    size_t count = 0;
    for (size_t b = 0; b < reduction->blocks; ++b) {
        memcpy(job->rows + count * SGS_PARAM_COUNT,
               reduction->out + reduction->begins[b] * SGS_PARAM_COUNT,
               reduction->results[b] * SGS_PARAM_COUNT * sizeof(float));
        count += reduction->results[b];
    }
    job->count = count;
}

static sgs_status reduce(sgsi_compress_job *job, size_t wanted)
{
    ghap_reduction reduction = {.job = job,
                                .points = sgsi_alloc(job->count, sizeof(ghap_point)),
                                .order = sgsi_alloc(job->count, sizeof(uint32_t)),
                                .out = sgsi_alloc(job->count, SGS_PARAM_COUNT * sizeof(float))};
    sgs_status status = SGS_STATUS_OK;
    if (!reduction.points || !reduction.order || !reduction.out)
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", job->count);
    if (!status) {
        make_points(&reduction);
        status = split_blocks(&reduction, job->count, wanted);
    }
    if (!status) {
        reduction.targets = sgsi_calloc(reduction.blocks, sizeof *reduction.targets);
        reduction.results = sgsi_calloc(reduction.blocks, sizeof *reduction.results);
        reduction.failed = sgsi_calloc(reduction.blocks, sizeof *reduction.failed);
        status = reduction.targets && reduction.results && reduction.failed
                     ? reduce_all(&reduction, wanted)
                     : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                                 job->count);
    }
    if (!status)
        collect(&reduction, job);
    sgsi_free(reduction.points);
    sgsi_free(reduction.order);
    sgsi_free(reduction.out);
    sgsi_free(reduction.begins);
    sgsi_free(reduction.targets);
    sgsi_free(reduction.results);
    sgsi_free(reduction.failed);
    return status;
}

static void defaults(sgs_compress_options *options)
{
    static const double keep[] = {0.7, 0.5, 0.3};
    if (options->keep == 0)
        options->keep = keep[options->preset - 1];
    if (options->eig_min == 0)
        options->eig_min = 1e-6;
}

// Name, first parameter and number of parameters of the sections.
static const struct {
    const char *name;
    int param, count;
} parts[] = {{"mean", SGS_PARAM_MEAN, 3},   {"rotation", SGS_PARAM_ROTATION, 4},
             {"scale", SGS_PARAM_SCALE, 3}, {"opacity", SGS_PARAM_OPACITY, 1},
             {"sh_dc", SGS_PARAM_SH_DC, 3}, {"sh_rest", SGS_PARAM_SH_REST, 0}};
enum { PARTS = sizeof parts / sizeof *parts };

static int part_count(size_t k, int sh_degree)
{
    return parts[k].count ? parts[k].count : 3 * sgsi_sh_rest_count(sh_degree);
}

static sgs_status encode(sgsi_compress_job *job)
{
    const size_t wanted = (size_t)((double)job->count * job->options->keep);
    sgs_status status = reduce(job, wanted ? wanted : 1);
    if (!status)
        status = sgsi_rows_finetune(job, FINETUNE);
    if (status)
        return status;
    job->out->header.count = job->count;
    for (size_t k = 0; k < PARTS; ++k)
        sgsi_pack_floats(job->out, parts[k].name, job->rows, job->count, parts[k].param,
                         part_count(k, job->sh_degree), false);
    return job->out->status;
}

static sgs_status decode(sgsi_container *in, sgs_gaussians **model)
{
    const uint8_t *planes[PARTS];
    sgs_status status = SGS_STATUS_OK;
    for (size_t k = 0; k < PARTS && !status; ++k)
        status = sgsi_unpack_floats(in, parts[k].name, in->header.count,
                                    part_count(k, (int)in->header.sh_degree), &planes[k]);
    if (!status)
        status = sgsi_container_finish(in);
    if (!status)
        status = sgsi_decoded_create(in, model);
    for (size_t k = 0; k < PARTS && !status; ++k)
        sgsi_planes_apply(planes[k], parts[k].param, part_count(k, (int)in->header.sh_degree),
                          *model);
    return status;
}

const sgsi_compress_method sgsi_method_ghap = {
    .name = "ghap", .version = 1, .defaults = defaults, .encode = encode, .decode = decode};
