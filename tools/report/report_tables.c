// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Tables as in the SPARE-GS paper: base pipelines without ("off") and with ("on") SPARE-GS and the
// change; all variants of a pipeline; seconds per phase; runs that ended early. A cell is a mean
// over seeds, a row over scenes the mean of the scenes' percentages, the last row a mean over
// pipelines.

#include "report/report_tables.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"

static const char *text_of(const json_t *object, const char *member)
{
    const char *text = json_string_value(json_object_get(object, member));
    return text ? text : "";
}

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

// Mean over seeds, and over scenes if `scene` is NULL. NaN if there is no such run.
static double mean(const json_t *runs, const char *scene, const char *pipeline, const char *variant,
                   const char *metric)
{
    double sum = 0, count = 0;
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        const json_t *run = json_array_get(runs, k);
        const double value = metric_of(run, metric);
        if ((scene && strcmp(scene, text_of(run, "scene"))) ||
            strcmp(pipeline, text_of(run, "pipeline")) ||
            strcmp(variant, text_of(run, "variant")) || isnan(value))
            continue;
        sum += value;
        ++count;
    }
    return count > 0 ? sum / count : NAN;
}

static json_t *new_table(const char *title, const char *note, const char *const columns[])
{
    json_t *list = json_array();
    for (size_t k = 0; columns[k]; ++k)
        json_array_append_new(list, json_string(columns[k]));
    return json_pack("{s:s,s:s,s:o,s:[]}", "title", title, "note", note, "columns", list, "rows");
}

static void put_text(json_t *row, const char *text)
{
    json_array_append_new(row, json_string(text));
}

static void put_number(json_t *row, const char *format, double value)
{
    char text[64];
    snprintf(text, sizeof text, format, value);
    put_text(row, isnan(value) ? "-" : text);
}

static void end_row(json_t *table, json_t *row)
{
    json_array_append_new(json_object_get(table, "rows"), row);
}

static double percent(double base, double ours)
{
    return 100.0 * (ours / base - 1.0);
}

// ---- Off and on ----

enum { METRICS = 6 };
static const char *const metrics[METRICS] = {"train_seconds", "gaussians", "test.psnr",
                                             "test.ssim",     "test.flip", "test.sharpness"};
static const char *const formats[METRICS] = {"%.1f", "%.0f", "%.2f", "%.4f", "%.4f", "%.3f"};
static const char *const change_formats[METRICS] = {"%+.1f %%", "%+.1f %%", "%+.2f",
                                                    "%+.4f",    "%+.4f",    "%+.3f"};

static double change(int metric, double base, double ours)
{
    return metric < 2 ? percent(base, ours) : ours - base;
}

static void put_changes(json_t *table, const char *pipeline, const char *scene,
                        const double sums[METRICS], double count)
{
    json_t *row = json_array();
    put_text(row, pipeline);
    put_text(row, scene);
    for (int k = 0; k < METRICS; ++k)
        put_text(row, "");
    for (int k = 0; k < METRICS; ++k)
        put_text(row, "");
    for (int k = 0; k < METRICS; ++k)
        put_number(row, change_formats[k], count > 0 ? sums[k] / count : NAN);
    end_row(table, row);
}

static bool put_scene(json_t *table, const json_t *runs, const char *pipeline, const char *scene,
                      double sums[METRICS])
{
    json_t *row = json_array();
    double base[METRICS], ours[METRICS];
    put_text(row, pipeline);
    put_text(row, scene);
    bool complete = true;
    for (int k = 0; k < METRICS; ++k) {
        base[k] = mean(runs, scene, pipeline, "off", metrics[k]);
        ours[k] = mean(runs, scene, pipeline, "on", metrics[k]);
        complete = complete && (k >= 2 || (!isnan(base[k]) && !isnan(ours[k])));
    }
    for (int k = 0; k < METRICS; ++k)
        put_number(row, formats[k], base[k]);
    for (int k = 0; k < METRICS; ++k)
        put_number(row, formats[k], ours[k]);
    for (int k = 0; k < METRICS; ++k) {
        put_number(row, change_formats[k], change(k, base[k], ours[k]));
        sums[k] += complete ? change(k, base[k], ours[k]) : 0.0;
    }
    end_row(table, row);
    return complete;
}

