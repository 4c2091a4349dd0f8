// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The counters, averages and timers of a training run as named fields of its checkpoint.

#include "base/fields.h"
#include "train/trainer_state.h"

void sgsi_train_progress_write(sgsi_field_list *list, const sgsi_train_progress *progress);

// Reads the content of the section. Timers without a record start at 0; counters that the training
// depends on are required. Errors as sgsi_fields_read; values are not checked.
sgs_status sgsi_train_progress_read(const char *path, const uint8_t *bytes, size_t size,
                                    sgsi_train_progress *progress);
