// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Restricts the files of a data set to the folders that the user named. Names with ".." are
// rejected when they are read (dataset.h); this module detects symbolic links that lead elsewhere.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/status.h"

// Real paths of the folders. Zero-initialise.
typedef struct sgsi_roots {
    char **path;
    size_t count;
} sgsi_roots;

// Adds a folder. Ignores NULL, a missing folder, and folders below one of the others. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_roots_add(sgsi_roots *roots, const char *folder);
void sgsi_roots_free(sgsi_roots *roots);

// Fails with FORMAT if `path` exists and resolves to a file outside of all folders; the error names
// its target and, if `option` is not NULL, this option for the folder of such files. Thread-safe.
sgs_status sgsi_roots_check(const sgsi_roots *roots, const char *path, const char *option);
