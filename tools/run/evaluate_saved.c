// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/evaluate_saved.h"

#include <stdint.h>
#include <stdlib.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "processes/rank_group.h"
#include "run/exposure_file.h"

// The colour maps that rank 0 reads.
static bool read_exposures(const saved_evaluation *input, json_t **exposures)
{
    bool damaged = false;
    if (!input->has_exposure)
        return true;
    char *path = format_text("%s/exposure.json", input->output);
    if (group_leads())
        *exposures = exposure_read(path, &damaged);
    free(path);
    if (!group_all(!damaged))
        return false;
    *exposures = group_json(*exposures);
    return true;
}

// Several ranks share the model, as in training; one process reads it.
static bool open_saved(const saved_evaluation *input, sgs_gaussians **model, evaluator *evaluation)
{
    char *path = format_text("%s/point_cloud/iteration_%d/point_cloud.ply", input->output,
                             input->iterations);
    bool done = false;
    if (group_ranks())
        done = evaluator_open_shared(evaluation, path, input->scene, &input->drawing);
    else if (sgs_ply_read(path, model))
        fail_library();
    else
        done = evaluator_open(evaluation, *model, input->scene, &input->drawing);
    free(path);
    return done;
}

bool evaluate_saved(const saved_evaluation *input, split_score *test, split_score *train)
{
    sgs_gaussians *model = NULL;
    json_t *exposures = NULL;
    evaluator evaluation = {0};
    bool done = read_exposures(input, &exposures) && open_saved(input, &model, &evaluation);
    evaluation.exposures = exposures;
    evaluation.lpips = input->lpips;
    evaluation.lpips_input = input->lpips_input;
    done = done && evaluate_split(&evaluation, SGS_SPLIT_TEST, SIZE_MAX, test) &&
           evaluate_split(&evaluation, SGS_SPLIT_TRAIN, input->train_most, train);
    evaluator_close(&evaluation);
    sgs_gaussians_destroy(model);
    json_decref(exposures);
    return done;
}
