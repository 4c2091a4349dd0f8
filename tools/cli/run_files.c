// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/run_files.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/resolved_path.h"
#include "sparegs/run.h"

const char *const run_entries[RUN_ENTRIES] = {
    "point_cloud",   "cameras.json", "input.ply",   "train.csv",  "spare.csv",
    "exposure.json", "summary.json", "regions.bin", "checkpoint", "config.json"};

static const char *const extra_entries[] = {"experiment.json", "log.txt",
                                            ".lock"}; // not moved with a run
static const char *const model_files[] = {"point_cloud.ply", "point_cloud_filter_3D.ply",
                                          "exposure.json"}; // of an iteration
static const char *const experiment_files[] = {"results.json", "results.csv", "post.csv"};

static bool is_among(const char *name, const char *const *names, size_t count)
{
    for (size_t k = 0; k < count; ++k)
        if (!strcmp(name, names[k]))
            return true;
    return false;
}
#define IS_AMONG(name, names) is_among(name, names, sizeof(names) / sizeof *(names))

static bool contains(const char *folder, const char *name)
{
    char *path = format_text("%s/%s", folder, name);
    const bool exists = file_exists(path);
    free(path);
    return exists;
}

static json_t *json_in(const char *folder, const char *name)
{
    char *path = format_text("%s/%s", folder, name);
    json_t *root = load_json(path, 0, NULL);
    free(path);
    return root;
}

// config.json is a common name: that of a run has options, or stands next to a model or checkpoint.
static bool is_run(const char *folder, const char *out)
{
    if (out && !strcmp(folder, out))
        return true;
    if (!contains(folder, "config.json"))
        return false;
    json_t *config = json_in(folder, "config.json");
    const bool has_options = json_is_object(json_object_get(config, "options"));
    json_decref(config);
    return has_options || contains(folder, "point_cloud") || contains(folder, "checkpoint");
}

static bool is_experiment(const char *folder)
{
    json_t *results = json_in(folder, "results.json");
    const bool is = json_is_object(json_object_get(results, "plan")) &&
                    json_is_array(json_object_get(results, "runs"));
    json_decref(results);
    return is;
}

// Cuts the last name off a path and returns it.
static const char *cut_name(char *path)
{
    char *slash = strrchr(path, '/');
    if (!slash)
        return "";
    const char *name = slash + 1;
    while (slash > path && slash[-1] == '/')
        --slash;
    *slash = 0;
    return name;
}

const char *run_file_owner(const char *path, const char *out)
{
    char *folder = resolve_path(path), *next = out ? resolve_path(out) : NULL;
    const char *name = cut_name(folder), *owner = NULL;
    if (IS_AMONG(name, experiment_files)) {
        owner = is_experiment(folder) ? "an experiment" : NULL;
    } else if (IS_AMONG(name, run_entries) || IS_AMONG(name, extra_entries)) {
        owner = is_run(folder, next) ? "a run" : NULL;
    }
    const char *below = owner ? "" : cut_name(folder);
    bool inside = !strcmp(below, "checkpoint");
    if (sgs_run_iteration(below) && IS_AMONG(name, model_files) && file_exists(path))
        inside = !strcmp(cut_name(folder), "point_cloud");
    if (inside && is_run(folder, next))
        owner = "a run";
    free(folder);
    free(next);
    return owner;
}

char *run_file_moved(const char *path, const char *out)
{
    bool moves = path_is_same(path, out);
    for (int k = 0; k < RUN_ENTRIES && !moves; ++k) {
        char *entry = format_text("%s/%s", out, run_entries[k]);
        moves = path_is_same(path, entry) || path_is_below(path, entry);
        free(entry);
    }
    char *whole = resolve_path(path), *folder = resolve_path(out);
    const size_t length = strlen(folder);
    // An entry may be a link: what it leads to does not move.
    moves = moves && !strncmp(whole, folder, length) && (!whole[length] || whole[length] == '/');
    char *moved = moves ? format_text("%s/previous%s", out, whole + length) : NULL;
    free(whole);
    free(folder);
    return moved;
}
