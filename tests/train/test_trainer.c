// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The trainer on the bundled scene at an eighth of its size: the loss falls; the bits are the same
// with any number of threads, with AVX2 and AVX-512 and after resuming; damaged checkpoints are
// refused; the cap holds.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "base/core.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    return room_load_split(8, 8, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

static sgs_train_options short_run(int iterations)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.spare = SGS_SPARE_BMD | SGS_SPARE_RAP;
    return options;
}

static void digest(const sgs_trainer *trainer, char hex[17])
{
    sgs_gaussians_hash(sgs_trainer_model(trainer), hex);
}

static void training_lowers_the_loss_and_grows_the_model(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(300);
    sgs_trainer *trainer = trainer_create(scene, &options);
    const size_t before = sgs_trainer_model(trainer)->count;
    const sgs_step_info first = trainer_run(trainer, 10), last = trainer_run(trainer, 290);
    assert_int_equal(last.stop, SGS_STOP_SCHEDULE);
    assert_true(last.loss_average < 0.6 * first.loss_average);
    assert_true(last.psnr_average > first.psnr_average + 4);
    assert_true(last.gaussians > before);
    sgs_step_info info;
    assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_LIMIT);
    sgs_trainer_destroy(trainer);
}

static void bits_do_not_depend_on_threads_or_vector_width(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(120);
    char reference[17] = "";
    const sgs_isa best = sgs_isa_get();
    for (int isa = SGS_ISA_BASELINE; isa <= SGS_ISA_AVX512; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        if (isa == SGS_ISA_AVX2) // the only ones with fused operations on x86
            reference[0] = 0;
        for (int threads = 1; threads <= 3; threads += 2) {
            sgs_threads_set(threads);
            sgs_trainer *trainer = trainer_create(scene, &options);
            trainer_run(trainer, 120);
            char hex[17];
            digest(trainer, hex);
            if (reference[0])
                assert_string_equal(hex, reference);
            memcpy(reference, hex, sizeof hex);
            sgs_trainer_destroy(trainer);
        }
    }
    sgs_threads_set(0);
    sgs_isa_set(best);
}

// train.py of 3DGS: `if iteration < opt.iterations: optimizer.step()`. Resuming with more
// iterations makes the step.
static void the_last_iteration_makes_no_step(void **state)
{
    (void)state;
    char path[64], before[17], after[17], whole[17], resumed[17];
    snprintf(path, sizeof path, "/tmp/sparegs_last_%ld", (long)getpid());
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        sgs_train_options options = short_run(12);
        options.pipeline = (sgs_pipeline)pipeline;
        options.schedule = SGS_SCHEDULE_PAPER;
        options.exposure = true;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, 11);
        digest(trainer, before);
        const sgs_step_info last = trainer_run(trainer, 1);
        assert_int_equal(last.stop, SGS_STOP_SCHEDULE);
        assert_true(last.loss > 0);
        digest(trainer, after);
        assert_string_equal(before, after);
        const double *map = sgs_trainer_exposure(trainer, last.view); // of the first visit
        for (int k = 0; k < 12; ++k)
            assert_true(map[k] == (k % 5 == 0));
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        sgs_trainer_destroy(trainer);

        options.iterations = 30;
        trainer = trainer_create(scene, &options);
        trainer_run(trainer, 30);
        digest(trainer, whole);
        sgs_trainer_destroy(trainer);
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        assert_int_equal(sgs_trainer_iteration(trainer), 12);
        trainer_run(trainer, 18);
        assert_int_equal(sgs_trainer_iteration(trainer), 30);
        digest(trainer, resumed);
        sgs_trainer_destroy(trainer);
        assert_string_equal(whole, resumed);
    }
    unlink(path);
}

