// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Checkpoints: the same bits from any stop point with all of SPARE-GS on, the same bytes when
// written again, every wrong section refused by name even if the checksum is right, changed options
// honoured or refused by name.

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

static sgs_scene *scene;
static temp_folder folder;
static char warning[1024];

static void keep_warning(void *user, const char *text)
{
    (void)user;
    snprintf(warning, sizeof warning, "%s", text);
}

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

static sgs_trainer *start(const sgs_scene *from, const sgs_train_options *options)
{
    sgs_trainer *trainer;
    if (sgs_trainer_create(from, options, &trainer))
        fail_msg("%s", sgs_last_error());
    return trainer;
}

static void run(sgs_trainer *trainer, int steps)
{
    sgs_step_info info;
    for (int i = 0; i < steps; ++i)
        if (sgs_trainer_step(trainer, &info))
            fail_msg("%s", sgs_last_error());
}

// A short_run(length) of `scene` after `steps` steps, saved under `name`. The caller destroys it.
static sgs_trainer *start_saved(int length, int steps, const char *name)
{
    const sgs_train_options options = short_run(length);
    sgs_trainer *trainer = start(scene, &options);
    run(trainer, steps);
    if (sgs_trainer_save_checkpoint(trainer, temp_path(&folder, name)))
        fail_msg("%s", sgs_last_error());
    return trainer;
}

static void digest(const sgs_trainer *trainer, char hex[17])
{
    sgs_gaussians_hash(sgs_trainer_model(trainer), hex);
}

// A run of LENGTH iterations with structural updates and equilibrium checks, which leaves a
// checkpoint at every stop point; each is continued to the end, alternating the number of threads.
static void every_stop_point_resumes_to_the_same_bits(void **state)
{
    (void)state;
    enum { LENGTH = 120, STOPS = 20 };
    sgs_train_options options = short_run(LENGTH);
    options.spare = SGS_SPARE_ALL;
    options.spare_patience = 1000; // observe and check, but do not end
    bool stop_at[LENGTH] = {false};
    int marked = 0;
    for (uint64_t k = 0; marked < STOPS; ++k) {
        const int at = 1 + (int)(sgsi_random_uniform(17, k) * (LENGTH - 1));
        marked += !stop_at[at];
        stop_at[at] = true;
    }
    sgs_trainer *trainer = start(scene, &options);
    char straight[17], resumed[17], name[32];
    const size_t before = sgs_trainer_model(trainer)->count;
    for (int i = 1; i <= LENGTH; ++i) {
        run(trainer, 1);
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
        trainer = start(scene, &options);
        if (sgs_trainer_load_checkpoint(trainer, temp_path(&folder, name)))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(sgs_trainer_iteration(trainer), at);
        run(trainer, LENGTH - at);
        digest(trainer, resumed);
        sgs_trainer_destroy(trainer);
        assert_string_equal(straight, resumed);
    }
    sgs_threads_set(0);
}

static void a_loaded_state_is_written_as_the_same_bytes(void **state)
{
    (void)state;
    const sgs_train_options options = short_run(90);
    sgs_trainer *trainer = start_saved(90, 47, "a");
    sgs_trainer_destroy(trainer);
    trainer = start(scene, &options);
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

// Loads `bytes` after making the checksum right; the trainer must refuse and stay as it is.
static void refuses(sgs_trainer *trainer, unsigned char *bytes, size_t size, sgs_status expected,
                    const char *words)
{
    char before[17], after[17];
    checkpoint_reseal(bytes, size);
    file_put(temp_path(&folder, "changed"), bytes, size);
    digest(trainer, before);
    const int iteration = sgs_trainer_iteration(trainer);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "changed")), expected);
    if (!strstr(sgs_last_error(), words) || !strstr(sgs_last_error(), "/changed: "))
        fail_msg("expected '%s' in: %s", words, sgs_last_error());
    digest(trainer, after);
    assert_string_equal(before, after);
    assert_int_equal(sgs_trainer_iteration(trainer), iteration);
    bad_input();
}

static void wrong_contents_with_a_right_checksum_are_refused_by_name(void **state)
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
        // Called otherwise: it is missing, or nobody knows it.
        memcpy(bytes, good, size);
        bytes[at] = 'X';
        snprintf(words, sizeof words, "section '%s' is missing", sections[k]);
        refuses(trainer, bytes, size, SGS_STATUS_FORMAT, k == 4 ? "do not fit" : words);
        // Twice.
        memcpy(bytes, good, size);
        if (k) {
            memset(bytes + at, 0, 16);
            memcpy(bytes + at, sections[k - 1], strlen(sections[k - 1]));
            refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "duplicate section");
        }
        // A length beyond the file, and all lengths whose sum overflows.
        static const uint64_t lengths[] = {UINT64_MAX, UINT64_MAX - 24, UINT64_MAX / 2, 1ull << 32};
        for (size_t j = 0; j < sizeof lengths / sizeof *lengths; ++j) {
            memcpy(bytes, good, size);
            memcpy(bytes + at + 16, &lengths[j], 8);
            refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "exceeds the file");
        }
    }
    // One section more than this program knows.
    const size_t end = section_find(good, size, "end");
    memcpy(bytes, good, end);
    memset(bytes + end, 0, 24 + 5);
    memcpy(bytes + end, "exposure_later", 14);
    bytes[end + 16] = 5;
    memcpy(bytes + end + 29, good + end, size - end);
    refuses(trainer, bytes, size + 29, SGS_STATUS_FORMAT, "unknown section 'exposure_later'");
    // Something behind the end.
    memcpy(bytes, good, size - 8);
    refuses(trainer, bytes, size + 3, SGS_STATUS_FORMAT, "data after the end");
    free(good);
    free(bytes);
    sgs_trainer_destroy(trainer);
}

