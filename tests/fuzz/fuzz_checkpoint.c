// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Checkpoints of a tiny training run. The checksum of the input is corrected first; otherwise
// no input would pass it. Inputs below 8 bytes select the valid checkpoint, so that seeds do not
// depend on the format. Checks that errors name the file, and that a loaded state can be trained
// and is the same after a save and a load.

#include "support/checkpoint_support.h"
#include "fuzz_good.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"

enum { SIDE = 16, VIEWS = 2, POINTS = 20 };

static sgs_trainer *trainer;

static void prepare(void)
{
    static sgs_view views[VIEWS];
    static uint8_t pixels[VIEWS][3 * SIDE * SIDE], colors[3 * POINTS];
    static float points[3 * POINTS];
    static sgs_scene scene = {.path = (char *)"scene",
                              .view_count = VIEWS,
                              .views = views,
                              .point_count = POINTS,
                              .points = points,
                              .colors = colors,
                              .extent = 1};
    static const char *const names[VIEWS] = {"a.png", "b.png"};
    for (int v = 0; v < VIEWS; ++v) {
        for (int i = 0; i < 3 * SIDE * SIDE; ++i)
            pixels[v][i] = (uint8_t)(7 * i + 31 * v);
        views[v] = (sgs_view){
            .name = (char *)names[v],
            .camera = {SGS_CAMERA_PINHOLE, SIDE, SIDE, {SIDE, SIDE, SIDE / 2, SIDE / 2}},
            .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.1 * v, 0, 3}},
            .image = {.width = SIDE, .height = SIDE, .channels = 3, .pixels = pixels[v]}};
    }
    for (int i = 0; i < 3 * POINTS; ++i) {
        points[i] = (float)(2 * sgsi_random_uniform(1, (uint64_t)i) - 1);
        colors[i] = (uint8_t)(40 * i);
    }
    sgs_threads_set(1);
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    sgs_step_info info;
    FUZZ_REQUIRE(!sgs_trainer_create(&scene, &options, &trainer));
    for (int i = 0; i < 3; ++i)
        FUZZ_REQUIRE(!sgs_trainer_step(trainer, &info));
    FUZZ_REQUIRE(!sgs_trainer_save_checkpoint(trainer, fuzz_path("input")));
    FUZZ_REQUIRE(!sgsi_file_read(fuzz_path("input"), 0, &good, &good_size));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (!good)
        prepare();
    if (size < 8)
        data = good, size = good_size;
    uint8_t *bytes = malloc(size);
    FUZZ_REQUIRE(bytes);
    memcpy(bytes, data, size);
    checkpoint_reseal(bytes, size);
    const char *path = fuzz_file("input", bytes, size);
    const bool trains = bytes[size - 1] % 8 == 0 || bytes[size - 1] == good[good_size - 1]; // slow
    free(bytes);
    if (sgs_trainer_load_checkpoint(trainer, path)) {
        fuzz_check_refusal(path);
        return 0;
    }
    const char *again = fuzz_path("again");
    uint8_t *written[2];
    size_t sizes[2];
    for (int round = 0; round < 2; ++round) {
        FUZZ_REQUIRE(!sgs_trainer_save_checkpoint(trainer, again));
        FUZZ_REQUIRE(!sgsi_file_read(again, 0, &written[round], &sizes[round]));
        FUZZ_REQUIRE(!sgs_trainer_load_checkpoint(trainer, again));
    }
    FUZZ_REQUIRE(sizes[0] == sizes[1] && !memcmp(written[0], written[1], sizes[0]));
    sgsi_free(written[0]);
    sgsi_free(written[1]);
    sgs_step_info info;
    const sgs_status status = trains ? sgs_trainer_step(trainer, &info) : SGS_STATUS_OK;
    FUZZ_REQUIRE(!status || status == SGS_STATUS_LIMIT);
    return 0;
}
