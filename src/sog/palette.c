// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Distances are computed by palette_kernels.inl. Means are sums in double precision in the order of
// the vectors.

#include "sog/palette.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/core.h"
#include "base/keyed_rows.h"
#include "base/threads.h"
#include "simd/kernel_variants.h"
#include "sog/palette_kernels.h"

enum {
    GROUP = SGSI_PALETTE_GROUP,
    SCALAR_ITERATIONS = 100,
    RANGE = 2048,
    SAMPLE_PER_CLUSTER = 256
};

// ---- Scalar codebook ----

static void sort_floats(float *values, uint32_t *keys, uint32_t *spare, size_t count)
{
    for (size_t i = 0; i < count; ++i) { // order of the keys is the order of the floats
        uint32_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        keys[i] = bits & 0x80000000 ? ~bits : bits | 0x80000000;
    }
    for (int shift = 0; shift < 32; shift += 8) {
        size_t begin[256] = {0}, total = 0;
        for (size_t i = 0; i < count; ++i)
            ++begin[keys[i] >> shift & 255];
        for (int k = 0; k < 256; ++k) {
            const size_t size = begin[k];
            begin[k] = total;
            total += size;
        }
        for (size_t i = 0; i < count; ++i)
            spare[begin[keys[i] >> shift & 255]++] = keys[i];
        uint32_t *swap = keys;
        keys = spare;
        spare = swap;
    }
    for (size_t i = 0; i < count; ++i) {
        const uint32_t bits = keys[i] & 0x80000000 ? keys[i] & 0x7FFFFFFF : ~keys[i];
        memcpy(&values[i], &bits, sizeof bits);
    }
}

// First index of a sorted array with a value above `limit`.
static size_t upper_bound(const float *values, size_t count, double limit)
{
    size_t low = 0, high = count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if ((double)values[middle] <= limit)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void sort_codebook(float codebook[SGSI_CODES], size_t used)
{
    for (size_t i = 1; i < used; ++i) // almost sorted
        for (size_t j = i; j > 0 && codebook[j] < codebook[j - 1]; --j) {
            const float swap = codebook[j];
            codebook[j] = codebook[j - 1];
            codebook[j - 1] = swap;
        }
    for (size_t i = used; i < SGSI_CODES; ++i)
        codebook[i] = used ? codebook[used - 1] : 0.0f;
}

// Replaces every entry by the mean of its values. sums[i]: of the first i values.
static double improve(const float *values, const double *sums, size_t count,
                      float codebook[SGSI_CODES])
{
    double moved = 0.0;
    for (size_t k = 0, begin = 0; k < SGSI_CODES; ++k) {
        const double limit = k + 1 < SGSI_CODES
                                 ? 0.5 * ((double)codebook[k] + (double)codebook[k + 1])
                                 : (double)FLT_MAX;
        const size_t end = upper_bound(values, count, limit);
        if (end > begin) {
            const float mean = (float)((sums[end] - sums[begin]) / (double)(end - begin));
            moved = fmax(moved, fabs((double)mean - (double)codebook[k]));
            codebook[k] = mean;
            begin = end;
        }
    }
    return moved;
}

void sgsi_codebook_fit(float *values, size_t count, float codebook[SGSI_CODES])
{
    uint32_t *keys = sgsi_alloc(count + 1, sizeof *keys),
             *spare = sgsi_alloc(count + 1, sizeof *spare);
    double *sums = sgsi_alloc(count + 1, sizeof *sums);
    size_t distinct = 0;
    if (keys && spare)
        sort_floats(values, keys, spare, count);
    for (size_t i = 0; keys && spare && i < count && distinct <= SGSI_CODES; ++i)
        if (!i || values[i] != values[i - 1]) {
            if (distinct < SGSI_CODES)
                codebook[distinct] = values[i];
            ++distinct;
        }
    if (!keys || !spare || !sums || distinct > SGSI_CODES) {
        // Half of the entries by rank and half by value, so that tails keep entries.
        float low = FLT_MAX, high = -FLT_MAX;
        for (size_t i = 0; i < count; ++i) {
            low = fminf(low, values[i]);
            high = fmaxf(high, values[i]);
        }
        for (size_t k = 0; k < SGSI_CODES; ++k) {
            const double share = ((double)k + 0.5) / SGSI_CODES;
            const float rank = values[(size_t)(share * (double)count)];
            codebook[k] = k % 2 && keys && spare
                              ? rank
                              : (float)((double)low + ((double)high - (double)low) * share);
        }
        distinct = SGSI_CODES;
        sort_codebook(codebook, distinct);
        if (keys && spare && sums) {
            sums[0] = 0.0;
            for (size_t i = 0; i < count; ++i)
                sums[i + 1] = sums[i] + (double)values[i];
            const double enough = 1e-7 * ((double)high - (double)low);
            for (int k = 0; k < SCALAR_ITERATIONS; ++k)
                if (improve(values, sums, count, codebook) <= enough)
                    break;
        }
    }
    sort_codebook(codebook, distinct);
    sgsi_free(keys);
    sgsi_free(spare);
    sgsi_free(sums);
}

uint8_t sgsi_codebook_index(const float codebook[SGSI_CODES], float value)
{
    size_t low = 0, high = SGSI_CODES - 1;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if ((double)value <= 0.5 * ((double)codebook[middle] + (double)codebook[middle + 1]))
            high = middle;
        else
            low = middle + 1;
    }
    return (uint8_t)low;
}

