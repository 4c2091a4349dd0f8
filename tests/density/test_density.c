// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Density control on models small enough to predict each row. Rows are identified by their red SH
// coefficient, because an update sorts them into Morton order.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core.h"
#include "base/morton.h"
#include "base/threads.h"
#include "density/density.h"
#include "density/pipeline.h"
#include "spare/spare.h"
#include "sparegs/trainer.h"

typedef struct fixture {
    const sgsi_pipeline *pipeline;
    sgs_gaussians *model;
    float *m, *v;
    sgsi_statistics statistics;
    spare_options spare;
    sgsi_density_options options;
    sgsi_density_result result;
} fixture;

static fixture make(size_t count)
{
    fixture f = {.pipeline = &sgsi_pipeline_3dgs};
    assert_int_equal(sgs_gaussians_create(count, &f.model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(f.model, count), SGS_STATUS_OK);
    f.m = sgsi_calloc(f.model->capacity, SGS_PARAM_COUNT * sizeof(float));
    f.v = sgsi_calloc(f.model->capacity, SGS_PARAM_COUNT * sizeof(float));
    assert_int_equal(sgsi_statistics_reserve(&f.statistics, f.model->capacity), SGS_STATUS_OK);
    f.options = (sgsi_density_options){.gradient_threshold = 2e-4,
                                       .opacity_min = 0.005,
                                       .size_split = 0.1,
                                       .size_max = INFINITY,
                                       .seed = 1,
                                       .iteration = 600};
    f.spare = spare_options_default();
    for (size_t i = 0; i < count; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        p[SGS_PARAM_MEAN] = (float)sgsi_random_uniform(9, 3 * i);
        p[SGS_PARAM_MEAN + 1] = (float)sgsi_random_uniform(9, 3 * i + 1);
        p[SGS_PARAM_MEAN + 2] = (float)sgsi_random_uniform(9, 3 * i + 2);
        p[SGS_PARAM_ROTATION] = 1;
        for (int k = 0; k < 3; ++k)
            p[SGS_PARAM_SCALE + k] = logf(0.05f);
        p[SGS_PARAM_OPACITY] = 0; // 0.5
        p[SGS_PARAM_SH_DC] = (float)i;
        sgs_gaussians_set(f.model, i, p);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            const size_t at = ((i / 16) * SGS_PARAM_COUNT + (size_t)k) * 16 + i % 16;
            f.m[at] = (float)i + 0.25f;
            f.v[at] = (float)i + 0.5f;
        }
        f.statistics.visible_count[i] = 2;
    }
    return f;
}

static void drop(fixture *f)
{
    sgs_gaussians_destroy(f->model);
    sgsi_free(f->m);
    sgsi_free(f->v);
    sgsi_statistics_free(&f->statistics);
    sgsi_free(f->result.region_list);
}

static void update(fixture *f)
{
    const sgsi_density_rows rows = {
        .model = f->model, .m = &f->m, .v = &f->v, .statistics = &f->statistics};
    sgsi_free(f->result.region_list);
    f->options.spare = &f->spare;
    assert_int_equal(sgsi_density_update(&rows, f->pipeline, &f->options, &f->result),
                     SGS_STATUS_OK);
}

static size_t rows_of(const fixture *f, float tag, size_t rows[8])
{
    size_t count = 0;
    for (size_t i = 0; i < f->model->count; ++i)
        if (*sgs_gaussians_at(f->model, i, SGS_PARAM_SH_DC) == tag && count < 8)
            rows[count++] = i;
    return count;
}

static float moment(const float *block, size_t i, int k)
{
    return block[((i / 16) * SGS_PARAM_COUNT + (size_t)k) * 16 + i % 16];
}

