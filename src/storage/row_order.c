// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "storage/row_order.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/keyed_rows.h"
#include "base/morton.h"
#include "storage/model_rows.h"

// Orders by keys and frees them.
static sgs_status take_order(sgsi_keyed_row *rows, size_t count, uint32_t **order)
{
    sgsi_keyed_row *spare = rows ? sgsi_alloc(count + 1, sizeof *spare) : NULL;
    *order = spare ? sgsi_alloc(count + 1, sizeof **order) : NULL;
    if (*order) {
        sgsi_sort_rows(rows, spare, count);
        for (size_t i = 0; i < count; ++i)
            (*order)[i] = rows[i].row;
    }
    sgsi_free(rows);
    sgsi_free(spare);
    return *order ? SGS_STATUS_OK
                  : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives",
                              count);
}

sgs_status sgsi_order_by_position(const sgs_gaussians *model, uint32_t **order)
{
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY},
          inv_size[3];
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3; ++k) {
            const float value = *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
            low[k] = fminf(low[k], value);
            high[k] = fmaxf(high[k], value);
        }
    for (int k = 0; k < 3; ++k)
        inv_size[k] = high[k] > low[k] ? 1.0f / (high[k] - low[k]) : 0.0f;
    sgsi_keyed_row *rows = sgsi_alloc(model->count + 1, sizeof *rows);
    for (size_t i = 0; rows && i < model->count; ++i) {
        float mean[3];
        for (int k = 0; k < 3; ++k)
            mean[k] = *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
        rows[i] = (sgsi_keyed_row){sgsi_morton_code(mean, low, inv_size), (uint32_t)i};
    }
    return take_order(rows, model->count, order);
}

sgs_status sgsi_order_by_importance(const sgs_gaussians *model, const float *importance,
                                    uint32_t **order)
{
    sgsi_keyed_row *rows = sgsi_alloc(model->count + 1, sizeof *rows);
    for (size_t i = 0; rows && i < model->count; ++i) {
        const double value = importance ? (double)importance[i] : sgsi_splat_importance(model, i);
        const double positive =
            value > 0.0 ? value : 0.0; // the bits of positive numbers are ordered
        uint64_t bits;
        memcpy(&bits, &positive, sizeof bits);
        rows[i] = (sgsi_keyed_row){~bits, (uint32_t)i};
    }
    return take_order(rows, model->count, order);
}
