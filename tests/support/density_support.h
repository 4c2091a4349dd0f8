// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A small model with everything that a structural update reads, for tests of base pipelines.
// Include after cmocka.h.

#include <math.h>

#include "density/density.h"
#include "density/pipeline.h"
#include "spare/spare.h"
#include "support/oracle_support.h"

typedef struct fixture {
    sgs_gaussians *model;
    float *m, *v, *importance, *prune_score;
    sgsi_statistics statistics;
    sgs_train_options train;
    sgsi_pipeline_state state;
    const sgsi_pipeline *pipeline;
    spare_options spare;
    sgsi_density_options options;
    sgsi_density_result result;
} fixture;

// Rows store their number as red; all are small, have opacity 0.5 and the gradient `gradient`.
static inline fixture *make(const sgsi_pipeline *pipeline, size_t count, float gradient)
{
    fixture *f = oracle_memory(1, sizeof *f);
    assert_int_equal(sgs_gaussians_create(count, &f->model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(f->model, count), SGS_STATUS_OK);
    f->m = sgsi_calloc(f->model->capacity, SGS_PARAM_COUNT * sizeof(float));
    f->v = sgsi_calloc(f->model->capacity, SGS_PARAM_COUNT * sizeof(float));
    f->importance = sgsi_calloc(count, sizeof(float));
    f->prune_score = sgsi_calloc(count, sizeof(float));
    assert_int_equal(sgsi_statistics_reserve(&f->statistics, f->model->capacity), SGS_STATUS_OK);
    f->train = sgs_train_options_default();
    f->state.initial_count = (int64_t)count;
    f->options = (sgsi_density_options){.train = &f->train,
                                        .state = &f->state,
                                        .extent = 10,
                                        .update = 0,
                                        .update_count = 145,
                                        .until = 15000,
                                        .interval = 100,
                                        .resolution = 1,
                                        .importance = f->importance,
                                        .prune_score = f->prune_score,
                                        .gradient_threshold = 2e-4,
                                        .opacity_min = 0.005,
                                        .size_split = 0.1,
                                        .size_max = INFINITY,
                                        .seed = 1,
                                        .iteration = 600};
    f->pipeline = pipeline;
    f->spare = spare_options_default();
    f->options.spare = &f->spare;
    for (size_t i = 0; i < count; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        for (int k = 0; k < 3; ++k) {
            p[SGS_PARAM_MEAN + k] = (float)sgsi_random_uniform(9, 3 * i + (size_t)k);
            p[SGS_PARAM_SCALE + k] = logf(0.005f);
        }
        p[SGS_PARAM_ROTATION] = 1;
        p[SGS_PARAM_SH_DC] = (float)i;
        sgs_gaussians_set(f->model, i, p);
        f->statistics.visible_count[i] = 2;
        f->statistics.gradient_sum[i] = f->statistics.abs_grad_sum[i] = 2 * gradient;
        f->importance[i] = 10;
    }
    return f;
}

static inline void drop(fixture *f)
{
    sgs_gaussians_destroy(f->model);
    sgsi_free(f->m);
    sgsi_free(f->v);
    sgsi_free(f->importance);
    sgsi_free(f->prune_score);
    sgsi_statistics_free(&f->statistics);
    sgsi_free(f->result.region_list);
    free(f);
}

static inline size_t update(fixture *f)
{
    sgsi_free(f->result.region_list);
    const sgsi_density_rows rows = {
        .model = f->model, .m = &f->m, .v = &f->v, .statistics = &f->statistics};
    assert_int_equal(sgsi_density_update(&rows, f->pipeline, &f->options, &f->result),
                     SGS_STATUS_OK);
    return f->model->count;
}

static inline size_t copies_of(const fixture *f, float row)
{
    size_t count = 0;
    for (size_t i = 0; i < f->model->count; ++i)
        count += *sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC) == row;
    return count;
}

static inline void set_faint(fixture *f, size_t row)
{
    *sgs_gaussians_at(f->model, row, SGS_PARAM_OPACITY) = logf(0.004f / 0.996f);
}
