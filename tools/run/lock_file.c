// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/lock_file.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

lock_result lock_file_take(const char *path, int *file)
{
    *file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (*file < 0)
        return LOCK_FAILED;
    if (!flock(*file, LOCK_EX | LOCK_NB))
        return LOCK_TAKEN;
    const int code = errno;
    close(*file);
    *file = -1;
    errno = code;
    return code == EWOULDBLOCK || code == EACCES ? LOCK_BUSY : LOCK_FAILED;
}
