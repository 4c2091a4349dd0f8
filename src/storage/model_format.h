// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The types of the functions that the table in model_file.c lists per format. Readers fill `info`
// except format, dropped and file_bytes, which sgsi_rows_end and the caller set.

#include "sparegs/model_file.h"

typedef sgs_status (*sgsi_model_read_fn)(const char *path, const sgs_model_read_options *options,
                                         sgs_gaussians **model, sgs_model_info *info);
// Reads only what the file records about its colours, without warnings.
typedef sgs_status (*sgsi_model_colors_fn)(const char *path, sgs_model_colors *colors);
typedef sgs_status (*sgsi_model_write_fn)(const char *path, const sgs_gaussians *model,
                                          const sgs_model_write_options *options,
                                          sgs_model_written *written);
