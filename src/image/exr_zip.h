// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The ZIP and ZIPS compression of EXR: bytes in, deflated bytes out. Knows no pixels and no files.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// One deflater and buffer per thread of the coming loops.
typedef struct sgsi_exr_zip sgsi_exr_zip;

// For chunks of at most `largest` bytes. NULL when out of memory.
sgsi_exr_zip *sgsi_exr_zip_create(size_t largest);
void sgsi_exr_zip_destroy(sgsi_exr_zip *zip);
// The same for larger chunks. False when out of memory.
bool sgsi_exr_zip_reserve(sgsi_exr_zip *zip, size_t largest);

// Deflates `count` bytes of `raw` into out, [count]. Returns the number of bytes there, or 0 when
// they would not be fewer: then readers take `raw` itself. Cannot fail.
size_t sgsi_exr_zip_pack(sgsi_exr_zip *zip, int thread, const uint8_t *raw, size_t count,
                         uint8_t *out);
