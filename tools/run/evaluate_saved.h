// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Evaluation of the model that a training run saved, on all ranks (rank_group.h); only rank 0
// reads the folder.

#include "run/evaluate.h"

typedef struct saved_evaluation {
    const char *output; // folder of the run
    int iterations;     // of the model
    const sgs_scene *scene;
    size_t train_most; // training views to score, evenly spaced
    drawing_values drawing;
    bool has_exposure;
    const sgs_lpips *lpips;
    sgs_lpips_input lpips_input;
} saved_evaluation;

// Scores the held-out views and the chosen training views. False after printing the error.
// Collective.
bool evaluate_saved(const saved_evaluation *input, split_score *test, split_score *train);
