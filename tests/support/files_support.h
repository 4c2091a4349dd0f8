// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Temporary folders and small files for tests. Include after cmocka.h.

#include <dirent.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

typedef struct temp_folder {
    char path[256];
} temp_folder;

static inline temp_folder temp_folder_make(void)
{
    temp_folder folder;
    const char *base = getenv("TMPDIR");
    snprintf(folder.path, sizeof folder.path, "%s/sparegs_test_XXXXXX",
             base && *base ? base : "/tmp");
    assert_non_null(mkdtemp(folder.path));
    return folder;
}

// Path of a file in the folder; valid until the fourth call after this one.
static inline const char *temp_path(const temp_folder *folder, const char *name)
{
    static char paths[4][512];
    static int next;
    char *path = paths[next++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", folder->path, name);
    return path;
}

static inline size_t temp_folder_count(const temp_folder *folder)
{
    size_t count = 0;
    DIR *directory = opendir(folder->path);
    assert_non_null(directory);
    for (const struct dirent *entry = readdir(directory); entry; entry = readdir(directory))
        count += entry->d_name[0] != '.';
    closedir(directory);
    return count;
}

// Removes the files in the folder and the folder, which must have no subfolders.
static inline void temp_folder_remove(const temp_folder *folder)
{
    DIR *directory = opendir(folder->path);
    assert_non_null(directory);
    for (const struct dirent *entry = readdir(directory); entry; entry = readdir(directory)) {
        if (strcmp(entry->d_name, ".") && strcmp(entry->d_name, ".."))
            assert_int_equal(unlinkat(dirfd(directory), entry->d_name, 0), 0);
    }
    closedir(directory);
    assert_int_equal(rmdir(folder->path), 0);
}

static inline int tree_remove_entry(const char *path, const struct stat *info, int kind,
                                    struct FTW *place)
{
    (void)info, (void)kind, (void)place;
    return remove(path);
}

// Removes the folder with its files and subfolders.
static inline void tree_remove(const temp_folder *folder)
{
    assert_int_equal(nftw(folder->path, tree_remove_entry, 8, FTW_DEPTH | FTW_PHYS), 0);
}

static inline void file_put(const char *path, const void *bytes, size_t size)
{
    FILE *stream = fopen(path, "wb");
    assert_non_null(stream);
    assert_int_equal(fwrite(bytes, 1, size, stream), size);
    assert_int_equal(fclose(stream), 0);
}

// Creates a file that cannot be opened, not even by root: a socket.
static inline void file_put_unreadable(const char *in, const char *name)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    assert_true(strlen(name) < sizeof address.sun_path);
    memcpy(address.sun_path, name, strlen(name));
    const int here = open(".", O_RDONLY), end = socket(AF_UNIX, SOCK_STREAM, 0);
    assert_true(here >= 0 && end >= 0);
    assert_int_equal(chdir(in), 0); // the path of a socket is short
    assert_int_equal(bind(end, (const struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(fchdir(here), 0);
    close(end);
    close(here);
}

// NUL-terminated beyond *size; release with free.
static inline unsigned char *file_get(const char *path, size_t *size)
{
    FILE *stream = fopen(path, "rb");
    assert_non_null(stream);
    assert_int_equal(fseek(stream, 0, SEEK_END), 0);
    *size = (size_t)ftell(stream);
    rewind(stream);
    unsigned char *bytes = malloc(*size + 1);
    assert_non_null(bytes);
    assert_int_equal(fread(bytes, 1, *size, stream), *size);
    bytes[*size] = 0;
    fclose(stream);
    return bytes;
}

static struct {
    struct rlimit limit;
    void (*handler)(int);
} files_before; // files_limited()

// Until files_unlimited(), writes beyond byte `bytes` of a file fail (EFBIG), as on a full disk.
static inline void files_limited(size_t bytes)
{
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &files_before.limit), 0);
    files_before.handler = signal(SIGXFSZ, SIG_IGN);
    const struct rlimit limit = {.rlim_cur = bytes, .rlim_max = files_before.limit.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

static inline void files_unlimited(void)
{
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &files_before.limit), 0);
    signal(SIGXFSZ, files_before.handler);
}

// Runs a program (searched in PATH), which must be installed, and returns its exit status. `output`
// receives stdout and stderr, NUL-terminated and truncated to `capacity`.
static inline int run_program(const char *const arguments[], char *output, size_t capacity)
{
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    fflush(NULL);
    const pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        dup2(ends[1], STDOUT_FILENO);
        dup2(ends[1], STDERR_FILENO);
        close(ends[0]);
        close(ends[1]);
        execvp(arguments[0], (char *const *)arguments);
        _exit(127);
    }
    close(ends[1]);
    size_t length = 0;
    char drained[256];
    for (;;) {
        const bool room = length + 1 < capacity;
        const ssize_t got = room ? read(ends[0], output + length, capacity - 1 - length)
                                 : read(ends[0], drained, sizeof drained);
        if (got <= 0)
            break;
        length += room ? (size_t)got : 0;
    }
    output[length] = 0;
    close(ends[0]);
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
        fail_msg("%s is not installed; tools/setup.sh installs it", arguments[0]);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}
