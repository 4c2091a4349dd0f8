// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a rank spends in the calls between ranks during the iterations of a training run, for
// summary.json. Without ranks nothing is counted.

#include <jansson.h>

#include "processes/rank_group.h"

typedef struct rank_clock {
    sgs_ranks_seconds before[SGS_RANKS_PURPOSE_COUNT]; // totals before the present iteration
    sgs_ranks_seconds spent[SGS_RANKS_PURPOSE_COUNT];  // in the iterations
    // Of the iterations after the first epoch, whose cuts follow measured costs.
    double warm_seconds, warm_waiting, warm_moving;
} rank_clock;

// Around each iteration, which took `seconds`. warm: it is after the first epoch.
void rank_clock_start(rank_clock *clock);
void rank_clock_stop(rank_clock *clock, double seconds, bool warm);

// Of all ranks in their order, on rank 0: [{"train_seconds":s, "waiting":{"records":s, ...},
// "moving":{...}, "waiting_share":x, "moving_share":x, "peak_rss_bytes":b}, ...]. The shares are of
// the iterations after the first epoch, null without any. NULL on other ranks, without ranks or on
// failure. Collective.
json_t *rank_clock_json(const rank_clock *clock, double train_seconds);

// Prints "ranks: ..." to stdout from the array above; nothing for NULL.
void rank_clock_print(const json_t *clocks);
