// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs compress`: a stored model as a compressed file of one of the published methods.

#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "processes/interrupt.h"
#include "cli/json_result.h"
#include "cli/json_output.h"
#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "arguments/shared_options.h"
#include "run/exposure_file.h"
#include "run/run_record.h"
#include "sparegs/compress.h"
#include "sparegs/model_file.h"

static const char description[] =
    "Compresses MODEL (a model file, or a run folder, whose latest iteration is used) with one of "
    "four published methods, or fcgs-like. SCENE provides the training views for the importance "
    "of lightgaussian and mesongs, for fine-tuning and for distillation. `sparegs decompress` "
    "writes the PLY file again.\nghap reduces the number of primitives and stores the rest as "
    "floats. sog sorts all primitives into a square grid and stores the grid as images; it does "
    "not write PlayCanvas .sog, use `sparegs convert` for that. lightgaussian quantises the SH "
    "coefficients with a codebook. mesongs codes positions as an octree and attributes with RAHT "
    "and 8 bits. fcgs-like codes quantised attributes with probabilities fitted to the model; it "
    "has the structure of FCGS without its trained network, so its results are not those of FCGS.";

// The words of --method; the last one is unlisted, and refused by the library.
#define METHOD_WORDS "lightgaussian|sog|mesongs|ghap|fcgs-like"
static const sgs_compress_method methods[] = {SGS_COMPRESS_LIGHTGAUSSIAN, SGS_COMPRESS_SOG,
                                              SGS_COMPRESS_MESONGS,       SGS_COMPRESS_GHAP,
                                              SGS_COMPRESS_FCGS_LIKE,     SGS_COMPRESS_FCGS};

typedef struct compress_values {
    const char *output, *run;
    int method, preset, codec;
    int finetune;
    double keep, eig_min, vq_ratio, step_scale;
    bool half, cell_center;
    int depth, blocks;
    int codebook, vq_steps, distill;
    int position_bits, dc_bits, sh_bits, scale_bits, rotation_bits, opacity_bits;
} compress_values;

