// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Image input and output: 8-bit images (OpenImageIO), PNG (OpenImageIO) and multi-channel EXR
// for compositing (OpenEXR). All writers write to a temporary file in the target folder and rename
// it, so a failed write keeps the existing file.
//
// Threads: all functions may be called from any thread at any time; calls on one sgs_exr_deep, one
// after the other. If two calls write the same file, the last one wins.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// A photo: planar 8-bit, display-encoded (sRGB as stored in the file). Plane c starts at
// pixels + c * width * height; row-major, top row first. channels is 3 (RGB) or 4 (RGB and straight
// alpha).
typedef struct sgs_image8 {
    int width, height, channels;
    uint8_t *pixels; // 64-byte aligned
} sgs_image8;

// Colour space in which photos are compared, and therefore of trained colours: display-encoded
// sRGB or linear light.
typedef enum sgs_space { SGS_SPACE_SRGB = 0, SGS_SPACE_LINEAR = 1 } sgs_space;

// Meaning of the colours of a model, as its file records it. All zero: not recorded.
typedef struct sgs_model_colors {
    bool space_known;   // otherwise, colours are usually display-encoded
    sgs_space space;    // of the model's colours
    double white_point; // linear light that maps to 1 in them, > 0; 0 = unknown
} sgs_model_colors;

// A photo prepared for training: planes as in sgs_image8, 3 or 4 channels, colours in the
// scene's space, and a valid mask. Invalid are pixels that are masked, have no ray, or have NaN or
// infinite values.
//
// Values are either 8-bit (255 is 1) or half floats, depending on the file; the other pointer is
// NULL. Light above the scene's white point is above 1.
typedef struct sgs_photo {
    int width, height, channels;
    uint8_t *pixels;
    // [height][(width + 15) / 16]: bit i of word w is pixel 16 w + i of the row, 1 = valid. NULL =
    // all valid.
    uint16_t *valid_mask;
    size_t kept;      // number of valid pixels
    uint16_t *halves; // IEEE 754 binary16, >= 0, neither infinite nor subnormal
    bool is_hdr;      // values above 1 are meaningful: comparisons do not clamp them
} sgs_photo;

// 16-bit words per row of a valid mask.
static inline size_t sgs_mask_words(int width)
{
    return ((size_t)width + 15) / 16;
}

// True if pixel (x, y) of an image of this width is valid; a NULL mask has only valid pixels. No
// bounds check.
static inline bool sgs_mask_is_valid(const uint16_t *valid_mask, int width, int x, int y)
{
    return !valid_mask ||
           (valid_mask[(size_t)y * sgs_mask_words(width) + (size_t)x / 16] >> x % 16 & 1);
}

// True for file names of masks next to photos: STEM_mask.png, and dynamic_mask_STEM.png of
// instant-ngp. `name` may have folders. Cannot fail.
SGS_API bool sgs_mask_is_name(const char *name);

// Reads a photo as 3 or 4 planes of 8 bits (grey becomes RGB, 16 bits are rounded). Release it
// with sgs_image8_free. Fails with IO, FORMAT (not an image, truncated), UNSUPPORTED, LIMIT (size),
// OUT_OF_MEMORY or INTERNAL (OpenImageIO); image->pixels is then NULL and the error names the file.
SGS_API sgs_status sgs_image8_read(const char *path, sgs_image8 *image);

// Width and height from the file's header only. Fails as sgs_image8_read.
SGS_API sgs_status sgs_image8_probe(const char *path, int *width, int *height);

// Reduces an image to out_width x out_height pixels: each output pixel is the exact area average of
// its source rectangle of width/out_width by height/out_height source pixels; colours of four
// channels are weighted by alpha. Release *out with sgs_image8_free. Fails with INVALID_ARGUMENT
// (size below 1 or above that of the image) or OUT_OF_MEMORY; *out is then empty.
SGS_API sgs_status sgs_image8_downscale(const sgs_image8 *image, int out_width, int out_height,
                                        sgs_image8 *out);

