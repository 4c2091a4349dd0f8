// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One file of a COLMAP model (FUZZ_FILE: cameras.bin ... points3D.txt) is the input; the others are
// small and valid. Checks that errors name the file, that accepted models have valid cameras,
// rotations, finite points and names inside their folder, and that reading is deterministic.

#include <xxhash.h>

#include "scene/colmap.h"
#include "fuzz_support.h"
#include "sparegs/camera.h"

static const char cameras_text[] =
    "1 PINHOLE 64 48 50 50 32 24\n2 OPENCV_FISHEYE 64 48 50 50 32 24 0.1 0 0 0\n";
static const char images_text[] =
    "1 1 0 0 0 0 0 0 1 a.jpg\n\n2 0.5 0.5 0.5 0.5 1 2 3 2 b/c.png\n1 2 3\n";
static const char points_text[] = "1 0 0 0 255 0 0 0.5 1 0\n2 1 1 1 0 255 0 0.5\n";

static void append(uint8_t *to, size_t *size, const void *bytes, size_t count)
{
    memcpy(to + *size, bytes, count);
    *size += count;
}

static void write_companions(void)
{
    const bool binary = strlen(FUZZ_FILE) > 4 && !strcmp(&FUZZ_FILE[strlen(FUZZ_FILE) - 4], ".bin");
    if (!binary) {
        fuzz_file("cameras.txt", cameras_text, strlen(cameras_text));
        fuzz_file("images.txt", images_text, strlen(images_text));
        fuzz_file("points3D.txt", points_text, strlen(points_text));
        return;
    }
    uint8_t bytes[512];
    size_t size = 0;
    const uint64_t one = 1, none = 0, width = 64, height = 48;
    const int32_t id = 1, model = 1;
    const double parameters[] = {50, 50, 32, 24}, pose[] = {1, 0, 0, 0, 0, 0, 0}, xyz[] = {0, 0, 1},
                 error = 1;
    append(bytes, &size, &one, 8);
    append(bytes, &size, &id, 4);
    append(bytes, &size, &model, 4);
    append(bytes, &size, &width, 8);
    append(bytes, &size, &height, 8);
    append(bytes, &size, parameters, sizeof parameters);
    fuzz_file("cameras.bin", bytes, size);
    size = 0;
    append(bytes, &size, &one, 8);
    append(bytes, &size, &id, 4);
    append(bytes, &size, pose, sizeof pose);
    append(bytes, &size, &id, 4);
    append(bytes, &size, "a.jpg", 6);
    append(bytes, &size, &none, 8);
    fuzz_file("images.bin", bytes, size);
    size = 0;
    append(bytes, &size, &one, 8);
    append(bytes, &size, &one, 8);
    append(bytes, &size, xyz, sizeof xyz);
    append(bytes, &size, "\1\2\3", 3);
    append(bytes, &size, &error, 8);
    append(bytes, &size, &none, 8);
    fuzz_file("points3D.bin", bytes, size);
}

static uint64_t digest(const sgsi_dataset *dataset)
{
    uint64_t hash =
        XXH64(dataset->points, dataset->point_count * 3 * sizeof(float), dataset->frame_count);
    hash = XXH64(dataset->colors, dataset->point_count * 3, hash);
    for (size_t i = 0; i < dataset->frame_count; ++i) {
        const sgsi_frame *frame = &dataset->frames[i];
        hash = XXH64(frame->name, strlen(frame->name), hash);
        hash = XXH64(frame->camera.params, sizeof frame->camera.params, hash);
        hash = XXH64(&frame->pose, sizeof frame->pose, hash);
    }
    return hash;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static bool prepared;
    if (!prepared)
        write_companions();
    prepared = true;
    const char *path = fuzz_file(FUZZ_FILE, data, size);
    uint64_t digests[2] = {0};
    for (int round = 0; round < 2; ++round) {
        sgsi_dataset dataset;
        if (sgsi_colmap_read(fuzz_folder, &dataset)) {
            fuzz_check_refusal(fuzz_folder);
            FUZZ_REQUIRE(!dataset.frames && !dataset.points && round == 0);
            return 0;
        }
        FUZZ_REQUIRE(dataset.frame_count > 0 &&
                     dataset.frame_count + dataset.point_count <= size + 4);
        fuzz_check_finite(dataset.points, 3 * dataset.point_count);
        for (size_t i = 0; i < dataset.frame_count; ++i) {
            const sgsi_frame *frame = &dataset.frames[i];
            FUZZ_REQUIRE(!sgs_camera_validate(&frame->camera));
            FUZZ_REQUIRE(frame->name[0] && frame->name[0] != '/' &&
                         strncmp(frame->name, "../", 3) && !strstr(frame->name, "/../"));
            const double *r = frame->pose.rotation;
            const double determinant = r[0] * (r[4] * r[8] - r[5] * r[7]) -
                                       r[1] * (r[3] * r[8] - r[5] * r[6]) +
                                       r[2] * (r[3] * r[7] - r[4] * r[6]);
            FUZZ_REQUIRE(fabs(determinant - 1) < 1e-6 && isfinite(frame->pose.translation[0]));
        }
        digests[round] = digest(&dataset);
        sgsi_dataset_free(&dataset);
    }
    FUZZ_REQUIRE(path && digests[0] == digests[1]);
    return 0;
}
