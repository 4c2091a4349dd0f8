// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of training options. A new option is one row here, one field in sgs_train_options and
// its use. The default of a new row must be what the program did before: a checkpoint that does not
// name the option was written with that value.

#include "sparegs/option_descriptors.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "density/pipeline.h"

// NOLINTBEGIN(bugprone-macro-parentheses): initialisers, not expressions
#define FIELD(member)                                                                              \
    .offset = offsetof(sgs_train_options, member),                                                 \
    .size = sizeof((const sgs_train_options *)0)->member
#define ALL_PIPELINES .pipelines = (1U << SGS_PIPELINE_COUNT) - 1
#define ONLY(pipeline) .pipelines = 1U << SGS_PIPELINE_##pipeline
// NOLINTEND(bugprone-macro-parentheses)

static const char training[] = "Training", base_pipelines[] = "Base pipelines",
                  spare_gs[] = "SPARE-GS", common[] = "Common";

static const sgs_train_option table[] = {
    {.name = "iterations",
     .type = SGS_OPTION_INT,
     FIELD(iterations),
     .initial = 30000,
     .low = 1,
     .high = 1e7,
     .values = "N",
     .help = "number of iterations",
     .group = training,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE_PAPER},
    {.name = "schedule",
     .type = SGS_OPTION_CHOICE,
     FIELD(schedule),
     .initial = SGS_SCHEDULE_SCALED,
     .values = "scaled|paper|finetune",
     .help = "scaled: the 30000-iteration schedule scaled to N iterations; paper: the unscaled "
             "schedule, stopped at N; finetune: for a trained initial model, no densification, "
             "pruning or opacity resets, position rate at its end",
     .group = training,
     ALL_PIPELINES},
    {.name = "batch",
     .type = SGS_OPTION_INT,
     FIELD(batch),
     .initial = 1,
     .low = 1,
     .high = 1024,
     .values = "B",
     .unit = "views",
     .help = "views per optimiser step: mean gradient, rates times the square root of B "
             "(Grendel-GS); fewer steps, another result. Iterations count views",
     .group = training,
     ALL_PIPELINES},
    {.name = "pipeline",
     .type = SGS_OPTION_CHOICE,
     FIELD(pipeline),
     .initial = SGS_PIPELINE_3DGS,
     .values = "3dgs|mip|taming|dash|fastgs|mcmc",
     .help = "base pipeline: 3DGS, Mip-Splatting, Taming 3DGS, DashGaussian, FastGS, 3DGS-MCMC",
     .group = training,
     ALL_PIPELINES},
    {.name = "filter",
     .type = SGS_OPTION_CHOICE,
     FIELD(filter),
     .initial = SGS_FILTER_3DGS,
     .values = "3dgs|none|mip",
     .help = "pixel filter: 0.3 px^2 dilation (3DGS), none, or Mip-Splatting's filters",
     .group = training,
     ALL_PIPELINES},
    {.name = "optimizer",
     .type = SGS_OPTION_CHOICE,
     FIELD(optimizer),
     .initial = SGS_OPTIMIZER_AUTO,
     .values = "sparse|dense|auto",
     .help = "Adam over the primitives visible in the iteration, or over all; auto: dense for mcmc "
             "from 2000 iterations and with the schedule paper, else sparse",
     .group = training,
     ALL_PIPELINES},
    {.name = "sh_degree",
     .type = SGS_OPTION_INT,
     FIELD(sh_degree),
     .initial = 3,
     .low = 0,
     .high = 3,
     .values = "D",
     .help = "maximum degree of the spherical harmonics",
     .group = training,
     ALL_PIPELINES},
    {.name = "compact_box",
     .type = SGS_OPTION_DOUBLE,
     FIELD(compact_box),
     .initial = 1,
     .low = 1e-3,
     .high = 1,
     .values = "X",
     .help = "fraction of a primitive's support used to assign it to tiles; 1 is exact, FastGS "
             "uses 0.5",
     .group = training,
     ALL_PIPELINES},
    {.name = "background",
     .type = SGS_OPTION_COLOR,
     FIELD(background),
     .random_offset = offsetof(sgs_train_options, background_random),
     .initial = 0,
     .low = 0,
     .high = 1,
     .values = "R,G,B|random",
     .help = "background colour, display values from 0 to 1, or a random colour in each iteration",
     .group = training,
     ALL_PIPELINES},
    {.name = "max_gaussians",
     .type = SGS_OPTION_SIZE,
     FIELD(max_gaussians),
     .initial = 0,
     .low = 0,
     .high = 2147483647,
     .values = "N",
     .initial_text = "0 = none; mcmc: 10 x initial number, at most 1000000",
     .help = "maximum number of primitives, also of the initial cloud",
     .group = training,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE},
    {.name = "init",
     .type = SGS_OPTION_MODEL,
     FIELD(init),
     .values = "MODEL",
     .initial_text = "none",
     .help = "initialise from this model file or run folder instead of the point "
             "cloud",
     .group = training,
     ALL_PIPELINES,
     .resume = SGS_RESUME_START},
    {.name = "region",
     .type = SGS_OPTION_BOX,
     FIELD(region),
     .values = "BOX|PLAN:K",
     .initial_text = "none",
     .help = "train the primitives of the initial model with centres in this box only (x0,y0,z0,"
             "x1,y1,z1; -inf and inf are allowed), or block K of a plan written by 'sparegs "
             "split', with the images of the block; the others are drawn, but not changed",
     .group = training,
     ALL_PIPELINES},
    {.name = "ssim_weight",
     .type = SGS_OPTION_DOUBLE,
     FIELD(ssim_weight),
     .initial = -1,
     .low = -1,
     .high = 1,
     .values = "W",
     .initial_text = "-1 = 0.2; 3dgs, mip, fastgs: up to 0.4 in short runs on large photos",
     .help = "weight of 1 - SSIM in the loss; the rest is L1",
     .group = training,
     ALL_PIPELINES},
    {.name = "ssim_sigma",
     .type = SGS_OPTION_DOUBLE,
     FIELD(ssim_sigma),
     .high = 3,
     .values = "S",
     .initial_text = "0 = 1.5; 3dgs, mip, fastgs: down to 1 in short runs on large photos",
     .help = "standard deviation of the window of SSIM in the loss, pixels",
     .group = training,
     ALL_PIPELINES},
    {.name = "alpha_loss",
     .type = SGS_OPTION_DOUBLE,
     FIELD(alpha_loss),
     .initial = 0,
     .low = 0,
     .high = 1000,
     .values = "W",
     .initial_text = "0 = none",
     .help = "weight of the mean absolute difference between rendered opacity and the images' "
             "alpha",
     .group = training,
     ALL_PIPELINES},
    {.name = "opaque",
     .type = SGS_OPTION_BOOL,
     FIELD(opaque),
     .help = "treat images without alpha channel as opaque: the model covers all their pixels; the "
             "default background is then random, the default alpha loss 0.1",
     .group = training,
     ALL_PIPELINES},
    {.name = "exposure",
     .type = SGS_OPTION_BOOL,
     FIELD(exposure),
     .help = "compensate exposure and white balance: optimise a 3 x 4 colour transform per image",
     .group = training,
     ALL_PIPELINES},
    {.name = "random_points",
     .type = SGS_OPTION_SIZE,
     FIELD(random_points),
     .initial = 100000,
     .low = 1,
     .high = 100000000,
     .values = "N",
     .help = "size of the random initial cloud for a scene without points",
     .group = training,
     ALL_PIPELINES,
     .resume = SGS_RESUME_START},
    {.name = "taming_multiplier",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.taming_multiplier),
     .initial = 20,
     .low = 1e-3,
     .high = 1e6,
     .values = "X",
     .help = "Taming: final number of primitives, as a multiple of the initial number",
     .group = base_pipelines,
     ONLY(TAMING)},
    {.name = "taming_count",
     .type = SGS_OPTION_SIZE,
     FIELD(pipeline_options.taming_count),
     .initial = 0,
     .low = 0,
     .high = 2147483647,
     .values = "N",
     .initial_text = "0 = from the multiplier",
     .help = "Taming: final number of primitives",
     .group = base_pipelines,
     ONLY(TAMING)},
    {.name = "taming_opacity",
     .type = SGS_OPTION_CHOICE,
     FIELD(pipeline_options.taming_opacity),
     .initial = SGS_TAMING_FROZEN,
     .values = "trained|frozen|linear",
     .help = "Taming: opacities after densification: trained, frozen as in the released code, or "
             "linear as in the paper, where they may exceed 1 (not with the mip filter; saved "
             "opacities are limited to 0.999999)",
     .group = base_pipelines,
     ONLY(TAMING)},
    {.name = "dash_count",
     .type = SGS_OPTION_SIZE,
     FIELD(pipeline_options.dash_count),
     .initial = 0,
     .low = 0,
     .high = 2147483647,
     .values = "N",
     .initial_text = "0 = momentum-based",
     .help = "Dash: final number of primitives",
     .group = base_pipelines,
     ONLY(DASH)},
    {.name = "fastgs_loss",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.fastgs_loss),
     .initial = 0.1,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "FastGS: normalised per-view error above which a pixel counts as high-error",
     .group = base_pipelines,
     ONLY(FASTGS)},
    {.name = "fastgs_gradient",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.fastgs_gradient),
     .initial = 0.0012,
     .low = 1e-9,
     .high = 1,
     .values = "X",
     .help = "FastGS: absolute-gradient threshold for splitting",
     .group = base_pipelines,
     ONLY(FASTGS)},
    {.name = "fastgs_dense",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.fastgs_dense),
     .initial = 0.001,
     .low = 1e-9,
     .high = 1,
     .values = "X",
     .unit = "x scene extent",
     .help = "FastGS: size above which a primitive is split, not cloned",
     .group = base_pipelines,
     ONLY(FASTGS)},
    {.name = "mcmc_noise",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_noise),
     .initial = 5e5,
     .low = 0,
     .high = 1e12,
     .values = "X",
     .unit = "x position learning rate",
     .help = "MCMC: noise on the positions of faint primitives",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_opacity_loss",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_opacity_loss),
     .initial = 0.01,
     .low = 0,
     .high = 1000,
     .values = "W",
     .help = "MCMC: weight of the mean opacity in the loss",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_scale_loss",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_scale_loss),
     .initial = 0.01,
     .low = 0,
     .high = 1000,
     .values = "W",
     .help = "MCMC: weight of the mean scale in the loss",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_growth",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_growth),
     .initial = 0.05,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "MCMC: share of primitives added per 100 iterations of the 30000-iteration schedule, "
             "up to the maximum number",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_start_opacity",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_start_opacity),
     .initial = 0.5,
     .low = 0.006,
     .high = 0.99,
     .values = "X",
     .help = "MCMC: opacity of the initial primitives",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_start_scale",
     .type = SGS_OPTION_DOUBLE,
     FIELD(pipeline_options.mcmc_start_scale),
     .initial = 0.1,
     .low = 1e-3,
     .high = 10,
     .values = "X",
     .unit = "x distance to the nearest points",
     .help = "MCMC: size of the initial primitives in a run of 30000 iterations; X^(N/30000) in a "
             "scaled run of N",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_units",
     .type = SGS_OPTION_CHOICE,
     FIELD(pipeline_options.mcmc_units),
     .initial = SGS_MCMC_UNITS_EXTENT,
     .values = "extent|world",
     .help = "MCMC: noise and scale loss relative to the scene's extent, or in scene units as in "
             "the released code",
     .group = base_pipelines,
     ONLY(MCMC)},
    {.name = "mcmc_redundant",
     .type = SGS_OPTION_CHOICE,
     FIELD(pipeline_options.mcmc_redundant),
     .initial = SGS_MCMC_DELETE,
     .values = "delete|relocate",
     .help = "MCMC: delete redundant primitives and lower the maximum number with them, or "
             "relocate them",
     .group = base_pipelines,
     ONLY(MCMC),
     .spare = SGS_SPARE_RAP},
    {.name = "spare",
     .type = SGS_OPTION_SET,
     FIELD(spare),
     .initial = SGS_SPARE_ALL,
     .values = "bmd,rap,edt",
     .initial_text = "on",
     .help = "SPARE-GS, or some of its parts: budget-modulated densification (bmd), "
             "redundancy-aware pruning (rap), equilibrium-driven termination (edt)",
     .group = spare_gs,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE},
    {.name = "spare_grid",
     .type = SGS_OPTION_INT,
     FIELD(spare_grid),
     .initial = 32,
     .low = 2,
     .high = 256,
     .values = "N",
     .unit = "voxels per axis",
     .help = "resolution of the region grid",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD | SGS_SPARE_RAP},
    {.name = "spare_tau_alpha",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_tau_alpha),
     .initial = 0.05,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "opacity threshold for redundant primitives",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_RAP},
    {.name = "spare_eps_loss",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_eps_loss),
     .initial = 0.008,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "equilibrium threshold for the relative change of the loss",
     .group = spare_gs,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE,
     .spare = SGS_SPARE_EDT},
    {.name = "spare_eps_count",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_eps_count),
     .initial = 0.01,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "equilibrium threshold for the relative change of the number of primitives",
     .group = spare_gs,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE,
     .spare = SGS_SPARE_EDT},
    {.name = "spare_patience",
     .type = SGS_OPTION_INT,
     FIELD(spare_patience),
     .initial = 2,
     .low = 1,
     .high = 1000,
     .values = "N",
     .unit = "checks",
     .help = "consecutive checks in equilibrium before training stops",
     .group = spare_gs,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE,
     .spare = SGS_SPARE_EDT},
    {.name = "spare_interval",
     .type = SGS_OPTION_INT,
     FIELD(spare_interval),
     .initial = 1000,
     .low = 1,
     .high = 1e9,
     .values = "N",
     .unit = "iterations",
     .help = "iterations between equilibrium checks, in the 30000-iteration schedule",
     .group = spare_gs,
     ALL_PIPELINES,
     .resume = SGS_RESUME_FREE,
     .spare = SGS_SPARE_EDT},
    {.name = "spare_demand",
     .type = SGS_OPTION_SET,
     FIELD(spare_demand),
     .initial = SGS_DEMAND_ALL,
     .low = 1,
     .values = "h,v,c",
     .help = "terms of the regional demand: gradient (h), visibility (v), capacity (c)",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD | SGS_SPARE_RAP},
    {.name = "spare_phi",
     .type = SGS_OPTION_CHOICE,
     FIELD(spare_phi),
     .initial = SGS_PHI_COUPLED,
     .values = "coupled|constant|product|plain",
     .help = "how slack and demand form the densification weight: coupled, constant range, "
             "product, or slack only",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD},
    {.name = "spare_budget",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_budget),
     .initial = 1,
     .low = 0.01,
     .high = 100,
     .values = "X",
     .unit = "x number of primitives",
     .help = "total budget of the regions",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD | SGS_SPARE_RAP},
    {.name = "spare_range",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_range),
     .initial = 0.375,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "largest deviation of the densification weight from 1 (gamma_0); not read by product "
             "and plain",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD},
    {.name = "spare_slope",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_slope),
     .initial = 2,
     .low = 0,
     .high = 100,
     .values = "X",
     .help = "slope of the densification weight over the slack (kappa_s)",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD},
    {.name = "spare_capacity_min",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_capacity_min),
     .initial = 0.25,
     .low = 0,
     .high = 1,
     .values = "X",
     .help = "lower limit of a region's relative capacity; 0 = Eq. 18 without limit",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD | SGS_SPARE_RAP},
    {.name = "spare_capacity_max",
     .type = SGS_OPTION_DOUBLE,
     FIELD(spare_capacity_max),
     .initial = 4,
     .low = 1,
     .high = 1000000000.0,
     .values = "X",
     .help = "upper limit of a region's relative capacity",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_BMD | SGS_SPARE_RAP},
    {.name = "spare_rap_visible",
     .type = SGS_OPTION_BOOL,
     FIELD(spare_rap_visible),
     .help =
         "redundancy-aware pruning keeps primitives that no view has seen since the last update",
     .group = spare_gs,
     ALL_PIPELINES,
     .spare = SGS_SPARE_RAP},
    {.name = "spare_target",
     .type = SGS_OPTION_CHOICE,
     FIELD(spare_target),
     .initial = SGS_TARGET_DEFAULT,
     .values = "default|gradient|importance|both",
     .initial_text = "default (both for taming, gradient for fastgs)",
     .help = "score modulated by the weight, for pipelines with two scores",
     .group = spare_gs,
     .pipelines = 1U << SGS_PIPELINE_TAMING | 1U << SGS_PIPELINE_FASTGS,
     .spare = SGS_SPARE_BMD},
    {.name = "seed",
     .type = SGS_OPTION_UINT64,
     FIELD(seed),
     .initial = 0,
     .values = "N",
     .help = "seed of all random choices",
     .group = common,
     ALL_PIPELINES},
};

