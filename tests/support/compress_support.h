// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Models and files for the tests of the compression. The layout of the container is that of the
// comment at the top of src/compress/container.c, written independently here.

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/core.h"
#include "sparegs/compress.h"
#include "sparegs/status.h"

enum { PACK_HEADER = 64, PACK_ENTRY = 48 };

static inline uint64_t pack_get(const unsigned char *bytes, size_t at, size_t width)
{
    uint64_t value = 0;
    memcpy(&value, bytes + at, width);
    return value;
}

static inline void pack_put(unsigned char *bytes, size_t at, uint64_t value, size_t width)
{
    memcpy(bytes + at, &value, width);
}

// Makes all checksums and the size match the content, as far as the table is inside the file.
static inline void pack_reseal(unsigned char *bytes, size_t size)
{
    if (size < PACK_HEADER + 8)
        return;
    pack_put(bytes, 48, size, 8);
    const uint64_t count = pack_get(bytes, 56, 4);
    if (count > 64 || PACK_HEADER + count * PACK_ENTRY + 8 > size)
        return;
    size_t at = PACK_HEADER + count * PACK_ENTRY + 8;
    for (uint64_t s = 0; s < count; ++s) {
        const size_t entry = PACK_HEADER + s * PACK_ENTRY;
        const uint64_t stored = pack_get(bytes, entry + 24, 8);
        if (stored > size - at)
            break;
        pack_put(bytes, entry + 40, XXH64(bytes + at, stored, 0), 8);
        at += stored;
    }
    const size_t digest = PACK_HEADER + count * PACK_ENTRY;
    pack_put(bytes, digest, XXH64(bytes, digest, 0), 8);
}

static inline void pack_keep_warning(void *warning, const char *message)
{
    snprintf(warning, 512, "%s", message);
}

// Compresses a model. `warning` receives the last warning, or "".
static inline sgs_status pack_with_warning(const sgs_gaussians *model,
                                           const sgs_compress_options *options, const char *path,
                                           char warning[512])
{
    *warning = 0;
    sgs_warning_handler_set(pack_keep_warning, warning);
    const sgs_status status = sgs_compress(model, options, path, NULL);
    sgs_warning_handler_set(NULL, NULL);
    return status;
}

// A model as training makes them: clustered positions, small scales, decreasing bands. Rotations
// are not normalised.
static inline sgs_gaussians *pack_model(size_t count, int sh_degree, uint64_t seed)
{
    sgs_gaussians *model = NULL;
    if (sgs_gaussians_create(count, &model) || sgs_gaussians_resize(model, count))
        return NULL;
    model->sh_degree = sh_degree;
    const int coefficients = 3 * ((sh_degree + 1) * (sh_degree + 1) - 1);
    for (size_t i = 0; i < count; ++i) {
        float row[SGS_PARAM_COUNT] = {0};
        uint64_t c = i * 64;
        const double angle = 6.28 * sgsi_random_uniform(seed, c++);
        const double height = sgsi_random_uniform(seed, c++);
        row[0] = (float)(2 * cos(angle) + 0.1 * sgsi_random_normal(seed, c++));
        row[1] = (float)(4 * height - 2);
        row[2] = (float)(2 * sin(angle) + 0.1 * sgsi_random_normal(seed, ++c));
        for (int k = 0; k < 4; ++k)
            row[SGS_PARAM_ROTATION + k] = (float)(sgsi_random_uniform(seed, ++c) - 0.4);
        for (int k = 0; k < 3; ++k)
            row[SGS_PARAM_SCALE + k] = (float)(-4 + 2 * sgsi_random_uniform(seed, ++c));
        row[SGS_PARAM_OPACITY] = (float)(8 * sgsi_random_uniform(seed, ++c) - 4);
        for (int k = 0; k < 3; ++k)
            row[SGS_PARAM_SH_DC + k] = (float)(sin(angle + k) + 0.2 * height);
        for (int k = 0; k < coefficients; ++k)
            row[SGS_PARAM_SH_REST + k] =
                (float)(0.2 * (sgsi_random_uniform(seed, ++c) - 0.5) / (1 + k / 9));
        sgs_gaussians_set(model, i, row);
    }
    return model;
}
