// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The trainer's whole state as named sections of one file (sections.c):
//
//   options    fields (fields.h): every option that affects the result (checkpoint_options.c)
//   scene      u64 per training view: digest of its name, camera and pose
//   size       u64: number of primitives n
//   progress   fields: counters, averages, equilibrium, seconds (checkpoint_progress.c)
//   model, moment1, moment2    blocks of 16 primitives, 59 parameters each; lanes after n are 0
//   statistics gradient sums, sums of absolute gradients, visible counts, largest radii: n each
//   depth_bounds    per tile of each view; they affect only the cost of a step
//   order      u32 per training view: the permutation of the current epoch
//   equilibrium    sums of the losses of each training view in two intervals (spare_view_fit)
//   exposure   colour maps of the views, their moments and steps; with option exposure
//   accumulated_grad, accumulated_rows    gradients before a step, as blocks, and the rows that
//              have any; for steps of several views
//   filter_3d  Mip-Splatting's 3D filter, n floats; with its pixel filter
//   stop       text: why training ended, empty before the end
//
// A new array is one section in visit_state(), a new counter one row in checkpoint_progress.c; a
// new option requires no change here. The BVH is not stored, because padded bounds make the hits
// independent of it. A damaged file, or one of another run, is refused before the trainer changes.

#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "train/checkpoint_options.h"
#include "train/checkpoint_progress.h"
#include "base/core.h"
#include "base/sections.h"
#include "base/threads.h"
#include "cluster/row_streams.h"
#include "train/small_images.h"
#include "train/trainer_state.h"

enum { BLOCK_FLOATS = SGS_PARAM_COUNT * SGS_LANES };

static size_t block_bytes(size_t n)
{
    return (n + SGS_LANES - 1) / SGS_LANES * BLOCK_FLOATS * sizeof(float);
}

// A pass over the state. With several ranks, passes that write and read are collective: rank 0
// alone has sections, the others send and receive rows.
typedef struct state_visit {
    sgsi_sections *sections; // NULL on other ranks
    sgs_trainer *trainer;
    size_t n;              // primitives of all ranks
    bool moves;            // the pass is WRITE or READ, with several ranks
    bool reads;            // then: READ
    size_t passed, blocks; // of visit_blocks: bytes so far, and of all
    sgs_status status;     // of the collective calls
} state_visit;

static state_visit visit_of(sgsi_sections *sections, sgs_trainer *trainer, size_t n,
                            sgsi_sections_pass pass)
{
    const bool reads = pass == SGSI_SECTIONS_READ;
    return (state_visit){.sections = sections,
                         .trainer = trainer,
                         .n = n,
                         .moves = sgsi_trainer_is_shared(trainer) &&
                                  (reads || pass == SGSI_SECTIONS_WRITE),
                         .reads = reads};
}

static void begin_section(const state_visit *visit, const char *name, size_t bytes)
{
    if (visit->sections)
        sgsi_sections_begin(visit->sections, name, bytes);
}

// An array that all ranks have.
static void visit_copy(state_visit *visit, const char *name, void *data, size_t bytes)
{
    begin_section(visit, name, bytes);
    if (visit->sections)
        sgsi_sections_piece(visit->sections, data, bytes);
    if (visit->moves && visit->reads && !visit->status)
        visit->status = sgsi_ranks_copy(visit->trainer->views.ranks, SGS_STATUS_OK, SGS_RANKS_OTHER,
                                        data, bytes);
}

// Bytes of rank 0 between the file and the ranks.
static void pass_bytes(void *context, void *bytes, size_t size)
{
    const state_visit *visit = context;
    sgsi_sections_piece(visit->sections, bytes, size);
}

// The same for blocks of parameters: the lanes after the last primitive are 0 in the file.
static void pass_blocks(void *context, void *bytes, size_t size)
{
    state_visit *visit = context;
    const size_t rest = visit->n % SGS_LANES, block = BLOCK_FLOATS * sizeof(float);
    visit->passed += size;
    float *last = (float *)((char *)bytes + (size - block));
    for (size_t i = 0; i < BLOCK_FLOATS && rest && visit->passed == visit->blocks && !visit->reads;
         ++i)
        last[i] = i % SGS_LANES < rest ? last[i] : 0.0f;
    sgsi_sections_piece(visit->sections, bytes, size);
}

