// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// 3D Gaussian Splatting as Markov Chain Monte Carlo (Kheradmand et al. 2024, arXiv 2404.09591): the
// primitives are samples, and an update moves them instead of cloning, splitting and pruning. No
// opacity is ever reset and no size limited.
//
// Relocation: a primitive of opacity <= 0.005 is dead. For each one a living primitive is drawn
// with replacement by its opacity, and a source drawn c times and its c dead rows become c + 1
// equal primitives that together look like the source (equation 9). They separate by their moments:
// those of the source restart, the dead rows keep theirs, as in the released code.
//
// Growth: the count grows to min(cap, 1.05 N). The sources are drawn from all rows by their new
// opacities and duplicated in the same way; moments of sources and new rows start at 0. At the cap
// only relocation continues.
//
// Noise and regularisers: density/position_noise.c and optimize/kernel_optimize.inl. Their
// published weights depend on the unit of length, because the noise grows with its third power and
// the scale loss with the first. By default they are multiplied by (5 / E)^2 and 5 / E: a scene of
// extent E = 5 gets the published values, and the result does not depend on the unit.
//
// Runs below 30 000 iterations: the copies of a primitive coincide, and the noise separates them
// too slowly for a run of a few thousand iterations, while it prevents faint primitives from
// converging. Up to 7000 iterations there is no noise. Instead, the copies are jittered: each moves
// once, by 0.8 times a normal deviate of its own covariance, like the children of a split. A given
// --mcmc-noise is used as it is, without the jitter. Few updates also have to place the primitives
// where they are missing: opacities in the draws are multiplied by the mean gradient of the
// position, and growth is so slow that it reaches the cap after a fifth of the updates, because the
// gradients of the first updates describe a blurred image. Towards 30 000 iterations all of this
// approaches the published method.
//
// SPARE-GS (a proposal; the paper does not treat this pipeline): w multiplies the opacities of both
// draws, and growth is proportional to sum min(w, 1) instead of N, so that over-quota regions
// contribute less. Redundant rows are treated with the dead ones: they are deleted and the cap is
// reduced by as many, or relocated. The opacity loss makes many rows faint, so an update takes the
// faintest: at most 5 % (mcmc_growth) below 30 000 iterations. With the published growth, deleting
// as many would stop the growth, and the cap would fall in each of 243 updates: there an update
// deletes at most half of what growth may add, and none at the cap.

#include "density/pipeline.h"

#include <math.h>

#include "base/core.h"
#include "density/relocation.h"
#include "density/run_length.h"

static const float DEAD = 0.005f;
static const double PAPER_EXTENT = 5.0, PAPER_NOISE = 5e5, SHORT_JITTER = 0.8;

static const double CAP_REACHED = 0.2; // of the updates up to 7000 iterations

enum { CAP_OF_INITIAL = 10, MAX_CAP = 1000000, DRAW_RELOCATION = 0x3E10, DRAW_GROWTH = 0x6407 };

typedef struct chain_update {
    const sgsi_density_options *options;
    sgsi_density_columns *c;
    double *weight;  // of the draws
    uint8_t *dead;   // rows to relocate
    uint8_t *gone;   // rows that do not stay: not finite, or redundant and deleted
    uint32_t *times; // how often a row was drawn
    uint32_t *drawn; // [draws]
    size_t draws;
} chain_update;

static size_t limit(size_t max_count, size_t initial)
{
    const size_t own = CAP_OF_INITIAL * initial < MAX_CAP ? CAP_OF_INITIAL * initial : MAX_CAP;
    if (max_count)
        return max_count;
    return own > initial ? own : initial;
}

static size_t cap_of(const sgsi_density_options *options)
{
    const size_t deleted = (size_t)options->state->deleted,
                 cap = limit(options->max_count, (size_t)options->state->initial_count);
    return cap > deleted ? cap - deleted : 0;
}

// Opacity of row i as it is now.
static double opacity_now(const sgsi_density_columns *c, size_t i)
{
    return (double)(c->moves.opacity[i] > 0.0f ? c->moves.opacity[i] : c->opacity[i]);
}

static double weight_now(const sgsi_density_columns *c, size_t i)
{
    return (double)c->weight[c->moves.root[i]];
}

// Most rows that an update takes from the redundant ones: as many as a published update may add,
// because a short run would otherwise lose most rows in few updates. A published run deletes half
// of what this update adds.
static size_t redundant_most(const chain_update *chain)
{
    const sgs_train_options *train = chain->options->train;
    const size_t count = chain->c->count, cap = cap_of(chain->options);
    const double share = fmin(chain->options->growth, train->pipeline_options.mcmc_growth),
                 all = share * (double)count,
                 added = fmin(all, cap > count ? (double)(cap - count) : 0.0),
                 shortness = train->pipeline_options.mcmc_redundant == SGS_MCMC_RELOCATE
                                 ? 1.0
                                 : sgsi_run_shortness(train);
    return (size_t)floor(shortness * all + (1.0 - shortness) * 0.5 * added + 1e-9);
}

