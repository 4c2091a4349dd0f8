// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Milestones. The end and the interval of densification depend on the base pipeline; the other
// milestones are those of 3DGS, and all pipelines are scaled alike. The published schedule (30 000
// iterations; Kerbl et al. 2023, sections 5.2 and 7.1, appendix B): densification from 500 to
// 15 000 every 100, opacity reset every 3000, one SH band per 1000, position rate decaying over the
// whole run.
//
// Scaled to N iterations, f = N / 30 000: densification until N/2, one SH band per N/30, checks for
// equilibrium every spare_interval * f, position rate decaying over N. For N < 30 000, chosen by
// measurement:
// - Structural updates: 10 up to N = 7000, growing geometrically to the published 145 at 30 000.
//   More primitives do not converge in a short run. Scene banana at 376x250, 7000 iterations, one
//   view held out: an update every 100 iterations gives more than 200 000 primitives; every 300,
//   106 000 and 27.73 dB; every 500, 65 000 and 27.55 dB in less than half of the time.
// - Gradient threshold: 1.7 times the published one up to N = 7000, decreasing to 1 at 30 000. At
//   2e-4 a third of all primitives pass at each update of a short run, compared with a few percent
//   of a published run. The threshold is then in the bulk of the distribution, where weights
//   (SPARE-GS) have little effect. banana as above, updates @ factor: 6 @ 1: 65 000 primitives,
//   14.5 % fewer with SPARE-GS; 8 @ 1.4: 62 600, 19.1 %; 10 @ 1.7: 58 600, 21.1 %; all within 0.1
//   dB of 27.55. Scene plush at 336x252: 31.38, 31.28 and 31.59 dB.
// - Opacity resets: every 3000 iterations, as published, rounded to updates. After the last one a
//   third of the densification remains, or half a reset interval if that is shorter: opacities
//   require some hundred visits to recover from 0.01, and the loss as many to settle. banana with
//   five updates: resets at 1000 and 2000: 27.51 dB; no reset: 27.61 dB and 14 % less time, because
//   rays pass more primitives while opacities are low.
// - Learning rates other than the position's: constant as published, and in the last 30 % of a
//   short run log-linear to a tenth at N = 7000, because constant rates end in noise; to less
//   towards 30 000, and towards 1000, where the loss still falls fast (room at 480x270, 300
//   iterations: 27.77 dB, with a tenth 27.24 dB). Per row constant | from 0.7 N | from 0.5 N: PSNR,
//   SSIM, FLIP, sharpness of the held-out views. plush at 336x252, 7000 iterations, 13 views: 29.68
//   dB, .9229, .1272, .532 | 29.87, .9239, .1240, .522 | 29.77, .9237, .1247, .514. banana as
//   above: 27.21, .7567, .1359, .537 | not measured | 27.32, .7609, .1357, .499. room at 480x270, 5
//   views: 32.84, .9535, .1086, 1.160 | 32.87, .9536, .1076, 1.165. At 2000 iterations the factor
//   is 0.43; plush: 29.07, .9138, .1329, .425 | 29.07, .9135, .1323, .422. There is no check
//   for equilibrium in this part.
// - Rates of rotation and scale: twice the published ones up to N = 7500, sqrt(30 000 / N) times
//   beyond. Primitives of a short run have too few steps to take the shape of what they cover.
//   34433df, published rates | twice: PSNR, SSIM, FLIP, sharpness of the held-out views. 7000
//   iterations: plush at 336x252, 29.18, .9212, .1332, .505 | 29.80, .9243, .1237, .526 (0.6 dB of
//   it in one view); room at 480x270, 32.20, .9513, .1087, 1.155 | 32.38, .9527, .1074, 1.120;
//   banana at 376x250, 13 views, 28.04, .7993, .1152, .672 | 28.09, .8007, .1191, .691. 2000
//   iterations: plush 28.95, .9081, .1338, .414 | 29.30, .9162, .1302, .445; room 31.15, .9475,
//   .1129, 1.084 | 31.67, .9497, .1113, 1.068. 300: plush 25.44, .8603, .1810, .211 | 26.30, .8684,
//   .1699, .242; room 26.89, .9057, .1512, .569 | 27.39, .9113, .1501, .706. Four times: 2000
//   iterations, banana 28.08, .7756 | 27.79, .7742; room 31.00, .9455; 300: room 26.41, .8951.
//   At 672x504, plush, 7000 iterations with SPARE-GS (a5fce2c | 83f95b0): 28.92, .8939, .1308, .327
//   | 28.92, .8950, .1319, .353. Room, 300 iterations, other pipelines: mip 26.73 | 27.15, taming
//   26.21 | 27.04, dash 26.79 | 27.22, fastgs 26.94 | 27.72.
//   Twice the rate of positions or colours: no gain on plush (29.67, .9226; 29.64, .9219); of
//   opacity as well: fewer primitives (36 932 instead of 40 028), 29.71, .9239.
// - Rate of SH above degree 0: reduced in proportion to the views if there are fewer than 24. 16
//   coefficients per channel and few directions fit colours that only the training views see.
//   7000 iterations at a5fce2c, published rate | times 0.6 (banana) or 0.5: banana at 376x250, 15
//   views, one held out: 27.32 dB, .7609, .1357, .499 | 27.82, .7793, .1279, .503; every fifth view
//   held out: 27.23, .7612, .1276, .756 | 27.53, .7762, .1233, .758. 12 views of room at 240x135:
//   30.90, .9566, .1196, .960 | 30.78, .9562, .1202, .946. 14 views of plush at 168x126: 26.75,
//   .8791, .1670, .813 | 26.75, .8788, .1683, .794. More views need the published rate; half of it:
//   plush, 84 views: 29.87, .9239, .1240 | 29.72, .9224, .1268; room, 30 views: 32.87, .9536, .1076
//   | 32.37, .9516, .1091.
//   2000 iterations are too few for this: banana 27.77, .7468, .1241 | 27.62, .7441, .1296 (0.63).
// - Large photographs, 3dgs only: from 320 000 pixels and 30 views on, the published threshold,
//   absolute gradients at twice the threshold (AbsGS), and less weight of gradients close to the
//   camera (Pixel-GS, its constant). Textures finer than the primitives have signed gradients that
//   cancel. Settings are interpolated over the logarithm of the pixels and over the views from 15
//   to 30, where nothing was measured, and fade out towards the published length. Plush at 672x504,
//   7000 iterations with SPARE-GS, before (83f95b0) | after (edd739f): 28.92, .8950, .1319, .353 |
//   29.11, .8972, .1305, .434; 300 iterations: 25.51, .8477, .1824, .106 | 25.42, .8520, .1855,
//   .117. What else was tried, other lengths and scenes: tools/manual/training.md, Large photos.
//   Few views do not constrain as many primitives: banana at 752x500, 13 views, 2000 iterations,
//   39 403 | 285 898 primitives: 27.57, .7531, .1318, .495 | 26.03, .7259, .1447, .800.
//
// MCMC has its own milestones (Kheradmand et al. 2024, released code): updates from 500 to 25 000
// every 100, each adding 5 %, and no opacity resets. Scaled: updates until 25 000 f every max(50,
// 100 f). Each adds what the published updates of that time add, at most as many rows as there are.
// MCMC's optimiser is the published, dense one from 2000 iterations on. 4703a08, without SPARE-GS,
// sparse | dense: PSNR, SSIM, FLIP, sharpness of the held-out views. 2000 iterations: plush at
// 336x252, 52 348 primitives, 29.06, .9120, .1326, .373 | 28.59, .9061, .1387, .350; room at
// 480x270, 30 000: 26.03, .8781, .1496, .264 | 27.08, .8990, .1407, .391; banana at 376x250,
// 40 085: 27.97, .7779, .1142, .516 | 28.16, .7758, .1113, .492. 4000: plush 29.37, .9216, .1308,
// .440 | 28.91, .9168, .1367, .421; room 27.37, .9019, .1366, .451 | 28.77, .9260, .1288, .552;
// banana 27.76, .7904, .1222, .572 | 27.91, .7942, .1210, .532. 7000: plush 29.75, .9245, .1277,
// .471 | 29.85, .9258, .1247, .468; room 29.13, .9276, .1214, .599 | 30.62, .9449, .1156, .816;
// banana 28.11, .8048, .1211, .581 | 28.22, .8059, .1149, .589. 1200, plush at 168x126, 44 540:
// 29.06 dB | 28.39 dB.
// With the dense optimiser, rotations and scales have the higher rates of short runs; a64b318,
// published rates | twice. 2000 iterations: plush 28.59, .9061, .1387, .350 | 28.74, .9100, .1362,
// .378; room 27.08, .8990, .1407, .391 | 28.38, .9211, .1331, .599. 7000: plush 29.85, .9258,
// .1247, .468 | 29.90, .9275, .1255, .481; room 30.62, .9449, .1156, .816 | 31.57, .9499, .1099,
// .887; banana 28.22, .8059, .1149, .589 | 28.36, .8089, .1129, .592. Four times: plush 29.78,
// .9266, .1275, .494; room 31.47, .9533, .1121, .952. With the sparse one, plush, 7000 iterations:
// 29.94, .9265 | 29.78, .9257.