static void clone_copies_the_row_and_starts_its_moments_at_zero(void **state)
{
    (void)state;
    fixture f = make(40);
    f.statistics.gradient_sum[7] = 5e-4f;   // mean 2.5e-4
    f.statistics.gradient_sum[8] = 3.9e-4f; // below the threshold
    update(&f);
    assert_int_equal(f.model->count, 41);
    assert_int_equal(f.result.cloned, 1);
    assert_int_equal(f.result.split, 0);
    size_t rows[8];
    assert_int_equal(rows_of(&f, 7, rows), 2);
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        assert_true(*sgs_gaussians_at(f.model, rows[0], k) ==
                    *sgs_gaussians_at(f.model, rows[1], k));
    const float sum = moment(f.m, rows[0], 3) + moment(f.m, rows[1], 3);
    assert_true(sum == 7.25f); // moments of the row and of its clone, 0
    assert_int_equal(rows_of(&f, 8, rows), 1);
    assert_true(moment(f.v, rows[0], 0) == 8.5f);
    for (size_t i = 0; i < f.model->count; ++i)
        assert_true(f.statistics.gradient_sum[i] == 0 && f.statistics.visible_count[i] == 0 &&
                    f.statistics.radius_max[i] == 0);
    drop(&f);
}

static void rows_after_the_last_one_are_inert(void **state)
{
    (void)state;
    for (int linear = 0; linear < 2; ++linear) {
        fixture f = make(40);
        f.model->linear_opacity = linear;
        for (size_t i = 0; i < 40 && linear; ++i)
            *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = 0.5f;
        f.statistics.gradient_sum[7] = 5e-4f;
        update(&f);
        assert_int_equal(f.model->count, 41);
        assert_true(f.model->capacity > 41);
        for (size_t i = f.model->count; i < f.model->capacity; ++i)
            for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
                const float expected = k == SGS_PARAM_ROTATION  ? 1.0f
                                       : k == SGS_PARAM_OPACITY ? (linear ? 0.0f : -30.0f)
                                       : k >= SGS_PARAM_SCALE && k < SGS_PARAM_OPACITY ? -20.0f
                                                                                       : 0.0f;
                if (*sgs_gaussians_at(f.model, i, k) != expected)
                    fail_msg("parameter %d of row %zu is %g", k, i,
                             (double)*sgs_gaussians_at(f.model, i, k));
                assert_true(moment(f.m, i, k) == 0 && moment(f.v, i, k) == 0);
            }
        drop(&f);
    }
}

static void split_replaces_the_parent_by_two_smaller_children_around_it(void **state)
{
    (void)state;
    fixture f = make(40);
    for (int k = 0; k < 3; ++k)
        *sgs_gaussians_at(f.model, 5, SGS_PARAM_SCALE + k) = logf(k == 1 ? 0.4f : 0.02f);
    const float y = *sgs_gaussians_at(f.model, 5, SGS_PARAM_MEAN + 1);
    f.statistics.gradient_sum[5] = 1e-3f;
    update(&f);
    assert_int_equal(f.model->count, 41);
    assert_int_equal(f.result.split, 1);
    size_t rows[8];
    assert_int_equal(rows_of(&f, 5, rows), 2);
    for (int c = 0; c < 2; ++c) {
        assert_true(fabsf(expf(*sgs_gaussians_at(f.model, rows[c], SGS_PARAM_SCALE + 1)) - 0.25f) <
                    1e-5f);
        assert_true(fabsf(*sgs_gaussians_at(f.model, rows[c], SGS_PARAM_MEAN + 1) - y) < 0.4f * 6);
        assert_true(moment(f.m, rows[c], 0) == 0);
    }
    assert_true(*sgs_gaussians_at(f.model, rows[0], SGS_PARAM_MEAN) !=
                *sgs_gaussians_at(f.model, rows[1], SGS_PARAM_MEAN));
    drop(&f);
}

static void split_children_scatter_like_the_parent(void **state)
{
    (void)state;
    fixture f = make(4000);
    double along = 0, across = 0;
    for (size_t i = 0; i < 4000;
         ++i) { // rotated by 90 degrees about z: the long axis x points along world y
        *sgs_gaussians_at(f.model, i, SGS_PARAM_ROTATION) = 0.70710678f;
        *sgs_gaussians_at(f.model, i, SGS_PARAM_ROTATION + 3) = 0.70710678f;
        *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(0.5f);
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + k) = 0;
        f.statistics.gradient_sum[i] = 1;
    }
    update(&f);
    assert_int_equal(f.model->count, 8000);
    for (size_t i = 0; i < 8000; ++i) {
        along += pow(*sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + 1), 2) / 8000;
        across += pow(*sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN), 2) / 8000;
    }
    assert_true(fabs(sqrt(along) - 0.5) < 0.02);
    assert_true(fabs(sqrt(across) - 0.05) < 0.002);
    drop(&f);
}

