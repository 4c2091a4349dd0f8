// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of base pipelines, and what several of them decide alike.

#include "density/pipeline.h"

const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline)
{
    static const sgsi_pipeline *const pipelines[] = {
        [SGS_PIPELINE_3DGS] = &sgsi_pipeline_3dgs,     [SGS_PIPELINE_MIP] = &sgsi_pipeline_mip,
        [SGS_PIPELINE_TAMING] = &sgsi_pipeline_taming, [SGS_PIPELINE_DASH] = &sgsi_pipeline_dash,
        [SGS_PIPELINE_FASTGS] = &sgsi_pipeline_fastgs, [SGS_PIPELINE_MCMC] = &sgsi_pipeline_mcmc,
    };
    return pipelines[pipeline];
}

sgsi_sampling sgsi_pipeline_sampling(const sgs_train_options *train, double extent)
{
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(train->pipeline);
    return pipeline->sampling ? pipeline->sampling(train, extent)
                              : (sgsi_sampling){.start_opacity = 0.1, .start_scale = 1.0};
}

void sgsi_density_decide_thinning(const sgsi_density_options *options, sgsi_density_columns *c)
{
    for (size_t i = 0; i < c->count; ++i) {
        c->action[i] = SGSI_ACTION_KEEP;
        c->removed[i] = sgsi_density_should_prune(options, c->opacity[i], c->scale_max[i]);
        c->prune_children[i] = c->removed[i];
    }
}
