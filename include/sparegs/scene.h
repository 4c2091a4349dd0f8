// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Data sets for training: views (camera, pose, photo), the sparse point cloud and the split,
// from files (COLMAP, binary or text; NeRF/nerfstudio transforms) or from the caller's memory. Also
// cameras.json, the only file it writes.
//
// Threads: sgs_scene_load, sgs_scene_create and calls on different scenes may run at the same time.
// On one scene, sgs_scene_photo and sgs_scene_prefetch take one call at a time: only one trainer at
// a time may use a scene whose photos exceed options.image_cache. A scene is otherwise
// read-only; sgs_scene_photo_read may be called by any thread at any time.

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

// Meaning of an alpha channel. Over: photos are composited over the background, so that
// transparent pixels train transparency. Mask: pixels with alpha below 0.5 are invalid, the others
// opaque. Ignore: all pixels are opaque.
typedef enum sgs_alpha { SGS_ALPHA_OVER = 0, SGS_ALPHA_MASK = 1, SGS_ALPHA_IGNORE = 2 } sgs_alpha;

typedef struct sgs_view {
    char *name;        // image name in the model, a relative path with '/' separators
    char *image_path;  // the image file; the name again for SGS_SCENE_MEMORY
    char *mask_path;   // file of the valid mask, or NULL
    sgs_camera camera; // at the size of `image`, after down-scaling
    // At the size of the image file (or of its display window), before down-scaling, which may
    // round width and height differently. Without files: the camera before down-scaling.
    sgs_camera file_camera;
    sgs_pose pose;
    sgs_split split; // SGS_SPLIT_TRAIN or SGS_SPLIT_TEST
    // Width 0 without load_images. No pixels if the photo is in the image cache: call
    // sgs_scene_photo.
    sgs_photo image;
    // Exif orientation of the image file, 1 to 8; 0 = not read. Not applied: pixels, camera and
    // pose are those of the stored image. It records how the camera was held.
    int orientation;
    // The photo is the display window of an EXR file with another data window. Outside of the data
    // window, alpha is 0.
    bool display_window;
} sgs_view;

typedef struct sgs_scene_options {
    size_t struct_size; // set by sgs_scene_options_default()
    // Image folder next to the sparse model, or an absolute path; NULL = "images". For
    // transforms.json, whose names include the folder, this folder replaces the top folder that all
    // names share; NULL = as named.
    const char *images_dir;
    // Divisor of width and height (area average), >= 1; 0 = automatic: 1, or the width is reduced
    // to 1600 pixels with a warning.
    int downscale;
    // Held-out views: the views i of the sorted names with i % test_every == 0, or, if the data set
    // names test views (transforms_test.json), those. 0 = none.
    int test_every;
    // Held-out views by name instead, separated by commas (with or without folder); NULL = none.
    const char *test_images;
    // false: only cameras and points; sizes are read from the headers of the image files.
    bool load_images;
    // Folder of masks next to the image folder; "none" = no masks; NULL = "masks" or "mask" if
    // present, in upper or lower case.
    const char *masks_dir;
    bool invert_masks; // black is valid instead of white, in masks of instant-ngp the reverse
    sgs_alpha alpha;
    // Colour space of the image files (an ID of the Color Interop Forum, or a name of OpenImageIO
    // or OpenColorIO). NULL = as each file declares; without a declaration floats are linear,
    // integers sRGB.
    const char *colorspace;
    sgs_space space; // of loss, trained colours and metrics
    // Memory for decoded photos in bytes; 0 = unlimited, all are kept.
    size_t image_cache;
    // Scene-linear light that maps to 1; 0 = the 99th percentile if any file is scene-linear, else
    // 1. It is measured in at most 16 of these photos, and without load_images only with
    // measure_white_point. Files whose values are encoded for display keep 1 as white.
    double white_point;
    // Do not look for the photos of cameras whose size the model gives. Requires load_images
    // false.
    bool cameras_only;
    // Names of held-out views as recorded by a run, replacing test_every and test_images, found by
    // sgs_scene_find_recorded. Names without a view are ignored. NULL = no list; an empty list
    // holds out nothing.
    const char *const *held_out;
    size_t held_out_count;
    // Hold out the test views that the data set names, even if test_every is 0. With both, there is
    // no warning that such views replace those of test_every.
    bool use_dataset_split;
    // Exact names of the views to keep; names without a view are ignored. The other views are
    // included in split, white point, center, extent and digest, and then dropped without being
    // decoded. NULL = keep all. Not used by sgs_scene_create.
    const char *const *kept;
    size_t kept_count;
    // Called after every view that was examined or decoded, or NULL. If it returns false,
    // sgs_scene_load and sgs_scene_create fail with SGS_STATUS_CANCELLED.
    sgs_progress_fn progress;
    void *progress_user;
    // With load_images false: measure the white point even so, as described at white_point.
    bool measure_white_point;
    // With cameras_only: size in pixels, before downscaling, of views without a size in the camera
    // file or a readable photo. 0 = such views are skipped.
    int view_width, view_height;
    // Memory in bytes for photos that are decoded at the same time, in addition to image_cache:
    // each has about 3.5 bytes per pixel of its file, 4.5 with alpha. One is always decoded. 0 = an
    // eighth of sgs_machine_memory.
    size_t decode_memory;
    // With load_images false: read only the headers of image files. Truncated files are then not
    // found and count as views. Otherwise each file is read once to find them.
    bool headers_only;
} sgs_scene_options;