// Keeps in the mask the faintest redundant rows among the living.
static sgs_status limit_redundant(chain_update *chain, sgsi_density_result *result)
{
    sgsi_density_columns *c = chain->c;
    const size_t most = redundant_most(chain);
    size_t redundant = 0;
    for (size_t i = 0; i < c->count; ++i) {
        c->redundant[i] = c->redundant[i] && !c->degenerate[i] && c->opacity[i] > DEAD;
        redundant += c->redundant[i];
        chain->weight[i] = -(double)c->opacity[i];
    }
    if (redundant <= most)
        return SGS_STATUS_OK;
    uint8_t *const chosen = chain->gone; // free until mark_dead
    const sgs_status status = sgsi_select_best(chain->weight, c->redundant, c->count, most, chosen);
    for (size_t i = 0; i < c->count && !status; ++i)
        c->redundant[i] = chosen[i];
    result->spare_deferred = redundant - most;
    return status;
}

// Returns the number of dead rows.
static size_t mark_dead(chain_update *chain)
{
    sgsi_density_columns *c = chain->c;
    const bool relocates =
        chain->options->train->pipeline_options.mcmc_redundant == SGS_MCMC_RELOCATE;
    size_t dead = 0;
    for (size_t i = 0; i < c->count; ++i) {
        const bool redundant = c->redundant[i];
        chain->dead[i] = !c->degenerate[i] && (c->opacity[i] <= DEAD || (redundant && relocates));
        chain->gone[i] = c->degenerate[i] || (redundant && !relocates);
        chain->options->state->deleted += redundant && !relocates;
        c->redundant[i] = redundant && !relocates;
        dead += chain->dead[i];
    }
    return dead;
}

// Draws `draws` sources among the rows with a weight and replaces each of them by the rows that
// share it. Returns with *drew false where no row has a weight.
static sgs_status duplicate_sources(chain_update *chain, size_t draws, uint64_t tag, bool *drew)
{
    sgsi_density_columns *c = chain->c;
    *drew = false;
    if (draws > chain->draws &&
        !sgsi_grow((void **)&chain->drawn, chain->draws, draws, sizeof *chain->drawn))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to draw %zu primitives",
                         draws);
    chain->draws = draws > chain->draws ? draws : chain->draws;
    const uint64_t seed =
        sgsi_random_bits(chain->options->seed ^ tag, (uint64_t)chain->options->iteration);
    const sgs_status status =
        sgsi_draw_rows(chain->weight, c->count, draws, seed, chain->drawn, drew);
    for (size_t i = 0; i < c->count; ++i)
        chain->times[i] = 0;
    for (size_t j = 0; j < draws && *drew; ++j)
        ++chain->times[chain->drawn[j]];
    for (size_t i = 0; i < c->count && *drew; ++i) {
        if (!chain->times[i])
            continue;
        const uint32_t n = chain->times[i] + 1;
        const double opacity = opacity_now(c, i);
        c->moves.opacity[i] = (float)sgsi_relocation_clamp(sgsi_relocation_opacity(opacity, n));
        c->moves.log_scale[i] += (float)log(sgsi_relocation_scale(opacity, n));
        c->moves.forget[i] = 1;
    }
    return status;
}

// Multiplies the weights of the draws by the gradients of short runs, relative to their mean.
static void weigh_by_gradient(chain_update *chain)
{
    const sgsi_density_columns *c = chain->c;
    const double shortness = sgsi_run_shortness(chain->options->train);
    double sum = 0.0, count = 0.0;
    for (size_t i = 0; i < c->count; ++i)
        if (!chain->dead[i] && !chain->gone[i]) {
            sum += (double)c->score[i];
            ++count;
        }
    if (!(sum > 0.0))
        return; // nothing was seen since the last update
    for (size_t i = 0; i < c->count; ++i) {
        const double relative = (double)c->score[c->moves.root[i]] * count / sum;
        chain->weight[i] *= 1.0 - shortness + shortness * relative;
    }
}

static sgs_status relocate(chain_update *chain, size_t dead)
{
    sgsi_density_columns *c = chain->c;
    for (size_t i = 0; i < c->count; ++i)
        chain->weight[i] =
            chain->dead[i] || chain->gone[i] ? 0.0 : (double)c->opacity[i] * (double)c->weight[i];
    weigh_by_gradient(chain);
    bool drew;
    const sgs_status status = duplicate_sources(chain, dead, DRAW_RELOCATION, &drew);
    size_t j = 0;
    for (size_t i = 0; i < c->count && !status && drew; ++i) {
        if (!chain->dead[i])
            continue;
        const uint32_t source = chain->drawn[j++];
        c->moves.root[i] = source;
        c->moves.opacity[i] = c->moves.opacity[source];
        c->moves.log_scale[i] = c->moves.log_scale[source];
    }
    return status;
}

