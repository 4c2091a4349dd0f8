// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Numbers in files use a decimal point, whatever the locale of the calling program. Acts on the
// calling thread, between begin and end; without memory the locale stays as it is.

#include <locale.h>

typedef struct sgsi_plain_numbers {
    locale_t plain, earlier;
} sgsi_plain_numbers;

static inline sgsi_plain_numbers sgsi_plain_numbers_begin(void)
{
    sgsi_plain_numbers numbers = {.plain = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0)};
    if (numbers.plain)
        numbers.earlier = uselocale(numbers.plain);
    return numbers;
}

static inline void sgsi_plain_numbers_end(const sgsi_plain_numbers *numbers)
{
    if (!numbers->plain)
        return;
    uselocale(numbers->earlier);
    freelocale(numbers->plain);
}
