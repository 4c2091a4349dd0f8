// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Milestones. The end and the interval of densification depend on the base pipeline; the other
// milestones are those of 3DGS, and all pipelines are scaled alike. The published schedule (30 000
// iterations; Kerbl et al. 2023, sections 5.2 and 7.1, appendix B): densification from 500 to
// 15 000 every 100, opacity reset every 3000, one SH band per 1000, position rate decaying over the
// whole run.
//
// Scaled to N iterations, f = N / 30 000: densification until N/2 (dash 0.9 N), one SH band per
// N/30, checks for equilibrium every spare_interval * f, position rate decaying over N. No
// primitive is removed for its size: the published rule removes those larger than a tenth of the
// extent in each update after the first reset, which makes holes in walls and floors.
//
// The rules for N < 30 000 below and that for large primitives are chosen by measurement;
// tools/experiments/schedules.md has the figures.
// - Structural updates: 10 up to N = 7000, at least 20 iterations apart; growing as a power of N to
//   the published number at 30 000.
// - Gradient threshold: 1.7 times the published one up to N = 7000, decreasing to 1 at 30 000. At
//   2e-4 a third of all primitives pass at each update of a run of up to 7000 iterations, compared
//   with a few percent of a published run. The threshold is then in the bulk of the distribution,
//   where weights (SPARE-GS) have little effect.
// - From a random cloud: the published threshold and 30 updates, because it has few points, and the
//   model must grow where the objects are.
// - From N = 1000 on, an update in the second half of densification removes at most 5 % of the
//   primitives, those of least opacity first: the few updates that remain cannot repair more.
//   On high-resolution images, updates of 3dgs and mip go on until the rates decay, but only remove
//   faint and redundant primitives, mostly those that this limit kept. FastGS has its own final
//   prunes.
// - Opacity resets: every 3000 iterations, as published, rounded to updates. After the last one a
//   third of the densification remains, or 1500 iterations if that is less: opacities require some
//   hundred visits to recover from 0.01, and the loss takes as long to settle. Their number follows
//   from N, not from the photos.
// - Learning rates other than the position's: constant as published, and in the last 30 % of a
//   run below 30 000 iterations log-linear to a tenth at N = 7000. The final factor rises to 1 at N
//   = 1000 and at N = 30 000; above 0.95 there is no decay. There is no check for equilibrium in
//   this part.
// - Rates of rotation and scale: twice the published ones up to N = 7500, sqrt(30 000 / N) times
//   beyond.
// - Rate of SH above degree 0: times views / 24 at N = 7000 if there are fewer than 24; the
//   reduction fades out towards N = 2000 and N = 30 000. Twice that of 3DGS up to N = 2000, with 30
//   views or more and small photos, but not with mcmc; this fades out towards N = 7000, 15
//   views and high-resolution images, where it makes held-out views worse.
// - High-resolution images, 3dgs, mip and fastgs: from 320 000 pixels and 60 views on, 0.8 times
//   the threshold and less weight of gradients close to the camera (Pixel-GS). With 3dgs, absolute
//   gradients count at twice the threshold (AbsGS), because signed ones cancel where a texture is
//   finer than the primitives; the others have their own rule for them. In the loss, SSIM has a
//   weight of 0.4 instead of 0.2 and a window with a standard deviation of 1 pixel instead of 1.5,
//   which sharpens the image. Opacity has at least twice the rate of 3DGS: fewer primitives per
//   ray, which saves time. More primitives then fade between two updates, so there are 15 updates,
//   and each prunes less. The rates decay to a half instead of a tenth. In the first 0.3 N
//   iterations, images have half the size, which saves time, too. Below these limits, settings are
//   interpolated over the logarithm of the pixels from 130 000 and linearly
//   over the views from 15. They fade out towards N = 30 000.
//
// MCMC has its own milestones (Kheradmand et al. 2024, released code): updates from 500 to 25 000
// every 100, each adding 5 %, and no opacity resets. Scaled: updates until 25 000 f every max(50,
// 100 f). Each adds as many primitives as the published updates in that part of the run, at most
// doubling them. The optimiser is the published, dense one from 2000 iterations on, with the higher
// rates of rotation and scale.

