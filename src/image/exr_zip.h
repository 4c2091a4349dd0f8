// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The ZIP and ZIPS compressions of EXR, on byte buffers. Independent of pixels and files.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// One compressor and buffer per thread.
typedef struct sgsi_exr_zip sgsi_exr_zip;

// For chunks of at most `largest` bytes; `level` of libdeflate, 1 (fastest) to 12 (smallest).
// Returns NULL if out of memory.
sgsi_exr_zip *sgsi_exr_zip_create(int threads, int level, size_t largest);
void sgsi_exr_zip_destroy(sgsi_exr_zip *zip);
// Raises the number of threads and `largest`. Returns false if out of memory.
bool sgsi_exr_zip_reserve(sgsi_exr_zip *zip, int threads, size_t largest);

// Compresses `count` bytes of `raw` to out [count]. Returns the compressed size, or 0 if it would
// not be smaller; `raw` is then stored as it is, which readers accept.
size_t sgsi_exr_zip_pack(sgsi_exr_zip *zip, int thread, const uint8_t *raw, size_t count,
                         uint8_t *out);

// The inverse: inflates `size` bytes of `packed` to out [count]; scratch [count]. False if they are
// damaged or have another decoded size, and without memory.
bool sgsi_exr_zip_unpack(const uint8_t *packed, size_t size, uint8_t *scratch, uint8_t *out,
                         size_t count);
