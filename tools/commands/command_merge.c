// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs merge`: joins the trained blocks of a plan to one model, in a run folder like that of a
// training. All blocks are checked before anything is written.

#include <stdlib.h>
#include <string.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "blocks/block_plan.h"
#include "blocks/merged_blocks.h"
#include "blocks/seam_report.h"
#include "cli/commands.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/resolved_path.h"
#include "processes/interrupt.h"
#include "run/exposure_file.h"
#include "run/run_folder.h"
#include "run/run_record.h"
#include "sparegs/model_file.h"
#include "sparegs/run.h"

static const char description[] =
    "Joins the blocks that were trained in DIR (block_0, block_1, ... of the plan DIR/blocks.json) "
    "into one model: each block contributes the primitives with centres in its own box. OUT is a "
    "run folder for eval, render, view and other commands. A block that is missing, unfinished, of "
    "another scene or plan, or trained on an image that is held out is an error.\nThen compares "
    "the PSNR near the seams with that "
    "elsewhere, in held-out images if there are any, and warns if the seams are at least 0.5 dB "
    "worse than in the coarse model that the blocks started from. The figures are also in "
    "OUT/summary.json. SCENE, its images and their split default to those of the blocks.";

typedef struct merge_values {
    const char *output;
    const char *reference;
    int seam_images;
    bool overwrite;
} merge_values;

static const option merge_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = offsetof(merge_values, output),
     .argument = "OUT",
     .help = "run folder of the merged model (required)"},
    {.name = "seam-images",
     .kind = OPTION_INTEGER,
     .offset = offsetof(merge_values, seam_images),
     .low = 0,
     .high = 1000000,
     .argument = "N",
     .initial = "100",
     .shown = "100, 0 = none",
     .unit = "images",
     .help = "maximum number of images for the comparison at the seams"},
    {.name = "seam-reference",
     .kind = OPTION_TEXT,
     .offset = offsetof(merge_values, reference),
     .argument = "MODEL|none",
     .shown = "the model that the blocks started from, if it is still there",
     .help = "model of the whole scene whose PSNR at the seams and elsewhere is subtracted"},
    {.name = "overwrite",
     .kind = OPTION_FLAG,
     .offset = offsetof(merge_values, overwrite),
     .help = "replace the run in OUT, which moves to OUT/previous"},
};

typedef struct merging {
    const merge_values *values;
    const common_values *common;
    merged_blocks blocks;
    model_path start;            // the model that the blocks started from, if it was found
    sgs_gaussians *reference;    // of the seams, or NULL
    json_t *reference_exposures; // of its own run, or NULL
    sgs_scene *scene;
    scene_values data;
    drawing_values drawing;
    run_folder folder;
    seam_report seams;
} merging;

// The config.json of the merged run: that of the blocks, for the whole scene.
static json_t *merged_config(const merging *m)
{
    json_t *config = json_deep_copy(m->blocks.configs[0]);
    json_t *options = json_object_get(config, "options"), *record = json_object();
    json_object_set_new(options, "region", json_string("none"));
    json_object_del(config, "block");
    json_object_del(config, "resumed");
    json_set_path(record, "plan", "%s", m->blocks.plan_path);
    json_object_set_new(record, "blocks", json_integer((json_int_t)m->blocks.plan.count));
    json_object_set_new(record, "scene_hash", json_string(m->blocks.plan.scene));
    json_object_set_new(config, "merged", record);
    run_record_split(config, m->scene);
    return config;
}

static json_t *summary_json(const merging *m)
{
    const merged_blocks *blocks = &m->blocks;
    char hash[17];
    sgs_gaussians_hash(blocks->model, hash);
    json_t *summary = json_result_new(), *counts = json_array();
    for (size_t b = 0; b < blocks->plan.count; ++b)
        json_array_append_new(counts, json_integer((json_int_t)blocks->counts[b]));
    json_object_set_new(summary, "iterations", json_integer(blocks->iteration));
    json_object_set_new(summary, "gaussians", json_integer((json_int_t)blocks->model->count));
    json_object_set_new(summary, "block_gaussians", counts);
    json_object_set_new(summary, "seams",
                        m->seams.images ? seam_report_json(&m->seams) : json_null());
    json_object_set_new(summary, "model_hash", json_string(hash));
    json_set_path(summary, "scene", "%s", m->scene->path);
    json_set_path(summary, "output", "%s", m->values->output);
    json_set_path(summary, "model", "%s/point_cloud/iteration_%d/point_cloud.ply",
                  m->values->output, blocks->iteration);
    return summary;
}

static bool write_exposures(const merging *m)
{
    if (!m->blocks.exposures)
        return true;
    char *path = format_text("%s/exposure.json", m->values->output);
    const bool written = write_json(path, json_incref(m->blocks.exposures));
    free(path);
    return written;
}

