// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The file, little-endian:
//
//     0  "SGSPACK1"
//     8  method, 16 bytes, padded with zeros
//    24  version of the method's layout: u32 | SH degree: u32
//    32  primitives: u64 | primitives before the compression: u64
//    48  size of the file: u64 | sections: u32 | reserved: u32
//    64  per section, 48 bytes: name, 16 bytes | deflated: u32 | reserved: u32 |
//        stored bytes: u64 | decoded bytes: u64 | XXH64 of the stored bytes: u64
//        XXH64 of everything before it: u64
//        the sections, in the order of the table, without gaps
//
// A file has at least a quarter of a byte per primitive; a smaller one is padded. With this rule
// the count of the header is bounded by the size of the file.

#include "compress/container.h"
#include "sparegs/output_file.h"

#include <libdeflate.h>
#include <stdio.h>
#include <string.h>
#include <xxhash.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files have the byte order of memory");

static const char magic[8] = {'S', 'G', 'S', 'P', 'A', 'C', 'K', '1'};
static const char padding_name[] = "padding";
enum {
    HEADER_BYTES = 64,
    ENTRY_BYTES = 48,
    DIGEST_BYTES = 8,
    COUNT_PER_BYTE = 4,
    DEFLATE_LEVEL = 9
};
static const uint64_t MAX_COUNT = (UINT64_C(1) << 31) - 16;

static void put(uint8_t *at, uint64_t value, size_t bytes)
{
    memcpy(at, &value, bytes);
}

static uint64_t get(const uint8_t *at, size_t bytes)
{
    uint64_t value = 0;
    memcpy(&value, at, bytes);
    return value;
}

// ---- Writing ----

// A deflated copy if it is smaller. NULL if it is not, or without memory.
static uint8_t *deflated(const void *data, size_t bytes, size_t *stored)
{
    struct libdeflate_compressor *compressor = libdeflate_alloc_compressor(DEFLATE_LEVEL);
    uint8_t *out = compressor ? sgsi_alloc(bytes, 1) : NULL;
    *stored = out ? libdeflate_deflate_compress(compressor, data, bytes, out, bytes) : 0;
    libdeflate_free_compressor(compressor);
    if (*stored && *stored < bytes)
        return out;
    sgsi_free(out);
    return NULL;
}

void sgsi_packer_add(sgsi_packer *packer, const char *name, const void *data, size_t bytes,
                     bool deflate)
{
    if (packer->status)
        return;
    if (packer->count == SGSI_CONTAINER_SECTIONS) {
        packer->status = sgsi_fail(SGS_STATUS_INTERNAL, "too many sections in a container");
        return;
    }
    sgsi_container_section *section = &packer->sections[packer->count];
    *section = (sgsi_container_section){.bytes = bytes, .stored = bytes};
    snprintf(section->name, sizeof section->name, "%s", name);
    if (deflate && bytes)
        section->data = deflated(data, bytes, &section->stored);
    section->deflated = section->data != NULL;
    if (!section->data) {
        section->stored = bytes;
        section->data = sgsi_alloc(bytes + 1, 1);
        if (!section->data) {
            packer->status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                       "not enough memory for %zu bytes of a file", bytes);
            return;
        }
        if (bytes)
            memcpy(section->data, data, bytes);
    }
    ++packer->count;
}

static size_t file_bytes(const sgsi_packer *packer)
{
    size_t bytes = HEADER_BYTES + packer->count * ENTRY_BYTES + DIGEST_BYTES;
    for (size_t s = 0; s < packer->count; ++s)
        bytes += packer->sections[s].stored;
    return bytes;
}

static size_t fill_table(const sgsi_packer *packer, size_t total, uint8_t *table)
{
    const sgsi_container_header *header = &packer->header;
    memcpy(table, magic, sizeof magic);
    memcpy(table + 8, header->method, strnlen(header->method, SGSI_CONTAINER_METHOD));
    put(table + 24, header->version, 4);
    put(table + 28, header->sh_degree, 4);
    put(table + 32, header->count, 8);
    put(table + 40, header->input, 8);
    put(table + 48, total, 8);
    put(table + 56, packer->count, 4);
    uint8_t *at = table + HEADER_BYTES;
    for (size_t s = 0; s < packer->count; ++s, at += ENTRY_BYTES) {
        const sgsi_container_section *section = &packer->sections[s];
        memcpy(at, section->name, strnlen(section->name, SGSI_CONTAINER_NAME));
        put(at + 16, section->deflated, 4);
        put(at + 24, section->stored, 8);
        put(at + 32, section->bytes, 8);
        put(at + 40, XXH64(section->data, section->stored, 0), 8);
    }
    const size_t bytes = (size_t)(at - table);
    put(at, XXH64(table, bytes, 0), DIGEST_BYTES);
    return bytes + DIGEST_BYTES;
}

