// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/path_sandbox.h"

#include <stdlib.h>
#include <string.h>

#include "base/core.h"

// True for one of the folders and everything below it.
static bool is_inside(const sgsi_roots *roots, const char *path)
{
    for (size_t i = 0; i < roots->count; ++i) {
        const size_t length = strlen(roots->path[i]);
        if (!strncmp(path, roots->path[i], length) &&
            (path[length] == '/' || !path[length] || length == 1))
            return true;
    }
    return false;
}

sgs_status sgsi_roots_add(sgsi_roots *roots, const char *folder)
{
    char *real = folder ? realpath(folder, NULL) : NULL;
    if (!real || is_inside(roots, real)) {
        free(real);
        return SGS_STATUS_OK;
    }
    void *grown = roots->path;
    if (!sgsi_grow(&grown, roots->count, roots->count + 1, sizeof *roots->path)) {
        free(real);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for its path", folder);
    }
    roots->path = grown;
    roots->path[roots->count++] = real;
    return SGS_STATUS_OK;
}

void sgsi_roots_free(sgsi_roots *roots)
{
    for (size_t i = 0; i < roots->count; ++i)
        free(roots->path[i]); // allocated by realpath
    sgsi_free(roots->path);
    *roots = (sgsi_roots){0};
}

sgs_status sgsi_roots_check(const sgsi_roots *roots, const char *path, const char *option)
{
    char *real = realpath(path, NULL);
    if (!real || is_inside(roots, real)) { // opening a missing one reports the error
        free(real);
        return SGS_STATUS_OK;
    }
    const sgs_status status = sgsi_fail(
        SGS_STATUS_FORMAT,
        "%s: symbolic link points outside the data set, to %s; replace it with the file%s%s", path,
        real,
        option ? ", link the whole folder, or give the folder of its target with option " : "",
        option ? option : "");
    free(real);
    return status;
}
