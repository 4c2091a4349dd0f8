// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Training on several ranks, which are threads of this process here: the model, losses and
// decisions are bit for bit those of one process, for all pipelines with SPARE-GS, with exposure,
// masks and HDR photos, for random divisions of the images, and after a checkpoint was loaded
// by another number of ranks. A failure on one rank stops all with its message.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "base/threads.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/files_support.h"
#include "support/ranks_support.h"
#include "train/trainer_state.h"

// The last structural update of every pipeline is at 100 or before.
enum { ITERATIONS = 125, MAX_RANKS = 4 };

static sgs_scene *scene, *hdr_scene;
static char folder[64];

// The photos as linear floats up to 1.5, with a masked disc.
static sgs_scene *make_hdr_scene(void)
{
    sgs_view_source *views = calloc(scene->view_count, sizeof *views);
    float **pixels = calloc(scene->view_count, sizeof *pixels);
    uint8_t **masks = calloc(scene->view_count, sizeof *masks);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_photo *photo;
        assert_int_equal(sgs_scene_photo(scene, i, &photo), SGS_STATUS_OK);
        const size_t count = (size_t)photo->width * (size_t)photo->height;
        pixels[i] = malloc(3 * count * sizeof(float));
        masks[i] = malloc(count);
        for (size_t k = 0; k < count; ++k) {
            const double x = (double)(k % (size_t)photo->width) / photo->width - 0.4,
                         y = (double)(k / (size_t)photo->width) / photo->height - 0.6;
            masks[i][k] = x * x + y * y < 0.02 ? 0 : 255;
            for (size_t c = 0; c < 3; ++c)
                pixels[i][3 * k + c] = 1.5f * sgs_photo_value(photo, c * count + k);
        }
        views[i] = (sgs_view_source){.name = scene->views[i].name,
                                     .camera = scene->views[i].camera,
                                     .pose = scene->views[i].pose,
                                     .pixel_type = SGS_PIXEL_FLOAT,
                                     .channels = 3,
                                     .pixels = pixels[i],
                                     .mask = masks[i]};
    }
    sgs_scene_options options = sgs_scene_options_default();
    options.space = SGS_SPACE_LINEAR;
    sgs_scene *made = NULL;
    if (sgs_scene_create(views, scene->view_count, scene->points, scene->colors, scene->point_count,
                         &options, &made))
        fail_msg("%s", sgs_last_error());
    for (size_t i = 0; i < scene->view_count; ++i) {
        free(pixels[i]);
        free(masks[i]);
    }
    free(pixels);
    free(masks);
    free(views);
    return made;
}

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    if (sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene))
        return 1;
    hdr_scene = make_hdr_scene();
    snprintf(folder, sizeof folder, "/tmp/sparegs_ranks_%ld", (long)getpid());
    return 0;
}

static int unload(void **state)
{
    (void)state;
    remove(folder);
    sgs_scene_destroy(scene);
    sgs_scene_destroy(hdr_scene);
    return 0;
}

// ---- One training, on a number of ranks ----

typedef struct result {
    char hash[17];
    double losses[ITERATIONS];
    size_t gaussians, updates;
    sgs_status status;
    bool consistent; // after a failure
    char message[256];
} result;

typedef struct training {
    const sgs_scene *scene;
    sgs_train_options options;
    int first, last;   // iterations; from the checkpoint if first > 0
    bool saves;        // rank 0 saves a checkpoint after the last
    const char *files; // model files of rank 0, without ".ply" and "_3D.ply"; or NULL
    uint64_t cut_seed;
    int collects; // before this iteration the model is collected, and no memory is left; 0 = never
    int failing;  // this rank fails in iteration `failing_at`, -1 = none
    int failing_at;
    size_t failing_allocation;
    size_t memory_limit; // 0 = none
    int limited;         // the rank with this limit, -1 = all
    int odd;             // this rank plans other updates, -1 = none
    result out;
} training;

// All ranks learn that the model of the viewer does not fit, and continue.
static void collect_without_memory(sgs_trainer *trainer, int rank)
{
    sgs_ranks *ranks = trainer->views.ranks;
    assert_int_equal(sgs_ranks_agree(ranks, SGS_STATUS_OK), SGS_STATUS_OK);
    if (!rank)
        sgsi_fail_allocation(1);
    assert_int_equal(sgs_ranks_agree(ranks, SGS_STATUS_OK), SGS_STATUS_OK);
    const sgs_status status = sgs_trainer_collect(trainer);
    sgsi_fail_allocation(0);
    assert_int_equal(status, ranks ? SGS_STATUS_OUT_OF_MEMORY : SGS_STATUS_OK);
    assert_true(sgs_trainer_is_consistent(trainer));
    sgs_ranks_recover(ranks);
}

