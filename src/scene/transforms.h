// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads the camera files of NeRF synthetic (transforms_train.json, transforms_test.json) and of
// nerfstudio and instant-ngp (transforms.json). Does not access photos.

#include "scene/dataset.h"

// `path`: the JSON file. If its name ends in transforms_train.json, transforms_test.json in the
// same folder is read as well. On failure *dataset is empty.
sgs_status sgsi_transforms_read(const char *path, sgsi_dataset *dataset);