// Three primitives in front of the camera, five too faint for a hit, the others behind it.
static void visible_primitives_are_counted_one_by_one(void **state)
{
    (void)state;
    enum { COUNT = 40, HIT = 3, FAINT = 5 };
    sgs_scene one = *scene;
    one.view_count = 1;
    one.views = &scene->views[1];
    const sgs_pose *pose = &one.views[0].pose;
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(COUNT, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, COUNT), SGS_STATUS_OK);
    for (int i = 0; i < COUNT; ++i) {
        float p[SGS_PARAM_COUNT] = {[SGS_PARAM_ROTATION] = 1};
        const double z = i < HIT + FAINT ? 4 + 0.1 * i : -4 - 0.1 * i;
        const double camera[3] = {0.1 * (i % HIT - 1) * z, 0, z};
        for (int k = 0; k < 3; ++k) {
            for (int row = 0; row < 3; ++row)
                p[SGS_PARAM_MEAN + k] +=
                    (float)(pose->rotation[3 * row + k] * (camera[row] - pose->translation[row]));
            p[SGS_PARAM_SCALE + k] = logf(0.1f);
        }
        p[SGS_PARAM_OPACITY] = i < HIT || i >= HIT + FAINT ? 0 : -8;
        sgs_gaussians_set(model, (size_t)i, p);
    }
    sgs_train_options options = short_run(100);
    options.init = model;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(&one, &options, &trainer), SGS_STATUS_OK);
    assert_int_equal(trainer_run(trainer, 1).visible, HIT);
    sgs_trainer_destroy(trainer);
    sgs_gaussians_destroy(model);
}

static void another_seed_gives_other_bits(void **state)
{
    (void)state;
    char hex[2][17];
    for (int k = 0; k < 2; ++k) {
        sgs_train_options options = short_run(60);
        options.seed = (uint64_t)k;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, 60);
        digest(trainer, hex[k]);
        sgs_trainer_destroy(trainer);
    }
    assert_string_not_equal(hex[0], hex[1]);
}

static void checkpoint_resumes_to_the_same_bits(void **state)
{
    (void)state;
    char path[64], straight[17], resumed[17];
    snprintf(path, sizeof path, "/tmp/sparegs_checkpoint_%ld", (long)getpid());
    const sgs_train_options options = short_run(150);
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, 83);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
    trainer_run(trainer, 67);
    digest(trainer, straight);
    sgs_trainer_destroy(trainer);
    trainer = trainer_create(scene, &options);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_iteration(trainer), 83);
    trainer_run(trainer, 67);
    digest(trainer, resumed);
    sgs_trainer_destroy(trainer);
    assert_string_equal(straight, resumed);
    unlink(path);
}

static void write_bytes(const char *path, const uint8_t *bytes, size_t size)
{
    FILE *stream = fopen(path, "wb");
    assert_non_null(stream);
    assert_int_equal(fwrite(bytes, 1, size, stream), size);
    fclose(stream);
}

static void damaged_or_foreign_checkpoints_are_refused_and_change_nothing(void **state)
{
    (void)state;
    char path[64], before[17], after[17];
    snprintf(path, sizeof path, "/tmp/sparegs_checkpoint_%ld", (long)getpid());
    sgs_train_options options = short_run(100);
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, 5);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
    uint8_t *bytes;
    size_t size;
    assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
    trainer_run(trainer, 1);
    digest(trainer, before);
    const size_t cuts[] = {0, 1, 7, 31, 40, size / 3, size - 9, size - 1};
    for (size_t k = 0; k < sizeof cuts / sizeof *cuts; ++k) {
        write_bytes(path, bytes, cuts[k]);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_FORMAT);
        assert_non_null(strstr(sgs_last_error(), path));
    }
    for (size_t k = 0; k < 64; ++k) {
        const size_t at = 16 + k * (size - 16) / 64;
        bytes[at] ^= 0x20;
        write_bytes(path, bytes, size);
        assert_int_not_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        bytes[at] ^= 0x20;
    }
    digest(trainer, after);
    assert_string_equal(before, after);
    sgs_trainer_destroy(trainer);
    options.seed = 5;
    trainer = trainer_create(scene, &options);
    write_bytes(path, bytes, size);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_INVALID_ARGUMENT);
    sgs_trainer_destroy(trainer);
    sgsi_free(bytes);
    unlink(path);
}