const sgs_train_option *sgs_train_option_descriptors(size_t *count)
{
    *count = sizeof table / sizeof *table;
    return table;
}

const sgs_train_option *sgs_train_option_find(const char *name)
{
    for (size_t i = 0; i < sizeof table / sizeof *table; ++i)
        if (!strcmp(table[i].name, name))
            return &table[i];
    return NULL;
}

bool sgs_train_option_is_read(const sgs_train_option *option, const sgs_train_options *options)
{
    return !option->spare || (option->spare & options->spare);
}

bool sgs_train_option_may_change(const sgs_train_option *option, const sgs_train_options *options)
{
    return option->resume == SGS_RESUME_FREE ||
           (option->resume == SGS_RESUME_FREE_PAPER && options->schedule == SGS_SCHEDULE_PAPER) ||
           !sgs_train_option_is_read(option, options);
}

// An enumeration has the representation of unsigned int (gcc, clang) or int (C++ with a fixed
// type); both agree on its values.
_Static_assert(sizeof(sgs_pipeline) == sizeof(int), "options read enumerations as int");

// ---- defaults ----

static void set_initial(const sgs_train_option *row, sgs_train_options *options)
{
    void *field = (char *)options + row->offset;
    switch (row->type) {
    case SGS_OPTION_BOOL:
        *(bool *)field = row->initial != 0;
        break;
    case SGS_OPTION_INT:
    case SGS_OPTION_CHOICE:
        *(int *)field = (int)row->initial;
        break;
    case SGS_OPTION_SET:
        *(unsigned *)field = (unsigned)row->initial;
        break;
    case SGS_OPTION_SIZE:
        *(size_t *)field = (size_t)row->initial;
        break;
    case SGS_OPTION_UINT64:
        *(uint64_t *)field = (uint64_t)row->initial;
        break;
    case SGS_OPTION_DOUBLE:
        *(double *)field = row->initial;
        break;
    case SGS_OPTION_COLOR:
        for (int c = 0; c < 3; ++c)
            ((float *)field)[c] = (float)row->initial;
        break;
    case SGS_OPTION_MODEL:
        break; // NULL
    case SGS_OPTION_BOX:
        *(sgs_box *)field = sgs_box_infinite();
        break;
    }
}

