// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stddef.h>
#include <time.h>

// Sleeps for less than a second, so that other threads get a core even on a busy machine.
static inline void rest(double seconds)
{
    const struct timespec time = {.tv_nsec = (long)(1e9 * seconds)};
    nanosleep(&time, NULL);
}
