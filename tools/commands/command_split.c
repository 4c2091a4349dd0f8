// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs split`: plans the blocks of a scene and writes the scripts that train them.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "arguments/shared_options.h"
#include "blocks/block_plan.h"
#include "blocks/block_scripts.h"

static const char description[] =
    "Divides SCENE, which has sparse points, into blocks that are trained separately, for scenes "
    "too large for one machine. The bounding box of the cameras is bisected along its longest "
    "side, so that blocks have a similar product of views and sparse points; the outer blocks "
    "extend to infinity. A view belongs to a block if enough of its lines of sight to sparse "
    "points cross the cell of the block, enlarged by a margin.\nWrites into DIR:\n  blocks.json  "
    "boxes and views of the blocks\n  coarse.sh    trains a coarse model of the whole scene in "
    "DIR/coarse\n  blocks.sh    trains the blocks from it in DIR/block_N, one after another or as "
    "a Slurm "
    "array job\nBoth scripts pass their arguments to 'sparegs train'. Afterwards, 'sparegs merge "
    "DIR -o OUT' joins the blocks. The guide is in tools/manual/cluster.md.";

typedef struct split_values {
    const char *output;
    sgs_block_options plan;
} split_values;

static const option split_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = offsetof(split_values, output),
     .argument = "DIR",
     .help = "folder for the plan, the scripts and the blocks (required)"},
    {.name = "blocks",
     .kind = OPTION_INTEGER,
     .offset = offsetof(split_values, plan.count),
     .low = 2,
     .high = SGS_BLOCKS_MAX,
     .argument = "K",
     .initial = "2",
     .help = "number of blocks"},
    {.name = "margin",
     .kind = OPTION_REAL,
     .offset = offsetof(split_values, plan.margin),
     .low = 0,
     .high = 10,
     .argument = "X",
     .initial = "0.2",
     .unit = "x side of the cell",
     .help = "enlargement of a cell on each side before views are assigned to it"},
    {.name = "share",
     .kind = OPTION_REAL,
     .offset = offsetof(split_values, plan.share),
     .low = 0,
     .high = 1,
     .argument = "X",
     .initial = "0.1",
     .help = "fraction of a view's lines of sight, to the sparse points in its image, that must "
             "cross the enlarged cell of a block"},
};

static bool show_planning(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("views", done, total);
    return true;
}

static bool plan_blocks(const sgs_scene *scene, const split_values *values, sgs_blocks *blocks)
{
    sgs_block_options options = values->plan;
    options.progress = show_planning;
    progress_work_start();
    const sgs_status status = sgs_blocks_plan(scene, &options, blocks);
    progress_end();
    if (status)
        fail_library();
    return !status;
}

static void print_plan(const sgs_blocks *blocks)
{
    printf("%5s %9s %7s   %s\n", "block", "points", "views", "box");
    for (size_t b = 0; b < blocks->count; ++b) {
        const sgs_block *block = &blocks->blocks[b];
        printf("%5zu %9zu %7zu  ", b, block->points, block->view_count);
        for (int k = 0; k < 3; ++k)
            printf(" %c [%.4g, %.4g)", "xyz"[k], (double)block -> box.low[k],
                   (double)block->box.high[k]);
        putchar('\n');
    }
}

static json_t *plan_result(const json_t *plan)
{
    json_t *list = json_array();
    size_t b;
    json_t *entry;
    json_array_foreach(json_object_get(plan, "blocks"), b, entry)
    {
        json_t *copy = json_copy(entry);
        json_object_set_new(
            copy, "views",
            json_integer((json_int_t)json_array_size(json_object_get(entry, "views"))));
        json_array_append_new(list, copy);
    }
    return list;
}

static bool write_plan(const sgs_scene *scene, const sgs_blocks *blocks, const split_values *values,
                       bool json)
{
    char *path = format_text("%s/blocks.json", values->output);
    bool done = !file_exists(path);
    if (!done)
        fail_run("%s: already exists, and trained blocks depend on it; choose another folder",
                 path);
    json_t *plan = block_plan_json(scene, blocks, &values->plan);
    if (json)
        reported_files_begin();
    else if (done)
        print_plan(blocks);
    reported_files_set("blocks", plan_result(plan));
    // The plan last: it marks the folder as complete.
    done = done && make_folder(values->output) &&
           block_scripts_write(values->output, scene->path, blocks->count) &&
           write_json(path, json_incref(plan));
    if (done)
        report_file(path);
    json_decref(plan);
    free(path);
    return (!json || reported_files_print()) && done;
}

int command_split(int argc, char **argv)
{
    command_call call;
    split_values values = {.plan = sgs_block_options_default()};
    const command_spec spec = {.name = "split",
                               .synopsis = "SCENE -o DIR [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Blocks",
                               .options = split_options,
                               .option_count = sizeof split_options / sizeof *split_options,
                               .values = &values};
    const int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    if (!values.output)
        return fail_usage("split requires an output folder, -o DIR; usage: sparegs split %s",
                          spec.synopsis);
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = false;
    options.cameras_only = true;
    sgs_scene *scene;
    if (sgs_scene_load(call.line.operands[0], &options, &scene))
        return fail_library();
    sgs_blocks blocks = {0};
    const bool done = scene_names_are_text(scene, "a plan of blocks") &&
                      plan_blocks(scene, &values, &blocks) &&
                      write_plan(scene, &blocks, &values, call.common.json);
    sgs_blocks_free(&blocks);
    sgs_scene_destroy(scene);
    return done ? EXIT_DONE : EXIT_FAILED;
}
