// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages of the viewer's page. Accepted messages have valid cameras of a bounded size; rejected
// ones have a description and are marked as invalid.

#include "fuzz_support.h"
#include "viewer/view_message.h"

static const camera_list *views(void)
{
    static named_camera cameras[2] = {
        {.camera = {SGS_CAMERA_OPENCV, 64, 48, {50, 51, 32, 24, 0.1, 0.01, 0, 0}},
         .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 1}}},
        {.camera = {SGS_CAMERA_OPENCV_FISHEYE, 80, 60, {30, 30, 40, 30}},
         .pose = {{0, 1, 0, -1, 0, 0, 0, 0, 1}, {1, 2, 3}}}};
    static const camera_list list = {.cameras = cameras, .count = 2};
    return &list;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    view_message message;
    const char *problem = view_message_parse((const char *)data, size, views(), &message);
    FUZZ_REQUIRE((problem == NULL) == (message.type != MESSAGE_INVALID));
    FUZZ_REQUIRE(!problem || *problem);
    if (message.type != MESSAGE_CAMERA)
        return 0;
    const view_request *request = &message.request;
    FUZZ_REQUIRE(!sgs_camera_validate(&request->camera));
    FUZZ_REQUIRE((size_t)request->camera.width * (size_t)request->camera.height <= VIEW_PIXELS);
    FUZZ_REQUIRE(request->aov >= 0 && request->aov < AOV_ROWS);
    FUZZ_REQUIRE(request->samples >= 1 && request->samples <= VIEW_SAMPLES);
    FUZZ_REQUIRE(isfinite(request->range.low) && isfinite(request->range.high));
    FUZZ_REQUIRE(!request->is_log || request->range.low >= 0);
    FUZZ_REQUIRE(request->crop.opacity >= 0 && request->crop.opacity <= 1);
    FUZZ_REQUIRE(!message.refused || *message.refused);
    for (int k = 0; k < 9; ++k)
        FUZZ_REQUIRE(isfinite(request->pose.rotation[k]));
    for (int k = 0; k < 3; ++k)
        FUZZ_REQUIRE(isfinite(request->pose.translation[k]));
    return 0;
}
