// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Files of a run that a later session continues or reads: rows and records up to the iteration are
// kept, the beginning of a record that a killed process left is removed, and a file that is damaged
// or unreadable is an error that leaves it as it is.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "arguments/model_path.h"
#include "cli/output.h"
#include "run/region_file.h"
#include "run/run_record.h"
#include "support/files_support.h"

static temp_folder folder;

// ---- Messages ----

static int saved_stderr;
static char *message;

static void catch_messages(void)
{
    fflush(stderr);
    saved_stderr = dup(STDERR_FILENO);
    const int file = open(temp_path(&folder, "stderr"), O_CREAT | O_TRUNC | O_WRONLY, 0666);
    assert_true(file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    close(file);
}

static void read_message(void)
{
    fflush(stderr);
    dup2(saved_stderr, STDERR_FILENO);
    close(saved_stderr);
    size_t size;
    free(message);
    message = (char *)file_get(temp_path(&folder, "stderr"), &size);
}

// One line with both texts.
static void assert_message(const char *path, const char *text)
{
    if (!strstr(message, path) || !strstr(message, text))
        fail_msg("no '%s' and '%s' in: %s", path, text, message);
    assert_true(strchr(message, '\n') == message + strlen(message) - 1);
}

// ---- regions.bin ----

enum { RECORDS = 4, REGIONS = 3, HEADER = 64, RECORD = HEADER + REGIONS * (int)sizeof(sgs_region) };
enum { AT_ITERATION = 4, AT_GRID = 8, AT_COUNT = 12 };

// Four records at the iterations 100, 200, 300 and 400.
static void put_records(void)
{
    const sgs_region regions[REGIONS] = {{.voxel = 1}, {.voxel = 2}, {.voxel = 7}};
    unlink(temp_path(&folder, "regions.bin"));
    for (int k = 1; k <= RECORDS; ++k) {
        const sgs_regions update = {.iteration = 100 * k,
                                    .grid = 4,
                                    .voxel_size = {1, 1, 1},
                                    .count = REGIONS,
                                    .regions = regions};
        assert_true(region_file_append(folder.path, &update));
    }
}

static long size_of_records(void)
{
    struct stat info;
    assert_int_equal(stat(temp_path(&folder, "regions.bin"), &info), 0);
    return (long)info.st_size;
}

static void flip(long offset, int mask)
{
    FILE *file = fopen(temp_path(&folder, "regions.bin"), "r+b");
    assert_non_null(file);
    fseek(file, offset, SEEK_SET);
    const int byte = fgetc(file) ^ mask;
    fseek(file, offset, SEEK_SET);
    fputc(byte, file);
    fclose(file);
}

static void records_up_to_the_iteration_are_kept(void **state)
{
    (void)state;
    static const int cases[][2] = {{0, 0}, {99, 0}, {100, 1}, {250, 2}, {400, 4}, {9000, 4}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        put_records();
        assert_true(region_file_cut(folder.path, cases[i][0]));
        assert_int_equal(size_of_records(), cases[i][1] * RECORD);
    }
    unlink(temp_path(&folder, "regions.bin"));
    assert_true(region_file_cut(folder.path, 100));
}

static void the_beginning_of_a_record_is_removed(void **state)
{
    (void)state;
    for (int left = 1; left < RECORD; ++left) {
        put_records();
        assert_int_equal(truncate(temp_path(&folder, "regions.bin"), 3 * RECORD + left), 0);
        assert_true(region_file_cut(folder.path, 400));
        assert_int_equal(size_of_records(), 3 * RECORD);
    }
}

static void a_history_ends_at_a_record_that_was_cut(void **state)
{
    (void)state;
    for (int left = 0; left < RECORD; left += 9) {
        put_records();
        assert_int_equal(truncate(temp_path(&folder, "regions.bin"), 3 * RECORD + left), 0);
        region_history history;
        assert_true(region_history_read(folder.path, &history));
        assert_int_equal(history.count, 3);
        assert_int_equal(history.updates[2].iteration, 300);
        region_history_free(&history);
    }
    put_records();
    flip(RECORD + AT_COUNT + 2, 1); // another record follows
    region_history history;
    catch_messages();
    const bool read = region_history_read(folder.path, &history);
    read_message();
    assert_false(read);
    region_history_free(&history);
}

// A part of a record would hide the later ones.
static void a_record_that_does_not_fit_is_removed(void **state)
{
    (void)state;
    put_records();
    files_limited(4 * RECORD + HEADER + 10);
    const sgs_region regions[REGIONS] = {{.voxel = 1}, {.voxel = 2}, {.voxel = 7}};
    const sgs_regions update = {
        .iteration = 500, .grid = 4, .voxel_size = {1, 1, 1}, .count = REGIONS, .regions = regions};
    catch_messages();
    const bool written = region_file_append(folder.path, &update);
    read_message();
    files_unlimited();
    assert_false(written);
    assert_message("regions.bin", "was not recorded");
    assert_int_equal(size_of_records(), 4 * RECORD);
}

static void a_damaged_record_is_an_error_that_keeps_the_file(void **state)
{
    (void)state;
    static const struct {
        int record, at, mask, byte;
    } cases[] = {{0, 0, 1, 0},
                 {1, 3, 32, RECORD},
                 {1, AT_GRID + 1, 2, RECORD},
                 {1, AT_COUNT, 32, RECORD},     // more regions: as if the file ended in this record
                 {1, AT_COUNT + 3, 64, RECORD}, // the same
                 {1, AT_COUNT, 4, RECORD + HEADER + 7 * (int)sizeof(sgs_region)},
                 {1, AT_COUNT, 1, RECORD + HEADER + 2 * (int)sizeof(sgs_region)},
                 {2, AT_ITERATION + 1, 1, 2 * RECORD},   // 44, less than the previous one
                 {1, AT_ITERATION + 1, 64, 2 * RECORD}}; // more than the next one
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        put_records();
        flip(cases[i].record * RECORD + cases[i].at, cases[i].mask);
        catch_messages();
        const bool cut = region_file_cut(folder.path, 400);
        read_message();
        assert_false(cut);
        assert_int_equal(size_of_records(), RECORDS * RECORD);
        char place[64];
        snprintf(place, sizeof place, "byte %d: invalid region record", cases[i].byte);
        assert_message("regions.bin", place);
    }
    put_records();
    flip(3 * RECORD, 1); // this one is removed anyway
    flip(2 * RECORD + AT_COUNT + 2, 1);
    assert_true(region_file_cut(folder.path, 250));
    assert_int_equal(size_of_records(), 2 * RECORD);
}

