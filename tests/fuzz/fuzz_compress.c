// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Compressed models of one method and image codec. The checksums of the input are corrected first;
// otherwise no input would pass them. Inputs below 8 bytes select a valid file, so that seeds do
// not depend on the format. Checks that errors name the file and that decoded parameters are
// finite.

#include "support/compress_support.h"
#include "base/threads.h"
#include "fuzz_good.h"

#ifndef FUZZ_CODEC
#define FUZZ_CODEC SGS_IMAGE_CODEC_JXL
#endif

static void prepare(void)
{
    sgsi_threads_set(1);
    sgs_compress_options options = sgs_compress_options_default();
    while (strcmp(sgs_compress_method_name(options.method), FUZZ_METHOD))
        options.method = (sgs_compress_method)((options.method + 1) % 6);
    options.finetune = 0;
    options.codec = FUZZ_CODEC;
    options.codebook = 16;
    options.vq_steps = 5;
    sgs_gaussians *model = pack_model(40, 1, 1);
    FUZZ_REQUIRE(model && !sgs_compress(model, &options, fuzz_path("input"), NULL));
    FUZZ_REQUIRE(!sgsi_file_read(fuzz_path("input"), 0, &good, &good_size));
    sgs_gaussians_destroy(model);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (!good)
        prepare();
    const bool is_good = size < 8;
    if (is_good)
        data = good, size = good_size;
    uint8_t *bytes = malloc(size);
    FUZZ_REQUIRE(bytes);
    memcpy(bytes, data, size);
    pack_reseal(bytes, size);
    const char *path = fuzz_file("input", bytes, size);
    free(bytes);
    sgs_gaussians *model;
    if (sgs_decompress(path, &model, NULL)) {
        FUZZ_REQUIRE(!is_good);
        fuzz_check_refusal(path);
        return 0;
    }
    for (size_t i = 0; i < model->count; ++i) {
        float row[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, row);
        fuzz_check_finite(row, SGS_PARAM_COUNT);
    }
    sgs_gaussians_destroy(model);
    return 0;
}
