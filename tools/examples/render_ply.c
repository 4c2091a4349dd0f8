// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Renders a PLY into its own buffer, like an application with its own image type: the planes of the
// frame point to the caller's memory.
//
//     render_ply MODEL.ply OUT.pfm
//
// The camera looks along +z at the centre of the model. OUT.pfm has the colours over black, as
// 32-bit floats.

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "sparegs/sparegs.h"

enum { WIDTH = 320, HEIGHT = 240 };
static const double focal_length = 400.0; // pixels

static int fail(void)
{
    fprintf(stderr, "render_ply: %s\n", sgs_last_error());
    return EXIT_FAILURE;
}

// A camera in front of the model, at a distance from which two standard deviations of its means
// fit into the image.
static sgs_status place_camera(const sgs_gaussians *model, sgs_pose *pose)
{
    double middle[3] = {0, 0, 0}, spread = 0.0;
    float *column = malloc((model->count + 1) * sizeof *column);
    sgs_status status = column ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    for (int k = 0; k < 3 && !status; ++k) {
        double sum = 0.0, squares = 0.0;
        status = sgs_gaussians_read(model, SGS_PARAM_MEAN + k, 0, model->count, column, 0);
        for (size_t i = 0; i < model->count && !status; ++i) {
            sum += (double)column[i];
            squares += (double)column[i] * (double)column[i];
        }
        middle[k] = sum / (double)model->count;
        spread =
            fmax(spread, sqrt(fmax(squares / (double)model->count - middle[k] * middle[k], 0)));
    }
    free(column);
    const double distance = 2.0 * spread * 2.0 * focal_length / HEIGHT + 1e-3;
    *pose = (sgs_pose){{1, 0, 0, 0, 1, 0, 0, 0, 1}, {-middle[0], -middle[1], distance - middle[2]}};
    return status;
}

// Rows from the bottom up, as PFM has them; a negative scale means little-endian.
static int write_pfm(const char *path, const float *rgba)
{
    const size_t plane = (size_t)WIDTH * HEIGHT;
    FILE *stream = fopen(path, "wb");
    if (!stream) {
        perror(path);
        return EXIT_FAILURE;
    }
    fprintf(stream, "PF\n%d %d\n-1.0\n", WIDTH, HEIGHT);
    for (int y = HEIGHT - 1; y >= 0; --y)
        for (int x = 0; x < WIDTH; ++x)
            for (size_t c = 0; c < 3; ++c)
                fwrite(&rgba[c * plane + (size_t)y * WIDTH + (size_t)x], sizeof *rgba, 1, stream);
    return ferror(stream) | fclose(stream) ? EXIT_FAILURE : EXIT_SUCCESS;
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        fputs("usage: render_ply MODEL.ply OUT.pfm\n", stderr);
        return 2;
    }
    const size_t plane = (size_t)WIDTH * HEIGHT;
    float *rgba = calloc(4 * plane, sizeof *rgba); // planar: R, G, B, A
    sgs_gaussians *model = NULL;
    sgs_renderer *renderer = NULL;
    sgs_pose pose;
    const sgs_camera camera = {
        SGS_CAMERA_PINHOLE, WIDTH, HEIGHT, {focal_length, focal_length, WIDTH / 2.0, HEIGHT / 2.0}};
    if (!rgba)
        return EXIT_FAILURE;
    int result = EXIT_FAILURE;
    if (sgs_ply_read(argv[1], &model) || place_camera(model, &pose) ||
        sgs_renderer_create(model, &renderer)) {
        fail();
    } else {
        sgs_frame frame = {.width = WIDTH,
                           .height = HEIGHT,
                           .color = {rgba, rgba + plane, rgba + 2 * plane},
                           .transmittance = rgba + 3 * plane};
        const sgs_render_options options = sgs_render_options_default();
        if (sgs_renderer_render(renderer, &camera, &pose, &options, &frame)) {
            fail();
        } else {
            double covered = 0.0;
            for (size_t i = 0; i < plane; ++i) {
                rgba[3 * plane + i] = 1.0f - rgba[3 * plane + i]; // transmittance becomes alpha
                covered += (double)rgba[3 * plane + i];
            }
            printf("%zu Gaussians, mean alpha %.3f\n", model->count, covered / (double)plane);
            result = write_pfm(argv[2], rgba);
        }
    }
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);
    free(rgba);
    return result;
}
