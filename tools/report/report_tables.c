// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Tables as in the SPARE-GS paper: base pipelines without ("off") and with ("on") SPARE-GS and the
// change; all variants of a pipeline; seconds per phase; runs that ended early. A cell is a mean
// over seeds, with their standard deviation if there are several, a change over scenes the mean of
// the scenes' changes, the last row of the first table a mean over pipelines. With data sets in the
// plan, averages are those of Table I: changes of the means of a data set, weighted by its scenes.

#include "report/report_tables.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "report/post_tables.h"
#include "report/table_rows.h"
#include "report/time_conditions.h"

// A metric such as "train_seconds" or "test.psnr".
static double metric_of(const json_t *run, const char *metric)
{
    const json_t *at = json_object_get(run, "summary");
    char name[64];
    while (*metric) {
        const size_t length = strcspn(metric, ".");
        snprintf(name, sizeof name, "%.*s", (int)length, metric);
        at = json_object_get(at, name);
        metric += length + (metric[length] == '.');
    }
    return json_is_number(at) ? json_number_value(at) : NAN;
}

// True if a run is one of a scene (of any if `scene` is NULL), a pipeline and a variant.
static bool is_run(const json_t *run, const char *scene, const char *pipeline, const char *variant)
{
    return (!scene || !strcmp(scene, json_member_text(run, "scene"))) &&
           !strcmp(pipeline, json_member_text(run, "pipeline")) &&
           !strcmp(variant, json_member_text(run, "variant"));
}

// The metric of such a run. NaN for other runs.
static double value_of(const json_t *run, const char *scene, const char *pipeline,
                       const char *variant, const char *metric)
{
    return is_run(run, scene, pipeline, variant) ? metric_of(run, metric) : NAN;
}

// Mean over the runs with this seed (NULL: any), over scenes if `scene` is NULL, and their number.
// NaN if there is no such run.
static double mean_of_seed(const json_t *runs, const json_t *seed, const char *scene,
                           const char *pipeline, const char *variant, const char *metric,
                           int *count)
{
    double sum = 0;
    *count = 0;
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        const json_t *run = json_array_get(runs, k);
        const double value = value_of(run, scene, pipeline, variant, metric);
        if (isnan(value) || (seed && !json_equal(seed, json_object_get(run, "seed"))))
            continue;
        sum += value;
        ++*count;
    }
    return *count ? sum / *count : NAN;
}

static double mean(const json_t *runs, const char *scene, const char *pipeline, const char *variant,
                   const char *metric)
{
    int count;
    return mean_of_seed(runs, NULL, scene, pipeline, variant, metric, &count);
}

// Standard deviation (n - 1) over the n seeds of their means, and n. NaN with one seed, or if the
// seeds have different numbers of scenes.
static double deviation(const json_t *plan, const json_t *runs, const char *scene,
                        const char *pipeline, const char *variant, const char *metric, int *seeds)
{
    const json_t *list = json_object_get(plan, "seeds");
    double center = 0, squares = 0;
    int scenes = 0;
    bool equal = true;
    *seeds = 0;
    for (size_t k = 0; k < json_array_size(list); ++k) {
        int number;
        const double value =
            mean_of_seed(runs, json_array_get(list, k), scene, pipeline, variant, metric, &number);
        if (!number)
            continue;
        equal = equal && (!scenes || number == scenes);
        scenes = number;
        const double difference = value - center;
        center += difference / ++*seeds;
        squares += difference * (value - center);
    }
    return *seeds > 1 && equal ? sqrt(squares / (*seeds - 1)) : NAN;
}

static bool has_seeds(const json_t *plan)
{
    return json_array_size(json_object_get(plan, "seeds")) > 1;
}

#define SEEDS_NOTE " ±: standard deviation over the seeds (n - 1)."

static double percent(double base, double ours)
{
    return 100.0 * (ours / base - 1.0);
}

// ---- Off and on ----

enum { METRICS = 7 }; // the last one, LPIPS, only where a run has it
static const char *const metrics[METRICS] = {"train_seconds", "gaussians", "test.psnr",
                                             "test.ssim",     "test.flip", "test.sharpness",
                                             "test.lpips"};
static const char *const formats[METRICS] = {"%.1f", "%.0f", "%.2f", "%.4f",
                                             "%.4f", "%.3f", "%.4f"};
