// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Checkpoints: resuming at any point gives the same bits with all of SPARE-GS enabled; a loaded
// state is written as the same bytes; wrong sections with a correct checksum are refused by name;
// changed options are used or refused by name.

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

#include "support/checkpoint_support.h"
#include "support/bad_input.h"
#include "base/core.h"
#include "support/files_support.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/trainer_support.h"
#include "support/warning_support.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { SANITIZED = 1 }; // slow
#else
enum { SANITIZED = 0 };
#endif

static sgs_scene *scene;
static temp_folder folder;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 16;
    options.test_every = 8;
    folder = temp_folder_make();
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    temp_folder_remove(&folder);
    return 0;
}

static sgs_train_options short_run(int iterations)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    return options;
}

// A short_run(length) of `scene` after `steps` steps, saved under `name`. The caller destroys it.
static sgs_trainer *start_saved(int length, int steps, const char *name)
{
    const sgs_train_options options = short_run(length);
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, steps);
    if (sgs_trainer_save_checkpoint(trainer, temp_path(&folder, name)))
        fail_msg("%s", sgs_last_error());
    return trainer;
}

static void digest(const sgs_trainer *trainer, char hex[17])
{
    sgs_gaussians_hash(sgs_trainer_model(trainer), hex);
}

// A run of LENGTH iterations with structural updates and equilibrium checks, and a checkpoint at
// each stop point. Each is resumed to the end, with alternating numbers of threads.
static void every_stop_point_resumes_to_the_same_bits(void **state)
{
    (void)state;
    enum { LENGTH = 120, STOPS = SANITIZED ? 7 : 20 };
    sgs_train_options options = short_run(LENGTH);
    options.spare = SGS_SPARE_ALL;
    options.spare_patience = 1000; // checks without ending the run
    bool stop_at[LENGTH] = {false};
    int marked = 0;
    for (uint64_t k = 0; marked < STOPS; ++k) {
        const int at = 1 + (int)(sgsi_random_uniform(17, k) * (LENGTH - 1));
        marked += !stop_at[at];
        stop_at[at] = true;
    }
    sgs_trainer *trainer = trainer_create(scene, &options);
    char straight[17], resumed[17], name[32];
    const size_t before = sgs_trainer_model(trainer)->count;
    for (int i = 1; i <= LENGTH; ++i) {
        trainer_run(trainer, 1);
        snprintf(name, sizeof name, "at_%d", i);
        if (i < LENGTH && stop_at[i] &&
            sgs_trainer_save_checkpoint(trainer, temp_path(&folder, name)))
            fail_msg("%s", sgs_last_error());
    }
    digest(trainer, straight);
    assert_int_not_equal(sgs_trainer_model(trainer)->count, before);
    sgs_trainer_destroy(trainer);
    for (int at = 1; at < LENGTH; ++at) {
        if (!stop_at[at])
            continue;
        snprintf(name, sizeof name, "at_%d", at);
        sgs_threads_set(1 + at % 3);
        trainer = trainer_create(scene, &options);
        if (sgs_trainer_load_checkpoint(trainer, temp_path(&folder, name)))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(sgs_trainer_iteration(trainer), at);
        trainer_run(trainer, LENGTH - at);
        digest(trainer, resumed);
        sgs_trainer_destroy(trainer);
        assert_string_equal(straight, resumed);
    }
    sgs_threads_set(0);
}

// The regions are those of updates that this trainer has made.
static void a_loaded_state_has_no_regions_of_the_state_before(void **state)
{
    (void)state;
    sgs_trainer *trainer = start_saved(90, 2, "early");
    while (!sgs_trainer_regions(trainer).count)
        trainer_run(trainer, 1);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "early")),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_regions(trainer).count, 0);
    assert_int_equal(sgs_trainer_regions(trainer).iteration, 0);
    sgs_trainer_destroy(trainer);
}

