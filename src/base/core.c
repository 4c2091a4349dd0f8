// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Errors, memory, files, clocks and random numbers shared by the whole library.

#include "base/core.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <malloc.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static _Thread_local char last_error[1024];
static _Thread_local size_t error_count;
static _Thread_local int errors_suspended; // depth
static sgs_warning_fn warning_fn;
static void *warning_user;
static atomic_size_t allocation_count;
static atomic_size_t allocation_failure;

enum { ALIGNMENT = 64, HUGE_BLOCK = 2 << 20 };

const char *sgs_status_text(sgs_status status)
{
    switch (status) {
#define SGS_STATUS_CASE(name, text)                                                                \
    case SGS_STATUS_##name:                                                                        \
        return text;
        SGS_STATUS_LIST(SGS_STATUS_CASE)
#undef SGS_STATUS_CASE
    }
    return "unknown status";
}

const char *sgs_last_error(void)
{
    return last_error;
}

// Messages quote untrusted files: line breaks and terminal escapes are replaced.
static void make_printable(char *text)
{
    for (; *text; ++text)
        if ((unsigned char)*text < 0x20 || *text == 0x7f)
            *text = '?';
}

void sgsi_record_error(const char *format, ...)
{
    // Formats into a second buffer: an argument may be sgs_last_error() itself when a caller adds a
    // file name.
    char text[sizeof last_error];
    if (errors_suspended)
        return;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    make_printable(text);
    memcpy(last_error, text, sizeof text);
    ++error_count;
}

size_t sgsi_error_count(void)
{
    return error_count;
}

void sgsi_errors_suspend(void)
{
    ++errors_suspended;
}

void sgsi_errors_resume(void)
{
    --errors_suspended;
}

void sgs_warning_handler_set(sgs_warning_fn fn, void *user)
{
    warning_fn = fn;
    warning_user = user;
}

void sgsi_options_init(void *options, size_t size, const void *defaults, size_t own_size)
{
    if (size < sizeof size)
        return;
    const size_t known = size < own_size ? size : own_size;
    memcpy(options, defaults, known);
    memset((char *)options + known, 0, size - known);
    memcpy(options, &size, sizeof size);
}

sgs_status sgsi_options_read(const void *given, const char *type, void *options, size_t size)
{
    if (!given)
        return SGS_STATUS_OK;
    size_t given_size;
    memcpy(&given_size, given, sizeof given_size);
    if (given_size < sizeof given_size || given_size > size)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s.struct_size is %zu, not within %zu to %zu; start from %s_default()",
                         type, given_size, sizeof given_size, size, type);
    memcpy(options, given, given_size);
    memcpy(options, &size, sizeof size);
    return SGS_STATUS_OK;
}

