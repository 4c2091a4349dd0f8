// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Files named by the user or found in a folder: their kind by name, and opening them.

#include <stdbool.h>
#include <stdio.h>

// Opens a regular file for reading; a named pipe without a writer does not block it. Paths below
// /dev may be pipes: /dev/stdin, and /dev/fd/N of a shell's <(COMMAND). NULL after setting errno,
// and *reason (may be NULL) to what is wrong.
FILE *open_input(const char *path, const char **reason);

// True if a file name ends in one of ".a|.b", in upper or lower case.
bool name_has_ending(const char *name, const char *endings);
