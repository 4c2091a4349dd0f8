// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The value of an option from its argument. Part of the option parser.

#include <stdbool.h>
#include <stddef.h>

#include "options/options.h"

enum { LONGEST_WORD = 63 };

// Parses the argument into the struct of values. False after printing the error. The value of a
// TEXT or FOLDER points into `argument`.
bool parse_value(const option *row, const char *argument, void *values);

// The range as written in the help: "1 to 30000 iterations". Held by `text`.
const char *range_text(const option *row, char text[96]);

// Copies word k of "a|b|c" or "a,b,c". False if there are fewer words.
bool word_at(const char *words, int k, char word[LONGEST_WORD + 1]);
// The index of the word text[0, length) in "a|b|c" or "a,b,c", or -1.
int word_index(const char *words, const char *text, size_t length);

// Removes slashes at the end: messages and configs contain OUT/point_cloud, not OUT//point_cloud.
void trim_slashes(char *path);