static bool steps(training *t, sgs_trainer *trainer, int rank)
{
    for (int i = t->first; i < t->last; ++i) {
        sgs_step_info info;
        if (i && i == t->collects)
            collect_without_memory(trainer, rank);
        const bool fails = i == t->failing_at && rank == t->failing;
        if (fails)
            sgsi_fail_allocation(t->failing_allocation);
        t->out.status = sgs_trainer_step(trainer, &info);
        if (fails) // not the others, which may be behind
            sgsi_fail_allocation(0);
        if (t->out.status) {
            snprintf(t->out.message, sizeof t->out.message, "%s", sgs_last_error());
            t->out.consistent = sgs_trainer_is_consistent(trainer);
            return false;
        }
        t->out.losses[i] = info.loss;
        t->out.updates += info.structural;
    }
    return true;
}

static sgs_status write_files(const training *t, sgs_trainer *trainer)
{
    char path[128];
    snprintf(path, sizeof path, "%s.ply", t->files);
    sgs_status status = sgs_trainer_write_ply(trainer, path);
    snprintf(path, sizeof path, "%s_3D.ply", t->files);
    if (!status && sgs_trainer_filter_3d(trainer))
        status = sgs_trainer_write_ply_filter_3d(trainer, path);
    return status;
}

static void run_rank(void *context, sgs_ranks *ranks)
{
    training *t = context;
    if (ranks)
        ranks->cut_seed = t->cut_seed;
    sgs_trainer *trainer = NULL;
    if (sgs_trainer_create(t->scene, &t->options, &trainer) ||
        sgs_trainer_ranks_set(trainer, ranks) ||
        (t->first && sgs_trainer_load_checkpoint(trainer, folder)))
        abort();
    if (t->limited < 0 || t->limited == sgs_ranks_rank(ranks))
        sgs_trainer_memory_limit_set(trainer, t->memory_limit, 0);
    if (ranks && t->odd == sgs_ranks_rank(ranks))
        trainer->schedule.threshold_factor *= 0.5;
    if (steps(t, trainer, sgs_ranks_rank(ranks))) {
        t->out.status = sgs_trainer_hash(trainer, t->out.hash);
        t->out.gaussians = sgs_trainer_count(trainer);
        if (t->saves)
            t->out.status = sgs_trainer_save_checkpoint(trainer, folder);
        if (t->files)
            t->out.status = write_files(t, trainer);
    }
    sgs_trainer_destroy(trainer);
}

// Trains on `count` ranks, 0 = a plain training. out [count].
static void train(const training *plan, int count, result *out)
{
    training all[MAX_RANKS];
    const int members = count ? count : 1;
    for (int r = 0; r < members; ++r)
        all[r] = *plan;
    if (count)
        ranks_run(count, all, sizeof *all, run_rank);
    else
        run_rank(&all[0], NULL);
    sgsi_fail_allocation(0); // rank 1 may have ended before the step of another one
    for (int r = 0; r < members; ++r)
        out[r] = all[r].out;
}

static training plan_of(sgs_pipeline pipeline)
{
    training plan = {.scene = scene,
                     .options = sgs_train_options_default(),
                     .last = ITERATIONS,
                     .failing = -1,
                     .limited = -1,
                     .odd = -1,
                     .failing_at = -1};
    plan.options.iterations = ITERATIONS;
    plan.options.pipeline = pipeline;
    plan.options.filter = pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    plan.options.spare = SGS_SPARE_BMD | SGS_SPARE_RAP | SGS_SPARE_EDT;
    return plan;
}

static void assert_same(const result *expected, const result *actual, int count, const char *what)
{
    for (int r = 0; r < count; ++r) {
        if (actual[r].status)
            fail_msg("%s: %s", what, actual[r].message);
        if (strcmp(expected->hash, actual[r].hash))
            fail_msg("%s, rank %d of %d: model %s, expected %s", what, r, count, actual[r].hash,
                     expected->hash);
        assert_int_equal(actual[r].gaussians, expected->gaussians);
        assert_int_equal(actual[r].updates, expected->updates);
        assert_memory_equal(actual[r].losses, expected->losses, sizeof expected->losses);
    }
}

