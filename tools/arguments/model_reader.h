// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads a model of any format of the library, and the compressed files of `sparegs compress`.

#include "sparegs/model_file.h"

// As sgs_model_read; the format of a compressed file is reported as PLY, as which it is decoded.
sgs_status model_reader_read(const char *path, const sgs_model_read_options *options,
                             sgs_gaussians **model, sgs_model_info *info);
// As sgs_model_read_colors.
sgs_status model_reader_colors(const char *path, sgs_model_colors *colors);
// As sgs_model_read_count; compressed files are not decoded.
sgs_status model_reader_count(const char *path, size_t *count);
// The name of the format: that of the library, or "compressed".
const char *model_reader_format(const char *path, const sgs_model_info *info);
