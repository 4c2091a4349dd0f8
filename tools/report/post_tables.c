// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/post_tables.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "report/bd_doubt.h"
#include "report/table_rows.h"
#include "report/time_conditions.h"
#include "sparegs/rate_distortion.h"

enum { BYTES, SECONDS, PSNR, SSIM, PERCEPTUAL, FIGURES };
static const char *const formats[FIGURES] = {"%.2f", "%.2f", "%.2f", "%.4f", "%.4f"};

static void *calloc_or_exit(size_t count, size_t size)
{
    void *memory = calloc(count + 1, size);
    if (!memory)
        exit(fail_run("out of memory"));
    return memory;
}

static double number_of(const json_t *value)
{
    return json_is_number(value) ? json_number_value(value) : NAN;
}

// What a row is about. group: a data set or a scene; NULL: all scenes.
typedef struct selection {
    const json_t *plan, *runs;
    const char *pipeline, *step, *group, *perceptual; // perceptual: "lpips" or "flip"
    bool is_data_set;
    unsigned *untimed; // bits of the conditions because of which changes of time are missing
} selection;

typedef struct figures {
    double values[FIGURES];
} figures;

static bool is_selected(const selection *chosen, const json_t *scene)
{
    return !chosen->group ||
           !strcmp(chosen->group,
                   json_member_text(scene, chosen->is_data_set ? "data_set" : "name"));
}

// The result of a step at a point, or NULL.
static const json_t *result_of(const json_t *run, const char *step, const char *point)
{
    size_t k;
    const json_t *result;
    json_array_foreach(json_object_get(run, "post"), k, result)
    {
        if (!strcmp(json_member_text(result, "step"), step) &&
            !strcmp(json_member_text(result, "point"), point))
            return result;
    }
    return NULL;
}

// Means over the seeds of a scene; NaN without a result.
static figures scene_figures(const selection *chosen, const char *scene, const char *variant,
                             const char *point)
{
    figures mean = {{0}};
    double count = 0;
    for (size_t k = 0; k < json_array_size(chosen->runs); ++k) {
        const json_t *run = json_array_get(chosen->runs, k);
        const json_t *result =
            strcmp(json_member_text(run, "scene"), scene) ||
                    strcmp(json_member_text(run, "pipeline"), chosen->pipeline) ||
                    strcmp(json_member_text(run, "variant"), variant)
                ? NULL
                : result_of(run, chosen->step, point);
        const json_t *test = json_object_get(result, "test");
        if (!result)
            continue;
        const double values[FIGURES] = {number_of(json_object_get(result, "bytes")) / 0x1p20,
                                        number_of(json_object_get(result, "seconds")),
                                        number_of(json_object_get(test, "psnr")),
                                        number_of(json_object_get(test, "ssim")),
                                        number_of(json_object_get(test, chosen->perceptual))};
        for (int f = 0; f < FIGURES; ++f)
            mean.values[f] += values[f];
        ++count;
    }
    for (int f = 0; f < FIGURES; ++f)
        mean.values[f] = count > 0 ? mean.values[f] / count : NAN;
    return mean;
}

// True if the scene has results of both variants at the point.
static bool has_results(const selection *chosen, const char *scene, const char *point)
{
    return !isnan(scene_figures(chosen, scene, "off", point).values[BYTES]) &&
           !isnan(scene_figures(chosen, scene, "on", point).values[BYTES]);
}

// The scenes of the group that have results at all points at which any of them has. Means over
// different scenes would not form a curve. Release with free().
static bool *complete_scenes(const selection *chosen, const json_t *points)
{
    const json_t *scenes = json_object_get(chosen->plan, "scenes");
    const size_t count = json_array_size(scenes);
    bool *complete = calloc_or_exit(count, sizeof *complete),
         *has = calloc_or_exit(count, sizeof *has);
    for (size_t s = 0; s < count; ++s)
        complete[s] = is_selected(chosen, json_array_get(scenes, s));
    for (size_t k = 0; k < json_array_size(points); ++k) {
        const char *point = json_string_value(json_array_get(points, k));
        bool any = false;
        for (size_t s = 0; s < count; ++s) {
            const json_t *scene = json_array_get(scenes, s);
            has[s] = is_selected(chosen, scene) &&
                     has_results(chosen, json_member_text(scene, "name"), point);
            any = any || has[s];
        }
        for (size_t s = 0; s < count && any; ++s)
            complete[s] = complete[s] && has[s];
    }
    free(has);
    return complete;
}

