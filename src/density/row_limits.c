// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "density/row_limits.h"

#include "base/core.h"
#include "density/pipeline.h"

// Replacement at the cap: rows below this opacity, up to this share of the cap per update. Measured
// at ad74728, 7000 iterations with SPARE-GS, every eighth view held out; PSNR, SSIM, FLIP and
// sharpness with 0.1 and 5 % | with 0.4 and 10 %. Plush at 336x252 with 23 334: 28.92, .9198,
// .1414, .485 | 29.81, .9223, .1245, .501. Room at 480x270 with 12 000: 32.04, .9504, .1083, 1.091
// | 32.03, .9492, .1083, 1.105 (training views 34.41 | 34.61). One view of plush: 31.39 | 31.49.
#define REPLACED_OPACITY 0.4f
#define REPLACED_SHARE 0.10

// Rows to choose from, [count] each.
typedef struct ranking {
    double *score; // largest first
    uint8_t *candidate, *chosen;
} ranking;

static void free_ranking(ranking *r)
{
    sgsi_free(r->score);
    sgsi_free(r->candidate);
    sgsi_free(r->chosen);
    *r = (ranking){0};
}

static sgs_status make_ranking(size_t count, ranking *r)
{
    *r = (ranking){.score = sgsi_alloc(count, sizeof *r->score),
                   .candidate = sgsi_alloc(count, 1),
                   .chosen = sgsi_alloc(count, 1)};
    if (r->score && r->candidate && r->chosen)
        return SGS_STATUS_OK;
    free_ranking(r);
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to rank %zu primitives", count);
}

static sgs_status choose(const ranking *r, size_t count, size_t wanted)
{
    return sgsi_select_best(r->score, r->candidate, count, wanted, r->chosen);
}

// True if row i is removed. A split row is replaced by its children, even if RAP marks it. (A row
// that grows by its absolute gradient and is redundant by its signed one is replaced by its clone;
// this is rare: one or two rows per update.)
static bool loses_row(const sgsi_density_columns *columns, size_t i)
{
    return columns->action[i] != SGSI_ACTION_SPLIT && sgsi_density_is_removed(columns, i);
}

// A row whose clone or children the pipeline removes does not grow: a split row is removed, a
// cloned one treated as without its clone.
static void drop_empty_growth(sgsi_density_columns *columns)
{
    for (size_t i = 0; i < columns->count; ++i) {
        if (columns->action[i] == SGSI_ACTION_KEEP || !columns->prune_children[i])
            continue;
        columns->removed[i] |= columns->action[i] == SGSI_ACTION_SPLIT;
        columns->action[i] = SGSI_ACTION_KEEP;
        columns->prune_children[i] = 0;
    }
}

sgs_status sgsi_limit_removal(const sgsi_density_options *options, sgsi_density_columns *columns)
{
    const size_t n = columns->count;
    size_t room = (size_t)(options->removal_max * (double)n), wanted = 0;
    if (options->removal_max <= 0.0)
        return SGS_STATUS_OK;
    drop_empty_growth(columns);
    for (size_t i = 0; i < n; ++i) {
        room -= columns->degenerate[i] && room;
        wanted += !columns->degenerate[i] && loses_row(columns, i);
    }
    if (wanted <= room)
        return SGS_STATUS_OK;
    ranking r;
    sgs_status status = make_ranking(n, &r);
    if (status)
        return status;
    for (size_t i = 0; i < n; ++i) {
        r.candidate[i] = !columns->degenerate[i] && loses_row(columns, i);
        r.score[i] = -(double)columns->opacity[i];
    }
    status = choose(&r, n, room);
    for (size_t i = 0; i < n && !status; ++i)
        if (r.candidate[i] && !r.chosen[i])
            columns->removed[i] = columns->redundant[i] = 0;
    free_ranking(&r);
    return status;
}

// Removes up to `wanted` rows of low opacity that do not grow, those of least opacity times
// footprint first. Rows not seen since the last update stay: their footprint is unknown. *made: the
// number of rows removed.
static sgs_status make_room(sgsi_density_columns *columns, const sgsi_statistics *statistics,
                            size_t wanted, size_t *made)
{
    const size_t n = columns->count;
    ranking r;
    *made = 0;
    sgs_status status = make_ranking(n, &r);
    if (status)
        return status;
    for (size_t i = 0; i < n; ++i) {
        const double radius = (double)statistics->radius_max[i];
        r.candidate[i] = columns->action[i] == SGSI_ACTION_KEEP &&
                         !sgsi_density_is_removed(columns, i) && statistics->visible_count[i] &&
                         columns->opacity[i] < REPLACED_OPACITY;
        r.score[i] = -(double)columns->opacity[i] * radius * radius;
    }
    status = choose(&r, n, wanted);
    for (size_t i = 0; i < n && !status; ++i) {
        columns->removed[i] |= r.chosen[i];
        *made += r.chosen[i];
    }
    free_ranking(&r);
    return status;
}

// Rows that an update may replace at the cap. With a limit on removal, they count as removed.
static size_t max_replaced(const sgsi_density_options *options, size_t count, size_t survivors)
{
    const size_t share = (size_t)(REPLACED_SHARE * (double)options->max_count);
    if (options->opacity_is_reset)
        return 0;
    if (options->removal_max <= 0.0)
        return share;
    const size_t limit = (size_t)(options->removal_max * (double)count),
                 removed = count - survivors, left = limit > removed ? limit - removed : 0;
    return share < left ? share : left;
}

// Counts the rows that grow and those that are not removed.
static void count_rows(const sgsi_density_columns *columns, size_t *growing, size_t *survivors)
{
    *growing = *survivors = 0;
    for (size_t i = 0; i < columns->count; ++i) {
        *growing += columns->action[i] != SGSI_ACTION_KEEP && !columns->prune_children[i];
        *survivors += !loses_row(columns, i);
    }
}

bool sgsi_growth_exceeds_cap(const sgsi_density_options *options,
                             const sgsi_density_columns *columns)
{
    size_t growing, survivors;
    count_rows(columns, &growing, &survivors);
    return options->max_count && survivors + growing > options->max_count;
}

sgs_status sgsi_limit_growth(const sgsi_density_options *options, sgsi_density_columns *columns,
                             const sgsi_statistics *statistics)
{
    const size_t n = columns->count, cap = options->max_count;
    size_t wanted, made = 0, survivors;
    if (!cap)
        return SGS_STATUS_OK;
    drop_empty_growth(columns);
    count_rows(columns, &wanted, &survivors);
    size_t room = survivors < cap ? cap - survivors : 0;
    if (wanted <= room)
        return SGS_STATUS_OK;
    const size_t lacking = wanted - room, most = max_replaced(options, n, survivors);
    sgs_status status = make_room(columns, statistics, lacking < most ? lacking : most, &made);
    room += made;
    if (status || wanted <= room)
        return status;
    ranking r;
    status = make_ranking(n, &r);
    if (status)
        return status;
    for (size_t i = 0; i < n; ++i) {
        r.candidate[i] = columns->action[i] != SGSI_ACTION_KEEP;
        r.score[i] = (double)columns->priority[i];
    }
    status = choose(&r, n, room);
    for (size_t i = 0; i < n && !status; ++i) {
        if (r.chosen[i] || columns->action[i] == SGSI_ACTION_KEEP)
            continue;
        if (columns->action[i] == SGSI_ACTION_SPLIT) // counted as a survivor
            columns->removed[i] = columns->redundant[i] = 0;
        columns->action[i] = SGSI_ACTION_KEEP;
    }
    free_ranking(&r);
    return status;
}
