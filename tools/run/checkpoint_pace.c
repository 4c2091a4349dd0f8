// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/checkpoint_pace.h"

bool checkpoint_pace_allows(const checkpoint_pace *pace)
{
    enum { MAX_SECONDS = 1800, MAX_INTERVALS = 10 };
    const double share = 0.05;
    return pace->spent <= share * pace->elapsed || pace->age >= MAX_SECONDS ||
           pace->intervals >= MAX_INTERVALS;
}
