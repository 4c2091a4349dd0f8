// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// For targets with checksums in their input: inputs below 8 bytes select a valid file, so that
// seeds do not depend on the format. The target defines prepare(), which sets good and good_size.

#include "fuzz_support.h"

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed);

static uint8_t *good;
static size_t good_size;

static void prepare(void);

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed)
{
    (void)seed;
    if (!good)
        prepare();
    if (size < 8 && good_size <= most) {
        memcpy(data, good, good_size);
        return good_size;
    }
    return LLVMFuzzerMutate(data, size, most);
}

#ifndef FUZZ_WITH_ENGINE
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most)
{
    (void)data;
    return size < most ? size : most;
}
#endif
