// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A held-out image has no colour map: its left half is used to fit one, its right half is scored
// (the protocol of 3DGS's --train_test_exp, except that the left half does not train the scene).

#include "run/exposure_file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "run/display_planes.h"
#include "sparegs/runtime.h"

bool exposure_write(const char *path, const sgs_scene *scene, const sgs_trainer *trainer)
{
    json_t *root = json_object();
    for (size_t v = 0; v < scene->view_count; ++v) {
        const double *map = sgs_trainer_exposure(trainer, v);
        if (!map)
            continue;
        json_t *rows = json_array();
        for (int c = 0; c < 3; ++c) {
            json_t *row = json_array();
            for (int k = 0; k < 4; ++k)
                json_array_append_new(row, json_number(map[4 * c + k]));
            json_array_append_new(rows, row);
        }
        json_object_set_new(root, scene->views[v].name, rows);
    }
    if (json_object_size(root))
        return write_json(path, root);
    json_decref(root);
    return true;
}

static bool is_complete(json_t *exposures)
{
    const char *name;
    json_t *rows;
    double map[12];
    bool complete = json_is_object(exposures);
    json_object_foreach(exposures, name, rows)
    {
        complete = complete && exposure_find(exposures, name, map);
    }
    return complete;
}

json_t *exposure_read(const char *path, bool *failed)
{
    json_error_t error;
    if (!file_exists(path)) {
        print_warning("%s: does not exist; the colour maps of the run are not used", path);
        return NULL;
    }
    json_t *root = load_json(path, 0, &error);
    if (is_complete(root))
        return root;
    fail_run("%s: file is damaged; train again, or evaluate the PLY file", path);
    json_decref(root);
    *failed = true;
    return NULL;
}

// Names the maps as the scene's views, see sgs_scene_find_recorded. False if out of memory.
static bool rename_maps(const sgs_scene *scene, json_t **exposures)
{
    const size_t count = json_object_size(*exposures);
    const char **names = malloc((count + 1) * sizeof *names);
    ptrdiff_t *views = malloc((count + 1) * sizeof *views);
    const bool made = names && views;
    if (made) {
        const char *name;
        json_t *map, *renamed = json_object();
        size_t k = 0;
        json_object_foreach(*exposures, name, map)
        {
            names[k++] = name;
        }
        sgs_scene_find_recorded(scene, names, count, views);
        for (k = 0; k < count; ++k)
            if (views[k] >= 0)
                json_object_set(renamed, scene->views[views[k]].name,
                                json_object_get(*exposures, names[k]));
        json_decref(*exposures);
        *exposures = renamed;
    } else
        fail_run("not enough memory for the colour maps of %zu images", count);
    free(names);
    free(views);
    return made;
}

bool exposure_of_model(const model_path *located, const sgs_scene *scene, json_t **exposures)
{
    bool damaged = false;
    *exposures = NULL;
    if (!json_is_true(config_option(located->config, "exposure")))
        return true;
    const char *slash = strrchr(located->ply_path, '/');
    const int length = slash ? (int)(slash - located->ply_path) : 0;
    char *path = format_text("%.*s/exposure.json", length, located->ply_path);
    if (!slash || !file_exists(path)) {
        free(path);
        path = format_text("%s/exposure.json", located->run ? located->run : "");
    }
    *exposures = exposure_read(path, &damaged);
    free(path);
    return !damaged && (!*exposures || rename_maps(scene, exposures));
}

void exposure_warn_finetune(const char *path, const json_t *config)
{
    if (json_is_true(config_option(config, "exposure")))
        print_warning("%s: trained with --exposure; fine-tuning compares with the photos "
                      "without exposure compensation",
                      path);
}

bool exposure_find(const json_t *exposures, const char *name, double map[12])
{
    const json_t *rows = json_object_get(exposures, name);
    for (size_t i = 0; i < 12 && rows; ++i) {
        const json_t *value = json_array_get(json_array_get(rows, i / 4), i % 4);
        if (!json_is_number(value))
            return false;
        map[i] = json_number_value(value);
    }
    return rows != NULL;
}

