// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of base pipelines.

#include "density/pipeline.h"

const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline)
{
    static const sgsi_pipeline *const pipelines[] = {
        [SGS_PIPELINE_3DGS] = &sgsi_pipeline_3dgs,     [SGS_PIPELINE_MIP] = &sgsi_pipeline_mip,
        [SGS_PIPELINE_TAMING] = &sgsi_pipeline_taming, [SGS_PIPELINE_DASH] = &sgsi_pipeline_dash,
        [SGS_PIPELINE_FASTGS] = &sgsi_pipeline_fastgs,
    };
    return pipelines[pipeline];
}
