// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// ZIP as in PKWARE's APPNOTE.TXT: entries are found by the central directory at the end of the
// file.

#include "storage/archive.h"

#include <libdeflate.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/output_file.h"
#include "storage/model_rows.h"
#include "storage/unpack.h"

enum {
    LOCAL_BYTES = 30,
    CENTRAL_BYTES = 46,
    END_BYTES = 22,
    MAX_COMMENT = 65535,
    METHOD_STORED = 0,
    METHOD_DEFLATE = 8,
    ENCRYPTED = 1,
    UTF8_NAMES = 0x800,
    VERSION_NEEDED = 20,
    DATE_1980 = 33 // 1980-01-01: files with equal contents are equal
};

static const uint32_t LOCAL_MAGIC = 0x04034B50, CENTRAL_MAGIC = 0x02014B50, END_MAGIC = 0x06054B50;
static const size_t DEFLATE_RATIO = 1032;

static const uint8_t *find_end(const sgsi_archive *archive)
{
    if (archive->size < END_BYTES)
        return NULL;
    const size_t last = archive->size - END_BYTES,
                 first = last > MAX_COMMENT ? last - MAX_COMMENT : 0;
    for (size_t at = last + 1; at-- > first;)
        if (sgsi_load_u32(archive->bytes + at) == END_MAGIC)
            return archive->bytes + at;
    return NULL;
}

static sgs_status read_entry(sgsi_archive *archive, size_t *at, size_t number)
{
    const uint8_t *bytes = archive->bytes + *at;
    const size_t left = archive->size - *at;
    sgsi_archive_entry *entry = &archive->entries[archive->entry_count];
    if (left < CENTRAL_BYTES || sgsi_load_u32(bytes) != CENTRAL_MAGIC)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: entry %zu of the ZIP directory is corrupt", archive->path,
                         *at, number);
    const size_t name = sgsi_load_u16(bytes + 28), extra = sgsi_load_u16(bytes + 30),
                 comment = sgsi_load_u16(bytes + 32), local = sgsi_load_u32(bytes + 42);
    if (name + extra + comment > left - CENTRAL_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: entry %zu of the ZIP directory is "
                         "truncated",
                         archive->path, *at, number);
    entry->method = sgsi_load_u16(bytes + 10);
    entry->checksum = sgsi_load_u32(bytes + 16);
    entry->packed = sgsi_load_u32(bytes + 20);
    entry->unpacked = sgsi_load_u32(bytes + 24);
    entry->name = sgsi_format("%.*s", (int)name, (const char *)bytes + CENTRAL_BYTES);
    if (!entry->name)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                         archive->path);
    ++archive->entry_count;
    *at += CENTRAL_BYTES + name + extra + comment;
    for (char *letter = entry->name; *letter; ++letter) // may appear in an error message
        *letter = (char)(*letter < 32 || *letter > 126 ? '?' : *letter);
    if (sgsi_load_u16(bytes + 8) & ENCRYPTED)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: %s is encrypted", archive->path, entry->name);
    if (entry->method != METHOD_STORED && entry->method != METHOD_DEFLATE)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: %s has ZIP method %d; supported: 0 (stored) and 8 (deflate)",
                         archive->path, entry->name, entry->method);
    if (local > archive->size || archive->size - local < LOCAL_BYTES ||
        sgsi_load_u32(archive->bytes + local) != LOCAL_MAGIC)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte %zu: %s has no local ZIP header",
                         archive->path, local, entry->name);
    entry->offset = local + LOCAL_BYTES + sgsi_load_u16(archive->bytes + local + 26) +
                    sgsi_load_u16(archive->bytes + local + 28);
    if (entry->offset > archive->size || entry->packed > archive->size - entry->offset)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: %s takes %zu bytes, beyond the end of the file",
                         archive->path, entry->offset, entry->name, entry->packed);
    if (entry->method == METHOD_STORED && entry->packed != entry->unpacked)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s is stored, but has two sizes, %zu and %zu",
                         archive->path, entry->name, entry->packed, entry->unpacked);
    return SGS_STATUS_OK;
}

sgs_status sgsi_archive_open(sgsi_archive *archive, const char *path)
{
    *archive = (sgsi_archive){.path = sgsi_strdup(path)};
    if (!archive->path)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    if (sgsi_is_folder(path))
        return SGS_STATUS_OK;
    sgs_status status = sgsi_file_read(path, 0, &archive->bytes, &archive->size);
    if (status)
        return status;
    const uint8_t *end = find_end(archive);
    if (!end)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: has no ZIP directory; the file is truncated or not a ZIP file", path);
    const size_t count = sgsi_load_u16(end + 10);
    size_t at = sgsi_load_u32(end + 16);
    if (at > archive->size || count > (archive->size - at) / CENTRAL_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: the ZIP directory of %zu entries at byte %zu is outside of the file",
                         path, count, at);
    archive->entries = sgsi_calloc(count + 1, sizeof *archive->entries);
    if (!archive->entries)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    for (size_t k = 0; !status && k < count; ++k)
        status = read_entry(archive, &at, k);
    return status;
}

void sgsi_archive_close(sgsi_archive *archive)
{
    for (size_t k = 0; k < archive->entry_count; ++k)
        sgsi_free(archive->entries[k].name);
    sgsi_free(archive->entries);
    sgsi_free(archive->bytes);
    sgsi_free(archive->path);
    *archive = (sgsi_archive){0};
}

