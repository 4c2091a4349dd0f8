// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPARE-GS: regions, demand, quotas, weights and redundancy.
//
// Training 3D Gaussians under a budget of primitives is an allocation problem: place the next
// primitive where it lowers the loss most. At the optimum the marginal utility of one more
// primitive is equal in every region of space (Eq. 12). The paper ("SPARE-GS", arXiv 2607.16624)
// turns this condition into a feedback loop. It runs at every structural update, before anything is
// cloned, split or removed, and uses statistics that the base pipeline accumulates anyway:
//
//   a_i    accumulated norm of the view-space gradient
//   d_i    number of views in which the primitive was visible
//   rho_i  largest projected radius in pixels
//   alpha_i  opacity
//
//   The bounding box of the centres is divided into 32^3 voxels. The K non-empty voxels are the
//   regions; region r contains n_r primitives.
//
//   (15)  demand      D_r = Q(H_r) + Q(V_r), Q(m) = rank of m among the regions / K
//   (16)  gradient    H_r = mean over r of a_i / d_i
//   (17)  visibility  V_r = mean over r of d_i
//   (18)  footprint   A_r = mean over r of rho_i^2
//         capacity    C_r = A_r / median of A
//         score       Q_r = D_r / C_r
//   (19)  share       l_r = Q_r / sum of Q
//   (20)  quota       n^_r = B l_r
//   (21)  slack       s_r = (n^_r - n_r) / (n^_r + 1), in (-inf, 1); positive: under budget
//   (22)  weight      w_i = Phi(s, l_r / max l); multiplies the densification score (23)
//   (24)  redundant   n_r > n^_r and alpha_i < tau_alpha and a_i / d_i < tau_org / 2
//
// The paper leaves four points open. The choices of this implementation:
//
//   OPEN-1, "footprint-normalized gradient": the text announces a normalisation by footprint, the
//     formula divides by d_i only. The formula is implemented as printed. H enters through its rank
//     only, so the influence is small.
//   OPEN-2, the budget B, "dynamically scaled" with N: B = kappa N with kappa = 1, a pure
//     redistribution target. kappa < 1 would put every region over quota, which amounts to a
//     higher threshold.
//   OPEN-3, Phi, "a bounded sigmoid": w = 1 + gamma tanh(kappa_s s / 2), kappa_s = 2, with gamma =
//     gamma_0 (1 + l~) / 2 for s >= 0 and gamma_0 (1 - l~ / 2) for s < 0, gamma_0 = 3/8. So w = 1
//     at s = 0, w is in (1 - gamma_0, 1 + gamma_0) and increases with s and l~: regions of high
//     demand are boosted more and suppressed less. The paper reports a reduction by 12 % for BMD
//     alone; at 30 000 iterations it is 22 to 26 % with 3/8, and 11 % with 0.2
//     (tools/experiments/spare-gs.md). spare_phi selects three other forms.
//   OPEN-4, interval and average of the termination test: see spare_equilibrium.c.
//
// Further details: tied regions share the mean of their ranks (many tie at 0). C_r is clamped to
// [1/4, 4]; otherwise a few voxels of tiny primitives take the whole budget. The median is taken
// over regions with A_r > 0 (mean of the two middle values for an even number); a region with
// A_r = 0 was not seen and has C_r = 1. a_i / d_i is 0 when d_i = 0, as in the base pipelines, so a
// faint primitive of an over-quota region that no view has seen is redundant unless
// rap_require_visible is set. A primitive with a non-finite centre is excluded from the box, the
// regions and N; its weight is 1 and it is not redundant. A non-finite gradient or
// radius counts as 0 in the means and never passes the gradient test of (24).
//
// Sums are in double precision and in index order within a region: the result depends on the input
// only, not on the loop that runs its passes. A call makes four passes over the primitives and
// three radix sorts of K numbers. A pass is divided into slices of the primitives; that of the sums
// into shares of the voxels, each of which reads all primitives.

#include "spare/spare.h"

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

enum { ALIGNMENT = 64, GRID_MAX = 256, RADIX = 256, BOX_LANES = 8 };
enum { MIN_SLICE = 1 << 14, MAX_SLICES = 256, MAX_SHARES = 16 };