// Means over the scenes that count. NaN without one, or without a result.
static void group_figures(const selection *chosen, const char *point, const bool *counts,
                          figures *base, figures *ours)
{
    const json_t *scenes = json_object_get(chosen->plan, "scenes");
    double count = 0;
    *base = *ours = (figures){{0}};
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        const json_t *scene = json_array_get(scenes, s);
        if (!counts[s])
            continue;
        const figures off = scene_figures(chosen, json_member_text(scene, "name"), "off", point);
        const figures on = scene_figures(chosen, json_member_text(scene, "name"), "on", point);
        if (isnan(off.values[BYTES]) || isnan(on.values[BYTES]))
            continue;
        for (int f = 0; f < FIGURES; ++f) {
            base->values[f] += off.values[f];
            ours->values[f] += on.values[f];
        }
        ++count;
    }
    for (int f = 0; f < FIGURES; ++f) {
        base->values[f] = count > 0 ? base->values[f] / count : NAN;
        ours->values[f] = count > 0 ? ours->values[f] / count : NAN;
    }
}

static void put_labels(json_t *row, const selection *chosen, const char *point)
{
    table_put_text(row, chosen->pipeline);
    table_put_text(row, chosen->step);
    table_put_text(row, chosen->group ? chosen->group : "mean");
    table_put_text(row, point);
}

static void put_delta(json_t *row, const char *format, double value)
{
    char text[64];
    snprintf(text, sizeof text, format, value);
    table_put_text(row, isnan(value) ? "N/A" : text);
}

// Bits of the conditions that differ between the results of both variants in the scenes that count.
static unsigned untimed_of(const selection *chosen, const bool *counts)
{
    const json_t *scenes = json_object_get(chosen->plan, "scenes");
    unsigned untimed = 0;
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        time_conditions conditions = {0};
        for (size_t k = 0; k < json_array_size(chosen->runs) && counts[s]; ++k) {
            const json_t *run = json_array_get(chosen->runs, k), *result;
            const char *variant = json_member_text(run, "variant");
            size_t p;
            if (strcmp(json_member_text(run, "scene"),
                       json_member_text(json_array_get(scenes, s), "name")) ||
                strcmp(json_member_text(run, "pipeline"), chosen->pipeline) ||
                (strcmp(variant, "off") && strcmp(variant, "on")))
                continue;
            json_array_foreach(json_object_get(run, "post"), p, result)
            {
                if (!strcmp(json_member_text(result, "step"), chosen->step))
                    time_conditions_add(&conditions, result);
            }
        }
        untimed |= conditions.differing;
    }
    return untimed;
}

// Warns of changes that depend on the rounding of the points, also in the note of the table.
static void warn_unreliable(json_t *table, const selection *chosen, const sgs_bd *bd)
{
    int k = 0;
    for (char *doubt; (doubt = bd_doubt(bd, k)); ++k) {
        char *text = format_text("%s, %s, %s: %s", chosen->pipeline, chosen->step,
                                 chosen->group ? chosen->group : "mean", doubt);
        char *note = format_text("%s %s.", json_member_text(table, "note"), text);
        print_warning("%s", text);
        json_object_set_new(table, "note", json_string(note));
        free(note);
        free(text);
        free(doubt);
    }
}

// The last row of a group: changes over all points. untimed: see untimed_of.
static void put_changes(json_t *table, const selection *chosen, const figures *base,
                        const figures *ours, size_t count, unsigned untimed)
{
    sgs_rd_point *const base_curve = calloc_or_exit(2 * count, sizeof *base_curve),
                        *const our_curve = base_curve + count;
    double seconds[2] = {0, 0};
    for (size_t k = 0; k < count; ++k) {
        base_curve[k] = (sgs_rd_point){base[k].values[BYTES], base[k].values[PSNR]};
        our_curve[k] = (sgs_rd_point){ours[k].values[BYTES], ours[k].values[PSNR]};
        seconds[0] += base[k].values[SECONDS];
        seconds[1] += ours[k].values[SECONDS];
    }
    sgs_bd bd = {.rate_percent = NAN, .psnr_db = NAN};
    if (sgs_bd_compute(base_curve, count, our_curve, count, &bd))
        bd.rate_percent = bd.psnr_db = NAN; // a model without primitives
    free(base_curve);
    warn_unreliable(table, chosen, &bd);
    json_t *row = json_array();
    put_labels(row, chosen, "all");
    for (int k = 0; k < 2 * FIGURES; ++k)
        table_put_text(row, "");
    table_put_number(row, "%+.1f %%",
                     seconds[0] > 0 && !untimed ? 100 * (seconds[1] / seconds[0] - 1) : NAN);
    put_delta(row, "%+.2f %%", bd.rate_percent);
    put_delta(row, "%+.2f dB", bd.psnr_db);
    table_end_row(table, row);
}

