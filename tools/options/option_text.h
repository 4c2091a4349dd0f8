// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The values of options as text, to compare two command lines.

#include <stdio.h>

#include "options/options.h"

// Writes a line "--name: value" for each option of all groups, given or not, except those in
// "a|b|c".
void options_describe(FILE *out, const command_line *line, const char *except);
// The same for those in "a|b|c".
void options_describe_only(FILE *out, const command_line *line, const char *names);
