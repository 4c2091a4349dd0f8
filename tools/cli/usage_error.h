// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Messages of a wrong command line, and the exit statuses.

#include <stddef.h>

enum { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

// Prints one line "sparegs: ..." to stderr and returns EXIT_USAGE.
int fail_usage(const char *format, ...) __attribute__((format(printf, 1, 2)));
// Prefix of these messages, such as the file that the options come from; NULL for none.
void fail_usage_within(const char *context);

// " (did you mean 'PREFIXword'?)" for the word that `text` abbreviates or, if it is similar, the
// nearest; "" if there is none, or it is `text` itself. Held by `storage`.
enum { SUGGESTION_LENGTH = 300 };
const char *suggestion(char storage[SUGGESTION_LENGTH], const char *prefix, const char *text,
                       const char *const *words, size_t count);
