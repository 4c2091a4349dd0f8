// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Images in and out, behind one C header: 8-bit photographs (OpenImageIO), PNG for people
// (OpenImageIO) and multi-channel EXR for compositors (OpenEXR). Every writer writes to a temporary
// file in the target folder and renames it, so a failed write leaves the earlier file intact.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// A photograph: planar 8-bit, display-encoded (sRGB as stored in the file). Plane c starts at
// pixels + c * width * height; row-major, top row first. channels is 3 (RGB) or 4 (RGB and straight
// alpha).
typedef struct sgs_image8 {
    int width, height, channels;
    uint8_t *pixels; // 64-byte aligned
} sgs_image8;

// The space that photographs are compared in, and so that trained colours are in: encoded for
// display, or light itself.
typedef enum sgs_space { SGS_SPACE_SRGB = 0, SGS_SPACE_LINEAR = 1 } sgs_space;

// A photograph ready to be compared with: planes as in sgs_image8, 3 or 4 channels, colours in the
// scene's space, and which of its pixels count. Pixels that a mask covers, that the lens has no ray
// for or that hold no number do not.
//
// Values are bytes (255 is 1) or half-float numbers, whichever the file needs; the other pointer is
// NULL. Light brighter than the scene's white is above 1.
typedef struct sgs_photo {
    int width, height, channels;
    uint8_t *pixels;
    uint16_t *valid_mask; // [height][(width + 15) / 16]: bit i of word w is pixel 16 w + i of the
                          // row, 1 = counts; NULL = all
    size_t kept;          // number of pixels that count
    uint16_t *halves;     // IEEE 754 binary16, >= 0, neither infinite nor subnormal
    bool is_hdr;          // values above 1 mean something: comparisons do not clamp there
} sgs_photo;

// Reads a photograph as 3 or 4 planes of 8 bit (grey becomes RGB, 16-bit is rounded). On failure
// image->pixels is NULL and the error names the file.
SGS_API sgs_status sgs_image8_read(const char *path, sgs_image8 *image);

// Width and height from the file's header only.
SGS_API sgs_status sgs_image8_probe(const char *path, int *width, int *height);

// Area-averaging by an integer factor: out size = max(1, size / factor) (floor); each output pixel
// is the exact area average of its source rectangle of width/out_width by height/out_height source
// pixels.
SGS_API sgs_status sgs_image8_downscale(const sgs_image8 *image, int out_width, int out_height,
                                        sgs_image8 *out);

// Frees the pixels and zeroes the struct; accepts an empty one.
SGS_API void sgs_image8_free(sgs_image8 *image);

// The transfer curve of sRGB and its inverse, continued above 1 and below 0. Cannot fail.
SGS_API float sgs_srgb_encode(float linear);
SGS_API float sgs_srgb_decode(float encoded);

// Value `at` of a photograph's planes (plane * width * height + pixel), as its space has it: 8-bit
// values scaled to [0, 1], or half-float numbers. No bounds check.
SGS_API float sgs_photo_value(const sgs_photo *photo, size_t at);

// Writes planar 8-bit RGB or RGBA or grey (channels 1, 3, 4) as PNG.
SGS_API sgs_status sgs_png_write(const char *path, const sgs_image8 *image);

// One EXR channel: a float plane or, when uints is set, a 32-bit unsigned plane. Row-major, top row
// first.
typedef struct sgs_exr_channel {
    const char *name;      // "R", "depth.Z", ...
    const float *floats;   // [height][width]
    const uint32_t *uints; // or this; exactly one is non-NULL
    bool half;             // store the floats as half
} sgs_exr_channel;

// How an EXR's pixels are packed. All but DWAA keep every bit.
typedef enum sgs_exr_compression {
    SGS_EXR_AUTO = 0, // a ZIP file, whose parts are deflated where that saves a third and stand as
                      // they are elsewhere
    SGS_EXR_ZIP,      // deflate, 16 lines at a time
    SGS_EXR_ZIPS,     // deflate, line by line: quicker to read in parts
    SGS_EXR_PIZ,      // wavelets: smaller where images are noisy
    SGS_EXR_NONE,
    SGS_EXR_DWAA, // cosine transform of R, G, B: much smaller, lossy to the eye's threshold; the
                  // rest as ZIP
    SGS_EXR_COMPRESSION_COUNT
} sgs_exr_compression;

typedef struct sgs_exr_info {
    int width, height;
    const double *world_to_camera; // 16, row-major, column vectors (p' = M p), or NULL
    const double *world_to_ndc;    // likewise
    const char *depth_definition;  // text attribute "sparegs:depthDefinition", or NULL
    const char *view_name;         // text attribute "sparegs:view", or NULL
    // fx, fy, cx, cy in pixels of a perspective camera, or NULL. Written as screenWindowWidth and
    // screenWindowCenter and, for a film back 36 mm wide, as pinholeFocalLength and
    // sensorOverallDimensions in mm.
    const double *intrinsics;
    bool is_latlong; // a latitude-longitude map of all directions: attribute envmap
    sgs_exr_compression compression;
} sgs_exr_info;

// Writes a scan-line EXR with data window = display window, Rec. 709 chromaticities and
// the attributes above. Matrices are stored in EXR's row-vector convention (transposed).
SGS_API sgs_status sgs_exr_write(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count);

// A stretch of a ray. Samples of a pixel are in ray order and do not overlap; z <= z_back (equal
// for a single hit), as the frame's distances are measured. Colour is premultiplied, display
// values: laid over each other, nearest on top, the samples of a pixel give its colour and alpha.
typedef struct sgs_deep_sample {
    float z, z_back, alpha, color[3];
} sgs_deep_sample;

// A deep scan-line EXR that is written row by row: float channels A, B, G, R, Z, ZBack, samples as
// they come. info as above; its compression is lossless and line by line (ZIPS) unless it is
// SGS_EXR_NONE. max_samples: per pixel, told by the header. On failure *deep is NULL.
typedef struct sgs_exr_deep sgs_exr_deep;
SGS_API sgs_status sgs_exr_deep_open(const char *path, const sgs_exr_info *info, int max_samples,
                                     sgs_exr_deep **deep);

// Appends `rows` rows. counts [rows][width]; samples: those of all pixels, one after the other.
SGS_API sgs_status sgs_exr_deep_write(sgs_exr_deep *deep, int rows, const uint32_t *counts,
                                      const sgs_deep_sample *samples);

// Ends the file and puts it in its place; all rows must have been written. Frees `deep` in any
// case.
SGS_API sgs_status sgs_exr_deep_close(sgs_exr_deep *deep);
// Gives up: leaves no file. Accepts NULL.
SGS_API void sgs_exr_deep_abort(sgs_exr_deep *deep);

#ifdef __cplusplus
}
#endif
