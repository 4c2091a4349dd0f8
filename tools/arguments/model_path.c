// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "arguments/model_path.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "arguments/recorded_options.h"
#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/compress.h"
#include "sparegs/model_file.h"
#include "sparegs/run.h"

static bool is_folder(const char *path)
{
    struct stat info;
    return !stat(path, &info) && S_ISDIR(info.st_mode);
}

// The model in a folder such as point_cloud/iteration_7000, or NULL. Release with free().
static char *iteration_model(const char *folder)
{
    char *path = format_text("%s/point_cloud.ply", folder);
    if (is_folder(folder) && file_exists(path) && !is_folder(path))
        return path;
    free(path);
    return NULL;
}

bool model_is(const char *model)
{
    sgs_model_format format;
    char *ply = iteration_model(model);
    free(ply);
    if (ply)
        return true;
    // A file that is missing is a model by its name.
    if (sgs_model_format_detect(model, &format) || sgs_is_compressed(model) ||
        (!is_folder(model) && sgs_model_format_of_name(model, &format)))
        return true;
    char *clouds = format_text("%s/point_cloud", model);
    const bool is = is_folder(clouds);
    free(clouds);
    return is;
}

// The run folder OUT of a folder OUT/point_cloud/iteration_N, an absolute path, or NULL. Release
// with free(). *iteration: N, or 0 for another name.
static char *run_of_iteration(const char *folder, int *iteration)
{
    static const char middle[] = "/point_cloud";
    char *run = realpath(folder, NULL), *slash = run ? strrchr(run, '/') : NULL;
    *iteration = slash ? sgs_run_iteration(slash + 1) : 0;
    if (slash)
        *slash = 0;
    const size_t length = run ? strlen(run) : 0, tail = sizeof middle - 1;
    if (length > tail && !strcmp(run + length - tail, middle)) {
        run[length - tail] = 0;
        return run;
    }
    *iteration = 0;
    free(run);
    return NULL;
}

// Reads RUN/config.json if it exists. Takes `run`, which may be NULL.
static void read_run_config(char *run, model_path *located)
{
    char *config = run ? format_text("%s/config.json", run) : NULL;
    if (config && file_exists(config)) {
        json_error_t error;
        located->config = load_json(config, 0, &error);
        if (!located->config) {
            char *fault = json_load_fault(config, &error);
            print_warning("%s; its options are ignored", fault);
            free(fault);
        } else {
            recorded_options_check(located->config, config);
        }
    }
    free(config);
    located->run = run;
}

bool model_locate(const char *model, model_path *located)
{
    *located = (model_path){0};
    if (!file_exists(model)) {
        fail_run("%s: no such model; specify a model file or a run folder", model);
        return false;
    }
    sgs_model_format format;
    if (!is_folder(model) || sgs_model_format_detect(model, &format)) {
        located->ply_path = format_text("%s", model);
        return true;
    }
    located->ply_path = iteration_model(model);
    if (located->ply_path) {
        read_run_config(run_of_iteration(model, &located->iteration), located);
        return true;
    }
    char path[4096];
    if (sgs_run_model_path(model, path, sizeof path, &located->iteration)) {
        fail_library();
        return false;
    }
    located->ply_path = format_text("%s", path);
    read_run_config(format_text("%s", model), located);
    return true;
}

bool model_locate_of_run(const char *model, const char *of, model_path *located)
{
    if (!model_locate(model, located))
        return false;
    if (!of)
        return true;
    model_path other;
    if (!model_locate(of, &other))
        return false;
    const bool is_run = other.config != NULL;
    if (!is_run)
        fail_run("%s: not a run folder: config.json does not exist or is damaged", of);
    free(other.ply_path);
    other.ply_path = located->ply_path;
    other.iteration = 0; // the model is none of the run's own
    located->ply_path = NULL;
    model_path_free(located);
    *located = other;
    return is_run;
}

void model_path_free(model_path *located)
{
    free(located->ply_path);
    free(located->run);
    json_decref(located->config);
    *located = (model_path){0};
}

json_t *config_option(const json_t *config, const char *name)
{
    return config ? json_object_get(json_object_get(config, "options"), name) : NULL;
}
