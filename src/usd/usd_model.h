// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The reader and the writer that model_file.c calls for OpenUSD.

#include "sparegs/model_file.h"

sgs_status sgsi_usd_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info);
sgs_status sgsi_usd_read_colors(const char *path, sgs_model_colors *colors);
sgs_status sgsi_usd_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written);
