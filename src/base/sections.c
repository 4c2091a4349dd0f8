// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The file, little-endian:
//
//   "SPAREGS1" | version: u32 | reserved: u32 | version of the program, 16 bytes, padded with zeros
//   per section: name, 16 bytes, padded with zeros | bytes: u64 | content
//   name "end" | bytes: 0
//   XXH64 of everything before it: u64
//
// No content is used before the checksum is verified. The checksum detects accidents, not
// manipulation: every size is validated against the remaining bytes.

#include "base/sections.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "sparegs/output_file.h"
#include "sparegs/runtime.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "sections are stored in the byte order of memory");

static const char magic[8] = {'S', 'P', 'A', 'R', 'E', 'G', 'S', '1'};
static const char end_name[] = "end";
enum {
    VERSION = 4,
    HEADER_BYTES = 32,
    PROGRAM_AT = 16, // since version 4
    SECTION_HEADER_BYTES = SGSI_SECTION_NAME + 8,
    DIGEST_BYTES = 8,
    CHUNK_BYTES = 1 << 20
};

// ---- writing ----

static void write_bytes(sgsi_sections *sections, const void *data, size_t bytes)
{
    if (sections->status || !bytes)
        return;
    XXH64_update(sections->hash, data, bytes);
    errno = 0;
    if (fwrite(data, 1, bytes, sections->file.stream) != bytes)
        sections->status = sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", sections->path,
                                     errno ? strerror(errno) : "disk full?");
}

static void write_section_header(sgsi_sections *sections, const char *name, uint64_t bytes)
{
    char header[SECTION_HEADER_BYTES] = {0};
    memcpy(header, name, strnlen(name, SGSI_SECTION_NAME));
    memcpy(header + SGSI_SECTION_NAME, &bytes, sizeof bytes);
    write_bytes(sections, header, sizeof header);
}

void sgsi_sections_measure(sgsi_sections *sections)
{
    *sections = (sgsi_sections){.pass = SGSI_SECTIONS_MEASURE,
                                .path = "",
                                .measured = HEADER_BYTES + SECTION_HEADER_BYTES + DIGEST_BYTES};
}

sgs_status sgsi_sections_create(sgsi_sections *sections, const char *path)
{
    *sections = (sgsi_sections){.pass = SGSI_SECTIONS_WRITE, .path = path};
    const sgs_status status = sgs_output_file_open(&sections->file, path);
    if (status)
        return status;
    sections->hash = XXH64_createState();
    if (!sections->hash) {
        sgs_output_file_abort(&sections->file);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    }
    XXH64_reset(sections->hash, 0);
    char header[HEADER_BYTES] = {0};
    const uint32_t version = VERSION;
    memcpy(header, magic, sizeof magic);
    memcpy(header + sizeof magic, &version, sizeof version);
    memcpy(header + PROGRAM_AT, sgs_version(), strnlen(sgs_version(), HEADER_BYTES - PROGRAM_AT));
    write_bytes(sections, header, sizeof header);
    return SGS_STATUS_OK;
}

// The previous section must be complete; otherwise the list of the caller is wrong.
static void check_filled(sgsi_sections *sections)
{
    if (!sections->status && sections->left)
        sections->status = sgsi_fail(SGS_STATUS_LIMIT, "%s: a section lacks %zu bytes",
                                     sections->path, sections->left);
}

sgs_status sgsi_sections_commit(sgsi_sections *sections)
{
    check_filled(sections);
    write_section_header(sections, end_name, 0);
    const uint64_t digest = XXH64_digest(sections->hash);
    write_bytes(sections, &digest, sizeof digest);
    XXH64_freeState(sections->hash);
    sections->hash = NULL;
    if (!sections->status)
        return sgs_output_file_commit(&sections->file);
    sgs_output_file_abort(&sections->file);
    return sections->status;
}

// ---- reading ----

static sgs_status fail_format(const sgsi_sections *sections, size_t at, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte %zu: %s; the file is truncated or corrupt",
                     sections->path, at, what);
}

