// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Runs a fuzz target on the files of a folder, for builds without libFuzzer. Fails if there are
// none.

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int main(int argc, char **argv)
{
    DIR *folder = argc == 2 ? opendir(argv[1]) : NULL;
    size_t count = 0;
    for (const struct dirent *entry; folder && (entry = readdir(folder));) {
        if (entry->d_name[0] == '.')
            continue;
        char path[1024];
        uint8_t *bytes;
        size_t size;
        snprintf(path, sizeof path, "%s/%s", argv[1], entry->d_name);
        if (sgsi_file_read(path, 0, &bytes, &size)) {
            fprintf(stderr, "%s\n", sgs_last_error());
            return 1;
        }
        LLVMFuzzerTestOneInput(bytes, size);
        sgsi_free(bytes);
        ++count;
    }
    if (folder)
        closedir(folder);
    printf("%zu inputs\n", count);
    return count == 0;
}
