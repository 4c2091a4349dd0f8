// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages and the progress line. On a terminal one line is redrawn in place and cleared before any
// other message; otherwise (log, pipe) every hundredth iteration prints a line. The rate is
// averaged over the last seconds, because the cost of an iteration changes with the number of
// primitives.

#include "cli/progress.h"

#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "cli/json_result.h"
#include "cli/option_key.h"
#include "cli/standard_output.h"
#include "cli/usage_error.h"
#include "sparegs/runtime.h"
#include "sparegs/status.h"
#include "sparegs/option_descriptors.h"

enum { WARNINGS_KEPT = 100, BAR_WIDTH = 20, MIN_BAR = 5, LINE_EVERY = 100 };

static struct {
    pthread_mutex_t lock;
    bool quiet, live, holds_errors;
    char error[1024];
    size_t warning_count;
    char *warnings[WARNINGS_KEPT];
    double drawn_at, measured_at, rate, shown_rate;
    int measured_iteration;
} console = {.lock = PTHREAD_MUTEX_INITIALIZER};

// Before a line on stderr.
static void clear_line(void)
{
    stdout_flush(); // keeps the order where both streams go to one file
    if (console.live)
        fputs("\r\033[K", stderr);
    console.live = false;
}

void make_printable(char *text)
{
    for (char *c = text; *c; ++c)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
}

static void print_line(const char *prefix, const char *format, bool is_error, va_list args)
{
    char text[2048];
    vsnprintf(text, sizeof text, format, args);
    make_printable(text);
    pthread_mutex_lock(&console.lock);
    const bool held = is_error && console.holds_errors;
    if (!held) {
        clear_line();
        fprintf(stderr, "%s%s\n", prefix, text);
    }
    if (is_error)
        snprintf(console.error, sizeof console.error, "%.1000s", text);
    if (is_error && !held)
        json_result_error(text);
    pthread_mutex_unlock(&console.lock);
}

// Fields of other options than those of training, and their flags.
static const struct {
    const char *field, *flag;
} renamed_fields[] = {{"images_dir", "images"},
                      {"masks_dir", "masks"},
                      {"colorspace", "input-colorspace"},
                      {"invert_masks", "invert-masks"},
                      {"downscale", "downscale"},
                      {"view_width", "size"},
                      {"spz_version", "spz-version"},
                      {"distill", "distill"},
                      {"finetune", "finetune"},
                      {"axis_depth", "depth z"},
                      {"position_bits", "position-bits"},
                      {"keep", "keep"},
                      {"codec", "codec"}};

// Writes the flag of a field with its dashes; false if the field has none.
static bool flag_of_field(const char *field, char flag[48])
{
    for (size_t i = 0; i < sizeof renamed_fields / sizeof *renamed_fields; ++i)
        if (!strcmp(renamed_fields[i].field, field)) {
            snprintf(flag, 48, "--%s", renamed_fields[i].flag);
            return true;
        }
    if (!sgs_train_option_find(field))
        return false;
    snprintf(flag, 48, "--%s", field);
    key_to_name(flag);
    return true;
}

// The library names fields: "option spare_grid" is --spare-grid on the command line.
static void with_flags(const char *message, char *text, size_t bytes)
{
    static const char word[] = "option ";
    size_t used = 0;
    for (const char *at = message; *at && used + 1 < bytes;) {
        char name[40] = "", flag[48];
        const char *from = at + sizeof word - 1;
        const bool marked = !strncmp(at, word, sizeof word - 1);
        const size_t length = marked ? strspn(from, "abcdefghijklmnopqrstuvwxyz0123456789_") : 0;
        if (length < sizeof name)
            memcpy(name, from, length);
        if (!length || !flag_of_field(name, flag) || used + strlen(flag) >= bytes) {
            text[used++] = *at++;
            continue;
        }
        memcpy(text + used, flag, strlen(flag));
        used += strlen(flag);
        at = from + length;
    }
    text[used] = 0;
}

void print_note(const char *format, ...)
{
    if (console.quiet)
        return;
    va_list args;
    va_start(args, format);
    print_line("sparegs: ", format, false, args);
    va_end(args);
}

static void receive_warning(void *user, const char *warning)
{
    (void)user;
    char message[1024];
    with_flags(warning, message, sizeof message);
    make_printable(message);
    pthread_mutex_lock(&console.lock);
    clear_line();
    fprintf(stderr, "sparegs: warning: %s\n", message);
    if (console.warning_count < WARNINGS_KEPT)
        console.warnings[console.warning_count++] = strdup(message);
    pthread_mutex_unlock(&console.lock);
}

