// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/rank_work.h"

#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "cli/value_order.h"
#include "options/option_text.h"
#include "processes/rank_group.h"
#include "sparegs/rank_check.h"

// Options that change no result.
static const char free_options[] = "threads|isa|image-cache|quiet|json";

// All lines; NULL after printing the error. Release with free().
static char *describe(const rank_work *work)
{
    char *text = NULL, *program = sgs_rank_program_text();
    size_t size = 0;
    FILE *out = program ? open_memstream(&text, &size) : NULL;
    bool done = true;
    if (out) {
        fputs(program, out);
        options_describe(out, work->line, free_options);
        if (work->model) {
            char hash[17];
            sgs_gaussians_hash(work->model, hash);
            fprintf(out, "model: %s\n", hash);
        }
        done = work->describe(out, work->context);
    }
    free(program);
    if ((!out || fclose(out)) && done) {
        fail_run("not enough memory to compare the ranks");
        done = false;
    }
    if (done)
        return text;
    free(text);
    return NULL;
}

void rank_work_write_drawing(FILE *out, const drawing_values *drawing)
{
    fprintf(out, "white: %.17g\nnear distance: %.17g\n", drawing->white_point,
            drawing->near_distance);
}

static bool write_object(FILE *out, const char *what, const json_t *object)
{
    const size_t count = json_object_size(object);
    const char **names = malloc((count + 1) * sizeof *names);
    size_t k = 0;
    bool done = names != NULL;
    if (!done)
        fail_run("not enough memory to compare the ranks");
    for (void *at = json_object_iter((json_t *)object); at && done;
         at = json_object_iter_next((json_t *)object, at))
        names[k++] = json_object_iter_key(at);
    if (done)
        qsort(names, count, sizeof *names, compare_strings);
    for (k = 0; k < count && done; ++k) {
        char *path = format_text("%s.%s", what, names[k]);
        done = rank_work_write_json(out, path, json_object_get(object, names[k]));
        free(path);
    }
    free(names);
    return done;
}

bool rank_work_write_json(FILE *out, const char *what, const json_t *value)
{
    bool done = true;
    if (json_object_size(value))
        return write_object(out, what, value);
    for (size_t k = 0; k < json_array_size(value) && done; ++k) {
        char *path = format_text("%s[%zu]", what, k);
        done = rank_work_write_json(out, path, json_array_get(value, k));
        free(path);
    }
    if (json_array_size(value))
        return done;
    char *text = value ? json_dumps(value, JSON_ENCODE_ANY) : NULL;
    fprintf(out, "%s: %s\n", what, text ? text : "none");
    free(text);
    return true;
}

bool rank_work_agrees(const rank_work *work)
{
    if (!group_ranks())
        return true;
    char *text = describe(work);
    bool same = group_all(text != NULL);
    if (same && sgs_ranks_compare(group_ranks(), SGS_STATUS_OK, text)) {
        fail_library();
        same = false;
    }
    free(text);
    return same;
}
