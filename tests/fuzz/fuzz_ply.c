// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PLY models. Checks that errors name the file, accepted models are finite, and a write and read
// gives the same bits.

#include "fuzz_support.h"
#include "sparegs/gaussians.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file("input", data, size);
    sgs_gaussians *model, *copy;
    if (sgs_ply_read(path, &model)) {
        fuzz_check_refusal(path);
        FUZZ_REQUIRE(!model);
        return 0;
    }
    FUZZ_REQUIRE(model->count <= size && model->sh_degree >= 0 && model->sh_degree <= 3);
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