void sgsi_warn(const char *format, ...)
{
    if (!warning_fn)
        return;
    char text[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    make_printable(text);
    warning_fn(warning_user, text);
}

static bool allocation_denied(void)
{
    atomic_fetch_add_explicit(&allocation_count, 1, memory_order_relaxed);
    size_t left = atomic_load_explicit(&allocation_failure, memory_order_relaxed);
    while (left &&
           !atomic_compare_exchange_weak_explicit(&allocation_failure, &left, left - 1,
                                                  memory_order_relaxed, memory_order_relaxed))
        ;
    return left == 1;
}

size_t sgsi_allocation_count(void)
{
    return atomic_load(&allocation_count);
}

void sgsi_fail_allocation(size_t n)
{
    atomic_store(&allocation_failure, n);
}

void *sgsi_alloc(size_t count, size_t size)
{
    size_t bytes;
    if (allocation_denied() || __builtin_mul_overflow(count, size, &bytes) || bytes > SIZE_MAX / 2)
        return NULL;
    const size_t alignment = bytes >= HUGE_BLOCK ? HUGE_BLOCK : ALIGNMENT;
    bytes = (bytes + ALIGNMENT) / ALIGNMENT * ALIGNMENT;
    void *block = NULL;
    if (posix_memalign(&block, alignment, bytes))
        return NULL;
    if (bytes >= HUGE_BLOCK)
        madvise(block, bytes, MADV_HUGEPAGE); // a hint: failure only affects speed
    return block;
}

void *sgsi_calloc(size_t count, size_t size)
{
    void *block = sgsi_alloc(count, size);
    if (block)
        memset(block, 0, count * size);
    return block;
}

bool sgsi_grow(void **block, size_t old_count, size_t new_count, size_t size)
{
    if (*block && new_count <= old_count)
        return true;
    void *grown = sgsi_alloc(new_count, size);
    if (!grown)
        return false;
    if (*block && old_count)
        memcpy(grown, *block, old_count * size);
    sgsi_free(*block);
    *block = grown;
    return true;
}

void sgsi_free(void *block)
{
    free(block);
}

void sgsi_return_memory(void)
{
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

char *sgsi_strdup(const char *text)
{
    const size_t size = strlen(text) + 1;
    char *copy = sgsi_alloc(size, 1);
    if (copy)
        memcpy(copy, text, size);
    return copy;
}

char *sgsi_format(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    const int length = vsnprintf(NULL, 0, format, args);
    va_end(args);
    char *text = length < 0 ? NULL : sgsi_alloc((size_t)length + 1, 1);
    if (!text)
        return NULL;
    va_start(args, format);
    vsnprintf(text, (size_t)length + 1, format, args);
    va_end(args);
    return text;
}

sgs_status sgsi_file_open(const char *path, FILE **stream, size_t *size)
{
    *stream = NULL;
    // Without O_NONBLOCK, the open of a named pipe waits for a writer.
    const int descriptor = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    struct stat info;
    const bool known = descriptor >= 0 && !fstat(descriptor, &info);
    if (known && S_ISREG(info.st_mode))
        *stream = fdopen(descriptor, "rb");
    if (*stream) {
        *size = (size_t)info.st_size;
        return SGS_STATUS_OK;
    }
    const int code = errno;
    if (descriptor >= 0)
        close(descriptor);
    return known && !S_ISREG(info.st_mode)
               ? sgsi_fail(SGS_STATUS_IO, "%s: is not a regular file", path)
               : sgsi_fail(SGS_STATUS_IO, "%s: cannot be opened: %s", path, strerror(code));
}

sgs_status sgsi_file_read(const char *path, size_t limit, uint8_t **bytes, size_t *size)
{
    *bytes = NULL;
    *size = 0;
    FILE *stream;
    size_t length;
    const sgs_status status = sgsi_file_open(path, &stream, &length);
    if (status)
        return status;
    if (limit && length > limit) {
        fclose(stream);
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: has %zu bytes; the limit is %zu", path, length,
                         limit);
    }
    uint8_t *block = sgsi_alloc(length + 1, 1);
    if (!block) {
        fclose(stream);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for its %zu bytes", path,
                         length);
    }
    const size_t got = fread(block, 1, length, stream);
    fclose(stream);
    if (got != length) {
        sgsi_free(block);
        return sgsi_fail(SGS_STATUS_IO, "%s: byte %zu: read error", path, got);
    }
    block[length] = 0;
    *bytes = block;
    *size = length;
    return SGS_STATUS_OK;
}

size_t sgsi_byte_order_mark(const uint8_t *text)
{
    return text[0] == 0xef && text[1] == 0xbb && text[2] == 0xbf ? 3 : 0;
}

bool sgsi_is_file(const char *path)
{
    struct stat info;
    return !stat(path, &info) && S_ISREG(info.st_mode);
}

bool sgsi_is_folder(const char *path)
{
    struct stat info;
    return !stat(path, &info) && S_ISDIR(info.st_mode);
}

// Fails with the error `code` of the first of the folders in `path` that causes it, else of `path`.
static sgs_status fail_at_folder(const char *path, int code)
{
    char *partial = sgsi_strdup(path);
    if (!partial)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to look for it", path);
    for (char *at = partial + 1; *partial && *at; ++at) {
        if (*at != '/' || !at[1])
            continue;
        struct stat info;
        const char kept = at[1];
        at[1] = 0; // "FOLDER/" is resolved; the search permission is that of "FOLDER/."
        char *inside = sgsi_format("%s.", partial);
        const bool blocked = inside && stat(inside, &info) && errno == code;
        sgsi_free(inside);
        at[1] = kept;
        if (blocked) {
            *at = 0;
            break;
        }
    }
    const sgs_status status = sgsi_fail(SGS_STATUS_IO, "%s: %s", partial, strerror(code));
    sgsi_free(partial);
    return status;
}

// Reads the kind of `path`; info->st_mode is 0 if nothing has this name.
static sgs_status find_path(const char *path, struct stat *info)
{
    struct stat link;
    if (!stat(path, info))
        return SGS_STATUS_OK;
    const int code = errno;
    info->st_mode = 0;
    if (code == ENOENT)
        return lstat(path, &link)
                   ? SGS_STATUS_OK
                   : sgsi_fail(SGS_STATUS_IO, "%s: symbolic link to a missing file", path);
    // A part longer than a file system stores cannot exist.
    if (code == ENAMETOOLONG && strlen(path) < PATH_MAX)
        return SGS_STATUS_OK;
    if (code == ENAMETOOLONG)
        return sgsi_fail(SGS_STATUS_IO, "%.80s...: %s", path, strerror(code));
    return fail_at_folder(path, code);
}

sgs_status sgsi_find_file(const char *path, bool *found)
{
    struct stat info;
    const sgs_status status = find_path(path, &info);
    *found = !status && S_ISREG(info.st_mode);
    if (status || *found || !info.st_mode)
        return status;
    return sgsi_fail(SGS_STATUS_IO, "%s: is not a regular file", path);
}