// With the schedule of the papers, which does not depend on the length.
static void a_completed_run_that_continues_counts_no_iteration_twice(void **state)
{
    (void)state;
    enum { SHORT = 12, LONG = 20 };
    sgs_train_options options = short_run(SHORT);
    options.schedule = SGS_SCHEDULE_PAPER;
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_int_equal(trainer_run(trainer, SHORT).stop, SGS_STOP_SCHEDULE);
    const char *path = temp_path(&folder, "completed");
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    options.iterations = LONG;
    sgs_trainer *straight = trainer_create(scene, &options), *extended;
    extended = trainer_create(scene, &options);
    assert_int_equal(sgs_trainer_load_checkpoint(extended, path), SGS_STATUS_OK);
    trainer_run(straight, SHORT);
    for (int i = SHORT + 1; i <= LONG; ++i) {
        const sgs_step_info a = trainer_run(straight, 1), b = trainer_run(extended, 1);
        assert_int_equal(b.iteration, i);
        if (a.loss_average != b.loss_average || a.psnr_average != b.psnr_average)
            fail_msg("iteration %d: loss %.9g and PSNR %.9g, expected %.9g and %.9g", i,
                     b.loss_average, b.psnr_average, a.loss_average, a.psnr_average);
    }
    char hashes[2][17];
    digest(straight, hashes[0]);
    digest(extended, hashes[1]);
    assert_string_equal(hashes[0], hashes[1]);
    sgs_trainer_destroy(straight);
    sgs_trainer_destroy(extended);
}

static void a_loaded_state_is_written_as_the_same_bytes(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(90);
    sgs_trainer *trainer = start_saved(90, 47, "a");
    sgs_trainer_destroy(trainer);
    trainer = trainer_create(scene, &options);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "a")), SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, temp_path(&folder, "b")), SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    size_t sizes[2];
    unsigned char *a = file_get(temp_path(&folder, "a"), &sizes[0]),
                  *b = file_get(temp_path(&folder, "b"), &sizes[1]);
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(a, b, sizes[0]);
    free(a);
    free(b);
}

// Corrects the checksum of `bytes`; checking and loading must fail and leave the trainer unchanged.
static void refuses(sgs_trainer *trainer, unsigned char *bytes, size_t size, sgs_status expected,
                    const char *words)
{
    char before[17], after[17], checked[1024];
    checkpoint_reseal(bytes, size);
    file_put(temp_path(&folder, "changed"), bytes, size);
    digest(trainer, before);
    const int iteration = sgs_trainer_iteration(trainer);
    const char *path = temp_path(&folder, "changed");
    assert_int_equal(sgs_trainer_check_checkpoint(trainer, path), expected);
    snprintf(checked, sizeof checked, "%s", sgs_last_error());
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), expected);
    assert_string_equal(sgs_last_error(), checked);
    if (!strstr(sgs_last_error(), words) || !strstr(sgs_last_error(), "/changed: "))
        fail_msg("expected '%s' in: %s", words, sgs_last_error());
    digest(trainer, after);
    assert_string_equal(before, after);
    assert_int_equal(sgs_trainer_iteration(trainer), iteration);
    bad_input();
}

