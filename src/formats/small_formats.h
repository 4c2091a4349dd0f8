// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The readers and writers that model_file.c calls for the formats that are one source file each.

#include "sparegs/model_file.h"

sgs_status sgsi_splat_read(const char *path, const sgs_model_read_options *options,
                           sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_splat_write(const char *path, const sgs_gaussians *model,
                            const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_spz_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_spz_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
// Warns of more primitives than older readers of this SPZ version accept. Cannot fail.
void sgsi_spz_warn_count(const char *path, int version, size_t count);
sgs_status sgsi_ksplat_read(const char *path, const sgs_model_read_options *options,
                            sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_ksplat_write(const char *path, const sgs_gaussians *model,
                             const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_glb_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_glb_read_colors(const char *path, sgs_model_colors *colors);
sgs_status sgsi_glb_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
