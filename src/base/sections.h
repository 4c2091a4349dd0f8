// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A file of named sections with a checksum. One function of the caller lists its sections and their
// memory in order. It runs once for each of the passes below, so that reading, writing and sizes
// always match. The content of the sections is opaque.
//
//     sgsi_sections_begin(&s, "exposure", count * sizeof(float));
//     sgsi_sections_piece(&s, exposure, count * sizeof(float));

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core.h"
#include "sparegs/output_file.h"

enum { SGSI_SECTION_NAME = 16, SGSI_SECTIONS_MAX = 64 };

typedef enum sgsi_sections_pass {
    SGSI_SECTIONS_MEASURE, // adds up the size of the file; no piece is touched
    SGSI_SECTIONS_WRITE,   // pieces go to the file
    SGSI_SECTIONS_CHECK,   // names and sizes are compared with the file's; no piece is touched
    SGSI_SECTIONS_READ     // pieces are filled
} sgsi_sections_pass;

typedef struct sgsi_section {
    char name[SGSI_SECTION_NAME + 1];
    size_t at, bytes;
    uint8_t *content; // of sgsi_sections_find, owned; NULL before
    bool known;       // requested in the CHECK pass
} sgsi_section;

typedef struct sgsi_sections {
    sgsi_sections_pass pass;
    sgs_status status; // first failure; later calls do nothing
    const char *path;
    size_t left; // bytes of the open section that are not yet covered by pieces
    // MEASURE
    size_t measured; // bytes of the complete file
    // WRITE
    sgs_output_file file;
    void *hash;
    // CHECK and READ
    FILE *input;
    size_t next; // place of the next piece in the file
    sgsi_section table[SGSI_SECTIONS_MAX];
    size_t count;
} sgsi_sections;

// Starts a MEASURE pass. Nothing needs to be closed.
void sgsi_sections_measure(sgsi_sections *sections);

// Starts the file at `path` (borrowed). It appears under its name, synced, in sgsi_sections_commit.
sgs_status sgsi_sections_create(sgsi_sections *sections, const char *path);
// Completes the file or, after a failure, removes it. Frees the memory of the struct in both cases.
sgs_status sgsi_sections_commit(sgsi_sections *sections);

// Opens a file and verifies magic, version, sizes and checksum. The content stays in the file,
// which may be larger than the memory, until it is asked for. The pass is CHECK. On failure (IO,
// FORMAT, UNSUPPORTED, OUT_OF_MEMORY; the error names the file and the place) nothing needs to be
// closed.
sgs_status sgsi_sections_open(sgsi_sections *sections, const char *path);
void sgsi_sections_close(sgsi_sections *sections);
// Reads a section into memory of `sections`. FORMAT if there is none of this name, IO,
// OUT_OF_MEMORY. Marks the section as known.
sgs_status sgsi_sections_find(sgsi_sections *sections, const char *name, const uint8_t **content,
                              size_t *bytes);
// Size of a section; 0 if there is none of this name.
size_t sgsi_sections_size(sgsi_sections *sections, const char *name);
// Copies bytes [from, from + bytes) of a section. FORMAT if it lacks them, IO.
sgs_status sgsi_sections_copy(sgsi_sections *sections, const char *name, size_t from, void *data,
                              size_t bytes);
// After the CHECK pass: the status, or FORMAT naming a section that was not requested.
sgs_status sgsi_sections_checked(sgsi_sections *sections);

// Opens the next section. CHECK fails with FORMAT when it is missing or its size differs.
void sgsi_sections_begin(sgsi_sections *sections, const char *name, size_t bytes);
void sgsi_sections_piece(sgsi_sections *sections, void *data, size_t bytes);
