// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Holds files that a data set names to the folders the user named. Names with ".." are refused
// where they are read (dataset.h); this finds what symbolic links would lead out.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/status.h"

enum { SGSI_ROOTS = 12 };

// Real paths of the folders, NULL-padded.
typedef struct sgsi_roots {
    char *path[SGSI_ROOTS];
} sgsi_roots;

// Adds a folder; one that does not exist, or NULL, or one more than there is room for adds nothing.
void sgsi_roots_add(sgsi_roots *roots, const char *folder);
void sgsi_roots_free(sgsi_roots *roots);

// FORMAT, with a sentence that names where `path` leads, if it exists and lies in none of the
// folders. Any thread.
sgs_status sgsi_roots_check(const sgsi_roots *roots, const char *path);