static const char *const change_formats[METRICS] = {"%+.1f %%", "%+.1f %%", "%+.2f", "%+.4f",
                                                    "%+.4f",    "%+.3f",    "%+.4f"};

// Number of metrics in the tables.
static int shown_metrics(const json_t *runs)
{
    for (size_t k = 0; k < json_array_size(runs); ++k)
        if (!isnan(metric_of(json_array_get(runs, k), metrics[METRICS - 1])))
            return METRICS;
    return METRICS - 1;
}

static double change(int metric, double base, double ours)
{
    return metric < 2 ? percent(base, ours) : ours - base;
}

// `seeds`: the table has a column of them.
static void put_changes(json_t *table, const char *pipeline, const char *label, bool seeds,
                        int shown, const double changes[METRICS])
{
    json_t *row = json_array();
    table_put_text(row, pipeline);
    table_put_text(row, label);
    for (int k = 0; k < 2 * shown + seeds; ++k)
        table_put_text(row, "");
    for (int k = 0; k < shown; ++k)
        table_put_number(row, change_formats[k], changes[k]);
    table_end_row(table, row);
}

// The variants that a table compares.
typedef struct comparison {
    const json_t *plan, *runs;
    const char *pipeline, *base, *ours;
} comparison;

// The values of both variants, of one scene or means over scenes. Deviations and numbers of seeds
// are those of a scene. untimed: bits of the conditions because of which the times cannot be
// compared.
typedef struct pair {
    double base[METRICS], ours[METRICS], base_deviation[METRICS], our_deviation[METRICS];
    int base_seeds, our_seeds;
    unsigned untimed;
} pair;

// Without deviations.
static pair pair_of(const comparison *compared, const char *scene)
{
    pair values = {0};
    time_conditions conditions = {0};
    for (int k = 0; k < METRICS; ++k) {
        values.base[k] =
            mean(compared->runs, scene, compared->pipeline, compared->base, metrics[k]);
        values.ours[k] =
            mean(compared->runs, scene, compared->pipeline, compared->ours, metrics[k]);
        values.base_deviation[k] = values.our_deviation[k] = NAN;
    }
    for (size_t k = 0; k < json_array_size(compared->runs); ++k) {
        const json_t *run = json_array_get(compared->runs, k);
        if (is_run(run, scene, compared->pipeline, compared->base) ||
            is_run(run, scene, compared->pipeline, compared->ours))
            time_conditions_add_run(&conditions, run);
    }
    values.untimed = conditions.differing;
    return values;
}

static void add_deviations(const comparison *compared, const char *scene, pair *values)
{
    for (int k = METRICS - 1; k >= 0; --k) { // the seeds are those of the first metric
        values->base_deviation[k] =
            deviation(compared->plan, compared->runs, scene, compared->pipeline, compared->base,
                      metrics[k], &values->base_seeds);
        values->our_deviation[k] =
            deviation(compared->plan, compared->runs, scene, compared->pipeline, compared->ours,
                      metrics[k], &values->our_seeds);
    }
}

// True if the scene has runs of both variants.
static bool is_whole(const pair *values)
{
    return !isnan(values->base[1]) && !isnan(values->ours[1]);
}

static void changes_of(const pair *values, double changes[METRICS])
{
    for (int k = 0; k < METRICS; ++k)
        changes[k] = change(k, values->base[k], values->ours[k]);
    if (values->untimed)
        changes[0] = NAN;
}

// The number of seeds, two numbers if they differ, or nothing in a row over scenes.
static void put_seeds(json_t *row, int base, int ours)
{
    char text[32] = "";
    if (base == ours && base > 0)
        snprintf(text, sizeof text, "%d", base);
    else if (base != ours)
        snprintf(text, sizeof text, "%d, %d", base, ours);
    table_put_text(row, text);
}

static void put_pair(json_t *table, const char *pipeline, const char *label, bool seeds, int shown,
                     const pair *values)
{
    json_t *row = json_array();
    table_put_text(row, pipeline);
    table_put_text(row, label);
    if (seeds)
        put_seeds(row, values->base_seeds, values->our_seeds);
    for (int k = 0; k < shown; ++k)
        table_put_spread(row, formats[k], values->base[k], values->base_deviation[k]);
    for (int k = 0; k < shown; ++k)
        table_put_spread(row, formats[k], values->ours[k], values->our_deviation[k]);
    double changes[METRICS];
    changes_of(values, changes);
    for (int k = 0; k < shown; ++k)
        table_put_number(row, change_formats[k], changes[k]);
    table_end_row(table, row);
}

