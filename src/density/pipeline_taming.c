// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Taming 3DGS (Mallick et al. 2024; score-based densification to a budget): the number of
// primitives follows a parabola to a budget; the primitives to clone or split are drawn by an
// importance, summed over ten views.
//
// Count, from S initial to B final primitives in n updates: c(x) = B - (B - S) (1 - x / n)^2.
// Update j may grow to min(c(j + 1), N + qualifiers), divided between clones and splits in
// proportion to their qualifiers (mean gradient >= tau).
//
// Importance: with N(c, v) = c v / median of the positive v, per view of loss P,
//     50 P (N(25, gradient) + N(100, opacity) + N(5, depth) + N(10, radius) + N(25, volume)
//           + N(50, distance) + N(10, loss) + N(0.1, hits) + N(50, blend))
// for primitives in view. The last four are sums over pixels; loss is 50 x error + 50 x edges, both
// scaled to [0, 1].
//
// Pruning: half of the primitives that 3DGS would remove, drawn by 1 / (importance + 1e-6), in the
// first 27 updates only. In the released code the importances are shifted by the rows of removed
// parents; here each row has its own. SPARE-GS: w multiplies the importance and the gradient of the
// qualifiers, because the budget compensates for a weight on the importance only
// (sgs_spare_target selects one of them).

#include "density/pipeline.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "density/plane_range.h"

enum { PRUNED_UPDATES = 27 };

// c(x), truncated as in the released code.
static double scheduled_count(double start, double final, int updates, int x)
{
    if (x >= updates)
        return final;
    const double n = updates, k = 2.0 * (final - start) / n, a = (final - start - k * n) / (n * n);
    return floor(a * x * x + k * x + start);
}

static double final_count(const sgsi_density_options *options)
{
    const sgs_pipeline_options *own = &options->train->pipeline_options;
    return own->taming_count
               ? (double)own->taming_count
               : floor((double)options->state->initial_count * own->taming_multiplier);
}

typedef struct draw {
    double *weight;
    uint8_t *eligible, *chosen;
} draw;

static sgs_status draw_kind(const sgsi_density_options *options, sgsi_density_columns *c, draw *d,
                            sgsi_action kind, size_t budget, uint8_t *action)
{
    for (size_t i = 0; i < c->count; ++i)
        d->eligible[i] = action[i] == kind;
    const uint64_t seed =
        sgsi_random_bits(options->seed ^ (kind == SGSI_ACTION_CLONE ? 0xC10E : 0x5917),
                         (uint64_t)options->iteration);
    const sgs_status status =
        sgsi_select_weighted(d->weight, d->eligible, c->count, budget, seed, d->chosen);
    for (size_t i = 0; i < c->count && !status; ++i)
        if (d->chosen[i])
            c->action[i] = (uint8_t)kind;
    return status;
}

// Rows that qualify (as an action per row), and their number per action.
static void find_qualifiers(const sgsi_density_options *options, const sgsi_density_columns *c,
                            uint8_t *action, size_t number[3], sgsi_density_result *result)
{
    const float threshold = (float)options->gradient_threshold;
    const bool weighs = options->train->spare_target != SGS_TARGET_IMPORTANCE;
    for (size_t i = 0; i < c->count; ++i) {
        const bool qualifies = c->score[i] * (weighs ? c->weight[i] : 1.0f) >= threshold;
        sgsi_density_count_reversal(c->score[i] >= threshold, qualifies, result);
        action[i] = sgsi_density_growth(qualifies, c->scale_max[i], (float)options->size_split);
        ++number[action[i]];
    }
}

static sgs_status grow(const sgsi_density_options *options, sgsi_density_columns *c, draw *d,
                       uint8_t *action, sgsi_density_result *result)
{
    size_t number[3] = {0};
    find_qualifiers(options, c, action, number, result);
    const size_t qualifiers = number[SGSI_ACTION_CLONE] + number[SGSI_ACTION_SPLIT];
    const double now = (double)c->count;
    const double scheduled =
        scheduled_count((double)options->state->initial_count, final_count(options),
                        options->update_count, options->update + 1);
    const double room = fmax(fmin(scheduled, now + (double)qualifiers) - now, 0.0);
    if (!qualifiers)
        return SGS_STATUS_OK;
    const double share = room / (double)qualifiers;
    sgs_status status = SGS_STATUS_OK;
    for (sgsi_action kind = SGSI_ACTION_CLONE; kind <= SGSI_ACTION_SPLIT && !status; ++kind)
        status =
            draw_kind(options, c, d, kind, (size_t)floor(share * (double)number[kind]), action);
    return status;
}

