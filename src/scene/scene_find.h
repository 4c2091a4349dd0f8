// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Detects the kind of scene in a folder and locates its files. Reads no contents except image
// counts, to choose among several COLMAP models.

#include <stdbool.h>
#include <stddef.h>

#include "base/path_sandbox.h"
#include "scene/similar_name.h"
#include "sparegs/status.h"

typedef struct sgsi_scene_files {
    bool colmap;        // otherwise transforms
    char *model_path;   // COLMAP: folder of cameras.bin; transforms: JSON file
    char *image_folder; // names of photos are relative to it
    // Parent of the mask folders. COLMAP: parent of the image folder by name, even if that is a
    // link; transforms: the image folder.
    char *mask_root;
} sgsi_scene_files;

// images_dir: see sgs_scene_options; NULL = "images". On failure *files is empty.
sgs_status sgsi_scene_find(const char *path, const char *images_dir, sgsi_scene_files *files);

// Frees the contents and zeroes the struct.
void sgsi_scene_files_free(sgsi_scene_files *files);

// The folder of option images_dir, NULL = not given, in a transforms scene: photos are in it
// instead of in the folder that their names begin with. *chosen is NULL without the option, after a
// failure, and for COLMAP, where it is files->image_folder. Fails with IO if there is no such
// folder.
sgs_status sgsi_scene_choose_images(const sgsi_scene_files *files, const char *images_dir,
                                    char **chosen);

// Path of photo `name`: folder/name, or if that does not exist the same name with an image
// extension added or replaced: some models have none, and folders of downscaled images often change
// it. NULL if out of memory.
char *sgsi_scene_image_path(const char *folder, const char *name);

// What sgsi_scene_find_unknown searches. Paths are relative to the folder.
typedef struct sgsi_file_search {
    const char *folder;
    const sgsi_roots *roots;  // links out of them are ignored
    const char *const *known; // sorted by strcmp
    size_t known_count;
    const char *const *missing; // photos that do not exist
    size_t missing_count;
    bool masks; // include files with the names of masks
} sgsi_file_search;

typedef struct sgsi_unknown_files {
    size_t count;
    char examples[256]; // the first few names, separated by commas
    // The first missing photo that resembles an unknown file, and the first such file, which the
    // caller frees; NULL = none.
    const char *missing;
    char *similar;
    sgsi_name_difference difference;
} sgsi_unknown_files;

// Lists the image files below a folder, in any image format, that are not known, except hidden
// ones. Searches each folder once, under its own path rather than that of a link.
void sgsi_scene_find_unknown(const sgsi_file_search *what, sgsi_unknown_files *unknown);
