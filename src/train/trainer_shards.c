// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Rows that ranks share: from the model that all have created to the rows of each, what a
// structural update sends, and the whole model for files.

#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/row_streams.h"
#include "model/filter_3d.h"
#include "model/model_hash.h"
#include "ply/ply_parts.h"
#include "train/trainer_state.h"

enum { ITEM_BYTES = 64 };

// ---- From the whole model to the own rows ----

// Keeps the own groups of an array of `rows`, `size` bytes per `unit` rows.
static void keep_own(void *to, const void *from, size_t rows, size_t unit, size_t size, int rank,
                     int ranks)
{
    const size_t group = SGSI_SHARD_ROWS / unit * size, total = (rows + unit - 1) / unit * size;
    char *at = to;
    for (size_t begin = (size_t)rank * group; begin < total; begin += (size_t)ranks * group) {
        const size_t bytes = total - begin < group ? total - begin : group;
        memcpy(at, (const char *)from + begin, bytes);
        at += bytes;
    }
}

// Replaces the model, which has no moments, statistics or gradients other than 0 yet.
static sgs_status share_model(sgs_trainer *trainer)
{
    const int rank = sgsi_trainer_rank(trainer), ranks = sgsi_trainer_ranks(trainer);
    sgs_gaussians *whole = trainer->model, *own;
    const size_t count = sgsi_shard_count(trainer->count, rank, ranks);
    sgs_status status = sgs_gaussians_create(count + SGS_LANES, &own);
    if (status)
        return status;
    status = sgs_gaussians_resize(own, count);
    float *filter = trainer->filter_3d ? sgsi_calloc(own->capacity, sizeof *filter) : NULL;
    if (!status && trainer->filter_3d && !filter)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for the 3D filter of %zu primitives", count);
    if (status) {
        sgs_gaussians_destroy(own);
        sgsi_free(filter);
        return status;
    }
    own->sh_degree = whole->sh_degree;
    keep_own(own->data, whole->data, trainer->count, SGS_LANES, SGSI_BLOCK_BYTES, rank, ranks);
    if (filter)
        keep_own(filter, trainer->filter_3d, trainer->count, 1, sizeof *filter, rank, ranks);
    sgsi_free(trainer->filter_3d);
    sgs_gaussians_destroy(whole);
    trainer->filter_3d = filter;
    trainer->model = own;
    if (rank) { // only rank 0 writes it
        sgsi_free(trainer->cloud_points);
        sgsi_free(trainer->cloud_colors);
        trainer->cloud_points = NULL;
        trainer->cloud_count = 0;
        trainer->cloud_colors = NULL;
    }
    sgsi_return_memory();
    return SGS_STATUS_OK;
}

sgs_status sgsi_trainer_share(sgs_trainer *trainer)
{
    sgs_status status = share_model(trainer);
    if (!status)
        status = sgsi_trainer_reserve_state(trainer);
    trainer->views.rebuild = true;
    return sgs_ranks_agree(trainer->views.ranks, status);
}

// ---- Structural updates ----

static sgs_status gather(void *context, sgs_status status, const void *own, size_t size,
                         size_t rows, void *whole)
{
    const sgs_trainer *trainer = context;
    const sgsi_row_array array = {(void *)own, SGSI_SHARD_ROWS * size, rows * size};
    return sgsi_rows_gather(trainer->views.ranks, status, SGS_RANKS_STRUCTURE, &array, whole);
}

static float *room(void *context, size_t items)
{
    const sgs_trainer *trainer = context;
    return sgsi_ranks_room(trainer->views.ranks, items * ITEM_BYTES);
}

static sgs_status exchange(void *context, sgs_status status, const size_t *to, const size_t *from,
                           const float **got)
{
    const sgs_trainer *trainer = context;
    sgs_ranks *ranks = trainer->views.ranks;
    const size_t count = (size_t)sgs_ranks_count(ranks);
    const unsigned char *bytes = NULL;
    size_t *sizes = sgsi_calloc(2 * count, sizeof *sizes);
    if (!sizes && !status)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu ranks", count);
    for (size_t r = 0; r < count && !status; ++r) {
        sizes[r] = to[r] * ITEM_BYTES;
        sizes[count + r] = from[r] * ITEM_BYTES;
    }
    status = status ? sgs_ranks_agree(ranks, status)
                    : sgsi_ranks_exchange(ranks, status, SGS_RANKS_STRUCTURE, sizes, sizes + count,
                                          &bytes);
    *got = (const float *)bytes;
    sgsi_free(sizes);
    return status;
}

