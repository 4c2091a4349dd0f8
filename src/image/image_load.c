// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The functions of image_oiio.h in the program: the first call loads the plug-in.

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "base/core.h"
#include "base/plugin.h"
#include "image/image_plugin.h"

#define PLUGIN "images.so"

static pthread_once_t once = PTHREAD_ONCE_INIT;
static bool loaded;
static char reason[512] = "it is neither next to the program nor in " SGSI_PLUGIN_DIR;
static sgsi_image_functions functions;

// Loads the libraries of OpenImageIO one by one, so that the loader searches each one's symbols
// among its own libraries instead of all 260: a third less time than for all at once. One that is
// missing is left to the loader of the plug-in.
static void load_needs(void)
{
    char names[] = SGSI_OIIO_NEEDS, *rest = names;
    for (char *name; (name = strsep(&rest, " "));)
        if (*name)
            dlopen(name, RTLD_LAZY | RTLD_LOCAL);
}

static void load_plugin(void)
{
    const sgsi_image_host host = {
        .record_error = sgsi_record_error, .alloc = sgsi_alloc, .release = sgsi_free};
    load_needs();
    void *plugin = sgsi_plugin_load(NULL, PLUGIN, false, reason, sizeof reason);
    sgsi_image_plugin_open_fn open_fn;
    if (!plugin ||
        !sgsi_plugin_find(plugin, SGSI_IMAGE_PLUGIN_OPEN, &open_fn, reason, sizeof reason))
        return;
    loaded = open_fn(&host, &functions) == SGSI_IMAGE_PLUGIN_VERSION;
    if (!loaded)
        snprintf(reason, sizeof reason, "it belongs to another version of sparegs");
}

static sgs_status need_plugin(const char *path)
{
    pthread_once(&once, load_plugin);
    return loaded ? SGS_STATUS_OK
                  : sgsi_fail(SGS_STATUS_UNSUPPORTED,
                              "%s: the image plug-in " PLUGIN " cannot be loaded: %s; copy it from "
                              "the folder that sparegs was built in, or install sparegs",
                              path, reason);
}

sgs_status sgsi_oiio_read(const char *path, bool is_mask, sgs_image8 *image)
{
    const sgs_status status = need_plugin(path);
    return status ? status : functions.read(path, is_mask, image);
}

sgs_status sgsi_oiio_probe(const char *path, int *width, int *height, int *channels)
{
    const sgs_status status = need_plugin(path);
    return status ? status : functions.probe(path, width, height, channels);
}

sgs_status sgsi_oiio_describe(const char *path, const char *colorspace, sgsi_image_info *info)
{
    const sgs_status status = need_plugin(path);
    return status ? status : functions.describe(path, colorspace, info);
}

sgs_status sgsi_oiio_read_rows(const char *path, const char *colorspace, sgsi_row_fn take,
                               void *context)
{
    const sgs_status status = need_plugin(path);
    return status ? status : functions.read_rows(path, colorspace, take, context);
}

sgs_status sgsi_oiio_png_encode(const char *path, const sgs_image8 *image, const char *description,
                                uint8_t **bytes, size_t *size)
{
    const sgs_status status = need_plugin(path);
    return status ? status : functions.png_encode(path, image, description, bytes, size);
}

sgs_status sgsi_oiio_dwaa_encode(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count,
                                 uint8_t **bytes, size_t *size)
{
    const sgs_status status = need_plugin(path);
    return status ? status
                  : functions.dwaa_encode(path, info, channels, channel_count, bytes, size);
}