#include "density/schedule.h"

#include <limits.h>
#include <math.h>

#include "density/pipeline.h"
#include "density/run_length.h"

enum {
    PAPER_HALF = 15000,
    CONSTANT_LENGTH = 1000,
    SHORT_SH_LENGTH = 2000,
    SHORT_UPDATES = 10,
    MIN_INTERVAL = 20,
    RELOCATION_INTERVAL = 50,
    FIRST_PRUNE = 6, // final prunes, in intervals of FastGS: 18 000 to 27 000 every 3000
    LAST_PRUNE = 9,
    DENSE_LENGTH = 2000
};
#define SHORT_THRESHOLD 1.7
#define RANDOM_THRESHOLD 1.0
#define RANDOM_UPDATES 30.0
#define FEW_VIEWS 24.0 // 1.5 per SH coefficient
#define SHORT_SH_RATE 2.0
#define SH_VIEWS_FROM 15.0
#define SH_VIEWS 30.0
#define ANNEAL_FROM 0.7
#define SHORT_LATE_RATE 0.1
#define SHORT_SHAPE_RATE 2.0
#define SMALL_PIXELS 1.3e5
#define LARGE_PIXELS 3.2e5
#define FINE_VIEWS_FROM 15.0
#define FINE_VIEWS 60.0
#define LARGE_THRESHOLD 0.8
#define LARGE_UPDATES 15.0
#define LARGE_ABS_SHARE 0.5
#define LARGE_NEAR_DEPTH 0.37 // gamma of Pixel-GS
#define LARGE_HALF_SIZE 0.3   // share of the run
#define SSIM_WEIGHT 0.2
#define LARGE_SSIM_WEIGHT 0.4
#define SSIM_SIGMA 1.5 // pixels
#define LARGE_SSIM_SIGMA 1.0
#define LARGE_LATE_RATE 0.5
#define NEARLY_CONSTANT 0.95
#define LARGE_OPACITY_RATE 2.0 // at least, times that of 3DGS
#define LATE_REMOVAL 0.05

static int rounded(double value, int least)
{
    const double whole = fmin(round(value), INT_MAX);
    return whole < least ? least : (int)whole;
}

// Batches shrink with the run, so that the number of steps does not.
static int batch(int paper, double f)
{
    return paper ? rounded(paper * fmin(f, 1.0), 1) : 0;
}

// On a white background, 3DGS makes an additional opacity reset at the start of densification.
static bool is_white(const sgs_train_options *options)
{
    const float *c = options->background;
    return !options->background_random && c[0] >= 1.0f && c[1] >= 1.0f && c[2] >= 1.0f;
}

static int first_update(int iterations)
{
    return rounded(500 * fmin(1.0, (double)iterations / SGSI_SHORT_LENGTH) - 1, 1);
}

// The updates of a pipeline that relocates, in a run of f < 1 of the published length.
static void scale_relocations(sgsi_schedule *schedule, double f)
{
    schedule->densify_from = first_update(schedule->iterations);
    schedule->densify_interval = rounded(schedule->densify_interval * f, RELOCATION_INTERVAL);
    const double published = schedule->densify_interval / (100.0 * f);
    schedule->growth = fmin(pow(1.0 + schedule->growth, published) - 1.0, 1.0);
}

static bool is_dense(const sgs_train_options *options)
{
    if (options->optimizer != SGS_OPTIMIZER_AUTO)
        return options->optimizer == SGS_OPTIMIZER_DENSE;
    return sgsi_pipeline_get(options->pipeline)->relocates &&
           (options->schedule == SGS_SCHEDULE_PAPER || options->iterations >= DENSE_LENGTH);
}

