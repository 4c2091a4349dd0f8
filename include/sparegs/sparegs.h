// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// All public headers at once.

#include "sparegs/export.h"
#include "sparegs/status.h"
#include "sparegs/version.h"

// Process-wide settings; files.
#include "sparegs/runtime.h"
#include "sparegs/output_file.h"

// Data: cameras, images, the model, scenes.
#include "sparegs/camera.h"
#include "sparegs/compress.h"
#include "sparegs/gaussians.h"
#include "sparegs/image.h"
#include "sparegs/metrics.h"
#include "sparegs/rate_distortion.h"
#include "sparegs/model_edit.h"
#include "sparegs/model_file.h"
#include "sparegs/usd_cameras.h"
#include "sparegs/region.h"
#include "sparegs/scene.h"
#include "sparegs/blocks.h"

// Work: rendering, training, on one process or several.
#include "sparegs/ranks.h"
#include "sparegs/render.h"
#include "sparegs/run.h"
#include "sparegs/aov_descriptors.h"
#include "sparegs/trainer.h"
#include "sparegs/rank_check.h"
#include "sparegs/rank_renderer.h"
#include "sparegs/option_descriptors.h"
#include "sparegs/prune.h"

// Measurement of the program itself; an application that renders or trains needs neither.
#include "sparegs/bench.h"
#include "sparegs/profile.h"
