// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/file_stems.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"

// A name without components that would leave the folder.
static char *inside(const char *name)
{
    char *const copy = format_text("%s", name), *path = calloc(strlen(name) + 1, 1);
    char *rest = copy, *end = path;
    for (char *part; path && (part = strsep(&rest, "/"));) {
        if (!*part || !strcmp(part, ".") || !strcmp(part, ".."))
            continue;
        if (end != path)
            *end++ = '/';
        end = stpcpy(end, part);
    }
    free(copy);
    if (path && *path)
        return path;
    free(path);
    return format_text("view");
}

static void cut_extension(char *path)
{
    char *const slash = strrchr(path, '/'), *const last = slash ? slash + 1 : path,
                *const dot = strrchr(last, '.');
    if (dot && dot != last)
        *dot = 0;
}

static int by_text(const void *a, const void *b)
{
    char *const *const *x = a, *const *const *y =
                                   b; // pointers into the array of stems, ordered as the views
    const int order = strcmp(**x, **y);
    return order ? order : (*x > *y) - (*x < *y);
}

typedef struct name_list {
    char *const *first;
    size_t stride, count;
} name_list;

static const char *name_at(const name_list *names, size_t i)
{
    return *(char *const *)((const char *)names->first + i * names->stride);
}

static void sort_stems(char **stems, size_t count, char ***order)
{
    for (size_t i = 0; i < count; ++i)
        order[i] = stems + i;
    qsort(order, count, sizeof *order, by_text);
}

// Renames entries that share a stem: to their full names, or, if `numbered`, with a number
// appended. Returns false if there were none.
static bool part_equals(const name_list *names, char **stems, char ***order, bool numbered)
{
    bool changed = false;
    sort_stems(stems, names->count, order);
    for (size_t first = 0, end; first < names->count; first = end) {
        for (end = first + 1; end < names->count && !strcmp(*order[end], *order[first]);)
            ++end;
        for (size_t k = first + numbered; k < end && end - first > 1; ++k) {
            char *const other = numbered ? format_text("%s_%zu", *order[k], k - first + 1)
                                         : inside(name_at(names, (size_t)(order[k] - stems)));
            free(*order[k]);
            *order[k] = other;
            changed = true;
        }
    }
    return changed;
}

static int find_stem(const void *key, const void *stem)
{
    char *const *const *at = stem;
    return strcmp(key, **at);
}

// True if a stem equals another one plus a suffix that its files may have: a.depth next to a.
static bool extends_another(const char *stem, char ***order, size_t count)
{
    char *const start = format_text("%s", stem), *const slash = strrchr(start, '/');
    bool found = false;
    for (char *end = start + strlen(start); !found && end > (slash ? slash + 1 : start); --end)
        if (*end == '.' || !strcmp(end, "_photo") || !strcmp(end, "_flip")) {
            *end = 0;
            found = bsearch(start, order, count, sizeof *order, find_stem);
        }
    free(start);
    return found;
}

// Renames such entries to their full names. False if out of memory.
static bool part_extended(const name_list *names, char **stems, char ***order)
{
    bool *extended = calloc(names->count + 1, sizeof *extended);
    sort_stems(stems, names->count, order);
    for (size_t i = 0; extended && i < names->count; ++i)
        extended[i] = extends_another(stems[i], order, names->count);
    for (size_t i = 0; extended && i < names->count; ++i)
        if (extended[i]) {
            free(stems[i]);
            stems[i] = inside(name_at(names, i));
        }
    free(extended);
    return extended != NULL;
}

char **file_stems(char *const *first_name, size_t stride, size_t count)
{
    const name_list names = {first_name, stride, count};
    char **stems = calloc(count + 1, sizeof *stems);
    char ***order = calloc(count + 1, sizeof *order);
    if (!stems || !order) {
        fail_run("not enough memory for the file names of %zu views", count);
        free(order);
        free(stems);
        return NULL;
    }
    for (size_t i = 0; i < count; ++i) {
        stems[i] = inside(name_at(&names, i));
        cut_extension(stems[i]);
    }
    if (!part_extended(&names, stems, order)) {
        fail_run("not enough memory for the file names of %zu views", count);
        free(order);
        file_stems_free(stems, count);
        return NULL;
    }
    part_equals(&names, stems, order, false);
    while (part_equals(&names, stems, order, true))
        ; // terminates: every pass lengthens the names that it changes
    free(order);
    return stems;
}

void file_stems_free(char **stems, size_t count)
{
    for (size_t i = 0; stems && i < count; ++i)
        free(stems[i]);
    free(stems);
}