// fine: how far the run follows the rules of high-resolution images, 0 to 1.
static double ssim_weight(const sgs_train_options *options, double fine)
{
    return options->ssim_weight < 0.0 ? SSIM_WEIGHT + (LARGE_SSIM_WEIGHT - SSIM_WEIGHT) * fine
                                      : options->ssim_weight;
}

static double ssim_sigma(const sgs_train_options *options, double fine)
{
    return options->ssim_sigma > 0.0 ? options->ssim_sigma
                                     : SSIM_SIGMA + (LARGE_SSIM_SIGMA - SSIM_SIGMA) * fine;
}

// Without milestones; the position rate is the final one (sgsi_schedule_lr).
static sgsi_schedule finetune(const sgs_train_options *options)
{
    return (sgsi_schedule){.iterations = options->iterations,
                           .ssim_weight = ssim_weight(options, 0.0),
                           .ssim_sigma = ssim_sigma(options, 0.0),
                           .dense = is_dense(options),
                           .densify_interval = 100,
                           .resolution_interval = 100,
                           .middle_until = 1,
                           .lr_span = 1e-9,
                           .anneal_from = options->iterations,
                           .lr_late = 1.0,
                           .lr_shape = 1.0,
                           .lr_sh = 1.0,
                           .lr_opacity = 1.0,
                           .check_interval = rounded(options->spare_interval, 1),
                           .threshold_factor = 1.0};
}

// How far growth follows the rules of high-resolution images, 0 to 1: log-linear in their pixels,
// and linear in their number.
static double fine_growth(size_t views, double pixels)
{
    const double size = log(pixels / SMALL_PIXELS) / log(LARGE_PIXELS / SMALL_PIXELS);
    const double number = ((double)views - FINE_VIEWS_FROM) / (FINE_VIEWS - FINE_VIEWS_FROM);
    return fmin(fmax(size, 0.0), 1.0) * fmin(fmax(number, 0.0), 1.0);
}

// Rises from 15 to 30 views, on small photos, to SHORT_SH_RATE times the published rate of
// 3DGS.
static double short_sh_rate(const sgsi_pipeline *pipeline, const sgsi_schedule_input *input)
{
    const double own = (double)pipeline->lr_rest / (double)sgsi_pipeline_3dgs.lr_rest,
                 enough = ((double)input->views - SH_VIEWS_FROM) / (SH_VIEWS - SH_VIEWS_FROM),
                 large = fine_growth(input->views, input->pixels);
    return pow(fmax(SHORT_SH_RATE / own, 1.0), fmin(fmax(enough, 0.0), 1.0) * (1.0 - large));
}

// short_sh_rate up to SHORT_SH_LENGTH; below 1 for few views at SGSI_SHORT_LENGTH.
static double sh_rate(const sgs_train_options *options, const sgsi_schedule_input *input)
{
    if (options->schedule != SGS_SCHEDULE_SCALED || options->iterations >= SGSI_PAPER_LENGTH)
        return 1.0;
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(options->pipeline);
    const double position = log((double)options->iterations / SHORT_SH_LENGTH) /
                            log((double)SGSI_SHORT_LENGTH / SHORT_SH_LENGTH),
                 above = fmin(fmax(position, 0.0), 1.0),
                 few = fmin((double)input->views / FEW_VIEWS, 1.0),
                 brief = pipeline->relocates ? 1.0 : short_sh_rate(pipeline, input);
    return pow(few, fmin(above, sgsi_run_shortness(options))) * pow(brief, 1.0 - above);
}

// A tenth at SGSI_SHORT_LENGTH, more on high-resolution images, 1 up to CONSTANT_LENGTH and from
// SGSI_PAPER_LENGTH on; beyond: position of N between the last two, log-linear. A decay by less
// than 5 % is none, so that equilibrium checks go on.
static double late_rate(int iterations, double beyond, double large)
{
    const double below = log((double)iterations / CONSTANT_LENGTH) /
                         log((double)SGSI_SHORT_LENGTH / CONSTANT_LENGTH);
    const double shortest = SHORT_LATE_RATE * pow(LARGE_LATE_RATE / SHORT_LATE_RATE, large),
                 rate = pow(shortest, fmin(fmax(below, 0.0), 1.0 - beyond));
    return rate > NEARLY_CONSTANT ? 1.0 : rate;
}