// Sums of changes, each with its weight. untimed: see pair.
typedef struct change_mean {
    double sums[METRICS], weight;
    unsigned untimed;
} change_mean;

static void add_change(change_mean *to, const double changes[METRICS], double weight)
{
    for (int k = 0; k < METRICS; ++k)
        to->sums[k] += weight * changes[k];
    to->weight += weight;
}

static void finish_changes(const change_mean *from, double changes[METRICS])
{
    for (int k = 0; k < METRICS; ++k)
        changes[k] = from->weight > 0 ? from->sums[k] / from->weight : NAN;
}

// Means over the scenes of a data set (all scenes if it is NULL) that have runs of both variants.
// Adds the change of the data set to `total`, weighted by its scenes, or that of each scene. False
// without such a scene.
static bool add_scenes(const comparison *compared, const char *data_set, pair *means,
                       change_mean *total)
{
    const json_t *scenes = json_object_get(compared->plan, "scenes");
    double count = 0, changes[METRICS];
    *means = (pair){0};
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        const json_t *scene = json_array_get(scenes, s);
        if (data_set && strcmp(data_set, json_member_text(scene, "data_set")))
            continue;
        const pair values = pair_of(compared, json_member_text(scene, "name"));
        if (!is_whole(&values))
            continue;
        for (int k = 0; k < METRICS; ++k) {
            means->base[k] += values.base[k];
            means->ours[k] += values.ours[k];
        }
        means->untimed |= values.untimed;
        ++count;
        changes_of(&values, changes);
        if (!data_set)
            add_change(total, changes, 1.0);
    }
    for (int k = 0; k < METRICS; ++k) {
        means->base[k] /= count;
        means->ours[k] /= count;
        means->base_deviation[k] = means->our_deviation[k] = NAN;
    }
    changes_of(means, changes);
    if (data_set && count > 0)
        add_change(total, changes, count);
    total->untimed |= means->untimed;
    return count > 0;
}

static bool is_first_of_data_set(const json_t *scenes, size_t s)
{
    for (size_t k = 0; k < s; ++k)
        if (!strcmp(json_member_text(json_array_get(scenes, k), "data_set"),
                    json_member_text(json_array_get(scenes, s), "data_set")))
            return false;
    return true;
}

static bool in_data_sets(const json_t *plan)
{
    const json_t *scenes = json_object_get(plan, "scenes");
    return *json_member_text(json_array_get(scenes, 0), "data_set");
}

// A row per scene of a data set (all scenes if `data_set` is NULL), and for a data set a row with
// the means of its scenes. Adds to `total` as add_scenes does.
static void put_scenes(json_t *table, const comparison *compared, const char *data_set,
                       change_mean *total)
{
    const json_t *scenes = json_object_get(compared->plan, "scenes");
    const int shown = shown_metrics(compared->runs);
    const bool seeds = has_seeds(compared->plan);
    pair means;
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        const json_t *scene = json_array_get(scenes, s);
        const char *name = json_member_text(scene, "name");
        if (data_set && strcmp(data_set, json_member_text(scene, "data_set")))
            continue;
        pair values = pair_of(compared, name);
        add_deviations(compared, name, &values);
        put_pair(table, compared->pipeline, name, seeds, shown, &values);
    }
    if (add_scenes(compared, data_set, &means, total) && data_set)
        put_pair(table, compared->pipeline, data_set, seeds, shown, &means);
}

// Names of the metrics in both states, and of their changes.
static const char *const base_names[METRICS] = {
    "base s", "base N", "base PSNR", "base SSIM", "base FLIP", "base sharpness", "base LPIPS"};
static const char *const our_names[METRICS] = {
    "ours s", "ours N", "ours PSNR", "ours SSIM", "ours FLIP", "ours sharpness", "ours LPIPS"};
static const char *const change_names[METRICS] = {"Δ time", "Δ N",         "Δ PSNR", "Δ SSIM",
                                                  "Δ FLIP", "Δ sharpness", "Δ LPIPS"};