sgs_status sgsi_packer_write(sgsi_packer *packer, const char *path, size_t *bytes)
{
    const size_t least = packer->header.count / COUNT_PER_BYTE + 1;
    if (!packer->status && file_bytes(packer) < least) {
        uint8_t *zeros = sgsi_calloc(least, 1);
        if (!zeros)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
        sgsi_packer_add(packer, padding_name, zeros, least, false);
        sgsi_free(zeros);
    }
    if (packer->status)
        return packer->status;
    uint8_t table[HEADER_BYTES + SGSI_CONTAINER_SECTIONS * ENTRY_BYTES + DIGEST_BYTES] = {0};
    *bytes = file_bytes(packer);
    const size_t table_bytes = fill_table(packer, *bytes, table);
    sgs_output_file file;
    const sgs_status status = sgs_output_file_open(&file, path);
    if (status)
        return status;
    fwrite(table, 1, table_bytes, file.stream); // the commit reports a failed write
    for (size_t s = 0; s < packer->count; ++s)
        fwrite(packer->sections[s].data, 1, packer->sections[s].stored, file.stream);
    return sgs_output_file_commit(&file);
}

void sgsi_packer_free(sgsi_packer *packer)
{
    for (size_t s = 0; s < packer->count; ++s)
        sgsi_free(packer->sections[s].data);
    packer->count = 0;
}

// ---- Reading ----

bool sgsi_container_is(const char *path)
{
    char bytes[sizeof magic];
    FILE *stream;
    size_t size;
    if (sgsi_file_open(path, &stream, &size))
        return false;
    const bool is =
        fread(bytes, sizeof bytes, 1, stream) == 1 && !memcmp(bytes, magic, sizeof magic);
    fclose(stream);
    return is;
}

static sgs_status read_header(sgsi_container *container)
{
    const uint8_t *file = container->file;
    const char *path = container->path;
    sgsi_container_header *header = &container->header;
    if (container->size < 8 || memcmp(file, magic, sizeof magic))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: not a compressed model of sparegs", path);
    if (container->size < HEADER_BYTES + DIGEST_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: the file ends inside the header", path);
    memcpy(header->method, file + 8, SGSI_CONTAINER_METHOD);
    header->version = (uint32_t)get(file + 24, 4);
    header->sh_degree = (uint32_t)get(file + 28, 4);
    header->count = get(file + 32, 8);
    header->input = get(file + 40, 8);
    container->count = get(file + 56, 4);
    if (get(file + 48, 8) != container->size)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: the file has %zu bytes instead of %llu", path,
                         container->size, (unsigned long long)get(file + 48, 8));
    if (container->count > SGSI_CONTAINER_SECTIONS ||
        HEADER_BYTES + container->count * ENTRY_BYTES + DIGEST_BYTES > container->size)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte 56: %zu sections are too many", path,
                         container->count);
    const size_t digest_at = HEADER_BYTES + container->count * ENTRY_BYTES;
    if (get(file + digest_at, 8) != XXH64(file, digest_at, 0))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: wrong checksum of the header; the file is damaged",
                         path);
    if (header->sh_degree > 3)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte 28: SH degree %u is above 3", path,
                         header->sh_degree);
    if (!header->count || header->count > MAX_COUNT || header->input < header->count ||
        header->count / COUNT_PER_BYTE >= container->size)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte 32: %llu primitives do not fit into the file",
                         path, (unsigned long long)header->count);
    return SGS_STATUS_OK;
}

