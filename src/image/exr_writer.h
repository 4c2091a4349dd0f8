// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Shared by flat and deep EXR files: OpenEXRCore's context on top of an atomic file, the header,
// and the parallel encoding of chunks. Independent of pixel contents.

#include <openexr.h>

#include "base/core.h"
#include "sparegs/image.h"
#include "sparegs/output_file.h"

// Level of ZIP for floats. They barely shrink more at higher ones: 0.776 of their size at level 1,
// 0.765 at 6, over all AOVs of a trained model.
enum { SGSI_EXR_MAX_SIDE = 65536, SGSI_EXR_FLOAT_LEVEL = 1 };

// A context with the library's allocator, which keeps messages of OpenEXR instead of printing them.
exr_context_initializer_t sgsi_exr_setup(void *user);

typedef struct sgsi_exr_writer {
    sgs_output_file file;
    exr_context_t context;
    const char *path; // borrowed
    int write_error;  // errno of the first failed write
    int first_line;   // y of the first line of the data window
} sgsi_exr_writer;

// A channel in the header.
typedef struct sgsi_exr_column {
    const char *name;
    exr_pixel_type_t type;
} sgsi_exr_column;

// Fails with INVALID_ARGUMENT if the sizes, the overscan, the frame rate or the intrinsics are out
// of range.
sgs_status sgsi_exr_check_info(const char *path, const sgs_exr_info *info);

// Opens the file and writes its header. Columns are sorted by name, as the format requires. On
// failure sets the error and removes the file. The writer must not move in memory afterwards.
// max_samples: per pixel, deep files only.
sgs_status sgsi_exr_open(sgsi_exr_writer *writer, const char *path, const sgs_exr_info *info,
                         exr_storage_t storage, exr_compression_t compression, int max_samples,
                         const sgsi_exr_column *columns, int column_count);

// Finishes the file and moves it into place if `result` is success. Otherwise sets the error and
// removes the file.
sgs_status sgsi_exr_close(sgsi_exr_writer *writer, exr_result_t result);

// Converts a result of OpenEXR to a status and sets the error.
sgs_status sgsi_exr_check(const sgsi_exr_writer *writer, exr_result_t result);

// Sets the encoder's pointers to the pixels of a chunk of `lines` lines. Called in parallel.
typedef void (*sgsi_exr_fill_fn)(const void *context, exr_encode_pipeline_t *encoder, int y,
                                 int lines);

// Encodes and writes the chunks of an image of `height` lines.
exr_result_t sgsi_exr_write_lines(sgsi_exr_writer *writer, int height,
                                  sgs_exr_compression compression, sgsi_exr_fill_fn fill,
                                  const void *context);