static void wrong_sections_are_refused_by_name(void **state)
{
    (void)state;
    size_t size;
    sgs_trainer *trainer = start_saved(90, 5, "good");
    unsigned char *good = file_get(temp_path(&folder, "good"), &size), *bytes = malloc(size + 64);
    static const char *const sections[] = {"options",      "scene",   "size",    "progress",
                                           "model",        "moment1", "moment2", "statistics",
                                           "depth_bounds", "order",   "stop"};
    char words[64];
    for (size_t k = 0; k < sizeof sections / sizeof *sections; ++k) {
        const size_t at = section_find(good, size, sections[k]);
        assert_true(at > 0);
        // Renamed: missing.
        memcpy(bytes, good, size);
        bytes[at] = 'X';
        snprintf(words, sizeof words, "section '%s' is missing", sections[k]);
        refuses(trainer, bytes, size, SGS_STATUS_FORMAT, k == 4 ? "do not fit" : words);
        // Duplicate.
        memcpy(bytes, good, size);
        if (k) {
            memset(bytes + at, 0, 16);
            memcpy(bytes + at, sections[k - 1], strlen(sections[k - 1]));
            refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "duplicate section");
        }
        // A length beyond the file, and lengths whose sum overflows.
        static const uint64_t lengths[] = {UINT64_MAX, UINT64_MAX - 24, UINT64_MAX / 2, 1ull << 32};
        for (size_t j = 0; j < sizeof lengths / sizeof *lengths; ++j) {
            memcpy(bytes, good, size);
            memcpy(bytes + at + 16, &lengths[j], 8);
            refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "exceeds the file");
        }
    }
    // An unknown section.
    const size_t end = section_find(good, size, "end");
    memcpy(bytes, good, end);
    memset(bytes + end, 0, 24 + 5);
    memcpy(bytes + end, "exposure_later", 14);
    bytes[end + 16] = 5;
    memcpy(bytes + end + 29, good + end, size - end);
    refuses(trainer, bytes, size + 29, SGS_STATUS_FORMAT, "unknown section 'exposure_later'");
    // Data after the end.
    memcpy(bytes, good, size - 8);
    refuses(trainer, bytes, size + 3, SGS_STATUS_FORMAT, "data after the end");
    free(good);
    free(bytes);
    sgs_trainer_destroy(trainer);
}

static void wrong_numbers_are_refused_by_name(void **state)
{
    (void)state;
    size_t size;
    sgs_trainer *trainer = start_saved(90, 5, "good");
    unsigned char *good = file_get(temp_path(&folder, "good"), &size), *bytes = malloc(size);
    // Counters out of range.
    const size_t order = section_find(good, size, "order") + 24;
    memcpy(bytes, good, size);
    const size_t iteration = field_find(good, size, "progress", "iteration");
    memset(bytes + iteration, 0xFF, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section 'progress' is out of range");
    for (int k = 0; k < 3; ++k) {
        static const char *const names[] = {"pipeline.initial_count", "pipeline.momentum",
                                            "pipeline.deleted"};
        memcpy(bytes, good, size);
        memset(bytes + field_find(good, size, "progress", names[k]), 0xFF, 8);
        refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section 'progress' is out of range");
    }
    memcpy(bytes, good, size); // a completed schedule without an iteration
    const size_t stop = field_find(good, size, "progress", "stop");
    bytes[stop] = SGS_STOP_SCHEDULE;
    memset(bytes + field_find(good, size, "progress", "order_position"), 0, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section 'progress' is out of range");
    memcpy(bytes, good, size);
    memset(bytes + order, 0xFF, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "contains view 4294967295 of");
    // More primitives than rows, and fewer.
    const size_t count = section_find(good, size, "size") + 24;
    memcpy(bytes, good, size);
    memset(bytes + count, 0xFF, 8);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "do not fit into the section 'model'");
    memcpy(bytes, good, size);
    memset(bytes + count, 0, 8);
    bytes[count] = 7;
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section 'model' has");
    // Another version, other options, another view.
    memcpy(bytes, good, size);
    bytes[8] = 99;
    refuses(trainer, bytes, size, SGS_STATUS_UNSUPPORTED,
            "in format 99; this program reads format 4");
    const size_t views = section_find(good, size, "scene") + 24;
    memcpy(bytes, good, size);
    bytes[views] ^= 1;
    refuses(trainer, bytes, size, SGS_STATUS_INVALID_ARGUMENT,
            "view '0002.jpg' or its camera changed");
    // The unmodified file loads.
    memcpy(bytes, good, size);
    checkpoint_reseal(bytes, size);
    file_put(temp_path(&folder, "changed"), bytes, size);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "changed")),
                     SGS_STATUS_OK);
    free(good);
    free(bytes);
    sgs_trainer_destroy(trainer);
}

// Corrects the checksum of `bytes` and loads them into a new trainer of short_run(90).
static sgs_status load_changed(unsigned char *bytes, size_t size, sgs_trainer **trainer)
{
    const sgs_train_options options = short_run(90);
    *trainer = trainer_create(scene, &options);
    checkpoint_reseal(bytes, size);
    file_put(temp_path(&folder, "changed"), bytes, size);
    return sgs_trainer_load_checkpoint(*trainer, temp_path(&folder, "changed"));
}

