// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What flat and deep EXR files share: OpenEXRCore's context over the library's own atomic file, the
// header, and the encoding of chunks by many threads. Knows no pixels.

#include <openexr.h>

#include "base/core.h"
#include "sparegs/image.h"

enum { SGSI_EXR_MAX_SIDE = 65536 };

typedef struct sgsi_exr_writer {
    sgsi_atomic_file file;
    exr_context_t context;
    const char *path; // borrowed
    int write_error;  // errno of the first failed write
} sgsi_exr_writer;

// A channel as the header lists it.
typedef struct sgsi_exr_column {
    const char *name;
    exr_pixel_type_t type;
} sgsi_exr_column;

// Opens the file and writes its header. Columns are sorted by name, as the format demands. On
// failure the error is told and nothing is left behind. The writer must not move afterwards.
// max_samples: per pixel, of deep files.
sgs_status sgsi_exr_open(sgsi_exr_writer *writer, const char *path, const sgs_exr_info *info,
                         exr_storage_t storage, exr_compression_t compression, int max_samples,
                         const sgsi_exr_column *columns, int column_count);

// Ends the file and puts it in its place if `result` is success; tells the error and leaves nothing
// behind otherwise.
sgs_status sgsi_exr_close(sgsi_exr_writer *writer, exr_result_t result);

// The error of a failed call of OpenEXR's as ours.
sgs_status sgsi_exr_tell(const sgsi_exr_writer *writer, exr_result_t result);

// Points a chunk's encoder at the pixels of its channels. `lines` are those
// of the chunk. Called in parallel.
typedef void (*sgsi_exr_fill_fn)(const void *context, exr_encode_pipeline_t *encoder, int y,
                                 int lines);

// Encodes and writes the chunks of an image of `height` lines.
exr_result_t sgsi_exr_write_lines(sgsi_exr_writer *writer, int height,
                                  sgs_exr_compression compression, sgsi_exr_fill_fn fill,
                                  const void *context);
