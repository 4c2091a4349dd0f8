// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// How the library reports failures: one status code per fallible call, one thread-local sentence
// that names the file, the place in it and the fix, and a callback for warnings. The library itself
// never prints and never exits; libpng prints an error for some invalid PNG files.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/export.h"

#ifdef __cplusplus
extern "C" {
#endif

// X-macro: enumerator suffix, human text.
#define SGS_STATUS_LIST(X)                                                                         \
    X(OK, "success")                                                                               \
    X(INVALID_ARGUMENT, "invalid argument")                                                        \
    X(OUT_OF_MEMORY, "out of memory")                                                              \
    X(IO, "file cannot be read or written")                                                        \
    X(FORMAT, "file content is invalid")                                                           \
    X(UNSUPPORTED, "not supported")                                                                \
    X(LIMIT, "a limit was reached")                                                                \
    X(CANCELLED, "cancelled by the caller")                                                        \
    X(INTERNAL, "internal error")

typedef enum sgs_status {
#define SGS_STATUS_ENUM(name, text) SGS_STATUS_##name,
    SGS_STATUS_LIST(SGS_STATUS_ENUM)
#undef SGS_STATUS_ENUM
} sgs_status;

// Short constant text for a status; never NULL, cannot fail.
SGS_API const char *sgs_status_text(sgs_status status);

// The sentence that explains the last failed call of this thread, "" if there was none. Owned by
// the library; valid until the next failing call on the same thread. Read it right after the
// failure: a successful call may overwrite it if it recovered from an internal failure.
SGS_API const char *sgs_last_error(void);

// Structs of options begin with struct_size. sgs_X_options_init(&options, sizeof options) writes
// the defaults and that size, at most `size` bytes, so that a program may be older than the
// library; sgs_X_options_default() calls it. A library refuses a struct_size larger than its own.

// Functions of the caller that the library calls must return: they must not throw an exception or
// call longjmp, which would leave locks held and objects unfinished. They run in the floating-point
// mode of the thread that made the call, except warnings and the body of sgs_parallel_ranges, which
// may run in the library's: rounding to nearest, no traps, denormals flushed to zero.

// Progress of a long call: `done` of `total` steps. Calls are serialised, but may come from a
// thread of the library; they must not call the library on the objects in use. Returning false
// cancels: the long call ends soon and fails with SGS_STATUS_CANCELLED.
typedef bool (*sgs_progress_fn)(void *user, size_t done, size_t total);

// Receives one line (no newline) per warning. May be called from several threads at the same time;
// must not call the library. `message` is valid during the call.
typedef void (*sgs_warning_fn)(void *user, const char *message);

// Sets the receiver of warnings of the whole process; NULL drops warnings (the default). Call it
// while no other library call runs. Cannot fail.
SGS_API void sgs_warning_handler_set(sgs_warning_fn fn, void *user);

#ifdef __cplusplus
}
#endif