static void faint_and_oversized_rows_are_pruned(void **state)
{
    (void)state;
    fixture f = make(40);
    *sgs_gaussians_at(f.model, 3, SGS_PARAM_OPACITY) = logf(0.004f / 0.996f);
    *sgs_gaussians_at(f.model, 4, SGS_PARAM_OPACITY) = logf(0.006f / 0.994f);
    *sgs_gaussians_at(f.model, 9, SGS_PARAM_SCALE) = logf(3.0f);
    update(&f);
    assert_int_equal(f.model->count, 39);
    size_t rows[8];
    assert_int_equal(rows_of(&f, 3, rows), 0);
    assert_int_equal(rows_of(&f, 4, rows), 1);
    f.options.size_max = 1;
    update(&f);
    assert_int_equal(rows_of(&f, 9, rows), 0);
    assert_int_equal(f.model->count, 38);
    drop(&f);
}

// 3DGS prunes after it splits: the children are judged by their own size, 1.6 times smaller.
static void children_of_a_split_are_pruned_by_their_own_size(void **state)
{
    (void)state;
    fixture f = make(40);
    const struct {
        size_t row;
        float scale; // of the parent, for size_max 1
        size_t children;
    } cases[] = {{7, 1.5f, 2}, {8, 1.59f, 2}, {9, 1.61f, 0}, {10, 3.0f, 0}};
    for (size_t k = 0; k < 4; ++k) {
        *sgs_gaussians_at(f.model, cases[k].row, SGS_PARAM_SCALE) = logf(cases[k].scale);
        f.statistics.gradient_sum[cases[k].row] = 1e-3f;
    }
    f.options.size_max = 1;
    update(&f);
    size_t rows[8];
    for (size_t k = 0; k < 4; ++k)
        assert_int_equal(rows_of(&f, (float)cases[k].row, rows), cases[k].children);
    drop(&f);
}

// Linear opacity: |x|, not a logit.
static void linear_opacities_are_pruned_by_their_value(void **state)
{
    (void)state;
    fixture f = make(40);
    for (size_t i = 0; i < 40; ++i)
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = 0.5f;
    *sgs_gaussians_at(f.model, 3, SGS_PARAM_OPACITY) = 0.004f;
    *sgs_gaussians_at(f.model, 4, SGS_PARAM_OPACITY) = -0.006f;
    *sgs_gaussians_at(f.model, 5, SGS_PARAM_OPACITY) = -20.0f; // a logit of 2e-9
    sgs_gaussians_declare_linear_opacity(f.model);
    update(&f);
    size_t rows[8];
    assert_int_equal(f.model->count, 39);
    assert_int_equal(rows_of(&f, 3, rows), 0);
    assert_int_equal(rows_of(&f, 4, rows), 1);
    assert_int_equal(rows_of(&f, 5, rows), 1);
    drop(&f);
}

static void cap_is_never_exceeded_and_keeps_the_best_scores(void **state)
{
    (void)state;
    fixture f = make(100);
    f.options.max_count = 110;
    for (size_t i = 0; i < 100; ++i)
        f.statistics.gradient_sum[i] = 1e-3f + 1e-5f * (float)i;
    update(&f);
    assert_int_equal(f.model->count, 110);
    size_t rows[8];
    for (int i = 0; i < 100; ++i)
        assert_int_equal(rows_of(&f, (float)i, rows), i < 90 ? 1 : 2);
    drop(&f);
}

// The score for growth is the larger of the mean gradient and the share of the mean absolute one,
// times the weight.
static void rows_grow_by_their_share_of_absolute_gradients(void **state)
{
    (void)state;
    for (int on = 0; on < 2; ++on) {
        fixture f = make(4);
        f.options.abs_share = on ? 0.5 : 0.0;
        f.statistics.abs_grad_sum[0] = 2 * 4.1e-4f;
        f.statistics.abs_grad_sum[1] = 2 * 3.9e-4f;
        f.statistics.abs_grad_sum[2] = 2 * 1e-4f;
        f.statistics.gradient_sum[2] = 2 * 2.1e-4f;
        update(&f);
        size_t rows[8];
        assert_int_equal(rows_of(&f, 0, rows), on ? 2 : 1);
        assert_int_equal(rows_of(&f, 1, rows), 1);
        assert_int_equal(rows_of(&f, 2, rows), 2);
        assert_int_equal(rows_of(&f, 3, rows), 1);
        drop(&f);
    }
}