// Writes the defaults to a struct of `size` bytes, see status.h: all zero, except struct_size and
// load_images (true). Cannot fail.
SGS_API void sgs_scene_options_init(sgs_scene_options *options, size_t size);
static inline sgs_scene_options sgs_scene_options_default(void)
{
    sgs_scene_options options;
    sgs_scene_options_init(&options, sizeof options);
    return options;
}

typedef struct sgs_scene {
    sgs_scene_format format;
    char *path;       // as given to sgs_scene_load
    char *model_path; // folder or file of the cameras
    size_t view_count;
    sgs_view *views;         // [view_count], sorted by name (strcmp)
    size_t point_count;      // sparse cloud, finite points only
    float *points;           // [point_count][3], world
    uint8_t *colors;         // [point_count][3], sRGB
    size_t images_missing;   // views skipped because their image file is missing or unreadable
    size_t images_unposed;   // files in the image folder without a pose (ignored)
    size_t masks;            // views with a mask file, also if it excludes every pixel
    size_t pixels_nonfinite; // pixels with NaN or infinite values; they are invalid
    size_t photo_bytes;      // size of all photos when decoded; 0 with cameras_only
    struct sgs_scene_store *store; // internal: the image cache; NULL = all photos are in views
    sgs_space space;               // of photos and trained colours
    double white_point;            // linear light that maps to 1; 1 if no file is scene-linear
    size_t linear_images;          // scene-linear photos in use, which white_point applies to
    size_t float_images;           // photos kept in half floats: HDR, 16-bit, linear space
    bool has_alpha;                // some photo has an alpha channel, regardless of `alpha`
    bool white_background;         // NeRF synthetic convention: white unless the caller sets it
    double center[3];              // mean of the training camera centres, world
    // World units, > 0: 1.1 times the largest distance of a training camera to the centre
    // (cameras_extent of 3DGS). If the cameras coincide, half of the median distance of the points
    // to the centre, or 1.
    double extent;
    // Identifies the names and poses of all views and the sparse points; independent of the size of
    // the photos.
    uint64_t digest;
    char *colorspace; // options.colorspace, or NULL
    sgs_alpha alpha;  // options.alpha
    // Bytes for decoding the largest photo, 0 with cameras_only; options.decode_memory, or its
    // default. Both are 0 after sgs_scene_create, which decodes nothing.
    size_t decode_bytes, decode_limit;
    // Largest ratio of the width of an image file to the width in use, >= 1: options.downscale, or
    // what the automatic reduction did.
    double reduction;
    // Colour spaces of the image files, separated by commas, in the order of the views: sRGB,
    // linear, or a name of the files or of options.colorspace. NULL with cameras_only, after
    // sgs_scene_create, and without memory.
    char *color_spaces;
} sgs_scene;

