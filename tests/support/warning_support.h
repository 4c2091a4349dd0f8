// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Collects the warnings of the library.

#include <stdio.h>
#include <string.h>

#include "sparegs/status.h"

static char warnings[16384]; // a line each
static int warning_count;

static inline void warning_collect(void *user, const char *message)
{
    (void)user;
    const size_t used = strlen(warnings);
    snprintf(warnings + used, sizeof warnings - used, "%s\n", message);
    ++warning_count;
}

// Clears the collected warnings and starts collecting; also a set-up of tests.
static inline int warnings_begin(void **state)
{
    (void)state;
    warnings[0] = 0;
    warning_count = 0;
    sgs_warning_handler_set(warning_collect, NULL);
    return 0;
}

static inline void warnings_end(void)
{
    sgs_warning_handler_set(NULL, NULL);
}