static json_t *pipelines_table(const json_t *plan, const json_t *runs)
{
    static const char *const columns[] = {
        "pipeline",  "scene",          "base s", "base N", "base PSNR", "base SSIM",
        "base FLIP", "base sharpness", "ours s", "ours N", "ours PSNR", "ours SSIM",
        "ours FLIP", "ours sharpness", "Δ time", "Δ N",    "Δ PSNR",    "Δ SSIM",
        "Δ FLIP",    "Δ sharpness",    NULL};
    json_t *table =
        new_table("Base pipelines without and with SPARE-GS",
                  "Base: variant off; ours: variant on. PSNR (dB), SSIM, FLIP and sharpness of the "
                  "held-out images. Better: higher PSNR and SSIM, lower FLIP, sharpness near 1.",
                  columns);
    const json_t *pipelines = json_object_get(plan, "pipelines"),
                 *scenes = json_object_get(plan, "scenes");
    double all[METRICS] = {0}, counted = 0;
    for (size_t p = 0; p < json_array_size(pipelines); ++p) {
        const char *pipeline = json_string_value(json_array_get(pipelines, p));
        double sums[METRICS] = {0}, count = 0;
        for (size_t s = 0; s < json_array_size(scenes); ++s)
            count +=
                put_scene(table, runs, pipeline, text_of(json_array_get(scenes, s), "name"), sums);
        put_changes(table, pipeline, "mean", sums, count);
        for (int k = 0; k < METRICS && count > 0; ++k)
            all[k] += sums[k] / count;
        counted += count > 0;
    }
    put_changes(table, "average", "", all, counted);
    return table;
}

// ---- All variants of a pipeline ----

static json_t *variants_table(const json_t *plan, const json_t *runs, const char *pipeline)
{
    static const char *const columns[] = {
        "variant",   "N",   "s",      "iterations", "PSNR",   "SSIM",        "FLIP",
        "sharpness", "Δ N", "Δ time", "Δ PSNR",     "Δ FLIP", "Δ sharpness", NULL};
    char *title = format_text("Variants of %s", pipeline);
    json_t *table =
        new_table(title, "Means over scenes and seeds; changes relative to variant off.", columns);
    free(title);
    const json_t *variants = json_object_get(plan, "variants");
    double base[METRICS];
    for (int k = 0; k < METRICS; ++k)
        base[k] = mean(runs, NULL, pipeline, "off", metrics[k]);
    for (size_t v = 0; v < json_array_size(variants); ++v) {
        const char *variant = text_of(json_array_get(variants, v), "name");
        double value[METRICS];
        for (int k = 0; k < METRICS; ++k)
            value[k] = mean(runs, NULL, pipeline, variant, metrics[k]);
        if (isnan(value[1]))
            continue;
        json_t *row = json_array();
        put_text(row, variant);
        put_number(row, formats[1], value[1]);
        put_number(row, formats[0], value[0]);
        put_number(row, "%.0f", mean(runs, NULL, pipeline, variant, "iterations"));
        for (int k = 2; k < METRICS; ++k)
            put_number(row, formats[k], value[k]);
        static const int changes[] = {1, 0, 2, 4, 5};
        for (size_t k = 0; k < sizeof changes / sizeof *changes; ++k)
            put_number(row, change_formats[changes[k]],
                       change(changes[k], base[changes[k]], value[changes[k]]));
        end_row(table, row);
    }
    return table;
}

// ---- Seconds ----

