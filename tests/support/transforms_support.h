// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Support for tests of transforms.json. Include after cmocka.h.

#include "support/scene_support.h"
#include "scene/transforms.h"

static inline void read_text(const temp_folder *folder, const char *text, sgsi_dataset *d)
{
    tree_put_text(folder, "transforms.json", text);
    if (sgsi_transforms_read(temp_path(folder, "transforms.json"), d))
        fail_msg("%s", sgs_last_error());
}