static sgs_status read_table(sgsi_container *container)
{
    const char *path = container->path;
    size_t at = HEADER_BYTES + container->count * ENTRY_BYTES + DIGEST_BYTES;
    for (size_t s = 0; s < container->count; ++s) {
        const uint8_t *entry = container->file + HEADER_BYTES + s * ENTRY_BYTES;
        sgsi_container_section *section = &container->sections[s];
        *section = (sgsi_container_section){.deflated = get(entry + 16, 4) == 1, .at = at};
        memcpy(section->name, entry, SGSI_CONTAINER_NAME);
        for (const char *c = section->name; *c; ++c)
            if (*c < ' ' || *c > '~')
                return sgsi_fail(SGS_STATUS_FORMAT, "%s: section %zu has an invalid name", path, s);
        const uint64_t stored = get(entry + 24, 8), bytes = get(entry + 32, 8);
        if (get(entry + 16, 4) > 1)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' has unknown coding %u", path,
                             section->name, (unsigned)get(entry + 16, 4));
        if (stored > container->size - at)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' ends after the end of the file",
                             path, section->name);
        // Deflate expands at most 1032 times.
        if (section->deflated ? bytes / 1032 > stored : bytes != stored)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: section '%s' of %llu bytes cannot contain %llu", path,
                             section->name, (unsigned long long)stored, (unsigned long long)bytes);
        if (get(entry + 40, 8) != XXH64(container->file + at, stored, 0))
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: wrong checksum of section '%s'; the file is damaged", path,
                             section->name);
        for (size_t k = 0; k < s; ++k)
            if (!strcmp(container->sections[k].name, section->name))
                return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' occurs twice", path,
                                 section->name);
        section->stored = stored;
        section->bytes = bytes;
        section->taken = !strcmp(section->name, padding_name);
        at += stored;
    }
    if (at != container->size)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %zu bytes after the last section", path,
                         container->size - at);
    return SGS_STATUS_OK;
}

sgs_status sgsi_container_open(const char *path, sgsi_container *container)
{
    *container = (sgsi_container){.path = path};
    sgs_status status = sgsi_file_read(path, 0, &container->file, &container->size);
    if (!status)
        status = read_header(container);
    if (!status)
        status = read_table(container);
    if (status)
        sgsi_container_close(container);
    return status;
}

void sgsi_container_close(sgsi_container *container)
{
    for (size_t s = 0; s < container->count && s < SGSI_CONTAINER_SECTIONS; ++s)
        sgsi_free(container->sections[s].data);
    sgsi_free(container->file);
    *container = (sgsi_container){0};
}

static sgsi_container_section *find(const sgsi_container *container, const char *name)
{
    for (size_t s = 0; s < container->count; ++s)
        if (!strcmp(container->sections[s].name, name))
            return (sgsi_container_section *)&container->sections[s];
    return NULL;
}

bool sgsi_container_has(const sgsi_container *container, const char *name)
{
    return find(container, name) != NULL;
}

// Inflates into a buffer that doubles only after the data has filled it.
static sgs_status inflate(const sgsi_container *container, sgsi_container_section *section)
{
    const uint8_t *stored = container->file + section->at;
    struct libdeflate_decompressor *decompressor = libdeflate_alloc_decompressor();
    enum libdeflate_result result = LIBDEFLATE_INSUFFICIENT_SPACE;
    size_t room = 2 * container->size, got = 0;
    bool memory = decompressor != NULL;
    for (; memory && result == LIBDEFLATE_INSUFFICIENT_SPACE; room *= 2) {
        if (room > section->bytes)
            room = section->bytes;
        sgsi_free(section->data);
        section->data = sgsi_alloc(room + 1, 1);
        memory = section->data != NULL;
        if (memory)
            result = libdeflate_deflate_decompress(decompressor, stored, section->stored,
                                                   section->data, room, &got);
        if (room == section->bytes)
            break;
    }
    libdeflate_free_decompressor(decompressor);
    if (memory && result == LIBDEFLATE_SUCCESS && got == section->bytes)
        return SGS_STATUS_OK;
    sgsi_free(section->data);
    section->data = NULL;
    if (!memory)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for section '%s'",
                         container->path, section->name);
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' does not inflate to %zu bytes",
                     container->path, section->name, section->bytes);
}

sgs_status sgsi_container_take(sgsi_container *container, const char *name, int64_t bytes,
                               const uint8_t **data, size_t *size)
{
    sgsi_container_section *section = find(container, name);
    if (!section)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' is missing", container->path, name);
    if (bytes >= 0 && section->bytes != (size_t)bytes)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' has %zu bytes instead of %lld",
                         container->path, name, section->bytes, (long long)bytes);
    section->taken = true;
    if (section->deflated && !section->data) {
        const sgs_status status = inflate(container, section);
        if (status)
            return status;
    }
    *data = section->deflated ? section->data : container->file + section->at;
    if (size)
        *size = section->bytes;
    return SGS_STATUS_OK;
}

sgs_status sgsi_container_finish(const sgsi_container *container)
{
    for (size_t s = 0; s < container->count; ++s)
        if (!container->sections[s].taken)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: unknown section '%s'", container->path,
                             container->sections[s].name);
    return SGS_STATUS_OK;
}
