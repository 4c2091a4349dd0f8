// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// See row_plan.h. Between processes only parameters of old rows travel, some of them at a time; the
// owner of a new row makes it a clone or a child.

#include "density/row_plan.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"

enum { JITTER_TAG = 0x59EAD };

void sgsi_plan_trim(sgsi_density_plan *plan)
{
    for (int k = 0; k < 2; ++k)
        if (plan->buffers[k] != plan->entries) {
            sgsi_free(plan->buffers[k]);
            plan->buffers[k] = NULL;
        }
}

void sgsi_plan_free(sgsi_density_plan *plan)
{
    sgsi_free(plan->buffers[0]);
    sgsi_free(plan->buffers[1]);
    *plan = (sgsi_density_plan){0};
}

typedef struct gather_job {
    const sgsi_plan_entry *entries;
    const float *from;
    float *to;
    bool parameters; // false: moments, new rows are 0
    const sgsi_row_moves *moves;
    const sgsi_density_options *options;
} gather_job;

// mean += amount * R S xi, xi ~ N(0, I): by the normals `counter` to `counter` + 2 of the seed.
static void move_in_covariance(float params[SGS_PARAM_COUNT], double amount, uint64_t seed,
                               uint64_t counter)
{
    double q[4], norm = 0.0, local[3];
    for (int k = 0; k < 4; ++k) {
        q[k] = params[SGS_PARAM_ROTATION + k];
        norm += q[k] * q[k];
    }
    if (!(norm > 1e-30)) {
        q[0] = norm = 1.0;
        q[1] = q[2] = q[3] = 0.0;
    }
    for (int k = 0; k < 4; ++k)
        q[k] /= sqrt(norm);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double rotation[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int k = 0; k < 3; ++k)
        local[k] = amount * exp((double)params[SGS_PARAM_SCALE + k]) *
                   sgsi_random_normal(seed, counter + (uint64_t)k);
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_MEAN + k] +=
            (float)(rotation[3 * k] * local[0] + rotation[3 * k + 1] * local[1] +
                    rotation[3 * k + 2] * local[2]);
}

// Split child: mean + R (s * n), n ~ N(0, 1)^3; scales / 1.6.
static void make_child(const gather_job *job, const sgsi_plan_entry *entry,
                       float params[SGS_PARAM_COUNT])
{
    const uint64_t seed = sgsi_random_bits(job->options->seed, (uint64_t)job->options->iteration);
    const uint64_t counter = (uint64_t)entry->row * 8 + (entry->kind == SGSI_PLAN_CHILD_1 ? 4 : 0);
    move_in_covariance(params, 1.0, seed, counter);
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] -= 0.47000363f; // ln 1.6
}

// Opacity, scales and mean of a row whose opacity was shared among copies. row: the old one;
// place: the new one, in the rows of all processes.
static void apply_move(const gather_job *job, uint32_t row, size_t place,
                       float params[SGS_PARAM_COUNT])
{
    const sgsi_row_moves *moves = job->moves;
    const double opacity = (double)moves->opacity[row];
    if (!(opacity > 0.0))
        return;
    params[SGS_PARAM_OPACITY] = (float)log(opacity / (1.0 - opacity));
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] += moves->log_scale[row];
    if (!(moves->jitter > 0.0))
        return;
    const uint64_t seed =
        sgsi_random_bits(job->options->seed ^ JITTER_TAG, (uint64_t)job->options->iteration);
    move_in_covariance(params, moves->jitter, seed, 4 * (uint64_t)place);
}

// Old row whose values an entry of the plan begins with.
static uint32_t source_row(const gather_job *job, const sgsi_plan_entry *entry)
{
    const bool moves = job->parameters && job->moves->root && entry->kind != SGSI_PLAN_FIXED;
    return moves ? job->moves->root[entry->row] : entry->row;
}

// False where the new row is 0: the moments of new rows.
static bool has_source(const gather_job *job, const sgsi_plan_entry *entry)
{
    const bool stays = entry->kind == SGSI_PLAN_KEEP || entry->kind == SGSI_PLAN_FIXED;
    const bool forgets =
        entry->kind != SGSI_PLAN_FIXED && job->moves->forget && job->moves->forget[entry->row];
    return job->parameters || (stays && !forgets);
}

// From the values of the old row to those of the new one, row `place` of all processes.
static void finish_row(const gather_job *job, const sgsi_plan_entry *entry, size_t place,
                       float row[SGS_PARAM_COUNT])
{
    if (job->parameters && job->moves->root && entry->kind != SGSI_PLAN_FIXED)
        apply_move(job, entry->row, place, row);
    if (job->parameters && (entry->kind == SGSI_PLAN_CHILD_0 || entry->kind == SGSI_PLAN_CHILD_1))
        make_child(job, entry, row);
}