#include "density/schedule.h"

#include <math.h>

#include "density/pipeline.h"

enum {
    PAPER_LENGTH = 30000,
    PAPER_HALF = 15000,
    SHORT_LENGTH = 7000,
    CONSTANT_LENGTH = 1000,
    FEW_VIEWS_LENGTH = 2000,
    SHORT_UPDATES = 10,
    LEAST_INTERVAL = 20,
    RELOCATION_INTERVAL = 50,
    DENSE_LENGTH = 2000
};
#define SHORT_THRESHOLD 1.7
#define FEW_VIEWS 24.0 // 1.5 per SH coefficient
#define ANNEAL_FROM 0.7
#define SHORT_LATE_RATE 0.1
#define SHORT_SHAPE_RATE 2.0
#define SMALL_PIXELS 1.3e5
#define LARGE_PIXELS 3.2e5
#define FINE_VIEWS_FROM 15.0
#define FINE_VIEWS 30.0
#define LARGE_ABS_SHARE 0.5
#define LARGE_NEAR_DEPTH 0.37 // gamma of Pixel-GS

static int rounded(double value, int least)
{
    const int whole = (int)lround(value);
    return whole < least ? least : whole;
}

// Batches shrink with the run, so that the number of steps does not.
static int batch(int paper, double f)
{
    return paper ? rounded(paper * fmin(f, 1.0), 1) : 0;
}

