// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The AOVs of --aov: their words and bits, and one row per AOV with its planes of a frame, its
// channels in an EXR and its PNG.

#include <stdbool.h>
#include <stddef.h>

// Identifiers and words in the order of help, layers and files; the rows are in aov_list.c.
#define AOV_LIST(FIRST, NEXT)                                                                      \
    FIRST(RGBA, "rgba")                                                                            \
    NEXT(DEPTH, "depth")                                                                           \
    NEXT(DEPTH_MEDIAN, "depth_median")                                                             \
    NEXT(DEPTH_FIRST, "depth_first")                                                               \
    NEXT(TRANSMITTANCE, "transmittance")                                                           \
    NEXT(HITS, "hits")                                                                             \
    NEXT(NORMAL, "normal")                                                                         \
    NEXT(POSITION, "position")                                                                     \
    NEXT(PRIMITIVE, "primitive")                                                                   \
    NEXT(REGION, "region")                                                                         \
    NEXT(SLACK, "slack")                                                                           \
    NEXT(CANDIDATES, "candidates")

#define AOV_INDEX(id, word) AOV_INDEX_##id,
enum { AOV_LIST(AOV_INDEX, AOV_INDEX) AOV_ROWS };
#undef AOV_INDEX
#define AOV_BIT(id, word) AOV_##id = 1 << AOV_INDEX_##id,
enum { AOV_LIST(AOV_BIT, AOV_BIT) AOV_ALL = (1 << AOV_ROWS) - 1 };
#undef AOV_BIT
// The argument of --aov: "all|rgba,depth,...".
#define AOV_FIRST_WORD(id, word) word
#define AOV_NEXT_WORD(id, word) "," word
#define AOV_WORDS "all|" AOV_LIST(AOV_FIRST_WORD, AOV_NEXT_WORD)

// The PNG of a quantity.
typedef enum aov_picture {
    AOV_PICTURE_COLOR,     // over the background
    AOV_PICTURE_GREY,      // 0 black, 1 white
    AOV_PICTURE_RAMP,      // dark to light over the range of all frames
    AOV_PICTURE_NORMALS,   // axes as red, green, blue
    AOV_PICTURE_POSITIONS, // axes as red, green, blue over these ranges
    AOV_PICTURE_IDS,       // a colour per number
    AOV_PICTURE_SLACK      // red to blue
} aov_picture;

// Planes derived from those of a frame; AOV_MADE_NONE: the planes of `source` only.
typedef enum aov_made {
    AOV_MADE_NONE,
    AOV_MADE_ALPHA, // 1 - transmittance, after the planes of `source`
    AOV_MADE_REGION,
    AOV_MADE_SLACK // both by the primitive of `source`, instead of its planes
} aov_made;

typedef struct aov_row {
    const char *source; // row of the library's table (sparegs/aov_descriptors.h)
    aov_made made;
    const char *channels[5]; // names in an EXR, NULL after the last
    bool half; // the channels may be stored as half floats: colours, shares and directions
    aov_picture picture;
} aov_row;

extern const aov_row aov_rows[AOV_ROWS];
extern const char *const aov_words[AOV_ROWS];

// The planes (SGS_AOV_ bits) of a frame that these quantities require.
unsigned aov_planes(unsigned aovs);
