// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/lock_file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

#include "cli/progress.h"
#include "processes/interrupt.h"

static lock_result take(const char *path, int flags, int operation, int *descriptor)
{
    *descriptor = open(path, flags | O_CLOEXEC, 0666);
    if (*descriptor < 0)
        return LOCK_FAILED;
    int failed;
    do
        failed = flock(*descriptor, operation);
    while (failed && errno == EINTR);
    if (!failed)
        return LOCK_TAKEN;
    const int code = errno;
    close(*descriptor);
    *descriptor = -1;
    errno = code;
    return code == EWOULDBLOCK || code == EACCES ? LOCK_BUSY : LOCK_FAILED;
}

lock_result lock_file_take(const char *path, int *descriptor)
{
    return take(path, O_RDWR | O_CREAT, LOCK_EX | LOCK_NB, descriptor);
}

lock_result lock_file_wait(const char *path, int *descriptor)
{
    lock_result result = lock_file_take(path, descriptor);
    while (result == LOCK_BUSY && !interrupt_signal()) {
        nanosleep(&(struct timespec){.tv_nsec = 50000000}, NULL);
        result = lock_file_take(path, descriptor);
    }
    return result;
}

bool lock_file_is_busy(const char *path)
{
    int descriptor;
    const lock_result result = take(path, O_RDWR, LOCK_EX | LOCK_NB, &descriptor);
    if (descriptor >= 0)
        close(descriptor);
    return result == LOCK_BUSY;
}

lock_result lock_folder_take(const char *path, int *descriptor)
{
    return take(path, O_RDONLY | O_DIRECTORY, LOCK_EX | LOCK_NB, descriptor);
}

bool lock_admits(const char *folder, lock_result result, int code)
{
    if (result == LOCK_BUSY)
        fail_run("%s: in use by another run; wait until it ends or choose another folder", folder);
    else if (result == LOCK_FAILED)
        print_warning("%s: cannot lock the folder against a second run: %s", folder,
                      strerror(code));
    return result != LOCK_BUSY;
}
