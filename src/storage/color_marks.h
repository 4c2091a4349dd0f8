// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// How model files record the meaning of their colours: the comments of a PLY, and the names of
// colour spaces in OpenUSD and glTF. The primaries of a model are those of Rec. 709.

#include <stdio.h>

#include "sparegs/image.h"

// The comments that record the colours, "ColorSpace: linear" and "WhitePoint: 5.25"; nothing for
// encoded colours without a white point.
void sgsi_color_comments_write(FILE *stream, const sgs_model_colors *colors);

// Applies such a comment; other keys are ignored, unknown values reset the mark.
void sgsi_color_comment_parse(const char *key, const char *value, sgs_model_colors *colors);

// Applies a name such as "lin_rec709_scene". path: for a warning about other primaries or transfer
// functions than those of sRGB and linear light; NULL for none.
void sgsi_color_space_parse(const char *path, const char *name, sgs_model_colors *colors);

// What is wrong with the colours of an option or a file, or NULL.
const char *sgsi_colors_wrong(const sgs_model_colors *colors);

// 0 unless the value is in the range of --white: above 0, at most 1e30.
double sgsi_white_point_checked(double value);

// A white point as text, whatever the locale; 0 if it is no such number.
double sgsi_white_point_parse(const char *text);
