// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Density control independent of the base pipeline, with the hooks of SPARE-GS.
//
// An update first makes all decisions from the old rows: this file computes scores, weights and
// redundancy, the pipeline decides on clone, split and prune (pipeline.h). Then it writes a plan
// with one entry per row of the new model (kept, clone or split child of an old row), sorts it
// along a Morton curve so that primitives near in space are near in memory, and gathers parameters
// and moments in this order. Differences from 3DGS: the order of rows, and the random numbers of
// the children, which depend on (seed, iteration, old row) and not on threads.

#include "density/density.h"

#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "model/opacity.h"
#include "base/core.h"
#include "base/morton.h"
#include "model/filter_3d.h"
#include "density/pipeline.h"
#include "density/row_limits.h"
#include "density/row_plan.h"
#include "base/threads.h"
#include "spare/spare.h"

sgs_status sgsi_statistics_reserve(sgsi_statistics *statistics, size_t capacity)
{
    if (capacity <= statistics->capacity)
        return SGS_STATUS_OK;
    sgsi_statistics_free(statistics);
    statistics->gradient_sum = sgsi_calloc_shared(capacity, sizeof *statistics->gradient_sum);
    statistics->abs_grad_sum = sgsi_calloc_shared(capacity, sizeof *statistics->abs_grad_sum);
    statistics->visible_count = sgsi_calloc_shared(capacity, sizeof *statistics->visible_count);
    statistics->radius_max = sgsi_calloc_shared(capacity, sizeof *statistics->radius_max);
    statistics->capacity = capacity;
    if (statistics->gradient_sum && statistics->abs_grad_sum && statistics->visible_count &&
        statistics->radius_max)
        return SGS_STATUS_OK;
    sgsi_statistics_free(statistics);
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for the statistics of %zu primitives", capacity);
}

void sgsi_statistics_clear(sgsi_statistics *statistics, size_t count)
{
    memset(statistics->gradient_sum, 0, count * sizeof *statistics->gradient_sum);
    memset(statistics->abs_grad_sum, 0, count * sizeof *statistics->abs_grad_sum);
    memset(statistics->visible_count, 0, count * sizeof *statistics->visible_count);
    memset(statistics->radius_max, 0, count * sizeof *statistics->radius_max);
}

void sgsi_statistics_resize_images(sgsi_statistics *statistics, size_t count, float factor)
{
    for (size_t i = 0; i < count; ++i)
        statistics->radius_max[i] *= factor;
}

void sgsi_statistics_free(sgsi_statistics *statistics)
{
    sgsi_free(statistics->gradient_sum);
    sgsi_free(statistics->abs_grad_sum);
    sgsi_free(statistics->visible_count);
    sgsi_free(statistics->radius_max);
    *statistics = (sgsi_statistics){0};
}

static void free_moves(const sgsi_row_moves *moves)
{
    void *const arrays[] = {moves->root, moves->copies, moves->opacity, moves->log_scale,
                            moves->forget};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
}

static void free_columns(sgsi_density_columns *columns)
{
    void *const arrays[] = {columns->x,
                            columns->y,
                            columns->z,
                            columns->opacity,
                            columns->scale_max,
                            columns->score,
                            columns->abs_grad,
                            columns->weight,
                            columns->redundant,
                            columns->action,
                            columns->removed,
                            columns->degenerate,
                            columns->prune_children,
                            columns->priority,
                            columns->workspace};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    free_moves(&columns->moves);
}

// Moves of rows that all stay.
static bool make_moves(sgsi_row_moves *moves, size_t count)
{
    *moves = (sgsi_row_moves){.root = sgsi_alloc(count, sizeof *moves->root),
                              .copies = sgsi_calloc(count, sizeof *moves->copies),
                              .opacity = sgsi_calloc(count, sizeof *moves->opacity),
                              .log_scale = sgsi_calloc(count, sizeof *moves->log_scale),
                              .forget = sgsi_calloc(count, 1)};
    for (size_t i = 0; i < count && moves->root; ++i)
        moves->root[i] = (uint32_t)i;
    return moves->root && moves->copies && moves->opacity && moves->log_scale && moves->forget;
}

