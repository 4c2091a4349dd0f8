// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Uses the installed library from C: creates a model, renders it, fails on purpose and reads the
// message.

#include <stdio.h>
#include <string.h>

#include <sparegs/render.h>
#include <sparegs/runtime.h>

int main(void)
{
    sgs_gaussians *model = NULL;
    if (sgs_gaussians_create(16, &model) || sgs_gaussians_resize(model, 1))
        return 1;
    float params[SGS_PARAM_COUNT] = {0};
    params[SGS_PARAM_MEAN + 2] = 2;
    params[SGS_PARAM_ROTATION] = 1;
    params[SGS_PARAM_OPACITY] = 2;
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] = -1.5F;
    sgs_gaussians_set(model, 0, params);

    const sgs_camera camera = {SGS_CAMERA_PINHOLE, 32, 24, {30, 30, 16, 12}};
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    const sgs_render_options options = sgs_render_options_default();
    sgs_renderer *renderer = NULL;
    sgs_frame frame;
    if (sgs_renderer_create(model, &renderer) || sgs_frame_create(32, 24, &frame) ||
        sgs_renderer_render(renderer, &camera, &pose, &options, &frame)) {
        puts(sgs_last_error());
        return 1;
    }
    const float middle = frame.transmittance[12 * 32 + 16], corner = frame.transmittance[0];
    printf("sparegs %s from C: transmittance %g in the middle, %g in the corner\n", sgs_version(),
           (double)middle, (double)corner);
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);

    const int failed = sgs_ply_read("no-such-file.ply", &model) == SGS_STATUS_IO && !model;
    return middle < 0.5F && corner > 0.9F && failed && strstr(sgs_last_error(), "no-such-file.ply")
               ? 0
               : 1;
}
