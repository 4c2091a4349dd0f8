// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options in the config.json of a run that other commands take over, such as the size of the
// images and the pixel filter: their words and the check of their values.

#include <jansson.h>

// The words of --alpha, in the order of sgs_alpha.
#define ALPHA_WORDS "over|mask|ignore"
// The words of --train-space, in the order of sgs_space.
#define SPACE_WORDS "srgb|linear"
// The words of --filter, in the order of sgs_filter.
#define FILTER_WORDS "3dgs|none|mip"

// Warns about each recorded value of another type or out of range, and removes it from `config`, so
// that it counts as not recorded. `path` is the file, for the messages.
void recorded_options_check(json_t *config, const char *path);
