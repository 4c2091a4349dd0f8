// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The folder of a training run: its newest model and the options that a rendering needs.

#include "sparegs/run.h"

#include <dirent.h>
#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"
#include "sparegs/model_file.h"
#include "storage/color_marks.h"

enum { MAX_PATH = 4096, MAX_ITERATIONS = 1000000000 };

int sgs_run_iteration(const char *name)
{
    static const char prefix[] = "iteration_";
    char *end;
    if (strncmp(name, prefix, sizeof prefix - 1))
        return 0;
    const char *number = name + sizeof prefix - 1;
    if (*number < '1' || *number > '9') // strtol accepts spaces and a sign
        return 0;
    const long iteration = strtol(number, &end, 10);
    return *end || iteration < 1 || iteration >= MAX_ITERATIONS ? 0 : (int)iteration;
}

// False if it does not fit.
static bool model_path(const char *folder, int iteration, char *path, size_t bytes)
{
    const int length =
        snprintf(path, bytes, "%s/point_cloud/iteration_%d/point_cloud.ply", folder, iteration);
    return length > 0 && (size_t)length < bytes;
}

sgs_status sgs_run_model_path(const char *folder, char *path, size_t bytes, int *iteration)
{
    char clouds[MAX_PATH];
    if (snprintf(clouds, sizeof clouds, "%s/point_cloud", folder) >= (int)sizeof clouds)
        return sgsi_fail(SGS_STATUS_LIMIT, "%.80s...: path of a run folder is too long", folder);
    DIR *directory = opendir(clouds);
    int newest = 0;
    for (struct dirent *entry; directory && (entry = readdir(directory));) {
        char ply[MAX_PATH];
        const int at = sgs_run_iteration(entry->d_name);
        if (at > newest && model_path(folder, at, ply, sizeof ply) && !access(ply, R_OK))
            newest = at;
    }
    if (directory)
        closedir(directory);
    if (!newest)
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: no point_cloud/iteration_N/point_cloud.ply in this folder; specify a "
                         "PLY file or a run folder",
                         folder);
    if (!model_path(folder, newest, path, bytes))
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: path of its model is too long", folder);
    if (iteration)
        *iteration = newest;
    return SGS_STATUS_OK;
}

static bool read_filter(const json_t *value, sgs_filter *filter)
{
    static const char *const words[] = {"3dgs", "none", "mip"}; // order of sgs_filter
    const char *text = json_string_value(value);
    for (int k = 0; text && k < 3; ++k)
        if (!strcmp(text, words[k])) {
            *filter = (sgs_filter)k;
            return true;
        }
    return !value; // runs without the option used the default
}

static bool read_background(const json_t *value, float background[3])
{
    if (!value || json_is_string(value)) // "random"
        return true;
    for (size_t c = 0; c < 3; ++c) {
        const json_t *channel = json_array_get(value, c);
        if (!json_is_number(channel))
            return false;
        background[c] = (float)json_number_value(channel);
    }
    return true;
}

static bool read_compact_box(const json_t *value, double *compact_box)
{
    if (value)
        *compact_box = json_number_value(value);
    return *compact_box > 0.0 && *compact_box <= 1.0;
}

// Runs of earlier versions did not record it.
static bool read_near(const json_t *value, double *near_distance)
{
    if (value)
        *near_distance = json_number_value(value);
    return *near_distance > 0.0 && isfinite(*near_distance);
}

static bool read_space(const json_t *value, sgs_model_colors *colors)
{
    const char *text = json_string_value(value);
    const bool linear = text && !strcmp(text, "linear");
    if (!value)
        return true;
    colors->space_known = true;
    colors->space = linear ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
    return linear || (text && !strcmp(text, "srgb"));
}

// null: not measured yet.
static bool read_white(const json_t *value, sgs_model_colors *colors)
{
    const double white = json_number_value(value);
    colors->white_point = sgsi_white_point_checked(white);
    return !value || json_is_null(value) || (json_is_number(value) && white == colors->white_point);
}

// What is wrong with the configuration, or NULL.
static const char *apply_config(const json_t *config, sgs_run_settings *settings)
{
    const json_t *options = json_object_get(config, "options");
    if (!read_filter(json_object_get(options, "filter"), &settings->filter))
        return "option filter";
    if (!read_background(json_object_get(options, "background"), settings->background))
        return "option background";
    if (!read_compact_box(json_object_get(options, "compact_box"), &settings->compact_box))
        return "option compact_box";
    if (!read_space(json_object_get(options, "train_space"), &settings->colors))
        return "option train_space";
    if (!read_white(json_object_get(options, "white"), &settings->colors))
        return "option white";
    return read_near(json_object_get(config, "near_distance"), &settings->near_distance)
               ? NULL
               : "near_distance";
}

static sgs_status read_config(const char *folder, sgs_run_settings *settings)
{
    char path[MAX_PATH];
    if (snprintf(path, sizeof path, "%s/config.json", folder) >= (int)sizeof path)
        return sgsi_fail(SGS_STATUS_LIMIT, "%.80s...: path of a run folder is too long", folder);
    if (access(path, F_OK) && errno == ENOENT)
        return SGS_STATUS_OK;
    uint8_t *text;
    size_t size;
    const sgs_status status = sgsi_file_read(path, 0, &text, &size);
    if (status)
        return status;
    json_error_t error;
    json_t *config = json_loadb((const char *)text, size, 0, &error);
    sgsi_free(text);
    if (!config)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: %s", path, error.line, error.text);
    const char *wrong = apply_config(config, settings);
    json_decref(config);
    return wrong ? sgsi_fail(SGS_STATUS_FORMAT, "%s: %s has an unknown value", path, wrong)
                 : SGS_STATUS_OK;
}

sgs_status sgs_run_read(const char *folder, sgs_gaussians **model, sgs_run_settings *settings)
{
    char path[MAX_PATH];
    const sgs_render_options defaults = sgs_render_options_default();
    *settings = (sgs_run_settings){.filter = defaults.filter,
                                   .compact_box = defaults.compact_box,
                                   .near_distance = defaults.near_distance};
    if (model)
        *model = NULL;
    sgs_status status = sgs_run_model_path(folder, path, sizeof path, &settings->iteration);
    if (!status)
        status = read_config(folder, settings);
    sgs_model_colors *colors = &settings->colors, recorded;
    if (!status && (!colors->space_known || !(colors->white_point > 0))) {
        status = sgs_model_read_colors(path, &recorded);
        const bool same = recorded.space_known && recorded.space == colors->space;
        if (!status && !colors->space_known)
            *colors = recorded;
        else if (!status && same)
            colors->white_point = recorded.white_point;
    }
    return status || !model ? status : sgs_ply_read(path, model);
}
