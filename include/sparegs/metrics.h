// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Image quality as in the 3DGS papers: 8-bit quantised images, PSNR over all pixels and channels,
// SSIM with an 11x11 Gaussian window and zero padding; also FLIP, sharpness and LPIPS. Pure
// functions.
//
// Threads: all functions may be called from any thread at any time.

#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

// Quantises planar float RGB ([3][height*width], display values) as 3DGS does: floor(clamp(255 v +
// 0.5, 0, 255)); NaN becomes 0. In C, planes of sgs_frame need a cast: (const float *const *). If
// `transmittance` is not NULL, adds `background` times it.
// Allocates out->pixels; release it with sgs_image8_free. Fails with INVALID_ARGUMENT (size, NULL
// planes) or OUT_OF_MEMORY; *out is then empty.
SGS_API sgs_status sgs_image8_from_planes(const float *const color[3], const float *transmittance,
                                          const float background[3], int width, int height,
                                          sgs_image8 *out);

// The 8-bit image of a render that `eval` compares. As sgs_image8_from_planes, of colours and
// background in `space`; linear light is encoded as sRGB before the quantisation. transmittance:
// NULL = the colours contain the background; background: may be NULL without transmittance. Release
// with sgs_image8_free. Fails as sgs_image8_from_planes.
SGS_API sgs_status sgs_image8_from_render(const float *const color[3], const float *transmittance,
                                          const float background[3], sgs_space space, int width,
                                          int height, sgs_image8 *out);

// The photo over `background`, both in the space of the photo. planes: [3][height][width]. Cannot
// fail.
SGS_API void sgs_photo_flatten(const sgs_photo *photo, const float background[3], float *planes);

// The 8-bit image of a photo that `eval` compares: flattened, and quantised as the render. space:
// of the scene of the photo. Pixels outside of its valid mask have any value. Release with
// sgs_image8_free. Fails with INVALID_ARGUMENT (size) or OUT_OF_MEMORY; *out is then empty.
SGS_API sgs_status sgs_image8_from_photo(const sgs_photo *photo, const float background[3],
                                         sgs_space space, sgs_image8 *out);

// 20 log10(1 / sqrt(MSE)) in dB over the first three channels; +infinity for identical images. NaN
// if the sizes differ or an image has fewer than three channels.
SGS_API double sgs_psnr(const sgs_image8 *a, const sgs_image8 *b);

// Mean SSIM over pixels and three channels, in [-1, 1]. Double precision, separable. NaN as
// sgs_psnr, and if out of memory.
SGS_API double sgs_ssim(const sgs_image8 *a, const sgs_image8 *b);

// The same over the valid pixels only (`valid_mask` as in sgs_photo; NULL = all). Invalid pixels
// have no influence: SSIM treats them as black in both images and skips the windows centred on
// them. NaN if no pixel is valid.
SGS_API double sgs_psnr_masked(const sgs_image8 *a, const sgs_image8 *b,
                               const uint16_t *valid_mask);
SGS_API double sgs_ssim_masked(const sgs_image8 *a, const sgs_image8 *b,
                               const uint16_t *valid_mask);

// Pixels per degree of vision at which FLIP is reported.
#define SGS_FLIP_PIXELS_PER_DEGREE 67.0

// FLIP error of `test` against `reference` (Andersson et al. 2020, low dynamic range): per pixel in
// [0, 1], 0 = no visible difference when the two images alternate on a screen. Display values
// (sRGB). Sizes must match; three channels are used. Pixels outside valid_mask ([height][(width +
// 15) / 16], NULL = all pixels valid) are black in both images and have error 0. map:
// [height][width], written, or NULL. *mean: mean error over valid pixels, NaN where none is. Fails
// with INVALID_ARGUMENT (sizes, pixels_per_degree outside (0, 3700]) or OUT_OF_MEMORY.
SGS_API sgs_status sgs_flip(const sgs_image8 *reference, const sgs_image8 *test,
                            const uint16_t *valid_mask, double pixels_per_degree, float *map,
                            double *mean);

// LPIPS, a distance of images in the features of a network (Zhang et al., "The Unreasonable
// Effectiveness of Deep Features as a Perceptual Metric", CVPR 2018, version 0.1). The weights are
// not part of this library: tools/scripts/lpips_weights.py converts the published files.
typedef struct sgs_lpips sgs_lpips;

// Range of the values that the network sees. 3DGS and its successors report SGS_LPIPS_UNIT; the
// authors of LPIPS scale to [-1, 1].
typedef enum sgs_lpips_input {
    SGS_LPIPS_UNIT,  // [0, 1]
    SGS_LPIPS_SIGNED // [-1, 1]
} sgs_lpips_input;

// Reads the weights of VGG16 or AlexNet; *lpips is NULL after a failure. Fails with IO, FORMAT
// (wrong size or order, damaged, values that are not finite, negative heads), UNSUPPORTED (version,
// network) or OUT_OF_MEMORY.
SGS_API sgs_status sgs_lpips_read(const char *path, sgs_lpips **lpips);
// Accepts NULL.
SGS_API void sgs_lpips_destroy(sgs_lpips *lpips);
// "vgg" or "alex"; owned by the library.
SGS_API const char *sgs_lpips_network(const sgs_lpips *lpips);
// Smallest width and height of an image, pixels.
SGS_API int sgs_lpips_min_size(const sgs_lpips *lpips);

// LPIPS of two images, 0 = equal. Display values (sRGB). Sizes must match; three channels are used.
// Invalid pixels (valid_mask as in sgs_flip) are black in both images, and each feature is weighted
// by the fraction of valid pixels in its cell of the image. Uses all threads. *distance: NaN where
// no pixel is valid, and after a failure. Fails with INVALID_ARGUMENT (sizes; images smaller than
// 16 pixels with vgg, 31 with alex) or OUT_OF_MEMORY.
SGS_API sgs_status sgs_lpips_distance(const sgs_lpips *lpips, sgs_lpips_input input,
                                      const sgs_image8 *a, const sgs_image8 *b,
                                      const uint16_t *valid_mask, double *distance);

// Sharpness of a render: the energy (sum of squares) of the 5-point Laplacian of its luma (0.299,
// 0.587, 0.114), relative to that of the photo. 1 = as much detail as the photo, below 1
// = blurred, above 1 = noisier. Counts pixels that are valid and have four valid neighbours. NaN if
// sizes differ or the photo has no detail (energy 0).
SGS_API double sgs_sharpness(const sgs_image8 *render, const sgs_image8 *photo,
                             const uint16_t *valid_mask);

#ifdef __cplusplus
}
#endif