static void visit_parts(state_visit *visit, const sgsi_row_array *array,
                        void (*pass)(void *context, void *bytes, size_t size))
{
    sgs_ranks *ranks = visit->trainer->views.ranks;
    if (!visit->status)
        visit->status = visit->reads
                            ? sgsi_rows_distribute(ranks, SGS_STATUS_OK, array, pass, visit)
                            : sgsi_rows_collect(ranks, SGS_STATUS_OK, array, pass, visit);
}

// An array with `size` bytes for every `unit` rows, in an open section.
static void visit_rows(state_visit *visit, void *own, size_t unit, size_t size)
{
    const sgsi_row_array array = {own, SGSI_SHARD_ROWS / unit * size,
                                  (visit->n + unit - 1) / unit * size};
    if (visit->moves)
        visit_parts(visit, &array, pass_bytes);
    else
        sgsi_sections_piece(visit->sections, own, array.total);
}

// Primitives in the model's layout. The lanes after the last one are zero in the file and, in one
// process, unchanged in memory.
static void visit_blocks(state_visit *visit, const char *name, float *data)
{
    const size_t n = visit->n, whole = n / SGS_LANES, rest = n % SGS_LANES;
    sgsi_sections *sections = visit->sections;
    begin_section(visit, name, block_bytes(n));
    if (visit->moves) {
        const sgsi_row_array array = sgsi_block_array(data, n);
        visit->passed = 0;
        visit->blocks = array.total;
        visit_parts(visit, &array, pass_blocks);
        return;
    }
    sgsi_sections_piece(sections, data, whole * BLOCK_FLOATS * sizeof(float));
    if (!rest)
        return;
    float tail[BLOCK_FLOATS] = {0};
    const size_t first = whole * BLOCK_FLOATS;
    for (size_t i = 0; i < BLOCK_FLOATS && sections->pass == SGSI_SECTIONS_WRITE; ++i)
        if (i % SGS_LANES < rest)
            tail[i] = data[first + i];
    sgsi_sections_piece(sections, tail, sizeof tail);
    for (size_t i = 0; i < BLOCK_FLOATS && sections->pass == SGSI_SECTIONS_READ; ++i)
        if (i % SGS_LANES < rest)
            data[first + i] = tail[i];
}

static void visit_depth_bounds(state_visit *visit)
{
    const sgsi_train_views *views = &visit->trainer->views;
    size_t tiles = 0;
    for (size_t i = 0; i < views->count; ++i)
        tiles += views->tile_counts[i];
    begin_section(visit, "depth_bounds", tiles * sizeof(float));
    for (size_t i = 0; i < views->count; ++i) {
        const size_t bytes = views->tile_counts[i] * sizeof(float);
        if (visit->sections)
            sgsi_sections_piece(visit->sections, views->depth_bounds[i], bytes);
        if (visit->moves && visit->reads && !visit->status)
            visit->status = sgsi_ranks_copy(views->ranks, SGS_STATUS_OK, SGS_RANKS_OTHER,
                                            views->depth_bounds[i], bytes);
    }
}

// All arrays that a training step changes.
static void visit_state(state_visit *visit)
{
    sgs_trainer *trainer = visit->trainer;
    const size_t views = trainer->views.count, n = visit->n;
    sgsi_statistics *statistics = &trainer->statistics;
    visit_blocks(visit, "model", trainer->model->data);
    visit_blocks(visit, "moment1", trainer->m);
    visit_blocks(visit, "moment2", trainer->v);
    begin_section(visit, "statistics", n * 4 * sizeof(float));
    visit_rows(visit, statistics->gradient_sum, 1, sizeof(float));
    visit_rows(visit, statistics->abs_grad_sum, 1, sizeof(float));
    visit_rows(visit, statistics->visible_count, 1, sizeof(uint32_t));
    visit_rows(visit, statistics->radius_max, 1, sizeof(float));
    visit_depth_bounds(visit);
    visit_copy(visit, "order", trainer->order, views * sizeof(uint32_t));
    visit_copy(visit, "equilibrium", trainer->view_fits, 2 * views * sizeof *trainer->view_fits);
    if (trainer->views.exposure) {
        size_t numbers;
        double *exposure = sgsi_exposure_state(trainer->views.exposure, &numbers);
        visit_copy(visit, "exposure", exposure, numbers * sizeof *exposure);
    }
    if (sgsi_trainer_accumulates(trainer)) {
        const size_t bytes = 2 * sizeof *trainer->accumulated_rows;
        visit_blocks(visit, "accumulated_grad", trainer->accumulated_grad);
        begin_section(visit, "accumulated_rows", (n + SGS_LANES - 1) / SGS_LANES * bytes);
        visit_rows(visit, trainer->accumulated_rows, SGS_LANES, bytes);
    }
    if (trainer->filter_3d) {
        begin_section(visit, "filter_3d", n * sizeof *trainer->filter_3d);
        visit_rows(visit, trainer->filter_3d, 1, sizeof *trainer->filter_3d);
    }
    visit_copy(visit, "stop", trainer->stop_text, sizeof trainer->stop_text);
}

