// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Selects the colour channels of an EXR file by their names, LAYER.CHANNEL. Does not read files.

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgsi_exr_colors {
    int channels[4]; // indices of R, G, B and A; A is -1 if the layer has none
    int rgb_layers;  // layers to choose from: 0 = grey, 1 = the main layer or the only one
} sgsi_exr_colors;

// Chooses R, G, B and A, in lower or upper case, of the main layer, whose names have no dot. If it
// lacks one of R, G and B: of the first layer that has them and whose name ends in Combined,
// Beauty, RGBA, RGB or Composite; else of the first that has them; else Y of the main layer for all
// three. False if there is none of these.
bool sgsi_exr_find_colors(const char *const *names, int count, sgsi_exr_colors *colors);

// Length of the layer in a channel's name, without the dot; 0 for the main layer. Cannot fail.
int sgsi_exr_layer_length(const char *name);

#ifdef __cplusplus
}
#endif
