// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The key of an option in JSON and in the library, and its name on the command line.

#include <string.h>

// Turns the key of an option in JSON, "spare_grid", into its name, "spare-grid".
static inline void key_to_name(char *text)
{
    for (char *dash = text; (dash = strchr(dash, '_'));)
        *dash = '-';
}