// At the cap, rows of an opacity below 0.4 that do not grow make room for growth: those of least
// opacity times squared radius, at most 10 % of the cap per update. After a reset, when the opacity
// of all rows is low, none is replaced.
static void growth_continues_at_the_cap_by_replacing_rows_of_low_opacity(void **state)
{
    (void)state;
    for (size_t growing = 3; growing <= 57; growing += 27) {
        fixture f = make(100);
        f.options.max_count = 100;
        f.options.opacity_is_reset = growing == 57;
        for (size_t i = 0; i < 100; ++i) {
            f.statistics.radius_max[i] = (float)(100 - i);
            *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) =
                i < 20 ? logf(0.35f / 0.65f) : logf(0.45f / 0.55f);
            f.statistics.gradient_sum[i] = i >= 100 - growing ? 1e-3f + 1e-5f * (float)i : 0.0f;
        }
        update(&f);
        const size_t replaced = growing == 57 ? 0 : growing < 10 ? growing : 10;
        assert_int_equal(f.model->count, 100);
        assert_int_equal(f.result.cloned, replaced);
        assert_int_equal(f.result.pruned, replaced);
        size_t rows[8];
        for (size_t i = 0; i < 100; ++i)
            assert_int_equal(rows_of(&f, (float)i, rows), i >= 20 - replaced && i < 20 ? 0
                                                          : i >= 100 - replaced        ? 2
                                                                                       : 1);
        drop(&f);
    }
}

// As above, with a limit of 6 % on removal: three rows are faint and removed anyway, so that three
// are replaced. Rows 0 to 9 were not seen since the last update and stay.
static void replaced_rows_were_seen_and_count_as_removed(void **state)
{
    (void)state;
    fixture f = make(100);
    f.options.max_count = 100;
    f.options.removal_max = 0.06;
    for (size_t i = 0; i < 100; ++i) {
        f.statistics.visible_count[i] = i >= 10;
        f.statistics.radius_max[i] = i < 10 ? 0.0f : (float)(100 - i);
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = i < 20 ? logf(0.35f / 0.65f) : 1.0f;
        f.statistics.gradient_sum[i] = i >= 80 ? 1e-3f + 1e-5f * (float)i : 0.0f;
    }
    for (size_t i = 30; i < 33; ++i)
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = -8.0f;
    update(&f);
    assert_int_equal(f.result.pruned, 6);
    assert_int_equal(f.result.cloned, 6);
    assert_int_equal(f.model->count, 100);
    size_t rows[8];
    for (size_t i = 0; i < 80; ++i)
        assert_int_equal(rows_of(&f, (float)i, rows),
                         !((i >= 17 && i < 20) || (i >= 30 && i < 33)));
    drop(&f);
}

// Row 1 is not finite. Rows 10 to 29 are faint, the later the fainter, and row 40 is opaque but too
// large: of 100 rows, an update limited to 5 % removes row 1 and the four faintest.
static void a_limited_update_removes_the_faintest_rows_first(void **state)
{
    (void)state;
    const double shares[] = {0.0, 0.05, 0.215, 0.5};
    const size_t removed[] = {22, 5, 21, 22};
    for (int k = 0; k < 4; ++k) {
        fixture f = make(100);
        f.options.removal_max = shares[k];
        f.options.size_max = 1.0;
        *sgs_gaussians_at(f.model, 1, SGS_PARAM_SCALE) = NAN;
        for (size_t i = 10; i < 30; ++i)
            *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = -6.0f - 0.1f * (float)i;
        *sgs_gaussians_at(f.model, 40, SGS_PARAM_SCALE) = logf(2.0f);
        update(&f);
        assert_int_equal(f.result.pruned, removed[k]);
        assert_int_equal(f.model->count, 100 - removed[k]);
        size_t rows[8];
        for (size_t i = 0; i < 100; ++i) {
            const bool faint = i >= 31 - removed[k] && i >= 10 && i < 30;
            const bool goes = i == 1 || faint || (i == 40 && removed[k] == 22);
            assert_int_equal(rows_of(&f, (float)i, rows), !goes);
        }
        drop(&f);
    }
}