// Sums of one voxel.
typedef struct cell {
    double gradient, visibility, area;
    uint64_t count;
} cell;

// Per voxel, for the last pass over the primitives.
typedef struct decision {
    uint32_t region;
    float weight;
    uint32_t over; // n_r > quota
} decision;

typedef struct sort_item {
    uint64_t key;
    uint64_t index;
} sort_item;

typedef struct workspace {
    uint32_t *region_of;      // [count]; voxel index until the last pass
    cell *cells;              // [voxels + 1], the last one for non-finite centres
    decision *decisions;      // [voxels + 1]
    spare_region *regions;    // [regions]
    sort_item *items, *other; // [regions]
    size_t size;
} workspace;

typedef struct box {
    double low[3], scale[3]; // voxel = (x - low) * scale
} box;

// Smallest and largest coordinates of the finite centres.
typedef struct extremes {
    float low[3], high[3];
} extremes;

// A pass over the primitives.
typedef struct pass {
    const spare_options *options;
    const spare_input *input;
    workspace *w;
    size_t slices, shares; // shares: a power of two
    size_t grid;
    box box;
    extremes found[MAX_SLICES]; // [slices]
    float *weights;
    uint8_t *redundant;
    atomic_size_t redundant_count;
} pass;

static void begin_pass(pass *p, const spare_options *options, const spare_input *input,
                       workspace *w)
{
    const size_t slices = input->count / MIN_SLICE;
    p->options = options;
    p->input = input;
    p->w = w;
    p->slices = !input->loop || slices < 1 ? 1 : slices < MAX_SLICES ? slices : MAX_SLICES;
    for (p->shares = 1;
         p->slices > 1 && 2 * p->shares <= (size_t)input->threads && p->shares < MAX_SHARES;)
        p->shares *= 2;
}

static void run_pass(pass *p, size_t count, spare_slice_fn body)
{
    if (p->input->loop)
        p->input->loop(count, body, p);
    else
        for (size_t slice = 0; slice < count; ++slice)
            body(p, slice);
}

// First primitive of a slice; slice `slices`: their number.
static size_t slice_begin(const pass *p, size_t slice)
{
    const size_t size = (p->input->count + p->slices - 1) / p->slices, begin = slice * size;
    return begin < p->input->count ? begin : p->input->count;
}

spare_options spare_options_default(void)
{
    return (spare_options){
        .grid = 32,
        .budget_scale = 1.0,
        .slack_gain = 2.0,
        .weight_range = 0.375,
        .phi = SPARE_PHI_COUPLED,
        .capacity_min = 0.25,
        .capacity_max = 4.0,
        .tau_alpha = 0.05,
        .tau_gradient = 2e-4,
        .use_h = true,
        .use_v = true,
        .use_c = true,
        .rap_require_visible = false,
    };
}

static size_t grid_of(const spare_options *options)
{
    return options->grid < 1 ? 1 : options->grid > GRID_MAX ? GRID_MAX : (size_t)options->grid;
}

static size_t voxel_count(const spare_options *options)
{
    const size_t grid = grid_of(options);
    return grid * grid * grid;
}