// Share of `count` rows that this update adds. In short runs: as much as reaches the cap at
// CAP_REACHED, at most the growth of the options.
static double growth_now(const sgsi_density_options *options, size_t count, size_t cap)
{
    if (!count || count >= cap)
        return 0.0;
    const double updates = fmax(CAP_REACHED * options->update_count - options->update, 1.0),
                 even = pow((double)cap / (double)count, 1.0 / updates) - 1.0,
                 shortness = sgsi_run_shortness(options->train);
    return shortness * fmin(even, options->growth) + (1.0 - shortness) * options->growth;
}

static sgs_status grow(chain_update *chain)
{
    sgsi_density_columns *c = chain->c;
    const size_t cap = cap_of(chain->options);
    size_t stay = 0;
    double base = 0.0;
    for (size_t i = 0; i < c->count; ++i) {
        chain->weight[i] = chain->gone[i] ? 0.0 : opacity_now(c, i) * weight_now(c, i);
        stay += !chain->gone[i];
        base += chain->gone[i] ? 0.0 : fmin(weight_now(c, i), 1.0);
    }
    const size_t wanted = (size_t)floor(growth_now(chain->options, stay, cap) * base + 1e-9);
    const size_t room = cap > stay ? cap - stay : 0, draws = wanted < room ? wanted : room;
    if (!draws)
        return SGS_STATUS_OK;
    weigh_by_gradient(chain);
    bool drew;
    const sgs_status status = duplicate_sources(chain, draws, DRAW_GROWTH, &drew);
    for (size_t i = 0; i < c->count && !status && drew; ++i)
        c->moves.copies[i] = chain->times[i];
    return status;
}

static sgs_status move_rows(chain_update *chain, sgsi_density_result *result)
{
    sgs_status status = limit_redundant(chain, result);
    if (!status) {
        const size_t dead = mark_dead(chain);
        status = dead ? relocate(chain, dead) : SGS_STATUS_OK;
    }
    return status ? status : grow(chain);
}

// How far automatic noise is replaced by the jitter of copies.
static double jitter_share(const sgs_train_options *train)
{
    return train->pipeline_options.mcmc_noise < 0.0 ? sgsi_run_shortness(train) : 0.0;
}

static sgs_status decide(const sgsi_density_options *options, sgsi_density_columns *c,
                         sgsi_density_result *result)
{
    const size_t n = c->count ? c->count : 1;
    chain_update chain = {.options = options,
                          .c = c,
                          .weight = sgsi_alloc(n, sizeof *chain.weight),
                          .dead = sgsi_calloc(n, 1),
                          .gone = sgsi_calloc(n, 1),
                          .times = sgsi_calloc(n, sizeof *chain.times)};
    c->moves.jitter = SHORT_JITTER * jitter_share(options->train);
    sgs_status status;
    if (chain.weight && chain.dead && chain.gone && chain.times)
        status = move_rows(&chain, result);
    else
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to relocate %zu primitives",
                           c->count);
    sgsi_free(chain.weight);
    sgsi_free(chain.dead);
    sgsi_free(chain.gone);
    sgsi_free(chain.times);
    sgsi_free(chain.drawn);
    return status;
}

static sgsi_sampling sampling(const sgs_train_options *train, double extent)
{
    const sgs_pipeline_options *own = &train->pipeline_options;
    const bool relative = own->mcmc_units == SGS_MCMC_UNITS_EXTENT && extent > 0.0;
    const double unit = relative ? PAPER_EXTENT / extent : 1.0;
    // A scale grows by a factor of e in 200 steps at most: a short run has no time to grow from a
    // tenth.
    const double length = train->schedule == SGS_SCHEDULE_SCALED
                              ? fmin(train->iterations / (double)SGSI_PAPER_LENGTH, 1.0)
                              : 1.0;
    // Without updates, nothing relocates what the noise moves away.
    const double automatic = train->schedule == SGS_SCHEDULE_FINETUNE ? 0.0 : PAPER_NOISE;
    const double noise = own->mcmc_noise < 0.0 ? automatic : own->mcmc_noise;
    return (sgsi_sampling){.noise = noise * unit * unit * (1.0 - jitter_share(train)),
                           .opacity_loss = own->mcmc_opacity_loss,
                           .scale_loss = own->mcmc_scale_loss * unit,
                           .start_opacity = own->mcmc_start_opacity,
                           .start_scale = pow(own->mcmc_start_scale, length)};
}

const sgsi_pipeline sgsi_pipeline_mcmc = {.name = "mcmc",
                                          .densify_until = 25000,
                                          .densify_interval = 100,
                                          .lr_opacity = 0.05f,
                                          .lr_rest = 1.25e-4f,
                                          .relocates = true,
                                          .decide = decide,
                                          .sampling = sampling,
                                          .limit = limit};