static sgs_status decide(const sgsi_density_options *options, sgsi_density_columns *c,
                         sgsi_density_result *result)
{
    const size_t n = c->count ? c->count : 1;
    draw d = {sgsi_alloc(n, sizeof(double)), sgsi_alloc(n, 1), sgsi_alloc(n, 1)};
    uint8_t *action = sgsi_alloc(n, 1);
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    if (d.weight && d.eligible && d.chosen && action) {
        const bool weighs = options->train->spare_target != SGS_TARGET_GRADIENT;
        for (size_t i = 0; i < c->count; ++i) {
            c->priority[i] = options->importance[i] * (weighs ? c->weight[i] : 1.0f);
            d.weight[i] = (double)c->priority[i];
        }
        status = grow(options, c, &d, action, result);
        for (size_t i = 0; i < c->count; ++i)
            d.weight[i] = 1.0 / (1e-6 + (double)options->importance[i]);
        if (!status && options->update < PRUNED_UPDATES)
            status = sgsi_prune_stochastic(options, c, d.weight);
    }
    sgsi_free(d.weight);
    sgsi_free(d.eligible);
    sgsi_free(d.chosen);
    sgsi_free(action);
    return status == SGS_STATUS_OUT_OF_MEMORY
               ? sgsi_fail(status, "not enough memory to draw from %zu primitives", c->count)
               : status;
}

// ---- Importance ----

// As Pillow converts to mode L in the released code.
static int grey(const sgsi_scored_image *image, int x, int y)
{
    const size_t plane = (size_t)image->width * (size_t)image->height,
                 at = (size_t)y * (size_t)image->width + (size_t)x;
    return (19595 * image->pixels[at] + 38470 * image->pixels[plane + at] +
            7471 * image->pixels[2 * plane + at] + 0x8000) >>
           16;
}

// 3x3 edge filter (8 in the centre, -1 around it) of the grey image, clamped to a byte; border
// pixels are the grey itself.
static int edge(const sgsi_scored_image *image, int x, int y)
{
    const int middle = grey(image, x, y);
    if (x == 0 || y == 0 || x == image->width - 1 || y == image->height - 1)
        return middle;
    int sum = 9 * middle;
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
            sum -= grey(image, x + dx, y + dy);
    return sum < 0 ? 0 : sum > 255 ? 255 : sum;
}

typedef struct weight_job {
    const sgsi_scored_image *image;
    float *weights;
    sgsi_plane_range edges;
    float edge_scale, error_scale;
} weight_job;

static void fill_edges(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const weight_job *job = context;
    for (size_t y = begin; y < end; ++y)
        for (int x = 0; x < job->image->width; ++x)
            job->weights[y * job->image->stride + (size_t)x] = (float)edge(job->image, x, (int)y);
}

static void add_errors(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const weight_job *job = context;
    const sgsi_scored_image *image = job->image;
    for (size_t y = begin; y < end; ++y)
        for (size_t x = 0; x < (size_t)image->width; ++x) {
            const size_t at = y * image->stride + x;
            job->weights[at] = (job->weights[at] - job->edges.least) * job->edge_scale +
                               (image->error[at] - image->error_min) * job->error_scale;
        }
}

static sgs_status pixel_weights(const sgsi_scored_image *image, const sgs_train_options *train,
                                float *weights)
{
    (void)train;
    const size_t rows = (size_t)image->height;
    weight_job job = {.image = image, .weights = weights};
    sgsi_parallel_ranges(rows, 8, fill_edges, &job);
    job.edges = sgsi_plane_range_find(weights, image->width, image->height, image->stride);
    const float edge_range = job.edges.most - job.edges.least,
                error_range = image->error_max - image->error_min;
    job.edge_scale = edge_range > 0.0f ? 50.0f / edge_range : 0.0f;
    job.error_scale = error_range > 0.0f ? 50.0f / error_range : 0.0f;
    sgsi_parallel_ranges(rows, 8, add_errors, &job);
    return SGS_STATUS_OK;
}

