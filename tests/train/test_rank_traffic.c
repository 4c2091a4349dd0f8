// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The predicted traffic of ranks, from the lists of one process, equals what ranks count: calls,
// messages and bytes of every rank in every iteration, by purpose.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/trainer.h"
#include "support/ranks_support.h"
#include "train/rank_traffic.h"
#include "train/trainer_state.h"
#include "train/view_ranks.h"

enum { ITERATIONS = 90, MAX_RANKS = 4 };

typedef struct counts {
    sgs_ranks_traffic sent[SGS_RANKS_PURPOSE_COUNT];
} counts;

typedef struct training {
    sgs_train_options options;
    counts sent[ITERATIONS]; // of one rank
    bool structural[ITERATIONS];
} training;

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 2;
    return (int)sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

static counts counted(const sgs_ranks *ranks)
{
    counts all;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k)
        all.sent[k] = sgs_ranks_traffic_get(ranks, (sgs_ranks_purpose)k);
    return all;
}

static void run_rank(void *context, sgs_ranks *ranks)
{
    training *t = context;
    sgs_trainer *trainer = NULL;
    if (sgs_trainer_create(scene, &t->options, &trainer) || sgs_trainer_ranks_set(trainer, ranks))
        abort();
    for (int i = 0; i < ITERATIONS; ++i) {
        const counts before = counted(ranks);
        sgs_step_info info;
        if (sgs_trainer_step(trainer, &info))
            abort();
        t->structural[i] = info.structural;
        t->sent[i] = counted(ranks);
        for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k) {
            t->sent[i].sent[k].calls -= before.sent[k].calls;
            t->sent[i].sent[k].messages -= before.sent[k].messages;
            t->sent[i].sent[k].bytes -= before.sent[k].bytes;
        }
    }
    sgs_trainer_destroy(trainer);
}

// One process with the costs of the cells at the last visit of each view.
typedef struct single {
    sgs_trainer *trainer;
    sgsi_tile_cost *tiles;
    float **costs; // [views][cells], NULL before the first visit
} single;

static void predict_step(single *s, int ranks, sgsi_rank_traffic *traffic)
{
    sgs_step_info info;
    assert_int_equal(sgs_trainer_step(s->trainer, &info), SGS_STATUS_OK);
    const sgs_view *source = &scene->views[info.view];
    const sgs_render_options options = sgs_render_options_default();
    const sgsi_rays *rays;
    sgsi_view view;
    assert_int_equal(sgsi_ray_cache_get(s->trainer->views.rays, &source->camera, &rays),
                     SGS_STATUS_OK);
    sgsi_view_set(&view, rays, &source->pose, &options);
    const sgsi_rank_input input = {.tracer = s->trainer->views.tracer,
                                   .view = &view,
                                   .rows = info.gaussians,
                                   .cell_costs = s->costs[info.view],
                                   .tiles = s->tiles,
                                   .exposure = s->trainer->options.exposure};
    assert_int_equal(sgsi_rank_traffic_predict(&input, ranks, traffic), SGS_STATUS_OK);
    size_t traced = 0, hit = 0;
    for (int r = 0; r < ranks; ++r) {
        traced += traffic[r].traced;
        hit += traffic[r].hit;
    }
    // Lists also hold the hits that end rays.
    assert_true(hit >= info.visible && hit <= info.visible + info.visible / 100);
    assert_true(traced >= hit && traced <= info.gaussians);
    if (!s->costs[info.view])
        s->costs[info.view] = calloc(rays->cells.count, sizeof(float));
    for (size_t i = 0; i < rays->cells.count; ++i)
        s->costs[info.view][i] = (float)sgsi_cell_cost(&rays->cells, s->tiles, i);
}

// Returns true if the headers of the calls agree, too: an iteration in which a buffer grows has
// more calls.
static bool compare(const sgsi_rank_traffic *expected, const counts *actual, int iteration,
                    int rank, bool structural)
{
    static const sgs_ranks_purpose purposes[] = {SGS_RANKS_RECORDS, SGS_RANKS_IMAGE, SGS_RANKS_SUMS,
                                                 SGS_RANKS_GRADIENTS};
    for (size_t k = 0; k < sizeof purposes / sizeof *purposes; ++k) {
        const sgs_ranks_traffic *a = &expected->sent[purposes[k]], *b = &actual->sent[purposes[k]];
        if (a->calls != b->calls || a->messages != b->messages || a->bytes != b->bytes)
            fail_msg("iteration %d, rank %d, %s: predicted %ju calls, %ju messages, %ju bytes, "
                     "counted %ju, %ju, %ju",
                     iteration, rank, sgs_ranks_purpose_name(purposes[k]), (uintmax_t)a->calls,
                     (uintmax_t)a->messages, (uintmax_t)a->bytes, (uintmax_t)b->calls,
                     (uintmax_t)b->messages, (uintmax_t)b->bytes);
    }
    const sgs_ranks_traffic *a = &expected->sent[SGS_RANKS_STATUS],
                            *b = &actual->sent[SGS_RANKS_STATUS];
    assert_true(structural || (a->bytes <= b->bytes && a->messages <= b->messages));
    return !memcmp(a, b, sizeof *a);
}

static void check(int ranks, bool exposure)
{
    training *all = calloc(MAX_RANKS, sizeof *all);
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 150;
    options.exposure = exposure;
    for (int r = 0; r < ranks; ++r)
        all[r].options = options;
    ranks_run(ranks, all, sizeof *all, run_rank);
    single s = {.tiles = calloc(100000, sizeof *s.tiles),
                .costs = calloc(scene->view_count, sizeof *s.costs)};
    assert_int_equal(sgs_trainer_create(scene, &options, &s.trainer), SGS_STATUS_OK);
    sgsi_tracer_watch_tiles(s.trainer->views.tracer, s.tiles);
    int same_headers = 0, structural = 0;
    uint64_t bytes = 0;
    for (int i = 0; i < ITERATIONS; ++i) {
        sgsi_rank_traffic traffic[MAX_RANKS];
        predict_step(&s, ranks, traffic);
        structural += all[0].structural[i];
        for (int r = 0; r < ranks; ++r) {
            same_headers += compare(&traffic[r], &all[r].sent[i], i + 1, r, all[r].structural[i]);
            bytes += traffic[r].sent[SGS_RANKS_RECORDS].bytes;
        }
    }
    print_message("%d ranks: %ju bytes of records, %d updates\n", ranks, (uintmax_t)bytes,
                  structural);
    assert_true(bytes > 0 && structural > 0);
    assert_true(same_headers > ranks * ITERATIONS / 2);
    for (size_t i = 0; i < scene->view_count; ++i)
        free(s.costs[i]);
    free(s.costs);
    sgs_trainer_destroy(s.trainer);
    free(s.tiles);
    free(all);
}

static void predicted_traffic_is_counted(void **state)
{
    (void)state;
    check(2, false);
    check(3, true);
    check(4, false);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(predicted_traffic_is_counted),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