static void cap_holds_for_the_initial_cloud_and_for_growth(void **state)
{
    (void)state;
    sgs_train_options options = short_run(200);
    options.max_gaussians = 1000;
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_int_equal(sgs_trainer_model(trainer)->count, 1000);
    for (int i = 0; i < 200; ++i)
        assert_true(trainer_run(trainer, 1).gaussians <= 1000);
    sgs_trainer_destroy(trainer);
}

// Rows with opacities from 0 to 1, every 50th not finite.
static sgs_gaussians *trained_model(bool linear)
{
    sgs_gaussians *model;
    const sgs_train_options options = short_run(60);
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, 30);
    const sgs_gaussians *from = sgs_trainer_model(trainer);
    assert_int_equal(sgs_gaussians_create(from->count + 100, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, from->count), SGS_STATUS_OK);
    if (linear)
        sgs_gaussians_declare_linear_opacity(model);
    for (size_t i = 0; i < from->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(from, i, params);
        const float share = (float)(i % 97) / 96.0f;
        params[SGS_PARAM_OPACITY] = linear ? share : 6.0f * share - 3.0f;
        if (i % 50 == 7)
            params[SGS_PARAM_SCALE + 1] = NAN;
        sgs_gaussians_set(model, i, params);
    }
    sgs_trainer_destroy(trainer);
    return model;
}

static void a_model_taken_over_trains_as_its_copy(void **state)
{
    (void)state;
    for (int linear = 0; linear < 2; ++linear)
        for (int part = 0; part < 3; ++part) {
            sgs_train_options options = short_run(60);
            sgs_gaussians *init = trained_model(linear);
            options.max_gaussians = part ? 2000 : 0;
            if (part == 2)
                options.region.high[0] = 0.5f;
            options.init = init;
            sgs_trainer *copied = trainer_create(scene, &options), *taken = NULL;
            options.init = NULL;
            const size_t count = init->count;
            assert_int_equal(sgs_trainer_create_from(scene, &options, &init, &taken),
                             SGS_STATUS_OK);
            assert_null(init);
            assert_true(sgs_trainer_count(taken) < count);
            if (part) // rows beyond the cap need no memory
                assert_int_equal(sgs_trainer_model(taken)->capacity,
                                 sgs_trainer_model(copied)->capacity);
            char hashes[2][17];
            for (int steps = 0; steps < 2; ++steps) {
                digest(copied, hashes[0]);
                digest(taken, hashes[1]);
                assert_string_equal(hashes[0], hashes[1]);
                trainer_run(copied, 8);
                trainer_run(taken, 8);
            }
            sgs_trainer_destroy(copied);
            sgs_trainer_destroy(taken);
        }
    sgs_trainer *none;
    sgs_gaussians *init = trained_model(false);
    sgs_train_options options = short_run(60);
    options.iterations = -1;
    assert_int_equal(sgs_trainer_create_from(scene, &options, &init, &none),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_null(init);
    assert_null(none);
    init = trained_model(false);
    init->sh_degree = 9;
    options = short_run(60);
    options.init = init;
    assert_int_equal(sgs_trainer_create(scene, &options, &none), SGS_STATUS_INVALID_ARGUMENT);
    assert_string_equal(sgs_last_error(), "SH degree 9 of the model is not within 0 to 3");
    sgs_gaussians_destroy(init);
}

static void no_model_to_take_over_replaces_that_of_the_options(void **state)
{
    (void)state;
    sgs_train_options options = short_run(60);
    sgs_trainer *trainers[2];
    char hashes[2][17];
    sgs_gaussians *init = trained_model(false), *none = NULL;
    for (int k = 0; k < 2; ++k) {
        options.init = k ? init : NULL;
        assert_int_equal(sgs_trainer_create_from(scene, &options, &none, &trainers[k]),
                         SGS_STATUS_OK);
        digest(trainers[k], hashes[k]);
        sgs_trainer_destroy(trainers[k]);
    }
    assert_string_equal(hashes[0], hashes[1]);
    sgs_gaussians_destroy(init);
}

static sgs_train_options mcmc_run(int iterations)
{
    sgs_train_options options = short_run(iterations);
    options.pipeline = SGS_PIPELINE_MCMC;
    options.spare_tau_alpha = 0.9; // few rows are faint so early
    return options;
}

static void mcmc_starts_as_its_options_say(void **state)
{
    (void)state;
    sgs_train_options options = mcmc_run(100);
    sgs_trainer *plain, *trainer;
    const sgs_train_options reference = short_run(100);
    plain = trainer_create(scene, &reference);
    for (int paper = 0; paper < 2; ++paper) {
        options.schedule = paper ? SGS_SCHEDULE_PAPER : SGS_SCHEDULE_SCALED;
        trainer = trainer_create(scene, &options);
        const sgs_gaussians *model = sgs_trainer_model(trainer), *before = sgs_trainer_model(plain);
        const double shift = log(0.1) * (paper ? 1 : 100 / 30000.0);
        assert_int_equal(model->count, before->count);
        for (size_t i = 0; i < model->count; ++i) {
            assert_true(*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) == 0); // 0.5
            for (int k = 0; k < 3; ++k)
                assert_true(fabs((double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) -
                                 (double)*sgs_gaussians_at(before, i, SGS_PARAM_SCALE + k) -
                                 shift) <= 1e-5);
        }
        sgs_trainer_destroy(trainer);
    }
    sgs_trainer_destroy(plain);
}

