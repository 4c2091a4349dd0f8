// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Files of models in all supported formats, with one reader and one writer. A model in memory has
// the values and axes of the 3DGS PLY (gaussians.h); conversions to the axes, activations and
// quantisation of a format happen here. tools/manual/formats.md describes the formats.
//
// Threads: the functions may be called from any thread, concurrently for different models.

#include <stdint.h>

#include "sparegs/gaussians.h"
#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_model_format {
    SGS_MODEL_PLY,            // 3DGS, little-endian floats
    SGS_MODEL_COMPRESSED_PLY, // PlayCanvas, chunks of 256
    SGS_MODEL_SPLAT,          // 32 bytes per primitive, no SH
    SGS_MODEL_SPZ,            // Niantic, versions 1 to 4
    SGS_MODEL_KSPLAT,         // GaussianSplats3D, levels 0 to 2
    SGS_MODEL_GLB,            // glTF 2.0 with KHR_gaussian_splatting
    SGS_MODEL_SOG,            // PlayCanvas, versions 1 and 2; a ZIP file or a folder with meta.json
    SGS_MODEL_LOD_SOG,        // a folder with lod-meta.json
    SGS_MODEL_USDA,           // OpenUSD text, ParticleField3DGaussianSplat
    SGS_MODEL_HTML,           // a page that shows the model offline; written only
    SGS_MODEL_FORMAT_COUNT
} sgs_model_format;

// Short name, "spz"; never NULL.
SGS_API const char *sgs_model_format_name(sgs_model_format format);

// Format that a file name selects: ".ply", ".compressed.ply", ".splat", ".spz", ".ksplat", ".glb",
// ".sog", ".usda" or ".html", without regard to case, or the whole names "meta.json" and
// "lod-meta.json". False for other names.
SGS_API bool sgs_model_format_of_name(const char *path, sgs_model_format *format);

// Format of an existing file, by its first bytes and its name, or of a folder with meta.json or
// lod-meta.json. False if it is not a model. Reads at most a few kilobytes.
SGS_API bool sgs_model_format_detect(const char *path, sgs_model_format *format);

// True if files of the format record that a model was trained with Mip-Splatting's filters
// (sgs_model_info.antialiased). Cannot fail.
SGS_API bool sgs_model_format_marks_filter(sgs_model_format format);

// The same for the space and the white point of the colours (sgs_model_info.colors).
SGS_API bool sgs_model_format_marks_colors(sgs_model_format format);

// Directions of x, y and z: left or right, down or up, back or front.
typedef enum sgs_spz_axes {
    SGS_SPZ_AXES_RUB, // the SPZ specification
    SGS_SPZ_AXES_RDF, // the axes of the PLY, as some exporters write them
    SGS_SPZ_AXES_LUF, // those of glTF
    // The others are read, but not written.
    SGS_SPZ_AXES_LDB,
    SGS_SPZ_AXES_RDB,
    SGS_SPZ_AXES_LUB,
    SGS_SPZ_AXES_LDF,
    SGS_SPZ_AXES_RUF, // those of Unity
    SGS_SPZ_AXES_LFU,
    SGS_SPZ_AXES_RFU, // those of Blender
    SGS_SPZ_AXES_LBD,
    SGS_SPZ_AXES_RBD,
    SGS_SPZ_AXES_COUNT
} sgs_spz_axes;

typedef struct sgs_model_read_options {
    size_t struct_size;    // set by sgs_model_read_options_default
    sgs_spz_axes spz_axes; // of SPZ files that do not name their axes
    int lod;               // level of a LOD SOG; 0 is the finest, and the only one of other formats
    bool drop_zero_quaternions; // drop primitives with a zero quaternion instead of using the
                                // identity
} sgs_model_read_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_model_read_options_init(sgs_model_read_options *options, size_t size);
static inline sgs_model_read_options sgs_model_read_options_default(void)
{
    sgs_model_read_options options;
    sgs_model_read_options_init(&options, sizeof options);
    return options;
}

typedef struct sgs_model_info {
    sgs_model_format format;
    int version;      // of an SPZ, KSPLAT or SOG file; 0 for other formats
    bool antialiased; // trained with Mip-Splatting's filters (SGS_FILTER_MIP)
    sgs_model_colors colors;
    bool fused_filter; // the PLY had filter_3D, which is now part of scales and opacities
    size_t dropped;    // primitives with invalid values
    size_t file_bytes; // of all files that were read
    int lod_count;     // levels of a LOD SOG, else 1
    sgs_spz_axes axes; // of an SPZ file
} sgs_model_info;

