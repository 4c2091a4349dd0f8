// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Counts the rejected inputs of a test program whose message is checked. Tests call bad_input()
// once per case; the program prints the number at exit, and tools/scripts/bad_inputs.sh adds them
// up.

#include <stdio.h>
#include <stdlib.h>

static int bad_input_count;

static inline void bad_input_tell(void)
{
    printf("bad inputs: %d\n", bad_input_count);
}

static inline void bad_input(void)
{
    if (bad_input_count++ == 0)
        atexit(bad_input_tell);
}
