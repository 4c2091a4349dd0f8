// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Whether the ranks of a machine use its cores well. Asks neither the launcher nor the system.

typedef struct rank_cores {
    int own;      // cores that this rank may use
    long machine; // cores of its machine
    int ranks;    // on this machine
    int threads;  // of this rank, as of the others
} rank_cores;

// What is wrong and how to start the ranks instead, for a warning; NULL if nothing is. Release with
// free().
char *rank_cores_advice(const rank_cores *cores);