// Reads a model of any supported format. Primitives with values that are not finite are dropped
// with a warning; see sgs_ply_read. options and info may be NULL. The caller destroys *model. Fails
// with INVALID_ARGUMENT (options), IO, FORMAT, UNSUPPORTED, LIMIT or OUT_OF_MEMORY; the error names
// file and place, *model is then NULL.
SGS_API sgs_status sgs_model_read(const char *path, const sgs_model_read_options *options,
                                  sgs_gaussians **model, sgs_model_info *info);

// Reads only what a model file records about its colours; formats that cannot record them leave
// them all zero. Gives no warnings. Fails as sgs_model_read; *colors is then all zero.
SGS_API sgs_status sgs_model_read_colors(const char *path, sgs_model_colors *colors);

// Number of primitives in a model file, of a LOD SOG in its finest level. Of both kinds of PLY,
// only the header is read: primitives with invalid values count. Other formats are read as by
// sgs_model_read, with its warnings. Fails as sgs_model_read; *count is then 0.
SGS_API sgs_status sgs_model_read_count(const char *path, size_t *count);

// A camera for OpenUSD or a page: pinhole part only, pixel centres at .5.
typedef struct sgs_model_camera {
    const char *name; // of the image
    int width, height;
    double fx, fy, cx, cy;              // pixels
    double rotation[9], translation[3]; // world to camera, x right, y down, z front
} sgs_model_camera;

typedef struct sgs_model_write_options {
    size_t struct_size;      // set by sgs_model_write_options_default
    bool antialiased;        // recorded if the format can record it
    int spz_version;         // 3 (gzip) or 4 (Zstandard)
    sgs_spz_axes spz_axes;   // RUB, RDF or LUF
    int ksplat_level;        // 0: floats; 1: 16 bits; 2: 8 bits for SH
    int sh_palette;          // entries of SOG's SH palette, 1 to 65536; 0: by the count
    int palette_iterations;  // of k-means for the palette, >= 1
    int lod_levels;          // of a LOD SOG, 1 to 16; each has half the primitives of the previous
    const float *importance; // [count] for the levels of a LOD SOG; NULL: opacity times volume
    const sgs_model_camera *cameras; // [camera_count] for OpenUSD and HTML; or NULL
    size_t camera_count;
    // Called while the palettes of SOG, LOD SOG and HTML are computed, or NULL. The other formats
    // are written without calls.
    sgs_progress_fn progress;
    void *progress_user;
    // Recorded if the format can record them, and they are linear or the white point is known;
    // `space_known` is ignored.
    sgs_model_colors colors;
    // HTML: the up axis of the page, world, any length. Zero: the mean up axis of the cameras.
    double up[3];
} sgs_model_write_options;

// Writes the defaults to a struct of `size` bytes, see status.h: SPZ 3 with RUB axes, KSPLAT level
// 1, 10 iterations, 4 levels. Cannot fail.
SGS_API void sgs_model_write_options_init(sgs_model_write_options *options, size_t size);
static inline sgs_model_write_options sgs_model_write_options_default(void)
{
    sgs_model_write_options options;
    sgs_model_write_options_init(&options, sizeof options);
    return options;
}

typedef enum sgs_row_order {
    SGS_ROWS_KEPT,
    SGS_ROWS_MORTON,     // along a Z curve
    SGS_ROWS_IMPORTANCE, // opacity times volume, decreasing
    SGS_ROWS_BUCKETS     // cells of 5 units, in input order within each
} sgs_row_order;

typedef struct sgs_model_written {
    size_t count;
    uint64_t bytes; // of all files
    sgs_row_order order;
} sgs_model_written;

// Writes the format that the name selects, atomically per file. options and written may be NULL.
// PLY stores every value; the other formats refuse a parameter that is not finite (see
// gaussians.h), and all but the two kinds of PLY an empty model. Fails with UNSUPPORTED (name),
// INVALID_ARGUMENT (options, model), LIMIT (too many primitives for the format), IO, OUT_OF_MEMORY
// or CANCELLED; an existing file is then unchanged.
SGS_API sgs_status sgs_model_write(const char *path, const sgs_gaussians *model,
                                   const sgs_model_write_options *options,
                                   sgs_model_written *written);

#ifdef __cplusplus
}
#endif
