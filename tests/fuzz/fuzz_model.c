// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Model files; FUZZ_FILE selects the format by its name. Checks that errors name the file, accepted
// models are finite and have no more primitives than their bytes can hold, and a PLY of the model
// has the same bits.

#include "fuzz_gaussians.h"
#include "sparegs/model_file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    // The most generous bound is that of SPZ, version 4.
    const size_t most = 16 * size + (1 << 16);
    const char *path = fuzz_file(FUZZ_FILE, data, size);
    sgs_gaussians *model;
    if (sgs_model_read(path, NULL, &model, NULL)) {
        fuzz_check_refusal(path);
        FUZZ_REQUIRE(!model);
        return 0;
    }
    FUZZ_REQUIRE(model->count <= most && model->sh_degree >= 0 && model->sh_degree <= 3);
    fuzz_check_model(model);
    sgs_gaussians_destroy(model);
    return 0;
}
