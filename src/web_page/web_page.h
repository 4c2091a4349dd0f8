// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The writer that model_file.c calls for the page that shows a model.

#include "sparegs/model_file.h"

sgs_status sgsi_web_page_write(const char *path, const sgs_gaussians *model,
                               const sgs_model_write_options *options, sgs_model_written *written);
