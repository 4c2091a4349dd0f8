// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/profile_report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/output.h"
#include "sparegs/runtime.h"

// Numbers of a profile that are averaged over views.
#define SGS_EACH_SUM(X)                                                                            \
    X(rays)                                                                                        \
    X(traced)                                                                                      \
    X(forward)                                                                                     \
    X(noise)                                                                                       \
    X(callbacks)                                                                                   \
    X(distinct)                                                                                    \
    X(gathered)                                                                                    \
    X(candidates)                                                                                  \
    X(block_tests)                                                                                 \
    X(evaluations)                                                                                 \
    X(block_hits)                                                                                  \
    X(tile_hits)                                                                                   \
    X(macrotile_hits)                                                                              \
    X(hits)
// Of the views in which a sampled pixel has a ray.
#define SGS_EACH_SAMPLED(X) X(sampled_hits) X(sampled_hits_unterminated) X(sampled_terminated)
#define SGS_EACH_TREE_SUM(X)                                                                       \
    X(build)                                                                                       \
    X(refit)                                                                                       \
    X(gather)                                                                                      \
    X(gather_with_depth_bound)                                                                     \
    X(bytes)                                                                                       \
    X(callbacks)                                                                                   \
    X(distinct)                                                                                    \
    X(cost)                                                                                        \
    X(overlap)                                                                                     \
    X(nodes)                                                                                       \
    X(leaves)                                                                                      \
    X(depth)                                                                                       \
    X(node_visits)                                                                                 \
    X(box_tests)

enum { LEAF_SIZES = sizeof((sgs_profile_tree *)0)->leaf_sizes / sizeof(double) };

static void add_numbers(json_t *object, const sgs_profile *profile);
static json_t *tree_json(const sgs_profile *profile, sgs_profile_kind kind);

static json_t *one_view_json(const char *name, const char *built_for, const sgs_profile *profile)
{
    json_t *object = json_object(), *trees = json_array();
    json_object_set_new(object, "name", json_text(name));
    json_object_set_new(object, "built_for", built_for ? json_text(built_for) : json_null());
    json_object_set_new(object, "width", json_integer(profile->width));
    json_object_set_new(object, "height", json_integer(profile->height));
    add_numbers(object, profile);
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k)
        json_array_append_new(trees, tree_json(profile, (sgs_profile_kind)k));
    json_object_set_new(object, "trees", trees);
    return object;
}

void profile_report_add(profile_report *report, const char *name, const char *built_for,
                        const sgs_profile *profile)
{
    sgs_profile *mean = &report->mean;
    ++report->views;
    report->built_elsewhere = built_for != NULL;
    if (!report->per_view)
        report->per_view = json_array();
    json_array_append_new(report->per_view, one_view_json(name, built_for, profile));
    mean->primitives = profile->primitives;
    mean->tiles_x += profile->tiles_x * profile->tiles_y;
#define X(name) mean->name += profile->name;
    SGS_EACH_SUM(X)
#undef X
    if (!isnan(profile->sampled_hits)) {
        ++report->sampled_views;
#define X(name) mean->name += profile->name;
        SGS_EACH_SAMPLED(X)
#undef X
    }
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
#define X(name) mean->trees[k].name += profile->trees[k].name;
        SGS_EACH_TREE_SUM(X)
#undef X
        for (int n = 0; n < LEAF_SIZES; ++n)
            mean->trees[k].leaf_sizes[n] += profile->trees[k].leaf_sizes[n];
    }
    const int tiles = profile->tiles_x * profile->tiles_y;
    double sum = 0, largest = 0;
    for (int t = 0; t < tiles; ++t) {
        sum += (double)profile->tile_seconds[t];
        largest = fmax(largest, (double)profile->tile_seconds[t]);
    }
    if (sum > 0)
        report->tile_slowest = fmax(report->tile_slowest, largest * tiles / sum);
}

void profile_report_finish(profile_report *report)
{
    sgs_profile *mean = &report->mean;
    const double share = report->views ? 1.0 / (double)report->views : 0;
#define X(name) mean->name *= share;
    SGS_EACH_SUM(X)
#undef X
    const double sampled = report->sampled_views ? 1.0 / (double)report->sampled_views : NAN;
#define X(name) mean->name *= sampled;
    SGS_EACH_SAMPLED(X)
#undef X
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
#define X(name) mean->trees[k].name *= share;
        SGS_EACH_TREE_SUM(X)
#undef X
        for (int n = 0; n < LEAF_SIZES; ++n)
            mean->trees[k].leaf_sizes[n] *= share;
    }
    mean->tiles_x = (int)(mean->tiles_x * share + 0.5);
    mean->tiles_y = 1;
}