// Loads a scene; release it with sgs_scene_destroy. options NULL = the defaults. Missing or
// unreadable images are skipped with a warning and counted. A view whose mask excludes every pixel
// is dropped. A scene may have no points.
//
// Photos that are not kept in memory (image_cache, load_images false) are read again later. With a
// relative path, the working directory must then be the same.
//
// Masks are looked up as MASKS/STEM.png, MASKS/NAME.png (NAME with the photo's extension),
// MASKS/STEM_mask.png, the same as JPEG and TIFF, and STEM_mask.png next to the photo. White (mean
// of the colours times alpha >= 128; all but 0 if none is) is valid. Alpha alone decides, with a
// warning, if it varies and the visible colours are neither white nor, as in a mask, of two values.
// Last, instant-ngp's dynamic_mask_STEM.png next to the photo: black is valid. A pixel of a
// down-scaled photo is valid if its whole area is.
//
// Fails with INVALID_ARGUMENT (options; all views held out; masks exclude everything), IO (a file
// is missing or not accessible, or no image is readable), FORMAT (invalid file, no lens with a ray,
// or a mask whose size differs from its photo), UNSUPPORTED (for example a camera model),
// OUT_OF_MEMORY or CANCELLED. The error names file, place and fix. On failure *scene is NULL.
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
    // The upper left pixel. NULL = a view without a photo: excluded from training and metrics.
    const void *pixels;
    // Bytes from one channel, pixel or row to the next (rows from top to bottom); may be negative.
    // 0 = packed: the channels of a pixel are adjacent. An sgs_image8 has channel_stride width *
    // height and pixel_stride 1.
    ptrdiff_t channel_stride, pixel_stride, row_stride;
    // The upper left pixel of an 8-bit mask of the same size: pixels of at least 128 are valid
    // (below 128 with options->invert_masks). NULL = all pixels are.
    const uint8_t *mask;
    ptrdiff_t mask_pixel_stride, mask_row_stride; // likewise
} sgs_view_source;

// Creates a scene from memory; release it with sgs_scene_destroy. All arrays are copied. points:
// [point_count][3], world, or NULL with point_count 0; colors: [point_count][3], 8-bit sRGB, or
// NULL for grey points. options NULL = the defaults; these apply: test_every, test_images and
// held_out (without them each source's own split), invert_masks, alpha, space, white_point and
// progress. The scene's views are sorted by name. Pixels with NaN or infinite channels are invalid.
//
// Fails with INVALID_ARGUMENT (the error names view and field) for a camera, pose, channel count,
// stride or point that is out of range or not finite, duplicate names, a mask or a lens that
// excludes every pixel, or no training view; with OUT_OF_MEMORY or CANCELLED. On failure *scene is
// NULL.
SGS_API sgs_status sgs_scene_create(const sgs_view_source *views, size_t view_count,
                                    const float *points, const uint8_t *colors, size_t point_count,
                                    const sgs_scene_options *options, sgs_scene **scene);

// Frees the scene and everything in it. Accepts NULL.
SGS_API void sgs_scene_destroy(sgs_scene *scene);

// The photo of view `index`, decoded if it is not in memory. Owned by the scene; valid until
// the next call for this scene; one thread at a time. Fails like sgs_scene_load if the file was
// removed or changed, and with INVALID_ARGUMENT for an index that is out of range; *photo is then
// NULL.
SGS_API sgs_status sgs_scene_photo(const sgs_scene *scene, size_t index, const sgs_photo **photo);