// ---- Equal vectors ----

// Numbers the distinct vectors by first occurrence. numbers: [count]. Without memory returns 0.
static size_t number_vectors(const float *vectors, size_t count, size_t dimensions,
                             uint32_t *numbers)
{
    const size_t bytes = dimensions * sizeof *vectors;
    sgsi_keyed_row *rows = sgsi_alloc(count + 1, sizeof *rows),
                   *spare = sgsi_alloc(count + 1, sizeof *spare);
    const bool room = rows && spare;
    size_t distinct = 0;
    for (size_t i = 0; room && i < count; ++i)
        rows[i] = (sgsi_keyed_row){XXH3_64bits(vectors + i * dimensions, bytes), (uint32_t)i};
    if (room)
        sgsi_sort_rows(rows, spare, count);
    for (size_t i = 0, first = 0; room && i < count; ++i) { // the first row of equal ones
        if (rows[i].key != rows[first].key || memcmp(vectors + rows[i].row * dimensions,
                                                     vectors + rows[first].row * dimensions, bytes))
            first = i;
        numbers[rows[i].row] = rows[first].row;
    }
    for (size_t i = 0; room && i < count; ++i)
        numbers[i] = numbers[i] == i ? (uint32_t)distinct++ : numbers[numbers[i]];
    sgsi_free(rows);
    sgsi_free(spare);
    return distinct;
}

// ---- Vectors ----

// k-means of the vectors `rows`; all memory is the caller's, except scratch.
typedef struct clustering {
    const float *vectors;
    const uint32_t *rows; // [count]
    size_t count, size;
    int dimensions, iterations;
    float *entries;   // [size][dimensions], out
    uint32_t *labels; // [count], out
    float *errors;    // [count]
    float *groups;    // [groups][dimensions][GROUP]
    double *sums;     // [size][dimensions]
    size_t *members;  // [size]
    size_t group_count;
} clustering;

static bool clustering_begin(clustering *c)
{
    c->group_count = (c->size + GROUP - 1) / GROUP;
    c->errors = sgsi_alloc(c->count + 1, sizeof *c->errors);
    c->groups = sgsi_alloc(c->group_count * (size_t)c->dimensions, GROUP * sizeof *c->groups);
    c->sums = sgsi_alloc(c->size, (size_t)c->dimensions * sizeof *c->sums);
    c->members = sgsi_alloc(c->size, sizeof *c->members);
    return c->errors && c->groups && c->sums && c->members;
}

static void clustering_end(clustering *c)
{
    sgsi_free(c->errors);
    sgsi_free(c->groups);
    sgsi_free(c->sums);
    sgsi_free(c->members);
}