void print_warning(const char *format, ...)
{
    char text[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    receive_warning(NULL, text);
}

int fail_run(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print_line("sparegs: ", format, true, args);
    va_end(args);
    return EXIT_FAILED;
}

int fail_library(void)
{
    char message[1024];
    with_flags(sgs_last_error(), message, sizeof message);
    return fail_run("%s", message);
}

void messages_hear_library(bool hear)
{
    sgs_warning_handler_set(hear ? receive_warning : NULL, NULL);
}

void messages_set_quiet(bool quiet)
{
    console.quiet = quiet;
}

void last_error_set(const char *text)
{
    snprintf(console.error, sizeof console.error, "%.1000s", text);
}

const char *last_error_text(void)
{
    return console.error;
}

void errors_hold(bool hold)
{
    pthread_mutex_lock(&console.lock);
    console.holds_errors = hold;
    if (hold)
        console.error[0] = 0;
    pthread_mutex_unlock(&console.lock);
}

size_t warning_count(void)
{
    return console.warning_count;
}

const char *warning_text(size_t k)
{
    return console.warnings[k] ? console.warnings[k] : "";
}

double clock_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void progress_start(int iteration)
{
    console.measured_iteration = iteration;
    console.measured_at = clock_seconds();
    console.drawn_at = 0;
    console.rate = console.shown_rate = 0;
}

static void measure_rate(int iteration, double now)
{
    const double elapsed = now - console.measured_at;
    if (elapsed <= 0 || iteration <= console.measured_iteration)
        return;
    const double rate = (iteration - console.measured_iteration) / elapsed;
    if (elapsed < 0.5) { // too short to store, sufficient to show
        console.shown_rate = console.rate > 0 ? console.rate : rate;
        return;
    }
    const double keep = console.rate > 0 ? exp(-elapsed / 10) : 0;
    console.rate = keep * console.rate + (1 - keep) * rate;
    console.shown_rate = console.rate;
    console.measured_at = now;
    console.measured_iteration = iteration;
}

// "1:02:03" or "2:03"; "-" when unknown.
static void duration_text(double seconds, char text[24])
{
    if (!(seconds >= 0 && seconds < 1e7)) {
        snprintf(text, 24, "-");
        return;
    }
    const int whole = (int)(seconds + 0.5);
    if (whole >= 3600)
        snprintf(text, 24, "%d:%02d:%02d", whole / 3600, whole / 60 % 60, whole % 60);
    else
        snprintf(text, 24, "%d:%02d", whole / 60, whole % 60);
}

static int terminal_width(void)
{
    struct winsize size;
    return !ioctl(STDERR_FILENO, TIOCGWINSZ, &size) && size.ws_col > 0 ? size.ws_col : 80;
}

// The bar of a line of `width` columns, as wide as the numbers leave room for; none if that is
// little, so that the numbers stay visible.
static void bar_text(const progress_state *state, int width, char text[BAR_WIDTH + 4])
{
    const int columns = width < BAR_WIDTH ? width : BAR_WIDTH;
    *text = 0;
    if (columns < MIN_BAR)
        return;
    const int full = (int)((double)columns * state->iteration / state->total);
    for (int i = 0; i < columns; ++i)
        text[i + 1] = i < full ? '#' : '.';
    text[0] = '[';
    memcpy(text + columns + 1, "] ", 3);
}

static void print_state(const char *numbers, const progress_state *state)
{
    char bar[BAR_WIDTH + 4], line[512];
    const bool terminal = isatty(STDERR_FILENO);
    const int width = terminal_width() - 1;
    bar_text(state, width - (int)strlen(numbers) - 3, bar);
    snprintf(line, sizeof line, "%s%s", bar, numbers);
    pthread_mutex_lock(&console.lock);
    stdout_flush();
    if (terminal)
        fprintf(stderr, "\r%.*s\033[K", width, line);
    else
        fprintf(stderr, "%s\n", numbers);
    fflush(stderr);
    console.live = terminal;
    pthread_mutex_unlock(&console.lock);
}

void progress_step(const progress_state *state)
{
    if (console.quiet)
        return;
    const bool last = state->iteration == state->total;
    const double now = clock_seconds();
    measure_rate(state->iteration, now);
    if (isatty(STDERR_FILENO) ? now - console.drawn_at < 0.1 && !last
                              : state->iteration % LINE_EVERY && !last)
        return;
    console.drawn_at = now;
    char left[24], numbers[256];
    duration_text(
        console.shown_rate > 0 ? (state->total - state->iteration) / console.shown_rate : -1, left);
    snprintf(numbers, sizeof numbers,
             "%d/%d  loss %.4f  %zu primitives  %.1f it/s  ETA %s  RSS %.0f MB", state->iteration,
             state->total, state->loss, state->gaussians, console.shown_rate, left,
             (double)sgs_rss_current() / 1e6);
    print_state(numbers, state);
}

void progress_pause(const progress_state *state)
{
    const double now = clock_seconds();
    console.measured_at = now;
    console.measured_iteration = state->iteration;
    if (console.quiet || !isatty(STDERR_FILENO) || now - console.drawn_at < 0.5)
        return;
    console.drawn_at = now;
    char numbers[256];
    snprintf(numbers, sizeof numbers, "%d/%d  loss %.4f  %zu primitives  paused  RSS %.0f MB",
             state->iteration, state->total, state->loss, state->gaussians,
             (double)sgs_rss_current() / 1e6);
    print_state(numbers, state);
}

void progress_end(void)
{
    pthread_mutex_lock(&console.lock);
    clear_line();
    fflush(stderr);
    pthread_mutex_unlock(&console.lock);
}

void progress_count(const char *label, size_t done, size_t total)
{
    if (console.quiet || !isatty(STDERR_FILENO))
        return;
    pthread_mutex_lock(&console.lock);
    fprintf(stderr, "\r%s %zu/%zu\033[K", label, done, total);
    fflush(stderr);
    console.live = true;
    pthread_mutex_unlock(&console.lock);
}

static struct {
    double started, drawn_at;
    size_t first;
} work;

void progress_work_start(void)
{
    work.started = -1;
}

void progress_work(const char *label, size_t done, size_t total)
{
    const double now = clock_seconds();
    if (work.started < 0) {
        work.started = now;
        work.drawn_at = 0;
        work.first = done;
    }
    if (console.quiet || !isatty(STDERR_FILENO) || (now - work.drawn_at < 0.1 && done < total))
        return;
    work.drawn_at = now;
    char left[24];
    duration_text(done > work.first
                      ? (now - work.started) * (double)(total - done) / (double)(done - work.first)
                      : -1,
                  left);
    pthread_mutex_lock(&console.lock);
    fprintf(stderr, "\r%s %zu/%zu  ETA %s\033[K", label, done, total, left);
    fflush(stderr);
    console.live = true;
    pthread_mutex_unlock(&console.lock);
}