// NaN if the divisor is 0: null in JSON, a dash in the table.
static double quotient(double a, double b)
{
    return b > 0 ? a / b : NAN;
}

void profile_counters_add(sgs_counter_values *to, const sgs_counter_values *from, double share)
{
    double *const sums[] = {&to->cycles, &to->instructions, &to->cache_references,
                            &to->cache_misses, &to->branch_misses};
    const double values[] = {from->cycles, from->instructions, from->cache_references,
                             from->cache_misses, from->branch_misses};
    for (int k = 0; k < 5; ++k)
        *sums[k] = values[k] < 0 || *sums[k] < 0 ? -1 : *sums[k] + share * values[k];
}

// ---- Conclusions ----

// Training rebuilds the tree when primitives are added or removed, at most every hundred
// iterations.
enum { REBUILT_EVERY = 100 };

// Wall-clock seconds of the gather with depth bounds, as in training.
static double gather_wall(const sgs_profile_tree *tree)
{
    return tree->gather_with_depth_bound / sgs_threads_get();
}

// Seconds per iteration to update the tree and gather.
static double iteration_cost(const profile_report *report, sgs_profile_kind kind)
{
    const sgs_profile_tree *tree = &report->mean.trees[kind];
    if (kind < SGS_PROFILE_REFIT)
        return tree->build + gather_wall(tree);
    return tree->refit + gather_wall(tree) + tree->build / REBUILT_EVERY;
}

// Above this timing noise, or if it is unknown, no tree is recommended for a fixed model.
static const double noise_limit = 0.2;

static bool is_too_noisy(const profile_report *report)
{
    return !(report->mean.noise <= noise_limit);
}

// Relative difference that exceeds timing noise, at least 2 %. Unknown noise (NaN) is assumed to be
// at the limit.
static double min_gain(const profile_report *report)
{
    return isnan(report->mean.noise) ? noise_limit : fmax(report->mean.noise, 0.02);
}

// Wall-clock seconds per view of a fixed model for tree and gather. The boxes depend on the camera,
// so that every view rebuilds or refits the tree.
static double view_cost(const profile_report *report, sgs_profile_kind kind)
{
    const sgs_profile_tree *tree = &report->mean.trees[kind];
    const double update = kind < SGS_PROFILE_REFIT ? tree->build : tree->refit;
    return update + tree->gather / sgs_threads_get();
}

typedef double (*cost_fn)(const profile_report *report, sgs_profile_kind kind);

// The refitted tree, unless another one takes less time by more than the noise.
static sgs_profile_kind best_tree(const profile_report *report, cost_fn cost)
{
    const double factor = 1 - min_gain(report);
    sgs_profile_kind best = SGS_PROFILE_REFIT;
    for (int k = 0; k < SGS_PROFILE_REFIT; ++k)
        if (cost(report, (sgs_profile_kind)k) < factor * cost(report, best))
            best = (sgs_profile_kind)k;
    return best;
}

// For user geometry Embree builds the same tree with HIGH as with MEDIUM.
static bool high_is_medium(const profile_report *report)
{
    const sgs_profile_tree *medium = &report->mean.trees[SGS_PROFILE_MEDIUM],
                           *high = &report->mean.trees[SGS_PROFILE_HIGH];
    return medium->callbacks == high->callbacks && medium->bytes == high->bytes;
}

// Boxes and primitives that the packets of a view test.
static double tests(const sgs_profile_tree *tree)
{
    return tree->box_tests + tree->callbacks;
}

static double more_tests(const profile_report *report)
{
    return quotient(tests(&report->mean.trees[SGS_PROFILE_AGED]),
                    tests(&report->mean.trees[SGS_PROFILE_REFIT])) -
           1;
}

// Refits after which the extra gather time of an aging tree equals the cost of a build. Gather time
// is taken as proportional to the tests, which are less noisy than time, and grows linearly to
// `extra` at the measured age n. So r refits cost extra r^2 / (2 n), and the mean cost per
// iteration is minimal where that equals the build. Infinite if the tests do not grow.
static double rebuild_after(const profile_report *report)
{
    const sgs_profile_tree *fresh = &report->mean.trees[SGS_PROFILE_REFIT];
    const double extra = gather_wall(fresh) * more_tests(report);
    return report->refits && extra > 0 && more_tests(report) > 1e-3
               ? sqrt(2 * fresh->build * report->refits / extra)
               : INFINITY;
}

