// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Finds out by looking what kind of scene a folder holds and where its parts are. Reads no content
// beyond the image counts that decide among several COLMAP models.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/status.h"

typedef struct sgsi_scene_files {
    bool colmap;        // else transforms
    char *model_path;   // COLMAP: folder of cameras.bin; transforms: the JSON file
    char *image_folder; // names of photographs are relative to this
    char *mask_root;    // holds the folders of masks: COLMAP: what holds the image folder, by its
                        // name, even if it is a link; transforms: the image folder
} sgsi_scene_files;

// `images_dir`: as in sgs_scene_options; NULL = "images". On failure *files is empty.
sgs_status sgsi_scene_find(const char *path, const char *images_dir, sgsi_scene_files *files);

// Frees the contents and zeroes the struct.
void sgsi_scene_files_free(sgsi_scene_files *files);

// The file of the photograph `name`: folder/name, or, when there is no such file, the one with
// another usual image extension (folders of reduced images often change it). NULL when out of
// memory.
char *sgsi_scene_image_path(const char *folder, const char *name);

// Counts the image files below `folder` (hidden ones aside) that are not in `known` (`count` paths
// relative to folder, sorted by strcmp) and writes the first few of them into `examples`.
size_t sgsi_scene_count_unknown(const char *folder, const char *const *known, size_t count,
                                char *examples, size_t examples_size);