// The last update that only removes; 0 = none.
static int last_thinning(const sgsi_schedule *schedule, double fine)
{
    const int room = schedule->anneal_from - schedule->densify_until,
              end = schedule->densify_until + rounded(fine * room, 0),
              last = end / schedule->densify_interval * schedule->densify_interval;
    return last > schedule->densify_until ? last : 0;
}

// Opacity resets of a scaled run with `until` iterations of densification: every 3000, and
// densification goes on after the last one for at least 1500 iterations, or a third of its length
// in short runs. Photos do not change the number, so that one more of them does not add a reset.
static int reset_count(double until)
{
    return (int)floor((until - fmin(until / 3.0, 1500.0)) / 3000.0);
}

// The published milestones times f; those that are not in proportion are set by the caller.
static sgsi_schedule published(const sgs_train_options *options, const sgsi_pipeline *pipeline,
                               const sgsi_schedule_input *input, double f)
{
    return (sgsi_schedule){
        .iterations = options->iterations,
        .dense = is_dense(options),
        .densify_from = 500,
        .densify_until = rounded(pipeline->densify_until * f, 1),
        .densify_interval = pipeline->densify_interval,
        .reset_interval = pipeline->relocates ? 0 : 3000,
        .growth = pipeline->relocates ? options->pipeline_options.mcmc_growth : 0.0,
        .reset_until = pipeline->densify_until,
        .first_reset = is_white(options) ? 500 : 0,
        .prunes_large = options->schedule != SGS_SCHEDULE_SCALED && pipeline->prunes_large,
        .prune_interval = pipeline->prune_interval ? rounded(pipeline->prune_interval * f, 1) : 0,
        .batch_rest = batch(pipeline->batch_rest, f),
        .batch_middle = batch(pipeline->batch_middle, f),
        .batch_late = batch(pipeline->batch_late, f),
        .middle_until = rounded(20000 * f, 1),
        .sh_interval = rounded(1000 * f, 1),
        .resolution_from = rounded(500 * fmin(f, 1.0), 0),
        .resolution_interval = rounded(100 * fmin(f, 1.0), 1),
        .ssim_weight = ssim_weight(options, 0.0),
        .ssim_sigma = ssim_sigma(options, 0.0),
        .lr_span = SGSI_PAPER_LENGTH * f,
        .anneal_from = options->iterations,
        .lr_late = 1.0,
        .lr_shape = 1.0,
        .lr_sh = sh_rate(options, input),
        .lr_opacity = 1.0,
        .check_interval = rounded(options->spare_interval * f, 1),
        .threshold_factor = 1.0};
}

// fine: how far a run of this length follows the rules of high-resolution images, 0 to 1.
static void sharpen(sgsi_schedule *schedule, const sgs_train_options *options,
                    const sgsi_pipeline *pipeline, double fine)
{
    schedule->threshold_factor *= pow(LARGE_THRESHOLD, fine);
    schedule->abs_share = pipeline->abs_grad ? 0.0 : LARGE_ABS_SHARE * fine;
    schedule->near_depth = LARGE_NEAR_DEPTH * fine;
    schedule->ssim_weight = ssim_weight(options, fine);
    schedule->ssim_sigma = ssim_sigma(options, fine);
    const double opacity_rate = LARGE_OPACITY_RATE * (double)sgsi_pipeline_3dgs.lr_opacity;
    schedule->lr_opacity = pow(fmax(opacity_rate / (double)pipeline->lr_opacity, 1.0), fine);
    schedule->half_size_until = rounded(LARGE_HALF_SIZE * fine * options->iterations, 0);
    if (schedule->half_size_until <= schedule->resolution_from)
        schedule->half_size_until = 0;
}