// A table with `shown` metrics and no rows.
static json_t *new_pipelines_table(bool in_sets, bool seeds, int shown)
{
    const char *columns[3 * METRICS + 4] = {"pipeline", "scene"};
    const char *const *const groups[] = {base_names, our_names, change_names};
    size_t count = 2;
    if (seeds)
        columns[count++] = "seeds";
    for (size_t g = 0; g < sizeof groups / sizeof *groups; ++g)
        for (int k = 0; k < shown; ++k)
            columns[count++] = groups[g][k];
    char *note = format_text(
        "Base: variant off; ours: variant on. PSNR (dB), SSIM, %s of the held-out images. Better: "
        "higher PSNR and SSIM, lower %s, sharpness near 1.%s%s",
        shown == METRICS ? "FLIP, sharpness and LPIPS" : "FLIP and sharpness",
        shown == METRICS ? "FLIP and LPIPS" : "FLIP", seeds ? SEEDS_NOTE : "",
        in_sets ? " A data set has the means of its scenes and the changes of these means. The "
                  "mean of a pipeline weights the data sets by their number of scenes."
                : "");
    json_t *table = table_new("Base pipelines without and with SPARE-GS", note, columns);
    free(note);
    return table;
}

static json_t *pipelines_table(const json_t *results)
{
    const json_t *plan = json_object_get(results, "plan"),
                 *pipelines = json_object_get(plan, "pipelines"),
                 *scenes = json_object_get(plan, "scenes");
    const bool in_sets = in_data_sets(plan), seeds = has_seeds(plan);
    const int shown = shown_metrics(json_object_get(results, "runs"));
    json_t *table = new_pipelines_table(in_sets, seeds, shown);
    change_mean all = {0};
    double changes[METRICS];
    for (size_t p = 0; p < json_array_size(pipelines); ++p) {
        const char *pipeline = json_string_value(json_array_get(pipelines, p));
        const comparison compared = {plan, json_object_get(results, "runs"), pipeline, "off", "on"};
        change_mean total = {0};
        for (size_t s = 0; in_sets && s < json_array_size(scenes); ++s)
            if (is_first_of_data_set(scenes, s))
                put_scenes(table, &compared,
                           json_member_text(json_array_get(scenes, s), "data_set"), &total);
        if (!in_sets)
            put_scenes(table, &compared, NULL, &total);
        all.untimed |= total.untimed;
        finish_changes(&total, changes);
        put_changes(table, pipeline, in_sets ? "scene-weighted mean" : "mean", seeds, shown,
                    changes);
        if (total.weight > 0)
            add_change(&all, changes, 1.0);
    }
    finish_changes(&all, changes);
    put_changes(table, "average", "", seeds, shown, changes);
    time_conditions_add_note(table, all.untimed);
    return table;
}

// ---- All variants of a pipeline ----

// The changes between two variants as in the row of means of the first table. Adds the conditions
// that prevent a change of time to *untimed.
static void mean_changes(const comparison *compared, double changes[METRICS], unsigned *untimed)
{
    const json_t *scenes = json_object_get(compared->plan, "scenes");
    const bool in_sets = in_data_sets(compared->plan);
    change_mean total = {0};
    pair means;
    for (size_t s = 0; in_sets && s < json_array_size(scenes); ++s)
        if (is_first_of_data_set(scenes, s))
            add_scenes(compared, json_member_text(json_array_get(scenes, s), "data_set"), &means,
                       &total);
    if (!in_sets)
        add_scenes(compared, NULL, &means, &total);
    finish_changes(&total, changes);
    *untimed |= total.untimed;
}

// The row of a variant, if it has runs. Adds to *untimed as mean_changes does.
static void put_variant(json_t *table, const comparison *compared, unsigned *untimed)
{
    const json_t *runs = compared->runs;
    const char *pipeline = compared->pipeline, *variant = compared->ours;
    const int shown = shown_metrics(runs);
    double value[METRICS], spread[METRICS], change_of[METRICS];
    int count = 0;
    for (int k = METRICS - 1; k >= 0; --k) { // the seeds are those of the first metric
        value[k] = mean(runs, NULL, pipeline, variant, metrics[k]);
        spread[k] = deviation(compared->plan, runs, NULL, pipeline, variant, metrics[k], &count);
    }
    if (isnan(value[1]))
        return;
    json_t *row = json_array();
    table_put_text(row, variant);
    if (has_seeds(compared->plan))
        put_seeds(row, count, count);
    table_put_spread(row, formats[1], value[1], spread[1]);
    table_put_spread(row, formats[0], value[0], spread[0]);
    table_put_number(row, "%.0f", mean(runs, NULL, pipeline, variant, "iterations"));
    for (int k = 2; k < shown; ++k)
        table_put_spread(row, formats[k], value[k], spread[k]);
    mean_changes(compared, change_of, untimed);
    static const int changes[] = {1, 0, 2, 4, 5, 6}; // the last one: LPIPS
    for (size_t k = 0; k < sizeof changes / sizeof *changes && changes[k] < shown; ++k)
        table_put_number(row, change_formats[changes[k]], change_of[changes[k]]);
    table_end_row(table, row);
}

