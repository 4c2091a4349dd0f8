// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A locale with a decimal comma, as desktop programs set it. Include after cmocka.h.

#include <locale.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "support/files_support.h"

// Sets LC_NUMERIC to an installed locale, or to one made in a temporary folder. False if the system
// cannot make one.
static inline bool decimal_comma_set(void)
{
    static const char source[] =
        "LC_NUMERIC\ndecimal_point \",\"\nthousands_sep \"\"\ngrouping -1\nEND LC_NUMERIC\n";
    if (setlocale(LC_NUMERIC, "de_DE.UTF-8") || setlocale(LC_NUMERIC, "fr_FR.UTF-8"))
        return true;
    const temp_folder folder = temp_folder_make();
    char command[1024];
    file_put(temp_path(&folder, "source"), source, sizeof source - 1);
    snprintf(command, sizeof command,
             "cd '%s' && localedef -c -i source -f UTF-8 ./comma.UTF-8 >log 2>&1", folder.path);
    const bool made = system(command) != -1 && !setenv("LOCPATH", folder.path, 1) &&
                      setlocale(LC_NUMERIC, "comma.UTF-8");
    unsetenv("LOCPATH");
    tree_remove(&folder);
    return made;
}

// Back to the decimal point.
static inline void decimal_comma_unset(void)
{
    setlocale(LC_NUMERIC, "C");
}
