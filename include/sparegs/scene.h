// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A data set on disk made ready for training: views (camera, pose, photograph), the sparse point
// cloud, the split. Reads COLMAP (binary and text) and NeRF/nerfstudio transforms. Writes only cameras.json.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_split { SGS_SPLIT_TRAIN = 0, SGS_SPLIT_TEST = 1, SGS_SPLIT_ALL = 2 } sgs_split;

typedef enum sgs_scene_format { SGS_SCENE_COLMAP_BINARY, SGS_SCENE_COLMAP_TEXT, SGS_SCENE_TRANSFORMS } sgs_scene_format;

// A photograph: planar 8-bit, display-encoded (sRGB as stored in the file). Plane c starts at
// pixels + c * width * height; row-major, top row first. channels is 3 (RGB) or 4 (RGB and straight alpha).
typedef struct sgs_image8 {
    int width, height, channels;
    uint8_t *pixels; // 64-byte aligned
} sgs_image8;

typedef struct sgs_view {
    char *name;        // image name as the model writes it, relative, '/' separators
    char *image_path;  // file that was or would be read
    sgs_camera camera; // at the size of `image` after down-scaling
    sgs_pose pose;
    sgs_split split;   // SGS_SPLIT_TRAIN or SGS_SPLIT_TEST
    sgs_image8 image;  // pixels is NULL when images were not asked for
} sgs_view;

typedef struct sgs_scene_options {
    const char *images_dir;   // folder beside the sparse model; NULL = "images"
    int downscale;            // 0 = automatic: 1, or to 1600 px width with a warning; else >= 1, area averaging
    int test_every;           // 0 = none; else index % test_every == 0 of the sorted names is held out
    const char *test_images;  // comma-separated names held out instead (name, or name without folder); NULL = none
    int load_images;          // 0: only cameras and points (image sizes are read from the files' headers)
} sgs_scene_options;

// {NULL, 0, 0, NULL, 1}
sgs_scene_options sgs_scene_options_default(void);

typedef struct sgs_scene {
    sgs_scene_format format;
    char *path;             // as given
    char *model_path;       // folder or file the cameras came from
    size_t view_count;      // sorted by name (strcmp)
    sgs_view *views;
    size_t point_count;     // sparse cloud, finite points only
    float *points;          // [point_count][3], world
    uint8_t *colors;        // [point_count][3]
    size_t images_missing;  // registered images without a readable file (skipped)
    size_t images_unposed;  // files in the image folder without a pose (ignored)
    int has_alpha;          // any image has an alpha channel
    int white_background;   // NeRF synthetic convention: white unless the user says otherwise
    double center[3];       // mean of the training camera centres, world
    double extent;          // 1.1 * max distance of a training camera to the centre (specs: nerf++ norm); > 0
} sgs_scene;

// Loads a scene. On failure *scene is NULL. Missing or broken images are skipped with a warning and
// counted; it is an error (SGS_STATUS_IO) only when none is left. A scene without points loads.
// Thread rule: may use the library's threads; call from one thread.
sgs_status sgs_scene_load(const char *path, const sgs_scene_options *options, sgs_scene **scene);

// Accepts NULL.
void sgs_scene_destroy(sgs_scene *scene);

// Index of the view called NAME (exact, then without folder, then without extension), or -1.
ptrdiff_t sgs_scene_find_view(const sgs_scene *scene, const char *name);

// Writes the cameras.json of 3DGS (id, img_name, width, height, position, camera-to-world rotation rows, fy, fx;
// held-out views first), atomically. Fails with IO or OUT_OF_MEMORY.
sgs_status sgs_scene_write_cameras_json(const sgs_scene *scene, const char *path);

#ifdef __cplusplus
}
#endif