static json_t *variants_table(const json_t *plan, const json_t *runs, const char *pipeline)
{
    static const char *const all_columns[] = {
        "variant",   "seeds", "N",   "s",      "iterations", "PSNR",   "SSIM",        "FLIP",
        "sharpness", "LPIPS", "Δ N", "Δ time", "Δ PSNR",     "Δ FLIP", "Δ sharpness", "Δ LPIPS"};
    enum { COLUMNS = sizeof all_columns / sizeof *all_columns };
    const int shown = shown_metrics(runs);
    const bool seeds = has_seeds(plan);
    const char *columns[COLUMNS + 1] = {NULL};
    for (size_t k = 0, count = 0; k < COLUMNS; ++k)
        if ((shown == METRICS || !strstr(all_columns[k], "LPIPS")) &&
            (seeds || strcmp(all_columns[k], "seeds")))
            columns[count++] = all_columns[k];
    char *title = format_text("Variants of %s", pipeline),
         *note = format_text("Means over scenes and seeds. Changes relative to variant off, over "
                             "the scenes that have runs of both: means of the changes of %s.%s",
                             in_data_sets(plan) ? "the data sets, weighted by their number of "
                                                  "scenes"
                                                : "the scenes",
                             seeds ? " ±: standard deviation (n - 1) over the seeds' means." : "");
    json_t *table = table_new(title, note, columns);
    free(title);
    free(note);
    const json_t *variants = json_object_get(plan, "variants");
    unsigned untimed = 0;
    for (size_t v = 0; v < json_array_size(variants); ++v) {
        const char *variant = json_member_text(json_array_get(variants, v), "name");
        put_variant(table, &(comparison){plan, runs, pipeline, "off", variant}, &untimed);
    }
    time_conditions_add_note(table, untimed);
    return table;
}

// ---- Seconds ----

static json_t *seconds_table(const json_t *plan, const json_t *runs)
{
    static const char *const phases[] = {"gather",    "forward",   "loss",
                                         "backward",  "optimizer", "bvh_refit",
                                         "bvh_build", "density",   "spare"};
    enum { UPDATE_PHASES = 6 }; // index of the first phase of a structural update
    static const char *const columns[] = {
        "pipeline", "variant",   "gather",         "forward",        "loss",
        "backward", "optimizer", "BVH refit",      "BVH build",      "density",
        "SPARE-GS", "total",     "SPARE-GS share", "of the updates", NULL};
    json_t *table =
        table_new("Seconds by phase",
                  "Means over scenes and seeds. SPARE-GS's share of the total, and of the "
                  "structural updates (density, SPARE-GS and BVH build).",
                  columns);
    const json_t *pipelines = json_object_get(plan, "pipelines");
    const json_t *variants = json_object_get(plan, "variants");
    for (size_t p = 0; p < json_array_size(pipelines); ++p)
        for (size_t v = 0; v < json_array_size(variants); ++v) {
            const char *pipeline = json_string_value(json_array_get(pipelines, p)),
                       *variant = json_member_text(json_array_get(variants, v), "name");
            const double total = mean(runs, NULL, pipeline, variant, "train_seconds");
            if (isnan(total))
                continue;
            json_t *row = json_array();
            table_put_text(row, pipeline);
            table_put_text(row, variant);
            double spare = 0, updates = 0;
            for (size_t k = 0; k < sizeof phases / sizeof *phases; ++k) {
                char metric[64];
                snprintf(metric, sizeof metric, "seconds.%s", phases[k]);
                spare = mean(runs, NULL, pipeline, variant, metric);
                table_put_number(row, "%.2f", spare);
                updates += k >= UPDATE_PHASES ? spare : 0.0;
            }
            table_put_number(row, "%.2f", total);
            table_put_number(row, "%.3f %%", 100.0 * spare / total);
            table_put_number(row, "%.2f %%", updates > 0 ? 100.0 * spare / updates : NAN);
            table_end_row(table, row);
        }
    return table;
}

