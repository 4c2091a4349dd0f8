// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Primaries of linear RGB images, as the eight CIE 1931 chromaticities that OpenEXR stores. No
// transfer functions.

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

// x and y of red, green, blue and white, in the order of OpenEXR's attribute `chromaticities`.
enum { SGSI_CHROMATICITIES = 8 };

// ITU-R BT.709 with D65.
extern const float sgsi_rec709[SGSI_CHROMATICITIES];

// True if no coordinate differs by more than 0.001.
bool sgsi_primaries_are_equal(const float a[SGSI_CHROMATICITIES],
                              const float b[SGSI_CHROMATICITIES]);

// The same for Rec. 709.
bool sgsi_primaries_are_rec709(const float chromaticities[SGSI_CHROMATICITIES]);

// The matrix [row][column] from linear RGB of these primaries to Rec. 709. White becomes white, by
// Bradford's chromatic adaptation. False if the primaries form no triangle, or a value is not
// finite; *matrix is then undefined.
bool sgsi_primaries_to_rec709(const float chromaticities[SGSI_CHROMATICITIES], double matrix[3][3]);

#ifdef __cplusplus
}
#endif
