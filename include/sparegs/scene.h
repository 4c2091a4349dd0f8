// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A data set made ready for training: views (camera, pose, photograph), the sparse point cloud, the
// split. From files (COLMAP, binary and text; NeRF/nerfstudio transforms) or from the caller's
// memory. Writes only cameras.json.
//
// Threads: sgs_scene_load, sgs_scene_create and calls on different scenes may run at the same time.
// On one scene, sgs_scene_photo and sgs_scene_prefetch take one call at a time; so one trainer at a
// time uses a scene whose photographs exceed options.image_cache. The rest of a scene is read only.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/camera.h"
#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_split { SGS_SPLIT_TRAIN = 0, SGS_SPLIT_TEST = 1, SGS_SPLIT_ALL = 2 } sgs_split;

typedef enum sgs_scene_format {
    SGS_SCENE_COLMAP_BINARY,
    SGS_SCENE_COLMAP_TEXT,
    SGS_SCENE_TRANSFORMS,
    SGS_SCENE_MEMORY // sgs_scene_create
} sgs_scene_format;

// What an alpha channel says. Over: the photograph is laid over the background, transparent pixels
// teach transparency. Mask: pixels of alpha below one half do not count, the others are opaque.
// Ignore: all are opaque.
typedef enum sgs_alpha { SGS_ALPHA_OVER = 0, SGS_ALPHA_MASK = 1, SGS_ALPHA_IGNORE = 2 } sgs_alpha;

typedef struct sgs_view {
    char *name;        // image name as the model writes it, relative, '/' separators
    char *image_path;  // file that was or would be read; the name again for SGS_SCENE_MEMORY
    char *mask_path;   // file that says which pixels count, or NULL
    sgs_camera camera; // at the size of `image` after down-scaling
    sgs_pose pose;
    sgs_split split; // SGS_SPLIT_TRAIN or SGS_SPLIT_TEST
    sgs_photo image; // empty (width 0) when images were not asked for; without planes when they are
                     // in the image cache
} sgs_view;

typedef struct sgs_scene_options {
    size_t struct_size;     // set by sgs_scene_options_default()
    const char *images_dir; // folder beside the sparse model; NULL = "images"
    int downscale;          // 0 = automatic: 1, or to 1600 px width with a warning; else >= 1, area
                            // averaging
    int test_every; // 0 = none; else index % test_every == 0 of the sorted names is held out, or,
                    // where the scene names test views of its own (transforms_test.json), these
    const char *test_images; // comma-separated names held out instead (name, or name without
                             // folder); NULL = none
    bool load_images;        // false: only cameras and points (image sizes are read from the files'
                             // headers)
    const char *masks_dir;   // folder of masks beside the image folder; "none" = no masks; NULL =
                             // "masks" or "mask" if there
    bool invert_masks;       // black counts instead of white
    sgs_alpha alpha;         // what alpha channels say
    const char *
        colorspace; // of the image files, instead of what they say themselves; NULL = what they say
    sgs_space space;    // to compare and train in
    size_t image_cache; // bytes of decoded photographs to keep in memory; 0 = all of them
    double white_point; // linear light that becomes 1; 0 = the 99th percentile where files are
                        // linear, else 1
    bool cameras_only;  // no photograph is looked for where the model tells its camera's size; with
                        // load_images false
    // Exact view names that are held out instead of what test_every and test_images select, as a
    // run recorded them. Names without a view are ignored. NULL = no such list; an empty list holds
    // out nothing.
    const char *const *held_out;
    size_t held_out_count;
    // Hold out the test views that the data set names, also with test_every 0.
    bool own_split;
    // Called after every view that was looked at or decoded, or NULL. Cancelling makes
    // sgs_scene_load and sgs_scene_create fail with SGS_STATUS_CANCELLED.
    sgs_progress_fn progress;
    void *progress_user;
} sgs_scene_options;

// Everything zero but struct_size and load_images, which is true.
SGS_API sgs_scene_options sgs_scene_options_default(void);

typedef struct sgs_scene {
    sgs_scene_format format;
    char *path;        // as given
    char *model_path;  // folder or file the cameras came from
    size_t view_count; // sorted by name (strcmp)
    sgs_view *views;
    size_t point_count;    // sparse cloud, finite points only
    float *points;         // [point_count][3], world
    uint8_t *colors;       // [point_count][3]
    size_t images_missing; // registered images without a readable file (skipped)
    size_t images_unposed; // files in the image folder without a pose (ignored)
    size_t masks;          // views with a mask file
    size_t pixels_broken;  // pixels of the photographs that hold no number (ignored)
    size_t photo_bytes;    // that all photographs take in memory, whether they are there or not; 0
                           // with cameras_only
    struct sgs_scene_store
        *store;            // internal: the image cache; NULL = all photographs are in `views`
    sgs_space space;       // of photographs and trained colours
    double white_point;    // linear light that is 1 in them; 1 where no file is linear
    size_t linear_images;  // photographs in linear light; others do not depend on white_point
    bool has_alpha;        // any image has an alpha channel
    bool white_background; // NeRF synthetic convention: white unless the user says otherwise
    double center[3];      // mean of the training camera centres, world
    double extent; // 1.1 * max distance of a training camera to the centre (cameras_extent in
                   // 3DGS); > 0
} sgs_scene;

