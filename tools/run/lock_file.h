// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Locks against other processes, also those of other machines that share the file system. NFS and
// Lustre pass on only locks of regular files that are open for writing: a locked folder excludes
// just the processes of the same machine.

#include <stdbool.h>

typedef enum lock_result {
    LOCK_TAKEN, // until the descriptor is closed or the process ends
    LOCK_BUSY,  // another process has it
    LOCK_FAILED // with errno: the path cannot be opened, or the file system has no locks
} lock_result;

// Creates the file if necessary; it stays, empty. *descriptor is -1 unless the lock is taken.
lock_result lock_file_take(const char *path, int *descriptor);

// The same, but waits while another process has the lock, until a request to stop: then LOCK_BUSY.
lock_result lock_file_wait(const char *path, int *descriptor);

// True if another process has the lock of the file. Does not create the file.
bool lock_file_is_busy(const char *path);

// As lock_file_take for a folder that exists. Leaves no file.
lock_result lock_folder_take(const char *path, int *descriptor);

// True unless another process has the lock of a folder, which is an error. A failure, with errno in
// `code`, is only a warning. Prints both.
bool lock_admits(const char *folder, lock_result result, int code);
