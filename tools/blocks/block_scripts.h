// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The shell scripts of `sparegs split`: coarse.sh and blocks.sh, which run under Slurm and without.

#include <stdbool.h>
#include <stddef.h>

// Writes both scripts into `folder` and reports them on stdout. False after printing the error.
bool block_scripts_write(const char *folder, const char *scene, size_t blocks);