static uint64_t view_digest(const sgs_view *view)
{
    // Field by field: structs have padding.
    const uint64_t parts[] = {XXH64(view->name, strlen(view->name), 0),
                              (uint64_t)view->camera.model << 32 | (uint32_t)view->camera.width,
                              (uint32_t)view->camera.height,
                              XXH64(view->camera.params, sizeof view->camera.params, 0),
                              XXH64(view->pose.rotation, sizeof view->pose.rotation, 0),
                              XXH64(view->pose.translation, sizeof view->pose.translation, 0)};
    return XXH64(parts, sizeof parts, 0);
}

static const sgs_view *train_view(const sgs_trainer *trainer, size_t i)
{
    return &trainer->scene->views[trainer->views.scene_views[i]];
}

// Sections that identify the run and its progress, before the arrays.
static void visit_head(sgsi_sections *sections, const sgs_trainer *trainer,
                       const sgsi_field_list *options, const sgsi_field_list *progress)
{
    uint64_t n = trainer->count;
    sgsi_sections_begin(sections, "options", options->count);
    sgsi_sections_piece(sections, options->bytes, options->count);
    sgsi_sections_begin(sections, "scene", trainer->views.count * sizeof(uint64_t));
    for (size_t i = 0; i < trainer->views.count; ++i) {
        uint64_t digest = view_digest(train_view(trainer, i));
        sgsi_sections_piece(sections, &digest, sizeof digest);
    }
    sgsi_sections_begin(sections, "size", sizeof n);
    sgsi_sections_piece(sections, &n, sizeof n);
    sgsi_sections_begin(sections, "progress", progress->count);
    sgsi_sections_piece(sections, progress->bytes, progress->count);
}

// For the passes MEASURE and WRITE, which do not change the trainer. The status of the collective
// calls; that of the file is in the sections.
static sgs_status visit_all(sgsi_sections *sections, const sgs_trainer *trainer,
                            const sgsi_field_list *options, const sgsi_field_list *progress)
{
    state_visit visit = visit_of(sections, (sgs_trainer *)trainer, trainer->count,
                                 sections ? sections->pass : SGSI_SECTIONS_WRITE);
    if (sections)
        visit_head(sections, trainer, options, progress);
    visit_state(&visit);
    return visit.status;
}

static bool list_fields(const sgs_trainer *trainer, sgsi_field_list *options,
                        sgsi_field_list *progress)
{
    sgsi_options_write(options, &trainer->options);
    sgsi_train_progress_write(progress, &trainer->progress);
    return !options->failed && !progress->failed;
}

size_t sgs_trainer_checkpoint_bytes(const sgs_trainer *trainer)
{
    sgsi_field_list options = {0}, progress = {0};
    sgsi_sections sections;
    list_fields(trainer, &options, &progress);
    sgsi_sections_measure(&sections);
    visit_all(&sections, trainer, &options, &progress);
    sgsi_free(options.bytes);
    sgsi_free(progress.bytes);
    return sections.measured;
}

// A file that cannot be written does not keep the other ranks from sending their rows.
static sgs_status write_file(const sgs_trainer *trainer, const char *path)
{
    sgsi_field_list options = {0}, progress = {0};
    sgsi_sections sections;
    sgs_status status =
        list_fields(trainer, &options, &progress)
            ? sgsi_sections_create(&sections, path)
            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    sgs_status sent = SGS_STATUS_OK;
    if (!status) {
        sent = visit_all(&sections, trainer, &options, &progress);
        status = sgsi_sections_commit(&sections);
    } else if (sgsi_trainer_is_shared(trainer)) {
        sections = (sgsi_sections){.pass = SGSI_SECTIONS_WRITE, .status = status, .path = path};
        char *reason = sgsi_strdup(sgs_last_error());
        sent = visit_all(&sections, trainer, &options, &progress);
        if (!sent && reason)
            status = sgsi_fail(status, "%s", reason);
        sgsi_free(reason);
    }
    sgsi_free(options.bytes);
    sgsi_free(progress.bytes);
    return sent ? sent : status;
}

