// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The readers and writers that model_file.c calls for both kinds of PLY.

#include "sparegs/model_file.h"

sgs_status sgsi_ply_model_read(const char *path, const sgs_model_read_options *options,
                               sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_ply_model_write(const char *path, const sgs_gaussians *model,
                                const sgs_model_write_options *options, sgs_model_written *written);
// Of both kinds of PLY.
sgs_status sgsi_ply_read_colors(const char *path, sgs_model_colors *colors);
sgs_status sgsi_ply_read_count(const char *path, size_t *count);
sgs_status sgsi_compressed_ply_read(const char *path, const sgs_model_read_options *options,
                                    sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_compressed_ply_write(const char *path, const sgs_gaussians *model,
                                     const sgs_model_write_options *options,
                                     sgs_model_written *written);