// Faint rows whose gradient is large: their clones and children are faint as well, so growth does
// not circumvent the limit.
static void faint_rows_that_grow_count_against_the_limit(void **state)
{
    (void)state;
    for (int limited = 0; limited < 2; ++limited) {
        fixture f = make(100);
        f.options.removal_max = limited ? 0.05 : 0.0;
        for (size_t i = 10; i < 30; ++i) {
            *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = -6.0f - 0.1f * (float)i;
            *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(i % 2 ? 0.05f : 0.4f);
            f.statistics.gradient_sum[i] = 1e-2f;
        }
        update(&f);
        assert_int_equal(f.model->count, limited ? 95 : 80);
        size_t rows[8];
        for (size_t i = 10; i < 30; ++i)
            assert_int_equal(rows_of(&f, (float)i, rows), limited && i < 25);
        drop(&f);
    }
}

// Of the rows with a large gradient none grows, of the faint ones 5 % are removed.
static void thinning_only_removes(void **state)
{
    (void)state;
    const sgsi_pipeline *pipelines[] = {&sgsi_pipeline_3dgs, &sgsi_pipeline_mip};
    for (int p = 0; p < 2; ++p) {
        fixture f = make(100);
        f.pipeline = pipelines[p];
        f.options.removal_max = 0.05;
        f.options.final_prune = true;
        for (size_t i = 0; i < 100; ++i) {
            if (i >= 10 && i < 20)
                *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = -6.0f - 0.1f * (float)i;
            *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(i % 2 ? 0.05f : 0.4f);
            f.statistics.gradient_sum[i] = 1e-2f;
            f.statistics.abs_grad_sum[i] = 1e-2f;
        }
        update(&f);
        assert_int_equal(f.model->count, 95);
        assert_int_equal(f.result.bmd_suppressed + f.result.bmd_boosted, 0);
        size_t rows[8];
        for (size_t i = 0; i < 100; ++i)
            assert_int_equal(rows_of(&f, (float)i, rows), i < 15 || i >= 20);
        drop(&f);
    }
}

// Rows 0 to 19 are too large, their children are not. At the cap there is no room for the children.
static void a_split_that_the_cap_denies_keeps_its_row(void **state)
{
    (void)state;
    fixture f = make(100);
    f.options.max_count = 100;
    f.options.size_max = 1.0;
    for (size_t i = 0; i < 100; ++i)
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = 3.0f;
    for (size_t i = 0; i < 20; ++i) {
        *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(1.5f);
        f.statistics.gradient_sum[i] = 1e-2f;
    }
    update(&f);
    assert_int_equal(f.model->count, 100);
    assert_int_equal(f.result.split, 0);
    assert_int_equal(f.result.pruned, 0);
    drop(&f);
}

// Rows 0 to 9 are too large; row 50 grows. They go where the cap has room for its clone without
// them, and stay where it has not: nothing would cover their area again.
static void large_rows_stay_where_the_cap_has_no_room_for_growth(void **state)
{
    (void)state;
    const struct {
        size_t cap, count, pruned;
    } cases[] = {{0, 91, 10}, {101, 91, 10}, {100, 100, 0}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        fixture f = make(100);
        f.options.max_count = cases[k].cap;
        f.options.size_max = 1.0;
        for (size_t i = 0; i < 100; ++i)
            *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = 3.0f;
        for (size_t i = 0; i < 10; ++i)
            *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(2.0f);
        f.statistics.gradient_sum[50] = 1e-2f;
        update(&f);
        assert_int_equal(f.result.pruned, cases[k].pruned);
        assert_int_equal(f.model->count, cases[k].count);
        drop(&f);
    }
}

