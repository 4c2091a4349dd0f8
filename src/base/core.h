// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Shared internals of the library: error messages, warnings, aligned memory, checked sizes,
// reading files, clock, random numbers. Independent of Gaussians.

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "sparegs/status.h"

#if defined(__GNUC__)
#define SGSI_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))
#else
#define SGSI_PRINTF(fmt, args)
#endif

// Records the message for sgs_last_error().
void sgsi_record_error(const char *format, ...) SGSI_PRINTF(1, 2);

// Records the message for sgs_last_error() and evaluates to `status`: `return
// sgsi_fail(SGS_STATUS_FORMAT, "%s: ...", path)`. A macro, so that compilers and analysers see at
// the call that the status is a failure.
#define sgsi_fail(status, ...) (sgsi_record_error(__VA_ARGS__), (status))

// Number of errors that this thread has recorded so far.
size_t sgsi_error_count(void);

// Between these two calls, which may be nested, the thread records no errors: for a failure that
// the caller of the library does not see.
void sgsi_errors_suspend(void);
void sgsi_errors_resume(void);

// Sends one warning line to the process-wide handler.
void sgsi_warn(const char *format, ...) SGSI_PRINTF(1, 2);

// Fills a caller's struct of `size` bytes, which begins with its struct_size, with the first bytes
// of `defaults` (`own_size` bytes): the struct may be of an earlier version, which had fewer
// fields, or of a later one, whose further fields become 0.
void sgsi_options_init(void *options, size_t size, const void *defaults, size_t own_size);

// Fills `options` (`size` bytes, holding the defaults) from a caller's struct of the same type,
// which begins with its struct_size and may be shorter, as an earlier version declared it: fields
// that it lacks keep their defaults. NULL means the defaults. Fails with INVALID_ARGUMENT, naming
// `type`, when struct_size is smaller than a size_t or larger than `size`.
sgs_status sgsi_options_read(const void *given, const char *type, void *options, size_t size);

// 64-byte aligned, zeroed memory; NULL when out of memory or when count * size overflows. Blocks of
// 2 MiB and more request huge pages. Release with sgsi_free.
void *sgsi_calloc(size_t count, size_t size);

// Like sgsi_calloc without zeroing. Fresh large blocks are untouched pages: the first write decides
// their NUMA node.
void *sgsi_alloc(size_t count, size_t size);

// Grows *block (may be NULL) from old_count to at least new_count elements and keeps the contents;
// the new elements are uninitialised. False when out of memory: *block is unchanged.
bool sgsi_grow(void **block, size_t old_count, size_t new_count, size_t size);

// Accepts NULL.
void sgsi_free(void *block);

// Returns free memory of the allocator to the system, after the release of many blocks.
void sgsi_return_memory(void);

// Number of calls to sgsi_alloc, sgsi_calloc and sgsi_grow in this process so far. For the test
// that a training step allocates nothing.
size_t sgsi_allocation_count(void);

// Test hook: makes the n-th allocation from now fail (n >= 1); 0 disables it.
void sgsi_fail_allocation(size_t n);

// A copy of `text`; NULL when out of memory. Release with sgsi_free.
char *sgsi_strdup(const char *text);
// printf into a new string; NULL when out of memory. Release with sgsi_free.
char *sgsi_format(const char *format, ...) SGSI_PRINTF(1, 2);

// Opens a regular file for reading and determines its size. Fails with IO for other kinds of files,
// and does not block on a named pipe without a writer. Release with fclose.
sgs_status sgsi_file_open(const char *path, FILE **stream, size_t *size);

// Reads a regular file; (*bytes)[*size] is NUL. Fails with IO (the error names the file),
// OUT_OF_MEMORY, or LIMIT when the file exceeds `limit` bytes (0 = no limit). Release with
// sgsi_free.
sgs_status sgsi_file_read(const char *path, size_t limit, uint8_t **bytes, size_t *size);

// Length of the byte order mark with which programs on Windows begin UTF-8 files, 3 or 0. `text`
// ends with NUL, as the bytes of sgsi_file_read do.
size_t sgsi_byte_order_mark(const uint8_t *text);

// True for a regular file or for a folder, respectively; follows links.
bool sgsi_is_file(const char *path);
bool sgsi_is_folder(const char *path);

// *found: `path` is a regular file, or a folder that can be listed and searched; follows links. OK
// with false if nothing has this name. Fails with IO if it exists but is something else, a link to
// nothing or not accessible, also for a parent folder, which the error names; or with
// OUT_OF_MEMORY.
sgs_status sgsi_find_file(const char *path, bool *found);
sgs_status sgsi_find_folder(const char *path, bool *found);

// Creates a folder and its missing parents; succeeds when it exists. Fails with IO or
// OUT_OF_MEMORY.
sgs_status sgsi_make_folder(const char *path);

// Creates a new file, open for writing as *descriptor, or, if that is NULL, a new folder, named
// "PATH.tmp.NUMBER": the process id and six digits that count the names of the process. Release
// *name with sgsi_free. Fails with OUT_OF_MEMORY or IO, whose error names `shown`, or the last name
// if a hundred of them exist; *name is then NULL.
sgs_status sgsi_temporary_create(const char *path, const char *shown, char **name, int *descriptor);

// Makes renames in the folder durable. Best effort: some file systems do not sync folders.
void sgsi_folder_sync(const char *path);

// Monotonic clock in seconds.
double sgsi_seconds(void);
// CPU time of this thread in seconds.
double sgsi_thread_seconds(void);

// Counter-based random numbers (SplitMix64 finaliser over seed and counter): the same on every
// machine and with every thread count. Uniform in (0,1); normal by Box-Muller from two counters.
uint64_t sgsi_random_bits(uint64_t seed, uint64_t counter);
double sgsi_random_uniform(uint64_t seed, uint64_t counter);
double sgsi_random_normal(uint64_t seed, uint64_t counter);
// order [count]: a permutation of 0 to count - 1, which depends on seed and count only.
void sgsi_random_permutation(uint64_t seed, size_t count, uint32_t *order);

// Largest distance of a camera from the origin: beyond it single precision fails, and Embree
// ignores boxes beyond 1.8e18.
#define SGSI_FARTHEST_CAMERA 1e15
