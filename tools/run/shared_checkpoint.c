// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/shared_checkpoint.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "cli/rank_group.h"

// The bytes of a file from malloc; false after printing the error.
static bool read_bytes(const char *path, void **bytes, size_t *size)
{
    FILE *file = fopen(path, "rb");
    long length = -1;
    if (file && !fseek(file, 0, SEEK_END))
        length = ftell(file);
    *bytes = length >= 0 ? malloc((size_t)length + 1) : NULL;
    *size = length >= 0 ? (size_t)length : 0;
    bool done = *bytes && !fseek(file, 0, SEEK_SET);
    done = done && fread(*bytes, 1, *size, file) == *size;
    if (file)
        fclose(file);
    if (!done)
        fail_run("%s: cannot be read to send it to the other ranks", path);
    return done;
}

// Loads a checkpoint from memory, through a file that has no name.
static bool load_bytes(sgs_trainer *trainer, const unsigned char *bytes, size_t size)
{
    const int file = memfd_create("checkpoint", MFD_CLOEXEC);
    bool done = file >= 0;
    for (size_t at = 0; at < size && done;) {
        const ssize_t written = write(file, bytes + at, size - at);
        done = written > 0;
        at += done ? (size_t)written : 0;
    }
    if (!done)
        fail_run("no memory for a checkpoint of %zu bytes", size);
    char path[64];
    snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    if (done && sgs_trainer_load_checkpoint(trainer, path)) {
        fail_library();
        done = false;
    }
    if (file >= 0)
        close(file);
    return done;
}

bool shared_checkpoint_load(sgs_trainer *trainer, const char *path)
{
    void *bytes = NULL;
    size_t size = 0;
    if (!group_ranks())
        return true;
    const bool sends = group_leads() && path;
    const bool read = !sends || read_bytes(path, &bytes, &size);
    if (!group_all(read)) {
        free(bytes);
        return false;
    }
    bool done = !sgs_ranks_broadcast(group_ranks(), SGS_STATUS_OK, &bytes, &size);
    if (done && !group_leads() && size)
        done = load_bytes(trainer, bytes, size);
    free(bytes);
    return group_all(done);
}
