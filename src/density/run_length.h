// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The length of a run compared with the published one. Pure functions.

struct sgs_train_options;

enum { SGSI_PAPER_LENGTH = 30000, SGSI_SHORT_LENGTH = 7000 }; // iterations

// How far a run of N iterations follows the rules of short runs: 1 up to N = 7000, log-linear to 0
// at 30 000. Not scaled to N: 0.
double sgsi_run_shortness(const struct sgs_train_options *options);
