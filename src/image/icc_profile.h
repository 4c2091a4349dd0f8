// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The name of an ICC profile that an image file embeds, for a warning: profiles are not applied.
// Reads the description only (ICC.1:2022, 7.2, 7.3 and 9.2.41; version 2: ICC.1:2001-04, 6.5.17).

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

// Writes the description in UTF-8, without control characters, in English if there are several; ""
// if it is missing or damaged. `size` > 0. Cannot fail.
void sgsi_icc_name(const uint8_t *profile, size_t bytes, char *name, size_t size);

// Writes the warning about an image with this profile, or "" if its description is that of sRGB,
// which colours without a declaration have. `size` > 0. Cannot fail.
void sgsi_icc_note(const void *profile, size_t bytes, char *note, size_t size);

#ifdef __cplusplus
}
#endif