static json_t *seconds_table(const json_t *plan, const json_t *runs)
{
    static const char *const phases[] = {"gather",    "forward",   "loss",
                                         "backward",  "optimizer", "bvh_refit",
                                         "bvh_build", "density",   "spare"};
    static const char *const columns[] = {
        "pipeline",  "variant",   "gather",  "forward",  "loss",  "backward",       "optimizer",
        "BVH refit", "BVH build", "density", "SPARE-GS", "total", "SPARE-GS share", NULL};
    json_t *table = new_table("Seconds by phase", "Means over scenes and seeds.", columns);
    const json_t *pipelines = json_object_get(plan, "pipelines");
    static const char *const variants[] = {"off", "on"};
    for (size_t p = 0; p < json_array_size(pipelines); ++p)
        for (int v = 0; v < 2; ++v) {
            const char *pipeline = json_string_value(json_array_get(pipelines, p));
            const double total = mean(runs, NULL, pipeline, variants[v], "train_seconds");
            if (isnan(total))
                continue;
            json_t *row = json_array();
            put_text(row, pipeline);
            put_text(row, variants[v]);
            double spare = 0;
            for (size_t k = 0; k < sizeof phases / sizeof *phases; ++k) {
                char metric[64];
                snprintf(metric, sizeof metric, "seconds.%s", phases[k]);
                spare = mean(runs, NULL, pipeline, variants[v], metric);
                put_number(row, "%.2f", spare);
            }
            put_number(row, "%.2f", total);
            put_number(row, "%.3f %%", 100.0 * spare / total);
            end_row(table, row);
        }
    return table;
}

static json_t *stops_table(const json_t *runs)
{
    static const char *const columns[] = {"scene", "pipeline",    "variant",
                                          "seed",  "stop reason", NULL};
    json_t *table = new_table(
        "Early stops", "Runs that stopped in equilibrium before the end of the schedule.", columns);
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        const json_t *run = json_array_get(runs, k), *summary = json_object_get(run, "summary");
        if (strcmp(text_of(summary, "stop_reason"), "equilibrium"))
            continue;
        json_t *row = json_array();
        put_text(row, text_of(run, "scene"));
        put_text(row, text_of(run, "pipeline"));
        put_text(row, text_of(run, "variant"));
        put_number(row, "%.0f", json_number_value(json_object_get(run, "seed")));
        put_text(row, text_of(summary, "stop_text"));
        end_row(table, row);
    }
    return table;
}

json_t *report_tables(const json_t *results)
{
    const json_t *plan = json_object_get(results, "plan"), *runs = json_object_get(results, "runs");
    const json_t *pipelines = json_object_get(plan, "pipelines");
    json_t *tables = json_array();
    json_array_append_new(tables, pipelines_table(plan, runs));
    for (size_t p = 0; p < json_array_size(pipelines); ++p) {
        json_t *table = variants_table(plan, runs, json_string_value(json_array_get(pipelines, p)));
        if (json_array_size(json_object_get(table, "rows")) > 2) // more than off and on
            json_array_append(tables, table);
        json_decref(table);
    }
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
    const char *title = text_of(json_object_get(results, "plan"), "title");
    char *text = format_text("# %s\n\n%zu completed runs.\n", *title ? title : "Experiment",
                             json_array_size(json_object_get(results, "runs")));
    for (size_t t = 0; t < json_array_size(tables); ++t) {
        const json_t *table = json_array_get(tables, t),
                     *columns = json_object_get(table, "columns"),
                     *rows = json_object_get(table, "rows");
        if (!json_array_size(rows))
            continue;
        char *longer = format_text("%s\n## %s\n\n%s\n\n", text, text_of(table, "title"),
                                   text_of(table, "note"));
        free(text);
        text = append_row(longer, columns);
        json_t *rule = json_array();
        for (size_t k = 0; k < json_array_size(columns); ++k)
            put_text(rule, "---");
        text = append_row(text, rule);
        json_decref(rule);
        for (size_t r = 0; r < json_array_size(rows); ++r)
            text = append_row(text, json_array_get(rows, r));
    }
    return text;
}
