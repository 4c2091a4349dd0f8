// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PLY models. Checks that errors name the file, accepted models are finite, and a write and read
// gives the same bits.

#include "fuzz_gaussians.h"
#include "sparegs/gaussians.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file("input", data, size);
    sgs_gaussians *model;
    if (sgs_ply_read(path, &model)) {
        fuzz_check_refusal(path);
        FUZZ_REQUIRE(!model);
        return 0;
    }
    FUZZ_REQUIRE(model->count <= size && model->sh_degree >= 0 && model->sh_degree <= 3);
    fuzz_check_model(model);
    sgs_gaussians_destroy(model);
    return 0;
}
