// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Sets the pointers of a frame's planes by the rows of the AOV table.

#include <string.h>

#include "sparegs/aov_descriptors.h"

// Stores `plane` as number `channel` of the pointers that begin `offset` bytes into `frame`.
static inline void sgsi_plane_set(void *frame, size_t offset, int channel, void *plane)
{
    memcpy((char *)frame + offset + (size_t)channel * sizeof plane, &plane, sizeof plane);
}

// True if a frame with the AOV bits `planes` has this one.
static inline bool sgsi_aov_is_requested(const sgs_aov *aov, unsigned planes)
{
    return !aov->bit || (planes & aov->bit);
}