// Compares one process with `count` ranks and, if `more` is not 0, with `more` ranks.
static result compare(training *plan, int count, int more, const char *what)
{
    result expected, actual[MAX_RANKS];
    train(plan, 0, &expected);
    assert_int_equal(expected.status, SGS_STATUS_OK);
    assert_true(expected.updates > 1);
    for (; count; count = more, more = 0) {
        plan->cut_seed = (uint64_t)count;
        train(plan, count, actual);
        assert_same(&expected, actual, count, what);
    }
    return expected;
}

// ---- Tests ----

// Plain trainings with the plan of each pipeline.
static result of_one_process[SGS_PIPELINE_COUNT];

static void every_pipeline_gives_the_bits_of_one_process(void **state)
{
    (void)state;
    static const char *const names[] = {"3dgs", "mip", "taming", "dash", "fastgs", "mcmc"};
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        training plan = plan_of((sgs_pipeline)pipeline);
        of_one_process[pipeline] = compare(&plan, 2 + pipeline % 3, 0, names[pipeline]);
    }
}

// The test above has 2 to 4.
static void one_and_four_ranks_give_the_same_bits(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_3DGS);
    plan.options.exposure = true;
    compare(&plan, 1, MAX_RANKS, "3dgs with exposure");
}

static void masks_and_hdr_give_the_same_bits(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_TAMING);
    plan.scene = hdr_scene;
    plan.options.background_random = true;
    compare(&plan, 3, 0, "masked HDR");
}

static void batches_of_views_give_the_same_bits(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_MCMC);
    plan.options.batch = 3;
    compare(&plan, 2, 0, "mcmc with batches of three views");
}

// Also after the model could not be collected.
static void cuts_by_cost_give_the_same_bits(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_FASTGS);
    plan.collects = ITERATIONS / 2;
    result actual[MAX_RANKS];
    train(&plan, 3, actual);
    assert_same(&of_one_process[SGS_PIPELINE_FASTGS], actual, 3, "fastgs, by cost");
    plan.last = plan.collects + 1; // one process has nothing to collect
    train(&plan, 0, actual);
    assert_int_equal(actual[0].status, SGS_STATUS_OK);
}

// 3 ranks, then 2, then one process.
static void another_number_of_ranks_resumes(void **state)
{
    (void)state;
    for (int exposure = 0; exposure < 2; ++exposure) {
        training plan = plan_of(exposure ? SGS_PIPELINE_TAMING : SGS_PIPELINE_MCMC);
        result expected, actual[MAX_RANKS];
        plan.options.exposure = exposure;
        if (exposure)
            train(&plan, 0, &expected);
        else
            expected = of_one_process[SGS_PIPELINE_MCMC];
        static const int ranks[] = {3, 2, 0}, ends[] = {61, 104, ITERATIONS};
        plan.saves = true;
        for (int part = 0; part < 3; ++part) {
            plan.first = part ? ends[part - 1] : 0;
            plan.last = ends[part];
            train(&plan, ranks[part], actual);
            assert_int_equal(actual[0].status, SGS_STATUS_OK);
        }
        assert_string_equal(actual[0].hash, expected.hash);
    }
}

static void assert_same_files(const char *a, const char *b, const char *suffix)
{
    char paths[2][160];
    size_t sizes[2];
    unsigned char *bytes[2];
    for (int k = 0; k < 2; ++k) {
        snprintf(paths[k], sizeof paths[k], "%s%s.ply", k ? b : a, suffix);
        bytes[k] = file_get(paths[k], &sizes[k]);
        remove(paths[k]);
    }
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(bytes[0], bytes[1], sizes[0]);
    free(bytes[0]);
    free(bytes[1]);
}

// With a 3D filter, and with opacities that are linear at the end.
static void model_files_have_the_bytes_of_one_process(void **state)
{
    (void)state;
    for (int mip = 0; mip < 2; ++mip) {
        training plan = plan_of(SGS_PIPELINE_TAMING);
        result ignored[MAX_RANKS];
        char files[2][96];
        plan.options.iterations = plan.last = 60;
        plan.options.filter = mip ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
        if (!mip)
            plan.options.pipeline_options.taming_opacity = SGS_TAMING_LINEAR;
        for (int k = 0; k < 2; ++k) {
            snprintf(files[k], sizeof files[k], "%s_%d", folder, k);
            plan.files = files[k];
            train(&plan, k ? 3 : 0, ignored);
            assert_int_equal(ignored[0].status, SGS_STATUS_OK);
        }
        assert_same_files(files[0], files[1], "");
        if (mip)
            assert_same_files(files[0], files[1], "_3D");
    }
}

