// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One reader and one writer per format; the table in model_file.c lists them. Readers fill `info`
// except format, dropped and file_bytes, which sgsi_rows_end and the caller set.

#include "sparegs/model_file.h"

typedef sgs_status (*sgsi_model_read_fn)(const char *path, const sgs_model_read_options *options,
                                         sgs_gaussians **model, sgs_model_info *info);
// Reads only what the file records about its colours, without warnings.
typedef sgs_status (*sgsi_model_colors_fn)(const char *path, sgs_model_colors *colors);
typedef sgs_status (*sgsi_model_write_fn)(const char *path, const sgs_gaussians *model,
                                          const sgs_model_write_options *options,
                                          sgs_model_written *written);

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
sgs_status sgsi_sog_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_sog_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_lod_sog_read(const char *path, const sgs_model_read_options *options,
                             sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_lod_sog_write(const char *path, const sgs_gaussians *model,
                              const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_usd_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_usd_read_colors(const char *path, sgs_model_colors *colors);
sgs_status sgsi_usd_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_web_page_write(const char *path, const sgs_gaussians *model,
                               const sgs_model_write_options *options, sgs_model_written *written);