sgs_train_options sgs_train_options_default(void)
{
    sgs_train_options options = {.struct_size = sizeof options};
    for (size_t i = 0; i < sizeof table / sizeof *table; ++i)
        set_initial(&table[i], &options);
    return options;
}

// ---- ranges ----

static sgs_status check_number(const sgs_train_option *row, double value)
{
    if (value >= row->low && value <= row->high) // false for NaN
        return SGS_STATUS_OK;
    const int digits = row->type == SGS_OPTION_DOUBLE ? 6 : 17;
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must be between %.*g and %.*g", row->name,
                     digits, row->low, digits, row->high);
}

static unsigned word_count(const char *words)
{
    unsigned count = 1;
    for (const char *at = words; (at = strpbrk(at, "|,")); ++at)
        ++count;
    return count;
}

static sgs_status check_box(const sgs_train_option *row, const sgs_box *box)
{
    for (int k = 0; k < 3; ++k)
        if (!(box->low[k] < box->high[k])) // true for NaN
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s must have a lower bound below the upper one on each axis",
                             row->name);
    return SGS_STATUS_OK;
}

static sgs_status check_field(const sgs_train_option *row, const sgs_train_options *options)
{
    const void *field = (const char *)options + row->offset;
    sgs_status status = SGS_STATUS_OK;
    switch (row->type) {
    case SGS_OPTION_INT:
        return check_number(row, *(const int *)field);
    case SGS_OPTION_SIZE:
        return check_number(row, (double)*(const size_t *)field);
    case SGS_OPTION_DOUBLE:
        return check_number(row, *(const double *)field);
    case SGS_OPTION_CHOICE:
        if (*(const unsigned *)field >= word_count(row->values))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must be one of %s", row->name,
                             row->values);
        return SGS_STATUS_OK;
    case SGS_OPTION_SET:
        if (row->low > 0 && !*(const unsigned *)field)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must have at least one of %s",
                             row->name, row->values);
        if (*(const unsigned *)field >> word_count(row->values))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s may have the bits of %s only",
                             row->name, row->values);
        return SGS_STATUS_OK;
    case SGS_OPTION_COLOR:
        for (int c = 0; c < 3 && !status; ++c)
            status = check_number(row, (double)((const float *)field)[c]);
        return status;
    case SGS_OPTION_BOX:
        return check_box(row, field);
    case SGS_OPTION_BOOL:
    case SGS_OPTION_UINT64:
    case SGS_OPTION_MODEL:
        break; // any value
    }
    return SGS_STATUS_OK;
}