static sgs_status read_at(const sgsi_sections *sections, size_t at, void *data, size_t bytes)
{
    for (size_t done = 0; done < bytes;) {
        const ssize_t got =
            pread(fileno(sections->input), (char *)data + done, bytes - done, (off_t)(at + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return sgsi_fail(SGS_STATUS_IO, "%s: byte %zu: read error: %s", sections->path,
                             at + done, got ? strerror(errno) : "the file was truncated");
        done += (size_t)got;
    }
    return SGS_STATUS_OK;
}

static sgsi_section *look_up(sgsi_sections *sections, const char *name)
{
    for (size_t i = 0; i < sections->count; ++i)
        if (!strcmp(sections->table[i].name, name))
            return &sections->table[i];
    return NULL;
}

// Walks the section headers of bytes HEADER_BYTES to size of the file.
static sgs_status read_table(sgsi_sections *sections, size_t size)
{
    for (size_t at = HEADER_BYTES;;) {
        if (size - at < SECTION_HEADER_BYTES)
            return fail_format(sections, at, "end of the section list is missing");
        char header[SECTION_HEADER_BYTES];
        const sgs_status status = read_at(sections, at, header, sizeof header);
        if (status)
            return status;
        sgsi_section section = {.at = at + SECTION_HEADER_BYTES};
        memcpy(section.name, header, SGSI_SECTION_NAME);
        uint64_t bytes;
        memcpy(&bytes, header + SGSI_SECTION_NAME, sizeof bytes);
        if (!strcmp(section.name, end_name))
            return bytes == 0 && section.at == size
                       ? SGS_STATUS_OK
                       : fail_format(sections, at, "data after the end");
        if (bytes > size - section.at)
            return fail_format(sections, at, "section exceeds the file");
        if (sections->count == SGSI_SECTIONS_MAX)
            return fail_format(sections, at, "too many sections");
        if (look_up(sections, section.name))
            return fail_format(sections, at, "duplicate section");
        section.bytes = (size_t)bytes;
        sections->table[sections->count++] = section;
        at = section.at + section.bytes;
    }
}

// Files before version 4 do not name the program; all were written by sparegs 0.1.0.
static sgs_status fail_version(const sgsi_sections *sections, const char *header, uint32_t version)
{
    enum { FIRST_NAMED = 4 };
    char program[HEADER_BYTES - PROGRAM_AT + 1] = "0.1.0";
    if (version >= FIRST_NAMED)
        memcpy(program, header + PROGRAM_AT, HEADER_BYTES - PROGRAM_AT);
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: written by sparegs %s in format %u; this program reads format %d: resume "
                     "with the program that wrote it, or start a new run",
                     sections->path, program, version, VERSION);
}

// Compares the first `size` bytes with the checksum after them.
static sgs_status prove_checksum(const sgsi_sections *sections, size_t size)
{
    uint8_t *chunk = sgsi_alloc(CHUNK_BYTES, 1);
    XXH64_state_t *hash = XXH64_createState();
    sgs_status status = SGS_STATUS_OK;
    if (!chunk || !hash)
        status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", sections->path);
    else
        XXH64_reset(hash, 0);
    for (size_t at = 0; at < size && !status;) {
        const size_t bytes = size - at < CHUNK_BYTES ? size - at : CHUNK_BYTES;
        status = read_at(sections, at, chunk, bytes);
        if (!status)
            XXH64_update(hash, chunk, bytes);
        at += bytes;
    }
    uint64_t digest;
    if (!status)
        status = read_at(sections, size, &digest, sizeof digest);
    if (!status && XXH64_digest(hash) != digest)
        status =
            sgsi_fail(SGS_STATUS_FORMAT, "%s: checksum mismatch; the file is truncated or corrupt",
                      sections->path);
    XXH64_freeState(hash);
    sgsi_free(chunk);
    return status;
}

static sgs_status prove(sgsi_sections *sections, size_t size)
{
    char header[HEADER_BYTES] = {0};
    uint32_t version;
    const bool fits = size >= HEADER_BYTES + SECTION_HEADER_BYTES + DIGEST_BYTES;
    sgs_status status = fits ? read_at(sections, 0, header, sizeof header) : SGS_STATUS_OK;
    if (status)
        return status;
    if (memcmp(header, magic, sizeof magic))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: is not a checkpoint", sections->path);
    memcpy(&version, header + sizeof magic, sizeof version);
    if (version != VERSION)
        return fail_version(sections, header, version);
    status = prove_checksum(sections, size - DIGEST_BYTES);
    return status ? status : read_table(sections, size - DIGEST_BYTES);
}

sgs_status sgsi_sections_open(sgsi_sections *sections, const char *path)
{
    *sections = (sgsi_sections){.pass = SGSI_SECTIONS_CHECK, .path = path};
    size_t size;
    sgs_status status = sgsi_file_open(path, &sections->input, &size);
    if (status)
        return status;
    status = prove(sections, size);
    if (status)
        sgsi_sections_close(sections);
    return status;
}

void sgsi_sections_close(sgsi_sections *sections)
{
    for (size_t i = 0; i < sections->count; ++i)
        sgsi_free(sections->table[i].content);
    sections->count = 0;
    fclose(sections->input);
    sections->input = NULL;
}

static sgs_status fail_missing(const sgsi_sections *sections, const char *name)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' is missing", sections->path, name);
}

