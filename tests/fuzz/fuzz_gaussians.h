// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// For targets that read models.

#include "fuzz_support.h"
#include "sparegs/gaussians.h"

// Asserts that a model is finite, and that a PLY of it has the same bits.
static inline void fuzz_check_model(const sgs_gaussians *model)
{
    sgs_gaussians *copy;
    fuzz_check_finite(model->data, model->capacity * SGS_PARAM_COUNT);
    char hashes[2][17];
    const char *again = fuzz_path("again");
    FUZZ_REQUIRE(!sgs_ply_write(again, model));
    sgs_gaussians_hash(model, hashes[0]);
    FUZZ_REQUIRE(!sgs_ply_read(again, &copy));
    sgs_gaussians_hash(copy, hashes[1]);
    FUZZ_REQUIRE(!strcmp(hashes[0], hashes[1]));
    sgs_gaussians_destroy(copy);
}