static void rap_removes_faint_still_primitives_of_crowded_voxels_only(void **state)
{
    (void)state;
    fixture f = make(200);
    for (size_t i = 0; i < 200; ++i) {
        const float x = i < 150
                            ? 0.01f * (float)sgsi_random_uniform(3, i)
                            : 0.2f + 0.016f * (float)(i - 150); // many in one voxel, then a line
        *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN) = x;
        *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + 1) =
            *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + 2) = 0;
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = i % 2 ? 0 : logf(0.03f / 0.97f);
        f.statistics.radius_max[i] = 4;
    }
    f.options.spare_prune = true;
    update(&f);
    assert_int_equal(f.result.spare_pruned, 75);
    assert_int_equal(f.model->count, 125);
    assert_true(f.result.regions > 10);
    size_t rows_in_regions = 0, redundant = 0;
    for (size_t r = 0; r < f.result.regions; ++r) { // the regions add up to the result
        rows_in_regions += f.result.region_list[r].count;
        redundant += f.result.region_list[r].redundant;
        assert_true(r == 0 || f.result.region_list[r].voxel > f.result.region_list[r - 1].voxel);
        assert_true(!f.result.region_list[r].redundant ||
                    (double)f.result.region_list[r].count > (double)f.result.region_list[r].quota);
    }
    assert_int_equal(rows_in_regions, 200);
    assert_int_equal(redundant, 75);
    size_t rows[8];
    assert_int_equal(rows_of(&f, 0, rows), 0);   // faint, in the crowded voxel
    assert_int_equal(rows_of(&f, 1, rows), 1);   // opaque, in the crowded voxel
    assert_int_equal(rows_of(&f, 160, rows), 1); // faint, alone
    drop(&f);
}

static void reset_lowers_opacities_and_clears_their_moments(void **state)
{
    (void)state;
    fixture f = make(20);
    *sgs_gaussians_at(f.model, 3, SGS_PARAM_OPACITY) = logf(0.006f / 0.994f);
    sgsi_density_reset_opacity(f.model, f.m, f.v, 0.01, NULL);
    assert_true(fabsf(1 / (1 + expf(-*sgs_gaussians_at(f.model, 2, SGS_PARAM_OPACITY))) - 0.01f) <
                1e-6f);
    assert_true(fabsf(1 / (1 + expf(-*sgs_gaussians_at(f.model, 3, SGS_PARAM_OPACITY))) - 0.006f) <
                1e-6f);
    assert_true(moment(f.m, 5, SGS_PARAM_OPACITY) == 0 && moment(f.v, 5, SGS_PARAM_OPACITY) == 0);
    assert_true(moment(f.m, 5, SGS_PARAM_SCALE) == 5.25f);
    drop(&f);
}

static void sorting_keeps_every_row(void **state)
{
    (void)state;
    fixture f = make(333);
    assert_int_equal(sgsi_density_sort(f.model), SGS_STATUS_OK);
    assert_int_equal(f.model->count, 333);
    size_t rows[8];
    for (int i = 0; i < 333; ++i)
        assert_int_equal(rows_of(&f, (float)i, rows), 1);
    drop(&f);
}

// All rows are near x = 5e6, the last one is not finite; the box of the grid must not include the
// origin.
static void rows_that_are_not_finite_are_in_no_region(void **state)
{
    (void)state;
    sgs_region *without = NULL;
    size_t regions = 0;
    for (int with = 0; with < 2; ++with) {
        fixture f = make(400 + (size_t)with);
        f.options.spare_densify = f.options.spare_prune = true;
        for (size_t i = 0; i < f.model->count; ++i) {
            *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN) += 5e6f;
            *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + 1) *= 200;
            f.statistics.gradient_sum[i] = 1e-5f * (float)i;
            f.statistics.radius_max[i] = 1 + (float)(i % 7);
        }
        if (with) // the centre is finite
            *sgs_gaussians_at(f.model, 400, SGS_PARAM_SCALE + 1) = NAN;
        update(&f);
        if (!with) {
            regions = f.result.regions;
            without = f.result.region_list;
            f.result.region_list = NULL;
            assert_true(regions > 100);
        } else {
            assert_int_equal(f.result.regions, regions);
            assert_memory_equal(f.result.region_list, without, regions * sizeof *without);
        }
        drop(&f);
    }
    sgsi_free(without);
}

// ---- Large updates, whose passes are divided ----