sgs_status sgs_trainer_save_checkpoint(const sgs_trainer *trainer, const char *path)
{
    if (trainer->inconsistent)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: cannot save: the last step failed and the state is inconsistent",
                         path);
    sgs_status status = sgsi_trainer_reserve_state((sgs_trainer *)trainer);
    if (status)
        return sgs_ranks_agree(trainer->views.ranks, status);
    return sgsi_trainer_rank(trainer) ? visit_all(NULL, trainer, NULL, NULL)
                                      : write_file(trainer, path);
}

// ---- reading ----

static sgs_status check_scene(sgsi_sections *sections, const sgs_trainer *trainer)
{
    const size_t views = trainer->views.count;
    size_t bytes;
    const uint8_t *digests;
    const sgs_status status = sgsi_sections_find(sections, "scene", &digests, &bytes);
    if (status)
        return status;
    if (bytes != views * sizeof(uint64_t))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: the run started with %zu training views, but the scene has %zu; "
                         "resume with the same scene",
                         sections->path, bytes / sizeof(uint64_t), views);
    for (size_t i = 0; i < views; ++i) {
        const sgs_view *view = train_view(trainer, i);
        uint64_t digest;
        memcpy(&digest, digests + i * sizeof digest, sizeof digest);
        if (digest != view_digest(view))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: view '%s' or its camera changed since the run started; resume "
                             "with the same scene",
                             sections->path, view->name);
    }
    return SGS_STATUS_OK;
}

// A number of primitives.
static bool is_count(int64_t n)
{
    return n >= 0 && n <= UINT32_MAX;
}

// View order and counters are used as indices: checks their ranges.
static sgs_status check_progress(sgsi_sections *sections, const sgs_trainer *trainer,
                                 const sgsi_train_progress *progress)
{
    const size_t views = trainer->views.count;
    if (progress->iteration < 0 || progress->iteration > 10000000 || progress->adam_step < 0 ||
        progress->adam_step > progress->iteration || progress->structure_iteration < 0 ||
        progress->structure_iteration > progress->iteration || progress->order_position > views ||
        progress->stop < SGS_STOP_NONE || progress->stop > SGS_STOP_SIGNAL ||
        progress->resolution < 0 || progress->resolution > 8 || progress->updates < 0 ||
        progress->start < SGSI_START_UNKNOWN || progress->start > SGSI_START_RANDOM ||
        progress->batch_views < 0 || progress->batch_views >= trainer->options.batch ||
        (progress->stop == SGS_STOP_SCHEDULE &&
         (!progress->iteration || !progress->order_position)) ||
        !is_count(progress->pipeline.initial_count) || !is_count(progress->pipeline.momentum) ||
        !is_count(progress->pipeline.deleted))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: a counter in section 'progress' is out of range",
                         sections->path);
    size_t bytes;
    const uint8_t *order;
    const sgs_status status = sgsi_sections_find(sections, "order", &order, &bytes);
    if (status)
        return status;
    for (size_t i = 0; i < views; ++i) {
        uint32_t view;
        memcpy(&view, order + i * sizeof view, sizeof view);
        if (view >= views)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: the view order contains view %u of %zu",
                             sections->path, view, views);
    }
    return SGS_STATUS_OK;
}

// Number of primitives; FORMAT if the section 'model' is shorter.
static sgs_status read_size(sgsi_sections *sections, size_t *n)
{
    size_t bytes;
    const uint8_t *size;
    const sgs_status status = sgsi_sections_find(sections, "size", &size, &bytes);
    if (status)
        return status;
    uint64_t count = 0;
    if (bytes != sizeof count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section 'size' has %zu bytes instead of %zu",
                         sections->path, bytes, sizeof count);
    memcpy(&count, size, sizeof count);
    if (count > sgsi_sections_size(sections, "model") / (SGS_PARAM_COUNT * sizeof(float)))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section 'size': %llu primitives do not fit into the section 'model'",
                         sections->path, (unsigned long long)count);
    *n = (size_t)count;
    return SGS_STATUS_OK;
}

sgs_status sgs_checkpoint_gaussians(const char *path, size_t *gaussians)
{
    sgsi_sections sections;
    *gaussians = 0;
    sgs_status status = sgsi_sections_open(&sections, path);
    if (status)
        return status;
    status = read_size(&sections, gaussians);
    sgsi_sections_close(&sections);
    return status;
}

