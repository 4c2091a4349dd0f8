// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Packages of OpenUSD, byte by byte.

#include <stddef.h>
#include <string.h>

static inline size_t usdz_put_le(unsigned char *to, size_t bytes, size_t value)
{
    for (size_t k = 0; k < bytes; ++k)
        to[k] = (unsigned char)(value >> (8 * k));
    return bytes;
}

// A package as the USDZ specification describes it: a ZIP file with stored files, whose data begin
// at multiples of 64 bytes. The directory lists them in reverse. Returns its size.
static inline size_t usdz_bytes(unsigned char *zip, const char *const files[2][2],
                                const size_t sizes[2])
{
    size_t at = 0, starts[2];
    for (int k = 0; k < 2; ++k) {
        const size_t name = strlen(files[k][0]), pad = 64 - (at + 30 + name) % 64;
        starts[k] = at;
        memset(zip + at, 0, 30);
        memcpy(zip + at, "PK\3\4\12", 5);
        usdz_put_le(zip + at + 18, 4, sizes[k]);
        usdz_put_le(zip + at + 22, 4, sizes[k]);
        usdz_put_le(zip + at + 26, 2, name);
        usdz_put_le(zip + at + 28, 2, pad);
        memcpy(zip + at + 30, files[k][0], name);
        memset(zip + at + 30 + name, 0, pad);
        memcpy(zip + at + 30 + name + pad, files[k][1], sizes[k]);
        at += 30 + name + pad + sizes[k];
    }
    const size_t directory = at;
    for (int k = 1; k >= 0; --k) {
        const size_t name = strlen(files[k][0]);
        memset(zip + at, 0, 46);
        memcpy(zip + at, "PK\1\2\12", 5);
        usdz_put_le(zip + at + 20, 4, sizes[k]);
        usdz_put_le(zip + at + 24, 4, sizes[k]);
        usdz_put_le(zip + at + 28, 2, name);
        usdz_put_le(zip + at + 42, 4, starts[k]);
        memcpy(zip + at + 46, files[k][0], name);
        at += 46 + name;
    }
    memset(zip + at, 0, 22);
    memcpy(zip + at, "PK\5\6", 4);
    usdz_put_le(zip + at + 8, 2, 2);
    usdz_put_le(zip + at + 10, 2, 2);
    usdz_put_le(zip + at + 12, 4, at - directory);
    usdz_put_le(zip + at + 16, 4, directory);
    return at + 22;
}