enum { LARGE = 100000 };

static int by_key_and_row(const void *a, const void *b)
{
    const uint64_t *x = a, *y = b;
    return x[0] != y[0] ? (x[0] > y[0]) - (x[0] < y[0]) : (x[1] > y[1]) - (x[1] < y[1]);
}

// Means on a coarse lattice, so that many keys are equal; every 7th row is cloned, every 11th is
// faint, one is not finite.
static void new_rows_are_in_morton_order_and_then_in_the_order_of_the_old_ones(void **state)
{
    (void)state;
    for (int threads = 1; threads < 8; threads += 3) {
        fixture f = make(LARGE);
        uint64_t(*expected)[2] = malloc(2 * LARGE * sizeof *expected);
        size_t count = 0;
        for (size_t i = 0; i < LARGE; ++i) {
            float mean[3];
            for (int k = 0; k < 3; ++k) {
                float *x = sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + k);
                *x = mean[k] = i < 2 ? (float)i : floorf(24 * *x) / 24;
            }
            f.statistics.gradient_sum[i] = i % 7 ? 0.0f : 1e-3f;
            if (i % 11 == 3)
                *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = -9;
            if (i == 5000)
                *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = NAN;
            const uint64_t key = sgsi_morton_code(mean, (float[3]){0, 0, 0}, (float[3]){1, 1, 1});
            for (int k = 0; k < 1 + (i % 7 == 0) && i != 5000 && i % 11 != 3; ++k) {
                expected[count][0] = key;
                expected[count++][1] = i;
            }
        }
        qsort(expected, count, sizeof *expected, by_key_and_row);
        sgsi_threads_set(threads);
        update(&f);
        sgsi_threads_set(0);
        assert_int_equal(f.model->count, count);
        for (size_t i = 0; i < count; ++i) {
            const float tag = (float)expected[i][1];
            const bool second = i && expected[i][1] == expected[i - 1][1],
                       clone = expected[i][1] % 7 == 0 && !second;
            assert_true(*sgs_gaussians_at(f.model, i, SGS_PARAM_SH_DC) == tag);
            assert_true(moment(f.m, i, 3) == (clone ? 0.0f : tag + 0.25f));
        }
        free(expected);
        drop(&f);
    }
}

// An update with SPARE-GS that clones, splits and removes, followed by an opacity reset.
static fixture large_update(int threads, const sgsi_pipeline *pipeline, double size_max, size_t cap)
{
    fixture f = make(LARGE);
    f.pipeline = pipeline;
    f.options.size_max = size_max;
    f.options.max_count = cap;
    f.options.spare_densify = f.options.spare_prune = true;
    for (size_t i = 0; i < LARGE; ++i) {
        const double u = sgsi_random_uniform(71, i), w = sgsi_random_uniform(72, i);
        const double seen = floor(40 * sgsi_random_uniform(73, i));
        f.statistics.gradient_sum[i] = f.statistics.abs_grad_sum[i] = (float)(4e-4 * u * u * seen);
        f.statistics.radius_max[i] = (float)(1 + 20 * w);
        f.statistics.visible_count[i] = (uint32_t)seen;
        *sgs_gaussians_at(f.model, i, SGS_PARAM_OPACITY) = (float)(12 * w - 8);
        *sgs_gaussians_at(f.model, i, SGS_PARAM_SCALE) = logf(u > 0.9 ? 0.4f : 0.02f);
        for (int k = 0; k < 3; ++k) // crowded at one side
            *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + k) *=
                *sgs_gaussians_at(f.model, i, SGS_PARAM_MEAN + k);
    }
    sgsi_threads_set(threads);
    update(&f);
    sgsi_density_reset_opacity(f.model, f.m, f.v, 0.01, NULL);
    sgsi_threads_set(0);
    return f;
}