static json_t *stops_table(const json_t *runs)
{
    static const char *const columns[] = {"scene", "pipeline",    "variant",
                                          "seed",  "stop reason", NULL};
    json_t *table = table_new(
        "Early stops", "Runs that stopped in equilibrium before the end of the schedule.", columns);
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        const json_t *run = json_array_get(runs, k), *summary = json_object_get(run, "summary");
        if (strcmp(json_member_text(summary, "stop_reason"), "equilibrium"))
            continue;
        json_t *row = json_array();
        table_put_text(row, json_member_text(run, "scene"));
        table_put_text(row, json_member_text(run, "pipeline"));
        table_put_text(row, json_member_text(run, "variant"));
        table_put_number(row, "%.0f", json_number_value(json_object_get(run, "seed")));
        table_put_text(row, json_member_text(summary, "stop_text"));
        table_end_row(table, row);
    }
    return table;
}

static bool has_variant(const json_t *plan, const char *name)
{
    const json_t *variants = json_object_get(plan, "variants");
    for (size_t v = 0; v < json_array_size(variants); ++v)
        if (!strcmp(json_member_text(json_array_get(variants, v), "name"), name))
            return true;
    return false;
}

// True if a table of variants has a row that is not in the table of pipelines.
static bool has_other_rows(const json_t *table, bool has_pairs)
{
    const json_t *rows = json_object_get(table, "rows");
    for (size_t r = 0; r < json_array_size(rows); ++r) {
        const char *name = json_string_value(json_array_get(json_array_get(rows, r), 0));
        if (!has_pairs || (strcmp(name, "off") && strcmp(name, "on")))
            return true;
    }
    return false;
}

json_t *report_tables(const json_t *results)
{
    const json_t *plan = json_object_get(results, "plan"), *runs = json_object_get(results, "runs");
    const json_t *pipelines = json_object_get(plan, "pipelines");
    json_t *tables = json_array();
    const bool has_pairs = has_variant(plan, "off") && has_variant(plan, "on");
    if (has_pairs)
        json_array_append_new(tables, pipelines_table(results));
    for (size_t p = 0; p < json_array_size(pipelines); ++p) {
        json_t *table = variants_table(plan, runs, json_string_value(json_array_get(pipelines, p)));
        if (has_other_rows(table, has_pairs))
            json_array_append(tables, table);
        json_decref(table);
    }
    post_tables_add(results, tables);
    json_array_append_new(tables, seconds_table(plan, runs));
    json_array_append_new(tables, stops_table(runs));
    return tables;
}

// ---- Markdown ----

static char *append_row(char *text, const json_t *cells)
{
    for (size_t k = 0; k < json_array_size(cells); ++k) {
        char *longer = format_text("%s| %s ", text, json_string_value(json_array_get(cells, k)));
        free(text);
        text = longer;
    }
    char *ended = format_text("%s|\n", text);
    free(text);
    return ended;
}

char *report_markdown(const json_t *results, const json_t *tables)
{
    const char *title = json_member_text(json_object_get(results, "plan"), "title");
    char *text = format_text("# %s\n\n%zu completed runs.\n", *title ? title : "Experiment",
                             json_array_size(json_object_get(results, "runs")));
    for (size_t t = 0; t < json_array_size(tables); ++t) {
        const json_t *table = json_array_get(tables, t),
                     *columns = json_object_get(table, "columns"),
                     *rows = json_object_get(table, "rows");
        if (!json_array_size(rows))
            continue;
        char *longer = format_text("%s\n## %s\n\n%s\n\n", text, json_member_text(table, "title"),
                                   json_member_text(table, "note"));
        free(text);
        text = append_row(longer, columns);
        json_t *rule = json_array();
        for (size_t k = 0; k < json_array_size(columns); ++k)
            table_put_text(rule, "---");
        text = append_row(text, rule);
        json_decref(rule);
        for (size_t r = 0; r < json_array_size(rows); ++r)
            text = append_row(text, json_array_get(rows, r));
    }
    return text;
}