// SPARE-GS off and on; stops around the updates at 50 and 100, resumed with other threads.
static void mcmc_gives_the_same_bits_with_any_threads_and_after_any_stop(void **state)
{
    (void)state;
    enum { LENGTH = 120 };
    const int stops[] = {49, 50, 51, 99, 100, 101};
    enum { STOPS = sizeof stops / sizeof *stops };
    char paths[STOPS][64], straight[17], hash[17];
    for (int k = 0; k < STOPS; ++k)
        snprintf(paths[k], sizeof paths[k], "/tmp/sparegs_mcmc_%ld_%d", (long)getpid(), stops[k]);
    for (int spare = 0; spare < 2; ++spare) {
        sgs_train_options options = mcmc_run(LENGTH);
        options.spare = spare ? SGS_SPARE_BMD | SGS_SPARE_RAP : 0;
        options.max_gaussians = 6000;
        size_t relocated = 0, deleted = 0;
        for (int threads = 1; threads <= 3; threads += 2) {
            sgs_threads_set(threads);
            sgs_trainer *trainer = trainer_create(scene, &options);
            for (int i = 0, stop = 0; i < LENGTH; ++i) {
                if (threads == 1 && stop < STOPS && i == stops[stop])
                    assert_int_equal(sgs_trainer_save_checkpoint(trainer, paths[stop++]),
                                     SGS_STATUS_OK);
                const sgs_step_info info = trainer_run(trainer, 1);
                relocated += info.relocated;
                deleted += info.spare_pruned;
                assert_true(info.gaussians <= 6000);
            }
            digest(trainer, threads > 1 ? hash : straight);
            sgs_trainer_destroy(trainer);
            if (threads > 1)
                assert_string_equal(hash, straight);
        }
        assert_true(relocated > 0);
        assert_int_equal(deleted > 0, spare);
        for (int k = 0; k < STOPS; ++k) {
            sgs_threads_set(2);
            sgs_trainer *trainer = trainer_create(scene, &options);
            assert_int_equal(sgs_trainer_load_checkpoint(trainer, paths[k]), SGS_STATUS_OK);
            unlink(paths[k]);
            trainer_run(trainer, LENGTH - stops[k]);
            digest(trainer, hash);
            assert_string_equal(hash, straight);
            sgs_trainer_destroy(trainer);
        }
    }
    sgs_threads_set(0);
}