// The updates and resets of a run of f < 1 of the published length. beyond: position of N between
// SGSI_SHORT_LENGTH and SGSI_PAPER_LENGTH; large: how far the photos call for the rules of
// high-resolution images; both 0 to 1.
static void scale_updates(sgsi_schedule *schedule, const sgsi_pipeline *pipeline, bool random,
                          double beyond, double large)
{
    const double f = (double)schedule->iterations / SGSI_PAPER_LENGTH;
    const double paper_updates = (PAPER_HALF - 500.0) / pipeline->densify_interval;
    const double fewest = random ? RANDOM_UPDATES
                                 : SHORT_UPDATES * pow(LARGE_UPDATES / SHORT_UPDATES, large),
                 updates = fewest * pow(paper_updates / fewest, beyond);
    schedule->late_removal = schedule->iterations < CONSTANT_LENGTH ? 0.0 : LATE_REMOVAL;
    schedule->densify_from = first_update(schedule->iterations);
    schedule->densify_interval =
        rounded((PAPER_HALF * f - schedule->densify_from) / updates, MIN_INTERVAL);
    if (schedule->late_removal > 0.0 && !pipeline->prune_interval)
        schedule->thin_until = last_thinning(schedule, (1.0 - beyond) * large);
    schedule->reset_interval =
        rounded(3000.0 / schedule->densify_interval, 1) * schedule->densify_interval;
    const int resets = reset_count(pipeline->densify_until * f);
    schedule->reset_until = resets * schedule->reset_interval + 1;
    if (!resets)
        schedule->first_reset = 0; // the run is too short for resets
}

sgsi_schedule sgsi_schedule_make(const sgs_train_options *options, const sgsi_schedule_input *input)
{
    if (options->schedule == SGS_SCHEDULE_FINETUNE)
        return finetune(options);
    const bool scaled = options->schedule == SGS_SCHEDULE_SCALED;
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(options->pipeline);
    const double f = scaled ? (double)options->iterations / SGSI_PAPER_LENGTH : 1.0;
    sgsi_schedule schedule = published(options, pipeline, input, f);
    if (f > 1.0 && schedule.reset_interval)
        schedule.reset_until = reset_count(schedule.densify_until) * schedule.reset_interval + 1;
    if (f >= 1.0)
        return schedule;
    const double beyond = 1.0 - sgsi_run_shortness(options);
    const double large = pipeline->fine_growth ? fine_growth(input->views, input->pixels) : 0.0;
    schedule.anneal_from = rounded(ANNEAL_FROM * options->iterations, 1);
    schedule.lr_late = late_rate(options->iterations, beyond, large);
    if (schedule.dense || !pipeline->relocates)
        schedule.lr_shape = fmin(sqrt(1.0 / f), SHORT_SHAPE_RATE);
    if (pipeline->relocates) {
        scale_relocations(&schedule, f);
        return schedule;
    }
    schedule.threshold_factor =
        pow(input->random ? RANDOM_THRESHOLD : SHORT_THRESHOLD, (1.0 - beyond) * (1.0 - large));
    sharpen(&schedule, options, pipeline, (1.0 - beyond) * large);
    scale_updates(&schedule, pipeline, input->random, beyond, large);
    return schedule;
}

bool sgsi_schedule_is_structural(const sgsi_schedule *schedule, int iteration)
{
    return iteration > schedule->densify_from && iteration < schedule->densify_until &&
           iteration % schedule->densify_interval == 0;
}

int sgsi_schedule_first_update(const sgsi_schedule *schedule)
{
    const int interval = schedule->densify_interval,
              first = (schedule->densify_from / interval + 1) * interval;
    return sgsi_schedule_is_structural(schedule, first) ? first : 0;
}

bool sgsi_schedule_is_reset(const sgsi_schedule *schedule, int iteration)
{
    return schedule->reset_interval && iteration < schedule->reset_until &&
           (iteration % schedule->reset_interval == 0 || iteration == schedule->first_reset);
}

