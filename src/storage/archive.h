// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Named files that form one model: the entries of a ZIP file, or files in a folder.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef struct sgsi_archive_entry {
    char *name;
    size_t offset, packed, unpacked; // offset of the data
    int method;                      // 0 stored, 8 deflate
    uint32_t checksum;               // CRC-32 of the unpacked data, 0 if the writer omits it
} sgsi_archive_entry;

typedef struct sgsi_archive {
    char *path;     // of the ZIP file or folder
    uint8_t *bytes; // of the ZIP file; NULL for a folder
    size_t size;
    sgsi_archive_entry *entries;
    size_t entry_count;
} sgsi_archive;

// Opens a ZIP file (stored or deflated entries; no encryption, no zip64), or a folder. Close it
// after a failure too. Fails with IO, FORMAT, UNSUPPORTED or OUT_OF_MEMORY.
sgs_status sgsi_archive_open(sgsi_archive *archive, const char *path);
void sgsi_archive_close(sgsi_archive *archive);

// Reads a named file of at most `most` bytes; (*bytes)[*size] is NUL. The name must be plain: no
// slash. The caller frees *bytes with sgsi_free. Fails with IO, FORMAT, LIMIT or OUT_OF_MEMORY.
sgs_status sgsi_archive_read(const sgsi_archive *archive, const char *name, size_t most,
                             uint8_t **bytes, size_t *size);

// A file to write.
typedef struct sgsi_archive_file {
    char name[64];
    uint8_t *bytes; // sgsi_alloc
    size_t size;
} sgsi_archive_file;

// Writes the files as one ZIP file with stored entries, atomically. Fails with LIMIT from 4 GiB on.
sgs_status sgsi_archive_write(const char *path, const sgsi_archive_file *files, size_t count,
                              uint64_t *written);
