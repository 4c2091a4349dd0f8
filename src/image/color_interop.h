// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Names of colour spaces in the attribute colorInteropID of EXR files: "Color Space Encodings for
// Texture Assets and CG Rendering" and "Identifying the Color Space of OpenEXR Files", both
// recommendations of the Color Interop Forum of the Academy Software Foundation.

#include <stdbool.h>

#include "image/primaries.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgsi_interop_space {
    double gamma;                // exponent of the decoding; 1 = linear light, 0 = sRGB
    const float *chromaticities; // [SGSI_CHROMATICITIES], static
} sgsi_interop_space;

// Finds a space by its ID, CURVE_PRIMARIES or CURVE_PRIMARIES_STATE, for example lin_ap1_scene.
// False if the curve or the primaries are unknown; *space is then undefined.
bool sgsi_interop_find(const char *id, sgsi_interop_space *space);

// Linear light of an encoded value. Negative values follow the recommendation: scaled by the slope
// at 0 for sRGB, unchanged for powers. Cannot fail.
float sgsi_interop_decode(const sgsi_interop_space *space, float value);

#ifdef __cplusplus
}
#endif