static const option compress_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(compress_values, output),
     .argument = "FILE",
     .help = "output file (required)"},
    {.name = "method",
     .kind = OPTION_CHOICE,
     .offset = offsetof(compress_values, method),
     .argument = METHOD_WORDS,
     .unlisted = "fcgs",
     .initial = "sog",
     .help = "compression method"},
    {.name = "preset",
     .kind = OPTION_CHOICE,
     .offset = offsetof(compress_values, preset),
     .argument = "spare-1|spare-2|spare-3",
     .initial = "spare-1",
     .help = "operating point, from the largest file to the smallest; for sog and fcgs-like chosen "
             "to match the sizes in the SPARE-GS paper"},
    {.name = "finetune",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, finetune),
     .low = 0,
     .high = 1000000,
     .argument = "N",
     .shown = "ghap 5000, lightgaussian with --keep 5000, mesongs 8000; 0 without SCENE",
     .unit = "iterations",
     .needs = "method=ghap|method=lightgaussian|method=mesongs",
     .help = "train the reduced model on the training images of SCENE"},
    {.name = "keep",
     .kind = OPTION_REAL,
     .offset = offsetof(compress_values, keep),
     .low = 0.001,
     .high = 1,
     .argument = "R",
     .shown = "set by the preset",
     .needs = "method=ghap|method=lightgaussian|method=mesongs",
     .help = "fraction of the primitives to keep"},
    {.name = "eig-min",
     .kind = OPTION_REAL,
     .offset = offsetof(compress_values, eig_min),
     .low = 1e-30,
     .high = 1e6,
     .argument = "X",
     .initial = "1e-6",
     .unit = "scene units squared",
     .needs = "method=ghap",
     .help = "lower limit of the variances of a merged primitive"},
    {.name = "position-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, position_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of positions"},
    {.name = "dc-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, dc_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of SH band 0"},
    {.name = "sh-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, sh_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of the other SH bands"},
    {.name = "scale-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, scale_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of scales"},
    {.name = "rotation-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, rotation_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of rotations"},
    {.name = "opacity-bits",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, opacity_bits),
     .low = 1,
     .high = 15,
     .argument = "N",
     .shown = "set by the preset",
     .needs = "method=sog",
     .help = "bits per value of opacities"},
    {.name = "vq-ratio",
     .kind = OPTION_REAL,
     .offset = offsetof(compress_values, vq_ratio),
     .low = 0.001,
     .high = 1,
     .argument = "R",
     .shown = "set by the preset",
     .needs = "method=lightgaussian",
     .help = "fraction of the primitives whose SH coefficients come from the codebook"},
    {.name = "distill",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, distill),
     .low = 1,
     .high = 1000000,
     .argument = "N",
     .shown = "none; published 10000",
     .unit = "iterations",
     .needs = "method=lightgaussian",
     .help = "reduce the SH degree to 2 and train all parameters but the opacities to match "
             "renders of MODEL; requires SCENE"},
    {.name = "half",
     .kind = OPTION_FLAG,
     .offset = offsetof(compress_values, half),
     .needs = "method=lightgaussian",
     .help = "store 16-bit floats, except positions"},
    {.name = "codebook",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, codebook),
     .low = 1,
     .high = 65536,
     .argument = "N",
     .shown = "lightgaussian 8192, mesongs 2048",
     .needs = "method=lightgaussian|method=mesongs",
     .help = "entries of the codebook"},
    {.name = "vq-steps",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, vq_steps),
     .low = 1,
     .high = 1000000,
     .argument = "N",
     .initial = "1000",
     .needs = "method=lightgaussian|method=mesongs",
     .help = "training steps of the codebook"},
    {.name = "octree-depth",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, depth),
     .low = 1,
     .high = 21,
     .argument = "N",
     .initial = "20",
     .needs = "method=mesongs",
     .help = "levels of the octree: 2^N cells per axis"},
    {.name = "cell-center",
     .kind = OPTION_FLAG,
     .offset = offsetof(compress_values, cell_center),
     .needs = "method=mesongs",
     .help = "decode positions to the centre of a cell instead of its lower corner"},
    {.name = "blocks",
     .kind = OPTION_INTEGER,
     .offset = offsetof(compress_values, blocks),
     .low = 1,
     .high = 65536,
     .argument = "N",
     .initial = "57",
     .needs = "method=mesongs",
     .help = "quantised blocks per channel"},
    {.name = "step-scale",
     .kind = OPTION_REAL,
     .offset = offsetof(compress_values, step_scale),
     .low = 0.001,
     .high = 1000,
     .argument = "X",
     .shown = "set by the preset",
     .needs = "method=fcgs-like",
     .help = "multiplier of all quantiser steps"},
    {.name = "codec",
     .kind = OPTION_CHOICE,
     .offset = offsetof(compress_values, codec),
     .argument = "jxl|webp|exr",
     .initial = "jxl",
     .needs = "method=sog",
     .help = "format of the images, all lossless"},
    RUN_OPTION(compress_values),
};

static bool show_progress(void *user, const char *stage, size_t done, size_t total)
{
    const char **current = user;
    if (!*current || strcmp(*current, stage))
        progress_work_start();
    *current = stage;
    progress_work(stage, done, total);
    return !interrupt_signal();
}

// The options of single methods; 0 where the command line has none.
static void set_method_options(const compress_values *values, sgs_compress_options *options)
{
    options->keep = values->keep;
    options->eig_min = values->eig_min;
    options->position_bits = values->position_bits;
    options->dc_bits = values->dc_bits;
    options->sh_bits = values->sh_bits;
    options->scale_bits = values->scale_bits;
    options->rotation_bits = values->rotation_bits;
    options->opacity_bits = values->opacity_bits;
    options->finetune = values->finetune;
    options->vq_ratio = values->vq_ratio;
    options->half = values->half;
    options->distill = values->distill;
    options->step_scale = values->step_scale;
    options->depth = values->depth;
    options->blocks = values->blocks;
    options->cell_center = values->cell_center;
    options->codebook = values->codebook;
    options->vq_steps = values->vq_steps;
    options->codec = (sgs_image_codec)values->codec;
}

static json_t *info_json(const sgs_compress_info *info, double seconds)
{
    json_t *root = json_result_new();
    json_object_set_new(root, "method", json_string(sgs_compress_method_name(info->method)));
    json_object_set_new(root, "input", json_integer((json_int_t)info->input));
    json_object_set_new(root, "gaussians", json_integer((json_int_t)info->gaussians));
    json_object_set_new(root, "bytes", json_integer((json_int_t)info->bytes));
    json_object_set_new(root, "bytes_per_gaussian",
                        json_number((double)info->bytes / (double)info->gaussians));
    json_object_set_new(root, "bytes_per_input_gaussian",
                        json_number((double)info->bytes / (double)info->input));
    json_object_set_new(root, "seconds", json_number(seconds));
    return root;
}