static sgs_status make_columns(size_t count, const sgsi_density_options *options, bool relocates,
                               sgsi_density_columns *columns)
{
    const size_t n = count ? count : 1;
    *columns = (sgsi_density_columns){.count = count};
    float **const floats[] = {&columns->x,        &columns->y,         &columns->z,
                              &columns->opacity,  &columns->scale_max, &columns->score,
                              &columns->abs_grad, &columns->weight,    &columns->priority};
    bool complete = true;
    for (size_t i = 0; i < sizeof floats / sizeof *floats; ++i)
        complete = (*floats[i] = sgsi_alloc(n, sizeof(float))) && complete;
    uint8_t **const marks[] = {&columns->redundant, &columns->degenerate, &columns->action,
                               &columns->removed, &columns->prune_children};
    for (size_t i = 0; i < sizeof marks / sizeof *marks; ++i)
        complete = (*marks[i] = sgsi_calloc(n, 1)) && complete;
    if (relocates)
        complete = make_moves(&columns->moves, n) && complete;
    if (options->spare)
        columns->workspace = sgsi_alloc(spare_workspace_size(options->spare, count), 1);
    if (complete && (columns->workspace || !options->spare))
        return SGS_STATUS_OK;
    free_columns(columns);
    *columns = (sgsi_density_columns){0};
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for a structural update of %zu primitives", count);
}

typedef struct column_job {
    const sgs_gaussians *model;
    const sgsi_statistics *statistics; // NULL: no statistics yet
    sgsi_density_columns *columns;
} column_job;

static bool is_degenerate(const sgs_gaussians *model, size_t i)
{
    float zeros = 0.0f;
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        zeros += *sgs_gaussians_at(model, i, k) * 0.0f;
    return !(zeros == 0.0f);
}

static void fill_columns(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const column_job *job = context;
    sgsi_density_columns *c = job->columns;
    for (size_t i = begin; i < end; ++i) {
        c->x[i] = *sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN);
        c->y[i] = *sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + 1);
        c->z[i] = *sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + 2);
        c->opacity[i] = sgsi_gaussians_opacity(job->model, i);
        float longest = *sgs_gaussians_at(job->model, i, SGS_PARAM_SCALE);
        for (int k = 1; k < 3; ++k)
            longest = fmaxf(longest, *sgs_gaussians_at(job->model, i, SGS_PARAM_SCALE + k));
        c->scale_max[i] = expf(longest);
        const uint32_t seen = job->statistics ? job->statistics->visible_count[i] : 0;
        c->score[i] = seen ? job->statistics->gradient_sum[i] / (float)seen : 0.0f;
        c->abs_grad[i] = seen ? job->statistics->abs_grad_sum[i] / (float)seen : 0.0f;
        c->weight[i] = 1.0f;
        if (is_degenerate(job->model, i)) {
            c->degenerate[i] = 1;
            c->x[i] = c->y[i] = c->z[i] = NAN; // outside of all boxes and regions
            c->opacity[i] = c->scale_max[i] = c->score[i] = c->abs_grad[i] = 0.0f;
        }
    }
}

// The part of `columns` that belongs to the rows of this process, to be filled.
static sgs_status fill_own(const sgsi_density_rows *rows, size_t own, sgsi_density_columns *part)
{
    const sgsi_density_options plain = {0};
    const sgs_status status = make_columns(own, &plain, false, part);
    if (status)
        return status;
    column_job job = {rows->model, rows->statistics, part};
    sgsi_parallel_ranges(own, 4096, fill_columns, &job);
    return SGS_STATUS_OK;
}

// Fills the columns of the rows of all processes. whole: their statistics.
static sgs_status gather_columns(const sgsi_density_rows *rows, sgsi_density_columns *columns,
                                 sgsi_statistics *whole)
{
    const sgsi_row_peers *peers = rows->peers;
    const sgsi_statistics *statistics = rows->statistics;
    sgsi_density_columns part = {0};
    const size_t own = sgsi_shard_count(columns->count, peers->rank, peers->ranks);
    sgs_status status = sgsi_statistics_reserve(whole, columns->count + 1);
    if (!status)
        status = fill_own(rows, own, &part);
    const struct {
        const void *own;
        void *whole;
        size_t size;
    } all[] = {{part.x, columns->x, 4},
               {part.y, columns->y, 4},
               {part.z, columns->z, 4},
               {part.opacity, columns->opacity, 4},
               {part.scale_max, columns->scale_max, 4},
               {part.score, columns->score, 4},
               {part.abs_grad, columns->abs_grad, 4},
               {part.degenerate, columns->degenerate, 1},
               {statistics->gradient_sum, whole->gradient_sum, 4},
               {statistics->visible_count, whole->visible_count, 4},
               {statistics->radius_max, whole->radius_max, 4}};
    for (size_t k = 0; k < sizeof all / sizeof *all && (!status || !k); ++k)
        status = peers->gather(peers->context, status, all[k].own, all[k].size, columns->count,
                               all[k].whole);
    for (size_t i = 0; i < columns->count && !status; ++i)
        columns->weight[i] = 1.0f;
    free_columns(&part);
    return status;
}