// ---- Tables ----

static void put_text(const char *name, const char *text)
{
    file_put(temp_path(&folder, name), text, strlen(text));
}

static void rows_up_to_the_iteration_are_kept(void **state)
{
    (void)state;
    put_text("train.csv", "old header\n1,a\n5,b\nnoise\n9,c\n4,unfinished");
    FILE *table = csv_open(temp_path(&folder, "train.csv"), "iteration,x", 5);
    assert_non_null(table);
    fputs("6,d\n", table);
    fclose(table);
    size_t size;
    char *text = (char *)file_get(temp_path(&folder, "train.csv"), &size);
    assert_string_equal(text, "iteration,x\n1,a\n5,b\n6,d\n");
    free(text);
}

// The time of a copy per row of all rows before it would exceed the time limit of the test.
static void a_table_of_many_rows_is_read_in_linear_time(void **state)
{
    (void)state;
    enum { ROWS = 3000000 };
    FILE *file = fopen(temp_path(&folder, "train.csv"), "w");
    assert_non_null(file);
    fputs("iteration\n", file);
    for (int k = 0; k < ROWS; ++k)
        fputs("1\n", file);
    fclose(file);
    FILE *table = csv_open(temp_path(&folder, "train.csv"), "iteration", 5);
    assert_non_null(table);
    assert_int_equal(fseek(table, 0, SEEK_END), 0);
    assert_int_equal(ftell(table), 10 + 2 * ROWS);
    fclose(table);
}

static void an_unreadable_table_is_an_error_that_keeps_it(void **state)
{
    (void)state;
    struct stat info;
    const char *path = temp_path(&folder, "sums.csv");
    assert_int_equal(symlink("/proc/self/mem", path), 0); // opens, but the first read fails
    catch_messages();
    FILE *table = csv_open(path, "iteration", 5);
    read_message();
    assert_null(table);
    assert_message("sums.csv", "cannot be read: Input/output error");
    assert_true(!lstat(path, &info) && S_ISLNK(info.st_mode));
}

// ---- config.json ----

static void an_unreadable_config_is_named_with_the_reason(void **state)
{
    (void)state;
    char run[512], clouds[600];
    snprintf(run, sizeof run, "%s", temp_path(&folder, "run"));
    snprintf(clouds, sizeof clouds, "%s/point_cloud/iteration_1/point_cloud.ply", run);
    assert_true(make_folder_of(clouds));
    put_text("run/point_cloud/iteration_1/point_cloud.ply", "ply\n");
    file_put_unreadable(run, "config.json");
    run_folder claimed;
    json_t *stored = NULL;
    catch_messages();
    const bool resumed = run_record_claim(&claimed, run, true, false, &stored);
    read_message();
    assert_false(resumed);
    assert_message("run/config.json: cannot be read: No such device or address",
                   "replace it with --overwrite");
    model_path located;
    catch_messages();
    const bool found = model_locate(run, &located);
    read_message();
    assert_true(found);
    assert_null(located.config);
    assert_message("run/config.json: cannot be read: No such device or address",
                   "its options are ignored");
    model_path_free(&located);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_up_to_the_iteration_are_kept),
        cmocka_unit_test(the_beginning_of_a_record_is_removed),
        cmocka_unit_test(a_history_ends_at_a_record_that_was_cut),
        cmocka_unit_test(a_record_that_does_not_fit_is_removed),
        cmocka_unit_test(a_damaged_record_is_an_error_that_keeps_the_file),
        cmocka_unit_test(rows_up_to_the_iteration_are_kept),
        cmocka_unit_test(a_table_of_many_rows_is_read_in_linear_time),
        cmocka_unit_test(an_unreadable_table_is_an_error_that_keeps_it),
        cmocka_unit_test(an_unreadable_config_is_named_with_the_reason),
    };
    folder = temp_folder_make();
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    nftw(folder.path, tree_remove_entry, 16, FTW_DEPTH | FTW_PHYS);
    free(message);
    return failed;
}