// A row per point, and the changes. No rows if nothing is complete.
static void put_group(json_t *table, const selection *chosen, const json_t *points)
{
    const size_t most = json_array_size(points);
    figures *const base = calloc_or_exit(2 * most, sizeof *base), *const ours = base + most;
    bool *counts = complete_scenes(chosen, points);
    size_t count = 0;
    for (size_t k = 0; k < most; ++k) {
        const char *point = json_string_value(json_array_get(points, k));
        group_figures(chosen, point, counts, &base[count], &ours[count]);
        if (isnan(base[count].values[BYTES]))
            continue;
        json_t *row = json_array();
        put_labels(row, chosen, point);
        for (int f = 0; f < FIGURES; ++f)
            table_put_number(row, formats[f], base[count].values[f]);
        for (int f = 0; f < FIGURES; ++f)
            table_put_number(row, formats[f], ours[count].values[f]);
        for (int f = 0; f < 3; ++f)
            table_put_text(row, "");
        table_end_row(table, row);
        ++count;
    }
    if (count) {
        const unsigned untimed = untimed_of(chosen, counts);
        put_changes(table, chosen, base, ours, count, untimed);
        *chosen->untimed |= untimed;
    }
    free(counts);
    free(base);
}

// The data sets of the plan, or its scenes, then all scenes if there are several.
static void put_step(json_t *table, selection *chosen, const json_t *points)
{
    const json_t *scenes = json_object_get(chosen->plan, "scenes");
    const size_t count = json_array_size(scenes);
    chosen->is_data_set = *json_member_text(json_array_get(scenes, 0), "data_set");
    const char *member = chosen->is_data_set ? "data_set" : "name";
    for (size_t s = 0; s < count; ++s) {
        chosen->group = json_member_text(json_array_get(scenes, s), member);
        bool first = true;
        for (size_t before = 0; before < s; ++before)
            first = first &&
                    strcmp(chosen->group, json_member_text(json_array_get(scenes, before), member));
        if (first)
            put_group(table, chosen, points);
    }
    chosen->group = NULL;
    if (count > 1)
        put_group(table, chosen, points);
}

// {"step": ["point", ...]} of one kind, in the order of the results.
static json_t *steps_of(const json_t *runs, const char *kind)
{
    json_t *steps = json_object();
    for (size_t r = 0; r < json_array_size(runs); ++r) {
        size_t k;
        const json_t *result;
        json_array_foreach(json_object_get(json_array_get(runs, r), "post"), k, result)
        {
            const char *step = json_member_text(result, "step"),
                       *point = json_member_text(result, "point");
            if (strcmp(json_member_text(result, "kind"), kind))
                continue;
            if (!json_object_get(steps, step))
                json_object_set_new(steps, step, json_array());
            json_t *points = json_object_get(steps, step);
            bool known = false;
            for (size_t p = 0; p < json_array_size(points); ++p)
                known = known || !strcmp(json_string_value(json_array_get(points, p)), point);
            if (!known)
                json_array_append_new(points, json_string(point));
        }
    }
    return steps;
}

// LPIPS where it was computed, else FLIP.
static const char *perceptual_of(const json_t *runs)
{
    for (size_t r = 0; r < json_array_size(runs); ++r) {
        size_t k;
        const json_t *result;
        json_array_foreach(json_object_get(json_array_get(runs, r), "post"), k, result)
        {
            if (json_is_number(json_object_get(json_object_get(result, "test"), "lpips")))
                return "lpips";
        }
    }
    return "flip";
}

// Whether a variant of the scene has a result at the point that no table of pairs shows.
static bool is_single(const selection *chosen, const char *scene, const char *variant,
                      const char *point)
{
    const bool paired = !strcmp(variant, "off") || !strcmp(variant, "on");
    return !isnan(scene_figures(chosen, scene, variant, point).values[BYTES]) &&
           !(paired && has_results(chosen, scene, point));
}

static void put_single(json_t *table, const selection *chosen, const char *scene,
                       const char *variant, const char *point)
{
    const figures mean = scene_figures(chosen, scene, variant, point);
    json_t *row = json_array();
    table_put_text(row, chosen->pipeline);
    table_put_text(row, variant);
    table_put_text(row, chosen->step);
    table_put_text(row, scene);
    table_put_text(row, point);
    for (int f = 0; f < FIGURES; ++f)
        table_put_number(row, formats[f], mean.values[f]);
    table_end_row(table, row);
}

