// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Shared internals of the library: failing with a sentence, warning, aligned memory, checked sizes,
// reading a whole file, replacing a file atomically. Knows nothing of Gaussians.

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

// Records the sentence for sgs_last_error() and returns `status`, so that callers write
// `return sgsi_fail(SGS_STATUS_FORMAT, "%s: ...", path)`.
sgs_status sgsi_fail(sgs_status status, const char *format, ...) SGSI_PRINTF(2, 3);

// Sends one warning line to the process-wide handler.
void sgsi_warn(const char *format, ...) SGSI_PRINTF(1, 2);

// 64-byte aligned memory, zeroed. NULL when out of memory or when count * size overflows. Large
// blocks (>= 2 MiB) ask for huge pages. Release with sgsi_free.
void *sgsi_calloc(size_t count, size_t size);

// Like sgsi_calloc without the zeroing (fresh large blocks are still untouched pages: first touch
// decides their NUMA node).
void *sgsi_alloc(size_t count, size_t size);

// Grows *block (may be NULL) from old_count to at least new_count elements, keeping the contents;
// the tail is uninitialised. False when out of memory: *block is unchanged.
bool sgsi_grow(void **block, size_t old_count, size_t new_count, size_t size);

// Accepts NULL.
void sgsi_free(void *block);

// Number of sgsi_alloc/calloc/grow calls so far in the process, for the test that a training step
// allocates nothing.
size_t sgsi_allocation_count(void);

// Test hook: the n-th allocation from now fails (n >= 1); 0 switches off.
void sgsi_fail_allocation(size_t n);

char *sgsi_strdup(const char *text);
// printf into a fresh string; NULL when out of memory. Release with sgsi_free.
char *sgsi_format(const char *format, ...) SGSI_PRINTF(1, 2);

// Reads a whole regular file; *bytes is NUL-terminated beyond *size. Fails with IO (names the
// file), or LIMIT when larger than `limit` bytes (0 = no limit). Release with sgsi_free.
sgs_status sgsi_file_read(const char *path, size_t limit, uint8_t **bytes, size_t *size);

// A file that appears under its name only when complete: written to "PATH.tmp.PID", flushed,
// fsync'ed, renamed.
typedef struct sgsi_atomic_file {
    FILE *stream;
    char *path, *temporary;
} sgsi_atomic_file;

sgs_status sgsi_atomic_open(sgsi_atomic_file *file, const char *path);
// Renames into place. On any earlier write error removes the temporary file and fails with IO.
sgs_status sgsi_atomic_commit(sgsi_atomic_file *file);
// Drops the temporary file; harmless after commit or a failed open.
void sgsi_atomic_abort(sgsi_atomic_file *file);

// True for a regular file, and for a folder; links are followed.
bool sgsi_is_file(const char *path);
bool sgsi_is_folder(const char *path);

// Creates a folder and its missing parents; fine when it exists already.
sgs_status sgsi_make_folder(const char *path);

// Seconds of a monotonic clock.
double sgsi_seconds(void);

// Counter-based random numbers (SplitMix64 finaliser over seed and counter): the same on every
// machine and for every thread count. Uniform in (0,1); normal by Box-Muller from two counters.
uint64_t sgsi_random_bits(uint64_t seed, uint64_t counter);
double sgsi_random_uniform(uint64_t seed, uint64_t counter);
double sgsi_random_normal(uint64_t seed, uint64_t counter);

// Cameras farther from the origin are refused: Embree's boxes end at 1.8e18, and single precision
// long before.
#define SGSI_FARTHEST_CAMERA 1e15
