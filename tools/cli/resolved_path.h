// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Compares paths of which a part need not exist yet.

#include <stdbool.h>

// The absolute path; the part that exists without symbolic links. Release with free().
char *resolve_path(const char *path);
// True if both resolve to the same path.
bool path_is_same(const char *a, const char *b);
// True if `path` resolves to an entry of the folder, at any depth.
bool path_is_below(const char *path, const char *folder);
