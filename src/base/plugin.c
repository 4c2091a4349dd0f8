// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/plugin.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static void *load_from(const char *folder, const char *file, bool global, char *reason,
                       size_t bytes)
{
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%s/%s", folder, file) >= (int)sizeof path ||
        access(path, F_OK)) {
        return NULL;
    }
    void *plugin = dlopen(path, RTLD_NOW | (global ? RTLD_GLOBAL : RTLD_LOCAL));
    if (!plugin)
        snprintf(reason, bytes, "%.400s", dlerror());
    return plugin;
}

// The folder of the program's file.
static bool program_folder(char folder[PATH_MAX])
{
    const ssize_t length = readlink("/proc/self/exe", folder, PATH_MAX - 1);
    if (length <= 0)
        return false;
    folder[length] = 0;
    char *slash = strrchr(folder, '/');
    if (!slash)
        return false;
    *slash = 0;
    return true;
}

void *sgsi_plugin_load(const char *folder, const char *file, bool global, char *reason,
                       size_t bytes)
{
    if (folder)
        return load_from(folder, file, global, reason, bytes);
    char program[PATH_MAX], place[PATH_MAX];
    const bool known = program_folder(program), absolute = SGSI_PLUGIN_DIR[0] == '/';
    void *plugin = known ? load_from(program, file, global, reason, bytes) : NULL;
    if (plugin)
        return plugin;
    if (absolute)
        return load_from(SGSI_PLUGIN_DIR, file, global, reason, bytes);
    if (!known ||
        snprintf(place, sizeof place, "%s/%s", program, SGSI_PLUGIN_DIR) >= (int)sizeof place)
        return NULL;
    return load_from(place, file, global, reason, bytes);
}

bool sgsi_plugin_find(void *plugin, const char *name, void *function, char *reason, size_t bytes)
{
    void *symbol = dlsym(plugin, name);
    if (!symbol) {
        snprintf(reason, bytes, "%.400s", dlerror());
        return false;
    }
    memcpy(function, &symbol, sizeof symbol); // C has no cast from an object to a function
    return true;
}
