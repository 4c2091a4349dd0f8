// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The colour spaces of image files: which one a file has, by its attributes or by the user, and the
// conversion of its pixels to linear light with the primaries of Rec. 709. C++; reads no files, but
// OpenColorIO may read its configuration. Exceptions of OpenImageIO leave these functions.

#include <cstddef>
#include <string>
#include <vector>

#include <OpenImageIO/color.h>
#include <OpenImageIO/imageio.h>

#include "image/image_oiio.h"

extern "C" {
#include "image/color_interop.h"
}

namespace sgsi
{

constexpr size_t max_shown = 64; // bytes of a name in a note

// Encodings that the trainer uses directly, or `other`: converted by OpenImageIO first.
enum class Encoding { srgb, linear, other };

struct Colors {
    Encoding encoding = Encoding::srgb;
    std::string name;                     // see sgsi_image_info
    OIIO::ColorProcessorHandle processor; // other: converts to linear light
    sgsi_interop_space space = {1, nullptr};
    bool decodes = false;          // from the curve of `space`
    bool scene_linear = false;     // see sgsi_image_info
    bool primaries = false;        // multiply linear light by the matrix
    double matrix[3][3] = {};      // to Rec. 709
    std::string notes[SGSI_NOTES]; // see sgsi_image_info
};

// Text of a file for a message: without control characters; "no reason given" if there is none.
std::string one_line(std::string text);

// Separated by commas.
std::string joined(const std::vector<std::string> &words);

// True for the names of sRGB with the primaries of Rec. 709, in lower or upper case.
bool is_srgb(const std::string &space);

// True for such names, and for IDs of the Color Interop Forum with a transfer curve.
bool is_encoded(const std::string &space);

// Chooses the space of a file. `colorspace`: the user's, or NULL. Errors as sgsi_oiio_describe.
sgs_status choose_colors(const char *path, const OIIO::ImageSpec &spec, bool is_exr,
                         const char *colorspace, Colors &colors);

// True if decode_row changes values: it requires unpremultiplied colours.
bool decodes(const Colors &colors);

// Decodes a row of [width][channels] to linear light. Cannot fail.
void decode_row(int width, size_t channels, const Colors &colors, float *row);

// Converts a row of linear light to the primaries of Rec. 709, premultiplied or not. Cannot fail.
void convert_primaries(int width, size_t channels, const Colors &colors, float *row);

} // namespace sgsi