typedef struct share {
    const char *name;
    double seconds;
} share;

enum { ITERATION_PARTS = 6 };

// Phases of a training iteration, in order.
static void iteration_parts(const sgs_bench_sample *s, share parts[ITERATION_PARTS])
{
    const share made[ITERATION_PARTS] = {{"refit", s->refit},       {"gather", s->gather},
                                         {"forward", s->forward},   {"loss", s->loss},
                                         {"backward", s->backward}, {"optimizer", s->optimizer}};
    memcpy(parts, made, sizeof made);
}

// The longest phase of an iteration, or of a view if no iteration was measured.
static share dominant(const profile_report *report, double *whole)
{
    const sgs_profile_tree *tree = &report->mean.trees[SGS_PROFILE_REFIT];
    share largest = {"gather", gather_wall(tree)};
    *whole = gather_wall(tree) + report->mean.forward / sgs_threads_get();
    if (report->mean.forward > tree->gather)
        largest = (share){"forward", report->mean.forward / sgs_threads_get()};
    if (report->training.iteration <= 0)
        return largest;
    share parts[ITERATION_PARTS];
    iteration_parts(&report->training, parts);
    *whole = report->training.iteration;
    largest = parts[0];
    for (int i = 1; i < ITERATION_PARTS; ++i)
        if (parts[i].seconds > largest.seconds)
            largest = parts[i];
    return largest;
}

// The conclusions as sentences; release with free().

// Milliseconds of the kinds: "low 2.89, medium 6.97, high 6.89, refit 1.82".
static char *list_costs(const profile_report *report, cost_fn cost)
{
    return format_text("low %.2f, medium %.2f, high %.2f, refit %.2f",
                       1e3 * cost(report, SGS_PROFILE_LOW), 1e3 * cost(report, SGS_PROFILE_MEDIUM),
                       1e3 * cost(report, SGS_PROFILE_HIGH), 1e3 * cost(report, SGS_PROFILE_REFIT));
}

static char *answer_drawing(const profile_report *report)
{
    const sgs_profile_kind best = best_tree(report, view_cost);
    if (isnan(report->mean.noise))
        return format_text("For a fixed model: undecided (one repetition gives no estimate of the "
                           "timing noise; use more of them)");
    if (is_too_noisy(report))
        return format_text("For a fixed model: undecided (gather times differ by %.0f %% between "
                           "repetitions; use more of them, or an idle machine)",
                           100 * report->mean.noise);
    char *costs = list_costs(report, view_cost);
    char *text =
        format_text("For a fixed model: %s (%.2f ms per view for tree and gather; %s; the "
                    "boxes depend on the camera, so every view rebuilds or refits the tree)",
                    sgs_profile_kind_name(best), 1e3 * view_cost(report, best), costs);
    free(costs);
    return text;
}

static char *answer_quality(const profile_report *report)
{
    const sgs_profile_kind train = best_tree(report, iteration_cost);
    char *costs = list_costs(report, iteration_cost), *drawing = answer_drawing(report);
    char *text = format_text(
        "Build quality for training: %s (%.2f ms per iteration for tree and gather; %s, rebuilt "
        "every %d iterations). %s.%s",
        sgs_profile_kind_name(train), 1e3 * iteration_cost(report, train), costs, REBUILT_EVERY,
        drawing, high_is_medium(report) ? " High and medium produce the same tree." : "");
    free(costs);
    free(drawing);
    return text;
}

static char *answer_rebuild(const profile_report *report)
{
    const sgs_profile_tree *fresh = &report->mean.trees[SGS_PROFILE_REFIT];
    const double after = rebuild_after(report);
    if (isfinite(after))
        return format_text(
            "Rebuild: after about %.0f refits, or when primitives are added or removed; %d refits "
            "increase the tests of boxes and primitives by %.1f %%, a build takes %.2f ms and a "
            "refit %.2f ms.",
            after, report->refits, 100 * more_tests(report), 1e3 * fresh->build,
            1e3 * fresh->refit);
    return format_text(
        "Rebuild: only when primitives are added or removed; %d refits do not increase the tests "
        "of boxes and primitives.",
        report->refits);
}

