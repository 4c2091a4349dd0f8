// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One record per update, in host byte order (little-endian): "SGRG", iteration, grid, number of
// regions (4 bytes each), corner and voxel size of the grid (6 doubles), then the regions as
// sgs_region.

#include "run/region_file.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/output.h"
#include "cli/progress.h"

typedef struct record_header {
    char magic[4];
    uint32_t iteration, grid, count;
    double low[3], voxel_size[3];
} record_header;

static const char magic[4] = {'S', 'G', 'R', 'G'};

static char *file_of(const char *folder)
{
    return format_text("%s/regions.bin", folder);
}

// True if all but the number of regions is possible.
static bool is_header(const record_header *header)
{
    return !memcmp(header->magic, magic, sizeof magic) && header->grid >= 2 &&
           header->grid <= 256 && header->iteration > 0 && header->iteration <= INT_MAX;
}

static long size_of(FILE *stream)
{
    struct stat info;
    return fstat(fileno(stream), &info) ? 0 : (long)info.st_size;
}

// Reads the next header. False at the end of the file or if it is invalid.
static bool read_header(FILE *stream, record_header *header)
{
    *header = (record_header){0};
    return fread(header, sizeof *header, 1, stream) == 1 && is_header(header);
}

// True if the regions after the header exceed the file.
static bool exceeds(FILE *stream, const record_header *header)
{
    const long left = size_of(stream) - ftell(stream);
    return left < 0 || header->count > (unsigned long)left / sizeof(sgs_region);
}

static long fail_damaged(const char *path, long offset)
{
    fail_run("%s: byte %ld: invalid region record; move the file away to continue without the "
             "earlier records",
             path, offset);
    return -1;
}

// True if a record follows anywhere after the header at `offset`: that record is not the last one,
// although its regions exceed the file.
static bool record_follows(FILE *stream, long offset, uint32_t iteration)
{
    record_header header;
    char last[sizeof magic] = {0};
    if (fseek(stream, offset + (long)sizeof header, SEEK_SET))
        return false;
    for (int byte; (byte = fgetc(stream)) != EOF;) {
        memmove(last, last + 1, sizeof last - 1);
        last[sizeof last - 1] = (char)byte;
        if (memcmp(last, magic, sizeof magic))
            continue;
        const long after = ftell(stream);
        if (fseek(stream, after - (long)sizeof magic, SEEK_SET) ||
            fread(&header, sizeof header, 1, stream) != 1)
            return false;
        if (is_header(&header) && header.iteration >= iteration)
            return true;
        if (fseek(stream, after, SEEK_SET))
            return false;
    }
    return false;
}

// True if the record is the last one, and a process that was killed while it appended wrote only a
// part of it. The position is the end of the header, and remains there.
static bool is_cut(FILE *stream, const record_header *header)
{
    const long at = ftell(stream);
    if (!exceeds(stream, header))
        return false;
    const bool cut = !record_follows(stream, at - (long)sizeof *header, header->iteration);
    return !fseek(stream, at, SEEK_SET) && cut;
}

// The end of the records up to `iteration`, or -1 after printing the error. A process that was
// killed while it appended leaves the beginning of a record at the end of the file. Any other
// invalid or unordered record is damage: to cut there would discard the valid ones after it.
static long end_of_records(const char *path, FILE *stream, int iteration)
{
    const long size = size_of(stream), record = (long)sizeof(record_header);
    long at = 0, keep = -1;
    uint32_t last = 0;
    while (size - at >= record) {
        record_header header;
        if (fseek(stream, at, SEEK_SET) || fread(&header, sizeof header, 1, stream) != 1) {
            fail_run("%s: byte %ld: cannot be read: %s", path, at, strerror(errno));
            return -1;
        }
        const bool wanted = header.iteration <= (uint32_t)iteration;
        if (keep >= 0 && !is_header(&header))
            break;
        if (!is_header(&header) || (wanted && header.iteration < last))
            return fail_damaged(path, at);
        if (!wanted && keep < 0)
            keep = at;
        if (header.count > (unsigned long)(size - at - record) / sizeof(sgs_region)) {
            if (wanted && record_follows(stream, at, header.iteration))
                return fail_damaged(path, at);
            break;
        }
        last = header.iteration;
        at += record + (long)(header.count * sizeof(sgs_region));
    }
    return keep >= 0 ? keep : at;
}

