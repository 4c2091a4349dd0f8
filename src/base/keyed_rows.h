// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Sorting row numbers by 64-bit keys.

#include <stddef.h>
#include <stdint.h>

typedef struct sgsi_keyed_row {
    uint64_t key;
    uint32_t row;
} sgsi_keyed_row;

// Sorts by key; equal keys keep their order. spare: as many rows as scratch memory; the result is
// in `rows`.
void sgsi_sort_rows(sgsi_keyed_row *rows, sgsi_keyed_row *spare, size_t count);
