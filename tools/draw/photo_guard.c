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

// Compares the names first: most files are other ones.
static bool is_file(const char *path, const char *input)
{
    return input && !strcmp(base_name(path), base_name(input)) && same_file(path, input);
}

bool photo_guard_admits(const sgs_scene *scene, const char *folder, const char *stem)
{
    static const char *const endings[] = {"png", "exr"};
    bool admits = true;
    for (int k = 0; k < 2 && admits; ++k) {
        char *path = format_text("%s/%s.%s", folder, stem, endings[k]);
        const size_t views = scene && file_exists(path) ? scene->view_count : 0;
        for (size_t v = 0; v < views && admits; ++v) {
            const sgs_view *view = &scene->views[v];
            admits = !is_file(path, view->image_path) && !is_file(path, view->mask_path);
        }
        if (!admits)
            fail_run("%s: is a photograph or a mask of the scene; choose another folder", path);
        free(path);
    }
    return admits;
}