// True with a stream, or with NULL if the file does not exist. False after printing the error.
static bool open_records(const char *path, FILE **stream)
{
    const char *reason = NULL;
    *stream = open_input(path, &reason);
    if (*stream || errno == ENOENT)
        return true;
    fail_run("%s: cannot be read: %s", path, reason);
    return false;
}

bool region_file_cut(const char *folder, int iteration)
{
    char *path = file_of(folder);
    FILE *stream;
    bool done = open_records(path, &stream);
    if (stream) {
        const long keep = iteration > 0 ? end_of_records(path, stream, iteration) : 0;
        done = keep >= 0 && !truncate(path, keep);
        if (keep >= 0 && !done)
            fail_run("%s: cannot be truncated: %s", path, strerror(errno));
        fclose(stream);
    }
    free(path);
    return done;
}

bool region_file_append(const char *folder, const sgs_regions *regions)
{
    char *path = file_of(folder);
    record_header header = {.iteration = (uint32_t)regions->iteration,
                            .grid = (uint32_t)regions->grid,
                            .count = (uint32_t)regions->count};
    memcpy(header.magic, magic, sizeof magic);
    memcpy(header.low, regions->low, sizeof header.low);
    memcpy(header.voxel_size, regions->voxel_size, sizeof header.voxel_size);
    FILE *stream = fopen(path, "ab");
    const bool opened = stream != NULL;
    const long before = opened ? size_of(stream) : 0;
    bool written = stream && fwrite(&header, sizeof header, 1, stream) == 1 &&
                   fwrite(regions->regions, sizeof *regions->regions, regions->count, stream) ==
                       regions->count;
    if (stream && fclose(stream))
        written = false;
    if (!written)
        print_warning("%s: an update was not recorded: %s", path,
                      errno ? strerror(errno) : "disk full?");
    if (!written && opened && truncate(path, before)) // a part of it would hide later updates
        print_warning("%s: cannot be truncated to %ld bytes: %s", path, before, strerror(errno));
    free(path);
    return written;
}

bool region_history_read(const char *folder, region_history *history)
{
    *history = (region_history){0};
    char *path = file_of(folder);
    FILE *stream;
    bool complete = open_records(path, &stream);
    record_header header;
    while (stream && read_header(stream, &header) && !exceeds(stream, &header)) {
        sgs_regions *longer = realloc(history->updates, (history->count + 1) * sizeof *longer);
        sgs_region *list = malloc((header.count ? header.count : 1) * sizeof *list);
        history->updates = longer ? longer : history->updates;
        if (!longer || !list || fread(list, sizeof *list, header.count, stream) != header.count) {
            free(list);
            complete = false;
            fail_run("%s: update %zu cannot be read", path, history->count + 1);
            break;
        }
        sgs_regions *update = &history->updates[history->count++];
        *update = (sgs_regions){.iteration = (int)header.iteration,
                                .grid = (int)header.grid,
                                .count = header.count,
                                .regions = list};
        memcpy(update->low, header.low, sizeof header.low);
        memcpy(update->voxel_size, header.voxel_size, sizeof header.voxel_size);
    }
    if (stream && complete && ftell(stream) < size_of(stream) && !feof(stream) &&
        !(is_header(&header) && is_cut(stream, &header))) {
        fail_run("%s: byte %ld: invalid region record; train again", path, ftell(stream));
        complete = false;
    }
    if (stream)
        fclose(stream);
    free(path);
    if (!complete)
        region_history_free(history);
    return complete;
}

void region_history_free(region_history *history)
{
    for (size_t i = 0; i < history->count; ++i)
        free((void *)history->updates[i].regions);
    free(history->updates);
    *history = (region_history){0};
}

uint32_t region_voxel(const sgs_regions *update, const double point[3], bool *inside)
{
    const uint32_t grid = (uint32_t)update->grid;
    bool held = true;
    uint32_t voxel = 0;
    for (int k = 2; k >= 0; --k) {
        const double at = floor((point[k] - update->low[k]) / update->voxel_size[k]);
        held = held && at >= 0 && at < grid;
        voxel = voxel * grid + (uint32_t)fmin(fmax(at, 0), grid - 1);
    }
    if (inside)
        *inside = held;
    return voxel;
}

static int compare_voxels(const void *key, const void *region)
{
    const uint32_t a = *(const uint32_t *)key, b = ((const sgs_region *)region)->voxel;
    return (a > b) - (a < b);
}

const sgs_region *region_find(const sgs_regions *update, uint32_t voxel)
{
    return update->count ? bsearch(&voxel, update->regions, update->count, sizeof *update->regions,
                                   compare_voxels)
                         : NULL;
}
