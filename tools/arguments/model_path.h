// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The MODEL argument: a model file, a SOG folder, or the folder of a run or of one of its
// iterations.

#include <jansson.h>
#include <stdbool.h>

// A resolved MODEL argument. The struct owns ply_path, a file of any model format or a SOG folder,
// and run, the run folder or NULL: MODEL, or the one that holds the iteration MODEL. config is the
// parsed config.json of the run or NULL.
typedef struct model_path {
    char *ply_path, *run;
    json_t *config;
    int iteration; // of a run folder; 0 for a file
} model_path;

// True if MODEL is a model file, a SOG folder or a folder with point_cloud/.
bool model_is(const char *model);
// False after printing the error.
bool model_locate(const char *model, model_path *located);
// The same for a model that was derived from the run in the folder `of`, of --run: run and config
// are those of `of`. NULL: as model_locate.
bool model_locate_of_run(const char *model, const char *of, model_path *located);
void model_path_free(model_path *located);

// The member `name` of config's "options", or NULL. Accepts NULL.
json_t *config_option(const json_t *config, const char *name);
