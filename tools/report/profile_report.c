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
    X(forward)                                                                                     \
    X(noise)                                                                                       \
    X(callbacks)                                                                                   \
    X(candidates)                                                                                  \
    X(block_tests)                                                                                 \
    X(evaluations)                                                                                 \
    X(block_hits)                                                                                  \
    X(tile_hits)                                                                                   \
    X(macrotile_hits)                                                                              \
    X(hits)
// Of the views in which a sampled pixel has a ray.
#define SGS_EACH_SAMPLED(X) X(sampled_hits) X(sampled_hits_unstopped) X(sampled_stopped)
#define SGS_EACH_TREE_SUM(X)                                                                       \
    X(build) X(refit) X(gather) X(gather_with_depth_bound) X(bytes) X(callbacks) X(cost) X(overlap)

void profile_report_add(profile_report *report, const sgs_profile *profile)
{
    sgs_profile *mean = &report->mean;
    ++report->views;
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
    }
    mean->tiles_x = (int)(mean->tiles_x * share + 0.5);
    mean->tiles_y = 1;
}

// NaN if the divisor is 0: null in JSON, a dash in the table.
static double quotient(double a, double b)
{
    return b > 0 ? a / b : NAN;
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

// Relative difference that exceeds timing noise, at least 2 %.
static double min_gain(const profile_report *report)
{
    return fmax(report->mean.noise, 0.02);
}

static sgs_profile_kind best_for_training(const profile_report *report)
{
    const double factor = 1 - min_gain(report);
    sgs_profile_kind best = SGS_PROFILE_REFIT;
    for (int k = 0; k < SGS_PROFILE_REFIT; ++k)
        if (iteration_cost(report, (sgs_profile_kind)k) < factor * iteration_cost(report, best))
            best = (sgs_profile_kind)k;
    return best;
}

// The tree with the fastest gather for a fixed model; among equals, the cheapest to build.
static sgs_profile_kind best_for_drawing(const profile_report *report)
{
    const double factor = 1 - min_gain(report);
    sgs_profile_kind best = SGS_PROFILE_LOW;
    for (int k = 0; k <= SGS_PROFILE_REFIT; ++k)
        if (report->mean.trees[k].gather < factor * report->mean.trees[best].gather)
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

static double more_callbacks(const profile_report *report)
{
    return quotient(report->mean.trees[SGS_PROFILE_AGED].callbacks,
                    report->mean.trees[SGS_PROFILE_REFIT].callbacks) -
           1;
}

// Refits after which the extra gather time of an aging tree equals the cost of a build. Gather time
// is taken as proportional to callbacks, which are less noisy than time, and grows linearly to
// `extra` at the measured age n. So r refits cost extra r^2 / (2 n), and the mean cost per
// iteration is minimal where that equals the build. Infinite if callbacks do not grow.
static double rebuild_after(const profile_report *report)
{
    const sgs_profile_tree *fresh = &report->mean.trees[SGS_PROFILE_REFIT];
    const double extra = gather_wall(fresh) * more_callbacks(report);
    return report->refits && extra > 0 && more_callbacks(report) > 1e-3
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
static char *answer_quality(const profile_report *report)
{
    const sgs_profile_kind train = best_for_training(report), draw = best_for_drawing(report);
    const sgs_profile_tree *low = &report->mean.trees[SGS_PROFILE_LOW],
                           *best = &report->mean.trees[draw];
    const double gain = low->gather - best->gather, // core time
        price = (best->build - low->build) * sgs_threads_get();
    char *training =
        format_text("Build quality: for training %s, %.2f ms per iteration for tree and gather "
                    "(low %.2f, medium %.2f, high %.2f, refit %.2f, rebuilt every %d iterations)",
                    sgs_profile_kind_name(train), 1e3 * iteration_cost(report, train),
                    1e3 * iteration_cost(report, SGS_PROFILE_LOW),
                    1e3 * iteration_cost(report, SGS_PROFILE_MEDIUM),
                    1e3 * iteration_cost(report, SGS_PROFILE_HIGH),
                    1e3 * iteration_cost(report, SGS_PROFILE_REFIT), REBUILT_EVERY);
    char *drawing =
        draw == SGS_PROFILE_LOW
            ? format_text("for a fixed model low: no other tree is faster by more than the timing "
                          "noise of %.0f %%",
                          100 * min_gain(report))
            : format_text("for a fixed model %s: it is %.0f %% faster than low and amortises its "
                          "build after %.0f views",
                          sgs_profile_kind_name(draw), 100 * quotient(gain, low->gather),
                          ceil(fmax(price / gain, 1)));
    char *text =
        format_text("%s; %s.%s", training, drawing,
                    high_is_medium(report) ? " High and medium produce the same tree." : "");
    free(training);
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
            "increase callbacks by %.1f %%, a build takes %.2f ms and a refit %.2f ms.",
            after, report->refits, 100 * more_callbacks(report), 1e3 * fresh->build,
            1e3 * fresh->refit);
    return format_text(
        "Rebuild: only when primitives are added or removed; %d refits do not increase callbacks.",
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
        "no hit, %.0f %% of SIMD lanes have a hit, %.1f %% of BVH callbacks lead to a hit, and "
        "the slowest tile takes %.1f times the mean.",
        largest.name, 100 * quotient(largest.seconds, whole),
        report->training.iteration > 0 ? "an iteration" : "a view",
        100 * (1 - quotient(m->block_hits, m->evaluations)),
        100 * quotient(m->hits, 16 * m->evaluations),
        100 * quotient(m->macrotile_hits, m->callbacks), report->tile_slowest);
}

// ---- Table and JSON ----

static void print_trees(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    printf("%-8s %10s %10s %12s %12s %10s %12s %10s %9s\n", "tree", "build ms", "refit ms",
           "gather ms*", "bounded ms*", "MB", "callbacks", "SA cost", "overlap");
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        const sgs_profile_tree *t = &m->trees[k];
        printf("%-8s %10.2f %10.2f %12.2f %12.2f %10.1f %12.0f %10.1f %9.3f\n",
               sgs_profile_kind_name((sgs_profile_kind)k), 1e3 * t->build, 1e3 * t->refit,
               1e3 * t->gather, 1e3 * t->gather_with_depth_bound, 1e-6 * t->bytes, t->callbacks,
               t->cost, t->overlap);
    }
    printf("* core time per view, best of the repetitions (timing noise %.0f %%); bounded: with "
           "depth bounds of an earlier visit, as in training; aged: after %d refits\n\n",
           100 * m->noise, report->refits);
}

static void print_counts(const sgs_profile *m)
{
    const struct {
        const char *name;
        double value;
    } rows[] = {{"BVH callbacks", m->callbacks},
                {"candidates of the tiles", m->candidates},
                {"block tests", m->block_tests},
                {"evaluations (block, primitive)", m->evaluations},
                {"block hits (block, primitive)", m->block_hits},
                {"true hits", m->hits}};
    printf("%-34s %12s %12s\n", "", "per view", "per ray");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i)
        printf("%-34s %12.0f %12.3f\n", rows[i].name, rows[i].value,
               quotient(rows[i].value, m->rays));
    if (m->callbacks > 0 && m->candidates > 0 && m->evaluations > 0)
        printf("false positives: %.1f %% of callbacks, %.1f %% of candidates, %.1f %% of "
               "evaluations, %.1f %% of lanes\n",
               100 * (1 - quotient(m->macrotile_hits, m->callbacks)),
               100 * (1 - quotient(m->tile_hits, m->candidates)),
               100 * (1 - quotient(m->block_hits, m->evaluations)),
               100 * (1 - quotient(m->hits, 16 * m->evaluations)));
    else
        puts("false positives: none, no part of the model is in view");
    if (isfinite(m->sampled_hits))
        printf("hits per ray (sampled): %.1f until termination, %.1f without termination; %.0f %% "
               "of rays terminate\n",
               m->sampled_hits, m->sampled_hits_unstopped, 100 * m->sampled_stopped);
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
    printf("%.0f primitives, %.0f rays per view, %zu view%s, %s, %d thread%s\n\n", m->primitives,
           m->rays, report->views, report->views == 1 ? "" : "s", sgs_isa_name(sgs_isa_get()),
           sgs_threads_get(), sgs_threads_get() == 1 ? "" : "s");
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

static json_t *tree_json(const profile_report *report, sgs_profile_kind kind)
{
    const sgs_profile_tree *t = &report->mean.trees[kind];
    json_t *object = json_object();
    json_object_set_new(object, "name", json_string(sgs_profile_kind_name(kind)));
    json_object_set_new(object, "build_seconds", json_number(t->build));
    json_object_set_new(object, "refit_seconds",
                        kind < SGS_PROFILE_REFIT ? json_null() : json_number(t->refit));
    json_object_set_new(object, "gather_core_seconds", json_number(t->gather));
    json_object_set_new(object, "gather_with_depth_bound_core_seconds",
                        json_number(t->gather_with_depth_bound));
    json_object_set_new(object, "bytes", json_number(t->bytes));
    json_object_set_new(object, "callbacks", json_number(t->callbacks));
    json_object_set_new(object, "surface_area_cost", json_number(t->cost));
    json_object_set_new(object, "overlap", json_number(t->overlap));
    json_object_set_new(object, "refits",
                        json_integer(kind == SGS_PROFILE_AGED ? report->refits : 0));
    json_object_set_new(object, "iteration_seconds", json_number(iteration_cost(report, kind)));
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

json_t *profile_json(const profile_report *report)
{
    const sgs_profile *m = &report->mean;
    json_t *root = json_object(), *trees = json_array(), *view = json_object(),
           *rates = json_object(), *answers = json_object();
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k)
        json_array_append_new(trees, tree_json(report, (sgs_profile_kind)k));
    const struct {
        const char *name;
        double value;
    } numbers[] = {{"rays", m->rays},
                   {"callbacks", m->callbacks},
                   {"candidates", m->candidates},
                   {"block_tests", m->block_tests},
                   {"evaluations", m->evaluations},
                   {"block_hits", m->block_hits},
                   {"hits", m->hits},
                   {"hits_per_ray", quotient(m->hits, m->rays)},
                   {"sampled_hits", m->sampled_hits},
                   {"sampled_hits_unstopped", m->sampled_hits_unstopped},
                   {"sampled_stopped", m->sampled_stopped},
                   {"forward_core_seconds", m->forward},
                   {"gather_noise", m->noise},
                   {"tile_slowest_over_mean", report->tile_slowest}};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i)
        json_object_set_new(view, numbers[i].name, json_number(numbers[i].value));
    json_object_set_new(rates, "callbacks",
                        json_number(1 - quotient(m->macrotile_hits, m->callbacks)));
    json_object_set_new(rates, "candidates",
                        json_number(1 - quotient(m->tile_hits, m->candidates)));
    json_object_set_new(rates, "evaluations",
                        json_number(1 - quotient(m->block_hits, m->evaluations)));
    json_object_set_new(rates, "lanes", json_number(1 - quotient(m->hits, 16 * m->evaluations)));
    json_object_set_new(view, "false_positives", rates);
    double whole;
    const share largest = dominant(report, &whole);
    char *texts[] = {answer_quality(report), answer_rebuild(report), answer_dominant(report)};
    static const char *const keys[] = {"quality_text", "rebuild_text", "dominant_text"};
    json_object_set_new(answers, "quality_training",
                        json_string(sgs_profile_kind_name(best_for_training(report))));
    json_object_set_new(answers, "quality_drawing",
                        json_string(sgs_profile_kind_name(best_for_drawing(report))));
    json_object_set_new(answers, "rebuild_after_refits", json_number(rebuild_after(report)));
    json_object_set_new(answers, "dominant", json_string(largest.name));
    json_object_set_new(answers, "dominant_share", json_number(quotient(largest.seconds, whole)));
    for (int i = 0; i < 3; ++i) {
        json_object_set_new(answers, keys[i], json_string(texts[i]));
        free(texts[i]);
    }
    json_object_set_new(root, "primitives", json_number(m->primitives));
    json_object_set_new(root, "views", json_integer((json_int_t)report->views));
    json_object_set_new(root, "threads", json_integer(sgs_threads_get()));
    json_object_set_new(root, "isa", json_string(sgs_isa_name(sgs_isa_get())));
    json_object_set_new(root, "trees", trees);
    json_object_set_new(root, "view", view);
    json_object_set_new(root, "training_seconds", training_json(&report->training));
    json_object_set_new(root, "counters", counters_json(report));
    json_object_set_new(root, "answers", answers);
    return root;
}