// Writes the run; config.json last: it marks OUT as a run.
static bool write_run(merging *m)
{
    const char *out = m->values->output;
    char *cameras = format_text("%s/cameras.json", out),
         *config = format_text("%s/config.json", out);
    const sgs_model_write_options options = model_write_options(&m->drawing);
    const bool replaces = run_folder_is_used(&m->folder);
    bool done = !replaces || run_folder_set_aside(&m->folder);
    if (done) {
        done = !sgs_scene_write_cameras_json(m->scene, cameras);
        if (!done)
            fail_library();
        done = done &&
               run_folder_save_model(&m->folder, m->blocks.model, m->blocks.iteration, &options) &&
               write_exposures(m) && write_json(config, merged_config(m));
        if (replaces && !done)
            run_folder_restore(&m->folder);
        done = done && (!replaces || run_folder_keep_previous(&m->folder));
    }
    free(cameras);
    free(config);
    return done;
}

static bool read_reference(merging *m, const model_path *located)
{
    return model_read(located, NULL, &m->reference) &&
           exposure_of_model(located, m->scene, &m->reference_exposures);
}

// Reads the model of --seam-reference. False after printing the error.
static bool read_given(merging *m)
{
    model_path located;
    const bool done = model_locate(m->values->reference, &located) && read_reference(m, &located);
    model_path_free(&located);
    return done;
}

static void forget_reference(merging *m)
{
    sgs_gaussians_destroy(m->reference);
    json_decref(m->reference_exposures);
    m->reference = NULL;
    m->reference_exposures = NULL;
}

// True if a model is known to be another than the one that the blocks started from: by its
// parameters if it was read, else by the record of its run.
static bool is_other(const merging *m, const model_path *located)
{
    const char *expected = json_string_value(json_object_get(m->blocks.configs[0], "init_hash"));
    char *path = format_text("%s/summary.json", located->run ? located->run : ""), own[17];
    json_t *summary = m->reference || !located->run ? NULL : load_json(path, 0, NULL);
    const char *hash = json_string_value(json_object_get(summary, "model_hash"));
    if (m->reference) {
        sgs_gaussians_hash(m->reference, own);
        hash = own;
    }
    const bool other = expected && hash && strcmp(hash, expected) != 0;
    json_decref(summary);
    free(path);
    return other;
}

// Whether the seams are compared with the model that the blocks started from.
static bool refers_to_start(const merging *m)
{
    return m->values->seam_images && !m->values->reference;
}

// Whether model_locate finds a model there, not only the name or the folder of a deleted one.
static bool is_present(const char *place)
{
    if (!place || !file_exists(place) || !model_is(place))
        return false;
    sgs_model_format format;
    char path[4096], *clouds = format_text("%s/point_cloud", place);
    const bool present = !file_exists(clouds) || sgs_model_format_detect(place, &format) ||
                         !sgs_run_model_path(place, path, sizeof path, NULL);
    free(clouds);
    return present;
}

// Locates the model that the blocks started from, where it was, or, if DIR was moved, in
// DIR/coarse; reads it if the seams are compared with it. False after printing the error.
static bool find_start(merging *m)
{
    const char *was = json_string_value(config_option(m->blocks.configs[0], "init"));
    char *coarse = format_text("%s/coarse", m->blocks.folder);
    const char *const places[] = {was, coarse};
    bool done = true;
    for (int k = 0; k < 2 && done && !m->start.ply_path; ++k) {
        if (!is_present(places[k]))
            continue;
        done = model_locate(places[k], &m->start) &&
               (!refers_to_start(m) || read_reference(m, &m->start));
        if (done && is_other(m, &m->start)) {
            forget_reference(m);
            model_path_free(&m->start);
        }
    }
    if (done && refers_to_start(m) && !m->reference)
        print_warning("%s: the model that the blocks started from is missing or was retrained; "
                      "seams are compared without it; give it with --seam-reference",
                      was ? was : coarse);
    free(coarse);
    return done;
}

// Warns if the model that the blocks started from was trained on held-out images: then the merged
// one was.
static void check_start(const merging *m)
{
    const char *run = m->start.run;
    const ptrdiff_t trained =
        run ? run_record_trained(run, m->start.config, m->scene, SGS_SPLIT_TEST) : 0;
    if (trained > 0)
        print_warning("%s: the model that the blocks started from was trained on %td of the %zu "
                      "held-out images, so held-out scores are too high; retrain it with the split "
                      "of the blocks",
                      run, trained, scene_split_count(m->scene, SGS_SPLIT_TEST));
}

// Whether --seam-reference names a model.
static bool is_given(const merging *m)
{
    return m->values->reference && strcmp(m->values->reference, "none") != 0;
}

static bool compare_seams(merging *m)
{
    evaluator evaluation = {0}, other = {0};
    if (!m->values->seam_images)
        return true;
    bool done = evaluator_open(&evaluation, m->blocks.model, m->scene, &m->drawing) &&
                (!m->reference || evaluator_open(&other, m->reference, m->scene, &m->drawing));
    evaluation.exposures = m->blocks.exposures;
    other.exposures = m->reference_exposures;
    done = done && seam_report_make(&evaluation, m->reference ? &other : NULL, &m->blocks.plan,
                                    (size_t)m->values->seam_images, &m->seams);
    evaluator_close(&evaluation);
    evaluator_close(&other);
    return done;
}

