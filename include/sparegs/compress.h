// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Compression of a trained model to a small file, and back. Four published methods and FCGS-like,
// each with its own file layout inside a common container. Viewers cannot read these files: a
// decompressed model is written as PLY.
//
// Threads: calls on different models may run at the same time. The results do not depend on the
// number of threads; decompression gives the same bits on every machine.

#include <stdint.h>

#include "sparegs/gaussians.h"
#include "sparegs/image.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_compress_method {
    SGS_COMPRESS_LIGHTGAUSSIAN = 0, // Fan et al. 2024: vector quantisation of the SH coefficients
    SGS_COMPRESS_SOG = 1,           // Morgenstern et al. 2024: Self-Organizing Gaussians
    SGS_COMPRESS_MESONGS = 2,       // Xie et al. 2024: octree, RAHT, block quantisation
    SGS_COMPRESS_GHAP = 3,          // Gaussian Herding across Pens: mixture reduction
    SGS_COMPRESS_FCGS = 4,          // Chen et al. 2025: a trained network; UNSUPPORTED
    SGS_COMPRESS_FCGS_LIKE = 5      // a codec with the structure of FCGS, without its network
} sgs_compress_method;

// How SGS_COMPRESS_SOG stores its images, always without loss.
typedef enum sgs_image_codec {
    SGS_IMAGE_CODEC_JXL = 0,  // JPEG XL
    SGS_IMAGE_CODEC_WEBP = 1, // up to 8191 x 8191 primitives
    SGS_IMAGE_CODEC_EXR = 2   // OpenEXR with ZIP: about twice as large
} sgs_image_codec;

// A field that is 0 (-1 for finetune) takes the value of the preset. Fields of other methods are
// ignored.
typedef struct sgs_compress_options {
    size_t struct_size; // set by sgs_compress_options_default()
    sgs_compress_method method;
    int preset; // operating point, 1 (largest file) to 3; default 1
    uint64_t seed;
    // Views for importance, distillation and fine-tuning, with images if fine-tuning is on; NULL =
    // none. Only views of the training split are used.
    const sgs_scene *scene;
    // Filter and near distance of these views; NULL = the defaults with the near distance of the
    // scene, sgs_near_distance(scene->extent), as in training.
    const sgs_render_options *render;
    float background[3];
    int finetune; // iterations; -1 = the method's default: 0 without a scene
    // Fraction of the primitives to keep, in (0, 1]: LightGaussian, MesonGS, GHAP.
    double keep;
    double eig_min; // GHAP: lower limit of eigenvalues of the covariance, world units squared

    // SOG: bits per value of positions, band 0, other bands, scales, rotations, opacities; 1..15.
    int position_bits, dc_bits, sh_bits, scale_bits, rotation_bits, opacity_bits;
    sgs_image_codec codec;

    // LightGaussian. vq_ratio: fraction of the primitives whose SH coefficients are quantised.
    // half: store values that are not quantised as 16-bit floats. distill: iterations of the
    // distillation to SH degree 2, 0 = none.
    double vq_ratio;
    bool half;
    int distill;

    // LightGaussian and MesonGS: entries and steps of the codebook.
    int codebook, vq_steps;

    // MesonGS: levels of the octree (1..21), blocks per channel; cell_center decodes positions to
    // the centre of a cell instead of its lower corner.
    int depth, blocks;
    bool cell_center;

    double step_scale; // FCGS-like: multiplier of all quantiser steps

    // Recorded in the file if they are not the defaults: the model was trained with Mip-Splatting's
    // filters; the meaning of its colours.
    bool antialiased;
    sgs_model_colors colors;

    // Called with the name of the current stage and its progress, or NULL. Returning false
    // cancels.
    bool (*progress)(void *user, const char *stage, size_t done, size_t total);
    void *progress_user;
} sgs_compress_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_compress_options_init(sgs_compress_options *options, size_t size);
static inline sgs_compress_options sgs_compress_options_default(void)
{
    sgs_compress_options options;
    sgs_compress_options_init(&options, sizeof options);
    return options;
}

typedef struct sgs_compress_info {
    sgs_compress_method method;
    size_t input;     // primitives of the model that was compressed
    size_t gaussians; // primitives in the file
    size_t bytes;     // size of the file
    int sh_degree;    // of the model in the file
    bool antialiased; // as recorded in the file; see sgs_compress_options
    sgs_model_colors colors;
} sgs_compress_info;

// The name of a method, as on the command line: "lightgaussian"; NULL for an unknown method.
SGS_API const char *sgs_compress_method_name(sgs_compress_method method);
// The command-line name of the only option that the presets of a method set: "keep", "vq-ratio" or
// "step-scale"; NULL if they set several, or for an unknown method.
SGS_API const char *sgs_compress_preset_option(sgs_compress_method method);

// Compresses a model to `path`, atomically: on failure an existing file is unchanged. info may be
// NULL. Fails with INVALID_ARGUMENT (options out of range, a missing scene, a model that is empty,
// whose sh_degree is not within 0..3, or with a parameter that is not finite or a log scale above
// 44), UNSUPPORTED (SGS_COMPRESS_FCGS), OUT_OF_MEMORY, IO or CANCELLED. Infinite logits are stored
// as those of 1 - 1e-6 and 1e-6.
SGS_API sgs_status sgs_compress(const sgs_gaussians *model, const sgs_compress_options *options,
                                const char *path, sgs_compress_info *info);

// True if `path` is a regular file that begins as those of sgs_compress. Cannot fail.
SGS_API bool sgs_is_compressed(const char *path);
// Describes a file without decoding the primitives; their checksums are verified. Fails with IO,
// FORMAT, UNSUPPORTED or OUT_OF_MEMORY; *info is then unchanged.
SGS_API sgs_status sgs_compress_info_read(const char *path, sgs_compress_info *info);

// Decompresses a file; the caller destroys *model. info may be NULL. Fails with IO, FORMAT,
// UNSUPPORTED (a newer version), LIMIT or OUT_OF_MEMORY; the error names file and place, *model is
// then NULL.
SGS_API sgs_status sgs_decompress(const char *path, sgs_gaussians **model, sgs_compress_info *info);

#ifdef __cplusplus
}
#endif