sgs_status sgsi_find_folder(const char *path, bool *found)
{
    struct stat info;
    const sgs_status status = find_path(path, &info);
    *found = false;
    if (status || !info.st_mode)
        return status;
    if (!S_ISDIR(info.st_mode))
        return sgsi_fail(SGS_STATUS_IO, "%s: is not a folder", path);
    if (faccessat(AT_FDCWD, path, R_OK | X_OK, AT_EACCESS))
        return sgsi_fail(SGS_STATUS_IO, "%s: %s", path, strerror(errno));
    *found = true;
    return SGS_STATUS_OK;
}

sgs_status sgsi_make_folder(const char *path)
{
    char *partial = sgsi_strdup(path);
    if (!partial)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to create it", path);
    for (char *at = partial + (*partial != 0);; ++at) { // after the '/' of an absolute path
        if (*at != '/' && *at != 0)
            continue;
        const char kept = *at;
        *at = 0;
        if (mkdir(partial, 0777) && errno != EEXIST) {
            const int code = errno;
            sgsi_free(partial);
            return sgsi_fail(SGS_STATUS_IO,
                             "%s: cannot be created: %s; choose another folder, or check the "
                             "permissions",
                             path, strerror(code));
        }
        *at = kept;
        if (!kept)
            break;
    }
    sgsi_free(partial);
    struct stat info;
    if (stat(path, &info) || !S_ISDIR(info.st_mode))
        return sgsi_fail(SGS_STATUS_IO, "%s: is not a folder; choose another folder", path);
    return SGS_STATUS_OK;
}

// The number makes the names of a process unique, also of threads that write the same path.
static char *temporary_name(const char *path)
{
    static atomic_uint names;
    const unsigned number = atomic_fetch_add_explicit(&names, 1, memory_order_relaxed);
    return sgsi_format("%s.tmp.%ld%06u", path, (long)getpid(), number % 1000000);
}

// Existing names are skipped: a container or another machine that shares the folder may have a
// process of the same id.
sgs_status sgsi_temporary_create(const char *path, const char *shown, char **name, int *descriptor)
{
    enum { TRIALS = 100 };
    for (int k = 0; k < TRIALS; ++k) {
        *name = temporary_name(path);
        if (!*name)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", shown);
        const int result = descriptor ? open(*name, O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666)
                                      : mkdir(*name, 0777);
        if (result >= 0 && descriptor)
            *descriptor = result;
        if (result >= 0)
            return SGS_STATUS_OK;
        const int code = errno;
        if (code != EEXIST)
            sgsi_record_error("%s: cannot be written: %s", shown, strerror(code));
        else
            sgsi_record_error("%s: already exists, as do %d other temporary files of %s; remove "
                              "those of processes that have ended",
                              *name, k, shown);
        sgsi_free(*name);
        *name = NULL;
        if (code != EEXIST)
            break;
    }
    return SGS_STATUS_IO;
}

void sgsi_folder_sync(const char *path)
{
    const int descriptor = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0)
        return;
    fsync(descriptor);
    close(descriptor);
}

static double read_clock(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

double sgsi_seconds(void)
{
    return read_clock(CLOCK_MONOTONIC);
}

double sgsi_thread_seconds(void)
{
    return read_clock(CLOCK_THREAD_CPUTIME_ID);
}

uint64_t sgsi_random_bits(uint64_t seed, uint64_t counter)
{
    // SplitMix64: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014.
    uint64_t z = seed * UINT64_C(0xD1342543DE82EF95) + (counter + 1) * UINT64_C(0x9E3779B97F4A7C15);
    for (int round = 0; round < 2; ++round) {
        z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
        z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
        z ^= z >> 31;
    }
    return z;
}

double sgsi_random_uniform(uint64_t seed, uint64_t counter)
{
    return ((double)(sgsi_random_bits(seed, counter) >> 11) + 0.5) * 0x1p-53;
}

double sgsi_random_normal(uint64_t seed, uint64_t counter)
{
    const double radius = sqrt(-2.0 * log(sgsi_random_uniform(seed, 2 * counter)));
    return radius * cos(6.283185307179586 * sgsi_random_uniform(seed, 2 * counter + 1));
}

void sgsi_random_permutation(uint64_t seed, size_t count, uint32_t *order)
{
    for (size_t i = 0; i < count; ++i)
        order[i] = (uint32_t)i;
    for (size_t i = count; i-- > 1;) {
        size_t k = (size_t)(sgsi_random_uniform(seed, i) * (double)(i + 1));
        k = k < i ? k : i; // where the number rounds to 1
        const uint32_t kept = order[i];
        order[i] = order[k];
        order[k] = kept;
    }
}