// Each option has an effect by the update at 50; for the start scale see above.
static void mcmc_options_change_the_run(void **state)
{
    (void)state;
    char base[17] = "", hash[17] = "";
    for (int k = 0; k < 9; ++k) {
        sgs_train_options options = mcmc_run(110);
        options.optimizer = k == 8 ? SGS_OPTIMIZER_DENSE : SGS_OPTIMIZER_SPARSE;
        sgs_pipeline_options *own = &options.pipeline_options;
        own->mcmc_noise = k == 1 ? 1e5 : -1;
        own->mcmc_opacity_loss *= k == 2 ? 0 : 1;
        own->mcmc_scale_loss *= k == 3 ? 0 : 1;
        own->mcmc_growth *= k == 4 ? 0.01 : 1;
        own->mcmc_start_opacity *= k == 5 ? 0.5 : 1;
        own->mcmc_units = k == 6 ? SGS_MCMC_UNITS_WORLD : SGS_MCMC_UNITS_EXTENT;
        own->mcmc_redundant = k == 7 ? SGS_MCMC_RELOCATE : SGS_MCMC_DELETE;
        sgs_trainer *trainer = trainer_create(scene, &options);
        const sgs_step_info info = trainer_run(trainer, 55);
        digest(trainer, k ? hash : base);
        assert_true(isfinite(info.loss));
        if (k && !strcmp(hash, base))
            fail_msg("variant %d changes nothing", k);
        sgs_trainer_destroy(trainer);
    }
}

static void dense_optimizer_and_random_background_train_too(void **state)
{
    (void)state;
    sgs_train_options options = short_run(150);
    options.optimizer = SGS_OPTIMIZER_DENSE;
    options.background_random = true;
    options.filter = SGS_FILTER_NONE;
    sgs_trainer *trainer = trainer_create(scene, &options);
    const sgs_step_info first = trainer_run(trainer, 10), last = trainer_run(trainer, 140);
    assert_true(last.loss_average < 0.8 * first.loss_average);
    sgs_trainer_destroy(trainer);
}

// Each base pipeline trains, gives the same bits uninterrupted on one thread and resumed on two,
// and obeys the cap.
static void every_pipeline_trains_resumes_and_obeys_the_cap(void **state)
{
    (void)state;
    char path[64];
    snprintf(path, sizeof path, "/tmp/sparegs_checkpoint_%ld", (long)getpid());
    for (int pipeline = SGS_PIPELINE_3DGS + 1; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        sgs_train_options options = short_run(160);
        options.pipeline = (sgs_pipeline)pipeline;
        options.max_gaussians = 6000;
        sgs_trainer *trainer;
        if (sgs_trainer_create(scene, &options, &trainer))
            fail_msg("%s", sgs_last_error());
        char straight[17], resumed[17];
        sgs_threads_set(1);
        const sgs_step_info first = trainer_run(trainer, 10);
        sgs_step_info last = first;
        for (int i = 10; i < 160; ++i) {
            last = trainer_run(trainer, 1);
            assert_true(last.gaussians <= 6000);
            if (i == 90)
                assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        }
        assert_true(last.loss_average < 0.9 * first.loss_average);
        digest(trainer, straight);
        sgs_trainer_destroy(trainer);
        sgs_threads_set(2);
        trainer = trainer_create(scene, &options);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        trainer_run(trainer, 160 - sgs_trainer_iteration(trainer));
        digest(trainer, resumed);
        sgs_trainer_destroy(trainer);
        assert_string_equal(straight, resumed);
    }
    sgs_threads_set(0);
    unlink(path);
}

// A trainer with milestones close to each other.
static sgs_trainer *start_busy(void)
{
    const sgs_train_options options = short_run(400);
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer->schedule.densify_from = 5;
    trainer->schedule.densify_interval = 10;
    trainer->schedule.densify_until = 100;
    trainer->schedule.reset_interval = 20;
    trainer->schedule.reset_until = 100;
    return trainer;
}

static double largest_opacity(const sgs_trainer *trainer)
{
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    double largest = 0;
    for (size_t i = 0; i < model->count; ++i)
        largest =
            fmax(largest, 1 / (1 + exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY))));
    return largest;
}

