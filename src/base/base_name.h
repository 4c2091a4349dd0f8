// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string.h>

// The part of a path behind the last '/'.
static inline const char *sgsi_base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

// Length of a path without the extension of its last part.
static inline int sgsi_stem_length(const char *path)
{
    const char *dot = strrchr(path, '.');
    return (int)(dot && !strchr(dot, '/') ? (size_t)(dot - path) : strlen(path));
}
