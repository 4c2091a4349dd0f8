// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A model that is a folder of files with a manifest, which replaces an earlier one as a whole. New
// files are written to FOLDER/MANIFEST.tmp.NUMBER; commit moves them into place by renames. Any
// failure leaves the earlier model as it was. A process that is killed between two of the renames
// leaves a folder without a manifest, never a manifest with files of another model. Other files in
// the folder are not touched.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef struct sgsi_model_folder_file {
    char name[96];                    // relative to the folder
    bool is_new, is_aside, is_placed; // is_aside: the earlier file is in the staging folder
} sgsi_model_folder_file;

typedef struct sgsi_model_folder {
    char *path, *stage, *manifest;
    bool was_made; // the folder did not exist
    sgsi_model_folder_file *files;
    size_t count, capacity;
} sgsi_model_folder;

// Creates the folder and the staging folder. `manifest` is the name of the file that makes the
// folder a model. Fails with IO or OUT_OF_MEMORY. Call sgsi_model_folder_close in any case.
sgs_status sgsi_model_folder_open(sgsi_model_folder *folder, const char *path,
                                  const char *manifest);
// Stages a new file. `name` may have one folder in front: "0_0/means_l.webp". Fails with IO or
// OUT_OF_MEMORY.
sgs_status sgsi_model_folder_put(sgsi_model_folder *folder, const char *name, const uint8_t *bytes,
                                 size_t size);
// Marks a file of the earlier model for removal, unless it is missing or replaced; call it after
// the last put. Fails with OUT_OF_MEMORY.
sgs_status sgsi_model_folder_drop(sgsi_model_folder *folder, const char *name);
// Puts the new files, one of which is the manifest, in the place of the earlier ones. Fails with IO
// or OUT_OF_MEMORY, with the earlier files in place.
sgs_status sgsi_model_folder_commit(sgsi_model_folder *folder);
// Removes what is left in the staging folder, and a folder that open created and that is empty.
void sgsi_model_folder_close(sgsi_model_folder *folder);
