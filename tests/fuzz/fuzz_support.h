// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Shared by the fuzz targets. The readers take paths, so each input becomes a file in its own
// folder, in memory if the system has such a place. A failed check aborts the process; the fuzzer
// keeps the input.

#include <fcntl.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define FUZZ_REQUIRE(condition)                                                                    \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "%s:%d: broken: %s; last error: %s\n", __FILE__, __LINE__, #condition, \
                    sgs_last_error());                                                             \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

static char fuzz_folder[64];

static inline void fuzz_folder_remove(void)
{
    char command[96];
    static const char *const names[] = {
        "cameras.bin", "images.bin",   "points3D.bin", "cameras.txt",
        "images.txt",  "points3D.txt", "input",        "again",
        "points.ply",  "input.splat",  "input.spz",    "input.ksplat",
        "input.usda",  "input.glb",    "input.sog",    "input.compressed.ply"};
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        snprintf(command, sizeof command, "%s/%s", fuzz_folder, names[i]);
        unlink(command);
    }
    rmdir(fuzz_folder);
}

// Path of a file in the folder; valid until the fourth call after this one.
static inline const char *fuzz_path(const char *name)
{
    static char paths[4][96];
    static unsigned next;
    if (!*fuzz_folder) {
        snprintf(fuzz_folder, sizeof fuzz_folder, "%s/sparegs_fuzz_XXXXXX",
                 access("/dev/shm", W_OK) ? "/tmp" : "/dev/shm");
        FUZZ_REQUIRE(mkdtemp(fuzz_folder));
        atexit(fuzz_folder_remove);
    }
    char *path = paths[next++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", fuzz_folder, name);
    return path;
}

static inline const char *fuzz_file(const char *name, const void *data, size_t size)
{
    const char *path = fuzz_path(name);
    const int file = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    FUZZ_REQUIRE(file >= 0 && (!size || write(file, data, size) == (ssize_t)size) && !close(file));
    return path;
}

// Asserts that an error is one line that names the file.
static inline void fuzz_check_refusal(const char *path)
{
    FUZZ_REQUIRE(strstr(sgs_last_error(), path) && !strchr(sgs_last_error(), '\n'));
}

static inline void fuzz_check_finite(const float *values, size_t count)
{
    for (size_t i = 0; i < count; ++i)
        FUZZ_REQUIRE(isfinite(values[i]));
}