// Decodes the photo of view `index` for the caller, area-averaged to width x height pixels, at
// most the size of its file: the values of sgs_scene_photo at the size of the view's camera, also
// for scenes without load_images. Without masks: valid_mask is NULL, all pixels are kept. Neither
// uses nor changes the image cache, so any thread may call it while a trainer uses the scene.
// Release with sgs_photo_free. Fails like sgs_scene_photo, with FORMAT for a size above that of
// the file, and with INVALID_ARGUMENT for an index that is out of range, a size below 1 and
// SGS_SCENE_MEMORY; *photo is then empty.
SGS_API sgs_status sgs_scene_photo_read(const sgs_scene *scene, size_t index, int width, int height,
                                        sgs_photo *photo);

// Hint that sgs_scene_photo will soon be called for this view: a thread decodes the photo in
// advance, unless it is in memory. Cannot fail.
SGS_API void sgs_scene_prefetch(const sgs_scene *scene, size_t index);

// Number of views, of those that follow the one in use, that sgs_scene_prefetch should be called
// for: one more than the number of decoding threads; 0 if all photos are in memory. Cannot fail.
SGS_API size_t sgs_scene_prefetch_count(const sgs_scene *scene);

// How `name` denotes a view: 0 exactly, 1 without folder, 2 without extension, -1 not at all.
// Cannot fail.
SGS_API int sgs_view_name_match(const char *view_name, const char *name);

// Index of the view with the best such match (the smallest number), or -1. Cannot fail.
SGS_API ptrdiff_t sgs_scene_find_view(const sgs_scene *scene, const char *name);

// views[k] = index of the view with the name names[k] that a run recorded, or -1. If none of the
// names is that of a view, views[k] = the only view whose name is names[k] with more or fewer
// folders in front ("images/a.png" for "a.png"), unless several names denote that view. A name may
// be NULL. `names` and `views` have `count` elements. Cannot fail.
SGS_API void sgs_scene_find_recorded(const sgs_scene *scene, const char *const *names, size_t count,
                                     ptrdiff_t *views);

typedef struct sgs_named_camera {
    const char *name; // required for writing; NULL after reading a file without names
    sgs_camera camera;
    sgs_pose pose;
    int orientation; // Exif, of the image file, 1 to 8; 0: unknown
} sgs_named_camera;

// Writes the cameras.json of 3DGS (id from 0, img_name, width, height, position, camera-to-world
// rotation rows, fy, fx) atomically, and, which 3DGS does not, cx, cy, camera_model (a name of
// sgs_camera_model_name) and params, and exif_orientation if it exceeds 1. Bytes of names that are
// not UTF-8 become '?'. Fails with INVALID_ARGUMENT (a camera, pose or name; the message names its
// index), IO or OUT_OF_MEMORY.
SGS_API sgs_status sgs_cameras_write_json(const sgs_named_camera *cameras, size_t count,
                                          const char *path);
// The same for the views of a scene, held-out views first.
SGS_API sgs_status sgs_scene_write_cameras_json(const sgs_scene *scene, const char *path);

// Reads a cameras.json of any 3DGS program: a list of cameras, or one. Without cx and cy, the
// principal point is the image centre; without camera_model and params, the lens is a pinhole; cx
// and cy replace those of params. Rotations must be orthonormal to 1e-3; poses are made exact, as
// by sgs_pose_orthonormalize. A byte order mark is skipped. An empty list succeeds with *count 0.
// Release *cameras [*count] with sgs_cameras_free; it owns the names. Fails with IO, FORMAT (the
// message names the camera by its index from 0) or OUT_OF_MEMORY; *cameras is then NULL.
SGS_API sgs_status sgs_cameras_read_json(const char *path, sgs_named_camera **cameras,
                                         size_t *count);
// The same of `size` bytes of text. path: begins the error message; nothing is read from it.
SGS_API sgs_status sgs_cameras_parse_json(const char *text, size_t size, const char *path,
                                          sgs_named_camera **cameras, size_t *count);
// Accepts NULL.
SGS_API void sgs_cameras_free(sgs_named_camera *cameras);

#ifdef __cplusplus
}
#endif
