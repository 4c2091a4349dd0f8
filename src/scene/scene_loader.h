// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A scene while it is loaded (scene.c): its views and their files (scene_views.c), its photos
// (scene_photos.c). Functions return OUT_OF_MEMORY, CANCELLED, or what they name.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/path_sandbox.h"
#include "base/progress_calls.h"
#include "image/photo.h"
#include "scene/dataset.h"
#include "scene/scene_find.h"
#include "sparegs/scene.h"

// Widest photo that is not reduced if options.downscale is 0.
enum { SGSI_AUTOMATIC_WIDTH = 1600 };

// State of a view while it is loaded.
typedef struct sgsi_view_slot {
    sgs_status status;
    char *error;
    char *notes[SGSI_NOTES];     // see sgsi_image_info; NULL = none
    int file_width, file_height; // before downscaling; of the display window if it is shown
    int width, height;           // after downscaling
    int channels;
    bool scene_linear;           // see sgsi_image_info
    char space[SGSI_SPACE_SIZE]; // likewise
    size_t bytes;                // decoded size of the photo
    size_t decode_bytes;         // see sgsi_photo_decode_bytes
    bool halves;                 // it is kept in half floats
    bool dynamic_mask;           // see sgsi_mask_file
    double circle;               // radius of the image circle after downscaling, 0 = no circle
    size_t lens;                 // index into sgsi_scene_loader.lenses
    bool dropped;                // not among options.kept
    bool cached; // if the photos exceed the image cache: it keeps this one from the start
    sgsi_photo_report report;
} sgsi_view_slot;

// Mask of the pixels for which a lens has rays. Most views share one.
typedef struct sgsi_lens_mask {
    sgs_camera camera;
    double circle;
    uint16_t *valid_mask; // NULL = all
    size_t rays;          // pixels with a ray
    bool reported;        // a warning about it was sent
} sgsi_lens_mask;

typedef struct sgsi_scene_loader {
    sgs_scene_options *options;
    sgsi_progress progress;
    sgsi_scene_files files;
    sgsi_dataset dataset;
    sgsi_view_slot *slots; // parallel to dataset.frames
    sgsi_roots roots;
    size_t top_folder;     // transforms: length of the folder that all names begin with
    char *mask_folders[2]; // that exist
    size_t mask_folder_count;
    char *name_hint; // why a missing photo seems to be there; NULL = no such file
    sgsi_lens_mask *lenses;
    size_t lens_count;
    sgsi_decode_limit *decode_limit; // of the photos; passes to the image cache
    bool limited;                    // the photos exceed the image cache
    // If limited: of the views that are kept, and their decoded sizes.
    sgsi_photo_source *sources;
    size_t *bytes;
    sgs_scene *scene;
} sgsi_scene_loader;

// Only cameras are requested: photos and masks are not accessed.
static inline bool sgsi_loader_cameras_only(const sgsi_scene_loader *l)
{
    return l->options->cameras_only && !l->options->load_images;
}

// Frees what a view owns.
void sgsi_view_free(sgs_view *view);

// Creates the views, sorted by name, with the paths of their photos and masks. IO: no such
// folder or mask.
sgs_status sgsi_loader_make_views(sgsi_scene_loader *l);

// Marks the views that options.kept does not name.
sgs_status sgsi_loader_mark_dropped(sgsi_scene_loader *l);

// Reads the headers of the photos, fits the cameras to them, measures the white point, and
// reads the photos. An error of one photo is kept in its slot. FORMAT: a camera does not
// fit.
sgs_status sgsi_loader_read_photos(sgsi_scene_loader *l);

// Warns of photos without a pose, and compares their names with those of missing photos. Call it
// before views are dropped: unreadable photos have a pose.
sgs_status sgsi_loader_count_unposed(sgsi_scene_loader *l);

// Drops the views without a usable photo, with warnings. Fails with the error of a slot that
// must not be skipped, and with IO or INVALID_ARGUMENT if no view is left.
sgs_status sgsi_loader_drop_unusable(sgsi_scene_loader *l);

// Drops the marked views. Call it after the extent is measured: they count for it. INVALID_ARGUMENT
// if no view is left.
sgs_status sgsi_loader_drop_marked(sgsi_scene_loader *l);

// Opens the image cache if the photos exceed it. The cache takes ownership of the lens masks,
// which it applies at each decoding.
sgs_status sgsi_loader_open_store(sgsi_scene_loader *l);

// What sgsi_photo_load needs for view i; paths belong to the view.
sgsi_photo_source sgsi_loader_source(const sgsi_scene_loader *l, size_t i);