// Between calls the model is the result of an iteration: the published trainers save it before
// structural updates and opacity resets.
static void updates_and_resets_follow_in_the_next_call(void **state)
{
    (void)state;
    char path[64];
    snprintf(path, sizeof path, "/tmp/sparegs_between_%ld", (long)getpid());
    sgs_trainer *trainer = start_busy();
    const size_t count = sgs_trainer_model(trainer)->count;
    sgs_step_info info = trainer_run(trainer, 10);
    assert_false(info.structural);
    assert_int_equal(sgs_trainer_model(trainer)->count, count);
    assert_int_equal(sgs_trainer_structure_iteration(trainer), 9);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
    info = trainer_run(trainer, 1);
    assert_true(info.structural);
    assert_int_equal(info.structure_iteration, 10);
    assert_int_not_equal(info.gaussians, count);
    assert_int_equal(sgs_trainer_structure_iteration(trainer), 10);
    trainer_run(trainer, 9);
    assert_true(largest_opacity(trainer) > 0.1);
    trainer_run(trainer, 1);
    assert_true(largest_opacity(trainer) < 0.02);
    char whole[17], resumed[17];
    digest(trainer, whole);
    sgs_trainer_destroy(trainer);
    trainer = start_busy();
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_structure_iteration(trainer), 9);
    trainer_run(trainer, 11);
    digest(trainer, resumed);
    assert_string_equal(resumed, whole);
    sgs_trainer_destroy(trainer);
    unlink(path);
}

// Fraction of primitives longer than a tenth of the extent after the update of iteration 30; a
// fifth of the initial cloud is. The reset is at 20, unless the run has none.
static double large_share(int reset_until, bool prunes)
{
    sgs_trainer *trainer = start_busy();
    trainer->schedule.reset_until = reset_until;
    trainer->schedule.prunes_large = prunes;
    trainer_run(trainer, 31);
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    double large = 0;
    for (size_t i = 0; i < model->count; ++i) {
        float longest = -INFINITY;
        for (int k = 0; k < 3; ++k)
            longest = fmaxf(longest, *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k));
        large += exp((double)longest) > 0.1 * scene->extent;
    }
    const double share = large / (double)model->count;
    sgs_trainer_destroy(trainer);
    return share;
}

static void large_primitives_are_pruned_only_after_an_opacity_reset(void **state)
{
    (void)state;
    assert_true(large_share(100, true) < 0.05);
    assert_true(large_share(15, true) > 0.15);
    assert_true(large_share(100, false) > 0.15); // a scaled run
}

// Radii are converted when the image size changes between two updates.
static void radii_follow_the_size_of_the_images(void **state)
{
    (void)state;
    sgs_train_options options = short_run(300);
    options.pipeline = SGS_PIPELINE_DASH;
    sgs_trainer *trainer = trainer_create(scene, &options);
    size_t compared = 0;
    assert_int_equal(sgsi_trainer_reserve_state(trainer), SGS_STATUS_OK);
    for (int k = 0; k < 300; ++k) {
        const sgsi_statistics *s = &trainer->statistics;
        const size_t count = trainer->model->count;
        const int before = trainer->progress.resolution;
        float *radius = malloc(count * sizeof *radius);
        uint32_t *seen = malloc(count * sizeof *seen);
        memcpy(radius, s->radius_max, count * sizeof *radius);
        memcpy(seen, s->visible_count, count * sizeof *seen);
        const sgs_step_info info = trainer_run(trainer, 1);
        const int after = trainer->progress.resolution;
        for (size_t i = 0; i < count && after != before && !info.structural; ++i)
            if (radius[i] > 0 && s->visible_count[i] == seen[i]) { // not in the view of this step
                assert_true(s->radius_max[i] == radius[i] * ((float)before / (float)after));
                ++compared;
            }
        free(radius);
        free(seen);
    }
    assert_true(compared > 10);
    sgs_trainer_destroy(trainer);
}

static void options_out_of_range_are_named(void **state)
{
    (void)state;
    sgs_trainer *trainer;
    sgs_train_options options = short_run(0);
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "iterations"));
    assert_null(trainer);
    options = short_run(10);
    options.spare_grid = 1;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "grid"));
}