static void wrong_numbers_with_a_right_checksum_are_refused_by_name(void **state)
{
    (void)state;
    size_t size;
    sgs_trainer *trainer = start_saved(90, 5, "good");
    unsigned char *good = file_get(temp_path(&folder, "good"), &size), *bytes = malloc(size);
    // Counters out of range.
    const size_t progress = section_find(good, size, "progress") + 24,
                 order = section_find(good, size, "order") + 24;
    memcpy(bytes, good, size);
    memset(bytes + progress, 0xFF, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "section 'progress' is out of range");
    memcpy(bytes, good, size);
    memset(bytes + order, 0xFF, 4);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "names view 4294967295 of");
    // More primitives than there are rows; another number than the rows.
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
    refuses(trainer, bytes, size, SGS_STATUS_UNSUPPORTED, "has version 99");
    const size_t text = section_find(good, size, "options") + 24;
    memcpy(bytes, good, size);
    memcpy(bytes + text, "iterators=", 10);
    refuses(trainer, bytes, size, SGS_STATUS_UNSUPPORTED, "option --iterators");
    memcpy(bytes, good, size);
    memcpy(bytes + text, "iterations:", 11);
    refuses(trainer, bytes, size, SGS_STATUS_FORMAT, "options are not readable");
    const size_t views = section_find(good, size, "scene") + 24;
    memcpy(bytes, good, size);
    bytes[views] ^= 1;
    refuses(trainer, bytes, size, SGS_STATUS_INVALID_ARGUMENT,
            "the view '0002.jpg' was another one");
    // Each of these was a change, not a flaw of the test: the file as it was loads.
    memcpy(bytes, good, size);
    checkpoint_reseal(bytes, size);
    file_put(temp_path(&folder, "changed"), bytes, size);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "changed")),
                     SGS_STATUS_OK);
    free(good);
    free(bytes);
    sgs_trainer_destroy(trainer);
}

static void options_are_honoured_or_refused_by_name(void **state)
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
        {"--iterations", MEMBER(iterations), false},
        {"--schedule", MEMBER(schedule), false},
        {"--filter", MEMBER(filter), false},
        {"--optimizer", MEMBER(optimizer), false},
        {"--compact-box", MEMBER(compact_box), false},
        {"--taming-opacity", MEMBER(pipeline_options.taming_opacity), false},
        {"--sh-degree", MEMBER(sh_degree), false},
        {"--background", MEMBER(background), false},
        {"--background-random", MEMBER(background_random), false},
        {"--max-gaussians", MEMBER(max_gaussians), true},
        {"--seed", MEMBER(seed), false},
        {"--spare", MEMBER(spare), false},
        {"--spare-grid", MEMBER(spare_grid), false},
        {"--spare-tau-alpha", MEMBER(spare_tau_alpha), false},
        {"--spare-eps-loss", MEMBER(spare_eps_loss), true},
        {"--spare-eps-count", MEMBER(spare_eps_count), true},
        {"--spare-patience", MEMBER(spare_patience), true},
        {"--spare-interval", MEMBER(spare_interval), false},
        {"--spare-demand", MEMBER(spare_demand), false},
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
    sgs_warning_handler_set(keep_warning, NULL);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        sgs_train_options changed = options;
        memcpy((char *)&changed + cases[k].offset, (const char *)&other + cases[k].offset,
               cases[k].bytes);
        trainer = start(scene, &changed);
        warning[0] = 0;
        const sgs_status status = sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "base"));
        assert_int_equal(status, cases[k].honoured ? SGS_STATUS_OK : SGS_STATUS_INVALID_ARGUMENT);
        const char *told = cases[k].honoured ? warning : sgs_last_error();
        char words[64];
        snprintf(words, sizeof words, "%s was ", cases[k].name);
        if (!strstr(told, words))
            fail_msg("expected '%s' in: %s", words, told);
        sgs_trainer_destroy(trainer);
    }
    sgs_warning_handler_set(NULL, NULL);
    // Another set of views.
    sgs_scene_options fewer = sgs_scene_options_default();
    fewer.downscale = 16;
    fewer.test_every = 4;
    sgs_scene *second;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &fewer, &second), SGS_STATUS_OK);
    trainer = start(second, &options);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, temp_path(&folder, "base")),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "30 training views and has 26 now"));
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(second);
}

static void a_full_disk_leaves_the_checkpoint_before(void **state)
{
    (void)state;
    sgs_trainer *trainer = start_saved(90, 2, "kept");
    const char *path = temp_path(&folder, "kept");
    size_t size, size_after;
    unsigned char *before = file_get(path, &size);
    run(trainer, 1);
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
        cmocka_unit_test(a_loaded_state_is_written_as_the_same_bytes),
        cmocka_unit_test(wrong_contents_with_a_right_checksum_are_refused_by_name),
        cmocka_unit_test(wrong_numbers_with_a_right_checksum_are_refused_by_name),
        cmocka_unit_test(options_are_honoured_or_refused_by_name),
        cmocka_unit_test(a_full_disk_leaves_the_checkpoint_before),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