sgs_status sgs_train_options_check(const sgs_train_options *given)
{
    sgs_train_options own = sgs_train_options_default();
    const sgs_status read = sgsi_options_read(given, "sgs_train_options", &own, sizeof own);
    if (read)
        return read;
    const sgs_train_options *options = &own;
    for (size_t i = 0; i < sizeof table / sizeof *table; ++i) {
        const sgs_status status = check_field(&table[i], options);
        if (status)
            return status;
    }
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(options->pipeline);
    if (options->filter == SGS_FILTER_MIP && pipeline->late_opacity &&
        pipeline->late_opacity(options) == SGSI_LATE_OPACITY_LINEAR)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "taming_opacity linear and filter mip exclude each other");
    if (!sgs_box_is_infinite(&options->region) && pipeline->late_opacity &&
        pipeline->late_opacity(options) == SGSI_LATE_OPACITY_LINEAR)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "taming_opacity linear and region exclude each other");
    if (options->opaque && !(options->alpha_loss > 0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "opaque requires alpha_loss above 0");
    return SGS_STATUS_OK;
}

// ---- text ----

static size_t put_double(char *text, size_t bytes, double value)
{
    char number[32];
    int digits = 15;
    do
        snprintf(number, sizeof number, "%.*g", digits, value);
    while (strtod(number, NULL) != value && ++digits <= 17);
    return (size_t)snprintf(text, bytes, "%s", number);
}

