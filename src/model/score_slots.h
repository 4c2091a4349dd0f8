// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The columns of the score pass: sums per primitive over the counted hits of one view, which the
// pipelines read. A row has 16 floats; unused ones are 0.

enum {
    SGSI_SCORE_WEIGHT = 0,   // weights of the pixels
    SGSI_SCORE_HITS = 1,     // number of hits
    SGSI_SCORE_BLEND = 2,    // T alpha
    SGSI_SCORE_DISTANCE = 3, // pixels from the projected centre
    SGSI_SCORE_FRONT = 4,    // T in front of the hit
    SGSI_SCORE_COUNT = 5
};