// 3DGS resets opacities once more on a white background, at the begin of densification.
static bool is_white(const sgs_train_options *options)
{
    const float *c = options->background;
    return !options->background_random && c[0] >= 1.0f && c[1] >= 1.0f && c[2] >= 1.0f;
}

static int first_update(int iterations)
{
    return rounded(500 * fmin(1.0, (double)iterations / SHORT_LENGTH) - 1, 1);
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

// Without milestones; the position rate is the final one (sgsi_schedule_lr).
static sgsi_schedule finetune(const sgs_train_options *options)
{
    return (sgsi_schedule){.iterations = options->iterations,
                           .dense = is_dense(options),
                           .densify_interval = 100,
                           .resolution_interval = 100,
                           .middle_until = 1,
                           .lr_span = 1e-9,
                           .anneal_from = options->iterations,
                           .lr_late = 1.0,
                           .lr_shape = 1.0,
                           .check_interval = rounded(options->spare_interval, 1),
                           .threshold_factor = 1.0};
}

// Position of N < PAPER_LENGTH between SHORT_LENGTH, 0, and PAPER_LENGTH, 1; log-linear.
static double beyond_short(int iterations)
{
    return fmax(log((double)iterations / SHORT_LENGTH) / log((double)PAPER_LENGTH / SHORT_LENGTH),
                0.0);
}

// How far growth follows the rules of large photographs, 0 to 1: log-linear in their pixels, and
// linear in their number.
static double fine_growth(size_t views, double pixels)
{
    const double size = log(pixels / SMALL_PIXELS) / log(LARGE_PIXELS / SMALL_PIXELS);
    const double number = ((double)views - FINE_VIEWS_FROM) / (FINE_VIEWS - FINE_VIEWS_FROM);
    return fmin(fmax(size, 0.0), 1.0) * fmin(fmax(number, 0.0), 1.0);
}

double sgsi_schedule_sh_rate(const sgs_train_options *options, size_t views)
{
    if (options->schedule != SGS_SCHEDULE_SCALED || options->iterations >= PAPER_LENGTH)
        return 1.0;
    const double above = log((double)options->iterations / FEW_VIEWS_LENGTH) /
                         log((double)SHORT_LENGTH / FEW_VIEWS_LENGTH);
    return pow(fmin((double)views / FEW_VIEWS, 1.0),
               fmin(fmax(above, 0.0), 1.0 - beyond_short(options->iterations)));
}

// A tenth at SHORT_LENGTH, 1 up to CONSTANT_LENGTH and from PAPER_LENGTH on; beyond: position of N
// between the last two, log-linear.
static double late_rate(int iterations, double beyond)
{
    const double below =
        log((double)iterations / CONSTANT_LENGTH) / log((double)SHORT_LENGTH / CONSTANT_LENGTH);
    return pow(SHORT_LATE_RATE, fmin(fmax(below, 0.0), 1.0 - beyond));
}

sgsi_schedule sgsi_schedule_make(const sgs_train_options *options, size_t views, double pixels)
{
    if (options->schedule == SGS_SCHEDULE_FINETUNE)
        return finetune(options);
    const bool scaled = options->schedule == SGS_SCHEDULE_SCALED;
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(options->pipeline);
    const double f = scaled ? (double)options->iterations / PAPER_LENGTH : 1.0;
    sgsi_schedule schedule = {
        .iterations = options->iterations,
        .dense = is_dense(options),
        .densify_from = 500,
        .densify_until = pipeline->densify_until,
        .densify_interval = pipeline->densify_interval,
        .reset_interval = pipeline->relocates ? 0 : 3000,
        .growth = pipeline->relocates ? options->pipeline_options.mcmc_growth : 0.0,
        .reset_until = pipeline->densify_until,
        .first_reset = is_white(options) ? 500 : 0,
        .prune_interval = pipeline->prune_interval ? rounded(pipeline->prune_interval * f, 1) : 0,
        .batch_rest = batch(pipeline->batch_rest, f),
        .batch_middle = batch(pipeline->batch_middle, f),
        .batch_late = batch(pipeline->batch_late, f),
        .middle_until = rounded(20000 * f, 1),
        .sh_interval = rounded(1000 * f, 1),
        .resolution_from = rounded(500 * fmin(f, 1.0), 0),
        .resolution_interval = rounded(100 * fmin(f, 1.0), 1),
        .lr_span = PAPER_LENGTH * f,
        .anneal_from = options->iterations,
        .lr_late = 1.0,
        .lr_shape = 1.0,
        .check_interval = rounded(options->spare_interval * f, 1),
        .threshold_factor = 1.0};
    if (!scaled || options->iterations == PAPER_LENGTH)
        return schedule;
    schedule.densify_until = rounded(pipeline->densify_until * f, 1);
    if (f >= 1.0) {
        schedule.reset_until = schedule.densify_until;
        return schedule;
    }
    const double beyond = beyond_short(options->iterations);
    schedule.anneal_from = rounded(ANNEAL_FROM * options->iterations, 1);
    schedule.lr_late = late_rate(options->iterations, beyond);
    if (schedule.dense || !pipeline->relocates)
        schedule.lr_shape = fmin(sqrt(1.0 / f), SHORT_SHAPE_RATE);
    if (pipeline->relocates) {
        scale_relocations(&schedule, f);
        return schedule;
    }
    const double paper_updates = (PAPER_HALF - 500.0) / pipeline->densify_interval;
    const double large = pipeline->fine_growth ? fine_growth(views, pixels) : 0.0;
    schedule.threshold_factor = pow(SHORT_THRESHOLD, (1.0 - beyond) * (1.0 - large));
    schedule.abs_share = LARGE_ABS_SHARE * (1.0 - beyond) * large;
    schedule.near_depth = LARGE_NEAR_DEPTH * (1.0 - beyond) * large;
    const double updates = SHORT_UPDATES * pow(paper_updates / SHORT_UPDATES, beyond);
    schedule.densify_from = first_update(options->iterations);
    schedule.densify_interval =
        rounded((PAPER_HALF * f - schedule.densify_from) / updates, LEAST_INTERVAL);
    schedule.reset_interval =
        rounded(3000.0 / schedule.densify_interval, 1) * schedule.densify_interval;
    const int third = schedule.densify_until - schedule.densify_until * 2 / 3,
              half = schedule.reset_interval / 2;
    schedule.reset_until = schedule.densify_until - (third < half ? third : half);
    if (schedule.reset_interval >= schedule.reset_until)
        schedule.first_reset = 0; // the run is too short for resets
    return schedule;
}

bool sgsi_schedule_is_structural(const sgsi_schedule *schedule, int iteration)
{
    return iteration > schedule->densify_from && iteration < schedule->densify_until &&
           iteration % schedule->densify_interval == 0;
}

bool sgsi_schedule_is_reset(const sgsi_schedule *schedule, int iteration)
{
    return schedule->reset_interval && iteration < schedule->reset_until &&
           (iteration % schedule->reset_interval == 0 || iteration == schedule->first_reset);
}

// train.py of 3DGS: `iteration > opacity_reset_interval`, and the reset at that iteration follows
// the update. Without a reset, as in a short scaled run, large primitives are kept.
bool sgsi_schedule_prunes_large(const sgsi_schedule *schedule, int last_reset)
{
    return schedule->reset_interval && last_reset >= schedule->reset_interval;
}

bool sgsi_schedule_is_final_prune(const sgsi_schedule *schedule, int iteration)
{
    return schedule->prune_interval && iteration > schedule->densify_until &&
           iteration < schedule->iterations && iteration % schedule->prune_interval == 0;
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