// Record headers: name 32, type u16, essential u16, length u32.
static void fields_may_be_missing_or_unknown_unless_they_are_essential(void **state)
{
    (void)state;
    const struct {
        const char *section, *field, *name; // the field and its new name
        sgs_status expected;
        const char *words;
    } cases[] = {
        {"progress", "seconds.gather", "seconds.later", SGS_STATUS_OK, ""},
        {"progress", "loss_average", "loss_mean", SGS_STATUS_OK, ""},
        {"progress", "iteration", "iterator", SGS_STATUS_UNSUPPORTED,
         "section 'progress': unknown field 'iterator'"},
        {"progress", "seconds.gather", "iteration", SGS_STATUS_FORMAT,
         "field 'iteration' has another type"},
        {"progress", "adam_step", "iteration", SGS_STATUS_FORMAT, "'iteration' appears twice"},
        // Options with their default: unknown ones had no effect, missing ones are implied.
        {"options", "seed", "spare_grid", SGS_STATUS_FORMAT, "option spare_grid appears twice"},
        {"options", "spare_grid", "spare_lattice", SGS_STATUS_OK, ""},
        {"options", "iterations", "iterators", SGS_STATUS_UNSUPPORTED,
         "uses option iterators (90)"},
        {"options", "sh_degree", "spare_grid", SGS_STATUS_INVALID_ARGUMENT,
         "option spare_grid was 3 when the run started and is 32 now"},
    };
    size_t size;
    sgs_trainer *trainer = start_saved(90, 5, "good"), *other;
    char straight[17], resumed[17];
    digest(trainer, straight);
    unsigned char *good = file_get(temp_path(&folder, "good"), &size), *bytes = malloc(size);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const size_t value = field_find(good, size, cases[k].section, cases[k].field);
        assert_true(value > 0);
        memcpy(bytes, good, size);
        memset(bytes + value - 40, 0, 32);
        memcpy(bytes + value - 40, cases[k].name, strlen(cases[k].name));
        const sgs_status status = load_changed(bytes, size, &other);
        if (status != cases[k].expected || (status && !strstr(sgs_last_error(), cases[k].words)))
            fail_msg("%s -> %s: status %d: %s", cases[k].field, cases[k].name, (int)status,
                     sgs_last_error());
        if (status) {
            bad_input();
        } else {
            digest(other, resumed);
            assert_string_equal(straight, resumed);
        }
        sgs_trainer_destroy(other);
    }
    // A missing essential field: the record is unknown and marked optional.
    const size_t step = field_find(good, size, "progress", "adam_step");
    memcpy(bytes, good, size);
    bytes[step - 40] = 'X';
    bytes[step - 6] = 0;
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "field 'adam_step' is missing");
    // A length beyond the section.
    memcpy(bytes, good, size);
    memset(bytes + step - 4, 0xFF, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "a field is truncated or damaged");
    free(good);
    free(bytes);
    sgs_trainer_destroy(trainer);
}

// Written by sparegs 0.1.0 before checkpoints had named fields.
static void a_checkpoint_of_format_3_is_refused_by_name(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(2);
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_int_equal(
        sgs_trainer_load_checkpoint(trainer, SGSI_TEST_DATA "/checkpoint_format_3.bin"),
        SGS_STATUS_UNSUPPORTED);
    assert_non_null(strstr(sgs_last_error(), "checkpoint_format_3.bin: written by sparegs 0.1.0 in "
                                             "format 3; this program reads format 4"));
    assert_int_equal(sgs_trainer_iteration(trainer), 0);
    // With the new version number the file is refused, too.
    size_t size;
    unsigned char *bytes = file_get(SGSI_TEST_DATA "/checkpoint_format_3.bin", &size);
    bytes[8] = 4;
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section exceeds the file");
    free(bytes);
    sgs_trainer_destroy(trainer);
}

