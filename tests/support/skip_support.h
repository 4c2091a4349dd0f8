// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// How a test leaves out what this machine cannot do. cmocka counts it as passed, and so does CTest:
// tools/scripts/skipped_tests.sh lists it with its reason. Include after cmocka.h.

// Ends the test with a reason, the arguments of printf.
#define skip_because(...)                                                                          \
    do {                                                                                           \
        print_message("skipped: " __VA_ARGS__);                                                    \
        print_message("\n");                                                                       \
        skip();                                                                                    \
    } while (0)