// train.py of 3DGS: `iteration > opacity_reset_interval`, and the reset at that iteration follows
// the update.
bool sgsi_schedule_prunes_large(const sgsi_schedule *schedule, int iteration, int last_reset)
{
    return schedule->prunes_large && sgsi_schedule_is_structural(schedule, iteration) &&
           schedule->reset_interval && last_reset >= schedule->reset_interval;
}

// The bounds are multiples of the interval: it is rounded in a scaled run, and there would be a
// prune at the end of densification or of the run. A longer run of the published schedule has no
// more prunes than the published one.
bool sgsi_schedule_is_final_prune(const sgsi_schedule *schedule, int iteration)
{
    const int interval = schedule->prune_interval, k = interval ? iteration / interval : 0;
    const bool own = k >= FIRST_PRUNE && k <= LAST_PRUNE && iteration % interval == 0 &&
                     iteration > schedule->densify_until && iteration < schedule->iterations;
    return own || sgsi_schedule_is_thinning(schedule, iteration);
}

bool sgsi_schedule_is_update(const sgsi_schedule *schedule, int iteration)
{
    return sgsi_schedule_is_structural(schedule, iteration) ||
           sgsi_schedule_is_final_prune(schedule, iteration);
}

bool sgsi_schedule_is_thinning(const sgsi_schedule *schedule, int iteration)
{
    return iteration >= schedule->densify_until && iteration <= schedule->thin_until &&
           iteration % schedule->densify_interval == 0;
}

bool sgsi_schedule_needs_statistics(const sgsi_schedule *schedule, int iteration)
{
    return iteration < schedule->iterations &&
           (iteration < schedule->densify_until || iteration <= schedule->thin_until);
}

double sgsi_schedule_removal_max(const sgsi_schedule *schedule, int iteration)
{
    const bool late = 2 * (long)iteration > schedule->densify_until &&
                      sgsi_schedule_is_structural(schedule, iteration);
    return late || sgsi_schedule_is_thinning(schedule, iteration) ? schedule->late_removal : 0.0;
}

bool sgsi_schedule_may_resize(const sgsi_schedule *schedule, int iteration)
{
    return iteration > schedule->resolution_from && iteration % schedule->resolution_interval == 0;
}

int sgsi_schedule_updates(const sgsi_schedule *schedule)
{
    const int updates =
        (schedule->densify_until - schedule->densify_from) / schedule->densify_interval;
    return updates > 1 ? updates : 1;
}

bool sgsi_schedule_steps_main(const sgsi_schedule *schedule, int iteration)
{
    if (!schedule->batch_rest || iteration <= schedule->densify_until)
        return true;
    return iteration % (iteration <= schedule->middle_until ? schedule->batch_middle
                                                            : schedule->batch_late) ==
           0;
}

bool sgsi_schedule_steps_rest(const sgsi_schedule *schedule, int iteration)
{
    if (!schedule->batch_rest || iteration > schedule->densify_until)
        return sgsi_schedule_steps_main(schedule, iteration);
    return iteration % schedule->batch_rest == 0;
}

double sgsi_schedule_lr(const sgsi_schedule *schedule, int iteration)
{
    const double u =
        fmin(fmax((iteration - schedule->lr_begin) / (schedule->lr_span - schedule->lr_begin), 0.0),
             1.0);
    return exp(u * log(0.01));
}

bool sgsi_schedule_is_annealing(const sgsi_schedule *schedule, int iteration)
{
    return schedule->lr_late < 1.0 && iteration > schedule->anneal_from;
}

double sgsi_schedule_lr_other(const sgsi_schedule *schedule, int iteration)
{
    if (!sgsi_schedule_is_annealing(schedule, iteration))
        return 1.0;
    const double u = (double)(iteration - schedule->anneal_from) /
                     (double)(schedule->iterations - schedule->anneal_from);
    return pow(schedule->lr_late, fmin(u, 1.0));
}