// Solves a x = b for three right-hand sides by Gaussian elimination with pivoting; a is symmetric
// positive definite. False if singular.
static bool solve(double a[4][4], double b[4][3])
{
    for (int i = 0; i < 4; ++i) {
        int pivot = i;
        for (int r = i + 1; r < 4; ++r)
            pivot = fabs(a[r][i]) > fabs(a[pivot][i]) ? r : pivot;
        if (!(fabs(a[pivot][i]) > 1e-12))
            return false;
        for (int k = 0; k < 4; ++k) {
            const double kept = a[i][k];
            a[i][k] = a[pivot][k];
            a[pivot][k] = kept;
        }
        for (int k = 0; k < 3; ++k) {
            const double kept = b[i][k];
            b[i][k] = b[pivot][k];
            b[pivot][k] = kept;
        }
        for (int r = 0; r < 4; ++r) {
            const double factor = r == i ? 0 : a[r][i] / a[i][i];
            for (int k = 0; k < 4 && r != i; ++k)
                a[r][k] -= factor * a[i][k];
            for (int k = 0; k < 3 && r != i; ++k)
                b[r][k] -= factor * b[i][k];
        }
    }
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 3; ++k)
            b[i][k] /= a[i][i];
    return true;
}

static double opacity_at(const float *transmittance, size_t at)
{
    return transmittance ? 1 - (double)transmittance[at] : 1;
}

void exposure_fit(float *const drawn[3], const float *transmittance, float *const photo[3],
                  const uint16_t *valid_mask, int width, int height, double map[12])
{
    double a[4][4] = {{0}}, b[4][3] = {{0}};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width / 2; ++x) {
            const size_t at = (size_t)y * (size_t)width + (size_t)x;
            if (!sgs_mask_is_valid(valid_mask, width, x, y))
                continue;
            const double from[4] = {(double)drawn[0][at], (double)drawn[1][at],
                                    (double)drawn[2][at], opacity_at(transmittance, at)};
            for (int i = 0; i < 4; ++i) {
                for (int k = 0; k < 4; ++k)
                    a[i][k] += from[i] * from[k];
                for (int c = 0; c < 3; ++c)
                    b[i][c] += from[i] * (double)photo[c][at];
            }
        }
    // Regularises towards the identity where the half is not informative, such as a grey wall.
    const double pull = 1e-4 * a[3][3] + 1e-9;
    for (int i = 0; i < 4; ++i) {
        a[i][i] += pull;
        if (i < 3)
            b[i][i] += pull;
    }
    const bool solved = solve(a, b);
    for (int c = 0; c < 3; ++c)
        for (int k = 0; k < 4; ++k)
            map[4 * c + k] = solved ? b[k][c] : k == c;
}

typedef struct apply_job {
    float *const *planes;
    const float *transmittance;
    const double *map;
} apply_job;

static void apply_range(void *context, size_t begin, size_t end)
{
    const apply_job *job = context;
    float *const *planes = job->planes;
    const double *map = job->map;
    for (size_t i = begin; i < end; ++i) {
        const double image[3] = {(double)planes[0][i], (double)planes[1][i], (double)planes[2][i]};
        for (size_t c = 0; c < 3; ++c)
            planes[c][i] = (float)(map[4 * c] * image[0] + map[4 * c + 1] * image[1] +
                                   map[4 * c + 2] * image[2] +
                                   map[4 * c + 3] * opacity_at(job->transmittance, i));
    }
}

void exposure_apply(float *const planes[3], const float *transmittance, size_t pixels,
                    const double map[12])
{
    apply_job job = {planes, transmittance, map};
    sgs_parallel_ranges(pixels, PIXELS_AT_ONCE, apply_range, &job);
}

uint16_t *exposure_right_half(const uint16_t *valid_mask, int width, int height)
{
    const size_t words = sgs_mask_words(width);
    uint16_t *half = calloc(words * (size_t)height, sizeof *half);
    for (int y = 0; half && y < height; ++y)
        for (int x = width / 2; x < width; ++x)
            if (sgs_mask_is_valid(valid_mask, width, x, y))
                half[(size_t)y * words + (size_t)x / 16] |= (uint16_t)(1u << x % 16);
    return half;
}
