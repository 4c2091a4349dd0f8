// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The ends of child processes: their status and signal are those of the system, and a status that
// is unknown, as in a process that ignores SIGCHLD, is a failure.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <signal.h>
#include <stdlib.h>

#include "draw/video.h"
#include "processes/child_process.h"
#include "processes/sub_command.h"
#include "support/files_support.h"

static temp_folder folder;

static int run_shell(const char *script)
{
    const char *const arguments[] = {"sh", "-c", script, NULL};
    child_process child = {.arguments = arguments, .log_path = temp_path(&folder, "log")};
    return child_run(&child);
}

static void the_status_is_that_of_the_program(void **state)
{
    (void)state;
    assert_int_equal(run_shell("exit 0"), 0);
    assert_int_equal(run_shell("exit 3"), 3);
    assert_int_equal(run_shell("kill -KILL $$"), 128 + SIGKILL);
}

static void an_unknown_status_is_a_failure(void **state)
{
    (void)state;
    signal(SIGCHLD, SIG_IGN);
    for (int k = 0; k < 2; ++k) {
        errno = 0;
        assert_int_equal(run_shell(k ? "exit 3" : "exit 0"), CHILD_LOST);
        assert_int_equal(errno, ECHILD);
    }
    signal(SIGCHLD, SIG_DFL);
}

// ffmpeg is a script that writes its last argument.
static bool encode(void)
{
    uint8_t pixels[4 * 4 * 3] = {0};
    const sgs_image8 image = {.width = 4, .height = 4, .channels = 3, .pixels = pixels};
    video *film = video_open(temp_path(&folder, "film.mp4"), 4, 4, 1, 24);
    assert_non_null(film);
    assert_true(video_add(film, &image));
    return video_close(film, true);
}

static void a_video_with_an_unknown_status_is_a_failure(void **state)
{
    (void)state;
    static const char script[] = "#!/bin/sh\nfor last; do :; done\ncat >\"${last#file:}\"\n";
    const char *value = getenv("PATH");
    char *program = strdup(temp_path(&folder, "ffmpeg")), *before = strdup(value ? value : "");
    char path[4096];
    FILE *file = fopen(program, "w");
    assert_non_null(file);
    fputs(script, file);
    fclose(file);
    assert_int_equal(chmod(program, 0755), 0);
    snprintf(path, sizeof path, "%.*s:%s", (int)(strrchr(program, '/') - program), program, before);
    setenv("PATH", path, 1);
    assert_true(encode());
    signal(SIGCHLD, SIG_IGN);
    assert_false(encode());
    signal(SIGCHLD, SIG_DFL);
    setenv("PATH", before, 1);
    free(before);
    free(program);
}

static void a_fault_names_the_status_or_the_signal(void **state)
{
    (void)state;
    static const struct {
        int status;
        const char *text;
    } rows[] = {
        {1, "failed with status 1"},
        {127, "failed with status 127"},
        {137, "failed with status 137"}, // its own exit status
        {-9, "was killed by signal 9 (SIGKILL; the system may have run out of memory)"},
        {-11, "was killed by signal 11 (SIGSEGV)"},
        {-15, "was killed by signal 15 (SIGTERM)"},
        {143, "was stopped by signal 15 (SIGTERM)"},
        {130, "was stopped by signal 2 (SIGINT)"},
        {-31, "was killed by signal 31"},
    };
    for (size_t k = 0; k < sizeof rows / sizeof *rows; ++k) {
        char *text = sub_command_fault(rows[k].status);
        assert_string_equal(text, rows[k].text);
        free(text);
    }
}

static int open_folder(void **state)
{
    (void)state;
    folder = temp_folder_make();
    return 0;
}

static int close_folder(void **state)
{
    (void)state;
    temp_folder_remove(&folder);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_status_is_that_of_the_program),
        cmocka_unit_test(an_unknown_status_is_a_failure),
        cmocka_unit_test(a_video_with_an_unknown_status_is_a_failure),
        cmocka_unit_test(a_fault_names_the_status_or_the_signal),
    };
    return cmocka_run_group_tests(tests, open_folder, close_folder);
}
