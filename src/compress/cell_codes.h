// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Ascending cell codes of an octree as a section: differences in groups of 7 bits, the least
// significant first, deflated.

#include "compress/container.h"

void sgsi_pack_cells(sgsi_packer *out, const uint64_t *cells, size_t count);

// Codes below 2^bits (bits <= 63), strictly ascending if `distinct`. The section proves its cells:
// every one takes at least a byte. *cells is released with sgsi_free, also after a failure (FORMAT
// or OUT_OF_MEMORY).
sgs_status sgsi_unpack_cells(sgsi_container *in, size_t count, int bits, bool distinct,
                             uint64_t **cells);
