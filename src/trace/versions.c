// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Version string of the libraries: Embree and OpenEXR as loaded, OpenImageIO as compiled against.

#include <openexr.h>
#include <pthread.h>
#include <stdio.h>

#include "bvh/bvh.h"
#include "sparegs/runtime.h"

static char line[256];
static pthread_once_t line_once = PTHREAD_ONCE_INIT;

static void make_line(void)
{
    int major, minor, patch;
    const char *extra;
    exr_get_library_version(&major, &minor, &patch, &extra);
    snprintf(line, sizeof line, "%s, OpenImageIO %s, OpenEXR %d.%d.%d", sgsi_bvh_version(),
             SGSI_OIIO_VERSION, major, minor, patch);
}

const char *sgs_version_libraries(void)
{
    pthread_once(&line_once, make_line);
    return line;
}
