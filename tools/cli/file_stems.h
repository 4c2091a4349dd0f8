// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Names of a view's output files.

#include <stddef.h>

// STEM of each of `count` views: the image name without its extension and without components that
// would leave the output folder ("", ".", ".."); "view" if nothing remains. Stems are unique: names
// that would collide, also with a suffix of another view's files (a.depth next to a), keep their
// extension, and equal names are numbered (NAME_2, ...). The pointers to the names are `stride`
// bytes apart, as members of an array of structures. Release with file_stems_free; NULL after
// printing the error.
char **file_stems(char *const *first_name, size_t stride, size_t count);

// Accepts NULL.
void file_stems_free(char **stems, size_t count);