static void changed_options_are_used_or_refused_by_name(void **state)
{
    (void)state;
    sgs_train_options options = short_run(90);
    sgs_trainer *trainer = start_saved(90, 3, "base");
    sgs_trainer_destroy(trainer);
    const struct {
        const char *name;
        size_t offset, bytes;
        bool honoured;
    } cases[] = {
#define MEMBER(member) offsetof(sgs_train_options, member), sizeof options.member
        {"iterations", MEMBER(iterations), false},
        {"schedule", MEMBER(schedule), false},
        {"filter", MEMBER(filter), false},
        {"optimizer", MEMBER(optimizer), false},
        {"compact_box", MEMBER(compact_box), false},
        {"taming_opacity", MEMBER(pipeline_options.taming_opacity), false},
        {"sh_degree", MEMBER(sh_degree), false},
        {"background", MEMBER(background), false},
        {"background", MEMBER(background_random), false},
        {"ssim_weight", MEMBER(ssim_weight), false},
        {"ssim_sigma", MEMBER(ssim_sigma), false},
        {"alpha_loss", MEMBER(alpha_loss), false},
        {"max_gaussians", MEMBER(max_gaussians), true},
        {"seed", MEMBER(seed), false},
        {"spare", MEMBER(spare), true},
        {"spare_grid", MEMBER(spare_grid), false},
        {"spare_tau_alpha", MEMBER(spare_tau_alpha), false},
        {"spare_eps_loss", MEMBER(spare_eps_loss), true},
        {"spare_eps_count", MEMBER(spare_eps_count), true},
        {"spare_patience", MEMBER(spare_patience), true},
        {"spare_interval", MEMBER(spare_interval), true},
        {"spare_demand", MEMBER(spare_demand), false},
    };
    sgs_train_options other = short_run(91);
    other.schedule = SGS_SCHEDULE_PAPER;
    other.filter = SGS_FILTER_NONE;
    other.optimizer = SGS_OPTIMIZER_DENSE;
    other.compact_box = 0.5;
    other.pipeline_options.taming_opacity = SGS_TAMING_LINEAR;
    other.sh_degree = 1;
    other.background[1] = 0.25f;
    other.background_random = true;
    other.ssim_weight = 0.3;
    other.ssim_sigma = 1.25;
    other.alpha_loss = 0.5;
    other.max_gaussians = 1000000;
    other.seed = UINT64_MAX;
    other.spare = SGS_SPARE_RAP;
    other.spare_grid = 33;
    other.spare_tau_alpha = 0.06;
    other.spare_eps_loss = 0.1;
    other.spare_eps_count = 0.2;
    other.spare_patience = 3;
    other.spare_interval = 999;
    other.spare_demand = SGS_DEMAND_H;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_train_options changed = options;
        memcpy((char *)&changed + cases[k].offset, (const char *)&other + cases[k].offset,
               cases[k].bytes);
        trainer = trainer_create(scene, &changed);
        warnings_begin(NULL);
        const sgs_status status = sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "base"));
        assert_int_equal(status, cases[k].honoured ? SGS_STATUS_OK : SGS_STATUS_INVALID_ARGUMENT);
        const char *told = cases[k].honoured ? warnings : sgs_last_error();
        char words[64];
        snprintf(words, sizeof words, "option %s was ", cases[k].name);
        if (!strstr(told, words))
            fail_msg("expected '%s' in: %s", words, told);
        sgs_trainer_destroy(trainer);
    }
    warnings_end();
    // Another set of views.
    sgs_scene_options fewer = sgs_scene_options_default();
    fewer.downscale = 16;
    fewer.test_every = 4;
    sgs_scene *second;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &fewer, &second), SGS_STATUS_OK);
    trainer = trainer_create(second, &options);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "base")),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "30 training views, but the scene has 26"));
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(second);
}

