// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// For decreasing radii r (factor 0.95): the target is the grid, blurred by a Gaussian of 2r + 1
// taps and sigma 2r + 1, circular along rows and reflected along columns. The grid, shifted by a
// random offset, is divided into blocks. In every pass a random permutation groups the cells of a
// block by four, and each group takes the best of its 24 arrangements with respect to the target.
// Passes repeat until the distance to the target improves by less than `improvement_break`; offsets
// repeat until one of them brings no improvement, but at least four times. Constants are those of
// the authors' released code.
//
// Difference: for more than DIRECT_TAPS taps the Gaussian, which falls to 0.88 at its end, is the
// weighted sum of four nested boxes. The weights differ by at most 0.015, and the cost of a blur
// does not depend on the radius.

#include "compress/plas.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"

enum {
    C = SGSI_PLAS_CHANNELS,
    MIN_BLOCK = 16,
    DIRECT_TAPS = 17,
    BOXES = 4,
    MIN_OFFSETS = 4,
    GROUPS_PER_ITEM = 4096,
    BATCH = 16, // groups whose cells are fetched at once
    COORDINATE_BITS = 16
};
static const double RADIUS_DECAY = 0.95;

// The two elements at cells 0 and 1, and the other two.
static const uint8_t pairs[6][4] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2},
                                    {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};

typedef struct plas_work {
    sgsi_plas *plas;
    size_t side;
    float *target, *blurred; // [side * side][C]
    uint32_t *permutation;   // [block * block]: row << COORDINATE_BITS | column
    double *distances;       // [items][2]: before and after
    // The current pass.
    size_t half, block, blocks, shift_x, shift_y, items_per_block;
    uint64_t counter;   // of random numbers
    size_t done, total; // radii
    bool cancelled;
} plas_work;

// ---- Target ----

typedef struct plas_kernel {
    size_t half[BOXES];
    double weight[BOXES]; // per element
    float taps[DIRECT_TAPS];
    bool direct;
} plas_kernel;

static plas_kernel make_kernel(size_t half)
{
    plas_kernel kernel = {.direct = 2 * half + 1 <= DIRECT_TAPS};
    const double sigma = (double)(2 * half + 1);
    double sum = 0;
    for (size_t k = 0; k < 2 * half + 1; ++k) {
        const double x = (double)k - (double)half, w = exp(-x * x / (2 * sigma * sigma));
        sum += w;
        if (kernel.direct)
            kernel.taps[k] = (float)w;
    }
    for (size_t k = 0; kernel.direct && k < 2 * half + 1; ++k)
        kernel.taps[k] = (float)((double)kernel.taps[k] / sum);
    if (kernel.direct)
        return kernel;
    // Box b reaches to (b + 1) / BOXES of the half width; the weights add up to the Gaussian.
    double total = 0, outer = 0;
    for (int b = BOXES - 1; b >= 0; --b) {
        kernel.half[b] = half * (size_t)(b + 1) / BOXES;
        const double middle = ((double)b + 0.5) / BOXES * (double)half;
        const double w = exp(-middle * middle / (2 * sigma * sigma));
        kernel.weight[b] = w - outer;
        outer = w;
        total += kernel.weight[b] * (double)(2 * kernel.half[b] + 1);
    }
    for (int b = 0; b < BOXES; ++b)
        kernel.weight[b] /= total;
    return kernel;
}

typedef struct plas_blur {
    const float *from;
    float *to;
    size_t side, half;
    plas_kernel kernel;
    bool vertical;
    double *scratch; // [threads][side + 2 half + 1][C]
} plas_blur;

// Index of an element beyond the ends of a line.
static size_t wrapped(const plas_blur *blur, ptrdiff_t i)
{
    const ptrdiff_t side = (ptrdiff_t)blur->side;
    if (!blur->vertical)
        return (size_t)((i % side + side) % side);
    if (side == 1)
        return 0;
    const ptrdiff_t period = 2 * (side - 1), at = (i % period + period) % period;
    return (size_t)(at < side ? at : period - at);
}

static void blur_line(void *context, size_t line, int thread)
{
    const plas_blur *blur = context;
    const size_t side = blur->side, half = blur->half;
    const size_t stride = (blur->vertical ? side : 1) * C;
    const float *from = blur->from + (blur->vertical ? line : line * side) * C;
    float *to = blur->to + (blur->vertical ? line : line * side) * C;
    double *sums = blur->scratch + (size_t)thread * (side + 2 * half + 1) * C;
    memset(sums, 0, C * sizeof *sums);
    for (size_t i = 0; i < side + 2 * half; ++i) {
        const float *x = from + wrapped(blur, (ptrdiff_t)i - (ptrdiff_t)half) * stride;
        for (size_t c = 0; c < C; ++c)
            sums[(i + 1) * C + c] = (blur->kernel.direct ? 0 : sums[i * C + c]) + (double)x[c];
    }
    for (size_t i = 0; i < side; ++i) {
        double out[C] = {0};
        if (blur->kernel.direct) {
            for (size_t k = 0; k <= 2 * half; ++k)
                for (size_t c = 0; c < C; ++c)
                    out[c] += (double)blur->kernel.taps[k] * sums[(i + k + 1) * C + c];
        } else {
            for (size_t b = 0; b < BOXES; ++b) {
                const size_t reach = blur->kernel.half[b];
                const double *high = sums + (i + half + reach + 1) * C,
                             *low = sums + (i + half - reach) * C, w = blur->kernel.weight[b];
                for (size_t c = 0; c < C; ++c)
                    out[c] += w * (high[c] - low[c]);
            }
        }
        for (size_t c = 0; c < C; ++c)
            to[i * stride + c] = (float)out[c];
    }
}

