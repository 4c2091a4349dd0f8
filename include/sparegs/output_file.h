// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Writes files atomically: a reader sees the old file or the new one, and a full disk or a killed
// process leaves the old one intact.
//
// Threads: all functions may be called from any thread at any time. Threads and processes may write
// the same path at the same time: the last commit wins.

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// A file while it is written as "TARGET.tmp.NUMBER". NUMBER consists of the process id and six
// digits that count the files of the process. Write to `stream`; the strings are read-only.
typedef struct sgs_output_file {
    FILE *stream;
    char *path, *target, *temporary; // target: path, or the file that this symbolic link points to
} sgs_output_file;

// Fails with IO (the temporary file cannot be created; `path` is a folder, a device, a pipe, or a
// symbolic link that leads nowhere) or OUT_OF_MEMORY; the file then needs neither commit nor abort.
SGS_API sgs_status sgs_output_file_open(sgs_output_file *file, const char *path);
// Flushes the file to disk and renames it to `target`. After a write error it removes the temporary
// file and fails with IO.
SGS_API sgs_status sgs_output_file_commit(sgs_output_file *file);
// Removes the temporary file; no effect after commit or a failed open.
SGS_API void sgs_output_file_abort(sgs_output_file *file);

// Writes a whole file. bytes [size]. Fails with IO or OUT_OF_MEMORY.
SGS_API sgs_status sgs_output_file_write(const char *path, const uint8_t *bytes, size_t size);

#ifdef __cplusplus
}
#endif
