// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "draw/photo_guard.h"

#include <stdlib.h>
#include <string.h>

#include "cli/options.h"
#include "cli/output.h"
#include "cli/progress.h"

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

// True for STEM.png, STEM_photo.png, STEM.depth.png, STEM.deep.exr and the like.
static bool may_be_written(const char *name, const char *stem)
{
    const size_t length = strlen(stem);
    if (strncmp(name, stem, length) != 0 || (name[length] != '.' && name[length] != '_'))
        return false;
    const char *ending = strrchr(name, '.');
    return ending && (!strcmp(ending, ".png") || !strcmp(ending, ".exr"));
}

// Compares the names first: most files are other ones.
static bool spares(const char *folder, const char *stem, const char *input)
{
    if (!input || !may_be_written(base_name(input), base_name(stem)))
        return true;
    char *path =
        format_text("%s/%.*s%s", folder, (int)(base_name(stem) - stem), stem, base_name(input));
    const bool same = same_file(path, input);
    if (same)
        fail_run("%s: is a photo or a mask of the scene; choose another folder", path);
    free(path);
    return !same;
}

bool photo_guard_admits(const sgs_scene *scene, const char *folder, const char *stem)
{
    bool admits = true;
    for (size_t v = 0; scene && v < scene->view_count && admits; ++v) {
        const sgs_view *view = &scene->views[v];
        admits = spares(folder, stem, view->image_path) && spares(folder, stem, view->mask_path);
    }
    return admits;
}
