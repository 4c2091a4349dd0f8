// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of `sparegs render` that no other command has.

#include <stdbool.h>

#include "options/options.h"

typedef struct render_values {
    const char *output, *view, *camera, *run;
    int split, format, encoding, depth, compression;
    unsigned aovs, save_cameras;
    bool reference, half, deep, skip_existing;
    double deep_tolerance;
    int deep_max;
    const char *frames, *size, *film, *depth_range;
    int orbit, spiral, first_frame, projection, samples, path_lens, overscan;
    double arc;
    double aperture, focus, fps;
} render_values;

enum { RENDER_OPTIONS = 32 };
extern const option render_options[RENDER_OPTIONS]; // values: render_values
