// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Tables of the steps after training, as in the downstream tables of the SPARE-GS paper: size,
// time and quality of pruned and of compressed models without and with SPARE-GS at each operating
// point, the change of the time, BD-rate and BD-PSNR.

#include <jansson.h>

// Appends a table for pruning and one for compression to `tables` if the results have such steps,
// and one for the results that have no counterpart of variant off or on.
void post_tables_add(const json_t *results, json_t *tables);