static int compress_model(const sgs_gaussians *model, const sgs_compress_options *options,
                          const compress_values *values, bool json)
{
    if (!make_folder_of(values->output))
        return EXIT_FAILED;
    sgs_compress_info info;
    const double start = clock_seconds();
    const sgs_status status = sgs_compress(model, options, values->output, &info);
    progress_end();
    if (status)
        return status == SGS_STATUS_CANCELLED && interrupt_signal() ? interrupt_status()
                                                                    : fail_library();
    const double seconds = clock_seconds() - start;
    if (json) {
        json_t *root = info_json(&info, seconds);
        json_object_set_new(root, "file", json_text(values->output));
        return print_json(root) ? EXIT_DONE : EXIT_FAILED;
    }
    printf("%s: %s, %zu of %zu primitives, %zu bytes, %.2f bytes per primitive of MODEL, %.1f s\n",
           values->output, sgs_compress_method_name(info.method), info.gaussians, info.input,
           info.bytes, (double)info.bytes / (double)info.input, seconds);
    return EXIT_DONE;
}

// True if the method trains on the images of SCENE.
static bool fine_tunes(const compress_values *values)
{
    switch (values->method) {
    case SGS_COMPRESS_GHAP:
    case SGS_COMPRESS_MESONGS:
        return values->finetune != 0;
    case SGS_COMPRESS_LIGHTGAUSSIAN:
        return values->finetune != 0 && values->keep > 0 && values->keep < 1;
    default:
        return false;
    }
}

// True if the method reads SCENE.
static bool reads_views(const compress_values *values)
{
    return values->method == SGS_COMPRESS_LIGHTGAUSSIAN || values->method == SGS_COMPRESS_MESONGS ||
           fine_tunes(values);
}

#define VIEW_OPTIONS "images|downscale|eval|test-every|test-images|compact-box|near"
#define PHOTO_OPTIONS "masks|invert-masks|alpha|input-colorspace|image-cache"

// Refuses options without effect. Returns -1 to continue, or an exit status.
static int check_values(const command_line *line, const compress_values *values)
{
    const bool has_scene = line->operand_count > 1;
    if (!values->output)
        return fail_usage("compress requires -o FILE");
    if (values->method == SGS_COMPRESS_FCGS)
        return fail_usage("--method fcgs: FCGS requires its trained network, which sparegs does "
                          "not contain; use --method fcgs-like, a codec of the same structure with "
                          "fitted probabilities");
    if (!has_scene && values->finetune > 0)
        return fail_usage("--finetune: fine-tuning requires a scene; add the argument SCENE");
    if (!has_scene && values->distill)
        return fail_usage("--distill: the distillation requires a scene; add the argument SCENE");
    if (!has_scene && values->keep > 0 && values->keep < 1 &&
        (values->method == SGS_COMPRESS_LIGHTGAUSSIAN || values->method == SGS_COMPRESS_MESONGS))
        return fail_usage("--keep: the importance of primitives requires a scene; add the argument "
                          "SCENE");
    if (values->finetune > 0 && !fine_tunes(values))
        return refuse_idle(line, "finetune", "on lightgaussian without --keep below 1");
    return has_scene
               ? -1
               : refuse_idle(line, VIEW_OPTIONS "|" PHOTO_OPTIONS "|background", "without SCENE");
}

static void warn_idle_preset(const command_line *line, int method)
{
    const char *name = sgs_compress_preset_option((sgs_compress_method)method);
    if (!name || !option_given(line, name))
        return;
    char *why = format_text("with --%s, the only value that it sets", name);
    warn_idle(line, "preset", why);
    free(why);
}

