// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The program loads image_oiio.cpp as the plug-in images.so: OpenImageIO depends on more than 200
// shared libraries, and a command that reads no image need not wait for the dynamic linker. The
// functions of image_oiio.h are then those of image_load.c, which call the plug-in. The library
// contains image_oiio.cpp itself.

#include "image/image_oiio.h"

enum { SGSI_IMAGE_PLUGIN_VERSION = 3 };

// What the plug-in calls of the program, see base/core.h.
typedef struct sgsi_image_host {
    void (*record_error)(const char *format, ...);
    void *(*alloc)(size_t count, size_t size);
    void (*release)(void *block);
} sgsi_image_host;

// The functions of image_oiio.h.
typedef struct sgsi_image_functions {
    sgs_status (*read)(const char *path, bool is_mask, sgs_image8 *image);
    sgs_status (*probe)(const char *path, int *width, int *height, int *channels);
    sgs_status (*describe)(const char *path, const char *colorspace, sgsi_image_info *info);
    sgs_status (*read_rows)(const char *path, const char *colorspace, sgsi_row_fn take,
                            void *context);
    sgs_status (*png_encode)(const char *path, const sgs_image8 *image, const char *description,
                             uint8_t **bytes, size_t *size);
    sgs_status (*dwaa_encode)(const char *path, const sgs_exr_info *info,
                              const sgs_exr_channel *channels, int channel_count, uint8_t **bytes,
                              size_t *size);
} sgsi_image_functions;

// The only symbol of the plug-in. Returns SGSI_IMAGE_PLUGIN_VERSION.
typedef int (*sgsi_image_plugin_open_fn)(const sgsi_image_host *host,
                                         sgsi_image_functions *functions);
#define SGSI_IMAGE_PLUGIN_OPEN "sgsi_image_plugin_open"
