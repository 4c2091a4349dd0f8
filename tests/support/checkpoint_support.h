// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Checkpoints as bytes, for tests that modify them and fix the checksum. Include after cmocka.h.

#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <xxhash.h>

// Start of the section's header in the file (name 16, length 8, content), or 0.
static inline size_t section_find(const unsigned char *bytes, size_t size, const char *name)
{
    for (size_t at = 32; at + 24 + 8 <= size;) {
        uint64_t length;
        memcpy(&length, bytes + at + 16, sizeof length);
        if (!strncmp((const char *)bytes + at, name, 16))
            return at;
        if (length > size - at - 24)
            return 0;
        at += 24 + length;
    }
    return 0;
}

// Start of the value of a field in a section of fields (name 32, type 2, essential 2, length 4,
// value), or 0.
static inline size_t field_find(const unsigned char *bytes, size_t size, const char *section,
                                const char *name)
{
    const size_t header = section_find(bytes, size, section);
    uint64_t length;
    memcpy(&length, bytes + header + 16, sizeof length);
    for (size_t at = header + 24; at + 40 <= header + 24 + length;) {
        uint32_t value;
        memcpy(&value, bytes + at + 36, sizeof value);
        if (!strncmp((const char *)bytes + at, name, 32))
            return at + 40;
        at += 40 + value;
    }
    return 0;
}

static inline void checkpoint_reseal(unsigned char *bytes, size_t size)
{
    if (size < 8)
        return;
    const uint64_t digest = XXH64(bytes, size - 8, 0);
    memcpy(bytes + size - 8, &digest, sizeof digest);
}
