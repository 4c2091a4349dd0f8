// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// transforms.json. Checks that errors name a file of the folder, names stay in their folder and
// poses are finite.

#include "fuzz_support.h"
#include "scene/transforms.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char cloud[] =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n";
    static bool prepared;
    if (!prepared)
        fuzz_file("points.ply", cloud, strlen(cloud));
    prepared = true;
    const char *path = fuzz_file("input", data, size);
    sgsi_dataset dataset;
    if (sgsi_transforms_read(path, &dataset)) {
        fuzz_check_refusal(fuzz_folder);
        FUZZ_REQUIRE(!dataset.frames);
        return 0;
    }
    for (size_t i = 0; i < dataset.frame_count; ++i) {
        const sgsi_frame *frame = &dataset.frames[i];
        FUZZ_REQUIRE(frame->name[0] && frame->name[0] != '/' && strncmp(frame->name, "../", 3) &&
                     !strstr(frame->name, "/../"));
        for (int k = 0; k < 9; ++k)
            FUZZ_REQUIRE(fabs(frame->pose.rotation[k]) < 1.001);
        for (int k = 0; k < 3; ++k)
            FUZZ_REQUIRE(isfinite(frame->pose.translation[k]));
    }
    sgsi_dataset_free(&dataset);
    return 0;
}
