// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPARE-GS is compared with values computed by hand and with a slow independent implementation of
// the paper (a loop over all primitives for every region, ranks by counting). The properties that
// the method guarantees are tested as well.

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "spare/spare.h"

enum { GUARD = 64 };

// Columns of primitives owned by the test, and the output of spare_evaluate.
typedef struct fixture {
    size_t count;
    float *x, *y, *z, *opacity, *gradient, *radius, *weights;
    uint32_t *visible;
    uint8_t *redundant;
    uint8_t *workspace;
    size_t workspace_size;
    spare_result result;
} fixture;

static void *take(size_t count, size_t size)
{
    void *block = sgsi_calloc(count + 1, size);
    assert_non_null(block);
    return block;
}

static fixture make_fixture(size_t count)
{
    fixture f = {.count = count};
    float **const columns[] = {&f.x, &f.y, &f.z, &f.opacity, &f.gradient, &f.radius, &f.weights};
    for (size_t k = 0; k < sizeof columns / sizeof *columns; ++k)
        *columns[k] = take(count, sizeof(float));
    f.visible = take(count, sizeof *f.visible);
    f.redundant = take(count, 1);
    return f;
}

static void free_fixture(fixture *f)
{
    float *const columns[] = {f->x, f->y, f->z, f->opacity, f->gradient, f->radius, f->weights};
    for (size_t k = 0; k < sizeof columns / sizeof *columns; ++k)
        sgsi_free(columns[k]);
    sgsi_free(f->visible);
    sgsi_free(f->redundant);
    sgsi_free(f->workspace);
}

// Runs on uninitialised memory of exactly the documented size with a guard after it, and checks
// that nothing was allocated.
static void evaluate(fixture *f, const spare_options *options)
{
    sgsi_free(f->workspace);
    f->workspace_size = spare_workspace_size(options, f->count);
    f->workspace = take(f->workspace_size + GUARD, 1);
    memset(f->workspace, 0xA5, f->workspace_size + GUARD);
    memset(f->weights, 0xA5, f->count * sizeof *f->weights);
    memset(f->redundant, 0xA5, f->count);
    const spare_input input = {f->count,    f->x,       f->y,      f->z, f->opacity,
                               f->gradient, f->visible, f->radius, NULL, 0};
    const size_t allocations = sgsi_allocation_count();
    spare_evaluate(options, &input, f->workspace, f->weights, f->redundant, &f->result);
    assert_int_equal(sgsi_allocation_count(), allocations);
    for (size_t i = 0; i < GUARD; ++i)
        assert_int_equal(f->workspace[f->workspace_size + i], 0xA5);
}

// -------------------------------------------------------------------------------------------------
// The independent implementation.

typedef enum plant {
    PLANT_NONE,
    PLANT_RANK_DESCENDING,
    PLANT_TIES_FIRST,
    PLANT_NO_CLAMP,
    PLANT_MEAN_FOR_MEDIAN,
    PLANT_MULTIPLY_CAPACITY,
    PLANT_SLACK_WITHOUT_ONE,
    PLANT_SHARE_NOT_RELATIVE,
    PLANT_FULL_TAU,
    PLANT_SWAPPED_AXES,
    PLANT_RADIUS_NOT_SQUARED,
    PLANT_COUNT
} plant;

typedef struct opinion {
    size_t region_count;
    spare_region *regions;
    uint32_t *region_of;
    uint8_t *redundant;
} opinion;

static int finite_centre(const fixture *f, size_t i)
{
    return isfinite(f->x[i]) && isfinite(f->y[i]) && isfinite(f->z[i]);
}

static size_t finite_count(const fixture *f)
{
    size_t count = 0;
    for (size_t i = 0; i < f->count; ++i)
        count += (size_t)finite_centre(f, i);
    return count;
}

