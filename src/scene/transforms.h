// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads the camera files of NeRF synthetic (transforms_train.json, transforms_test.json) and of
// nerfstudio and instant-ngp (transforms.json). Looks at no photograph.

#include "scene/dataset.h"

// `path` is the JSON file; a name that ends in transforms_train.json brings transforms_test.json
// beside it. On failure *dataset is empty and the error names file, frame, key and fix.
sgs_status sgsi_transforms_read(const char *path, sgsi_dataset *dataset);
