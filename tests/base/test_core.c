// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Files of base/core.h: writers of the same file do not disturb each other, and folders. Memory
// readings of sparegs/runtime.h.

#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/output_file.h"
#include "sparegs/runtime.h"
#include "support/files_support.h"

// ---- Files that are replaced ----

static void assert_content(const char *path, const char *expected)
{
    uint8_t *bytes;
    size_t size;
    assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
    assert_string_equal((const char *)bytes, expected);
    sgsi_free(bytes);
}

static void two_open_writes_of_a_file_are_separate(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "file");
    sgs_output_file first, second;
    assert_int_equal(sgs_output_file_open(&first, path), SGS_STATUS_OK);
    assert_int_equal(sgs_output_file_open(&second, path), SGS_STATUS_OK);
    for (int k = 0; k < 2; ++k) { // a rest of digits: leftovers of a run are recognised by it
        const char *mark = strstr((k ? second : first).temporary, "file.tmp.");
        assert_non_null(mark);
        mark += strlen("file.tmp.");
        assert_true(*mark && strspn(mark, "0123456789") == strlen(mark));
    }
    fputs("the longer text", first.stream);
    fputs("short", second.stream);
    assert_int_equal(sgs_output_file_commit(&first), SGS_STATUS_OK);
    assert_content(path, "the longer text");
    assert_int_equal(sgs_output_file_commit(&second), SGS_STATUS_OK);
    assert_content(path, "short");
    assert_int_equal(temp_folder_count(&folder), 1);
    temp_folder_remove(&folder);
}

static void a_symbolic_link_is_followed(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "target"), *link = temp_path(&folder, "link");
    struct stat info;
    assert_int_equal(sgs_output_file_write(path, (const uint8_t *)"old", 3), SGS_STATUS_OK);
    assert_int_equal(symlink("target", link), 0);
    assert_int_equal(sgs_output_file_write(link, (const uint8_t *)"new", 3), SGS_STATUS_OK);
    assert_content(path, "new");
    assert_int_equal(lstat(link, &info), 0);
    assert_true(S_ISLNK(info.st_mode));
    assert_int_equal(unlink(path), 0);
    assert_int_equal(sgs_output_file_write(link, (const uint8_t *)"new", 3), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "link: is a symbolic link that cannot be followed"));
    assert_int_equal(temp_folder_count(&folder), 1);
    temp_folder_remove(&folder);
}

static void a_device_or_a_pipe_is_not_replaced(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pipe");
    sgs_output_file file;
    struct stat info;
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_int_equal(sgs_output_file_open(&file, path), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "pipe: is a device or a pipe"));
    assert_int_equal(stat(path, &info), 0);
    assert_true(S_ISFIFO(info.st_mode));
    assert_int_equal(temp_folder_count(&folder), 1);
    temp_folder_remove(&folder);
}

static void a_folder_is_no_output_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "folder"), *link = temp_path(&folder, "link");
    const char *const names[] = {"", "none/", "./.", "none/..", path, link};
    sgs_output_file file;
    assert_int_equal(mkdir(path, 0700), 0);
    assert_int_equal(symlink("folder", link), 0);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        char expected[600];
        assert_int_equal(sgs_output_file_open(&file, names[k]), SGS_STATUS_IO);
        snprintf(expected, sizeof expected, "%s: is %s folder; choose the name of a file", names[k],
                 k == 2 || k > 3 ? "a" : "the name of a");
        assert_string_equal(sgs_last_error(), expected);
        assert_null(file.stream);
    }
    assert_int_equal(temp_folder_count(&folder), 2);
    assert_int_equal(rmdir(path), 0);
    temp_folder_remove(&folder);
}

// Of another process with the same id, as in a container that shares the folder.
static void temporary_files_of_others_are_kept(void **state)
{
    (void)state;
    enum { TRIALS = 100 };
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "file");
    sgs_output_file file;
    assert_int_equal(sgs_output_file_open(&file, path), SGS_STATUS_OK);
    const size_t stem = strlen(file.temporary) - 6; // six digits that count
    char name[512];
    snprintf(name, sizeof name, "%s", file.temporary);
    const unsigned first = (unsigned)strtoul(name + stem, NULL, 10);
    assert_true(first < 900000);
    sgs_output_file_abort(&file);
    for (unsigned k = 1; k <= TRIALS; ++k) {
        snprintf(name + stem, sizeof name - stem, "%06u", first + k);
        file_put(name, "other", 6);
    }
    assert_int_equal(sgs_output_file_open(&file, path), SGS_STATUS_IO);
    assert_null(file.temporary);
    assert_non_null(strstr(sgs_last_error(), name)); // the last one
    assert_non_null(strstr(sgs_last_error(), ": already exists"));
    assert_int_equal(temp_folder_count(&folder), TRIALS);
    assert_content(name, "other");
    // The next name is free.
    assert_int_equal(sgs_output_file_write(path, (const uint8_t *)"own", 4), SGS_STATUS_OK);
    assert_content(path, "own");
    assert_int_equal(temp_folder_count(&folder), TRIALS + 1);
    temp_folder_remove(&folder);
}

enum { WRITERS = 4, ROUNDS = 12, LONGEST = 3000 };

