// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The plug-in's side of image_plugin.h: what image_oiio.cpp calls of the program, and the entry.

#include <stdarg.h>
#include <stdio.h>

#include "base/core.h"
#include "image/image_plugin.h"

static sgsi_image_host host;

void sgsi_record_error(const char *format, ...)
{
    char text[4096];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    host.record_error("%s", text);
}

void *sgsi_alloc(size_t count, size_t size)
{
    return host.alloc(count, size);
}

void sgsi_free(void *block)
{
    host.release(block);
}

__attribute__((visibility("default"))) int sgsi_image_plugin_open(const sgsi_image_host *program,
                                                                  sgsi_image_functions *functions);

int sgsi_image_plugin_open(const sgsi_image_host *program, sgsi_image_functions *functions)
{
    host = *program;
    *functions = (sgsi_image_functions){.read = sgsi_oiio_read,
                                        .probe = sgsi_oiio_probe,
                                        .describe = sgsi_oiio_describe,
                                        .read_rows = sgsi_oiio_read_rows,
                                        .png_encode = sgsi_oiio_png_encode,
                                        .dwaa_encode = sgsi_oiio_dwaa_encode};
    return SGSI_IMAGE_PLUGIN_VERSION;
}