static sgs_status read_from_folder(const sgsi_archive *archive, const char *name, size_t most,
                                   uint8_t **bytes, size_t *size)
{
    char *path = sgsi_format("%s/%s", archive->path, name);
    const sgs_status status = path ? sgsi_file_read(path, most, bytes, size)
                                   : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                               "%s: not enough memory to read it", archive->path);
    sgsi_free(path);
    return status;
}

// Some writers leave the checksum 0.
static sgs_status check_entry(const sgsi_archive *archive, const sgsi_archive_entry *entry,
                              uint8_t **bytes, size_t *size)
{
    if (!entry->checksum || libdeflate_crc32(0, *bytes, *size) == entry->checksum)
        return SGS_STATUS_OK;
    sgsi_free(*bytes);
    *bytes = NULL;
    *size = 0;
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s has a wrong checksum; the file is damaged",
                     archive->path, entry->name);
}

sgs_status sgsi_archive_read(const sgsi_archive *archive, const char *name, size_t most,
                             uint8_t **bytes, size_t *size)
{
    const sgsi_archive_entry *entry = archive->entries;
    *bytes = NULL;
    *size = 0;
    for (const char *letter = name; *letter; ++letter)
        if ((unsigned char)*letter < 32 || *letter == 127)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: an entry name contains control characters",
                             archive->path);
    if (!*name || strchr(name, '/') || strchr(name, '\\') || !strcmp(name, ".."))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: '%.64s' is not a valid entry name", archive->path,
                         name);
    if (!archive->bytes)
        return read_from_folder(archive, name, most, bytes, size);
    while (entry < archive->entries + archive->entry_count && strcmp(entry->name, name))
        ++entry;
    if (entry == archive->entries + archive->entry_count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has no file '%.64s'", archive->path, name);
    if (entry->unpacked > most)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: %s has %zu bytes; the limit is %zu", archive->path,
                         name, entry->unpacked, most);
    const uint8_t *packed = archive->bytes + entry->offset;
    if (entry->method == METHOD_DEFLATE) {
        const size_t bound = entry->packed * DEFLATE_RATIO + DEFLATE_RATIO,
                     room = entry->unpacked < bound ? entry->unpacked : bound;
        const sgs_status status = sgsi_unpack(SGSI_PACKING_DEFLATE, archive->path, name, packed,
                                              entry->packed, room, bytes, size);
        if (status)
            return status;
        (*bytes)[*size] = 0;
        return check_entry(archive, entry, bytes, size);
    }
    *bytes = sgsi_alloc(entry->packed + 1, 1);
    if (!*bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                         archive->path);
    memcpy(*bytes, packed, entry->packed);
    (*bytes)[entry->packed] = 0;
    *size = entry->packed;
    return check_entry(archive, entry, bytes, size);
}

// ---- Writing ----

// The fields that local header and directory share, from the version on.
static void put_fields(uint8_t *at, const sgsi_archive_file *file)
{
    const uint32_t sum = libdeflate_crc32(0, file->bytes, file->size);
    sgsi_store_u16(at, VERSION_NEEDED);
    sgsi_store_u16(at + 2, UTF8_NAMES);
    sgsi_store_u16(at + 8, DATE_1980);
    sgsi_store_u32(at + 10, sum);
    sgsi_store_u32(at + 14, (uint32_t)file->size);
    sgsi_store_u32(at + 18, (uint32_t)file->size);
    sgsi_store_u16(at + 22, (uint32_t)strlen(file->name));
}

sgs_status sgsi_archive_write(const char *path, const sgsi_archive_file *files, size_t count,
                              uint64_t *written)
{
    size_t total = END_BYTES, at = 0;
    for (size_t k = 0; k < count; ++k)
        total += LOCAL_BYTES + CENTRAL_BYTES + 2 * strlen(files[k].name) + files[k].size;
    if (total > UINT32_MAX)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: %zu bytes exceed the 4 GiB of a ZIP file", path,
                         total);
    uint8_t *bytes = sgsi_calloc(total, 1), *central = NULL;
    if (!bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    size_t directory = 0;
    for (size_t k = 0; k < count; ++k)
        directory += LOCAL_BYTES + strlen(files[k].name) + files[k].size;
    central = bytes + directory;
    for (size_t k = 0; k < count; ++k) {
        const size_t length = strlen(files[k].name);
        sgsi_store_u32(bytes + at, LOCAL_MAGIC);
        put_fields(bytes + at + 4, &files[k]);
        memcpy(bytes + at + LOCAL_BYTES, files[k].name, length);
        memcpy(bytes + at + LOCAL_BYTES + length, files[k].bytes, files[k].size);
        sgsi_store_u32(central, CENTRAL_MAGIC);
        sgsi_store_u16(central + 4, VERSION_NEEDED);
        put_fields(central + 6, &files[k]);
        sgsi_store_u32(central + 42, (uint32_t)at);
        memcpy(central + CENTRAL_BYTES, files[k].name, length);
        central += CENTRAL_BYTES + length;
        at += LOCAL_BYTES + length + files[k].size;
    }
    sgsi_store_u32(central, END_MAGIC);
    sgsi_store_u16(central + 8, (uint32_t)count);
    sgsi_store_u16(central + 10, (uint32_t)count);
    sgsi_store_u32(central + 12, (uint32_t)((size_t)(central - bytes) - directory));
    sgsi_store_u32(central + 16, (uint32_t)directory);
    const sgs_status status = sgs_output_file_write(path, bytes, total);
    sgsi_free(bytes);
    *written += total;
    return status;
}