// Warns about options that the method does not read, and about SCENE if it does not.
static void warn_idle_options(const command_line *line, const compress_values *values)
{
    if (values->method == SGS_COMPRESS_FCGS_LIKE)
        warn_idle(line, "seed", "on fcgs-like, which makes no random choice");
    warn_idle_preset(line, values->method);
    if (line->operand_count < 2)
        return;
    if (!reads_views(values)) {
        char *why =
            values->method == SGS_COMPRESS_GHAP
                ? format_text("with --finetune 0")
                : format_text("on --method %s",
                              sgs_compress_method_name((sgs_compress_method)values->method));
        print_warning("SCENE has no effect %s", why);
        warn_idle(line, VIEW_OPTIONS "|" PHOTO_OPTIONS "|background", why);
        free(why);
        return;
    }
    if (values->method == SGS_COMPRESS_GHAP)
        warn_idle(line, "near", "on ghap, which trains with the near distance of the scene");
    if (!fine_tunes(values))
        warn_idle(line, PHOTO_OPTIONS, "without fine-tuning");
    if (!fine_tunes(values) && !values->distill)
        warn_idle(line, "background", "without fine-tuning or distillation");
}

// False after printing the error if FILE would replace a file of a SCENE that the method does not
// read.
static bool spares_unread(const command_call *call, const compress_values *values,
                          const scene_values *data)
{
    if (call->line.operand_count < 2 || !file_exists(values->output))
        return true;
    messages_hear_library(false);
    sgs_scene *scene = scene_open_cameras(call->line.operands[1], data, 0, 0);
    messages_hear_library(true);
    sgs_scene_destroy(scene);
    return scene != NULL;
}

static int run_compress(const command_call *call, const compress_values *values, scene_values *data,
                        drawing_values *drawing, model_path *located)
{
    const bool views = call->line.operand_count > 1 && reads_views(values);
    sgs_scene *scene = NULL;
    sgs_gaussians *model = NULL;
    int status = model_scene_resolve(data, &call->line, located);
    if (status < 0 && !views && !spares_unread(call, values, data))
        status = EXIT_FAILED;
    if (status >= 0)
        return status;
    if (views) {
        const char *path = call->line.operands[1];
        scene = fine_tunes(values) ? scene_open(path, data, true)
                                   : scene_open_cameras(path, data, 0, 0);
        if (!scene)
            return EXIT_FAILED;
        if (located->run)
            run_record_check_scene(located->run, scene);
        if (fine_tunes(values)) {
            scene_warn_idle(scene, data, &call->line);
            exposure_warn_finetune(located->ply_path, located->config);
        }
    }
    drawing_resolve(drawing, &call->line, located->config, data, scene);
    const bool read = model_read_filled(located, drawing, &model);
    const sgs_render_options render = drawing_render_options(drawing);
    sgs_compress_options options = sgs_compress_options_default();
    options.method = (sgs_compress_method)values->method;
    options.preset = values->preset + 1;
    options.seed = call->common.seed;
    options.scene = scene;
    options.render = &render;
    for (int c = 0; c < 3; ++c)
        options.background[c] = drawing->background[c];
    set_method_options(values, &options);
    const sgs_model_write_options marks = model_write_options(drawing);
    options.antialiased = marks.antialiased;
    options.colors = marks.colors;
    const char *stage = NULL;
    options.progress = show_progress;
    options.progress_user = &stage;
    status = read ? compress_model(model, &options, values, call->common.json) : EXIT_FAILED;
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
    return status;
}

int command_compress(int argc, char **argv)
{
    command_call call;
    scene_values data;
    drawing_values drawing;
    compress_values values = {.finetune = -1};
    const command_spec spec = {.name = "compress",
                               .synopsis = "MODEL [SCENE] -o FILE [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 2,
                               .title = "Compression",
                               .options = compress_options,
                               .option_count = sizeof compress_options / sizeof *compress_options,
                               .values = &values,
                               .scene = &data,
                               .drawing = &drawing};
    int status = command_begin(&spec, argc, argv, &call);
    values.method = methods[values.method];
    if (status < 0)
        status = check_values(&call.line, &values);
    if (status >= 0)
        return status;
    warn_idle_options(&call.line, &values);
    if (!check_output(values.output))
        return EXIT_FAILED;
    sgs_model_format format;
    if (sgs_model_format_of_name(values.output, &format))
        print_warning("%s: compress writes sparegs's own container, not .%s; use 'sparegs "
                      "convert' for .%s",
                      values.output, sgs_model_format_name(format), sgs_model_format_name(format));
    interrupt_watch();
    model_path located;
    status = model_locate_of_run(call.line.operands[0], values.run, &located)
                 ? refuse_outputs_at(&call.line, located.ply_path)
                 : EXIT_FAILED;
    if (status < 0)
        status = run_compress(&call, &values, &data, &drawing, &located);
    model_path_free(&located);
    return status;
}