// Counts the last of the n rows in the section 'model' that are outside of the region. FORMAT if
// one of the others is.
static sgs_status count_fixed(sgsi_sections *sections, const sgs_box *region, size_t n,
                              size_t *fixed)
{
    float centers[3][SGS_LANES]; // of a block, which begins with them
    *fixed = 0;
    for (size_t i = 0; i < n && !sgs_box_is_infinite(region); ++i) {
        const size_t lane = i % SGS_LANES;
        const sgs_status status =
            lane ? SGS_STATUS_OK
                 : sgsi_sections_copy(sections, "model",
                                      i / SGS_LANES * BLOCK_FLOATS * sizeof(float), centers,
                                      sizeof centers);
        if (status)
            return status;
        const float center[3] = {centers[0][lane], centers[1][lane], centers[2][lane]};
        const bool own = sgs_box_contains(region, center);
        if (own && *fixed)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: section 'model': row %zu is inside of the region, rows before it "
                             "are not",
                             sections->path, i);
        *fixed += !own;
    }
    return SGS_STATUS_OK;
}

// What the sections of a file contain that the trainer's members depend on.
typedef struct contents {
    size_t n, fixed; // primitives; of these, outside of the region
    sgsi_train_progress progress;
} contents;

// Compares an undamaged file with the trainer.
static sgs_status check(sgsi_sections *sections, sgs_trainer *trainer, contents *found)
{
    size_t *const n = &found->n;
    sgsi_train_progress *const progress = &found->progress;
    sgs_status status = read_size(sections, n);
    if (status)
        return status;
    size_t bytes;
    const uint8_t *fields, *options;
    status = sgsi_sections_find(sections, "progress", &fields, &bytes);
    if (status)
        return status;
    status = sgsi_train_progress_read(sections->path, fields, bytes, progress);
    if (status)
        return status;
    status = sgsi_sections_find(sections, "options", &options, &bytes);
    if (status)
        return status;
    bool spare_changed;
    status = sgsi_options_compare(sections->path, options, bytes, &trainer->options,
                                  progress->iteration, &spare_changed);
    if (!status && spare_changed) { // the equilibrium depends on these options
        progress->equilibrium.held = 0;
        if (progress->stop == SGS_STOP_EQUILIBRIUM)
            progress->stop = SGS_STOP_NONE;
    }
    if (!status)
        status = check_scene(sections, trainer);
    if (status)
        return status;
    state_visit visit = visit_of(sections, trainer, *n, SGSI_SECTIONS_CHECK);
    visit_state(&visit);
    status = sgsi_sections_checked(sections);
    if (!status)
        status = check_progress(sections, trainer, progress);
    if (!status)
        status = count_fixed(sections, &trainer->options.region, *n, &found->fixed);
    const size_t cap = trainer->options.max_gaussians, own = *n - found->fixed;
    if (!status && cap && own > cap)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "%s: has %zu primitives, more than option max_gaussians %zu; raise it",
                           sections->path, own, cap);
    return status;
}

// Memory for the own ones of `count` primitives in the trainer, uninitialised.
static sgs_status make_room(sgs_trainer *trainer, size_t count)
{
    const size_t n =
        sgsi_shard_count(count, sgsi_trainer_rank(trainer), sgsi_trainer_ranks(trainer));
    sgs_gaussians *model;
    sgs_status status = sgs_gaussians_create(n + SGS_LANES, &model);
    if (!status)
        status = sgs_gaussians_resize(model, n);
    if (status) {
        sgs_gaussians_destroy(model);
        return status;
    }
    float *m = sgsi_calloc_shared(model->capacity, SGS_PARAM_COUNT * sizeof(float));
    float *v = sgsi_calloc_shared(model->capacity, SGS_PARAM_COUNT * sizeof(float));
    sgsi_statistics statistics = {0};
    if (!m || !v || sgsi_statistics_reserve(&statistics, model->capacity)) {
        sgsi_free(m);
        sgsi_free(v);
        sgs_gaussians_destroy(model);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the %zu primitives of a checkpoint", n);
    }
    model->sh_degree = trainer->options.sh_degree;
    sgs_gaussians_destroy(trainer->model);
    sgsi_free(trainer->m);
    sgsi_free(trainer->v);
    sgsi_statistics_free(&trainer->statistics);
    trainer->statistics = statistics;
    trainer->model = model;
    trainer->count = count;
    trainer->m = m;
    trainer->v = v;
    status = sgsi_trainer_reserve_accumulated_grad(trainer);
    return status ? status : sgsi_trainer_reserve_filter_3d(trainer);
}

