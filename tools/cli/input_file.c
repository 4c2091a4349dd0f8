// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/input_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

FILE *open_input(const char *path, const char **reason)
{
    static const char devices[] = "/dev/";
    const bool device = !strncmp(path, devices, sizeof devices - 1);
    const int descriptor = open(path, O_RDONLY | O_CLOEXEC | (device ? 0 : O_NONBLOCK));
    struct stat info;
    const bool known = descriptor >= 0 && !fstat(descriptor, &info);
    const bool accepted = known && (device || S_ISREG(info.st_mode));
    FILE *stream = accepted ? fdopen(descriptor, "rb") : NULL;
    if (stream)
        return stream;
    const int code = !known || accepted ? errno : S_ISDIR(info.st_mode) ? EISDIR : EINVAL;
    if (descriptor >= 0)
        close(descriptor);
    if (reason)
        *reason = code == EINVAL ? "is not a regular file" : strerror(code);
    errno = code;
    return NULL;
}

bool name_has_ending(const char *name, const char *endings)
{
    const char *dot = strrchr(name, '.');
    const size_t length = dot ? strlen(dot) : 0;
    for (const char *at = endings; dot && at; at = strchr(at, '|')) {
        at += *at == '|';
        if (strcspn(at, "|") == length && !strncasecmp(at, dot, length))
            return true;
    }
    return false;
}