static char *answer_dominant(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    double whole;
    const share largest = dominant(report, &whole);
    if (!(m->evaluations > 0))
        return format_text("Dominant phase: %s; no part of the model is in view.", largest.name);
    return format_text(
        "Dominant phase: %s, %.0f %% of %s; %.1f %% of the evaluated (block, primitive) pairs have "
        "no hit, %.0f %% of SIMD lanes have a hit, %.1f %% of the primitives that the BVH reports "
        "lead to a hit, and "
        "the slowest tile takes %.1f times the mean.",
        largest.name, 100 * quotient(largest.seconds, whole),
        report->training.iteration > 0 ? "an iteration" : "a view",
        100 * (1 - quotient(m->block_hits, m->evaluations)),
        100 * quotient(m->hits, 16 * m->evaluations),
        100 * quotient(m->macrotile_hits, m->distinct), report->tile_slowest);
}

// ---- Table and JSON ----

static void print_trees(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    printf("%-8s %10s %10s %12s %12s %10s\n", "tree", "build ms", "refit ms", "gather ms*",
           "bounded ms*", "MB");
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        const sgs_profile_tree *t = &m->trees[k];
        char refit[32] = "-";
        if (k >= SGS_PROFILE_REFIT)
            snprintf(refit, sizeof refit, "%.2f", 1e3 * t->refit);
        printf("%-8s %10.2f %10s %12.2f %12.2f %10.1f\n",
               sgs_profile_kind_name((sgs_profile_kind)k), 1e3 * t->build, refit, 1e3 * t->gather,
               1e3 * t->gather_with_depth_bound, 1e-6 * t->bytes);
    }
    char noise[64] = "unknown with one repetition";
    if (!isnan(m->noise))
        snprintf(noise, sizeof noise, "%.0f %%", 100 * m->noise);
    printf("* core time per view, best of the repetitions (timing noise %s); bounded: with depth "
           "bounds of an earlier visit, as in training; aged: after %d refits%s\n\n",
           noise, report->refits,
           report->built_elsewhere ? "" : "; refit, aged: built for the same camera, the only one");
    printf("%-8s %9s %9s %6s %8s %8s %12s %12s %12s %12s\n", "tree", "nodes", "leaves", "depth",
           "SAH cost", "overlap", "node visits", "box tests", "callbacks", "distinct");
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        const sgs_profile_tree *t = &m->trees[k];
        printf("%-8s %9.0f %9.0f %6.3g %8.1f %8.3f %12.0f %12.0f %12.0f %12.0f\n",
               sgs_profile_kind_name((sgs_profile_kind)k), t->nodes, t->leaves, t->depth, t->cost,
               t->overlap, t->node_visits, t->box_tests, t->callbacks, t->distinct);
    }
    putchar('\n');
}

static void print_counts(const sgs_profile *m)
{
    const struct {
        const char *name;
        double value;
    } rows[] = {{"BVH callbacks", m->callbacks},
                {"distinct in their macrotile", m->distinct},
                {"candidates of the macrotiles", m->gathered},
                {"candidates of the tiles (tile, primitive)", m->candidates},
                {"block tests", m->block_tests},
                {"evaluations (block, primitive)", m->evaluations},
                {"block hits (block, primitive)", m->block_hits},
                {"true hits", m->hits}};
    printf("%-42s %12s %12s\n", "", "per view", "per ray");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i)
        printf("%-42s %12.0f %12.3f\n", rows[i].name, rows[i].value,
               quotient(rows[i].value, m->rays));
    if (m->callbacks > 0 && m->candidates > 0 && m->evaluations > 0)
        printf("false positives: %.1f %% of distinct callbacks, %.1f %% of candidates, %.1f %% of "
               "evaluations, %.1f %% of lanes\n",
               100 * (1 - quotient(m->macrotile_hits, m->distinct)),
               100 * (1 - quotient(m->tile_hits, m->candidates)),
               100 * (1 - quotient(m->block_hits, m->evaluations)),
               100 * (1 - quotient(m->hits, 16 * m->evaluations)));
    else
        puts("false positives: none, no part of the model is in view");
    if (isfinite(m->sampled_hits))
        printf("hits per ray (sampled): %.1f until termination, %.1f without termination; %.0f %% "
               "of rays terminate\n",
               m->sampled_hits, m->sampled_hits_unterminated, 100 * m->sampled_terminated);
}

static void print_training(const sgs_bench_sample *sample)
{
    share parts[ITERATION_PARTS];
    iteration_parts(sample, parts);
    printf("training iteration: %.2f ms:", 1e3 * sample->iteration);
    for (int k = 0; k < ITERATION_PARTS; ++k)
        printf("%s %s %.2f", k ? "," : "", parts[k].name, 1e3 * parts[k].seconds);
    printf("; build %.2f\n", 1e3 * sample->build);
}

