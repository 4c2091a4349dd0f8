// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Model files that a test composes byte by byte, and the values that it expects of them. Include
// after cmocka.h.

#include <math.h>
#include <stdarg.h>
#include <stdint.h>

#include "base/core.h"
#include "sparegs/model_file.h"
#include "support/files_support.h"
#include "support/model_support.h"

typedef struct bytes {
    unsigned char data[32768];
    size_t size;
} bytes;

static inline void put(bytes *out, const void *data, size_t size)
{
    memcpy(out->data + out->size, data, size);
    out->size += size;
}

static inline void put_text(bytes *out, const char *format, ...) SGSI_PRINTF(2, 3);
static inline void put_text(bytes *out, const char *format, ...)
{
    const size_t room = sizeof out->data - out->size;
    va_list args;
    va_start(args, format);
    const int length = vsnprintf((char *)out->data + out->size, room, format, args);
    va_end(args);
    assert_in_range(length, 0, room - 1);
    out->size += (size_t)length;
}

static inline void put_u8(bytes *out, unsigned value)
{
    out->data[out->size++] = (unsigned char)value;
}

static inline void put_u16(bytes *out, unsigned value)
{
    put_u8(out, value & 255);
    put_u8(out, value >> 8);
}

static inline void put_u32(bytes *out, uint32_t value)
{
    put_u16(out, value & 65535);
    put_u16(out, value >> 16);
}

static inline void put_u64(bytes *out, uint64_t value)
{
    put_u32(out, (uint32_t)value);
    put_u32(out, (uint32_t)(value >> 32));
}

static inline void put_float(bytes *out, float value)
{
    put(out, &value, 4);
}

static inline sgs_gaussians *read_bytes(const temp_folder *folder, const char *name,
                                        const bytes *file, sgs_model_info *info)
{
    sgs_gaussians *model;
    file_put(temp_path(folder, name), file->data, file->size);
    if (sgs_model_read(temp_path(folder, name), NULL, &model, info))
        fail_msg("%s", sgs_last_error());
    return model;
}

static inline void expect(const sgs_gaussians *model, size_t i, int param, double expected)
{
    const double value = (double)model_value(model, i, param);
    if (!(fabs(value - expected) <= 2e-6 * (1.0 + fabs(expected))))
        fail_msg("parameter %d of primitive %zu is %.9g, expected %.9g", param, i, value, expected);
}

static inline void expect_row(const sgs_gaussians *model, size_t i, int param, int count,
                              const double *expected)
{
    for (int k = 0; k < count; ++k)
        expect(model, i, param + k, expected[k]);
}

static inline double logit(double p)
{
    return log(p / (1.0 - p));
}