// Frees the pixels and zeroes the struct; accepts an empty one.
SGS_API void sgs_image8_free(sgs_image8 *image);

// The sRGB transfer function and its inverse, extended above 1 and below 0. Cannot fail.
SGS_API float sgs_srgb_encode(float linear);
SGS_API float sgs_srgb_decode(float encoded);

// Value at index `at` of a photo's planes (plane * width * height + pixel), in the
// photo's space: 8-bit values scaled to [0, 1], or half floats. No bounds check.
SGS_API float sgs_photo_value(const sgs_photo *photo, size_t at);

// Frees a photo of sgs_scene_photo_read and zeroes the struct; accepts an empty one.
SGS_API void sgs_photo_free(sgs_photo *photo);

// Writes planar 8-bit grey, RGB or RGBA (1, 3 or 4 channels) as PNG. Fails with INVALID_ARGUMENT
// (channels, empty image), UNSUPPORTED (OpenImageIO without PNG), IO or OUT_OF_MEMORY.
SGS_API sgs_status sgs_png_write(const char *path, const sgs_image8 *image);
// The same with a text chunk "Description"; NULL for none.
SGS_API sgs_status sgs_png_write_described(const char *path, const sgs_image8 *image,
                                           const char *description);

// One EXR channel: a float plane or a 32-bit unsigned plane. Row-major, top row first.
typedef struct sgs_exr_channel {
    const char *name;      // "R", "depth.Z", ...
    const float *floats;   // [height][width]
    const uint32_t *uints; // exactly one of floats and uints is non-NULL
    bool half;             // store the floats as half; those from 65520 on become infinite
} sgs_exr_channel;

// EXR compressions. All but DWAA are lossless.
typedef enum sgs_exr_compression {
    // ZIP for the parts of the file that it reduces by a third, uncompressed otherwise.
    SGS_EXR_AUTO = 0,
    SGS_EXR_ZIP,  // deflate, 16 lines at a time
    SGS_EXR_ZIPS, // deflate, line by line: faster partial reads
    SGS_EXR_PIZ,  // wavelets: smaller for noisy images
    SGS_EXR_NONE,
    // Cosine transform of R, G, B, also of layers: much smaller, visually lossless. All other
    // channels, also those named Y, are lossless. An image of one channel uses ZIP instead.
    SGS_EXR_DWAA,
    SGS_EXR_COMPRESSION_COUNT
} sgs_exr_compression;

typedef struct sgs_exr_info {
    int width, height;             // of the planes: the data window
    const double *world_to_camera; // 16, row-major, column vectors (p' = M p), or NULL
    const double *world_to_ndc;    // the same
    const char *depth_definition;  // text attribute "sparegs:depthDefinition", or NULL
    const char *view_name;         // text attribute "sparegs:view", or NULL
    // fx > 0, fy > 0, cx, cy in pixels of a perspective camera, or NULL. Written as
    // screenWindowWidth and screenWindowCenter, as pixelAspectRatio (sgs_pixel_aspect) and, for a
    // film back 36 mm wide, as pinholeFocalLength and sensorOverallDimensions in mm.
    const double *intrinsics;
    bool is_latlong; // a latitude-longitude map of all directions: attribute envmap
    sgs_exr_compression compression;
    // Frames per second of the sequence, from 0.001 to 1e6: attribute framesPerSecond, with the
    // rates of NTSC as n 1000/1001. 0 = none. See sgs_frame_rate.
    double frame_rate;
    // Pixels of the planes outside the display window, on each of its sides; 0 = none. The display
    // window begins at (0, 0), the data window at (-overscan, -overscan). `intrinsics` and
    // world_to_ndc refer to the display window.
    int overscan;
    // Space of the channels R, G and B: text attribute "colorInteropID", which names colour spaces
    // as the ASWF Color Interop Forum does, or NULL.
    const char *color_space;
    // Deep files: store colours and alpha as half floats. See sgs_exr_deep_open. Flat files: see
    // sgs_exr_channel.
    bool deep_half;
} sgs_exr_info;