static void print_counters(const profile_report *report)
{
    const struct {
        const char *name;
        double value;
        int digits;
    } counters[] = {{"cycles", report->counters.cycles, 0},
                    {"instructions", report->counters.instructions, 0},
                    {"cache references", report->counters.cache_references, 2},
                    {"cache misses", report->counters.cache_misses, 2},
                    {"branch misses", report->counters.branch_misses, 2}};
    if (!report->counted) {
        puts(report->no_counters);
        return;
    }
    printf("hardware counters per view:");
    for (size_t k = 0; k < sizeof counters / sizeof *counters; ++k) {
        if (counters[k].value < 0)
            printf("%s %s unavailable", k ? "," : "", counters[k].name);
        else
            printf("%s %.*f M %s", k ? "," : "", counters[k].digits, 1e-6 * counters[k].value,
                   counters[k].name);
    }
    putchar('\n');
}

void profile_print(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    printf("%.0f primitives, %.0f that a ray can hit, %.0f rays per view, %zu view%s, %s, %d "
           "thread%s\n\n",
           m->primitives, m->traced, m->rays, report->views, report->views == 1 ? "" : "s",
           sgs_isa_name(sgs_isa_get()), sgs_threads_get(), sgs_threads_get() == 1 ? "" : "s");
    print_trees(report);
    print_counts(m);
    if (report->training.iteration > 0)
        print_training(&report->training);
    printf("view without gather: %.2f core ms; per tile %.1f us, the slowest %.1f times the mean\n",
           1e3 * m->forward, 1e6 * quotient(m->forward, m->tiles_x), report->tile_slowest);
    print_counters(report);
    char *const answers[] = {answer_quality(report), answer_rebuild(report),
                             answer_dominant(report)};
    putchar('\n');
    for (int i = 0; i < 3; ++i) {
        puts(answers[i]);
        free(answers[i]);
    }
}

static json_t *tree_json(const sgs_profile *profile, sgs_profile_kind kind)
{
    const sgs_profile_tree *t = &profile->trees[kind];
    json_t *object = json_object(), *sizes = json_array();
    const struct {
        const char *name;
        double value;
    } numbers[] = {{"build_seconds", t->build},
                   {"refit_seconds", kind < SGS_PROFILE_REFIT ? NAN : t->refit},
                   {"gather_core_seconds", t->gather},
                   {"gather_with_depth_bound_core_seconds", t->gather_with_depth_bound},
                   {"bytes", t->bytes},
                   {"callbacks", t->callbacks},
                   {"distinct_callbacks", t->distinct},
                   {"surface_area_cost", t->cost},
                   {"overlap", t->overlap},
                   {"nodes", t->nodes},
                   {"leaves", t->leaves},
                   {"depth", t->depth},
                   {"node_visits", t->node_visits},
                   {"box_tests", t->box_tests}};
    json_object_set_new(object, "name", json_string(sgs_profile_kind_name(kind)));
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i)
        json_object_set_new(object, numbers[i].name, json_number(numbers[i].value));
    for (int n = 0; n < LEAF_SIZES; ++n)
        json_array_append_new(sizes, json_number(t->leaf_sizes[n]));
    json_object_set_new(object, "leaf_sizes", sizes);
    return object;
}

static json_t *counters_json(const profile_report *report)
{
    if (!report->counted)
        return json_null();
    const struct {
        const char *name;
        double value;
    } values[] = {{"cycles", report->counters.cycles},
                  {"instructions", report->counters.instructions},
                  {"cache_references", report->counters.cache_references},
                  {"cache_misses", report->counters.cache_misses},
                  {"branch_misses", report->counters.branch_misses}};
    json_t *object = json_object();
    for (size_t i = 0; i < sizeof values / sizeof *values; ++i)
        json_object_set_new(object, values[i].name,
                            values[i].value < 0 ? json_null() : json_number(values[i].value));
    return object;
}

static json_t *training_json(const sgs_bench_sample *sample)
{
    if (!(sample->iteration > 0))
        return json_null();
    share parts[ITERATION_PARTS];
    iteration_parts(sample, parts);
    json_t *object = json_object();
    for (int k = 0; k < ITERATION_PARTS; ++k)
        json_object_set_new(object, parts[k].name, json_number(parts[k].seconds));
    json_object_set_new(object, "iteration", json_number(sample->iteration));
    json_object_set_new(object, "build", json_number(sample->build));
    return object;
}