typedef struct writer {
    const char *path;
    char letter;
    size_t failures;
} writer;

// A text of one letter; its length depends on the letter.
static size_t text_length(char letter)
{
    return LONGEST / (size_t)(letter - 'a' + 1);
}

static void *write_often(void *context)
{
    writer *w = context;
    uint8_t text[LONGEST];
    memset(text, w->letter, sizeof text);
    for (int round = 0; round < ROUNDS; ++round)
        w->failures +=
            sgs_output_file_write(w->path, text, text_length(w->letter)) != SGS_STATUS_OK;
    return NULL;
}

static void threads_that_write_one_file_leave_a_whole_one(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "file");
    writer writers[WRITERS];
    pthread_t threads[WRITERS];
    for (int k = 0; k < WRITERS; ++k) {
        writers[k] = (writer){.path = path, .letter = (char)('a' + k)};
        assert_int_equal(pthread_create(&threads[k], NULL, write_often, &writers[k]), 0);
    }
    for (int k = 0; k < WRITERS; ++k) {
        assert_int_equal(pthread_join(threads[k], NULL), 0);
        assert_int_equal(writers[k].failures, 0);
    }
    uint8_t *bytes;
    size_t size;
    assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
    assert_int_equal(size, text_length((char)bytes[0]));
    for (size_t i = 0; i < size; ++i)
        assert_int_equal(bytes[i], bytes[0]);
    sgsi_free(bytes);
    assert_int_equal(temp_folder_count(&folder), 1);
    temp_folder_remove(&folder);
}

// ---- Folders ----

static void folders_are_made_with_their_parents(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a/b/c");
    for (int again = 0; again < 2; ++again)
        assert_int_equal(sgsi_make_folder(path), SGS_STATUS_OK);
    assert_true(sgsi_is_folder(path));
    tree_remove(&folder);
}

// A sanitizer build detects a read past the end of the path.
static void a_folder_without_a_name_is_refused(void **state)
{
    (void)state;
    assert_int_equal(sgsi_make_folder(""), SGS_STATUS_IO);
    assert_string_equal(sgs_last_error(), ": cannot be created: No such file or directory; "
                                          "choose another folder, or check the permissions");
}

// ---- Memory ----

static void touch(char *bytes, size_t size)
{
    for (size_t i = 0; i < size; i += 4096)
        bytes[i] = 1;
}

static void *touch_pages(void *pages)
{
    touch(pages, 7 * 4096); // less than a batch of the kernel
    return NULL;
}

// The kernel adds the pages of a thread to its totals in batches.
static void the_memory_peak_is_at_least_every_reading(void **state)
{
    (void)state;
    enum { STEPS = 400, STEP = 7 * 4096 };
    char *bytes = malloc((size_t)STEPS * STEP);
    assert_non_null(bytes);
    uint64_t most = 0;
    for (size_t i = 0; i < STEPS; ++i) {
        pthread_t thread;
        assert_int_equal(pthread_create(&thread, NULL, touch_pages, bytes + i * STEP), 0);
        assert_int_equal(pthread_join(thread, NULL), 0);
        const uint64_t now = sgs_rss_current();
        most = now > most ? now : most;
        assert_true(now > 0 && sgs_rss_peak() >= most);
    }
    free(bytes);
    assert_true(sgs_rss_peak() >= most);
}

// ---- Statuses ----

static void every_status_has_a_text_of_its_own(void **state)
{
    (void)state;
#define STATUS(name, text) SGS_STATUS_##name,
    static const sgs_status all[] = {SGS_STATUS_LIST(STATUS)};
#undef STATUS
    enum { COUNT = sizeof all / sizeof *all };
    assert_int_equal(all[COUNT - 1], COUNT - 1); // without gaps
    for (int i = 0; i < COUNT; ++i) {
        assert_true(*sgs_status_text(all[i]));
        for (int k = 0; k < i; ++k)
            assert_string_not_equal(sgs_status_text(all[i]), sgs_status_text(all[k]));
    }
    assert_string_equal(sgs_status_text(SGS_STATUS_OUT_OF_MEMORY), "out of memory");
    const sgs_status unknown[] = {(sgs_status)COUNT, (sgs_status)-1};
    for (int i = 0; i < 2; ++i) {
        assert_non_null(sgs_status_text(unknown[i]));
        for (int k = 0; k < COUNT; ++k)
            assert_string_not_equal(sgs_status_text(unknown[i]), sgs_status_text(all[k]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(two_open_writes_of_a_file_are_separate),
        cmocka_unit_test(a_symbolic_link_is_followed),
        cmocka_unit_test(a_device_or_a_pipe_is_not_replaced),
        cmocka_unit_test(a_folder_is_no_output_file),
        cmocka_unit_test(temporary_files_of_others_are_kept),
        cmocka_unit_test(threads_that_write_one_file_leave_a_whole_one),
        cmocka_unit_test(folders_are_made_with_their_parents),
        cmocka_unit_test(a_folder_without_a_name_is_refused),
        cmocka_unit_test(the_memory_peak_is_at_least_every_reading),
        cmocka_unit_test(every_status_has_a_text_of_its_own),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