static void group_entries(clustering *c)
{
    const size_t dimensions = (size_t)c->dimensions;
    for (size_t k = 0; k < c->group_count * GROUP; ++k)
        for (size_t d = 0; d < dimensions; ++d)
            c->groups[(k / GROUP * dimensions + d) * GROUP + k % GROUP] =
                k < c->size ? c->entries[k * dimensions + d] : FLT_MAX / 4; // never the nearest
}

static const sgsi_nearest_fn kernels[SGS_ISA_COUNT] = SGSI_VARIANTS(sgsi_palette_nearest);

static void assign_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const clustering *c = context;
    const sgsi_nearest job = {.vectors = c->vectors,
                              .rows = c->rows,
                              .dimensions = (size_t)c->dimensions,
                              .groups = c->groups,
                              .group_count = c->group_count,
                              .labels = c->labels,
                              .errors = c->errors};
    kernels[sgs_isa_get()](&job, begin, end);
}

// Moves entries to the means of their vectors, and entries without vectors to the worst ones.
static void update_entries(clustering *c)
{
    const size_t dimensions = (size_t)c->dimensions;
    memset(c->sums, 0, c->size * dimensions * sizeof *c->sums);
    memset(c->members, 0, c->size * sizeof *c->members);
    for (size_t i = 0; i < c->count; ++i) {
        const float *vector = c->vectors + c->rows[i] * dimensions;
        double *sum = c->sums + c->labels[i] * dimensions;
        for (size_t d = 0; d < dimensions; ++d)
            sum[d] += (double)vector[d];
        ++c->members[c->labels[i]];
    }
    for (size_t k = 0; k < c->size; ++k) {
        if (c->members[k]) {
            for (size_t d = 0; d < dimensions; ++d)
                c->entries[k * dimensions + d] =
                    (float)(c->sums[k * dimensions + d] / (double)c->members[k]);
            continue;
        }
        size_t worst = 0;
        for (size_t i = 1; i < c->count; ++i)
            if (c->errors[i] > c->errors[worst])
                worst = i;
        c->errors[worst] = 0.0f;
        memcpy(c->entries + k * dimensions, c->vectors + c->rows[worst] * dimensions,
               dimensions * sizeof(float));
    }
}

static void clustering_run(clustering *c, sgsi_progress *progress)
{
    const size_t dimensions = (size_t)c->dimensions;
    for (size_t k = 0; k < c->size; ++k) // evenly spaced vectors
        memcpy(c->entries + k * dimensions,
               c->vectors + c->rows[(2 * k + 1) * c->count / (2 * c->size)] * dimensions,
               dimensions * sizeof(float));
    for (int step = 0; step < c->iterations; ++step) {
        group_entries(c);
        sgsi_parallel_ranges(c->count, RANGE, assign_range, c);
        update_entries(c);
        if (progress && sgsi_progress_cancelled(progress))
            return;
    }
    group_entries(c);
    sgsi_parallel_ranges(c->count, RANGE, assign_range, c);
}

// ---- Two levels ----

typedef struct second_level {
    const float *vectors;
    int dimensions, iterations;
    size_t clusters;
    const size_t *begin, *entry_begin; // [clusters + 1]
    const uint32_t *rows;              // sorted by cluster
    sgsi_palette *palette;
    sgsi_progress *progress;
    bool *failed; // [clusters]
} second_level;