// Images at the resolution of the checkpoint.
static sgs_status restore_images(sgs_trainer *trainer, int resolution)
{
    sgsi_small_images images;
    const sgs_status status = sgsi_small_images_make(&trainer->views, resolution, &images);
    if (!status)
        sgsi_small_images_adopt(&trainer->views, &images);
    return status;
}

// Opens and compares the file. Closes it after a failure.
static sgs_status open_file(sgsi_sections *sections, sgs_trainer *trainer, const char *path,
                            contents *found)
{
    sgs_status status = sgsi_sections_open(sections, path);
    if (status)
        return status;
    status = check(sections, trainer, found);
    if (status)
        sgsi_sections_close(sections);
    return status;
}

sgs_status sgs_trainer_check_checkpoint(sgs_trainer *trainer, const char *path)
{
    sgsi_sections sections;
    contents found = {0};
    const sgs_status status = open_file(&sections, trainer, path, &found);
    if (!status)
        sgsi_sections_close(&sections);
    return status;
}

// The schedule depends on whether the run began with a random cloud. The trainer may have been
// created without the points or the model of that time.
static void restore_progress(sgs_trainer *trainer, const sgsi_train_progress *progress)
{
    const int32_t own = trainer->progress.start;
    trainer->progress = *progress;
    if (progress->start == SGSI_START_UNKNOWN)
        trainer->progress.start = own;
    if (trainer->progress.start == own)
        return;
    const double lr_begin = trainer->schedule.lr_begin; // planned from the photos
    trainer->schedule = sgsi_train_schedule(trainer->scene, &trainer->options,
                                            progress->start == SGSI_START_RANDOM);
    trainer->schedule.lr_begin = lr_begin;
}

// Replaces the state by that of a file that agrees with the trainer; sections NULL on other ranks.
static sgs_status read_state(sgsi_sections *sections, sgs_trainer *trainer, const contents *found)
{
    const sgsi_train_progress *progress = &found->progress;
    sgs_ranks *ranks = sgsi_trainer_is_shared(trainer) ? trainer->views.ranks : NULL;
    trainer->inconsistent = true;
    sgs_status status = make_room(trainer, found->n);
    trainer->fixed = found->fixed;
    if (!status) // before reading: other sizes reset the depth bounds
        status = restore_images(trainer, progress->resolution ? progress->resolution : 1);
    status = sgs_ranks_agree(ranks, status);
    if (status)
        return status;
    if (sections)
        sections->pass = SGSI_SECTIONS_READ;
    state_visit visit = visit_of(sections, trainer, found->n, SGSI_SECTIONS_READ);
    visit_state(&visit);
    status = visit.status;
    if (!status) // rank 0 alone knows that a read failed
        status = sgs_ranks_agree(ranks, sections ? sections->status : SGS_STATUS_OK);
    if (status)
        return status;
    restore_progress(trainer, progress);
    sgsi_free((void *)trainer->regions.regions); // of the state before
    trainer->regions = (sgs_regions){0};
    trainer->stop_text[progress->stop ? sizeof trainer->stop_text - 1 : 0] = 0;
    trainer->views.rebuild = true;
    trainer->inconsistent = false;
    if (sgsi_trainer_opacity_is_linear(trainer))
        sgs_gaussians_declare_linear_opacity(trainer->model);
    return SGS_STATUS_OK;
}

sgs_status sgs_trainer_load_checkpoint(sgs_trainer *trainer, const char *path)
{
    sgsi_sections sections;
    contents found = {0};
    sgs_ranks *ranks = sgsi_trainer_is_shared(trainer) ? trainer->views.ranks : NULL;
    const bool reads = !sgsi_trainer_rank(trainer);
    sgsi_trainer_release(trainer);
    sgs_status status = reads ? open_file(&sections, trainer, path, &found) : SGS_STATUS_OK;
    const bool opened = reads && !status;
    if (ranks)
        status = sgsi_ranks_copy(ranks, status, SGS_RANKS_OTHER, &found, sizeof found);
    if (!status)
        status = read_state(reads ? &sections : NULL, trainer, &found);
    if (opened)
        sgsi_sections_close(&sections);
    return status;
}
