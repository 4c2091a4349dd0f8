// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/evaluate_saved.h"

#include <stdlib.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "cli/rank_group.h"
#include "run/exposure_file.h"

static bool read_saved(const saved_evaluation *input, sgs_gaussians **model, json_t **exposures)
{
    char *path = format_text("%s/point_cloud/iteration_%d/point_cloud.ply", input->output,
                             input->iterations);
    char *exposure_path = format_text("%s/exposure.json", input->output);
    bool done = true, damaged = false;
    if (group_leads()) {
        done = !sgs_ply_read(path, model);
        if (!done)
            fail_library();
        *exposures = input->has_exposure ? exposure_read(exposure_path, &damaged) : NULL;
    }
    done = group_all(done && !damaged) &&
           !sgs_ranks_broadcast_model(group_ranks(), SGS_STATUS_OK, model);
    if (done && input->has_exposure)
        *exposures = group_json(*exposures);
    free(exposure_path);
    free(path);
    return done;
}

bool evaluate_saved(const saved_evaluation *input, split_score *test, split_score *train)
{
    sgs_gaussians *model = NULL;
    json_t *exposures = NULL;
    evaluator evaluation = {0};
    bool done = read_saved(input, &model, &exposures);
    done = group_all(done && evaluator_open(&evaluation, model, input->scene, &input->drawing));
    evaluation.exposures = exposures;
    evaluation.lpips = input->lpips;
    evaluation.lpips_input = input->lpips_input;
    done = done && evaluate_split(&evaluation, SGS_SPLIT_TEST, test) &&
           evaluate_split(&evaluation, SGS_SPLIT_TRAIN, train);
    evaluator_close(&evaluation);
    sgs_gaussians_destroy(model);
    json_decref(exposures);
    return done;
}
