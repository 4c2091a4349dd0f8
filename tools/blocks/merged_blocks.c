// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "blocks/merged_blocks.h"

#include <stdlib.h>
#include <string.h>

#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"
#include "run/exposure_file.h"
#include "run/run_record.h"
#include "sparegs/model_edit.h"
#include "sparegs/model_file.h"
#include "sparegs/option_descriptors.h"

static char *block_path(const merged_blocks *merged, size_t block, const char *file)
{
    return format_text("%s/block_%zu%s%s", merged->folder, block, *file ? "/" : "", file);
}

// A JSON file of a block, or NULL after printing the error.
static json_t *read_block_file(const merged_blocks *merged, size_t block, const char *file)
{
    char *path = block_path(merged, block, file), *folder = block_path(merged, block, "");
    json_t *root = NULL;
    if (!file_exists(folder)) {
        fail_run("%s: block %zu of %zu is missing; train it with 'sparegs train SCENE -o %s "
                 "--region %s:%zu --init MODEL'",
                 folder, block, merged->plan.count, folder, merged->plan_path, block);
    } else if (!file_exists(path)) {
        fail_run("%s: block %zu is unfinished: %s does not exist; continue it with --resume",
                 folder, block, file);
    } else {
        root = read_json(path);
    }
    free(path);
    free(folder);
    return root;
}

// The region of a config as it would be recorded for this box.
static bool has_region(const json_t *config, const sgs_box *box)
{
    char text[128];
    sgs_train_options options = sgs_train_options_default();
    options.region = *box;
    sgs_train_option_text(sgs_train_option_find("region"), &options, text, sizeof text);
    const char *region = json_string_value(config_option(config, "region"));
    return region && !strcmp(region, text);
}

// True if the options that a rendering depends on are those of block 0.
static bool agrees(const merged_blocks *merged, size_t block)
{
    static const char *const names[] = {
        "filter", "compact_box", "background", "sh_degree", "train_space",  "white",
        "alpha",  "exposure",    "images",     "masks",     "invert_masks", "input_colorspace"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        const json_t *first = config_option(merged->configs[0], names[k]),
                     *own = config_option(merged->configs[block], names[k]);
        if (json_equal(first, own) || (!first && !own))
            continue;
        fail_run("%s/block_%zu: option %s differs from that of block 0; train all blocks with the "
                 "same options",
                 merged->folder, block, names[k]);
        return false;
    }
    return true;
}

// True if the block started from the same model as block 0. Blocks of several models do not fit
// together at their faces.
static bool has_common_start(const merged_blocks *merged, size_t block)
{
    const json_t *first = json_object_get(merged->configs[0], "init_hash"),
                 *own = json_object_get(merged->configs[block], "init_hash");
    if (!first || !own || json_equal(first, own))
        return true;
    fail_run("%s/block_%zu: initial model differs from that of %s/block_0; retrain one of them "
             "with the --init of the other and --overwrite",
             merged->folder, block, merged->folder);
    return false;
}

static bool check_block(merged_blocks *merged, size_t block)
{
    json_t *const config = read_block_file(merged, block, "config.json");
    merged->configs[block] = config;
    if (!config)
        return false;
    const json_t *record = json_object_get(config, "block");
    const char *scene = json_string_value(json_object_get(record, "scene_hash"));
    if (!scene || strcmp(scene, merged->plan.scene) != 0) {
        fail_run("%s/block_%zu: was trained on a scene other than that of %s", merged->folder,
                 block, merged->plan_path);
        return false;
    }
    if (json_integer_value(json_object_get(record, "index")) != (json_int_t)block ||
        !has_region(config, &merged->plan.boxes[block])) {
        fail_run("%s/block_%zu: its box differs from that of block %zu in %s", merged->folder,
                 block, block, merged->plan_path);
        return false;
    }
    json_t *summary = read_block_file(merged, block, "summary.json");
    if (!summary)
        return false;
    const char *reason = json_string_value(json_object_get(summary, "stop_reason"));
    const bool complete = run_record_is_complete(summary);
    if (!complete)
        fail_run("%s/block_%zu: is unfinished (stopped by: %s); continue it with --resume",
                 merged->folder, block, reason ? reason : "unknown");
    json_decref(summary);
    return complete && agrees(merged, block) && has_common_start(merged, block);
}

