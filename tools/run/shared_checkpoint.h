// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A checkpoint that only rank 0 can read (cli/rank_group.h), loaded by all ranks.

#include <stdbool.h>

#include "sparegs/trainer.h"

// Rank 0 has loaded the checkpoint at `path`, NULL for none; the others load the same bytes. False
// after printing the error. Collective; without ranks it does nothing.
bool shared_checkpoint_load(sgs_trainer *trainer, const char *path);
