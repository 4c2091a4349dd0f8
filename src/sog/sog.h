// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One SOG model in memory: decoded textures and codebooks on the reading side, encoded files on the
// writing side. sog_lod.c combines several.

#include "storage/archive.h"
#include "storage/model_folder.h"
#include "storage/model_rows.h"
#include "sog/webp_image.h"
#include "base/progress_calls.h"
#include "sparegs/model_file.h"

enum {
    SGSI_SOG_MEANS_LOW,
    SGSI_SOG_MEANS_HIGH,
    SGSI_SOG_SCALES,
    SGSI_SOG_QUATS,
    SGSI_SOG_SH0,
    SGSI_SOG_CENTROIDS,
    SGSI_SOG_LABELS,
    SGSI_SOG_TEXTURES,
    SGSI_SOG_CODES = 256,
    SGSI_SOG_PALETTE_COLUMNS = 64, // palette entries per row of the centroids
    SGSI_SOG_FILES = SGSI_SOG_TEXTURES + 1
};

typedef struct sgsi_sog {
    size_t count, palette_count;
    size_t bytes; // of all its files, or of the ZIP file
    int version, sh_degree;
    bool antialiased;
    double means_low[3], means_high[3];
    // Version 2: a codebook per attribute. Version 1: the same table per channel, from its bounds.
    double scales[3][SGSI_SOG_CODES], colors[3][SGSI_SOG_CODES], opacity[SGSI_SOG_CODES];
    double rest[SGSI_SOG_CODES];
    sgsi_webp textures[SGSI_SOG_TEXTURES];
} sgsi_sog;

// Reads a ZIP file, a folder, or the meta.json in a folder. Close it after a failure too.
sgs_status sgsi_sog_open(sgsi_sog *sog, const char *path);
void sgsi_sog_close(sgsi_sog *sog);
void sgsi_sog_row(const sgsi_sog *sog, size_t i, float params[SGS_PARAM_COUNT]);

// Folder of a path that ends in /meta.json or /lod-meta.json, else the path; the caller frees it
// with sgsi_free. NULL when out of memory.
char *sgsi_sog_folder(const char *path);

// Steps of progress that encoding `count` primitives takes.
size_t sgsi_sog_steps(const sgs_gaussians *model, const sgs_model_write_options *options);

// Encodes rows order[0 ... count) of the model to at most SGSI_SOG_FILES files, meta.json last.
// Free them with sgsi_sog_files_free. Fails with OUT_OF_MEMORY, LIMIT or CANCELLED.
sgs_status sgsi_sog_encode(const sgs_gaussians *model, const uint32_t *order, size_t count,
                           const sgs_model_write_options *options, sgsi_progress *progress,
                           sgsi_archive_file files[SGSI_SOG_FILES], size_t *file_count);
// The same for the whole model, rows along a Morton curve, with the progress of `options`.
sgs_status sgsi_sog_encode_model(const sgs_gaussians *model, const sgs_model_write_options *options,
                                 sgsi_archive_file files[SGSI_SOG_FILES], size_t *file_count);
void sgsi_sog_files_free(sgsi_archive_file files[SGSI_SOG_FILES]);

// Stages the files of a SOG model. `unit` is "" or the folder of a unit with its slash: "0_0/".
// Fails with IO or OUT_OF_MEMORY.
sgs_status sgsi_sog_put(sgsi_model_folder *folder, const char *unit, const sgsi_archive_file *files,
                        size_t count, uint64_t *written);
// Marks the files of an earlier SOG model, if there is one, for removal; see
// sgsi_model_folder_drop.
sgs_status sgsi_sog_drop(sgsi_model_folder *folder, const char *unit);