static void large_updates_do_not_depend_on_the_threads(void **state)
{
    (void)state;
    const sgsi_pipeline *pipelines[] = {&sgsi_pipeline_3dgs, &sgsi_pipeline_mip};
    for (int p = 0; p < 2; ++p) {
        fixture f = large_update(1, pipelines[p], INFINITY, 0);
        const sgsi_density_result *a = &f.result;
        assert_true(a->cloned > 1000 && a->split > 1000 && a->spare_pruned > 1000 &&
                    a->pruned > a->spare_pruned && a->bmd_boosted && a->bmd_suppressed);
        for (int threads = 2; threads < 8; threads += 3) {
            fixture g = large_update(threads, pipelines[p], INFINITY, 0);
            const size_t bytes = f.model->capacity * SGS_PARAM_COUNT * sizeof(float);
            const sgsi_density_result *b = &g.result;
            assert_int_equal(f.model->count, g.model->count);
            assert_int_equal(f.model->capacity, g.model->capacity);
            assert_memory_equal(f.model->data, g.model->data, bytes);
            assert_memory_equal(f.m, g.m, bytes);
            assert_memory_equal(f.v, g.v, bytes);
            assert_memory_equal(a->region_list, b->region_list,
                                a->regions * sizeof *a->region_list);
            assert_true(a->cloned == b->cloned && a->split == b->split && a->pruned == b->pruned &&
                        a->spare_pruned == b->spare_pruned && a->regions == b->regions &&
                        a->bmd_boosted == b->bmd_boosted && a->mean_weight == b->mean_weight &&
                        a->bmd_suppressed == b->bmd_suppressed &&
                        a->over_budget_share == b->over_budget_share);
            drop(&g);
        }
        drop(&f);
    }
}

static void a_cap_with_room_for_all_changes_nothing(void **state)
{
    (void)state;
    const sgsi_pipeline *pipelines[] = {&sgsi_pipeline_3dgs, &sgsi_pipeline_mip};
    for (int p = 0; p < 2; ++p) {
        fixture f = large_update(0, pipelines[p], 0.3, 0),
                g = large_update(0, pipelines[p], 0.3, 3 * LARGE);
        const sgsi_density_result *a = &f.result, *b = &g.result;
        assert_true(a->pruned > a->spare_pruned + 1000);
        assert_int_equal(f.model->count, g.model->count);
        assert_memory_equal(f.model->data, g.model->data,
                            f.model->capacity * SGS_PARAM_COUNT * sizeof(float));
        assert_true(a->spare_pruned == b->spare_pruned && a->bmd_boosted == b->bmd_boosted &&
                    a->bmd_suppressed == b->bmd_suppressed);
        drop(&f);
        drop(&g);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_that_are_not_finite_are_in_no_region),
        cmocka_unit_test(clone_copies_the_row_and_starts_its_moments_at_zero),
        cmocka_unit_test(rows_after_the_last_one_are_inert),
        cmocka_unit_test(split_replaces_the_parent_by_two_smaller_children_around_it),
        cmocka_unit_test(split_children_scatter_like_the_parent),
        cmocka_unit_test(faint_and_oversized_rows_are_pruned),
        cmocka_unit_test(children_of_a_split_are_pruned_by_their_own_size),
        cmocka_unit_test(linear_opacities_are_pruned_by_their_value),
        cmocka_unit_test(cap_is_never_exceeded_and_keeps_the_best_scores),
        cmocka_unit_test(rows_grow_by_their_share_of_absolute_gradients),
        cmocka_unit_test(growth_continues_at_the_cap_by_replacing_rows_of_low_opacity),
        cmocka_unit_test(replaced_rows_were_seen_and_count_as_removed),
        cmocka_unit_test(a_limited_update_removes_the_faintest_rows_first),
        cmocka_unit_test(faint_rows_that_grow_count_against_the_limit),
        cmocka_unit_test(thinning_only_removes),
        cmocka_unit_test(a_split_that_the_cap_denies_keeps_its_row),
        cmocka_unit_test(large_rows_stay_where_the_cap_has_no_room_for_growth),
        cmocka_unit_test(rap_removes_faint_still_primitives_of_crowded_voxels_only),
        cmocka_unit_test(reset_lowers_opacities_and_clears_their_moments),
        cmocka_unit_test(sorting_keeps_every_row),
        cmocka_unit_test(new_rows_are_in_morton_order_and_then_in_the_order_of_the_old_ones),
        cmocka_unit_test(a_cap_with_room_for_all_changes_nothing),
        cmocka_unit_test(large_updates_do_not_depend_on_the_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