// Values of color_space: linear light, and the encoding of sRGB.
#define SGS_COLOR_LINEAR "lin_rec709_scene"
#define SGS_COLOR_SRGB "srgb_rec709_scene"

// Width of a pixel over its height, fy / fx, in an image of this size. 1 if they differ by at most
// 1 %, as in calibrations of square pixels, or, if that is more, by one pixel of the shorter side,
// to which sizes of downscaled images are rounded: programs would see another pixel format.
SGS_API double sgs_pixel_aspect(double fx, double fy, int width, int height);

// A frame rate as the rational number numerator / denominator, both > 0. Rates from 23.976 on that
// are within 0.002 of 1000/1001 of the next integer, such as 29.97, stand for that (SMPTE ST 12-1),
// as for OpenEXR's guessExactFps; others are rounded to a thousandth. False, and the outputs are
// unchanged, if the rate is outside [0.001, 1e6].
SGS_API bool sgs_frame_rate(double rate, int *numerator, int *denominator);

// Writes a scan-line EXR with Rec. 709 chromaticities and the attributes above. Matrices are stored
// in EXR's row-vector convention (transposed). Fails with INVALID_ARGUMENT (size, overscan,
// frame rate, intrinsics, compression, channels, a name used twice), IO, OUT_OF_MEMORY, UNSUPPORTED
// or INTERNAL (OpenEXR).
SGS_API sgs_status sgs_exr_write(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count);

// A segment of a ray. The samples of a pixel are in ray order and do not overlap; z <= z_back
// (equal for a single hit), measured like the frame's distances. Colours are premultiplied display
// values; compositing the samples front to back gives the pixel's colour and alpha.
typedef struct sgs_deep_sample {
    float z, z_back, alpha, color[3];
} sgs_deep_sample;

// A deep scan-line EXR, written row by row: float channels A, B, G, R, Z, ZBack. `info` as above;
// compression is ZIPS, or none for SGS_EXR_NONE. max_samples: the largest count of a pixel, at
// least 1, stored in the header.
//
// With deep_half, A, B, G and R are half floats: rounded to nearest and limited to 65504 in
// magnitude. A positive alpha that would become 0 becomes 2^-24, the smallest half, so that no
// sample keeps its colour without alpha. If no value is limited, the samples composited front to
// back differ from the exact ones by at most 2^-10 M in colour, M the largest colour / alpha of the
// pixel's samples, and by 2^-11 in alpha; values below 2^-14 add up to 2^-24 max(1, M) each.
//
// Fails with INVALID_ARGUMENT (info, max_samples), IO, OUT_OF_MEMORY or INTERNAL (OpenEXR); *deep
// is then NULL.
typedef struct sgs_exr_deep sgs_exr_deep;
SGS_API sgs_status sgs_exr_deep_open(const char *path, const sgs_exr_info *info, int max_samples,
                                     sgs_exr_deep **deep);

// Appends `rows` rows. counts: [rows][width]; samples: of all these pixels, consecutively. Fails
// with INVALID_ARGUMENT (more rows than the image has, a count above max_samples), IO,
// OUT_OF_MEMORY or INTERNAL; after a failure close or abort the file.
SGS_API sgs_status sgs_exr_deep_write(sgs_exr_deep *deep, int rows, const uint32_t *counts,
                                      const sgs_deep_sample *samples);

// Finishes the file and moves it into place. Fails with INVALID_ARGUMENT if rows are missing, or as
// sgs_exr_deep_write; an existing file is then unchanged. Frees `deep` in any case.
SGS_API sgs_status sgs_exr_deep_close(sgs_exr_deep *deep);
// Discards the file. Accepts NULL.
SGS_API void sgs_exr_deep_abort(sgs_exr_deep *deep);

#ifdef __cplusplus
}
#endif