// The single results of a step, in the order of the plan.
static void put_singles(json_t *table, selection *chosen, const json_t *points)
{
    size_t v, s, k;
    const json_t *variant, *scene, *point;
    json_array_foreach(json_object_get(chosen->plan, "variants"), v, variant)
    {
        const char *name = json_member_text(variant, "name");
        json_array_foreach(json_object_get(chosen->plan, "scenes"), s, scene)
        {
            const char *of = json_member_text(scene, "name");
            json_array_foreach(points, k, point)
            {
                if (is_single(chosen, of, name, json_string_value(point)))
                    put_single(table, chosen, of, name, json_string_value(point));
            }
        }
    }
}

// put(table, selection, points) for every pipeline and every step of a kind. Returns the bits of
// the conditions because of which changes of time are missing.
static unsigned for_each_step(const json_t *results, const char *kind, json_t *table,
                              void (*put)(json_t *, selection *, const json_t *))
{
    const json_t *plan = json_object_get(results, "plan"), *runs = json_object_get(results, "runs");
    json_t *steps = steps_of(runs, kind);
    const json_t *pipelines = json_object_get(plan, "pipelines");
    unsigned untimed = 0;
    for (size_t p = 0; p < json_array_size(pipelines); ++p) {
        const char *step;
        json_t *points;
        json_object_foreach(steps, step, points)
        {
            selection chosen = {.plan = plan,
                                .runs = runs,
                                .pipeline = json_string_value(json_array_get(pipelines, p)),
                                .step = step,
                                .perceptual = perceptual_of(runs),
                                .untimed = &untimed};
            put(table, &chosen, points);
        }
    }
    json_decref(steps);
    return untimed;
}

static json_t *kind_table(const json_t *results, const char *kind, const char *title)
{
    const bool lpips = !strcmp(perceptual_of(json_object_get(results, "runs")), "lpips");
    const char *const columns[] = {"pipeline",
                                   "step",
                                   "scenes",
                                   "point",
                                   "base MiB",
                                   "base s",
                                   "base PSNR",
                                   "base SSIM",
                                   lpips ? "base LPIPS" : "base FLIP",
                                   "ours MiB",
                                   "ours s",
                                   "ours PSNR",
                                   "ours SSIM",
                                   lpips ? "ours LPIPS" : "ours FLIP",
                                   "Δ time",
                                   "BD-rate",
                                   "BD-PSNR",
                                   NULL};
    json_t *table = table_new(
        title,
        "Base: models of variant off; ours: variant on. Size in MiB (2^20 bytes), seconds of the "
        "step, quality of the held-out images; means over seeds, then over the scenes that have "
        "results at all points. Δ time: change of the sum over the points. BD-rate: change in size "
        "at equal PSNR; BD-PSNR: change in PSNR "
        "at equal size; N/A without a common range, or if a smaller file of a curve is better.",
        columns);
    time_conditions_add_note(table, for_each_step(results, kind, table, put_step));
    return table;
}

static json_t *single_table(const json_t *results, const char *const kinds[], size_t count)
{
    const bool lpips = !strcmp(perceptual_of(json_object_get(results, "runs")), "lpips");
    const char *const columns[] = {"pipeline", "variant", "step", "scene", "point",
                                   "MiB",      "s",       "PSNR", "SSIM",  lpips ? "LPIPS" : "FLIP",
                                   NULL};
    json_t *table =
        table_new("Pruning and compression of single variants",
                  "Results of variants other than off and on, and of one of them where the other "
                  "has none. Size in MiB (2^20 bytes), seconds of the step, quality of the "
                  "held-out images; means over seeds.",
                  columns);
    for (size_t k = 0; k < count; ++k)
        for_each_step(results, kinds[k], table, put_singles);
    return table;
}

// Appends a table that has rows. Steals the reference to `table`.
static void add_table(json_t *tables, json_t *table)
{
    if (json_array_size(json_object_get(table, "rows")))
        json_array_append(tables, table);
    json_decref(table);
}

void post_tables_add(const json_t *results, json_t *tables)
{
    static const char *const kinds[] = {"prune", "compress"};
    add_table(tables, kind_table(results, "prune", "Pruning of models without and with SPARE-GS"));
    add_table(tables,
              kind_table(results, "compress", "Compression of models without and with SPARE-GS"));
    add_table(tables, single_table(results, kinds, sizeof kinds / sizeof *kinds));
}