static bool report(const merging *m)
{
    char *path = format_text("%s/summary.json", m->values->output);
    json_t *summary = summary_json(m);
    const bool done = write_json(path, json_incref(summary));
    free(path);
    if (m->seams.images)
        seam_report_print(&m->seams, m->common->json);
    if (m->common->json)
        return print_json(summary) && done;
    printf("%zu blocks, %zu primitives, model %s\n", m->blocks.plan.count, m->blocks.model->count,
           json_string_value(json_object_get(summary, "model_hash")));
    printf("%s\n", json_string_value(json_object_get(summary, "model")));
    json_decref(summary);
    return done;
}

// Opens the scene as the blocks saw it, all of its views.
static int open_scene(merging *m, const command_line *line)
{
    const json_t *config = m->blocks.configs[0];
    const char *recorded = json_string_value(json_object_get(m->blocks.plan.root, "scene"));
    const char *path = line->operand_count > 1 ? line->operands[1] : recorded;
    const int status = scene_resolve(&m->data, line, config);
    if (status >= 0)
        return status;
    m->data.held_out = NULL; // names views of the first block only
    if (!path)
        return fail_run("%s: no scene is recorded; add the argument SCENE", m->blocks.plan_path);
    m->scene = scene_open(path, &m->data, m->values->seam_images > 0);
    if (!m->scene || !block_plan_is_of(&m->blocks.plan, m->blocks.plan_path, m->scene))
        return EXIT_FAILED;
    drawing_resolve(&m->drawing, line, config, &m->data, m->scene);
    return -1;
}

// Reads all inputs. Returns -1 to continue, or an exit status.
static int read_inputs(merging *m, const command_line *line)
{
    const int status = open_scene(m, line);
    if (status >= 0)
        return status;
    if (!merged_blocks_hold_out(&m->blocks, m->scene))
        return EXIT_FAILED;
    if (!find_start(m))
        return EXIT_FAILED;
    check_start(m);
    const bool read = (!is_given(m) || read_given(m)) && merged_blocks_read(&m->blocks);
    return interrupt_signal() ? interrupt_status() : read ? -1 : EXIT_FAILED;
}

// True if a model named by an option is a part of the run in OUT.
static bool is_in_output(const merging *m, const char *model)
{
    char *clouds = format_text("%s/point_cloud", m->values->output);
    const bool is = path_is_same(model, m->values->output) || path_is_below(model, clouds);
    free(clouds);
    return is;
}

// False after printing the error if OUT is an input: --overwrite would move it to OUT/previous.
static bool spares_inputs(const merging *m)
{
    const char *out = m->values->output, *given = m->values->reference,
               *start = json_string_value(config_option(m->blocks.configs[0], "init"));
    char *coarse = format_text("%s/coarse", m->blocks.folder);
    const char *role = path_is_same(coarse, out) || (start && is_in_output(m, start))
                           ? "is the model that the blocks started from"
                       : given && is_in_output(m, given) ? "is the model of --seam-reference"
                                                         : NULL;
    for (size_t b = 0; b < m->blocks.plan.count && !role; ++b) {
        char *block = format_text("%s/block_%zu", m->blocks.folder, b);
        role = path_is_same(block, out) ? "is a block of this command" : NULL;
        free(block);
    }
    free(coarse);
    if (role)
        fail_run("%s: %s; choose another folder with -o", out, role);
    return !role;
}

static int merge(merging *m, const command_line *line)
{
    if (!merged_blocks_check(&m->blocks, line->operands[0]) || !spares_inputs(m) ||
        !run_folder_prepare(&m->folder, m->values->output) ||
        !run_folder_admits(&m->folder, m->values->overwrite, "replace it with --overwrite"))
        return EXIT_FAILED;
    const int status = read_inputs(m, line);
    if (status >= 0) {
        run_folder_leave(&m->folder);
        return status;
    }
    run_folder_clean(&m->folder);
    if (!write_run(m) || !compare_seams(m) || !report(m))
        return EXIT_FAILED;
    return interrupt_status();
}

int command_merge(int argc, char **argv)
{
    command_call call;
    merge_values values = {0};
    merging m = {.values = &values, .common = &call.common};
    const command_spec spec = {.name = "merge",
                               .synopsis = "DIR [SCENE] -o OUT [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 2,
                               .title = "Merging",
                               .options = merge_options,
                               .option_count = sizeof merge_options / sizeof *merge_options,
                               .values = &values,
                               .scene = &m.data};
    (void)drawing_group(&m.drawing); // defaults
    int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    if (!values.output)
        return fail_usage("merge requires an output folder, -o OUT; usage: sparegs merge %s",
                          spec.synopsis);
    if (!values.seam_images)
        status = refuse_idle(&call.line, "seam-reference", "with --seam-images 0");
    if (status >= 0)
        return status;
    interrupt_watch();
    status = merge(&m, &call.line);
    sgs_scene_destroy(m.scene);
    forget_reference(&m);
    model_path_free(&m.start);
    merged_blocks_free(&m.blocks);
    return status;
}