static float *row_at(float *block, size_t row)
{
    return block + row / SGS_LANES * SGS_PARAM_COUNT * SGS_LANES + row % SGS_LANES;
}

static void gather_rows(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const gather_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        float row[SGS_PARAM_COUNT] = {0};
        const sgsi_plan_entry *entry = &job->entries[i];
        const float *from = row_at((float *)job->from, source_row(job, entry));
        if (has_source(job, entry))
            for (int k = 0; k < SGS_PARAM_COUNT; ++k)
                row[k] = from[k * SGS_LANES];
        finish_row(job, entry, i, row);
        float *to = row_at(job->to, i);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            to[k * SGS_LANES] = row[k];
    }
}

// ---- Rows that move between processes ----

enum { ITEM_FLOATS = 16 }; // of a message: some parameters of a row

// Counts, per process, the rows of the plan that this one sends to it and receives from it.
static void count_moves(const gather_job *job, const sgsi_density_plan *plan,
                        const sgsi_row_peers *peers, size_t *to, size_t *from)
{
    memset(to, 0, (size_t)peers->ranks * sizeof *to);
    memset(from, 0, (size_t)peers->ranks * sizeof *from);
    for (size_t i = 0; i < plan->count; ++i) {
        const sgsi_plan_entry *entry = &plan->entries[i];
        const int sender = sgsi_shard_owner(source_row(job, entry), peers->ranks),
                  receiver = sgsi_shard_owner(i, peers->ranks);
        if (!has_source(job, entry))
            continue;
        to[receiver] += sender == peers->rank;
        from[sender] += receiver == peers->rank;
    }
}

// Copies the parameters [first, first + count) of all rows that this process sends or receives
// between the block and the items of a message, whose parts begin at items[rank]. The latter end
// where the parts do.
static void copy_moves(const gather_job *job, const sgsi_density_plan *plan,
                       const sgsi_row_peers *peers, int first, int count, float *items,
                       size_t *begin, bool sends)
{
    for (size_t i = 0; i < plan->count; ++i) {
        const sgsi_plan_entry *entry = &plan->entries[i];
        const size_t source = source_row(job, entry);
        const int sender = sgsi_shard_owner(source, peers->ranks),
                  receiver = sgsi_shard_owner(i, peers->ranks);
        if ((sends ? sender : receiver) != peers->rank)
            continue;
        float row[SGS_PARAM_COUNT] = {0};
        if (has_source(job, entry)) {
            float *item = items + begin[sends ? receiver : sender]++ * ITEM_FLOATS;
            const float *old = row_at((float *)job->from, sgsi_shard_place(source, peers->ranks));
            for (int k = 0; k < count && sends; ++k)
                item[k] = old[(first + k) * SGS_LANES];
            for (int k = count; k < ITEM_FLOATS && sends; ++k)
                item[k] = 0.0f;
            memcpy(row, item, (size_t)count * sizeof *row);
        }
        if (sends)
            continue;
        if (!first) // children and moves change the first parameters only
            finish_row(job, entry, i, row);
        float *to = row_at(job->to, sgsi_shard_place(i, peers->ranks));
        for (int k = 0; k < count; ++k)
            to[(first + k) * SGS_LANES] = row[k];
    }
}

// Some parameters at a time, so that a message is small compared with the rows.
static sgs_status move_rows(const gather_job *job, const sgsi_density_plan *plan,
                            const sgsi_row_peers *peers, sgs_status status)
{
    static const int first[] = {0, SGS_PARAM_SH_REST, SGS_PARAM_SH_REST + 15,
                                SGS_PARAM_SH_REST + 30, SGS_PARAM_COUNT};
    _Static_assert((int)SGS_PARAM_SH_REST <= (int)ITEM_FLOATS,
                   "the first parameters fit into an item");
    const size_t ranks = (size_t)peers->ranks;
    size_t *to = sgsi_alloc(3 * ranks, sizeof *to), *from = to ? to + ranks : NULL,
           *begin = to ? from + ranks : NULL, total = 0;
    if (!to && !status)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu processes", ranks);
    if (!status)
        count_moves(job, plan, peers, to, from);
    for (size_t r = 0; r < ranks && !status; ++r)
        total += to[r];
    const sgs_status failed = status;
    for (size_t k = 0; k + 1 < sizeof first / sizeof *first && (!status || status == failed); ++k) {
        float *items = status ? NULL : peers->room(peers->context, total);
        if (!items && !status)
            status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu primitives",
                               total);
        for (size_t r = 0; r < ranks && !status; ++r)
            begin[r] = r ? begin[r - 1] + to[r - 1] : 0;
        const int count = first[k + 1] - first[k];
        if (!status)
            copy_moves(job, plan, peers, first[k], count, items, begin, true);
        const float *got;
        status = peers->exchange(peers->context, status, to, from, &got);
        if (status)
            break;
        for (size_t r = 0; r < ranks; ++r)
            begin[r] = r ? begin[r - 1] + from[r - 1] : 0;
        copy_moves(job, plan, peers, first[k], count, (float *)got, begin, false);
    }
    sgsi_free(to);
    return status;
}

