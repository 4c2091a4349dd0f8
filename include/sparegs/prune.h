// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Importance of the primitives of a trained model, and pruning by it. Scores of four published
// methods; what each primitive contributes to the training views. No training: fine-tune a pruned
// model with sgs_finetune (trainer.h).
//
// Threads: all functions may be called from any thread at any time; the model and the scene must
// not change meanwhile. Results do not depend on the number of threads, bit for bit.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/gaussians.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

// What to trace: the training views of a scene.
typedef struct sgs_view_pass_options {
    size_t struct_size; // set by sgs_view_pass_options_default()
    // Of the views; `differentiable` and `progress` are ignored. NULL = the defaults with the near
    // distance of the scene, sgs_near_distance(scene->extent), as in training.
    const sgs_render_options *render;
    int downscale;            // divisor of width and height, which are rounded up; 1..1024; 1
    sgs_progress_fn progress; // called after every view, or NULL
    void *progress_user;
} sgs_view_pass_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_view_pass_options_init(sgs_view_pass_options *options, size_t size);
static inline sgs_view_pass_options sgs_view_pass_options_default(void)
{
    sgs_view_pass_options options;
    sgs_view_pass_options_init(&options, sizeof options);
    return options;
}

// What a primitive contributes to views: sums over the counted hits of all rays, T the
// transmittance in front of the hit, o the opacity as traced (with the pixel filter's factor).
typedef struct sgs_contribution {
    double weight;  // sum of T alpha
    double front;   // sum of T o
    double hits;    // number of counted hits
    uint32_t views; // number of views with a counted hit
} sgs_contribution;

// contributions [model->count]: overwritten. The images of the scene need not be loaded. Fails with
// INVALID_ARGUMENT (options; no training view), UNSUPPORTED (a lens without rays), OUT_OF_MEMORY or
// CANCELLED.
SGS_API sgs_status sgs_contributions(const sgs_gaussians *model, const sgs_scene *scene,
                                     const sgs_view_pass_options *options,
                                     sgs_contribution *contributions);

// RAP's network, from the file of its authors: their weights are not part of this library.
typedef struct sgs_rap_network sgs_rap_network;

enum { SGS_RAP_FEATURES = 15 };

// Reads the weights from a file of torch.save. *network is NULL after a failure. Fails with IO,
// FORMAT (not this network, damaged, values that are not finite), LIMIT or OUT_OF_MEMORY.
SGS_API sgs_status sgs_rap_read(const char *path, sgs_rap_network **network);
// Accepts NULL.
SGS_API void sgs_rap_destroy(sgs_rap_network *network);

// RAP's features: comparisons with the 128 nearest neighbours (all, if there are fewer) and with
// the model, in [0, 1]. features: [model->count][SGS_RAP_FEATURES]; overwritten. progress: called
// during the computation, or NULL. Needs about 700 bytes per primitive. Fails with
// INVALID_ARGUMENT (fewer than two primitives, or a parameter is not finite), OUT_OF_MEMORY, LIMIT
// or CANCELLED.
SGS_API sgs_status sgs_rap_features(const sgs_gaussians *model, sgs_progress_fn progress,
                                    void *user, float *features);
// Name of feature k, or NULL. Owned by the library.
SGS_API const char *sgs_rap_feature_name(int k);
// The importance, in [0, 1], of a primitive with these features. Cannot fail.
SGS_API double sgs_rap_score(const sgs_rap_network *network,
                             const float features[SGS_RAP_FEATURES]);

typedef enum sgs_prune_method {
    SGS_PRUNE_LIGHTGAUSSIAN = 0, // LightGaussian, Fan et al. 2024: sum of T o, times volume^0.1
    SGS_PRUNE_REFINE = 1,        // REFINE, arXiv 2606.09074: closed form from the parameters
    // PUP 3D-GS, Hanson et al. 2025: log determinant of the Fisher matrix of position and log scale
    SGS_PRUNE_PUP = 2,
    SGS_PRUNE_RAP = 3 // RAP, CVPR 2026: a network on 15 features of the parameters
} sgs_prune_method;

typedef struct sgs_prune_options {
    size_t struct_size; // set by sgs_prune_options_default()
    sgs_prune_method method;
    const sgs_scene *scene;             // LightGaussian, PUP: its training views
    const sgs_view_pass_options *views; // LightGaussian, PUP; NULL = the defaults for the scene
    const double (*cameras)[3];         // REFINE: [camera_count] camera centres, world
    size_t camera_count;        // REFINE: > 0; of more than 64 a fixed random subset is used
    double volume_power;        // LightGaussian: exponent of the volume, 0..10; 0.1
    int fisher_downscale;       // PUP: replaces views->downscale; 1..1024; 4
    float background[3];        // PUP: of the views, in the space of the model; finite; black
    const sgs_rap_network *rap; // RAP
    sgs_progress_fn progress;   // RAP: called during the computation of the features, or NULL
    void *progress_user;
} sgs_prune_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_prune_options_init(sgs_prune_options *options, size_t size);
static inline sgs_prune_options sgs_prune_options_default(void)
{
    sgs_prune_options options;
    sgs_prune_options_init(&options, sizeof options);
    return options;
}

// Scores: [model->count], higher is more important; overwritten, finite. Fails with
// INVALID_ARGUMENT (options, missing inputs, a parameter that is not finite), as sgs_contributions,
// or with OUT_OF_MEMORY or CANCELLED. An infinite logit of the opacity is valid.
SGS_API sgs_status sgs_prune_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                                    double *scores);

// Selects the primitives that remain when the share `ratio` in [0, 1] is removed, by the rule of
// the method's released code. LightGaussian and PUP: all scores up to that of rank int(ratio (count
// - 1)) are removed, including ties. REFINE removes int(count ratio), RAP keeps int(count (1 -
// ratio)); among equal scores the first rows are removed. keep: [count], overwritten. *kept: their
// number. Fails with INVALID_ARGUMENT (ratio, or a score is NaN) or OUT_OF_MEMORY.
SGS_API sgs_status sgs_prune_select(sgs_prune_method method, const double *scores, size_t count,
                                    double ratio, bool *keep, size_t *kept);

// A new model of the rows with keep[i], in their order; keep: [model->count]. The caller destroys
// *out. Fails with OUT_OF_MEMORY; *out is then NULL.
SGS_API sgs_status sgs_gaussians_keep(const sgs_gaussians *model, const bool *keep,
                                      sgs_gaussians **out);

#ifdef __cplusplus
}
#endif
