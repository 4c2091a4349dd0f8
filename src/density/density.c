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
#include "model/filter_3d.h"
#include "density/pipeline.h"
#include "density/plan_rows.h"
#include "density/row_limits.h"
#include "base/threads.h"
#include "spare/spare.h"

enum { GRAIN = 1 << 14 };

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

static void clear_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sgsi_statistics *statistics = context;
    const size_t count = end - begin;
    memset(statistics->gradient_sum + begin, 0, count * sizeof *statistics->gradient_sum);
    memset(statistics->abs_grad_sum + begin, 0, count * sizeof *statistics->abs_grad_sum);
    memset(statistics->visible_count + begin, 0, count * sizeof *statistics->visible_count);
    memset(statistics->radius_max + begin, 0, count * sizeof *statistics->radius_max);
}

void sgsi_statistics_clear(sgsi_statistics *statistics, size_t count)
{
    sgsi_parallel_ranges(count, GRAIN, clear_range, statistics);
}

typedef struct radius_job {
    float *radius_max, factor;
} radius_job;

static void scale_radii(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const radius_job *job = context;
    for (size_t i = begin; i < end; ++i)
        job->radius_max[i] *= job->factor;
}

void sgsi_statistics_resize_images(sgsi_statistics *statistics, size_t count, float factor)
{
    radius_job job = {statistics->radius_max, factor};
    sgsi_parallel_ranges(count, GRAIN, scale_radii, &job);
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

static void number_rows(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    uint32_t *rows = context;
    for (size_t i = begin; i < end; ++i)
        rows[i] = (uint32_t)i;
}

// Moves of rows that all stay.
static bool make_moves(sgsi_row_moves *moves, size_t count)
{
    *moves = (sgsi_row_moves){.root = sgsi_alloc(count, sizeof *moves->root),
                              .copies = sgsi_calloc_shared(count, sizeof *moves->copies),
                              .opacity = sgsi_calloc_shared(count, sizeof *moves->opacity),
                              .log_scale = sgsi_calloc_shared(count, sizeof *moves->log_scale),
                              .forget = sgsi_calloc_shared(count, 1)};
    if (moves->root)
        sgsi_parallel_ranges(count, GRAIN, number_rows, moves->root);
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
        complete = (*marks[i] = sgsi_calloc_shared(n, 1)) && complete;
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

static void fill_ones(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    float *values = context;
    for (size_t i = begin; i < end; ++i)
        values[i] = 1.0f;
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
    if (!status)
        sgsi_parallel_ranges(columns->count, GRAIN, fill_ones, columns->weight);
    free_columns(&part);
    return status;
}

typedef struct slice_loop {
    spare_slice_fn body;
    void *context;
} slice_loop;

static void run_slice(void *context, size_t slice, int thread)
{
    (void)thread;
    const slice_loop *loop = context;
    loop->body(loop->context, slice);
}

static void run_slices(size_t count, spare_slice_fn body, void *context)
{
    slice_loop loop = {body, context};
    sgsi_parallel_for(count, 1, run_slice, &loop);
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
                               .radius_max = statistics->radius_max,
                               .loop = run_slices,
                               .threads = sgsi_threads()};
    spare_result found;
    spare_evaluate(options->spare, &input, columns->workspace, columns->weight, columns->redundant,
                   &found);
    result->regions = found.region_count;
    result->over_budget_share = found.over_budget_share;
    result->mean_weight = options->spare_densify ? found.mean_weight : 1.0;
    if (!options->spare_densify)
        sgsi_parallel_ranges(columns->count, GRAIN, fill_ones, columns->weight);
    if (!options->spare_prune)
        memset(columns->redundant, 0, columns->count);
    *regions = found;
    result->spare_seconds = sgsi_seconds() - start;
}

typedef struct region_job {
    const sgsi_density_columns *columns;
    const uint32_t *region_of;
    sgs_region *list;
} region_job;

// Neighbours are mostly of the same region: it receives their sums at once.
static void add_to_region(sgs_region *region, const sgs_region *sums)
{
    __atomic_fetch_add(&region->densified, sums->densified, __ATOMIC_RELAXED);
    __atomic_fetch_add(&region->removed, sums->removed, __ATOMIC_RELAXED);
    __atomic_fetch_add(&region->redundant, sums->redundant, __ATOMIC_RELAXED);
}

static void count_decisions(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const region_job *job = context;
    const sgsi_density_columns *columns = job->columns;
    sgs_region sums = {0};
    for (size_t i = begin; i < end; ++i) {
        const uint32_t region = job->region_of[i];
        if (region == SPARE_NO_REGION)
            continue;
        const bool split = columns->action[i] == SGSI_ACTION_SPLIT;
        const bool moved = columns->moves.root && columns->moves.root[i] != i;
        if (region != sums.voxel) { // here the index of a region
            add_to_region(&job->list[sums.voxel], &sums);
            sums = (sgs_region){.voxel = region};
        }
        sums.densified += columns->moves.copies ? columns->moves.copies[i]
                                                : columns->action[i] != SGSI_ACTION_KEEP;
        sums.removed += moved || (columns->removed[i] && !split);
        sums.redundant += columns->redundant[i] && !columns->removed[i] && !split;
    }
    add_to_region(&job->list[sums.voxel], &sums);
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
    region_job job = {columns, found->region_of, list};
    sgsi_parallel_ranges(columns->count, GRAIN, count_decisions, &job);
    result->region_list = list;
    memcpy(result->region_low, found->low, sizeof found->low);
    memcpy(result->region_voxel_size, found->voxel_size, sizeof found->voxel_size);
    return SGS_STATUS_OK;
}

// The decisions of the pipeline. Large rows stay where the cap has no room for all that grow: the
// pruning by size relies on growth that covers their area again.
static sgs_status decide(const sgsi_pipeline *pipeline, const sgsi_density_options *options,
                         sgsi_density_columns *columns, sgsi_density_result *result)
{
    if (pipeline->prunes_large && options->max_count && options->size_max < INFINITY) {
        const sgsi_density_result before = *result;
        sgsi_density_options kept = *options;
        kept.size_max = INFINITY;
        const sgs_status status = pipeline->decide(&kept, columns, result);
        if (status || sgsi_growth_exceeds_cap(&kept, columns))
            return status;
        *result = before;
    }
    return pipeline->decide(options, columns, result);
}

// Decisions on the columns of all rows, and the plan that follows from them.
static sgs_status decide_and_plan(const sgsi_density_rows *rows, const sgsi_pipeline *pipeline,
                                  const sgsi_density_options *options,
                                  sgsi_density_columns *columns, const sgsi_statistics *statistics,
                                  sgsi_density_result *result, sgsi_density_plan *plan)
{
    spare_result regions;
    evaluate_spare(columns, statistics, options, result, &regions);
    sgs_status status = decide(pipeline, options, columns, result);
    if (!status)
        status = sgsi_limit_removal(options, columns);
    if (!status)
        status = sgsi_limit_growth(options, columns, statistics);
    if (!status && regions.region_count)
        status = report_regions(columns, &regions, options, result);
    return status ? status : sgsi_plan_make(columns, rows->fixed, result, plan);
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
    status = sgsi_plan_make(&columns, 0, &result, &plan);
    free_columns(&columns);
    sgsi_plan_trim(&plan);
    if (!status) // without rows that are not finite
        status = sgsi_density_reorder(model, &plan);
    sgsi_plan_free(&plan);
    return status;
}

typedef struct reset_job {
    sgs_gaussians *model;
    float *m, *v;
    double ceiling;
    const float *filter_3d;
    float limit; // logit of the ceiling
} reset_job;

static void reset_blocks(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const reset_job *job = context;
    sgs_gaussians *model = job->model;
    for (size_t block = begin; block < end; ++block) {
        const size_t at = (block * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES;
        for (size_t k = 0; k < SGS_LANES; ++k) {
            const size_t i = block * SGS_LANES + k;
            float own = job->limit;
            if (i >= model->count)
                break;
            if (job->filter_3d) { // o c <= ceiling, c the factor of the filter
                const double factor = sgsi_filter_3d_factor(model, i, job->filter_3d[i]),
                             most = fmin(job->ceiling / fmax(factor, 1e-30), 1.0 - 1e-7);
                own = (float)log(most / (1.0 - most));
            }
            model->data[at + k] = model->data[at + k] > own ? own : model->data[at + k];
            job->m[at + k] = job->v[at + k] = 0.0f;
        }
    }
}

void sgsi_density_reset_opacity(sgs_gaussians *model, float *m, float *v, double ceiling,
                                const float *filter_3d)
{
    reset_job job = {model, m, v, ceiling, filter_3d, (float)log(ceiling / (1.0 - ceiling))};
    sgsi_parallel_ranges((model->count + SGS_LANES - 1) / SGS_LANES, 256, reset_blocks, &job);
}
