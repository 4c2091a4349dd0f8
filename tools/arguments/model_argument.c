// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "arguments/model_argument.h"

#include <stdlib.h>
#include <string.h>

#include "arguments/model_path.h"
#include "arguments/model_reader.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/value_order.h"
#include "processes/interrupt.h"

bool model_open(const char *model, const sgs_model_read_options *options, opened_model *opened)
{
    *opened = (opened_model){0};
    if (!model_locate(model, &opened->located))
        return false;
    if (model_reader_read(opened->located.ply_path, options, &opened->gaussians, &opened->info)) {
        fail_library();
        model_path_free(&opened->located);
        return false;
    }
    opened->antialiased = model_is_antialiased(&opened->located, &opened->info);
    return true;
}

bool model_is_antialiased(const model_path *located, const sgs_model_info *info)
{
    const char *filter = json_string_value(config_option(located->config, "filter"));
    return info->antialiased || (filter && !strcmp(filter, "mip"));
}

void opened_model_free(opened_model *opened)
{
    sgs_gaussians_destroy(opened->gaussians);
    model_path_free(&opened->located);
    *opened = (opened_model){0};
}

void model_measure(const sgs_gaussians *model, double center[3], double *range)
{
    enum { SAMPLES = 10000 };
    const size_t count = model->count, kept = count < SAMPLES ? count : SAMPLES;
    float *values = malloc((kept + 1) * sizeof *values);
    *range = 0;
    for (int k = 0; k < 3; ++k) {
        center[k] = 0;
        for (size_t i = 0; values && i < kept; ++i)
            values[i] = *sgs_gaussians_at(model, i * count / kept, SGS_PARAM_MEAN + k);
        if (!values || !kept)
            continue;
        qsort(values, kept, sizeof *values, compare_floats);
        const double along = (double)values[kept - 1 - kept / 10] - (double)values[kept / 10];
        center[k] = (double)values[kept / 2];
        *range = along > *range ? along : *range;
    }
    free(values);
    if (!(*range > 0))
        *range = 1;
}

// The cameras of a data set are spread over about a quarter of what they see.
static double near_distance_of(const sgs_gaussians *model)
{
    double center[3], range;
    model_measure(model, center, &range);
    return sgs_near_distance(range / 4);
}

bool model_read(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians)
{
    sgs_model_info info;
    return model_read_info(located, drawing, gaussians, &info);
}

bool model_read_info(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians,
                     sgs_model_info *info)
{
    if (model_reader_read(located->ply_path, NULL, gaussians, info)) {
        fail_library();
        return false;
    }
    if (drawing && info->antialiased && !drawing->filter_selected)
        drawing->filter = SGS_FILTER_MIP;
    if (drawing && !drawing->near_selected)
        drawing->near_distance = near_distance_of(*gaussians);
    return true;
}

bool model_read_filled(const model_path *located, drawing_values *drawing,
                       sgs_gaussians **gaussians)
{
    if (!model_read(located, drawing, gaussians))
        return false;
    if (!(*gaussians)->count)
        fail_run("%s: contains no primitives", located->ply_path);
    return (*gaussians)->count > 0;
}

int model_scene_resolve(scene_values *values, const command_line *line, const model_path *located)
{
    sgs_model_colors colors;
    const int status = scene_resolve(values, line, located->config);
    values->use_dataset_split = values->use_dataset_split ||
                                (!located->config && !values->test_every && !values->test_images);
    // An unreadable file is an error of the later reading of the whole model.
    if (config_option(located->config, "train_space") ||
        model_reader_colors(located->ply_path, &colors))
        return status;
    if (colors.space_known && !option_given(line, "train-space"))
        values->space = colors.space;
    if (colors.white_point > 0 && !option_given(line, "white"))
        values->white_point = colors.white_point;
    return status;
}

void model_warn_space(const model_path *located, sgs_space space)
{
    static const char *const names[] = {[SGS_SPACE_SRGB] = "srgb", [SGS_SPACE_LINEAR] = "linear"};
    sgs_model_colors colors;
    if (!model_reader_colors(located->ply_path, &colors) && colors.space_known &&
        colors.space != space)
        print_warning("%s: its colours are %s, those of this training are %s; train with "
                      "--train-space %s",
                      located->ply_path, names[colors.space], names[space], names[colors.space]);
}

sgs_model_colors model_colors(sgs_space space, double white_point)
{
    const bool matters = space == SGS_SPACE_LINEAR || white_point != 1;
    return (sgs_model_colors){
        .space_known = true, .space = space, .white_point = matters ? white_point : 0};
}

sgs_model_write_options model_write_options(const drawing_values *drawing)
{
    sgs_model_write_options options = sgs_model_write_options_default();
    options.antialiased = drawing->filter == SGS_FILTER_MIP;
    options.colors = model_colors(drawing->space, drawing->white_point);
    return options;
}

int model_output_format(const char *path, sgs_model_format *format)
{
    if (!sgs_model_format_of_name(path, format))
        return fail_usage("%s: the name has no known extension; use .ply, .compressed.ply, "
                          ".splat, .spz, .ksplat, .glb, .sog, meta.json, lod-meta.json or .usda",
                          path);
    if (*format == SGS_MODEL_HTML)
        return fail_usage("%s: a page cannot be read as a model; write a .ply, and make the page "
                          "with 'sparegs convert'",
                          path);
    return model_check_manifest(path);
}

int model_check_manifest(const char *path)
{
    static const char *const names[] = {"meta.json", "lod-meta.json"};
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    int status = -1;
    for (int k = 0; k < 2; ++k) {
        if (strcmp(name, names[k]) != 0)
            continue;
        char *other = format_text("%.*s%s", (int)(name - path), path, names[1 - k]);
        if (file_exists(other))
            status = fail_usage("%s: %s is in the same folder, which can hold one model; choose "
                                "another folder",
                                path, other);
        free(other);
    }
    return status;
}

// name: of the format, which cannot record the colours.
static void warn_about_colors(const char *path, const char *name, const sgs_model_colors *colors)
{
    char white[64] = "";
    if (colors->white_point > 0)
        snprintf(white, sizeof white, " --white %.9g", colors->white_point);
    if (colors->space == SGS_SPACE_LINEAR)
        print_warning("%s: %s cannot record linear colours, and its viewers show them too dark; "
                      "render with --train-space linear%s",
                      path, name, white);
    else if (*white)
        print_warning("%s: %s cannot record the white level; render with%s", path, name, white);
}

void model_warn_unmarked(const char *path, sgs_model_format format,
                         const sgs_model_write_options *options)
{
    const char *name = sgs_model_format_name(format);
    if (options->antialiased && !sgs_model_format_marks_filter(format))
        print_warning("%s: %s cannot record that a model was trained with Mip-Splatting's filters; "
                      "render with --filter mip",
                      path, name);
    if (format != SGS_MODEL_HTML && !sgs_model_format_marks_colors(format))
        warn_about_colors(path, name, &options->colors);
}

bool model_show_encoding(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("encoding", done, total);
    return !interrupt_signal();
}
