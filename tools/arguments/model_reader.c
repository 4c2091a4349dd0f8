// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "arguments/model_reader.h"

#include "sparegs/compress.h"

sgs_status model_reader_read(const char *path, const sgs_model_read_options *options,
                             sgs_gaussians **model, sgs_model_info *info)
{
    if ((options && options->lod) || !sgs_is_compressed(path))
        return sgs_model_read(path, options, model, info);
    sgs_compress_info found;
    const sgs_status status = sgs_decompress(path, model, &found);
    if (!status && info)
        *info = (sgs_model_info){.format = SGS_MODEL_PLY,
                                 .antialiased = found.antialiased,
                                 .colors = found.colors,
                                 .file_bytes = found.bytes,
                                 .lod_count = 1};
    return status;
}

sgs_status model_reader_colors(const char *path, sgs_model_colors *colors)
{
    if (!sgs_is_compressed(path))
        return sgs_model_read_colors(path, colors);
    sgs_compress_info found = {0};
    const sgs_status status = sgs_compress_info_read(path, &found);
    *colors = found.colors;
    return status;
}

sgs_status model_reader_count(const char *path, size_t *count)
{
    if (!sgs_is_compressed(path))
        return sgs_model_read_count(path, count);
    sgs_compress_info found = {0};
    const sgs_status status = sgs_compress_info_read(path, &found);
    *count = found.gaussians;
    return status;
}

const char *model_reader_format(const char *path, const sgs_model_info *info)
{
    return sgs_is_compressed(path) ? "compressed" : sgs_model_format_name(info->format);
}
