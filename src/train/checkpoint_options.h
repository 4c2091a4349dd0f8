// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of a training as text in its checkpoint, and what may differ when it is continued.

#include "sparegs/trainer.h"

// "iterations=30000\nschedule=0\n...": every option that shapes the result. Release with sgsi_free;
// NULL: out of memory.
char *sgsi_options_text(const sgs_train_options *options);

// Holds the text of a checkpoint (`bytes` long, not terminated) against `now`. Options that may
// change are warned of, with the iteration they change at; any other difference fails with
// INVALID_ARGUMENT and names the option and both values.
sgs_status sgsi_options_agree(const char *path, const char *text, size_t bytes,
                              const sgs_train_options *now, int iteration);
