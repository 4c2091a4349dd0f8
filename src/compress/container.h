// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The file of a compressed model: a header with the method, named sections with sizes and
// checksums, each stored as it is or deflated. The contents of the sections belong to the methods.
//
// Reading a file never allocates more than four times its size before the data is proven to exist:
// a deflated section is inflated in growing pieces.

#include <stdbool.h>
#include <stdint.h>

#include "base/core.h"

enum { SGSI_CONTAINER_NAME = 16, SGSI_CONTAINER_SECTIONS = 64, SGSI_CONTAINER_METHOD = 16 };

typedef struct sgsi_container_header {
    char method[SGSI_CONTAINER_METHOD + 1]; // "ghap"
    uint32_t version;                       // of the method's layout
    uint32_t sh_degree;                     // 0..3
    uint64_t count;                         // primitives of the decoded model
    uint64_t input;                         // primitives of the model that was compressed
} sgsi_container_header;

typedef struct sgsi_container_section {
    char name[SGSI_CONTAINER_NAME + 1];
    bool deflated, taken;
    size_t stored, bytes; // in the file, and decoded
    uint8_t *data;        // writer: stored bytes. Reader: NULL, or the inflated bytes; owned
    size_t at;            // reader: offset in the file
} sgsi_container_section;

// ---- Writing ----

// Zero-initialise and fill in the header.
typedef struct sgsi_packer {
    sgsi_container_header header;
    sgs_status status; // first failure; later calls do nothing
    size_t count;
    sgsi_container_section sections[SGSI_CONTAINER_SECTIONS];
} sgsi_packer;

// Adds a copy of the bytes. `deflate`: deflated if that is smaller.
void sgsi_packer_add(sgsi_packer *packer, const char *name, const void *data, size_t bytes,
                     bool deflate);
// Writes the file atomically; *bytes is its size. Fails with packer->status, IO or OUT_OF_MEMORY.
sgs_status sgsi_packer_write(sgsi_packer *packer, const char *path, size_t *bytes);
void sgsi_packer_free(sgsi_packer *packer);

// ---- Reading ----

typedef struct sgsi_container {
    const char *path;
    uint8_t *file;
    size_t size;
    sgsi_container_header header;
    size_t count;
    sgsi_container_section sections[SGSI_CONTAINER_SECTIONS];
} sgsi_container;

enum { SGSI_ANY_SIZE = -1 };

// Whether a regular file begins as a container.
bool sgsi_container_is(const char *path);

// Reads a file and verifies header, table of sections and checksums. Fails with IO, FORMAT,
// UNSUPPORTED or OUT_OF_MEMORY; nothing needs to be closed then. `path` is borrowed.
sgs_status sgsi_container_open(const char *path, sgsi_container *container);
void sgsi_container_close(sgsi_container *container); // accepts a zeroed one

// The decoded bytes of a section, valid until close. `bytes` is the required size, or
// SGSI_ANY_SIZE. size may be NULL. Fails with FORMAT naming the section, or OUT_OF_MEMORY.
sgs_status sgsi_container_take(sgsi_container *container, const char *name, int64_t bytes,
                               const uint8_t **data, size_t *size);
// Whether the file has a section of this name.
bool sgsi_container_has(const sgsi_container *container, const char *name);
// FORMAT if a section was never taken.
sgs_status sgsi_container_finish(const sgsi_container *container);
