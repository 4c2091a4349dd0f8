// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of a training as named fields of its checkpoint, and what may differ when it is
// resumed.

#include "base/fields.h"
#include "sparegs/trainer.h"

// Every option that shapes the result, as text (sgs_train_option_text).
void sgsi_options_write(sgsi_field_list *list, const sgs_train_options *options);

// Compares the options of a checkpoint (the content of the section) with `now`. Options that may
// change are warned about, with the iteration from which the new value is used; any other
// difference fails with INVALID_ARGUMENT, naming the field and both values. An option that the
// checkpoint does not name had its default. *spare_changed: one of SPARE-GS's differs.
sgs_status sgsi_options_compare(const char *path, const uint8_t *bytes, size_t size,
                                const sgs_train_options *now, int iteration, bool *spare_changed);