static void evaluate_spare(sgsi_density_columns *columns, const sgsi_statistics *statistics,
                           const sgsi_density_options *options, sgsi_density_result *result,
                           spare_result *regions)
{
    *regions = (spare_result){0};
    if (!options->spare_densify && !options->spare_prune)
        return;
    const double start = sgsi_seconds();
    const spare_input input = {.count = columns->count,
                               .x = columns->x,
                               .y = columns->y,
                               .z = columns->z,
                               .opacity = columns->opacity,
                               .gradient_sum = statistics->gradient_sum,
                               .visible_count = statistics->visible_count,
                               .radius_max = statistics->radius_max};
    spare_result found;
    spare_evaluate(options->spare, &input, columns->workspace, columns->weight, columns->redundant,
                   &found);
    result->regions = found.region_count;
    result->over_budget_share = found.over_budget_share;
    result->mean_weight = options->spare_densify ? found.mean_weight : 1.0;
    for (size_t i = 0; i < columns->count && !options->spare_densify; ++i)
        columns->weight[i] = 1.0f;
    if (!options->spare_prune)
        memset(columns->redundant, 0, columns->count);
    *regions = found;
    result->spare_seconds = sgsi_seconds() - start;
}

// Lists the regions with the decisions on their primitives.
static sgs_status report_regions(const sgsi_density_columns *columns, const spare_result *found,
                                 const sgsi_density_options *options, sgsi_density_result *result)
{
    sgs_region *list = sgsi_calloc(found->region_count, sizeof *list);
    if (!list)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu regions",
                         found->region_count);
    for (size_t r = 0; r < found->region_count; ++r) {
        const spare_region *from = &found->regions[r];
        list[r] = (sgs_region){.voxel = from->voxel,
                               .count = from->count,
                               .gradient = (float)from->gradient,
                               .visibility = (float)from->visibility,
                               .demand = (float)from->demand,
                               .capacity = (float)from->capacity,
                               .quota = (float)from->quota,
                               .slack = (float)from->slack,
                               .weight = options->spare_densify ? (float)from->weight : 1.0f};
    }
    for (size_t i = 0; i < columns->count; ++i) {
        if (found->region_of[i] == SPARE_NO_REGION)
            continue;
        sgs_region *region = &list[found->region_of[i]];
        const bool split = columns->action[i] == SGSI_ACTION_SPLIT;
        const bool moved = columns->moves.root && columns->moves.root[i] != i;
        region->densified += columns->moves.copies ? columns->moves.copies[i]
                                                   : columns->action[i] != SGSI_ACTION_KEEP;
        region->removed += moved || (columns->removed[i] && !split);
        region->redundant += columns->redundant[i] && !columns->removed[i] && !split;
    }
    result->region_list = list;
    memcpy(result->region_low, found->low, sizeof found->low);
    memcpy(result->region_cell, found->cell, sizeof found->cell);
    return SGS_STATUS_OK;
}

static void bounding_box(const sgsi_density_columns *columns, float low[3], float inv_size[3])
{
    const float *const axes[3] = {columns->x, columns->y, columns->z};
    for (int k = 0; k < 3; ++k) {
        float least = INFINITY, most = -INFINITY;
        for (size_t i = 0; i < columns->count; ++i) {
            least = fminf(least, axes[k][i]);
            most = fmaxf(most, axes[k][i]);
        }
        low[k] = least;
        inv_size[k] = most > least ? 1.0f / (most - least) : 0.0f;
    }
}

// Least significant digit first; stable, so rows of equal keys keep their order.
static sgsi_plan_entry *sort_plan(sgsi_plan_entry *entries, sgsi_plan_entry *spare, size_t count)
{
    enum { DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS };
    for (int shift = 0; shift < 63; shift += DIGIT_BITS) {
        uint32_t begin[DIGITS] = {0};
        for (size_t i = 0; i < count; ++i)
            ++begin[entries[i].key >> shift & (DIGITS - 1)];
        uint32_t total = 0;
        for (int k = 0; k < DIGITS; ++k) {
            const uint32_t size = begin[k];
            begin[k] = total;
            total += size;
        }
        for (size_t i = 0; i < count; ++i)
            spare[begin[entries[i].key >> shift & (DIGITS - 1)]++] = entries[i];
        sgsi_plan_entry *const swap = entries;
        entries = spare;
        spare = swap;
    }
    return entries;
}