sgs_status sgsi_sections_find(sgsi_sections *sections, const char *name, const uint8_t **content,
                              size_t *bytes)
{
    sgsi_section *section = look_up(sections, name);
    if (!section)
        return fail_missing(sections, name);
    section->known = true;
    if (!section->content) {
        uint8_t *block = sgsi_alloc(section->bytes + 1, 1);
        if (!block)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for section '%s'",
                             sections->path, name);
        const sgs_status status = read_at(sections, section->at, block, section->bytes);
        if (status) {
            sgsi_free(block);
            return status;
        }
        section->content = block;
    }
    *content = section->content;
    *bytes = section->bytes;
    return SGS_STATUS_OK;
}

size_t sgsi_sections_size(sgsi_sections *sections, const char *name)
{
    const sgsi_section *section = look_up(sections, name);
    return section ? section->bytes : 0;
}

sgs_status sgsi_sections_copy(sgsi_sections *sections, const char *name, size_t from, void *data,
                              size_t bytes)
{
    const sgsi_section *section = look_up(sections, name);
    if (!section)
        return fail_missing(sections, name);
    if (from > section->bytes || bytes > section->bytes - from)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' has %zu bytes instead of %zu",
                         sections->path, name, section->bytes, from + bytes);
    return read_at(sections, section->at + from, data, bytes);
}

sgs_status sgsi_sections_checked(sgsi_sections *sections)
{
    for (size_t i = 0; i < sections->count && !sections->status; ++i)
        if (!sections->table[i].known)
            sections->status =
                sgsi_fail(SGS_STATUS_FORMAT,
                          "%s: unknown section '%s'; resume with the version that wrote it",
                          sections->path, sections->table[i].name);
    return sections->status;
}

// ---- the visit ----

void sgsi_sections_begin(sgsi_sections *sections, const char *name, size_t bytes)
{
    check_filled(sections);
    sections->left = bytes;
    if (sections->status)
        return;
    if (sections->pass == SGSI_SECTIONS_MEASURE) {
        sections->measured += SECTION_HEADER_BYTES + bytes;
        return;
    }
    if (sections->pass == SGSI_SECTIONS_WRITE) {
        write_section_header(sections, name, bytes);
        return;
    }
    sgsi_section *section = look_up(sections, name);
    if (!section) {
        sections->status = fail_missing(sections, name);
        return;
    }
    section->known = true;
    sections->next = section->at;
    if (section->bytes != bytes)
        sections->status =
            sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' has %zu bytes instead of %zu",
                      sections->path, name, section->bytes, bytes);
}

void sgsi_sections_piece(sgsi_sections *sections, void *data, size_t bytes)
{
    if (sections->status || !bytes)
        return;
    if (bytes > sections->left) { // the list of the caller is wrong
        sections->status =
            sgsi_fail(SGS_STATUS_LIMIT, "%s: a piece exceeds its section", sections->path);
        return;
    }
    sections->left -= bytes;
    if (sections->pass == SGSI_SECTIONS_WRITE)
        write_bytes(sections, data, bytes);
    if (sections->pass == SGSI_SECTIONS_READ) {
        sections->status = read_at(sections, sections->next, data, bytes);
        sections->next += bytes;
    }
}