// Loads a scene. On failure *scene is NULL. Missing or broken images are skipped with a warning and
// counted; it is an error (SGS_STATUS_IO) only when none is left. A mask that does not fit its
// photograph is an error, a mask that covers everything drops its view. A scene without points
// loads.
//
// Masks are looked for as MASKS/STEM.png, MASKS/NAME.png (with the photograph's own extension
// before .png), and STEM_mask.png beside the photograph. White (mean of the channels >= 128)
// counts. A pixel of a reduced photograph counts when all of its area does.
SGS_API sgs_status sgs_scene_load(const char *path, const sgs_scene_options *options,
                                  sgs_scene **scene);

// How the pixels of an sgs_view_source are stored. Alpha is straight.
typedef enum sgs_pixel_type {
    SGS_PIXEL_UINT8 = 0, // 255 is 1; colours encoded as sRGB
    SGS_PIXEL_HALF = 1,  // IEEE 754 binary16; colours are linear light, Rec. 709 primaries
    SGS_PIXEL_FLOAT = 2  // likewise
} sgs_pixel_type;

// A view in the caller's memory. Initialise to zero, then set at least camera, pose, channels and
// pixels.
typedef struct sgs_view_source {
    const char *name;  // unique; NULL = "view_000012" for index 12
    sgs_camera camera; // at the size of the image
    sgs_pose pose;
    sgs_split split; // SGS_SPLIT_TRAIN or SGS_SPLIT_TEST
    sgs_pixel_type pixel_type;
    int channels; // 3 (RGB) or 4 (RGBA)
    // The upper left pixel. NULL = a view without a photograph, which is neither trained on nor
    // compared.
    const void *pixels;
    // Bytes from a channel to the next one, from a pixel to the next one of its row, and from a row
    // to the next lower one; may be negative. 0 = packed: channels of a pixel are adjacent. An
    // sgs_image8 has channel_stride width * height and pixel_stride 1.
    ptrdiff_t channel_stride, pixel_stride, row_stride;
    // The upper left pixel of an 8-bit mask of the same size: pixels of at least 128 are valid
    // (below 128 with options->invert_masks). NULL = all are.
    const uint8_t *mask;
    ptrdiff_t mask_pixel_stride, mask_row_stride; // likewise
} sgs_view_source;

// Makes a scene from memory. Everything is copied; the caller's memory may go afterwards. points
// [point_count][3] world, colors [point_count][3] 8-bit sRGB; both may be NULL with point_count 0,
// colors alone NULL for grey points. Of the options, test_every, test_images, held_out (else each
// source's own split), invert_masks, alpha, space, white_point and progress apply; options NULL =
// the defaults. The scene's views are sorted by name. Pixels with a NaN or an infinite channel are
// not valid.
//
// Fails with INVALID_ARGUMENT, naming view and field, for a camera, pose, channel count, stride or
// point that is out of range or not finite, duplicate names, a mask that excludes every pixel, or
// no training view; OUT_OF_MEMORY; CANCELLED. On failure *scene is NULL.
SGS_API sgs_status sgs_scene_create(const sgs_view_source *views, size_t view_count,
                                    const float *points, const uint8_t *colors, size_t point_count,
                                    const sgs_scene_options *options, sgs_scene **scene);

// Accepts NULL.
SGS_API void sgs_scene_destroy(sgs_scene *scene);

// The photograph of view `index`, from memory or decoded now. Valid until the next call for this
// scene; one thread at a time. Fails as loading does, when its file has gone or changed since.
SGS_API sgs_status sgs_scene_photo(const sgs_scene *scene, size_t index, const sgs_photo **photo);

// Announces that this photograph will be asked for soon: a thread decodes it ahead, where it is not
// in memory. Cannot fail.
SGS_API void sgs_scene_prefetch(const sgs_scene *scene, size_t index);

// Index of the view called NAME (exact, then without folder, then without extension), or -1.
SGS_API ptrdiff_t sgs_scene_find_view(const sgs_scene *scene, const char *name);

// Writes the cameras.json of 3DGS (id, img_name, width, height, position, camera-to-world rotation
// rows, fy, fx; held-out views first), atomically. Fails with IO or OUT_OF_MEMORY.
SGS_API sgs_status sgs_scene_write_cameras_json(const sgs_scene *scene, const char *path);

#ifdef __cplusplus
}
#endif