static void refine_cluster(void *context, size_t k, int thread)
{
    (void)thread;
    second_level *level = context;
    const size_t dimensions = (size_t)level->dimensions, first = level->begin[k],
                 count = level->begin[k + 1] - first;
    clustering c = {.vectors = level->vectors,
                    .rows = level->rows + first,
                    .count = count,
                    .size = level->entry_begin[k + 1] - level->entry_begin[k],
                    .dimensions = level->dimensions,
                    .iterations = level->iterations,
                    .entries = level->palette->entries + level->entry_begin[k] * dimensions};
    if (count && !sgsi_progress_cancelled(level->progress)) {
        c.labels = sgsi_alloc(count, sizeof *c.labels);
        level->failed[k] = !c.labels || !clustering_begin(&c);
        if (!level->failed[k]) {
            clustering_run(&c, level->progress);
            for (size_t i = 0; i < count; ++i)
                level->palette->labels[c.rows[i]] = (uint32_t)level->entry_begin[k] + c.labels[i];
        }
        clustering_end(&c);
        sgsi_free(c.labels);
    }
    const size_t steps = SGSI_PALETTE_STEPS - 1;
    for (size_t s = k * steps / level->clusters; s < (k + 1) * steps / level->clusters; ++s)
        sgsi_progress_advance(level->progress);
}

typedef struct first_level {
    float *entries;
    uint32_t *rows, *labels, *sorted;
    size_t *begin, *entry_begin;
    size_t *distinct; // different vectors of each cluster
    bool *failed;
} first_level;

static bool first_level_begin(first_level *level, size_t count, int dimensions, size_t clusters)
{
    level->entries = sgsi_alloc(clusters, (size_t)dimensions * sizeof *level->entries);
    level->rows = sgsi_alloc(count + 1, sizeof *level->rows);
    level->labels = sgsi_alloc(count + 1, sizeof *level->labels);
    level->sorted = sgsi_alloc(count + 1, sizeof *level->sorted);
    level->begin = sgsi_calloc(clusters + 1, sizeof *level->begin);
    level->entry_begin = sgsi_calloc(clusters + 1, sizeof *level->entry_begin);
    level->distinct = sgsi_calloc(clusters, sizeof *level->distinct);
    level->failed = sgsi_calloc(clusters, sizeof *level->failed);
    return level->entries && level->rows && level->labels && level->sorted && level->begin &&
           level->entry_begin && level->distinct && level->failed;
}

static void first_level_end(first_level *level)
{
    sgsi_free(level->entries);
    sgsi_free(level->rows);
    sgsi_free(level->labels);
    sgsi_free(level->sorted);
    sgsi_free(level->begin);
    sgsi_free(level->entry_begin);
    sgsi_free(level->distinct);
    sgsi_free(level->failed);
}

// Trains on a sample and labels all vectors.
static bool find_clusters(const float *vectors, size_t count, int dimensions, size_t clusters,
                          int iterations, first_level *level, sgsi_progress *progress)
{
    const size_t most = SAMPLE_PER_CLUSTER * clusters, sample = count < most ? count : most;
    for (size_t i = 0; i < sample; ++i)
        level->rows[i] = (uint32_t)(i * count / sample);
    clustering c = {.vectors = vectors,
                    .rows = level->rows,
                    .count = sample,
                    .size = clusters,
                    .dimensions = dimensions,
                    .iterations = iterations,
                    .entries = level->entries,
                    .labels = level->labels};
    bool done = clustering_begin(&c);
    if (done) {
        clustering_run(&c, progress);
        sgsi_free(c.errors);
        c.errors = sgsi_alloc(count + 1, sizeof *c.errors);
        done = c.errors != NULL;
    }
    if (done) {
        for (size_t i = 0; i < count; ++i)
            level->rows[i] = (uint32_t)i;
        c.count = count;
        sgsi_parallel_ranges(count, RANGE, assign_range, &c);
    }
    clustering_end(&c);
    return done;
}