// With statistics, accumulated gradients, filters and exposure.
static void file_size_and_count_are_reported(void **state)
{
    (void)state;
    for (int pipeline = 0; pipeline < SGS_PIPELINE_COUNT; ++pipeline) {
        sgs_train_options options = short_run(90);
        options.pipeline = (sgs_pipeline)pipeline;
        options.filter = pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
        options.exposure = pipeline == SGS_PIPELINE_DASH;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, 2);
        const char *path = temp_path(&folder, "sized");
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        size_t size, count;
        free(file_get(path, &size));
        assert_int_equal(sgs_trainer_checkpoint_bytes(trainer), size);
        assert_int_equal(sgs_checkpoint_gaussians(path, &count), SGS_STATUS_OK);
        assert_int_equal(count, sgs_trainer_model(trainer)->count);
        sgs_trainer_destroy(trainer);
    }
    size_t count = 7;
    assert_int_equal(sgs_checkpoint_gaussians(SGSI_TEST_DATA "/checkpoint_format_3.bin", &count),
                     SGS_STATUS_UNSUPPORTED);
    assert_int_equal(count, 0);
}

// `refuses` checks the errors.
static void checking_a_checkpoint_loads_nothing(void **state)
{
    (void)state;
    sgs_trainer_destroy(start_saved(90, 5, "sound"));
    const char *path = temp_path(&folder, "sound");
    for (int k = 0; k < 2; ++k) {
        sgs_train_options options = short_run(90);
        options.sh_degree = k ? 2 : options.sh_degree;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer_run(trainer, 1);
        char before[17], after[17];
        digest(trainer, before);
        assert_int_equal(sgs_trainer_check_checkpoint(trainer, path),
                         k ? SGS_STATUS_INVALID_ARGUMENT : SGS_STATUS_OK);
        digest(trainer, after);
        assert_string_equal(before, after);
        assert_int_equal(sgs_trainer_iteration(trainer), 1);
        assert_int_equal(sgs_trainer_check_checkpoint(trainer, temp_path(&folder, "nothing")),
                         SGS_STATUS_IO);
        assert_int_equal(
            sgs_trainer_check_checkpoint(trainer, SGSI_TEST_DATA "/checkpoint_format_3.bin"),
            SGS_STATUS_UNSUPPORTED);
        trainer_run(trainer, 1); // it can be used further
        sgs_trainer_destroy(trainer);
    }
}

// A run that ended in equilibrium continues only if an option of the test has changed.
static void an_equilibrium_is_final_until_its_options_change(void **state)
{
    (void)state;
    enum { LENGTH = 400, VIEWS = 30 };
    sgs_train_options options = short_run(LENGTH);
    options.spare_eps_loss = options.spare_eps_count = 1;
    options.spare_interval = 100; // an interval covers at least a pass over the views
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgs_step_info info = {0};
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    assert_int_equal(info.stop, SGS_STOP_EQUILIBRIUM);
    const int ended = info.iteration;
    assert_true(ended < LENGTH);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, temp_path(&folder, "still")),
                     SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    enum { CHANGES = 6 };
    sgs_train_options changes[CHANGES];
    for (int k = 0; k < CHANGES; ++k)
        changes[k] = options;
    changes[1].spare = SGS_SPARE_BMD | SGS_SPARE_RAP;
    changes[2].spare_eps_loss = 1e-6;
    changes[3].spare_eps_count = 0;
    changes[4].spare_patience = 1000;
    changes[5].spare_eps_loss = 0.9;
    for (int k = 0; k < CHANGES; ++k) {
        trainer = trainer_create(scene, &changes[k]);
        assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "still")),
                         SGS_STATUS_OK);
        assert_int_equal(sgs_trainer_iteration(trainer), ended);
        assert_int_equal(sgs_trainer_step(trainer, &info), k ? SGS_STATUS_OK : SGS_STATUS_LIMIT);
        assert_int_equal(*sgs_trainer_stop_text(trainer) != 0, k == 0);
        if (k == 1) {
            trainer_run(trainer, LENGTH - 1 - ended);
            assert_int_equal(sgs_trainer_iteration(trainer), LENGTH);
        }
        if (k == 5) { // two checks of the new limit, not one more
            while (!info.stop)
                assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
            assert_int_equal(info.stop, SGS_STOP_EQUILIBRIUM);
            assert_in_range(info.iteration, ended + 2 * VIEWS, LENGTH - 1);
        }
        sgs_trainer_destroy(trainer);
    }
}

