// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of base pipelines.

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
