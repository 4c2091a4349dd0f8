// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "compress/cell_codes.h"

static const char name[] = "cells";
enum { GROUP_BYTES = 10 }; // of 64 bits

void sgsi_pack_cells(sgsi_packer *out, const uint64_t *cells, size_t count)
{
    uint8_t *bytes = sgsi_alloc(count, GROUP_BYTES);
    if (!bytes) {
        out->status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu cells", count);
        return;
    }
    size_t size = 0;
    for (size_t i = 0; i < count; ++i) {
        uint64_t rest = cells[i] - (i ? cells[i - 1] : 0);
        for (; rest >= 128; rest >>= 7)
            bytes[size++] = (uint8_t)(rest | 128);
        bytes[size++] = (uint8_t)rest;
    }
    sgsi_packer_add(out, name, bytes, size, true);
    sgsi_free(bytes);
}

sgs_status sgsi_unpack_cells(sgsi_container *in, size_t count, int bits, bool distinct,
                             uint64_t **cells)
{
    const uint8_t *bytes;
    size_t size, at = 0;
    const sgs_status status = sgsi_container_take(in, name, SGSI_ANY_SIZE, &bytes, &size);
    if (status)
        return status;
    bool valid = count <= size;
    *cells = valid ? sgsi_alloc(count, sizeof **cells) : NULL;
    if (valid && !*cells)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu cells", in->path,
                         count);
    const uint64_t end = UINT64_C(1) << bits;
    uint64_t code = 0;
    for (size_t i = 0; i < count && valid; ++i) {
        uint64_t step = 0;
        bool more = true;
        for (int shift = 0; shift <= 63 && more && at < size; shift += 7) {
            step |= (uint64_t)(bytes[at] & 127) << shift;
            more = bytes[at++] & 128;
        }
        valid = !more && (step || !i || !distinct) && step < end - code;
        code += step;
        (*cells)[i] = code;
    }
    if (!valid || at != size)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section 'cells' does not contain %zu ascending cells", in->path,
                         count);
    return SGS_STATUS_OK;
}