// ---- All rows ----

// Replaces *block by an array of the new capacity with its rows in the order of the plan; `own` of
// them belong to this process.
static sgs_status gather_block(float **block, size_t capacity, size_t own,
                               const sgsi_density_plan *plan, bool parameters,
                               const sgsi_row_moves *moves, const sgsi_density_options *options,
                               const sgsi_row_peers *peers)
{
    float *to = sgsi_alloc(capacity, SGS_PARAM_COUNT * sizeof *to);
    sgs_status status =
        to ? SGS_STATUS_OK
           : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", capacity);
    if (status && !peers)
        return status;
    const size_t whole = own / SGS_LANES * SGS_LANES; // rows of full blocks
    if (!status)
        memset(to + whole * SGS_PARAM_COUNT, 0, (capacity - whole) * SGS_PARAM_COUNT * sizeof *to);
    gather_job job = {plan->entries, *block, to, parameters, moves, options};
    if (peers)
        status = move_rows(&job, plan, peers, status);
    else
        sgsi_parallel_ranges(plan->count, 1024, gather_rows, &job);
    if (status) {
        sgsi_free(to);
        return status;
    }
    sgsi_free(*block);
    *block = to;
    return SGS_STATUS_OK;
}

static size_t padded_capacity(size_t count)
{
    return (count + SGS_LANES - 1) / SGS_LANES * SGS_LANES + SGS_LANES;
}

sgs_status sgsi_density_apply(const sgsi_density_rows *rows, const sgsi_density_plan *plan,
                              const sgsi_row_moves *moves, const sgsi_density_options *options)
{
    sgs_gaussians *model = rows->model;
    const sgsi_row_peers *peers = rows->peers;
    const size_t own =
        peers ? sgsi_shard_count(plan->count, peers->rank, peers->ranks) : plan->count;
    const size_t capacity = padded_capacity(own);
    sgs_status status =
        gather_block(&model->data, capacity, own, plan, true, moves, options, peers);
    if (!status)
        status = gather_block(rows->m, capacity, own, plan, false, moves, options, peers);
    if (!status)
        status = gather_block(rows->v, capacity, own, plan, false, moves, options, peers);
    if (status)
        return status;
    model->count = model->capacity = capacity;
    if (rows->count)
        *rows->count = plan->count;
    return sgs_gaussians_resize(model, own); // the rows after the own ones become inert
}

typedef struct reorder_job {
    const sgsi_density_plan *plan;
    float *data, *column; // [plan->count]: one parameter in the new order
    int param;
} reorder_job;

static void take_column(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const reorder_job *job = context;
    for (size_t i = begin; i < end; ++i)
        job->column[i] = row_at(job->data, job->plan->entries[i].row)[job->param * SGS_LANES];
}

static void put_column(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const reorder_job *job = context;
    for (size_t i = begin; i < end; ++i)
        row_at(job->data, i)[job->param * SGS_LANES] = job->column[i];
}

// In place, one parameter at a time: a second copy of the rows would be the peak of a rank that
// keeps few of them.
sgs_status sgsi_density_reorder(sgs_gaussians *model, const sgsi_density_plan *plan)
{
    enum { GRAIN = 4096 };
    reorder_job job = {plan, model->data, sgsi_alloc(plan->count + 1, sizeof *job.column), 0};
    if (!job.column)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives",
                         plan->count);
    for (job.param = 0; job.param < SGS_PARAM_COUNT; ++job.param) {
        sgsi_parallel_ranges(plan->count, GRAIN, take_column, &job);
        sgsi_parallel_ranges(plan->count, GRAIN, put_column, &job);
    }
    sgsi_free(job.column);
    return sgs_gaussians_resize(model, plan->count);
}
