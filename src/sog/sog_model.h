// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The readers and writers that model_file.c calls for SOG.

#include "sparegs/model_file.h"

sgs_status sgsi_sog_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_sog_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
sgs_status sgsi_lod_sog_read(const char *path, const sgs_model_read_options *options,
                             sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_lod_sog_write(const char *path, const sgs_gaussians *model,
                              const sgs_model_write_options *options, sgs_model_written *written);
