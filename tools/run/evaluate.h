// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Image quality by the protocol of the 3DGS papers: each view is rendered, quantised to 8 bits and
// compared with its photo (PSNR, SSIM, FLIP, sharpness, LPIPS). Writes no files.

#include <jansson.h>

#include "arguments/shared_options.h"
#include "sparegs/metrics.h"
#include "sparegs/rank_renderer.h"

typedef struct evaluator {
    const sgs_scene *scene; // with images
    sgs_renderer *renderer; // or, for a model that the ranks share:
    sgs_rank_renderer *rank_renderer;
    sgs_render_options render;
    float background[3];
    sgs_frame frame; // of the last view: most have the same size
    // Set after opening, or left NULL:
    const json_t *exposures; // of OUT/exposure.json
    const sgs_lpips *lpips;
    sgs_lpips_input lpips_input;
} evaluator;

// Creates the renderer for a model, which must outlive the evaluator. False after printing the
// error.
bool evaluator_open(evaluator *evaluation, const sgs_gaussians *model, const sgs_scene *scene,
                    const drawing_values *drawing);
// The same for a model file whose primitives several ranks share; only rank 0 reads it. Such an
// evaluator scores with evaluate_views and evaluate_split only. Collective.
bool evaluator_open_shared(evaluator *evaluation, const char *path, const sgs_scene *scene,
                           const drawing_values *drawing);
void evaluator_close(evaluator *evaluation);

// Reads the weights of LPIPS from a file (NULL: none) and checks that all photos of the scene
// are large enough. False after printing the error.
bool evaluate_lpips(const char *path, const sgs_scene *scene, sgs_lpips **lpips);

// The figures of sparegs/metrics.h; FLIP at SGS_FLIP_PIXELS_PER_DEGREE.
typedef struct view_score {
    double psnr, ssim, flip;
    double sharpness; // NaN if the photo is flat
    double lpips;     // NaN without weights
    double seconds;   // of the rendering; those of a shared model: per image
} view_score;

// The images that were compared, 8-bit, and the FLIP error per pixel.
typedef struct view_images {
    sgs_image8 drawn, photo;
    float *flip_map; // [height][width]
} view_images;

// Scores one view. `images`, if not NULL, receives the images. False after printing the error;
// `images` is then empty.
bool evaluate_view(evaluator *evaluation, const sgs_view *view, view_score *score,
                   view_images *images);
void view_images_free(view_images *images);

// For one process: decodes the next photos in advance, those of the views of the split from `next`
// on.
void evaluate_prefetch(const sgs_scene *scene, sgs_split split, size_t next);

// PSNR of an image that is identical to its photo in the mean of a split: the mean of an
// infinite value would be infinite.
#define IDENTICAL_PSNR 100.0

typedef struct split_score {
    size_t images, identical; // identical images are among `images`
    size_t sharp_images;      // images whose photo is not flat
    size_t views;             // of the split, if not all of them were to be scored; else 0
    bool is_stopped;          // by a request
    view_score mean;          // sharpness: over sharp_images
} split_score;

// Adds a view to the sums in sum->mean. A view without a valid pixel is skipped with a warning.
void split_score_add(split_score *sum, const sgs_view *view, const view_score *score);
// Turns the sums into means; NaN where there is no image.
void split_score_finish(split_score *sum);

// Scores of a split on all ranks, [view_count]; is_scored is false after a request to stop.
typedef struct rank_score {
    view_score score;
    bool is_scored;
} rank_score;

// Scores at most `most` views of the split, evenly spaced: the i-th of them on rank i modulo the
// number of ranks; all receive all scores. save: called with the images of each own view, or NULL;
// NULL for a shared model. False after printing the error. Collective.
typedef bool (*evaluate_save)(void *context, size_t view, const view_images *images);
bool evaluate_views(evaluator *evaluation, sgs_split split, size_t most, const char *label,
                    evaluate_save save, void *context, rank_score *scores);

// Scores at most `most` views of a split, evenly spaced. A request to stop (interrupt.h) ends it
// early with images = 0 and is_stopped. False after printing the error. Collective.
bool evaluate_split(evaluator *evaluation, sgs_split split, size_t most, split_score *score);

enum { SHARPNESS_TEXT = 32 };
// The sharpness right-aligned in `width` columns, "-" if it is NaN. Returns `text`.
char *sharpness_format(char text[SHARPNESS_TEXT], double sharpness, int width, int decimals);
// Adds "psnr" (null if infinite), "ssim", "flip", "sharpness" and "lpips" to a JSON object. NaN
// becomes null.
void view_score_add_json(json_t *object, const view_score *score);
// {"images":n,"identical":n}, the means and "seconds_per_image".
json_t *split_score_json(const split_score *score);
// Prints "LABEL PSNR ..." to stdout; nothing without images.
void split_score_print(const char *label, const split_score *score);