// Counts, times and rates of a view, or their means.
static void add_numbers(json_t *object, const sgs_profile *m)
{
    const struct {
        const char *name;
        double value;
    } numbers[] = {{"rays", m->rays},
                   {"traced_primitives", m->traced},
                   {"callbacks", m->callbacks},
                   {"distinct_callbacks", m->distinct},
                   {"macrotile_candidates", m->gathered},
                   {"candidates", m->candidates},
                   {"block_tests", m->block_tests},
                   {"evaluations", m->evaluations},
                   {"block_hits", m->block_hits},
                   {"hits", m->hits},
                   {"hits_per_ray", quotient(m->hits, m->rays)},
                   {"sampled_hits", m->sampled_hits},
                   {"sampled_hits_unstopped", m->sampled_hits_unterminated},
                   {"sampled_stopped", m->sampled_terminated},
                   {"forward_core_seconds", m->forward},
                   {"gather_noise", m->noise}};
    const struct {
        const char *name;
        double hits, all;
    } rates[] = {{"callbacks", m->macrotile_hits, m->distinct},
                 {"candidates", m->tile_hits, m->candidates},
                 {"evaluations", m->block_hits, m->evaluations},
                 {"lanes", m->hits, 16 * m->evaluations}};
    json_t *false_positives = json_object();
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i)
        json_object_set_new(object, numbers[i].name, json_number(numbers[i].value));
    for (size_t i = 0; i < sizeof rates / sizeof *rates; ++i)
        json_object_set_new(false_positives, rates[i].name,
                            json_number(1 - quotient(rates[i].hits, rates[i].all)));
    json_object_set_new(object, "false_positives", false_positives);
}

static json_t *answers_json(const profile_report *report)
{
    json_t *answers = json_object();
    double whole;
    const share largest = dominant(report, &whole);
    char *texts[] = {answer_quality(report), answer_rebuild(report), answer_dominant(report)};
    static const char *const keys[] = {"quality_text", "rebuild_text", "dominant_text"};
    json_object_set_new(answers, "quality_training",
                        json_string(sgs_profile_kind_name(best_tree(report, iteration_cost))));
    json_object_set_new(answers, "quality_drawing",
                        is_too_noisy(report)
                            ? json_null()
                            : json_string(sgs_profile_kind_name(best_tree(report, view_cost))));
    json_object_set_new(answers, "rebuild_after_refits", json_number(rebuild_after(report)));
    json_object_set_new(answers, "dominant", json_string(largest.name));
    json_object_set_new(answers, "dominant_share", json_number(quotient(largest.seconds, whole)));
    for (int i = 0; i < 3; ++i) {
        json_object_set_new(answers, keys[i], json_string(texts[i]));
        free(texts[i]);
    }
    return answers;
}

// The program, the run of it, and the machine.
static void add_origin(json_t *root, const profile_report *report)
{
    json_object_set_new(root, "version", json_string(sgs_version()));
    json_object_set_new(root, "libraries", json_string(sgs_version_libraries()));
    json_object_set_new(root, "model", json_text(report->model));
    json_object_set_new(root, "scene", json_text(report->scene));
    json_object_set_new(root, "repeat", json_integer(report->repeat));
    json_object_set_new(root, "threads", json_integer(sgs_threads_get()));
    json_object_set_new(root, "isa", json_string(sgs_isa_name(sgs_isa_get())));
}

json_t *profile_json(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    json_t *root = json_object(), *trees = json_array(), *view = json_object();
    add_origin(root, report);
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        json_t *tree = tree_json(m, (sgs_profile_kind)k);
        json_object_set_new(tree, "refits",
                            json_integer(k == SGS_PROFILE_AGED ? report->refits : 0));
        json_object_set_new(tree, "iteration_seconds",
                            json_number(iteration_cost(report, (sgs_profile_kind)k)));
        json_array_append_new(trees, tree);
    }
    add_numbers(view, m);
    json_object_set_new(view, "tile_slowest_over_mean", json_number(report->tile_slowest));
    json_object_set_new(root, "primitives", json_integer((json_int_t)m->primitives));
    json_object_set_new(root, "views", json_integer((json_int_t)report->views));
    json_object_set_new(root, "trees", trees);
    json_object_set_new(root, "view", view);
    json_object_set_new(root, "per_view", json_incref(report->per_view));
    json_object_set_new(root, "training_seconds", training_json(&report->training));
    json_object_set_new(root, "counters", counters_json(report));
    json_object_set_new(root, "answers", answers_json(report));
    return root;
}