sgsi_row_peers sgsi_trainer_peers(sgs_trainer *trainer)
{
    return (sgsi_row_peers){.context = trainer,
                            .rank = sgsi_trainer_rank(trainer),
                            .ranks = sgsi_trainer_ranks(trainer),
                            .gather = gather,
                            .room = room,
                            .exchange = exchange};
}

// ---- The whole model ----

void sgsi_trainer_release(sgs_trainer *trainer)
{
    sgs_gaussians_destroy(trainer->collected);
    sgsi_free(trainer->collected_filter);
    trainer->collected = NULL;
    trainer->collected_filter = NULL;
}

static void append(void *context, void *bytes, size_t size)
{
    char **at = context;
    memcpy(*at, bytes, size);
    *at += size;
}

static sgs_status make_copy(sgs_trainer *trainer)
{
    sgs_status status = sgs_gaussians_create(trainer->count + SGS_LANES, &trainer->collected);
    if (!status)
        status = sgs_gaussians_resize(trainer->collected, trainer->count);
    if (status || !trainer->filter_3d)
        return status;
    trainer->collected_filter =
        sgsi_calloc(trainer->collected->capacity, sizeof *trainer->collected_filter);
    return trainer->collected_filter
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for the 3D filter of %zu primitives", trainer->count);
}

// The 3D filter, if there is one, to whole [count] of rank 0.
static sgs_status collect_filter(sgs_trainer *trainer, sgs_status own, float *whole)
{
    const sgsi_row_array array = {trainer->filter_3d, SGSI_SHARD_ROWS * sizeof(float),
                                  trainer->count * sizeof(float)};
    char *at = (char *)whole;
    return trainer->filter_3d ? sgsi_rows_collect(trainer->views.ranks, own, &array, append, &at)
                              : sgs_ranks_agree(trainer->views.ranks, own);
}

sgs_status sgs_trainer_collect(sgs_trainer *trainer)
{
    sgs_ranks *ranks = trainer->views.ranks;
    sgs_status own = SGS_STATUS_OK;
    if (!sgsi_trainer_is_shared(trainer))
        return SGS_STATUS_OK;
    sgsi_trainer_release(trainer);
    if (!sgsi_trainer_rank(trainer))
        own = make_copy(trainer);
    sgsi_row_array array = sgsi_block_array(trainer->model->data, trainer->count);
    char *at = trainer->collected ? (char *)trainer->collected->data : NULL;
    sgs_status status = sgsi_rows_collect(ranks, own, &array, append, &at);
    if (!status)
        status = collect_filter(trainer, SGS_STATUS_OK, trainer->collected_filter);
    if (status) {
        sgsi_trainer_release(trainer);
        return status;
    }
    if (trainer->collected) {
        trainer->collected->sh_degree = trainer->model->sh_degree;
        if (trainer->model->linear_opacity)
            sgs_gaussians_declare_linear_opacity(trainer->collected);
    }
    return SGS_STATUS_OK;
}

// ---- Hash and model file, from parts of the model ----

typedef struct parts_job {
    const sgs_trainer *trainer;
    void (*take)(void *taker, sgs_gaussians *rows, const float *filter_3d);
    void *taker;         // NULL: the rows are not used
    const float *filter; // [count], or NULL
    size_t first;        // row of the next part
} parts_job;

// Whole blocks in the model's layout.
static void take_blocks(void *context, void *bytes, size_t size)
{
    parts_job *job = context;
    const size_t rows = size / SGSI_BLOCK_BYTES * SGS_LANES,
                 left = job->trainer->count - job->first;
    sgs_gaussians part = *job->trainer->model;
    part.data = bytes;
    part.count = part.capacity = rows < left ? rows : left;
    if (job->taker)
        job->take(job->taker, &part, job->filter ? job->filter + job->first : NULL);
    job->first += part.count;
}

static void hash_rows(void *taker, sgs_gaussians *rows, const float *filter_3d)
{
    (void)filter_3d;
    sgsi_gaussians_hash_rows(taker, rows);
}

sgs_status sgs_trainer_hash(sgs_trainer *trainer, char hex[17])
{
    sgs_ranks *ranks = trainer->views.ranks;
    if (!sgsi_trainer_is_shared(trainer)) {
        sgs_gaussians_hash(trainer->model, hex);
        return SGS_STATUS_OK;
    }
    sgsi_gaussians_hasher *hasher =
        sgsi_gaussians_hash_begin(trainer->count, trainer->model->sh_degree);
    parts_job job = {.trainer = trainer, .take = hash_rows, .taker = hasher};
    const sgsi_row_array array = sgsi_block_array(trainer->model->data, trainer->count);
    const sgs_status own =
        hasher ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a hash");
    const sgs_status status = sgsi_rows_collect(ranks, own, &array, take_blocks, &job);
    memset(hex, 0, 17);
    sgsi_gaussians_hash_end(hasher, hex);
    return status ? status : sgsi_ranks_copy(ranks, SGS_STATUS_OK, SGS_RANKS_OTHER, hex, 17);
}