// Rows that an update adds at most.
static size_t most_new_rows(const sgsi_density_columns *columns)
{
    size_t copies = 0;
    for (size_t i = 0; i < columns->count && columns->moves.copies; ++i)
        copies += columns->moves.copies[i];
    return columns->moves.copies ? copies : columns->count;
}

// Lists the rows of the new model, the fixed ones last. Children and clones are never redundant,
// but the pipeline's own rule may remove them.
static sgs_status make_plan(const sgsi_density_columns *columns, size_t fixed,
                            sgsi_density_result *result, sgsi_density_plan *plan)
{
    const size_t room = columns->count + most_new_rows(columns) + fixed + 1;
    *plan = (sgsi_density_plan){0};
    for (int k = 0; k < 2; ++k)
        plan->buffers[k] = sgsi_alloc(room, sizeof(sgsi_plan_entry));
    if (!plan->buffers[0] || !plan->buffers[1])
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the plan of a structural update");
    float low[3], inv_size[3];
    bounding_box(columns, low, inv_size);
    sgsi_plan_entry *entries = plan->buffers[0];
    for (size_t i = 0; i < columns->count; ++i) {
        if (columns->degenerate[i]) {
            ++result->pruned;
            continue;
        }
        const size_t root = columns->moves.root ? columns->moves.root[i] : i;
        const float mean[3] = {columns->x[root], columns->y[root], columns->z[root]};
        const uint64_t key = sgsi_morton_code(mean, low, inv_size);
        const bool prune_children = columns->prune_children[i];
        if (columns->action[i] == SGSI_ACTION_SPLIT) {
            ++result->split;
            result->pruned += prune_children ? 2 : 0;
            for (uint32_t kind = SGSI_PLAN_CHILD_0; kind <= SGSI_PLAN_CHILD_1 && !prune_children;
                 ++kind)
                entries[plan->count++] = (sgsi_plan_entry){key, (uint32_t)i, kind};
            continue;
        }
        if (columns->action[i] == SGSI_ACTION_CLONE) {
            ++result->cloned;
            result->pruned += prune_children;
            if (!prune_children)
                entries[plan->count++] = (sgsi_plan_entry){key, (uint32_t)i, SGSI_PLAN_CLONE};
        }
        const bool removed = sgsi_density_is_removed(columns, i);
        result->pruned += removed;
        result->spare_pruned += removed && !columns->removed[i];
        if (!removed)
            entries[plan->count++] = (sgsi_plan_entry){key, (uint32_t)i, SGSI_PLAN_KEEP};
        const uint32_t copies = columns->moves.copies ? columns->moves.copies[i] : 0;
        for (uint32_t k = 0; k < copies; ++k)
            entries[plan->count++] = (sgsi_plan_entry){key, (uint32_t)i, SGSI_PLAN_CLONE};
        result->cloned += copies;
        result->relocated += root != i;
    }
    plan->entries = sort_plan(plan->buffers[0], plan->buffers[1], plan->count);
    for (size_t i = 0; i < fixed; ++i)
        plan->entries[plan->count++] =
            (sgsi_plan_entry){.row = (uint32_t)(columns->count + i), .kind = SGSI_PLAN_FIXED};
    return SGS_STATUS_OK;
}

// Decisions on the columns of all rows, and the plan that follows from them.
static sgs_status decide_and_plan(const sgsi_density_rows *rows, const sgsi_pipeline *pipeline,
                                  const sgsi_density_options *options,
                                  sgsi_density_columns *columns, const sgsi_statistics *statistics,
                                  sgsi_density_result *result, sgsi_density_plan *plan)
{
    spare_result regions;
    evaluate_spare(columns, statistics, options, result, &regions);
    sgs_status status = pipeline->decide(options, columns, result);
    if (!status)
        status = sgsi_limit_removal(options, columns);
    if (!status)
        status = sgsi_limit_growth(options, columns, statistics);
    if (!status && regions.region_count)
        status = report_regions(columns, &regions, options, result);
    return status ? status : make_plan(columns, rows->fixed, result, plan);
}

