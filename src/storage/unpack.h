// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Decompression of untrusted data, and compression, in memory. The output buffer starts at four
// times the input and doubles only after it was filled, so that a false size allocates little.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef enum sgsi_packing {
    SGSI_PACKING_GZIP,
    SGSI_PACKING_DEFLATE,
    SGSI_PACKING_ZSTD
} sgsi_packing;

// Decompresses `size` bytes into *out, which the caller frees with sgsi_free. most: the largest
// output to accept; a larger one is an error. `what` names the data in errors: "FILE: WHAT is
// corrupt". Fails with FORMAT, LIMIT or OUT_OF_MEMORY.
sgs_status sgsi_unpack(sgsi_packing packing, const char *path, const char *what, const uint8_t *in,
                       size_t size, size_t most, uint8_t **out, size_t *out_size);

// Compresses; the caller frees *out with sgsi_free. Fails with OUT_OF_MEMORY.
sgs_status sgsi_pack(sgsi_packing packing, int level, const uint8_t *in, size_t size, uint8_t **out,
                     size_t *out_size);