// With 30 iterations between updates, a view may be missing: primitives that only it shows have no
// gradient. The option has no effect then, but it has in a run of the published length.
static void unseen_primitives_are_not_redundant_in_short_runs(void **state)
{
    (void)state;
    for (int published = 0; published < 2; ++published) {
        char hashes[2][17];
        for (int visible = 0; visible < 2; ++visible) {
            sgs_train_options options = short_run(published ? 30000 : 200);
            options.spare = SGS_SPARE_RAP;
            options.spare_rap_visible = visible;
            options.spare_tau_alpha = 0.3;
            sgs_trainer *trainer = trainer_create(scene, &options);
            trainer->schedule.densify_from = 10;
            trainer->schedule.densify_interval = 30;
            trainer->schedule.densify_until = 70;
            trainer_run(trainer, 62);
            digest(trainer, hashes[visible]);
            sgs_trainer_destroy(trainer);
        }
        assert_int_equal(strcmp(hashes[0], hashes[1]) == 0, !published);
    }
}

static void scale_scene(double factor)
{
    for (size_t i = 0; i < 3 * scene->point_count; ++i)
        scene->points[i] *= (float)factor;
    for (size_t v = 0; v < scene->view_count; ++v)
        for (int k = 0; k < 3; ++k)
            scene->views[v].pose.translation[k] *= factor;
    for (int k = 0; k < 3; ++k)
        scene->center[k] *= factor;
    scene->extent *= factor;
}

// No threshold in absolute units hides a small scene from its cameras. Runs last, because scaling
// rounds the scene.
static void a_scene_in_small_units_trains_as_well(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(60);
    double losses[2];
    for (int i = 0; i < 2; ++i) {
        sgs_trainer *trainer = trainer_create(scene, &options);
        losses[i] = trainer_run(trainer, 60).loss_average;
        sgs_trainer_destroy(trainer);
        scale_scene(i ? 1e3 : 1e-3);
    }
    print_message("loss %.5f, a thousand times smaller %.5f\n", losses[0], losses[1]);
    assert_true(fabs(losses[1] / losses[0] - 1) < 0.1);
    scene->views[1].pose.translation[2] = 1e19;
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgs_step_info info;
    sgs_status status = SGS_STATUS_OK;
    for (int i = 0; i < 60 && !status; ++i)
        status = sgs_trainer_step(trainer, &info);
    assert_int_equal(status, SGS_STATUS_INVALID_ARGUMENT); // not an assertion of Embree
    assert_non_null(strstr(sgs_last_error(), "is out of range"));
    sgs_trainer_destroy(trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(training_lowers_the_loss_and_grows_the_model),
        cmocka_unit_test(bits_do_not_depend_on_threads_or_vector_width),
        cmocka_unit_test(the_last_iteration_makes_no_step),
        cmocka_unit_test(visible_primitives_are_counted_one_by_one),
        cmocka_unit_test(another_seed_gives_other_bits),
        cmocka_unit_test(checkpoint_resumes_to_the_same_bits),
        cmocka_unit_test(damaged_or_foreign_checkpoints_are_refused_and_change_nothing),
        cmocka_unit_test(cap_holds_for_the_initial_cloud_and_for_growth),
        cmocka_unit_test(a_model_taken_over_trains_as_its_copy),
        cmocka_unit_test(no_model_to_take_over_replaces_that_of_the_options),
        cmocka_unit_test(mcmc_starts_as_its_options_say),
        cmocka_unit_test(mcmc_gives_the_same_bits_with_any_threads_and_after_any_stop),
        cmocka_unit_test(mcmc_options_change_the_run),
        cmocka_unit_test(dense_optimizer_and_random_background_train_too),
        cmocka_unit_test(every_pipeline_trains_resumes_and_obeys_the_cap),
        cmocka_unit_test(options_out_of_range_are_named),
        cmocka_unit_test(updates_and_resets_follow_in_the_next_call),
        cmocka_unit_test(large_primitives_are_pruned_only_after_an_opacity_reset),
        cmocka_unit_test(radii_follow_the_size_of_the_images),
        cmocka_unit_test(unseen_primitives_are_not_redundant_in_short_runs),
        cmocka_unit_test(a_scene_in_small_units_trains_as_well),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
