// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Loads a photo: decodes, downscales and masks it. Repeatable at any time with the same
// result. Independent of the scene.

#include <stdbool.h>
#include <stdint.h>

#include "image/decode_limit.h"
#include "image/image_oiio.h"
#include "image/mask.h"
#include "sparegs/scene.h"

typedef struct sgsi_photo_source {
    const char *image_path, *mask_path; // mask_path may be NULL
    int file_width, file_height;        // size of the photo's file, or of its display window
    bool display_window;                // the photo is the display window of an EXR file
    int width, height;                  // requested size, at most the file's
    bool invert_mask, dynamic_mask;     // see sgsi_mask_file
    sgs_alpha alpha;
    const char *colorspace; // NULL = the file's
    sgs_space space;
    double white_point;   // > 0
    const uint16_t *lens; // mask of pixels with a ray, width x height, or NULL = all
    // Limits photos that are decoded at the same time; NULL = no limit. decode_bytes: of this one.
    sgsi_decode_limit *decode_limit;
    size_t decode_bytes;
} sgsi_photo_source;

// Further results of a load.
typedef struct sgsi_photo_report {
    bool mask_failed;        // the error concerns the mask, not the photo
    sgsi_mask_use mask;      // of the mask file
    size_t pixels_nonfinite; // pixels of the file with an infinite or NaN channel
} sgsi_photo_report;

// Fails like sgs_image8_read if the photo cannot be read. On failure the photo is empty.
sgs_status sgsi_photo_load(const sgsi_photo_source *source, sgs_photo *photo,
                           sgsi_photo_report *report);

// Converts a colour value from linear light or its sRGB encoding to the space of photos.
// Negative light becomes 0.
float sgsi_photo_encode(float value, bool linear, sgs_space space, double white_point);

// Applies the alpha channel, if any: see sgs_alpha.
sgs_status sgsi_photo_use_alpha(sgs_photo *photo, sgs_alpha alpha);

// Luminance histogram of linear photos: counts of max(R, G, B) > 0, in bins of 1/32 octave.
enum {
    SGSI_LIGHT_OCTAVE = 32,
    SGSI_LIGHT_LOW = -40, // octaves
    SGSI_LIGHT_HIGH = 40,
    SGSI_LIGHT_BINS = (SGSI_LIGHT_HIGH - SGSI_LIGHT_LOW) * SGSI_LIGHT_OCTAVE
};

typedef struct sgsi_light {
    uint64_t bins[SGSI_LIGHT_BINS];
} sgsi_light;

// Adds the pixels of a file; with `display_window`, only those in the display window.
sgs_status sgsi_light_add(sgsi_light *light, const char *path, const char *colorspace,
                          bool display_window);

// Adds a pixel by its brightest channel.
void sgsi_light_add_value(sgsi_light *light, float brightest);

// The value that a fraction `share` of the pixels does not exceed; 1 if the histogram is empty.
double sgsi_light_quantile(const sgsi_light *light, double share);

// True if such a photo is kept in 8 bits, false if in half floats.
bool sgsi_photo_is_8bit(const sgsi_image_info *info, sgs_space space);

// Chooses the window of a file that the camera describes: *display for the display window of an EXR
// file whose data window differs, false for the pixels of the file. A camera of the size of the
// data window, or of another shape than the display window, has the file's pixels. Fails with
// FORMAT for other formats that hold a part of the camera's picture, because its position is
// unknown, and with LIMIT for a display window of more than 65536 pixels per side or 2^30 in total.
sgs_status sgsi_photo_choose_window(const char *path, const sgsi_image_info *info,
                                    const sgs_camera *camera, bool *display);

// Properties of a photo that is the display window of this file: its size, and unless the data
// window covers it, an alpha channel, which is 0 outside of the data window. Cannot fail.
sgsi_image_info sgsi_photo_display(const sgsi_image_info *file);

// Decoded size in bytes of such a photo at this resolution, including a mask.
size_t sgsi_photo_bytes(const sgsi_image_info *info, sgs_space space, int width, int height);

// Memory for decoding a photo, beside its decoded size: the file's pixels before they are reduced,
// and half a byte per pixel for rows and decoder.
size_t sgsi_photo_decode_bytes(const sgsi_image_info *info);

// Colour c of a pixel over a background: straight alpha, as the loss compares it.
static inline float sgsi_photo_over(const sgs_photo *photo, size_t c, size_t pixel,
                                    const float background[3])
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    if (photo->channels < 4)
        return sgs_photo_value(photo, c * plane + pixel);
    const float opaque = sgs_photo_value(photo, 3 * plane + pixel);
    return opaque * sgs_photo_value(photo, c * plane + pixel) + (1.0f - opaque) * background[c];
}

// The same of all pixels, clamped to [0, 1] and rounded to 8 bits: [3][height][width].
void sgsi_photo_over_bytes(const sgs_photo *photo, const float background[3], uint8_t *bytes);

// Frees the planes and keeps the other fields.
void sgsi_photo_release(sgs_photo *photo);

// Frees the contents and zeroes the struct; accepts an empty one.
void sgsi_photo_free(sgs_photo *photo);
