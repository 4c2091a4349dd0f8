// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/path_sandbox.h"

#include <stdlib.h>
#include <string.h>

#include "base/core.h"

static bool is_below(const char *path, const char *root)
{
    const size_t length = strlen(root);
    return !strncmp(path, root, length) && (path[length] == '/' || length == 1);
}

static bool is_inside(const sgsi_roots *roots, const char *path)
{
    for (size_t i = 0; i < roots->count; ++i)
        if (!strcmp(path, roots->path[i]) || is_below(path, roots->path[i]))
            return true;
    return false;
}

sgs_status sgsi_roots_add(sgsi_roots *roots, const char *folder)
{
    char *real = folder ? realpath(folder, NULL) : NULL;
    if (!real || is_inside(roots, real)) {
        free(real);
        return SGS_STATUS_OK;
    }
    char **grown = realloc(roots->path, (roots->count + 1) * sizeof *grown);
    if (!grown) {
        free(real);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory for its path", folder);
    }
    grown[roots->count++] = real;
    roots->path = grown;
    return SGS_STATUS_OK;
}

void sgsi_roots_free(sgsi_roots *roots)
{
    for (size_t i = 0; i < roots->count; ++i)
        free(roots->path[i]);
    free(roots->path);
    *roots = (sgsi_roots){0};
}

sgs_status sgsi_roots_check(const sgsi_roots *roots, const char *path)
{
    char *real = realpath(path, NULL);
    if (!real || is_inside(roots, real)) { // opening a missing one reports the error
        free(real);
        return SGS_STATUS_OK;
    }
    const sgs_status status = sgsi_fail(
        SGS_STATUS_FORMAT, "%s: a link leads out of the data set, to %s; replace it by the file",
        path, real);
    free(real);
    return status;
}
