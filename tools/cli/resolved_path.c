// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/resolved_path.h"

#include <stdlib.h>
#include <string.h>

#include "cli/output.h"

char *resolve_path(const char *path)
{
    char *whole = format_text("%s%s", *path == '/' ? "" : "./", path);
    char *head = format_text("%s", whole), *real = realpath(head, NULL);
    for (char *slash; !real && (slash = strrchr(head, '/'));) {
        *slash = 0;
        real = realpath(*head ? head : "/", NULL);
    }
    char *joined = format_text("%s%s", real && strcmp(real, "/") ? real : "", whole + strlen(head));
    free(real);
    free(head);
    free(whole);
    return joined;
}

bool path_is_same(const char *a, const char *b)
{
    char *first = resolve_path(a), *second = resolve_path(b);
    const bool same = !strcmp(first, second);
    free(first);
    free(second);
    return same;
}

bool path_is_below(const char *path, const char *folder)
{
    char *whole = resolve_path(path), *top = resolve_path(folder);
    const size_t length = strlen(top);
    const bool below = !strncmp(whole, top, length) && whole[length] == '/';
    free(whole);
    free(top);
    return below;
}
