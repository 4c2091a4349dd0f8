// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Radix sort from the lowest byte of the key on: stable, and independent of the values.

#include "base/keyed_rows.h"

void sgsi_sort_rows(sgsi_keyed_row *rows, sgsi_keyed_row *spare, size_t count)
{
    for (int shift = 0; shift < 64; shift += 16) {
        // Two passes of 8 bits, so that the result is in `rows` again.
        for (int half = 0; half < 2; ++half) {
            sgsi_keyed_row *from = half ? spare : rows, *to = half ? rows : spare;
            size_t begin[256] = {0}, total = 0;
            for (size_t i = 0; i < count; ++i)
                ++begin[from[i].key >> (shift + 8 * half) & 255];
            for (int k = 0; k < 256; ++k) {
                const size_t size = begin[k];
                begin[k] = total;
                total += size;
            }
            for (size_t i = 0; i < count; ++i)
                to[begin[from[i].key >> (shift + 8 * half) & 255]++] = from[i];
        }
    }
}