// Sorts rows by cluster, and gives each cluster entries in proportion to its distinct vectors, at
// least one. In proportion to its rows, a vector that most rows share would take most entries, and
// the time of k-means is the product of both.
static void share_entries(first_level *level, const uint32_t *numbers, size_t count,
                          size_t clusters, size_t size)
{
    size_t *begin = level->begin, left = size, distinct_left = 0, others = 0;
    for (size_t i = 0; i < count; ++i) {
        ++begin[level->labels[i] + 1];
        if (numbers[i] == distinct_left) { // its first occurrence
            ++level->distinct[level->labels[i]];
            ++distinct_left;
        }
    }
    for (size_t k = 0; k < clusters; ++k)
        others += level->distinct[k] > 0;
    for (size_t k = 0; k < clusters; ++k) {
        const size_t distinct = level->distinct[k];
        size_t share = 0;
        if (distinct) {
            --others;
            share = (size_t)((double)left * (double)distinct / (double)distinct_left + 0.5);
            share = share < 1 ? 1 : share;
            share = share > distinct ? distinct : share;
            share = share > left - others ? left - others : share;
        }
        left -= share;
        distinct_left -= distinct;
        level->entry_begin[k + 1] = level->entry_begin[k] + share;
        begin[k + 1] += begin[k];
    }
    for (size_t i = 0; i < count; ++i)
        level->sorted[begin[level->labels[i]]++] = (uint32_t)i;
    memmove(begin + 1, begin, clusters * sizeof *begin); // each begin had become the next one's
    begin[0] = 0;
}

// An entry for each distinct vector.
static void list_vectors(const float *vectors, const uint32_t *numbers, size_t count,
                         sgsi_progress *progress, sgsi_palette *palette)
{
    const size_t dimensions = (size_t)palette->dimensions;
    for (size_t i = 0; i < count; ++i) {
        palette->labels[i] = numbers[i];
        if (numbers[i] == palette->size)
            memcpy(palette->entries + dimensions * palette->size++, vectors + dimensions * i,
                   dimensions * sizeof *vectors);
    }
    for (int k = 0; k < SGSI_PALETTE_STEPS; ++k)
        sgsi_progress_advance(progress);
}

// Two levels of k-means. False without memory.
static bool cluster_vectors(const float *vectors, const uint32_t *numbers, size_t count,
                            size_t size, int iterations, sgsi_progress *progress,
                            sgsi_palette *palette)
{
    const size_t clusters = (size_t)floor(sqrt((double)size) + 0.5);
    first_level level = {0};
    bool done =
        first_level_begin(&level, count, palette->dimensions, clusters) &&
        find_clusters(vectors, count, palette->dimensions, clusters, iterations, &level, progress);
    if (done) {
        sgsi_progress_advance(progress);
        share_entries(&level, numbers, count, clusters, size);
        second_level second = {vectors,     palette->dimensions, iterations,   clusters,
                               level.begin, level.entry_begin,   level.sorted, palette,
                               progress,    level.failed};
        sgsi_parallel_for(clusters, 1, refine_cluster, &second);
        palette->size = level.entry_begin[clusters];
        for (size_t k = 0; k < clusters; ++k)
            done = done && !level.failed[k];
    }
    first_level_end(&level);
    return done;
}

sgs_status sgsi_palette_train(const float *vectors, size_t count, int dimensions, size_t size,
                              int iterations, sgsi_progress *progress, sgsi_palette *palette)
{
    size = size < count ? size : count;
    *palette = (sgsi_palette){.dimensions = dimensions};
    palette->entries = sgsi_calloc(size + 1, (size_t)dimensions * sizeof(float));
    palette->labels = sgsi_calloc(count + 1, sizeof *palette->labels);
    uint32_t *numbers = sgsi_alloc(count + 1, sizeof *numbers);
    const size_t distinct = palette->entries && palette->labels && numbers
                                ? number_vectors(vectors, count, (size_t)dimensions, numbers)
                                : 0;
    bool done = distinct > 0;
    if (done && distinct <= size)
        list_vectors(vectors, numbers, count, progress, palette);
    else if (done)
        done = cluster_vectors(vectors, numbers, count, size, iterations, progress, palette);
    sgsi_free(numbers);
    if (!done)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to cluster %zu vectors",
                         count);
    if (sgsi_progress_cancelled(progress))
        return sgsi_fail(SGS_STATUS_CANCELLED, "cancelled");
    return SGS_STATUS_OK;
}

void sgsi_palette_free(sgsi_palette *palette)
{
    sgsi_free(palette->entries);
    sgsi_free(palette->labels);
    *palette = (sgsi_palette){0};
}
