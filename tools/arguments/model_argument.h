// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The MODEL argument of the commands: a file of any format that the library reads, or a run folder.

#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "sparegs/model_file.h"

typedef struct opened_model {
    model_path located;
    sgs_gaussians *gaussians;
    sgs_model_info info;
    bool antialiased; // model_is_antialiased
} opened_model;

// Locates and reads a model; options may be NULL. False after printing the error.
bool model_open(const char *model, const sgs_model_read_options *options, opened_model *opened);
void opened_model_free(opened_model *opened);
// True if the file is marked as antialiased, or its run used --filter mip.
bool model_is_antialiased(const model_path *located, const sgs_model_info *info);

// Reads a located model. A file that is marked as antialiased selects --filter mip, unless the
// command line or the run's config selects a filter. If neither selects a near distance, it follows
// from the size of the model. drawing may be NULL. False after printing the error.
bool model_read(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians);
// The same; *info receives what the file records.
bool model_read_info(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians,
                     sgs_model_info *info);
// The same, for commands that need at least one primitive.
bool model_read_filled(const model_path *located, drawing_values *drawing,
                       sgs_gaussians **gaussians);

// Medians of the coordinates of the primitives, and the widest range from the 10 % to the 90 %
// quantile, or 1 where that is 0. Of 10 000 evenly chosen primitives at most.
void model_measure(const sgs_gaussians *model, double center[3], double *range);

// scene_resolve for the scene of a MODEL. Without a run's config, colour space and white point are
// those that the file records, and without an option the test views that the data set names are
// held out.
int model_scene_resolve(scene_values *values, const command_line *line, const model_path *located);

// Warns if the file records another space than that of a training run that starts from it.
void model_warn_space(const model_path *located, sgs_space space);

// The space and the white point of a model's colours, as files record them: encoded colours with
// the white point 1 need no record.
sgs_model_colors model_colors(sgs_space space, double white_point);

// The options to write a model that is rendered so.
sgs_model_write_options model_write_options(const drawing_values *drawing);

// The format that the name of an output selects. Returns -1 to continue, or EXIT_USAGE after
// printing the error: an unknown format, or a page that only shows a model.
int model_output_format(const char *path, sgs_model_format *format);

// Rejects a meta.json next to a lod-meta.json and vice versa, because readers would find two models
// in the folder. Returns -1 to continue, or EXIT_USAGE after printing the error. Part of
// model_output_format.
int model_check_manifest(const char *path);

// Warns if the format cannot record what the options say about the model. path: the file.
void model_warn_unmarked(const char *path, sgs_model_format format,
                         const sgs_model_write_options *options);

// The progress callback of sgs_model_write for a command: a line on stderr; false after a signal.
bool model_show_encoding(void *user, size_t done, size_t total);
