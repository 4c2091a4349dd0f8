// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Cameras of OpenUSD text. Checks that errors name the file, and that accepted cameras have valid
// lenses and poses, paths, and views in the order of their time codes.

#include "fuzz_support.h"
#include "sparegs/usd_cameras.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    enum { MOST = 100000 };
    const char *path = fuzz_file("input.usda", data, size);
    sgs_usd_cameras *cameras;
    size_t views = 0;
    if (sgs_usd_cameras_read(path, 64, 48, &cameras)) {
        fuzz_check_refusal(path);
        FUZZ_REQUIRE(!cameras);
        return 0;
    }
    FUZZ_REQUIRE(cameras->count > 0 && cameras->count <= size);
    for (size_t i = 0; i < cameras->count; ++i) {
        const sgs_usd_camera *camera = &cameras->cameras[i];
        FUZZ_REQUIRE(camera->path && *camera->path && camera->view_count > 0);
        FUZZ_REQUIRE(camera->is_animated || camera->view_count == 1);
        for (size_t k = 0; k < camera->view_count; ++k) {
            const sgs_usd_view *view = &camera->views[k];
            FUZZ_REQUIRE(!sgs_camera_validate(&view->camera) && !sgs_pose_validate(&view->pose));
            FUZZ_REQUIRE(view->frame >= 0 && view->frame <= 1000000);
            FUZZ_REQUIRE(!k || view->frame == view[-1].frame + 1);
        }
        views += camera->view_count;
    }
    FUZZ_REQUIRE(views <= MOST);
    sgs_usd_cameras_destroy(cameras);
    return 0;
}