static void *carve(char *base, size_t *offset, size_t count, size_t size)
{
    void *part = base ? base + *offset : NULL;
    *offset += (count * size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return part;
}

static workspace lay_out(const spare_options *options, size_t count, void *memory)
{
    const size_t voxels = voxel_count(options), regions = count < voxels ? count : voxels;
    workspace w = {0};
    w.region_of = carve(memory, &w.size, count, sizeof *w.region_of);
    w.cells = carve(memory, &w.size, voxels + 1, sizeof *w.cells);
    w.decisions = carve(memory, &w.size, voxels + 1, sizeof *w.decisions);
    w.regions = carve(memory, &w.size, regions, sizeof *w.regions);
    w.items = carve(memory, &w.size, regions, sizeof *w.items);
    w.other = carve(memory, &w.size, regions, sizeof *w.other);
    return w;
}

size_t spare_workspace_size(const spare_options *options, size_t count)
{
    return lay_out(options, count, NULL).size;
}

// Sets low and scale so that `grid` voxels cover the interval, padded on both sides by a thousandth
// of its length (at least 1e-6).
static void set_axis(box *b, int axis, double low, double high, size_t grid)
{
    const double extent = high - low, pad = fmax(1e-3 * extent, 1e-6);
    b->low[axis] = low - pad;
    b->scale[axis] = (double)grid / (extent + 2.0 * pad);
}

static void find_extremes(void *context, size_t slice)
{
    pass *job = context;
    const spare_input *input = job->input;
    const size_t first = slice_begin(job, slice), last = slice_begin(job, slice + 1);
    float low[3][BOX_LANES], high[3][BOX_LANES];
    for (int lane = 0; lane < BOX_LANES; ++lane)
        for (int axis = 0; axis < 3; ++axis) {
            low[axis][lane] = INFINITY;
            high[axis][lane] = -INFINITY;
        }
    // Eight independent minima let the compiler use vector instructions. `taint` is 0, or NaN for a
    // non-finite coordinate: then every comparison is false and the primitive is left out.
    for (size_t begin = first; begin < last; begin += BOX_LANES) {
        const size_t lanes = last - begin < BOX_LANES ? last - begin : BOX_LANES;
        for (size_t lane = 0; lane < lanes; ++lane) {
            const float x = input->x[begin + lane], y = input->y[begin + lane],
                        z = input->z[begin + lane];
            const float taint = (x - x) + (y - y) + (z - z);
            const float p[3] = {x + taint, y + taint, z + taint};
            for (int axis = 0; axis < 3; ++axis) {
                low[axis][lane] = p[axis] < low[axis][lane] ? p[axis] : low[axis][lane];
                high[axis][lane] = p[axis] > high[axis][lane] ? p[axis] : high[axis][lane];
            }
        }
    }
    extremes *found = &job->found[slice];
    for (int axis = 0; axis < 3; ++axis) {
        float least = low[axis][0], most = high[axis][0];
        for (int lane = 1; lane < BOX_LANES; ++lane) {
            least = low[axis][lane] < least ? low[axis][lane] : least;
            most = high[axis][lane] > most ? high[axis][lane] : most;
        }
        found->low[axis] = least;
        found->high[axis] = most;
    }
}

// Bounding box of the finite centres.
static box bounding_box(pass *p)
{
    const extremes *found = p->found;
    run_pass(p, p->slices, find_extremes);
    box b;
    for (int axis = 0; axis < 3; ++axis) {
        float least = found[0].low[axis], most = found[0].high[axis];
        for (size_t slice = 1; slice < p->slices; ++slice) {
            least = found[slice].low[axis] < least ? found[slice].low[axis] : least;
            most = found[slice].high[axis] > most ? found[slice].high[axis] : most;
        }
        const bool any = most >= least;
        set_axis(&b, axis, any ? (double)least : 0.0, any ? (double)most : 0.0, p->grid);
    }
    return b;
}

// The value of rank k in ascending order (Hoare's selection). Reorders values.
static float select_value(float *values, size_t count, size_t k)
{
    size_t first = 0, last = count - 1;
    while (first < last) {
        const float pivot = values[first + (last - first) / 2];
        size_t i = first, j = last;
        for (;;) {
            while (values[i] < pivot)
                ++i;
            while (values[j] > pivot)
                --j;
            if (i >= j)
                break;
            const float swapped = values[i];
            values[i++] = values[j];
            values[j--] = swapped;
        }
        if (k <= j)
            last = j;
        else
            first = j + 1;
    }
    return values[k];
}

// The box of the finite centres, excluding the fraction `quantile` of them at each end of each
// axis. `values` has room for input->count.
static box quantile_box(const spare_input *input, double quantile, size_t grid, float *values)
{
    const float *const columns[3] = {input->x, input->y, input->z};
    box b;
    for (int axis = 0; axis < 3; ++axis) {
        size_t n = 0;
        for (size_t i = 0; i < input->count; ++i) {
            values[n] = columns[axis][i];
            n += isfinite(input->x[i]) && isfinite(input->y[i]) && isfinite(input->z[i]);
        }
        const size_t cut = n ? (size_t)(quantile * (double)(n - 1)) : 0;
        const double low = n ? (double)select_value(values, n, cut) : 0.0;
        const double high = n ? (double)select_value(values, n, n - 1 - cut) : 0.0;
        set_axis(&b, axis, low, high, grid);
    }
    return b;
}

// Clamps to the grid; NaN gives 0.
static inline uint32_t voxel_coordinate(double x, double low, double scale, double last)
{
    const double at = (x - low) * scale;
    const double clamped = at < last ? at : last;
    return (uint32_t)(int32_t)(clamped > 0.0 ? clamped : 0.0);
}

// k_i for every primitive; that of grid^3, one beyond the last, for those without a finite centre.
static void assign_voxels(void *context, size_t slice)
{
    const pass *p = context;
    const spare_input *input = p->input;
    const box *b = &p->box;
    const size_t grid = p->grid, end = slice_begin(p, slice + 1);
    const uint32_t outside = (uint32_t)(grid * grid * grid);
    uint32_t *voxel_of = p->w->region_of;
    const double last = (double)grid - 1.0;
    for (size_t i = slice_begin(p, slice); i < end; ++i) {
        const float x = input->x[i], y = input->y[i], z = input->z[i];
        const float taint = (x - x) + (y - y) + (z - z);
        const uint32_t vx = voxel_coordinate((double)x, b->low[0], b->scale[0], last);
        const uint32_t vy = voxel_coordinate((double)y, b->low[1], b->scale[1], last);
        const uint32_t vz = voxel_coordinate((double)z, b->low[2], b->scale[2], last);
        // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): NULL only when computing the size
        voxel_of[i] = taint == 0.0f ? (vz * (uint32_t)grid + vy) * (uint32_t)grid + vx : outside;
    }
}

// a_i / d_i; 0 for a primitive that was not visible in any view.
static inline double mean_gradient(const spare_input *input, size_t i)
{
    const uint32_t views = input->visible_count[i];
    return views ? (double)input->gradient_sum[i] / (double)views : 0.0;
}

static inline double finite_or_zero(double value)
{
    return fabs(value) <= DBL_MAX ? value : 0.0;
}

// Sums of (16), (17) and (18) per voxel of a share, in index order. Voxels of a cache line are in
// one share.
static void accumulate(void *context, size_t share)
{
    enum { ROW_BITS = 5 };
    const pass *p = context;
    const spare_input *input = p->input;
    const uint32_t *voxel_of = p->w->region_of;
    for (size_t i = 0; i < input->count; ++i) {
        if ((voxel_of[i] >> ROW_BITS & (p->shares - 1)) != share)
            continue;
        cell *c = &p->w->cells[voxel_of[i]];
        const double radius = (double)input->radius_max[i];
        c->gradient += finite_or_zero(mean_gradient(input, i));
        c->visibility += (double)input->visible_count[i];
        c->area += finite_or_zero(radius * radius);
        ++c->count;
    }
}

// Non-empty voxels in ascending order with their means (16), (17) and (18). Returns K.
static size_t collect_regions(const cell *cells, size_t voxels, spare_region *regions,
                              decision *decisions)
{
    size_t count = 0;
    for (size_t voxel = 0; voxel < voxels; ++voxel) {
        const cell *c = &cells[voxel];
        if (!c->count)
            continue;
        const double n = (double)c->count;
        decisions[voxel].region = (uint32_t)count;
        regions[count++] = (spare_region){
            .voxel = (uint32_t)voxel,
            .count = (uint32_t)c->count,
            .gradient = c->gradient / n,
            .visibility = c->visibility / n,
            .area = c->area / n,
        };
    }
    return count;
}

// The bits of non-negative doubles sort as integers; -0 becomes +0. The means are sums of norms,
// counts and squares, hence never negative.
static uint64_t ordered_bits(double value)
{
    uint64_t bits;
    value += 0.0;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

// Stable radix sort by key, eight bits per pass; skips bytes that all keys share. The result is in
// *items.
static void sort_items(sort_item **items, sort_item **other, size_t count)
{
    for (int shift = 0; shift < 64; shift += 8) {
        size_t start[RADIX] = {0};
        for (size_t i = 0; i < count; ++i)
            ++start[(*items)[i].key >> shift & (RADIX - 1)];
        if (count && start[(*items)[0].key >> shift & (RADIX - 1)] == count)
            continue;
        size_t sum = 0;
        for (int digit = 0; digit < RADIX; ++digit) {
            const size_t here = start[digit];
            start[digit] = sum;
            sum += here;
        }
        for (size_t i = 0; i < count; ++i)
            (*other)[start[(*items)[i].key >> shift & (RADIX - 1)]++] = (*items)[i];
        sort_item *const swap = *items;
        *items = *other;
        *other = swap;
    }
}

typedef double (*metric_fn)(const spare_region *region);

static double metric_gradient(const spare_region *region)
{
    return region->gradient;
}

static double metric_visibility(const spare_region *region)
{
    return region->visibility;
}

// Adds Q(m) = rank / K to the demand of every region (15). Equal values share the mean of their
// ranks.
static void add_rank(workspace *w, size_t count, metric_fn metric)
{
    for (size_t r = 0; r < count; ++r)
        w->items[r] = (sort_item){ordered_bits(metric(&w->regions[r])), r};
    sort_items(&w->items, &w->other, count);
    for (size_t begin = 0, end; begin < count; begin = end) {
        for (end = begin + 1; end < count && w->items[end].key == w->items[begin].key;)
            ++end;
        const double rank = 0.5 * (double)(begin + 1 + end); // ranks begin + 1 .. end
        for (size_t k = begin; k < end; ++k)
            w->regions[w->items[k].index].demand += rank / (double)count;
    }
}

// A_ref: the median of the positive A_r; 0 if there are none.
static double reference_area(workspace *w, size_t count)
{
    size_t positive = 0;
    for (size_t r = 0; r < count; ++r)
        if (w->regions[r].area > 0.0)
            w->items[positive++] = (sort_item){ordered_bits(w->regions[r].area), r};
    if (!positive)
        return 0.0;
    sort_items(&w->items, &w->other, positive);
    const double low = w->regions[w->items[(positive - 1) / 2].index].area;
    const double high = w->regions[w->items[positive / 2].index].area;
    return 0.5 * (low + high);
}

// Phi of (22): the weight for slack s and normalised share l~ in (0, 1]. 2 sigma(u) - 1 is written
// as tanh(u / 2).
static double modulation(const spare_options *options, double slack, double share)
{
    const double gain = 0.5 * options->slack_gain;
    switch (options->phi) {
    case SPARE_PHI_CONSTANT:
        return 1.0 + options->weight_range * tanh(gain * slack);
    case SPARE_PHI_PRODUCT:
        return 2.0 / (1.0 + exp(-options->slack_gain * slack * share)); // can approach 0
    case SPARE_PHI_PLAIN:
        return 1.0 + 0.5 * tanh(gain * slack);
    default: {
        const double gamma =
            options->weight_range * (slack >= 0.0 ? 0.5 * (1.0 + share) : 1.0 - 0.5 * share);
        return 1.0 + gamma * tanh(gain * slack);
    }
    }
}

// Demand (15), capacity and score (18). Without H and V all regions have the same demand; without C
// all capacities are 1.
static void score_regions(const spare_options *options, workspace *w, size_t count)
{
    const bool any = options->use_h || options->use_v;
    for (size_t r = 0; r < count; ++r)
        w->regions[r].demand = any ? 0.0 : 1.0;
    if (options->use_h)
        add_rank(w, count, metric_gradient);
    if (options->use_v)
        add_rank(w, count, metric_visibility);
    const double reference = options->use_c ? reference_area(w, count) : 0.0;
    for (size_t r = 0; r < count; ++r) {
        spare_region *region = &w->regions[r];
        // A region without a footprint was not seen: its capacity is unknown, not small.
        region->capacity = 1.0;
        if (reference > 0.0 && region->area > 0.0)
            region->capacity =
                fmin(fmax(region->area / reference, options->capacity_min), options->capacity_max);
        region->score = region->demand / region->capacity;
    }
}

// Share (19), quota (20), slack (21) and weight (22) of each region, and the decision for its
// voxel.
static void allocate(const spare_options *options, workspace *w, size_t count, double budget)
{
    double sum = 0.0, most = 0.0;
    for (size_t r = 0; r < count; ++r) {
        sum += w->regions[r].score;
        most = fmax(most, w->regions[r].score);
    }
    for (size_t r = 0; r < count; ++r) {
        spare_region *region = &w->regions[r];
        const double n = (double)region->count;
        region->share = region->score / sum;
        region->quota = budget * region->share;
        region->slack = (region->quota - n) / (region->quota + 1.0);
        region->weight = modulation(options, region->slack, region->score / most);
        decision *v = &w->decisions[region->voxel];
        v->weight = (float)region->weight;
        v->over = n > region->quota;
    }
}

// Writes the weights and the mask (24), counts the redundant primitives, and replaces the voxels of
// region_of by regions.
static void mark_redundant(void *context, size_t slice)
{
    pass *p = context;
    const spare_options *options = p->options;
    const spare_input *input = p->input;
    const workspace *w = p->w;
    const double tau_gradient = 0.5 * options->tau_gradient;
    const size_t end = slice_begin(p, slice + 1);
    size_t found = 0;
    for (size_t i = slice_begin(p, slice); i < end; ++i) {
        const decision *v = &w->decisions[w->region_of[i]];
        w->region_of[i] = v->region;
        p->weights[i] = v->weight;
        const bool faint = v->over && (double)input->opacity[i] < options->tau_alpha;
        const bool seen = !options->rap_require_visible || input->visible_count[i];
        p->redundant[i] = faint && seen && mean_gradient(input, i) < tau_gradient;
        found += p->redundant[i];
    }
    atomic_fetch_add_explicit(&p->redundant_count, found, memory_order_relaxed);
}

void spare_evaluate(const spare_options *options, const spare_input *input, void *memory,
                    float *weights, uint8_t *redundant, spare_result *result)
{
    const size_t grid = grid_of(options), voxels = voxel_count(options);
    workspace w = lay_out(options, input->count, memory);
    *result = (spare_result){.regions = w.regions, .region_of = w.region_of, .mean_weight = 1.0};
    if (!input->count)
        return;

    pass p = {.grid = grid, .weights = weights, .redundant = redundant};
    begin_pass(&p, options, input, &w);
    const double quantile = fmin(options->grid_quantile, 0.25);
    // The memory of region_of serves as the copy of a column.
    p.box = quantile > 0.0 ? quantile_box(input, quantile, grid, (float *)(void *)w.region_of)
                           : bounding_box(&p);
    for (int axis = 0; axis < 3; ++axis) {
        result->low[axis] = p.box.low[axis];
        result->voxel_size[axis] = 1.0 / p.box.scale[axis];
    }
    run_pass(&p, p.slices, assign_voxels);
    // NOLINTNEXTLINE(clang-analyzer-core.NonNullParamChecker): as above
    memset(w.cells, 0, (voxels + 1) * sizeof *w.cells);
    run_pass(&p, p.shares, accumulate);
    w.decisions[voxels] = (decision){.region = SPARE_NO_REGION, .weight = 1.0f};
    const double total = (double)(input->count - w.cells[voxels].count);
    const size_t count = collect_regions(w.cells, voxels, w.regions, w.decisions);
    score_regions(options, &w, count);
    allocate(options, &w, count, options->budget_scale * total);

    double weight = 0.0, over = 0.0;
    for (size_t r = 0; r < count; ++r) {
        const double n = (double)w.regions[r].count;
        weight += n * w.regions[r].weight;
        over += n > w.regions[r].quota ? n : 0.0;
    }
    result->region_count = count;
    if (count) {
        result->mean_weight = weight / total;
        result->over_budget_share = over / total;
    }
    run_pass(&p, p.slices, mark_redundant);
    result->redundant_count = p.redundant_count;
}

bool spare_pruning_in_cooldown(long iteration, long last_opacity_reset, long interval)
{
    // An update at the iteration of the reset runs before the reset and is not affected.
    return last_opacity_reset >= 0 && iteration > last_opacity_reset &&
           iteration - last_opacity_reset <= interval;
}
