// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Model files; FUZZ_FILE selects the format by its name. Checks that errors name the file, accepted
// models are finite and have no more primitives than their bytes can hold, and a PLY of the model
// has the same bits.

#include "fuzz_support.h"
#include "sparegs/model_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    // gzip expands at most 1032 times, and a primitive of SPZ takes 16 bytes; textures of SOG may
    // have 65536 pixels more than bytes.
    const size_t most = 65 * size + (1 << 16);
    const char *path = fuzz_file(FUZZ_FILE, data, size);
    sgs_gaussians *model, *copy;
    if (sgs_model_read(path, NULL, &model, NULL)) {
        fuzz_check_refusal(path);
        FUZZ_REQUIRE(!model);
        return 0;
    }
    FUZZ_REQUIRE(model->count <= most && model->sh_degree >= 0 && model->sh_degree <= 3);
    fuzz_check_finite(model->data, model->capacity * SGS_PARAM_COUNT);
    char hashes[2][17];
    const char *again = fuzz_path("again");
    FUZZ_REQUIRE(!sgs_ply_write(again, model));
    sgs_gaussians_hash(model, hashes[0]);
    FUZZ_REQUIRE(!sgs_ply_read(again, &copy));
    sgs_gaussians_hash(copy, hashes[1]);
    FUZZ_REQUIRE(!strcmp(hashes[0], hashes[1]));
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(copy);
    return 0;
}
