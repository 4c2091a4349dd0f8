// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads the intrinsics of transforms.json (transforms.c) from JSON objects. Errors name file, frame
// and key. Does not access photos.

#include <stdbool.h>

#include <jansson.h>

#include "scene/dataset.h"

typedef struct sgsi_transforms_reader {
    const char *path;
    char where[48];          // "frame 3" or "the global keys"
    bool ignores_distortion; // warned
    bool ignores_intrinsics; // of a panorama; warned
} sgsi_transforms_reader;

enum { SGSI_LENS_NUMBERS = 19 };

// Intrinsics as the keys state them. `model` belongs to the JSON object.
typedef struct sgsi_lens_keys {
    double value[SGSI_LENS_NUMBERS]; // NaN if absent
    const char *model;               // camera_model, NULL if absent
    bool fisheye;                    // instant-ngp's is_fisheye
    bool panorama;                   // instant-ngp's latlong
} sgsi_lens_keys;

// No key is present. Cannot fail.
sgsi_lens_keys sgsi_lens_keys_none(void);

// Sets the values that are present in `object`, between calls of plain_numbers.h: first of the
// global object, then of a frame. FORMAT: a value is unusable; UNSUPPORTED: the lens.
sgs_status sgsi_lens_keys_read(const sgsi_transforms_reader *r, const json_t *object,
                               sgsi_lens_keys *out);

// Sets frame->camera and circle, and frame->angle_x and angle_y if the photo completes it. FORMAT:
// no valid camera; UNSUPPORTED: the model.
sgs_status sgsi_lens_keys_apply(sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                                sgsi_frame *frame);
