// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of a training run as named fields of its checkpoint, and what may differ when it is
// resumed.

#include "base/fields.h"
#include "sparegs/trainer.h"

// Every option that affects the result, as text (sgs_train_option_text).
void sgsi_options_write(sgsi_field_list *list, const sgs_train_options *options);

// Compares the options of a checkpoint (content of the section 'options') with `now`. A difference
// that the resume rule allows is a warning that names the first iteration with the new value; any
// other fails with INVALID_ARGUMENT, naming the field and both values. An option without a record
// had its default. *spare_changed: an option of SPARE-GS differs.
sgs_status sgsi_options_compare(const char *path, const uint8_t *bytes, size_t size,
                                const sgs_train_options *now, int iteration, bool *spare_changed);
