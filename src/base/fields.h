// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Named fields as bytes: a list of {name, type, value} records, so that a field can be added or
// dropped without a reader mistaking one for another. A record is marked essential when a reader
// that does not know its name must not ignore it. Does not know what the fields mean.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

enum { SGSI_FIELD_NAME = 32 };

typedef enum sgsi_field_type {
    SGSI_FIELD_I32 = 1,
    SGSI_FIELD_U32,
    SGSI_FIELD_I64,
    SGSI_FIELD_U64,
    SGSI_FIELD_F64,
    SGSI_FIELD_TEXT // not terminated
} sgsi_field_type;

// Bytes under construction. Zero-initialise; release `bytes` with sgsi_free.
typedef struct sgsi_field_list {
    uint8_t *bytes;
    size_t count, capacity;
    bool failed; // out of memory; further records are dropped
} sgsi_field_list;

// Appends a record. Names are shorter than SGSI_FIELD_NAME.
void sgsi_fields_put(sgsi_field_list *list, const char *name, sgsi_field_type type, bool essential,
                     const void *value, size_t bytes);

// One record of a list that is being read; `value` points into the list and may be unaligned.
typedef struct sgsi_field_record {
    char name[SGSI_FIELD_NAME + 1];
    sgsi_field_type type;
    bool essential;
    const uint8_t *value;
    size_t bytes;
} sgsi_field_record;

// The record at *at, which moves behind it. False at the end, or with *damaged when the bytes left
// hold no whole record.
bool sgsi_fields_next(const uint8_t **at, const uint8_t *end, sgsi_field_record *record,
                      bool *damaged);

// A member of a struct, of the type's C type (size_t: SGSI_FIELD_U64 where it has 64 bits).
typedef struct sgsi_field {
    const char *name;
    sgsi_field_type type; // not TEXT
    size_t offset;
    bool essential; // must be in the list; another one keeps the value that the struct had
} sgsi_field;

void sgsi_fields_write(sgsi_field_list *list, const sgsi_field *fields, size_t count,
                       const void *object);

// Fills `object`, which holds the values of fields that the list does not name. Unknown records are
// skipped unless they are essential. FORMAT when a record is cut, repeated or of another type, or
// an essential field is missing; UNSUPPORTED for an unknown essential record. Errors begin with
// `path` and name `section` and the field.
sgs_status sgsi_fields_read(const char *path, const char *section, const uint8_t *bytes,
                            size_t size, const sgsi_field *fields, size_t count, void *object);