static size_t put_word(char *text, size_t bytes, const char *words, unsigned index)
{
    for (; index > 0; --index) {
        words = strpbrk(words, "|,");
        if (!words)
            return (size_t)snprintf(text, bytes, "?");
        ++words;
    }
    return (size_t)snprintf(text, bytes, "%.*s", (int)strcspn(words, "|,"), words);
}

static size_t put_set(char *text, size_t bytes, const char *words, unsigned bits)
{
    size_t used = 0;
    for (unsigned k = 0; k < word_count(words); ++k) {
        if (!(bits >> k & 1))
            continue;
        if (used)
            used += (size_t)snprintf(text + (used < bytes ? used : bytes),
                                     used < bytes ? bytes - used : 0, ",");
        used += put_word(text + (used < bytes ? used : bytes), used < bytes ? bytes - used : 0,
                         words, k);
    }
    return used ? used : (size_t)snprintf(text, bytes, "off");
}

static size_t put_box(char *text, size_t bytes, const sgs_box *box)
{
    const float *low = box->low, *high = box->high;
    if (sgs_box_is_infinite(box))
        return (size_t)snprintf(text, bytes, "none");
    return (size_t)snprintf(text, bytes, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g", (double)low[0],
                            (double)low[1], (double)low[2], (double)high[0], (double)high[1],
                            (double)high[2]);
}

