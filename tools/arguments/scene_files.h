// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The files that a data set is read from: photos, masks and camera files. Outputs never replace
// them, whatever path or symbolic link names them.

#include <stdbool.h>
#include <stddef.h>

#include "options/options.h"
#include "sparegs/scene.h"

typedef struct scene_files {
    const sgs_scene *scene;   // borrowed; NULL: no file is refused
    struct scene_file *found; // sorted by device and inode; listed for the first output that exists
    size_t count;
    bool is_listed;
} scene_files;

// Release with scene_files_free.
scene_files scene_files_of(const sgs_scene *scene);
void scene_files_free(scene_files *files);

// False after printing the error if an output at `path` would replace a file of the scene; `advice`
// ends the message.
bool scene_files_admit(scene_files *files, const char *path, const char *advice);
// The same for all output options of a command.
bool scene_files_admit_outputs(const sgs_scene *scene, const command_line *line);
