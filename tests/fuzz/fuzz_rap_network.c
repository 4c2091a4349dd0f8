// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The weight file of `prune --method rap`. Checks that errors name the file and accepted networks
// give scores from 0 to 1.

#include "fuzz_support.h"
#include "sparegs/prune.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *path = fuzz_file("input", data, size);
    sgs_rap_network *network;
    if (sgs_rap_read(path, &network)) {
        FUZZ_REQUIRE(!network && strstr(sgs_last_error(), path));
        return 0;
    }
    const float features[SGS_RAP_FEATURES] = {0.0f, 0.25f, 0.5f, 1.0f};
    const double score = sgs_rap_score(network, features);
    FUZZ_REQUIRE(score >= 0 && score <= 1);
    sgs_rap_destroy(network);
    return 0;
}
