// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The .splat format of antimatter15/splat: 32 bytes per primitive without a header, no SH.
//
//     float mean[3]; float scale[3] (linear); uint8 color[3], opacity; uint8 rotation[4]
//
// The rotation (w, x, y, z) is 128 q + 128. Writers sort by decreasing opacity times volume, so
// that a viewer can show the most important primitives of an incomplete file.

#include "formats/small_formats.h"

#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/output_file.h"
#include "storage/model_rows.h"
#include "storage/row_order.h"

enum { SPLAT_BYTES = 32 };

static void decode(const uint8_t *at, float params[SGS_PARAM_COUNT])
{
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    for (int k = 0; k < 3; ++k) {
        params[SGS_PARAM_MEAN + k] = sgsi_load_float(at + 4 * k);
        params[SGS_PARAM_SCALE + k] = sgsi_log_scale((double)sgsi_load_float(at + 12 + 4 * k));
        params[SGS_PARAM_SH_DC + k] = (float)sgsi_dc_from_color(at[24 + k] / 255.0);
    }
    params[SGS_PARAM_OPACITY] = sgsi_logit(at[27] / 255.0);
    for (int k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] = (float)(at[28 + k] - 128) / 128.0f;
}

sgs_status sgsi_splat_read(const char *path, const sgs_model_read_options *options,
                           sgs_gaussians **model, sgs_model_info *info)
{
    uint8_t *bytes;
    size_t size;
    sgsi_rows rows = {0};
    (void)info;
    sgs_status status = sgsi_file_read(path, 0, &bytes, &size);
    if (status)
        return status;
    if (!size || size % SPLAT_BYTES)
        status =
            sgsi_fail(SGS_STATUS_FORMAT,
                      "%s: has %zu bytes, which is not a multiple of %d; the file is truncated "
                      "or not a .splat file",
                      path, size, SPLAT_BYTES);
    if (!status)
        status =
            sgsi_rows_begin(&rows, path, size / SPLAT_BYTES, 0, options->drop_zero_quaternions);
    for (size_t i = 0; !status && i < size / SPLAT_BYTES; ++i) {
        float params[SGS_PARAM_COUNT];
        decode(bytes + i * SPLAT_BYTES, params);
        sgsi_rows_add(&rows, params);
    }
    sgsi_free(bytes);
    if (status)
        return status;
    info->dropped = rows.dropped;
    return sgsi_rows_end(&rows, model);
}

static void encode(const sgsi_splat *splat, uint8_t *at)
{
    for (int k = 0; k < 3; ++k) {
        sgsi_store_float(at + 4 * k, splat->mean[k]);
        sgsi_store_float(at + 12 + 4 * k, (float)exp((double)splat->log_scale[k]));
        at[24 + k] = sgsi_unorm8(sgsi_color_from_dc((double)splat->dc[k]));
    }
    at[27] = sgsi_unorm8(splat->opacity);
    const double sign = splat->rotation[0] < 0.0 ? -1.0 : 1.0;
    for (int k = 0; k < 4; ++k)
        at[28 + k] =
            (uint8_t)fmin(fmax(floor(128.0 * sign * splat->rotation[k] + 128.5), 0.0), 255.0);
}

sgs_status sgsi_splat_write(const char *path, const sgs_gaussians *model,
                            const sgs_model_write_options *options, sgs_model_written *written)
{
    (void)options;
    if (model->sh_degree)
        sgsi_warn("%s: .splat holds no SH; those of degree 1 to %d are omitted", path,
                  model->sh_degree);
    sgsi_warn_clipped_colors(path, ".splat", model, 1.0);
    uint32_t *order = NULL;
    sgs_status status = sgsi_order_by_importance(model, NULL, &order);
    uint8_t *bytes = status ? NULL : sgsi_alloc(model->count + 1, SPLAT_BYTES);
    if (!status && !bytes)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    for (size_t i = 0; !status && i < model->count; ++i) {
        const sgsi_splat splat = sgsi_splat_get(model, order[i]);
        encode(&splat, bytes + i * SPLAT_BYTES);
    }
    if (!status)
        status = sgs_output_file_write(path, bytes, model->count * SPLAT_BYTES);
    sgsi_free(bytes);
    sgsi_free(order);
    written->bytes = model->count * SPLAT_BYTES;
    written->order = SGS_ROWS_IMPORTANCE;
    return status;
}
