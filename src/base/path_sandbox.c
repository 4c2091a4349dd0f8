// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/path_sandbox.h"

#include <stdlib.h>
#include <string.h>

#include "base/core.h"

void sgsi_roots_add(sgsi_roots *roots, const char *folder)
{
    char *real = folder ? realpath(folder, NULL) : NULL;
    for (size_t i = 0; real && i < SGSI_ROOTS; ++i) {
        if (roots->path[i] && strcmp(roots->path[i], real))
            continue;
        if (!roots->path[i])
            roots->path[i] = real;
        else
            free(real);
        return;
    }
    free(real);
}

void sgsi_roots_free(sgsi_roots *roots)
{
    for (size_t i = 0; i < SGSI_ROOTS; ++i)
        free(roots->path[i]); // allocated by realpath
    *roots = (sgsi_roots){0};
}

static bool is_below(const char *path, const char *root)
{
    const size_t length = strlen(root);
    return !strncmp(path, root, length) && (path[length] == '/' || length == 1);
}

sgs_status sgsi_roots_check(const sgsi_roots *roots, const char *path)
{
    char *real = realpath(path, NULL);
    if (!real)
        return SGS_STATUS_OK; // opening it reports the error
    bool below = false;
    for (size_t i = 0; i < SGSI_ROOTS; ++i)
        below = below || (roots->path[i] && is_below(real, roots->path[i]));
    const sgs_status status =
        below ? SGS_STATUS_OK
              : sgsi_fail(SGS_STATUS_FORMAT,
                          "%s: a link leads out of the data set, to %s; replace it by the file",
                          path, real);
    free(real);
    return status;
}