size_t sgs_train_option_text(const sgs_train_option *option, const sgs_train_options *options,
                             char *text, size_t bytes)
{
    const void *field = (const char *)options + option->offset;
    switch (option->type) {
    case SGS_OPTION_BOOL:
        return (size_t)snprintf(text, bytes, "%s", *(const bool *)field ? "true" : "false");
    case SGS_OPTION_INT:
        return (size_t)snprintf(text, bytes, "%d", *(const int *)field);
    case SGS_OPTION_SIZE:
        return (size_t)snprintf(text, bytes, "%zu", *(const size_t *)field);
    case SGS_OPTION_UINT64:
        return (size_t)snprintf(text, bytes, "%" PRIu64, *(const uint64_t *)field);
    case SGS_OPTION_DOUBLE:
        return put_double(text, bytes, *(const double *)field);
    case SGS_OPTION_CHOICE:
        return put_word(text, bytes, option->values, *(const unsigned *)field);
    case SGS_OPTION_SET:
        return put_set(text, bytes, option->values, *(const unsigned *)field);
    case SGS_OPTION_COLOR: {
        const float *c = field;
        if (*(const bool *)((const char *)options + option->random_offset))
            return (size_t)snprintf(text, bytes, "random");
        return (size_t)snprintf(text, bytes, "%.9g,%.9g,%.9g", (double)c[0], (double)c[1],
                                (double)c[2]);
    }
    case SGS_OPTION_BOX:
        return put_box(text, bytes, field);
    case SGS_OPTION_MODEL:
        return (size_t)snprintf(text, bytes, "%s", *(const void *const *)field ? "model" : "none");
    }
    return 0;
}