// Trains with the n-th allocation after rank 1 has begun the iteration failing: all ranks stop with
// one message. Returns the number of failures, 0 or 1.
static int fail_at(training *plan, int iteration, size_t n)
{
    result actual[MAX_RANKS];
    plan->failing = 1;
    plan->failing_at = iteration;
    plan->failing_allocation = n;
    train(plan, 3, actual);
    for (int r = 0; r < 3; ++r) {
        assert_int_equal(actual[r].status, actual[0].status);
        assert_string_equal(actual[r].message, actual[0].message);
    }
    if (actual[0].status)
        assert_non_null(strstr(actual[0].message, "rank "));
    return actual[0].status != SGS_STATUS_OK;
}

static void a_failure_stops_all_ranks(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_TAMING);
    plan.options.iterations = plan.last = 60;
    int failures = 0;
    sgsi_threads_set(1);
    for (size_t n = 1; n <= 40; n += 3) // allocates buffers; updates the structure
        failures += fail_at(&plan, n % 2 ? 0 : 20, n);
    sgsi_threads_set(0);
    assert_true(failures > 3);
}

// The ranks ask each other whether an update fits into the memory limit. One that has failed before
// does not take part, which is not a refusal.
static void a_failed_update_is_not_refused(void **state)
{
    (void)state;
    training plan = plan_of(SGS_PIPELINE_3DGS);
    plan.options.iterations = 60;
    plan.last = 22;
    plan.memory_limit = SIZE_MAX / 4;
    int failures = 0;
    sgsi_threads_set(1);
    for (size_t n = 1; n <= 160; n += 8)
        failures += fail_at(&plan, 20, n);
    sgsi_threads_set(0);
    assert_true(failures > 11);
}

// A limit that admits the updates, and one that refuses the first.
static void one_rank_may_have_a_memory_limit(void **state)
{
    (void)state;
    result actual[MAX_RANKS], unlimited;
    training plan = plan_of(SGS_PIPELINE_MCMC);
    plan.options.iterations = 90;
    plan.options.pipeline_options.mcmc_growth = 1.0;
    plan.last = 52; // one update, to more primitives
    train(&plan, 0, &unlimited);
    assert_true(unlimited.updates > 0);
    plan.limited = 1;
    plan.memory_limit = SIZE_MAX / 4;
    train(&plan, 3, actual);
    for (int r = 0; r < 3; ++r) {
        if (actual[r].status)
            fail_msg("%s", actual[r].message);
        assert_int_equal(actual[r].updates, unlimited.updates);
    }
    assert_string_equal(actual[0].hash, unlimited.hash);
    plan.memory_limit = 1;
    train(&plan, 3, actual);
    for (int r = 0; r < 3; ++r) {
        assert_int_equal(actual[r].status, SGS_STATUS_OUT_OF_MEMORY);
        assert_non_null(strstr(actual[r].message, "exceeds the memory limit"));
        assert_true(actual[r].consistent);
    }
}

// As with C libraries that differ: the ranks notice it before anything changes.
static void other_plans_of_a_rank_stop_all(void **state)
{
    (void)state;
    result actual[MAX_RANKS];
    training plan = plan_of(SGS_PIPELINE_3DGS);
    plan.odd = 1;
    train(&plan, 3, actual);
    for (int r = 0; r < 3; ++r) {
        assert_int_equal(actual[r].status, SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(actual[r].message, "differs from that of rank 0"));
        assert_true(actual[r].consistent);
        assert_int_equal(actual[r].updates, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_pipeline_gives_the_bits_of_one_process), // before those that use it
        cmocka_unit_test(one_and_four_ranks_give_the_same_bits),
        cmocka_unit_test(masks_and_hdr_give_the_same_bits),
        cmocka_unit_test(batches_of_views_give_the_same_bits),
        cmocka_unit_test(cuts_by_cost_give_the_same_bits),
        cmocka_unit_test(another_number_of_ranks_resumes),
        cmocka_unit_test(model_files_have_the_bytes_of_one_process),
        cmocka_unit_test(a_failure_stops_all_ranks),
        cmocka_unit_test(a_failed_update_is_not_refused),
        cmocka_unit_test(one_rank_may_have_a_memory_limit),
        cmocka_unit_test(other_plans_of_a_rank_stop_all),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
