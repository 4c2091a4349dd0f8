// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The heat maps of a profiled view: exact values as EXR, colour maps as PNG. Tile maps are enlarged
// to the image size, so that all maps align.

#include <stdio.h>
#include <stdlib.h>

#include "draw/colormap.h"
#include "cli/output.h"
#include "report/profile_report.h"
#include "cli/progress.h"
#include "sparegs/image.h"

typedef struct map_files {
    const char *folder, *stem, *name; // of the view
    FILE *stream;                     // receives the paths
} map_files;

static bool write_exr(const map_files *files, const char *suffix, int width, int height,
                      const sgs_exr_channel *channels, int count)
{
    char *path = format_text("%s/%s%s", files->folder, files->stem, suffix);
    const sgs_exr_info info = {.width = width, .height = height, .view_name = files->name};
    bool written = make_folder_of(path);
    if (written && sgs_exr_write(path, &info, channels, count)) {
        fail_library();
        written = false;
    }
    if (written)
        fprintf(files->stream, "%s\n", path);
    free(path);
    return written;
}

static bool write_png(const map_files *files, const char *suffix, const float *plane, int width,
                      int height)
{
    char *path = format_text("%s/%s%s", files->folder, files->stem, suffix);
    const value_range range = plane_range(plane, (size_t)width * (size_t)height);
    sgs_image8 image = {0};
    bool written = plane_colored(plane, width, height, range, &image);
    if (!written)
        fail_run("%s: not enough memory to write it", path);
    if (written && sgs_png_write(path, &image)) {
        fail_library();
        written = false;
    }
    if (written) {
        fprintf(files->stream, "%s\n", path);
        print_note("%s%s: colours from dark to light represent %g to %g", files->stem, suffix,
                   (double)range.low, (double)range.high);
    }
    sgs_image8_free(&image);
    free(path);
    return written;
}

static bool write_tiles_png(const map_files *files, const char *suffix, const float *tiles,
                            const sgs_profile *profile)
{
    const int width = profile->width, height = profile->height;
    float *plane = malloc((size_t)width * (size_t)height * sizeof *plane);
    if (!plane) {
        fail_run("%s%s: not enough memory to write it", files->name, suffix);
        return false;
    }
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            plane[(size_t)y * (size_t)width + (size_t)x] =
                tiles[y / 16 * profile->tiles_x + x / 16];
    const bool written = write_png(files, suffix, plane, width, height);
    free(plane);
    return written;
}

bool profile_write_maps(const char *folder, const named_camera *view, const sgs_profile *profile,
                        FILE *stream)
{
    const map_files files = {folder, view->stem, view->name, stream};
    const sgs_exr_channel pixels[] = {
        {.name = "hits.count", .floats = profile->pixel_hits},
        {.name = "block_hits.count", .floats = profile->pixel_block_hits}};
    const sgs_exr_channel tiles[] = {
        {.name = "candidates.count", .floats = profile->tile_candidates},
        {.name = "evaluations.count", .floats = profile->tile_evaluations},
        {.name = "cost.seconds", .floats = profile->tile_seconds}};
    return write_exr(&files, ".profile.exr", profile->width, profile->height, pixels, 2) &&
           write_exr(&files, ".tiles.exr", profile->tiles_x, profile->tiles_y, tiles, 3) &&
           write_png(&files, ".hits.png", profile->pixel_hits, profile->width, profile->height) &&
           write_png(&files, ".block_hits.png", profile->pixel_block_hits, profile->width,
                     profile->height) &&
           write_tiles_png(&files, ".tile_candidates.png", profile->tile_candidates, profile) &&
           write_tiles_png(&files, ".tile_cost.png", profile->tile_seconds, profile);
}
