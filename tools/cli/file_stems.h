// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the files of a view are called.

#include <stddef.h>

// STEM of each of `count` views: the image name without its extension, kept inside the folder the
// files go to ("", "." and ".." between slashes are left out; "view" where nothing is left). Names
// that would share a stem, or whose stem is another one's and an ending of its files (a.depth
// beside a), keep their extension, equal names are numbered (NAME_2, ...): no two stems are equal.
// The pointers to the names lie `stride` bytes apart, as members of an array of
// structures do. Release with file_stems_free; NULL after printing the error.
char **file_stems(char *const *first_name, size_t stride, size_t count);

// Accepts NULL.
void file_stems_free(char **stems, size_t count);
