// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/lock_file.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

static lock_result take(const char *path, int flags, int *descriptor)
{
    *descriptor = open(path, flags | O_CLOEXEC, 0666);
    if (*descriptor < 0)
        return LOCK_FAILED;
    if (!flock(*descriptor, LOCK_EX | LOCK_NB))
        return LOCK_TAKEN;
    const int code = errno;
    close(*descriptor);
    *descriptor = -1;
    errno = code;
    return code == EWOULDBLOCK || code == EACCES ? LOCK_BUSY : LOCK_FAILED;
}

lock_result lock_file_take(const char *path, int *descriptor)
{
    return take(path, O_RDWR | O_CREAT, descriptor);
}

lock_result lock_folder_take(const char *path, int *descriptor)
{
    return take(path, O_RDONLY | O_DIRECTORY, descriptor);
}
