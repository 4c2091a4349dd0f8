// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A record, little-endian:
//
//   name, 32 bytes, padded with zeros | type: u16 | essential: u16 | bytes: u32 | value

#include "base/fields.h"

#include <string.h>

#include "base/core.h"

enum { HEADER_BYTES = SGSI_FIELD_NAME + 8, MAX_FIELDS = 64 };

void sgsi_fields_put(sgsi_field_list *list, const char *name, sgsi_field_type type, bool essential,
                     const void *value, size_t bytes)
{
    if (list->failed)
        return;
    const size_t wanted = list->count + HEADER_BYTES + bytes;
    if (wanted > list->capacity) {
        uint8_t *grown = sgsi_alloc(2 * wanted, 1);
        if (!grown) {
            list->failed = true;
            return;
        }
        if (list->count)
            memcpy(grown, list->bytes, list->count);
        sgsi_free(list->bytes);
        list->bytes = grown;
        list->capacity = 2 * wanted;
    }
    uint8_t *at = list->bytes + list->count;
    const uint16_t marks[2] = {(uint16_t)type, essential};
    const uint32_t length = (uint32_t)bytes;
    memset(at, 0, HEADER_BYTES);
    memcpy(at, name, strnlen(name, SGSI_FIELD_NAME - 1));
    memcpy(at + SGSI_FIELD_NAME, marks, sizeof marks);
    memcpy(at + SGSI_FIELD_NAME + sizeof marks, &length, sizeof length);
    if (bytes)
        memcpy(at + HEADER_BYTES, value, bytes);
    list->count = wanted;
}

bool sgsi_fields_next(const uint8_t **at, const uint8_t *end, sgsi_field_record *record,
                      bool *damaged)
{
    const size_t left = (size_t)(end - *at);
    *damaged = false;
    if (!left)
        return false;
    *damaged = true;
    if (left < HEADER_BYTES)
        return false;
    uint16_t marks[2];
    uint32_t length;
    memcpy(marks, *at + SGSI_FIELD_NAME, sizeof marks);
    memcpy(&length, *at + SGSI_FIELD_NAME + sizeof marks, sizeof length);
    if (length > left - HEADER_BYTES || marks[1] > 1)
        return false;
    *record = (sgsi_field_record){.type = (sgsi_field_type)marks[0],
                                  .essential = marks[1] == 1,
                                  .value = *at + HEADER_BYTES,
                                  .bytes = length};
    memcpy(record->name, *at, SGSI_FIELD_NAME);
    *at += HEADER_BYTES + length;
    *damaged = false;
    return true;
}

static size_t type_bytes(sgsi_field_type type)
{
    return type == SGSI_FIELD_I32 || type == SGSI_FIELD_U32 ? 4 : 8;
}

void sgsi_fields_write(sgsi_field_list *list, const sgsi_field *fields, size_t count,
                       const void *object)
{
    for (size_t i = 0; i < count; ++i)
        sgsi_fields_put(list, fields[i].name, fields[i].type, fields[i].essential,
                        (const char *)object + fields[i].offset, type_bytes(fields[i].type));
}

static sgs_status read_record(const char *path, const char *section,
                              const sgsi_field_record *record, const sgsi_field *fields,
                              size_t count, uint64_t *seen, void *object)
{
    for (size_t i = 0; i < count; ++i) {
        if (strcmp(fields[i].name, record->name))
            continue;
        if (record->type != fields[i].type || record->bytes != type_bytes(record->type))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s': field '%s' has another type",
                             path, section, record->name);
        if (*seen >> i & 1)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s': field '%s' appears twice", path,
                             section, record->name);
        *seen |= UINT64_C(1) << i;
        memcpy((char *)object + fields[i].offset, record->value, record->bytes);
        return SGS_STATUS_OK;
    }
    if (!record->essential)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: section '%s': unknown field '%s'; resume with the program that wrote the "
                     "file",
                     path, section, record->name);
}

sgs_status sgsi_fields_read(const char *path, const char *section, const uint8_t *bytes,
                            size_t size, const sgsi_field *fields, size_t count, void *object)
{
    uint64_t seen = 0;
    sgsi_field_record record;
    bool damaged = false;
    sgs_status status = SGS_STATUS_OK;
    if (count > MAX_FIELDS)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: section '%s' has more than %d fields", path,
                         section, MAX_FIELDS);
    const uint8_t *at = bytes, *end = bytes + size;
    while (!status && sgsi_fields_next(&at, end, &record, &damaged))
        status = read_record(path, section, &record, fields, count, &seen, object);
    if (!status && damaged)
        status = sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s': a field is truncated or damaged",
                           path, section);
    for (size_t i = 0; i < count && !status; ++i)
        if (fields[i].essential && !(seen >> i & 1))
            status = sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s': field '%s' is missing", path,
                               section, fields[i].name);
    return status;
}
