// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a page learns when it connects, as JSON: the model, its cameras, the tables of its run.

#include <jansson.h>

#include "viewer/view_source.h"

// {"type": "hello", ...}: model, AOVs, colours of the ramp, views, up axis, first camera,
// options and summary of the run.
json_t *view_facts(view_source *source, bool training);

// {"type": "history", "train": {column: [...]}, "spare": {...}} from the CSV files of the run.
json_t *view_history(const view_source *source);
