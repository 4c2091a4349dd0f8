// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// SCENE/sparse/0 and SCENE/images of `sparegs reconstruct`. Only what the command itself wrote is
// replaced: a model whose digest is known, and a symbolic link. Functions that return bool print
// their error before they return false.

#include <jansson.h>
#include <stdbool.h>

// Checks that sparse/0 is absent, empty or a model with one of the digests in `known` (a list of
// strings, or NULL), and that images is absent, a link or the folder `photos` (an absolute path).
bool reconstructed_scene_check(const char *scene, const char *photos, const json_t *known);

// Size and 64-bit FNV-1a hash of each file of the binary model in a folder, as one text; release
// with free(). NULL if a file is missing or cannot be read, with errno.
char *reconstructed_model_digest(const char *folder);

// Copies the binary model in the folder `from` to sparse/0, which is replaced as a whole.
bool reconstructed_model_keep(const char *scene, const char *from);

// Makes images a link to the photos, unless it is their folder.
bool reconstructed_images_link(const char *scene, const char *photos);