// The schedule of a resumed run is that of its start, whether the points or the initial model of
// that time are still there or not.
static void the_schedule_follows_the_start_of_the_run(void **state)
{
    (void)state;
    enum { LENGTH = 120, SAVED = 20 };
    sgs_scene empty = *scene;
    empty.point_count = 0;
    sgs_train_options options = short_run(LENGTH);
    options.random_points = 300;
    for (int random = 0; random < 2; ++random) {
        sgs_trainer *trainer = trainer_create(random ? &empty : scene, &options);
        trainer_run(trainer, SAVED);
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, temp_path(&folder, "start")),
                         SGS_STATUS_OK);
        trainer_run(trainer, LENGTH - SAVED);
        const sgs_train_milestones straight = sgs_trainer_milestones(trainer);
        char straight_hash[17], hash[17];
        digest(trainer, straight_hash);
        sgs_trainer_destroy(trainer);
        trainer = trainer_create(random ? scene : &empty, &options);
        assert_true(sgs_trainer_milestones(trainer).gradient_factor != straight.gradient_factor);
        if (sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "start")))
            fail_msg("%s", sgs_last_error());
        const sgs_train_milestones resumed = sgs_trainer_milestones(trainer);
        assert_true(resumed.gradient_factor == straight.gradient_factor);
        assert_int_equal(resumed.densify_interval, straight.densify_interval);
        trainer_run(trainer, LENGTH - SAVED);
        digest(trainer, hash);
        assert_string_equal(hash, straight_hash);
        sgs_trainer_destroy(trainer);
    }
}

static void a_full_disk_keeps_the_earlier_checkpoint(void **state)
{
    (void)state;
    sgs_trainer *trainer = start_saved(90, 2, "kept");
    const char *path = temp_path(&folder, "kept");
    size_t size, size_after;
    unsigned char *before = file_get(path, &size);
    trainer_run(trainer, 1);
    const size_t files = temp_folder_count(&folder);
    for (size_t room = 0; room < size; room += size / 7) {
        files_limited(room);
        const sgs_status status = sgs_trainer_save_checkpoint(trainer, path);
        files_unlimited();
        assert_int_equal(status, SGS_STATUS_IO);
        assert_non_null(strstr(sgs_last_error(), "kept: cannot be written: File too large"));
    }
    assert_int_equal(temp_folder_count(&folder), files);
    unsigned char *after = file_get(path, &size_after);
    assert_int_equal(size, size_after);
    assert_memory_equal(before, after, size);
    free(before);
    free(after);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, "/nowhere/at/all"), SGS_STATUS_IO);
    sgs_trainer_destroy(trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_stop_point_resumes_to_the_same_bits),
        cmocka_unit_test(a_completed_run_that_continues_counts_no_iteration_twice),
        cmocka_unit_test(a_loaded_state_is_written_as_the_same_bytes),
        cmocka_unit_test(wrong_sections_are_refused_by_name),
        cmocka_unit_test(wrong_numbers_are_refused_by_name),
        cmocka_unit_test(fields_may_be_missing_or_unknown_unless_they_are_essential),
        cmocka_unit_test(a_checkpoint_of_format_3_is_refused_by_name),
        cmocka_unit_test(changed_options_are_used_or_refused_by_name),
        cmocka_unit_test(file_size_and_count_are_reported),
        cmocka_unit_test(checking_a_checkpoint_loads_nothing),
        cmocka_unit_test(a_loaded_state_has_no_regions_of_the_state_before),
        cmocka_unit_test(an_equilibrium_is_final_until_its_options_change),
        cmocka_unit_test(the_schedule_follows_the_start_of_the_run),
        cmocka_unit_test(a_full_disk_keeps_the_earlier_checkpoint),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
