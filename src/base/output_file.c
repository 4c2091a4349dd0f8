// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "sparegs/output_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core.h"

// The file that an output to `path` replaces: where `path` is a symbolic link, the file it points
// to.
static sgs_status find_target(const char *path, char **target)
{
    struct stat info;
    const bool is_link = !lstat(path, &info) && S_ISLNK(info.st_mode);
    char *real = is_link ? realpath(path, NULL) : NULL;
    if (is_link && !real)
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: is a symbolic link that cannot be followed: %s; remove it or choose "
                         "another name",
                         path, strerror(errno));
    *target = sgsi_strdup(is_link ? real : path);
    free(real);
    return SGS_STATUS_OK;
}

// True for "", and for a path that ends in '/', "." or "..".
static bool names_folder(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    return !*name || !strcmp(name, ".") || !strcmp(name, "..");
}

sgs_status sgs_output_file_open(sgs_output_file *file, const char *path)
{
    struct stat info;
    *file = (sgs_output_file){0};
    const bool exists = !stat(path, &info);
    if ((exists && S_ISDIR(info.st_mode)) || names_folder(path))
        return sgsi_fail(SGS_STATUS_IO, "%s: is %s folder; choose the name of a file", path,
                         exists ? "a" : "the name of a");
    if (exists && !S_ISREG(info.st_mode))
        return sgsi_fail(SGS_STATUS_IO, "%s: is a device or a pipe; choose the name of a file",
                         path);
    sgs_status status = find_target(path, &file->target);
    if (status)
        return status;
    int descriptor = -1;
    file->path = sgsi_strdup(path);
    if (!file->path || !file->target)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    else
        status = sgsi_temporary_create(file->target, path, &file->temporary, &descriptor);
    file->stream = status ? NULL : fdopen(descriptor, "wb");
    if (!status && !file->stream) {
        status = sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", path, strerror(errno));
        close(descriptor);
    }
    if (status)
        sgs_output_file_abort(file);
    return status;
}

static void sync_folder_of(const char *path)
{
    char folder[4096] = ".";
    const char *slash = strrchr(path, '/');
    if (slash)
        snprintf(folder, sizeof folder, "%.*s", (int)(slash - path + (slash == path)), path);
    sgsi_folder_sync(folder);
}

// Why an earlier write to the temporary file failed: errno of a further one, 0 if that succeeds.
static int write_fault(FILE *stream)
{
    static const char block[4096];
    errno = 0;
    for (int k = 0; k < 2; ++k) // the first one may fill the last block of a full disk
        if (write(fileno(stream), block, sizeof block) < 0)
            return errno;
    return 0;
}

sgs_status sgs_output_file_commit(sgs_output_file *file)
{
    errno = 0;
    const bool written =
        !fflush(file->stream) && !ferror(file->stream) && !fsync(fileno(file->stream));
    int code = written || errno ? errno : write_fault(file->stream);
    const bool closed = !fclose(file->stream);
    file->stream = NULL;
    if (written && closed && !rename(file->temporary, file->target)) {
        sync_folder_of(file->target);
        sgsi_free(file->path);
        sgsi_free(file->target);
        sgsi_free(file->temporary);
        *file = (sgs_output_file){0};
        return SGS_STATUS_OK;
    }
    if (written)
        code = errno;
    const sgs_status status = sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", file->path,
                                        code ? strerror(code) : "disk full?");
    sgs_output_file_abort(file);
    return status;
}

void sgs_output_file_abort(sgs_output_file *file)
{
    if (file->stream)
        fclose(file->stream);
    if (file->temporary)
        unlink(file->temporary);
    sgsi_free(file->path);
    sgsi_free(file->target);
    sgsi_free(file->temporary);
    *file = (sgs_output_file){0};
}

sgs_status sgs_output_file_write(const char *path, const uint8_t *bytes, size_t size)
{
    sgs_output_file file;
    const sgs_status status = sgs_output_file_open(&file, path);
    if (status)
        return status;
    if (size)
        fwrite(bytes, 1, size, file.stream); // an error stays with the stream and fails the commit
    return sgs_output_file_commit(&file);
}