float sgsi_positive_median(const float *values, size_t stride, const uint8_t *present, size_t count)
{
    // Positive floats are ordered like their bits: three passes over 11, 11 and 10 bits find the
    // element.
    enum { PASSES = 3, BINS = 1 << 11 };
    static const int shifts[PASSES] = {21, 10, 0}, widths[PASSES] = {11, 11, 10};
    uint32_t high = 0;
    size_t total = 0, rank = 0;
    for (int pass = 0; pass < PASSES; ++pass) {
        uint32_t bins[BINS] = {0};
        for (size_t i = 0; i < count; ++i) {
            if ((present && !present[i / SGS_LANES]) || !(values[i * stride] > 0.0f))
                continue;
            uint32_t bits;
            memcpy(&bits, &values[i * stride], sizeof bits);
            if (!pass || bits >> shifts[pass - 1] == high)
                ++bins[bits >> shifts[pass] & ((1U << widths[pass]) - 1)];
            total += !pass;
        }
        if (!total)
            return 0.0f;
        if (!pass)
            rank = (total - 1) / 2; // the lower of two middle ones
        uint32_t bin = 0;
        while (rank >= bins[bin])
            rank -= bins[bin++];
        high = high << widths[pass] | bin;
    }
    float median;
    memcpy(&median, &high, sizeof median);
    return median;
}

// A property of the primitives, weighted in units of its median.
typedef struct property {
    const float *values;
    size_t stride;
    const uint8_t *present; // as of sgsi_positive_median
    double weight;
    float median;
} property;

enum { OWN = 5, PROPERTIES = 9 }; // from OWN on: sums over pixels

typedef struct importance_job {
    const sgsi_scored_view *view;
    property properties[PROPERTIES];
    float *importance;
} importance_job;

static void find_median(void *context, size_t k, int thread)
{
    (void)thread;
    importance_job *job = context;
    property *p = &job->properties[k];
    p->median = sgsi_positive_median(p->values, p->stride, p->present, job->view->count);
}

static double normalised(const property *p, size_t i)
{
    const float value = p->values[p->stride * i];
    return value > 0.0f && p->median > 0.0f ? p->weight * (double)value / (double)p->median : 0.0;
}

static void add_importance(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const importance_job *job = context;
    const sgsi_scored_view *view = job->view;
    for (size_t i = begin; i < end; ++i) {
        if (!(view->radius[i] > 0.0f))
            continue;
        const int count = view->touched[i / SGS_LANES] ? PROPERTIES : OWN;
        double score = 0.0;
        for (int k = 0; k < count; ++k)
            score += normalised(&job->properties[k], i);
        job->importance[i] += (float)(50.0 * view->loss * score);
    }
}

static property sum_property(const sgsi_scored_view *view, int slot, double weight)
{
    return (property){view->sums + slot, 16, view->touched, weight, 0.0f};
}

static void score_view(const sgsi_scored_view *view, float *importance, float *prune_score)
{
    (void)prune_score;
    importance_job job = {.view = view,
                          .importance = importance,
                          .properties = {{view->gradient, 1, NULL, 25, 0.0f},
                                         {view->opacity, 1, NULL, 100, 0.0f},
                                         {view->depth, 1, NULL, 5, 0.0f},
                                         {view->radius, 1, NULL, 10, 0.0f},
                                         {view->volume, 1, NULL, 25, 0.0f},
                                         sum_property(view, SGSI_SCORE_WEIGHT, 10),
                                         sum_property(view, SGSI_SCORE_HITS, 0.1),
                                         sum_property(view, SGSI_SCORE_BLEND, 50),
                                         sum_property(view, SGSI_SCORE_DISTANCE, 50)}};
    sgsi_parallel_for(PROPERTIES, 1, find_median, &job);
    sgsi_parallel_ranges(view->count, 4096, add_importance, &job);
}

static sgsi_late_opacity late_opacity(const sgs_train_options *train)
{
    if (train->schedule == SGS_SCHEDULE_FINETUNE) // no densification that ends
        return SGSI_LATE_OPACITY_TRAINED;
    switch (train->pipeline_options.taming_opacity) {
    case SGS_TAMING_FROZEN:
        return SGSI_LATE_OPACITY_FROZEN;
    case SGS_TAMING_LINEAR:
        return SGSI_LATE_OPACITY_LINEAR;
    default:
        return SGSI_LATE_OPACITY_TRAINED;
    }
}

const sgsi_pipeline sgsi_pipeline_taming = {.name = "taming",
                                            .densify_until = 15000,
                                            .densify_interval = 100,
                                            .lr_opacity = 0.025f,
                                            .lr_rest = 2.5e-4f,
                                            .decide = decide,
                                            .late_opacity = late_opacity,
                                            .prunes_large = true,
                                            .score_views = 10,
                                            .pixel_weights = pixel_weights,
                                            .score_view = score_view};