static void write_rows(void *taker, sgs_gaussians *rows, const float *filter_3d)
{
    sgsi_ply_parts_add(taker, rows, filter_3d);
}

// Writes rows with the filter applied, as sgs_gaussians_fuse_filter_3d.
static void write_fused(void *taker, sgs_gaussians *rows, const float *filter_3d)
{
    sgsi_filter_3d_fuse_rows(rows, filter_3d, rows);
    rows->linear_opacity = false;
    sgsi_ply_parts_add(taker, rows, NULL);
}

// Copies of all rows in parts to rank 0.
static sgs_status pass_parts(sgs_trainer *trainer, parts_job *job)
{
    const sgsi_row_array array = sgsi_block_array(trainer->model->data, trainer->count);
    if (sgsi_trainer_is_shared(trainer))
        return sgsi_rows_collect(trainer->views.ranks, SGS_STATUS_OK, &array, take_blocks, job);
    char *part = sgsi_alloc(array.group, 1);
    if (!part)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to copy %zu primitives",
                         trainer->count);
    for (size_t at = 0; at < array.total; at += array.group) {
        const size_t left = array.total - at, size = left < array.group ? left : array.group;
        memcpy(part, (char *)array.own + at, size);
        take_blocks(job, part, size);
    }
    sgsi_free(part);
    return SGS_STATUS_OK;
}

// The white point of encoded colours matters if photos are in linear light.
static sgs_model_colors trained_colors(const sgs_trainer *trainer)
{
    const sgs_scene *scene = trainer->views.scene;
    const bool has_white = scene->space == SGS_SPACE_LINEAR || scene->linear_images > 0;
    return (sgs_model_colors){.space_known = true,
                              .space = scene->space,
                              .white_point = has_white ? scene->white_point : 0.0};
}

// A file that rank 0 cannot write does not keep the others from sending.
static sgs_status write_parts(sgs_trainer *trainer, const char *path, sgsi_ply_kind kind,
                              const float *filter)
{
    sgsi_ply_parts *parts = NULL;
    sgs_status written = SGS_STATUS_OK;
    char *reason = NULL;
    const sgsi_ply_contents contents = {.kind = kind, .colors = trained_colors(trainer)};
    if (!sgsi_trainer_rank(trainer))
        written = sgsi_ply_parts_begin(path, trainer->model, trainer->count, &contents, &parts);
    if (written)
        reason = sgsi_strdup(sgs_last_error());
    parts_job job = {.trainer = trainer,
                     .take = kind == SGSI_PLY_ANTIALIASED ? write_fused : write_rows,
                     .taker = parts,
                     .filter = filter};
    const sgs_status sent = pass_parts(trainer, &job);
    if (parts)
        written = sgsi_ply_parts_end(parts, !sent);
    if (reason && !sent)
        written = sgsi_fail(written, "%s", reason);
    sgsi_free(reason);
    return sent ? sent : written;
}

// The model with its 3D filter, as a file of a kind.
static sgs_status write_filtered(sgs_trainer *trainer, const char *path, sgsi_ply_kind kind)
{
    if (!sgsi_trainer_is_shared(trainer))
        return write_parts(trainer, path, kind, trainer->filter_3d);
    sgs_status own = SGS_STATUS_OK;
    float *filter = NULL;
    if (!sgsi_trainer_rank(trainer)) {
        filter = sgsi_alloc(trainer->count, sizeof *filter);
        if (!filter)
            own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    }
    sgs_status status = collect_filter(trainer, own, filter);
    if (!status)
        status = write_parts(trainer, path, kind, filter);
    sgsi_free(filter);
    return status;
}

sgs_status sgs_trainer_write_ply(sgs_trainer *trainer, const char *path)
{
    return trainer->filter_3d ? write_filtered(trainer, path, SGSI_PLY_ANTIALIASED)
                              : write_parts(trainer, path, SGSI_PLY_PLAIN, NULL);
}

sgs_status sgs_trainer_write_ply_filter_3d(sgs_trainer *trainer, const char *path)
{
    return trainer->filter_3d // the same on all ranks
               ? write_filtered(trainer, path, SGSI_PLY_FILTER_3D)
               : sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: the model has no 3D filter", path);
}

sgs_status sgs_trainer_write_points(sgs_trainer *trainer, const char *path)
{
    return write_parts(trainer, path, SGSI_PLY_POINTS, NULL);
}