bool merged_blocks_check(merged_blocks *merged, const char *folder)
{
    *merged = (merged_blocks){.folder = format_text("%s", folder),
                              .plan_path = format_text("%s/blocks.json", folder)};
    if (!block_plan_read(merged->plan_path, &merged->plan))
        return false;
    merged->configs = calloc(merged->plan.count, sizeof(json_t *));
    merged->counts = calloc(merged->plan.count, sizeof *merged->counts);
    if (!merged->configs || !merged->counts)
        exit(fail_run("out of memory"));
    for (size_t b = 0; b < merged->plan.count; ++b)
        if (!check_block(merged, b))
            return false;
    return true;
}

bool merged_blocks_hold_out(const merged_blocks *merged, const sgs_scene *scene)
{
    ptrdiff_t trained = 0;
    for (size_t b = 0; b < merged->plan.count && trained <= 0; ++b) {
        char *folder = block_path(merged, b, "");
        trained = run_record_trained(folder, merged->configs[b], scene, SGS_SPLIT_TEST);
        if (trained > 0)
            fail_run("%s: was trained on %td of the %zu held-out images of the merged model; train "
                     "all blocks with the same --eval, --test-every or --test-images",
                     folder, trained, scene_split_count(scene, SGS_SPLIT_TEST));
        free(folder);
    }
    return trained <= 0;
}

// Appends the block's primitives in its box.
static bool append_block(merged_blocks *merged, size_t block, const sgs_gaussians *from)
{
    const sgs_box *box = &merged->plan.boxes[block];
    size_t to = merged->model->count;
    merged->counts[block] = block_plan_count(from, box);
    if (sgs_gaussians_resize(merged->model, to + merged->counts[block])) {
        fail_library();
        return false;
    }
    for (size_t i = 0; i < from->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(from, i, params);
        if (sgs_box_contains(box, params + SGS_PARAM_MEAN))
            sgs_gaussians_set(merged->model, to++, params);
    }
    return true;
}

static bool read_model(merged_blocks *merged, size_t block)
{
    char *folder = block_path(merged, block, "");
    model_path located;
    sgs_gaussians *own = NULL;
    sgs_model_info info;
    bool done = model_locate(folder, &located);
    if (done && sgs_model_read(located.ply_path, NULL, &own, &info)) {
        fail_library();
        done = false;
    }
    if (done && block == 0) {
        done = !sgs_gaussians_create(own->count, &merged->model);
        if (!done)
            fail_library();
        else
            merged->model->sh_degree = own->sh_degree;
    }
    if (done)
        merged->iteration =
            located.iteration > merged->iteration ? located.iteration : merged->iteration;
    done = done && append_block(merged, block, own);
    model_path_free(&located);
    sgs_gaussians_destroy(own);
    free(folder);
    return done;
}

static bool read_exposures(merged_blocks *merged, size_t block)
{
    if (!json_is_true(config_option(merged->configs[block], "exposure")))
        return true;
    bool failed = false;
    char *path = block_path(merged, block, "exposure.json");
    json_t *own = exposure_read(path, &failed);
    free(path);
    if (!merged->exposures)
        merged->exposures = json_object();
    if (own)
        json_object_update_missing(merged->exposures, own);
    json_decref(own);
    return !failed;
}

bool merged_blocks_read(merged_blocks *merged)
{
    for (size_t b = 0; b < merged->plan.count && !interrupt_signal(); ++b) {
        progress_count("reading blocks", b, merged->plan.count);
        if (!read_model(merged, b) || !read_exposures(merged, b)) {
            progress_end();
            return false;
        }
    }
    progress_end();
    return true;
}

void merged_blocks_free(merged_blocks *merged)
{
    for (size_t b = 0; b < merged->plan.count && merged->configs; ++b)
        json_decref(merged->configs[b]);
    free(merged->configs);
    free(merged->counts);
    json_decref(merged->exposures);
    sgs_gaussians_destroy(merged->model);
    block_plan_free(&merged->plan);
    free(merged->folder);
    free(merged->plan_path);
    *merged = (merged_blocks){0};
}