// A hash of which rows the update keeps, adds and moves.
static uint64_t plan_digest(const sgsi_density_plan *plan, const sgsi_density_columns *columns)
{
    const sgsi_row_moves *moves = &columns->moves;
    uint64_t digest = XXH64(plan->entries, plan->count * sizeof *plan->entries, 0);
    if (moves->root)
        digest = XXH64(moves->root, columns->count * sizeof *moves->root, digest);
    if (moves->copies)
        digest = XXH64(moves->copies, columns->count * sizeof *moves->copies, digest);
    return digest;
}

sgs_status sgsi_density_update(const sgsi_density_rows *rows, const sgsi_pipeline *pipeline,
                               const sgsi_density_options *options, sgsi_density_result *result)
{
    *result = (sgsi_density_result){.mean_weight = 1.0, .unchanged = true};
    sgsi_density_columns columns;
    sgsi_statistics gathered = {0};
    const size_t count = (rows->count ? *rows->count : rows->model->count) - rows->fixed;
    sgs_status status = make_columns(count, options, pipeline->relocates, &columns);
    if (status)
        return status;
    if (rows->peers) {
        status = gather_columns(rows, &columns, &gathered);
    } else {
        column_job job = {rows->model, rows->statistics, &columns};
        sgsi_parallel_ranges(columns.count, 4096, fill_columns, &job);
    }
    sgsi_density_plan plan = {0};
    if (!status)
        status = decide_and_plan(rows, pipeline, options, &columns,
                                 rows->peers ? &gathered : rows->statistics, result, &plan);
    sgsi_statistics_free(&gathered);
    if (!status && rows->peers && options->compare)
        status = options->compare(options->context, plan_digest(&plan, &columns));
    result->refused = !status && options->admits && !options->admits(options->context, plan.count);
    if (result->refused)
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                      "a structural update to %zu primitives exceeds the memory limit", plan.count);
    // Before the rows are copied, when the memory is at its peak.
    const sgsi_row_moves moves = columns.moves;
    columns.moves = (sgsi_row_moves){0};
    free_columns(&columns);
    sgsi_plan_trim(&plan);
    if (rows->peers)
        sgsi_return_memory();
    result->unchanged = status != SGS_STATUS_OK;
    if (!status)
        status = sgsi_density_apply(rows, &plan, &moves, options);
    if (!status)
        status = sgsi_statistics_reserve(rows->statistics, rows->model->capacity);
    if (!status)
        sgsi_statistics_clear(rows->statistics, rows->model->count);
    sgsi_plan_free(&plan);
    free_moves(&moves);
    return status;
}

sgs_status sgsi_density_sort(sgs_gaussians *model)
{
    const sgsi_density_options options = {.size_max = INFINITY};
    sgsi_density_result result = {0};
    sgsi_density_columns columns;
    sgs_status status = make_columns(model->count, &options, false, &columns);
    if (status)
        return status;
    sgsi_density_plan plan = {0};
    column_job job = {model, NULL, &columns};
    sgsi_parallel_ranges(model->count, 4096, fill_columns, &job);
    status = make_plan(&columns, 0, &result, &plan);
    free_columns(&columns);
    sgsi_plan_trim(&plan);
    if (!status) // without rows that are not finite
        status = sgsi_density_reorder(model, &plan);
    sgsi_plan_free(&plan);
    return status;
}

void sgsi_density_reset_opacity(sgs_gaussians *model, float *m, float *v, double ceiling,
                                const float *filter_3d)
{
    const float limit = (float)log(ceiling / (1.0 - ceiling));
    for (size_t block = 0; block < (model->count + SGS_LANES - 1) / SGS_LANES; ++block) {
        const size_t at = (block * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES;
        for (size_t k = 0; k < SGS_LANES; ++k) {
            const size_t i = block * SGS_LANES + k;
            float own = limit;
            if (i >= model->count)
                break;
            if (filter_3d) { // o c <= ceiling, c the factor of the filter
                const double most =
                    fmin(ceiling / fmax(sgsi_filter_3d_factor(model, i, filter_3d[i]), 1e-30),
                         1.0 - 1e-7);
                own = (float)log(most / (1.0 - most));
            }
            model->data[at + k] = model->data[at + k] > own ? own : model->data[at + k];
            m[at + k] = v[at + k] = 0.0f;
        }
    }
}
