// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The MODEL argument of the commands: a file of any format that the library reads, or a run folder.

#include "cli/output.h"
#include "cli/shared_options.h"
#include "sparegs/model_file.h"

typedef struct opened_model {
    model_path located;
    sgs_gaussians *gaussians;
    sgs_model_info info;
    bool antialiased; // by its mark, or because its run used --filter mip
} opened_model;

// Locates and reads a model; options may be NULL. False after printing the error.
bool model_open(const char *model, const sgs_model_read_options *options, opened_model *opened);
void opened_model_free(opened_model *opened);

// Reads a located model. A mark in the file selects --filter mip, unless the command line or the
// run's config selected a filter. Where nothing selected a near limit, the size of the model does.
// drawing may be NULL. False after printing the error.
bool model_read(const model_path *located, drawing_values *drawing, sgs_gaussians **gaussians);

// Medians of the coordinates of the primitives, and the widest range from the 10 % to the 90 %
// quantile, or 1 where that is 0. Of 10 000 evenly chosen primitives at most.
void model_measure(const sgs_gaussians *model, double center[3], double *range);

// Warns if the format of `path` has no mark for what the options say about the model.
void model_warn_unmarked(const char *path, const sgs_model_write_options *options);

// The progress callback of sgs_model_write for a command: a line on stderr; false after a signal.
bool model_show_encoding(void *user, size_t done, size_t total);
