// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A file of named sections with a checksum. One function of the caller names its sections and their
// pieces of memory in order; it is run three times for the three passes below, so that writing and
// reading cannot drift apart. Knows nothing of what is in the sections.
//
//     sgsi_sections_begin(&s, "exposure", count * sizeof(float));
//     sgsi_sections_piece(&s, exposure, count * sizeof(float));

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core.h"

enum { SGSI_SECTION_NAME = 16, SGSI_SECTIONS_MOST = 64 };

typedef enum sgsi_sections_pass {
    SGSI_SECTIONS_WRITE, // pieces go to the file
    SGSI_SECTIONS_CHECK, // names and sizes are compared with the file's; no piece is touched
    SGSI_SECTIONS_READ   // pieces are filled
} sgsi_sections_pass;

typedef struct sgsi_section {
    char name[SGSI_SECTION_NAME + 1];
    size_t at, bytes;
    bool known; // the CHECK pass asked for it
} sgsi_section;

typedef struct sgsi_sections {
    sgsi_sections_pass pass;
    sgs_status status; // of the first failure; the calls after it do nothing
    const char *path;
    size_t left; // bytes of the open section that no piece has taken yet
    // WRITE
    sgsi_atomic_file file;
    void *hash;
    // CHECK and READ
    uint8_t *bytes;
    const uint8_t *next;
    sgsi_section table[SGSI_SECTIONS_MOST];
    size_t count;
} sgsi_sections;

// Starts the file at `path` (borrowed); it appears under its name, flushed to the disk, only by
// sgsi_sections_commit.
sgs_status sgsi_sections_create(sgsi_sections *sections, const char *path);
// Ends the file or, after a failure, removes what was written. Frees the struct's memory in any
// case.
sgs_status sgsi_sections_commit(sgsi_sections *sections);

// Reads a file and proves that it is whole: magic, version, sizes, checksum. The pass is CHECK. On
// failure (IO, FORMAT, UNSUPPORTED, OUT_OF_MEMORY; the error names the file and the place) nothing
// is left to close.
sgs_status sgsi_sections_open(sgsi_sections *sections, const char *path);
void sgsi_sections_close(sgsi_sections *sections);
// The content of a section, NULL if there is none of this name; the section counts as known.
const uint8_t *sgsi_sections_find(sgsi_sections *sections, const char *name, size_t *bytes);
// After the CHECK pass: the status, or FORMAT naming a section that nobody asked for.
sgs_status sgsi_sections_checked(sgsi_sections *sections);

// Opens the next section. CHECK fails with FORMAT when it is missing or has another size.
void sgsi_sections_begin(sgsi_sections *sections, const char *name, size_t bytes);
void sgsi_sections_piece(sgsi_sections *sections, void *data, size_t bytes);