static int compare_values(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

// Lower end and length of the padded grid on one axis.
static void slow_span(const fixture *f, const float *column, const spare_options *o, double span[2])
{
    float *sorted = take(f->count, sizeof *sorted);
    size_t n = 0;
    for (size_t j = 0; j < f->count; ++j)
        if (finite_centre(f, j))
            sorted[n++] = column[j];
    qsort(sorted, n, sizeof *sorted, compare_values);
    const size_t cut = n ? (size_t)(o->grid_quantile * (double)(n - 1)) : 0;
    const double low = (double)sorted[n ? cut : 0], high = (double)sorted[n ? n - 1 - cut : 0];
    const double pad = fmax((high - low) * 1e-3, 1e-6);
    span[0] = low - pad;
    span[1] = high - low + 2.0 * pad;
    sgsi_free(sorted);
}

static uint32_t slow_axis(double x, const double span[2], int grid)
{
    return (uint32_t)fmin(fmax(floor((x - span[0]) / span[1] * grid), 0.0), grid - 1);
}

static double slow_gradient(const fixture *f, size_t i)
{
    return f->visible[i] ? (double)f->gradient[i] / f->visible[i] : 0.0;
}

static double slow_rank(const spare_region *regions, size_t count, size_t r, int visibility,
                        plant error)
{
    double less = 0.0, equal = 0.0;
    const double mine = visibility ? regions[r].visibility : regions[r].gradient;
    for (size_t j = 0; j < count; ++j) {
        const double other = visibility ? regions[j].visibility : regions[j].gradient;
        less += error == PLANT_RANK_DESCENDING ? other > mine : other < mine;
        equal += other == mine;
    }
    return (less + (error == PLANT_TIES_FIRST ? 1.0 : (equal + 1.0) / 2.0)) / (double)count;
}

// Median by counting: the mean of the smallest and the largest value with at most half of the
// values on either side.
static double slow_median(const spare_region *regions, size_t count, plant error)
{
    double low = INFINITY, high = -INFINITY, sum = 0.0, positive = 0.0;
    for (size_t r = 0; r < count; ++r) {
        positive += regions[r].area > 0.0;
        sum += regions[r].area;
    }
    for (size_t r = 0; r < count; ++r) {
        double below = 0.0, above = 0.0;
        for (size_t j = 0; j < count; ++j) {
            below += regions[j].area > 0.0 && regions[j].area < regions[r].area;
            above += regions[j].area > regions[r].area;
        }
        if (regions[r].area > 0.0 && below <= positive / 2.0 && above <= positive / 2.0) {
            low = fmin(low, regions[r].area);
            high = fmax(high, regions[r].area);
        }
    }
    if (positive == 0.0)
        return 0.0;
    return error == PLANT_MEAN_FOR_MEDIAN ? sum / positive : 0.5 * (low + high);
}

static double slow_sigmoid(double u)
{
    return 1.0 / (1.0 + exp(-u));
}

static double slow_phi(const spare_options *o, double slack, double share)
{
    if (o->phi == SPARE_PHI_PLAIN)
        return 0.5 + slow_sigmoid(o->slack_gain * slack);
    if (o->phi == SPARE_PHI_PRODUCT)
        return 2.0 * slow_sigmoid(o->slack_gain * slack * share);
    double gamma = o->weight_range;
    if (o->phi == SPARE_PHI_COUPLED)
        gamma *= slack >= 0.0 ? (1.0 + share) / 2.0 : 1.0 - share / 2.0;
    return 1.0 + gamma * (2.0 * slow_sigmoid(o->slack_gain * slack) - 1.0);
}

// Statistics (16) to (18) of one region, by a loop over all primitives.
static spare_region slow_region(const fixture *f, const uint32_t *voxel_of, uint32_t voxel,
                                plant error)
{
    spare_region region = {.voxel = voxel};
    for (size_t i = 0; i < f->count; ++i) {
        if (voxel_of[i] != voxel)
            continue;
        const double gradient = slow_gradient(f, i), radius = (double)f->radius[i];
        ++region.count;
        region.gradient += isfinite(gradient) ? gradient : 0.0;
        region.visibility += f->visible[i];
        region.area +=
            isfinite(radius) ? (error == PLANT_RADIUS_NOT_SQUARED ? radius : radius * radius) : 0.0;
    }
    region.gradient /= region.count;
    region.visibility /= region.count;
    region.area /= region.count;
    return region;
}

static void slow_allocation(const fixture *f, const spare_options *o, opinion *p, plant error)
{
    const double median = slow_median(p->regions, p->region_count, error);
    double sum = 0.0, most = 0.0;
    for (size_t r = 0; r < p->region_count; ++r) {
        spare_region *region = &p->regions[r];
        region->demand = o->use_h ? slow_rank(p->regions, p->region_count, r, 0, error) : 0.0;
        region->demand += o->use_v ? slow_rank(p->regions, p->region_count, r, 1, error) : 0.0;
        if (!o->use_h && !o->use_v)
            region->demand = 1.0;
        const bool known = o->use_c && median > 0.0 && region->area > 0.0;
        region->capacity = known ? region->area / median : 1.0;
        if (known && error != PLANT_NO_CLAMP)
            region->capacity = fmin(fmax(region->capacity, o->capacity_min), o->capacity_max);
        region->score = error == PLANT_MULTIPLY_CAPACITY ? region->demand * region->capacity
                                                         : region->demand / region->capacity;
        sum += region->score;
        most = fmax(most, region->score);
    }
    for (size_t r = 0; r < p->region_count; ++r) {
        spare_region *region = &p->regions[r];
        region->share = region->score / sum;
        region->quota = o->budget_scale * (double)finite_count(f) * region->share;
        region->slack = (region->quota - region->count) /
                        (region->quota + (error == PLANT_SLACK_WITHOUT_ONE ? 0 : 1));
        const double share =
            error == PLANT_SHARE_NOT_RELATIVE ? region->share : region->score / most;
        region->weight = slow_phi(o, region->slack, share);
    }
}

static opinion slow_opinion(const fixture *f, const spare_options *o, plant error)
{
    opinion p = {.regions = take(f->count, sizeof *p.regions),
                 .region_of = take(f->count, sizeof *p.region_of),
                 .redundant = take(f->count, 1)};
    uint32_t *voxel_of = take(f->count, sizeof *voxel_of);
    const uint32_t grid = (uint32_t)o->grid;
    double span[3][2];
    slow_span(f, f->x, o, span[0]);
    slow_span(f, f->y, o, span[1]);
    slow_span(f, f->z, o, span[2]);
    for (size_t i = 0; i < f->count; ++i)
        if (finite_centre(f, i)) {
            const uint32_t x = slow_axis((double)f->x[i], span[0], o->grid),
                           y = slow_axis((double)f->y[i], span[1], o->grid),
                           z = slow_axis((double)f->z[i], span[2], o->grid);
            voxel_of[i] = error == PLANT_SWAPPED_AXES ? x * grid * grid + y * grid + z
                                                      : z * grid * grid + y * grid + x;
        } else {
            voxel_of[i] = UINT32_MAX;
        }
    for (uint32_t voxel = 0; voxel < grid * grid * grid; ++voxel) {
        size_t first = 0;
        while (first < f->count && voxel_of[first] != voxel)
            ++first;
        if (first < f->count)
            p.regions[p.region_count++] = slow_region(f, voxel_of, voxel, error);
    }
    slow_allocation(f, o, &p, error);
    for (size_t i = 0; i < f->count; ++i) {
        if (voxel_of[i] == UINT32_MAX) {
            p.region_of[i] = SPARE_NO_REGION;
            continue;
        }
        while (p.regions[p.region_of[i]].voxel != voxel_of[i])
            ++p.region_of[i];
        const spare_region *region = &p.regions[p.region_of[i]];
        p.redundant[i] =
            region->count > region->quota && (double)f->opacity[i] < o->tau_alpha &&
            slow_gradient(f, i) < o->tau_gradient * (error == PLANT_FULL_TAU ? 1.0 : 0.5) &&
            !(o->rap_require_visible && !f->visible[i]);
    }
    sgsi_free(voxel_of);
    return p;
}

static void free_opinion(opinion *p)
{
    sgsi_free(p->regions);
    sgsi_free(p->region_of);
    sgsi_free(p->redundant);
}

static double difference(double a, double b)
{
    const double d = fabs(a - b) / fmax(1e-12, fmax(fabs(a), fabs(b)));
    return a == b ? 0.0 : isnan(d) ? INFINITY : d;
}

// Largest relative difference between spare_evaluate and the independent implementation; infinite
// if they disagree on a region, a membership or a redundant primitive.
static double disagreement(const fixture *f, const opinion *p)
{
    const spare_result *result = &f->result;
    if (result->region_count != p->region_count)
        return INFINITY;
    double worst = 0.0, weight = 0.0, over = 0.0;
    size_t redundant = 0;
    for (size_t r = 0; r < p->region_count; ++r) {
        const spare_region *a = &result->regions[r], *b = &p->regions[r];
        if (a->voxel != b->voxel || a->count != b->count)
            return INFINITY;
        const double pairs[][2] = {
            {a->gradient, b->gradient},
            {a->visibility, b->visibility},
            {a->area, b->area},
            {a->demand, b->demand},
            {a->capacity, b->capacity},
            {a->score, b->score},
            {a->share, b->share},
            {a->quota, b->quota},
            {1.0 + a->slack, 1.0 + b->slack},
            {a->weight, b->weight},
        };
        for (size_t k = 0; k < sizeof pairs / sizeof *pairs; ++k)
            worst = fmax(worst, difference(pairs[k][0], pairs[k][1]));
        weight += b->weight * b->count;
        over += b->count > b->quota ? b->count : 0.0;
    }
    for (size_t i = 0; i < f->count; ++i) {
        if (result->region_of[i] != p->region_of[i] || f->redundant[i] != p->redundant[i])
            return INFINITY;
        if (f->weights[i] != (p->region_of[i] == SPARE_NO_REGION
                                  ? 1.0f
                                  : (float)result->regions[p->region_of[i]].weight))
            return INFINITY;
        redundant += p->redundant[i];
    }
    if (redundant != result->redundant_count)
        return INFINITY;
    const double total = (double)finite_count(f);
    if (total > 0.0) {
        worst = fmax(worst, difference(result->mean_weight, weight / total));
        worst = fmax(worst, difference(result->over_budget_share, over / total));
    }
    return worst;
}

// -------------------------------------------------------------------------------------------------
// Inputs.

typedef enum layout {
    LAYOUT_RANDOM,
    LAYOUT_CLUSTERED,
    LAYOUT_ONE_VOXEL,
    LAYOUT_ONE_EACH,
    LAYOUT_TIES,
    LAYOUT_NOT_FINITE,
    LAYOUT_UNSEEN,
    LAYOUT_NO_RADIUS,
    LAYOUT_HUGE,
    LAYOUT_COUNT
} layout;

static void place(fixture *f, size_t i, layout kind, uint64_t seed)
{
    const uint64_t at = 16 * i;
    float *const centre[3] = {&f->x[i], &f->y[i], &f->z[i]};
    for (uint64_t axis = 0; axis < 3; ++axis) {
        const double u = sgsi_random_uniform(seed, at + axis);
        *centre[axis] = (float)(4.0 * u - 1.0);
        if (kind == LAYOUT_CLUSTERED)
            *centre[axis] =
                (float)(sgsi_random_normal(seed, at + axis) * pow(10.0, (double)(i % 4) - 2.0));
        if (kind == LAYOUT_ONE_VOXEL)
            *centre[axis] = 3.25f;
        if (kind == LAYOUT_HUGE)
            *centre[axis] = (float)((u - 0.5) * 6e38);
    }
    if (kind == LAYOUT_ONE_EACH) {
        f->x[i] = (float)(i % 8);
        f->y[i] = (float)(i / 8 % 8);
        f->z[i] = (float)(i / 64);
    }
    if (kind == LAYOUT_NOT_FINITE && i % 5 == 0)
        *centre[i / 5 % 3] = i % 2 ? NAN : i % 3 ? INFINITY : -INFINITY;
}

static fixture make_layout(size_t count, layout kind, uint64_t seed)
{
    fixture f = make_fixture(count);
    for (size_t i = 0; i < count; ++i) {
        const uint64_t at = 16 * i;
        place(&f, i, kind, seed);
        f.opacity[i] = (float)pow(sgsi_random_uniform(seed, at + 4), 3.0);
        f.visible[i] = (uint32_t)(sgsi_random_bits(seed, at + 5) % 12);
        f.gradient[i] = (float)(4e-4 * f.visible[i] * pow(sgsi_random_uniform(seed, at + 6), 2.0));
        f.radius[i] = f.visible[i] ? (float)exp(1.5 * sgsi_random_normal(seed, at + 7)) : 0.0f;
        if (kind == LAYOUT_TIES) {
            f.visible[i] = 2;
            f.gradient[i] = 2e-4f;
            f.radius[i] = 3.0f;
        }
        if (kind == LAYOUT_UNSEEN)
            f.visible[i] = 0;
        if (kind == LAYOUT_NO_RADIUS)
            f.radius[i] = 0.0f;
        if (kind == LAYOUT_NOT_FINITE && i % 7 == 0)
            f.gradient[i] = NAN;
        if (kind == LAYOUT_NOT_FINITE && i % 11 == 0)
            f.radius[i] = INFINITY;
    }
    return f;
}

// Options for regions that are large enough to hold several primitives of a small test.
static spare_options small_grid(void)
{
    spare_options options = spare_options_default();
    options.grid = 8;
    return options;
}

// tau_alpha, the grid and the terms as in the paper; budget and slope as OPEN-2 and OPEN-3 choose.
static void defaults_are_those_of_the_paper(void **state)
{
    (void)state;
    const spare_options o = spare_options_default();
    assert_int_equal(o.grid, 32);
    assert_true(o.tau_alpha == 0.05 && o.tau_gradient == 2e-4);
    assert_true(o.budget_scale == 1.0 && o.slack_gain == 2.0);
    assert_true(o.use_h && o.use_v && o.use_c && !o.rap_require_visible);
}

// -------------------------------------------------------------------------------------------------
// Computed by hand: one primitive at x = 0, two at x = 1, three at x = 2.

static fixture make_three_regions(void)
{
    fixture f = make_fixture(6);
    const float x[] = {2, 1, 0, 2, 1, 2};
    const float gradient[] = {3e-4f, 1e-4f, 4e-4f, 3e-4f, 0, 0};
    const uint32_t visible[] = {3, 1, 2, 3, 0, 3};
    const float radius[] = {1, 2, 4, 1, 2, 0};
    const float opacity[] = {0.01f, 0.04f, 0.04f, 0.01f, 0.01f, 0.01f};
    memcpy(f.x, x, sizeof x);
    memcpy(f.gradient, gradient, sizeof gradient);
    memcpy(f.visible, visible, sizeof visible);
    memcpy(f.radius, radius, sizeof radius);
    memcpy(f.opacity, opacity, sizeof opacity);
    return f;
}

static void three_regions_match_hand_computation(void **state)
{
    (void)state;
    fixture f = make_three_regions();
    spare_options options = spare_options_default();
    options.tau_gradient = 2.0 * (double)1e-4f; // primitive 1 is exactly at the threshold
    evaluate(&f, &options);
    const double third = 1.0 / 3.0;
    const struct {
        double x, count, gradient, visibility, area, demand, capacity, score, quota, slack, share;
    } expected[] = {
        {0, 1, 2e-4, 2, 16, 5 * third, 4, 5.0 / 12, 30.0 / 93, -63.0 / 123, 5.0 / 93},
        {16, 2, 0.5e-4, 0.5, 4, 2 * third, 1, 2.0 / 3, 48.0 / 93, -138.0 / 141, 8.0 / 93},
        {31, 3, 2e-4 / 3, 3, 2 * third, 5 * third, 0.25, 20.0 / 3, 480.0 / 93, 201.0 / 573,
         80.0 / 93},
    };
    assert_int_equal(f.result.region_count, 3);
    for (size_t r = 0; r < 3; ++r) {
        const spare_region *region = &f.result.regions[r];
        assert_int_equal(region->voxel % 32, (int)expected[r].x);
        assert_true(region->count == expected[r].count);
        assert_true(difference(region->gradient, expected[r].gradient) <
                    1e-6); // the input is float
        assert_true(difference(region->visibility, expected[r].visibility) < 1e-14);
        assert_true(difference(region->area, expected[r].area) < 1e-14);
        assert_true(difference(region->demand, expected[r].demand) < 1e-14);
        assert_true(difference(region->capacity, expected[r].capacity) < 1e-14);
        assert_true(difference(region->score, expected[r].score) < 1e-14);
        assert_true(difference(region->share, expected[r].share) < 1e-14);
        assert_true(difference(region->quota, expected[r].quota) < 1e-14);
        assert_true(difference(region->slack, expected[r].slack) < 1e-13);
        const double share = expected[r].share / expected[2].share;
        const double gamma =
            options.weight_range * (expected[r].slack > 0 ? (1 + share) / 2 : 1 - share / 2);
        const double weight = 1 + gamma * (2 / (1 + exp(-2 * expected[r].slack)) - 1);
        assert_true(difference(region->weight, weight) < 1e-14);
    }
    const uint32_t region_of[] = {2, 1, 0, 2, 1, 2};
    const uint8_t redundant[] = {0, 0, 0, 0, 1, 0};
    assert_memory_equal(f.result.region_of, region_of, sizeof region_of);
    assert_memory_equal(f.redundant, redundant, sizeof redundant);
    assert_true(difference(f.result.over_budget_share, 0.5) < 1e-14);
    options.rap_require_visible = true;
    evaluate(&f, &options);
    assert_int_equal(f.result.redundant_count, 0);
    free_fixture(&f);
}

static void ties_share_the_mean_rank(void **state)
{
    (void)state;
    // Five regions with H = 0, 0, 0, 1, 1 (in units of 1e-4): ranks 2, 2, 2, 4.5, 4.5 of 5.
    fixture f = make_fixture(5);
    for (size_t i = 0; i < 5; ++i) {
        f.x[i] = (float)i;
        f.visible[i] = 1;
        f.gradient[i] = i < 3 ? 0.0f : 1e-4f;
    }
    spare_options options = spare_options_default();
    options.use_v = false;
    evaluate(&f, &options);
    assert_int_equal(f.result.region_count, 5);
    for (size_t r = 0; r < 5; ++r) {
        assert_true(difference(f.result.regions[r].demand, r < 3 ? 0.4 : 0.9) < 1e-14);
        assert_true(f.result.regions[r].capacity == 1.0); // all radii are 0
    }
    free_fixture(&f);
}

static void median_of_an_even_number_is_the_middle_mean(void **state)
{
    (void)state;
    // Areas 0, 1, 4, 9, 16: the median 6.5 leaves out the zero.
    fixture f = make_fixture(5);
    for (size_t i = 0; i < 5; ++i) {
        f.x[i] = (float)i;
        f.radius[i] = (float)i;
    }
    const spare_options options = spare_options_default();
    evaluate(&f, &options);
    const double capacity[] = {1, 0.25, 4 / 6.5, 9 / 6.5, 16 / 6.5};
    for (size_t r = 0; r < 5; ++r)
        assert_true(difference(f.result.regions[r].capacity, capacity[r]) < 1e-14);
    free_fixture(&f);
}

static void redundancy_tests_use_strict_inequalities(void **state)
{
    (void)state;
    // One region: the quota equals the count, so nothing is over quota or redundant.
    fixture f = make_fixture(4);
    spare_options options = spare_options_default();
    evaluate(&f, &options);
    assert_int_equal(f.result.region_count, 1);
    assert_true(f.result.regions[0].quota == 4.0 && f.weights[0] == 1.0f);
    assert_int_equal(f.result.redundant_count, 0);
    // Half the budget: over quota; the opacity test is strict.
    options.budget_scale = 0.5;
    options.tau_alpha = 0.0625;
    f.opacity[1] = 0.0625f;
    f.opacity[2] = nextafterf(0.0625f, 0.0f);
    f.opacity[3] = NAN;
    evaluate(&f, &options);
    const uint8_t expected[] = {1, 0, 1, 0};
    assert_memory_equal(f.redundant, expected, sizeof expected);
    free_fixture(&f);
}

// -------------------------------------------------------------------------------------------------

static void every_layout_matches_the_slow_reading(void **state)
{
    (void)state;
    const size_t counts[] = {0, 1, 2, 3, 60, 512, 1500};
    for (int kind = 0; kind < LAYOUT_COUNT; ++kind)
        for (size_t k = 0; k < sizeof counts / sizeof *counts; ++k) {
            fixture f = make_layout(counts[k], (layout)kind, 100 + (uint64_t)kind);
            for (int phi = SPARE_PHI_COUPLED; phi <= SPARE_PHI_PLAIN; ++phi) {
                spare_options options = small_grid();
                options.phi = (spare_phi)phi;
                options.rap_require_visible = phi == SPARE_PHI_PLAIN;
                options.grid_quantile = phi % 2 ? 0.1 : 0.0;
                evaluate(&f, &options);
                opinion p = slow_opinion(&f, &options, PLANT_NONE);
                assert_true(disagreement(&f, &p) <= 1e-10);
                free_opinion(&p);
            }
            free_fixture(&f);
        }
}

static void ablations_match_the_slow_reading(void **state)
{
    (void)state;
    fixture f = make_layout(900, LAYOUT_CLUSTERED, 5);
    for (int bits = 0; bits < 8; ++bits) {
        spare_options options = small_grid();
        options.use_h = bits & 1;
        options.use_v = bits & 2;
        options.use_c = bits & 4;
        options.budget_scale = 0.8;
        evaluate(&f, &options);
        opinion p = slow_opinion(&f, &options, PLANT_NONE);
        assert_true(disagreement(&f, &p) <= 1e-10);
        if (!bits)
            for (size_t r = 0; r < f.result.region_count; ++r)
                assert_true(difference(f.result.regions[r].share * (double)f.result.region_count,
                                       1.0) < 1e-12);
        free_opinion(&p);
    }
    free_fixture(&f);
}

static void comparison_catches_planted_errors(void **state)
{
    (void)state;
    fixture f = make_layout(1200, LAYOUT_RANDOM, 6);
    const spare_options options = small_grid();
    evaluate(&f, &options);
    for (int error = PLANT_NONE; error < PLANT_COUNT; ++error) {
        opinion p = slow_opinion(&f, &options, (plant)error);
        const double d = disagreement(&f, &p);
        if (error == PLANT_TIES_FIRST) { // needs ties, which random input does not have
            fixture tied = make_layout(300, LAYOUT_TIES, 6);
            opinion q = slow_opinion(&tied, &options, PLANT_TIES_FIRST);
            evaluate(&tied, &options);
            assert_true(disagreement(&tied, &q) > 1e-3);
            free_opinion(&q);
            free_fixture(&tied);
        } else {
            assert_true(error == PLANT_NONE ? d <= 1e-10 : d > 1e-3);
        }
        free_opinion(&p);
    }
    free_fixture(&f);
}

static void quotas_sum_to_the_budget_and_weights_follow_slack(void **state)
{
    (void)state;
    for (int kind = 0; kind < LAYOUT_COUNT; ++kind) {
        fixture f = make_layout(2000, (layout)kind, 40);
        spare_options options = spare_options_default();
        options.budget_scale = kind % 2 ? 1.0 : 1.25;
        evaluate(&f, &options);
        double quota = 0.0, members = 0.0;
        for (size_t r = 0; r < f.result.region_count; ++r) {
            const spare_region *region = &f.result.regions[r];
            quota += region->quota;
            members += region->count;
            assert_true(region->demand > 0.0 && region->demand <= 2.0);
            assert_true(fabs(region->weight - 1.0) < options.weight_range && region->slack < 1.0);
            assert_int_equal(region->weight > 1.0, region->slack > 0.0);
            assert_true(r == 0 || region[-1].voxel < region->voxel);
        }
        assert_int_equal(members, finite_count(&f));
        assert_true(members == 2000.0 || kind == LAYOUT_NOT_FINITE);
        assert_true(difference(quota, options.budget_scale * members) < 1e-12);
        free_fixture(&f);
    }
}

// Weight of the first of two regions as its slack grows, at equal demand. The caller sets the
// counts.
static void weight_grows_with_slack(void **state)
{
    (void)state;
    for (int phi = SPARE_PHI_COUPLED; phi <= SPARE_PHI_PLAIN; ++phi) {
        double last_slack = 1.0, last_weight = 2.0;
        for (size_t own = 1; own < 40; ++own) {
            fixture f = make_fixture(40);
            for (size_t i = own; i < 40; ++i)
                f.x[i] = 1.0f;
            spare_options options = spare_options_default();
            options.phi = (spare_phi)phi;
            evaluate(&f, &options);
            const spare_region *region = &f.result.regions[0];
            assert_true(region->quota == 20.0 && region->slack < last_slack &&
                        region->weight < last_weight);
            assert_int_equal(region->weight > 1.0, own < 20);
            last_slack = region->slack;
            last_weight = region->weight;
            free_fixture(&f);
        }
    }
}

static void weight_grows_with_share_at_equal_slack(void **state)
{
    (void)state;
    // Three regions with shares 1/6, 2/6, 3/6 by rank of visibility and counts proportional to the
    // shares: every slack is 0. With kappa != 1 all slacks have one sign and nearly one size; the
    // weight must not decrease with the share.
    for (int more = 0; more < 2; ++more) {
        fixture f = make_fixture(6000);
        for (size_t i = 0; i < 6000; ++i) {
            f.x[i] = i < 1000 ? 0.0f : i < 3000 ? 1.0f : 2.0f;
            f.visible[i] = i < 1000 ? 1 : i < 3000 ? 2 : 3;
        }
        spare_options options = spare_options_default();
        options.use_h = false;
        options.budget_scale = more ? 1.5 : 0.5;
        evaluate(&f, &options);
        assert_int_equal(f.result.region_count, 3);
        assert_true(f.result.regions[0].weight < f.result.regions[1].weight);
        assert_true(f.result.regions[1].weight < f.result.regions[2].weight);
        assert_int_equal(f.result.regions[0].weight > 1.0, more);
        free_fixture(&f);
    }
}

static void redundancy_grows_with_tau_alpha(void **state)
{
    (void)state;
    fixture f = make_layout(4000, LAYOUT_CLUSTERED, 8);
    uint8_t *before = take(4000, 1);
    size_t last = 0;
    for (int step = 0; step <= 20; ++step) {
        spare_options options = spare_options_default();
        options.tau_alpha = 0.05 * step;
        evaluate(&f, &options);
        assert_true(step ? f.result.redundant_count > last : f.result.redundant_count == 0);
        for (size_t i = 0; i < f.count; ++i)
            assert_true(f.redundant[i] >= before[i]);
        last = f.result.redundant_count;
        memcpy(before, f.redundant, f.count);
    }
    sgsi_free(before);
    free_fixture(&f);
}

static void order_of_primitives_does_not_matter(void **state)
{
    (void)state;
    fixture f = make_layout(1500, LAYOUT_RANDOM, 9), g = make_fixture(1500);
    const spare_options options = small_grid();
    for (size_t i = 0; i < f.count; ++i) {
        const size_t j = (i * 7 + 3) % f.count;
        g.x[j] = f.x[i], g.y[j] = f.y[i], g.z[j] = f.z[i];
        g.opacity[j] = f.opacity[i], g.gradient[j] = f.gradient[i];
        g.visible[j] = f.visible[i], g.radius[j] = f.radius[i];
    }
    evaluate(&f, &options);
    evaluate(&g, &options);
    for (size_t i = 0; i < f.count; ++i) {
        const size_t j = (i * 7 + 3) % f.count;
        assert_int_equal(f.redundant[i], g.redundant[j]);
        assert_true(fabsf(f.weights[i] - g.weights[j]) < 1e-6f);
    }
    free_fixture(&f);
    free_fixture(&g);
}

static void no_primitives_is_not_an_error(void **state)
{
    (void)state;
    const spare_options options = spare_options_default();
    fixture f = make_fixture(0);
    evaluate(&f, &options);
    assert_int_equal(f.result.region_count, 0);
    assert_int_equal(f.result.redundant_count, 0);
    assert_true(f.result.mean_weight == 1.0 && f.result.over_budget_share == 0.0);
    free_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(defaults_are_those_of_the_paper),
        cmocka_unit_test(three_regions_match_hand_computation),
        cmocka_unit_test(ties_share_the_mean_rank),
        cmocka_unit_test(median_of_an_even_number_is_the_middle_mean),
        cmocka_unit_test(redundancy_tests_use_strict_inequalities),
        cmocka_unit_test(every_layout_matches_the_slow_reading),
        cmocka_unit_test(ablations_match_the_slow_reading),
        cmocka_unit_test(comparison_catches_planted_errors),
        cmocka_unit_test(quotas_sum_to_the_budget_and_weights_follow_slack),
        cmocka_unit_test(weight_grows_with_slack),
        cmocka_unit_test(weight_grows_with_share_at_equal_slack),
        cmocka_unit_test(redundancy_grows_with_tau_alpha),
        cmocka_unit_test(order_of_primitives_does_not_matter),
        cmocka_unit_test(no_primitives_is_not_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