static bool make_target(plas_work *work)
{
    plas_blur blur = {.from = work->plas->features,
                      .to = work->blurred,
                      .side = work->side,
                      .half = work->half,
                      .kernel = make_kernel(work->half)};
    blur.scratch = sgsi_alloc((size_t)sgsi_threads() * (work->side + 2 * work->half + 1),
                              C * sizeof *blur.scratch);
    if (!blur.scratch)
        return false;
    sgsi_parallel_for(work->side, 0, blur_line, &blur);
    blur.from = work->blurred;
    blur.to = work->target;
    blur.vertical = true;
    sgsi_parallel_for(work->side, 0, blur_line, &blur);
    sgsi_free(blur.scratch);
    return true;
}

// ---- Passes ----

// Cell of position `p` inside a block.
static size_t cell_of(const plas_work *work, size_t block, uint32_t p)
{
    const size_t b = work->block;
    size_t y = block / work->blocks * b + (p >> COORDINATE_BITS) + work->shift_y,
           x = block % work->blocks * b + (p & ((1u << COORDINATE_BITS) - 1)) + work->shift_x;
    y -= y >= work->side ? work->side : 0;
    x -= x >= work->side ? work->side : 0;
    return y * work->side + x;
}

static void arrange_group(const plas_work *work, const size_t cells[4], double distances[2])
{
    float cost[4][4], features[4][C]; // cost[i][j]: element i at cell j
    for (int i = 0; i < 4; ++i)
        memcpy(features[i], work->plas->features + cells[i] * C, sizeof features[i]);
    for (int j = 0; j < 4; ++j) {
        const float *target = work->target + cells[j] * C;
        for (int i = 0; i < 4; ++i) {
            float lanes[4] = {0};
            for (int c = 0; c < C; c += 4)
                for (int k = 0; k < 4; ++k) {
                    const float d = features[i][c + k] - target[c + k];
                    lanes[k] += d * d;
                }
            cost[i][j] = (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
        }
    }
    const float before = (cost[0][0] + cost[1][1]) + (cost[2][2] + cost[3][3]);
    float least = before;
    uint8_t best[4] = {0, 1, 2, 3}; // the element at each cell
    for (int p = 0; p < 6; ++p) {
        const uint8_t *at = pairs[p];
        const float kept[2] = {cost[at[0]][0] + cost[at[1]][1], cost[at[2]][2] + cost[at[3]][3]},
                    swapped[2] = {cost[at[1]][0] + cost[at[0]][1], cost[at[3]][2] + cost[at[2]][3]};
        const int first = swapped[0] < kept[0], second = swapped[1] < kept[1];
        const float sum = (first ? swapped[0] : kept[0]) + (second ? swapped[1] : kept[1]);
        if (sum < least) {
            least = sum;
            best[0] = at[first];
            best[1] = at[!first];
            best[2] = at[2 + second];
            best[3] = at[2 + !second];
        }
    }
    distances[0] += (double)before;
    distances[1] += (double)least;
    if (!(least < before))
        return;
    uint32_t order[4];
    for (int i = 0; i < 4; ++i)
        order[i] = work->plas->order[cells[i]];
    for (int j = 0; j < 4; ++j) {
        memcpy(work->plas->features + cells[j] * C, features[best[j]], sizeof features[0]);
        work->plas->order[cells[j]] = order[best[j]];
    }
}

static void arrange_item(void *context, size_t item, int thread)
{
    (void)thread;
    const plas_work *work = context;
    const size_t groups = work->block * work->block / 4, block = item / work->items_per_block;
    const size_t begin = item % work->items_per_block * GROUPS_PER_ITEM;
    const size_t end = begin + GROUPS_PER_ITEM < groups ? begin + GROUPS_PER_ITEM : groups;
    double *distances = work->distances + 2 * item;
    distances[0] = distances[1] = 0;
    for (size_t g = begin; g < end; g += BATCH) {
        size_t cells[4 * BATCH];
        const size_t count = end - g < BATCH ? end - g : BATCH;
        for (size_t k = 0; k < 4 * count; ++k) {
            cells[k] = cell_of(work, block, work->permutation[4 * g + k]);
            __builtin_prefetch(work->plas->features + cells[k] * C);
            __builtin_prefetch(work->target + cells[k] * C);
        }
        for (size_t k = 0; k < count; ++k)
            arrange_group(work, cells + 4 * k, distances);
    }
}

static uint32_t random_below(plas_work *work, size_t limit)
{
    return (uint32_t)((sgsi_random_bits(work->plas->seed, work->counter++) >> 32) *
                          (uint64_t)limit >>
                      32);
}

static void permute(plas_work *work, uint32_t *items, size_t count)
{
    for (size_t i = count; i > 1; --i) {
        const uint32_t j = random_below(work, i), swapped = items[i - 1];
        items[i - 1] = items[j];
        items[j] = swapped;
    }
}

// One pass over all blocks; true if the distance improved.
static bool run_pass(plas_work *work)
{
    const sgsi_plas *plas = work->plas;
    work->cancelled =
        plas->progress && !plas->progress(plas->progress_user, work->done, work->total);
    if (work->cancelled)
        return false;
    const size_t area = work->block * work->block;
    permute(work, work->permutation, area);
    work->items_per_block = (area / 4 + GROUPS_PER_ITEM - 1) / GROUPS_PER_ITEM;
    const size_t items = work->items_per_block * work->blocks * work->blocks;
    if (!items)
        return false;
    sgsi_parallel_for(items, 0, arrange_item, work);
    double before = 0, after = 0;
    for (size_t i = 0; i < items; ++i) {
        before += work->distances[2 * i];
        after += work->distances[2 * i + 1];
    }
    return before > 0 && 1 - after / before >= plas->improvement_break;
}

static bool sort_radius(plas_work *work, size_t radius)
{
    const size_t side = work->side;
    size_t taps = 2 * radius + 1;
    taps = taps < side - 1 ? taps : side - 1;
    work->half = taps / 2;
    work->block = (taps + 1 < side ? taps + 1 : side) / 2 * 2;
    work->block = work->block > MIN_BLOCK ? work->block : MIN_BLOCK;
    work->block = work->block < side ? work->block : side;
    work->blocks = side / work->block;
    if (!make_target(work))
        return false;
    for (size_t i = 0; i < work->block * work->block; ++i)
        work->permutation[i] = (uint32_t)(i / work->block << COORDINATE_BITS | i % work->block);
    for (int offset = 0;; ++offset) {
        work->shift_y = random_below(work, work->block);
        work->shift_x = random_below(work, work->block);
        bool improved = false;
        while (run_pass(work))
            improved = true;
        if (work->cancelled || (!improved && offset + 1 >= MIN_OFFSETS))
            return true;
    }
}

// Applies a random order to order and features.
static bool shuffle(plas_work *work)
{
    sgsi_plas *plas = work->plas;
    const size_t count = work->side * work->side;
    uint32_t *source = sgsi_alloc(count, sizeof *source);
    if (!source)
        return false;
    for (size_t i = 0; i < count; ++i)
        source[i] = (uint32_t)i;
    permute(work, source, count);
    memcpy(work->target, plas->features, count * C * sizeof *plas->features);
    for (size_t i = 0; i < count; ++i)
        memcpy(plas->features + i * C, work->target + (size_t)source[i] * C,
               C * sizeof *plas->features);
    memcpy(plas->order, source, count * sizeof *source);
    sgsi_free(source);
    return true;
}

sgs_status sgsi_plas_sort(sgsi_plas *plas)
{
    const size_t side = (size_t)plas->side, count = side * side;
    plas_work work = {.plas = plas, .side = side};
    work.target = sgsi_alloc(count, C * sizeof(float));
    work.blurred = sgsi_alloc(count, C * sizeof(float));
    work.permutation = sgsi_alloc(count, sizeof *work.permutation);
    // A block of at least 16 x 16 cells is one item.
    work.distances = sgsi_alloc(count / 64 + 64, 2 * sizeof *work.distances);
    bool memory = work.target && work.blurred && work.permutation && work.distances;
    memory = memory && shuffle(&work);
    const double first = (double)side / 2 - 1;
    work.total = first >= 1 ? (size_t)(log(1 / first) / log(RADIUS_DECAY)) + 1 : 0;
    for (double radius = first; radius >= 1 && memory && !work.cancelled; radius *= RADIUS_DECAY) {
        memory = sort_radius(&work, (size_t)radius);
        work.done += work.done < work.total;
    }
    sgsi_free(work.target);
    sgsi_free(work.blurred);
    sgsi_free(work.permutation);
    sgsi_free(work.distances);
    if (!memory)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives",
                         count);
    return work.cancelled ? sgsi_fail(SGS_STATUS_CANCELLED, "sorting was cancelled")
                          : SGS_STATUS_OK;
}
