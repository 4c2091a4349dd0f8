// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Named fields as bytes: a list of {name, type, value} records, so that fields can be added and
// removed. A record is essential if a reader that does not have the field must refuse the list.
// Independent of the meaning of the fields.

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

// Reads the record at *at and advances *at. False at the end; also with *damaged if the last record
// is incomplete.
bool sgsi_fields_next(const uint8_t **at, const uint8_t *end, sgsi_field_record *record,
                      bool *damaged);

// A member of a struct, of the type's C type (size_t: SGSI_FIELD_U64 where it has 64 bits).
typedef struct sgsi_field {
    const char *name;
    sgsi_field_type type; // not TEXT
    size_t offset;
    bool essential; // a list without it is refused; else a member without a record keeps its value
} sgsi_field;

void sgsi_fields_write(sgsi_field_list *list, const sgsi_field *fields, size_t count,
                       const void *object);

// Fills `object`; fields without a record keep their values. Unknown records are skipped unless
// they are essential. Fails with FORMAT if a record is cut, repeated or of another type, or an
// essential field is missing, and with UNSUPPORTED for an unknown essential record. Errors begin
// with `path` and name `section` and the field.
sgs_status sgsi_fields_read(const char *path, const char *section, const uint8_t *bytes,
                            size_t size, const sgsi_field *fields, size_t count, void *object);
