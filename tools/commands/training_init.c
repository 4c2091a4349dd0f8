// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The initial model of `sparegs train --init`. A checkpoint replaces it, so that a run with one
// does not read it again: it may be gone, or be the model of an earlier run in OUT that --overwrite
// has moved to OUT/previous. A run with a region also takes its targets from it.

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/resolved_path.h"
#include "cli/run_files.h"
#include "commands/training.h"
#include "processes/rank_group.h"

static bool read_model(training *run, sgs_gaussians **init)
{
    model_path located;
    bool read = model_locate(run->values.init, &located) && model_read(&located, NULL, init);
    if (read && !(*init)->count) {
        fail_run("%s: contains no primitives; train without --init", located.ply_path);
        read = false;
    }
    if (read) {
        model_warn_space(&located, run->scene->space);
        sgs_gaussians_hash(*init, run->init_hash);
    }
    model_path_free(&located);
    return read;
}

// The recorded hash of the initial model if a checkpoint replaces the model, else NULL. Collective.
static const char *hash_of_replaced(const training *run)
{
    const char *recorded = json_string_value(config_option(run->stored, "init")),
               *hash = json_string_value(json_object_get(run->stored, "init_hash"));
    if (!hash || !recorded || strcmp(recorded, run->values.init) != 0 || run->values.region)
        return NULL;
    const bool found = group_leads() && run_folder_has_checkpoint(&run->folder);
    return group_number(found) ? hash : NULL;
}

bool training_init_read(training *run, sgs_gaussians **init)
{
    const char *hash = run->values.init ? hash_of_replaced(run) : NULL;
    run->init_is_replaced = hash != NULL;
    if (!run->values.init)
        return true;
    if (!hash)
        return read_model(run, init);
    snprintf(run->init_hash, sizeof run->init_hash, "%s", hash);
    // One inert primitive in its place.
    const bool made = !sgs_gaussians_create(1, init) && !sgs_gaussians_resize(*init, 1);
    if (!made)
        fail_library();
    return made;
}

void training_init_recall(training *run)
{
    const char *recorded = json_string_value(config_option(run->stored, "init"));
    if (!recorded || !run->values.init)
        return;
    char *moved = run_file_moved(run->values.init, run->values.output);
    if (path_is_same(moved ? moved : run->values.init, recorded)) {
        run->values.init = recorded;
    } else if (moved && file_exists(moved)) {
        run->values.init = run->init_moved = moved;
        return;
    }
    free(moved);
}

bool training_init_stays(const training *run)
{
    const train_values *values = &run->values;
    if (!values->init || !values->overwrite || !run_folder_replaces_previous(&run->folder))
        return true;
    char *previous = format_text("%s/previous", values->output);
    const bool deleted = file_exists(values->init) && (path_is_same(values->init, previous) ||
                                                       path_is_below(values->init, previous));
    free(previous);
    if (deleted)
        fail_run("%s: --overwrite deletes this initial model with %s/previous; move it away, or "
                 "choose another folder with -o",
                 values->init, values->output);
    return !deleted;
}

void training_init_follow(training *run)
{
    const train_values *values = &run->values;
    if (!values->init || values->resume || !run_folder_is_used(&run->folder))
        return;
    run->init_moved = run_file_moved(values->init, values->output);
    if (run->init_moved)
        run->values.init = run->init_moved;
}
