// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The rows of --aov.

#include "draw/aov_list.h"

#include "sparegs/aov_descriptors.h"

// NOLINTNEXTLINE(bugprone-macro-parentheses): an initialiser, not an expression
#define AOV_WORD(id, word) [AOV_INDEX_##id] = word,
const char *const aov_words[AOV_ROWS] = {AOV_LIST(AOV_WORD, AOV_WORD)};

const aov_row aov_rows[AOV_ROWS] = {
    [AOV_INDEX_RGBA] = {.source = "color",
                        .made = AOV_MADE_ALPHA,
                        .channels = {"R", "G", "B", "A"},
                        .half = true,
                        .picture = AOV_PICTURE_COLOR},
    [AOV_INDEX_DEPTH] = {.source = "depth_mean",
                         .channels = {"depth.Z"},
                         .picture = AOV_PICTURE_RAMP},
    [AOV_INDEX_DEPTH_MEDIAN] = {.source = "depth_median",
                                .channels = {"depth_median.Z"},
                                .picture = AOV_PICTURE_RAMP},
    [AOV_INDEX_DEPTH_FIRST] = {.source = "depth_first",
                               .channels = {"depth_first.Z"},
                               .picture = AOV_PICTURE_RAMP},
    [AOV_INDEX_TRANSMITTANCE] = {.source = "transmittance",
                                 .channels = {"transmittance.T"},
                                 .half = true,
                                 .picture = AOV_PICTURE_GREY},
    [AOV_INDEX_HITS] = {.source = "hits", .channels = {"hits.count"}, .picture = AOV_PICTURE_RAMP},
    [AOV_INDEX_NORMAL] = {.source = "normal",
                          .channels = {"N.X", "N.Y", "N.Z"},
                          .half = true,
                          .picture = AOV_PICTURE_NORMALS},
    [AOV_INDEX_POSITION] = {.source = "position",
                            .channels = {"P.X", "P.Y", "P.Z"},
                            .picture = AOV_PICTURE_POSITIONS},
    [AOV_INDEX_PRIMITIVE] = {.source = "primitive",
                             .channels = {"primitive.id"},
                             .picture = AOV_PICTURE_IDS},
    [AOV_INDEX_REGION] = {.source = "primitive",
                          .made = AOV_MADE_REGION,
                          .channels = {"region.id"},
                          .picture = AOV_PICTURE_IDS},
    [AOV_INDEX_SLACK] = {.source = "primitive",
                         .made = AOV_MADE_SLACK,
                         .channels = {"slack.S"},
                         .picture = AOV_PICTURE_SLACK},
    [AOV_INDEX_CANDIDATES] = {.source = "candidates",
                              .channels = {"candidates.count"},
                              .picture = AOV_PICTURE_RAMP},
};

unsigned aov_planes(unsigned aovs)
{
    unsigned planes = 0;
    for (int k = 0; k < AOV_ROWS; ++k)
        if (aovs >> k & 1)
            planes |= sgs_aov_find(aov_rows[k].source)->bit;
    return planes;
}
