// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/earlier_results.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/progress.h"

static bool fail_foreign(const char *path)
{
    fail_run("%s: is not a file of an experiment and would be replaced; move it away, or choose "
             "another folder with -o",
             path);
    return false;
}

// True if the file does not exist, or begins as the tables of an experiment.
static bool is_table(const char *path)
{
    static const char start[] = "scene,pipeline,variant,seed,";
    char text[sizeof start] = "";
    if (!file_exists(path))
        return true;
    FILE *stream = open_input(path, NULL);
    const bool is = stream && fread(text, 1, sizeof start - 1, stream) == sizeof start - 1 &&
                    !strcmp(text, start);
    if (stream)
        fclose(stream);
    return is;
}

static bool table_admits(const char *folder, const char *name)
{
    char *path = format_text("%s/%s", folder, name);
    const bool admits = is_table(path) || fail_foreign(path);
    free(path);
    return admits;
}

static bool plan_has(const experiment_plan *plan, const char *folder, const char *name)
{
    const size_t length = strlen(folder);
    for (size_t i = 0; i < plan->count; ++i)
        if (!strcmp(plan->runs[i].folder + length + 1, name)) // "FOLDER/NAME"
            return true;
    return false;
}

// False after printing the error if a run is not in the plan: its results would be dropped.
static bool runs_admit(const json_t *results, const char *folder, const experiment_plan *plan)
{
    size_t k;
    const json_t *run;
    json_array_foreach(json_object_get(results, "runs"), k, run)
    {
        const char *name = json_string_value(json_object_get(run, "folder"));
        if (!name || plan_has(plan, folder, name))
            continue;
        fail_run("%s: holds results of another plan, with run %s; choose another folder with -o, "
                 "add this run to the plan, or remove results.json, which is written again for "
                 "the runs of this plan",
                 folder, name);
        return false;
    }
    return true;
}

bool earlier_results_admit(const char *folder, const experiment_plan *plan)
{
    char *path = format_text("%s/results.json", folder);
    json_t *results = load_json(path, 0, NULL);
    const bool is_own = json_is_object(json_object_get(results, "plan")) &&
                        json_is_array(json_object_get(results, "runs"));
    const bool admits = (is_own || !file_exists(path) || fail_foreign(path)) &&
                        table_admits(folder, "results.csv") &&
                        (!plan->post.count || table_admits(folder, "post.csv")) &&
                        runs_admit(results, folder, plan);
    json_decref(results);
    free(path);
    return admits;
}

void earlier_results_drop_post(const char *folder)
{
    char *path = format_text("%s/post.csv", folder);
    if (is_table(path))
        unlink(path);
    free(path);
}
