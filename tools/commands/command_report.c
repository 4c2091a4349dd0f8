// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs report`: the tables of an experiment as Markdown, and one self-contained HTML page:
// report_page.html with data and images embedded.

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cli/commands.h"
#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "options/options.h"
#include "processes/interrupt.h"
#include "report/report_tables.h"
#include "report/table_file.h"
#include "run/evaluate.h"
#include "run/exposure_file.h"
#include "run/region_file.h"

extern const char report_page[]; // report_page.html, embedded by report_page.cmake
static const char page_start[] = "<!DOCTYPE html>",
                  page_title[] = "<title>sparegs experiment</title>";
static const char tables_mark[] = " completed runs.\n";

static const char description[] =
    "Creates tables and an HTML page of an experiment (DIR of 'sparegs experiment'), complete or "
    "not: DIR/report.md and DIR/report.html. The page is one self-contained file: primitives over "
    "iterations, quality against primitives, size against quality of pruned and compressed models, "
    "seconds by phase, maps of the regions, renders next "
    "to photos, and a log of the structural updates.";

typedef struct report_values {
    const char *markdown, *html;
    int pictures, maps;
} report_values;

static const option report_options[] = {
    {.name = "markdown",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(report_values, markdown),
     .argument = "FILE",
     .shown = "DIR/report.md",
     .help = "output file of the tables"},
    {.name = "html",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(report_values, html),
     .argument = "FILE",
     .shown = "DIR/report.html",
     .help = "output file of the page"},
    {.name = "pictures",
     .kind = OPTION_INTEGER,
     .offset = offsetof(report_values, pictures),
     .low = 0,
     .high = 100,
     .argument = "N",
     .initial = "4",
     .unit = "runs",
     .help =
         "number of runs shown with a render of the first held-out view; their scenes must exist"},
    {.name = "maps",
     .kind = OPTION_INTEGER,
     .offset = offsetof(report_values, maps),
     .low = 0,
     .high = 1000,
     .argument = "N",
     .initial = "4",
     .unit = "runs",
     .help = "number of runs with SPARE-GS that are shown with region maps, about 200 KB each"},
};

// ---- A run ----

static double number_at(const json_t *row, size_t k)
{
    return json_number_value(json_array_get(row, k));
}

// A log of the structural updates, from spare.csv or, without SPARE-GS, from train.csv.
static json_t *update_words(const json_t *train, const json_t *spare, const json_t *summary)
{
    json_t *words = json_array();
    for (size_t k = 0; k < json_array_size(spare); ++k) {
        const json_t *r = json_array_get(spare, k);
        char *text =
            format_text("iteration %.0f: %.0f primitives in %.0f regions after the update; %.0f %% "
                        "over quota before it, mean weight %.3f; weights suppressed %.0f and "
                        "boosted %.0f densifications; %.0f pruned as redundant",
                        number_at(r, 0), number_at(r, 2), number_at(r, 1), 100 * number_at(r, 3),
                        number_at(r, 4), number_at(r, 5), number_at(r, 6), number_at(r, 7));
        json_array_append_new(words, json_string(text));
        free(text);
    }
    for (size_t k = 0; k < json_array_size(train) && !json_array_size(spare); ++k) {
        const json_t *r = json_array_get(train, k);
        if (number_at(r, 5) == 0 && number_at(r, 6) == 0)
            continue;
        char *text =
            format_text("up to iteration %.0f: %.0f densified, %.0f pruned, %.0f primitives",
                        number_at(r, 0), number_at(r, 5), number_at(r, 6), number_at(r, 3));
        json_array_append_new(words, json_string(text));
        free(text);
    }
    json_array_append(words, json_object_get(summary, "stop_text"));
    return words;
}

// [{"iteration","grid","cells":[[voxel, -, count, quota, slack, weight]]}], at most eight updates
// evenly spread. None, after a warning, if the file is damaged.
static json_t *region_maps(const char *folder)
{
    enum { MAPS = 8 };
    region_history history;
    json_t *maps = json_array();
    errors_hold(true);
    const bool whole = region_history_read(folder, &history);
    errors_hold(false);
    if (!whole) {
        print_warning("%s; its region maps are omitted", last_error_text());
        return maps;
    }
    for (size_t u = 0; u < history.count; ++u) {
        const sgs_regions *update = &history.updates[u];
        const size_t wanted = history.count < MAPS ? history.count : MAPS;
        if ((u + 1) * wanted / history.count == u * wanted / history.count)
            continue;
        json_t *cells = json_array();
        for (size_t i = 0; i < update->count; ++i) {
            const sgs_region *r = &update->regions[i];
            char quota[24], slack[24], weight[24];
            snprintf(quota, sizeof quota, "%.3g", (double)r->quota);
            snprintf(slack, sizeof slack, "%.3g", (double)r->slack);
            snprintf(weight, sizeof weight, "%.3g", (double)r->weight);
            json_array_append_new(cells, json_pack("[i,i,i,f,f,f]", (int)r->voxel, 0, (int)r->count,
                                                   strtod(quota, NULL), strtod(slack, NULL),
                                                   strtod(weight, NULL)));
        }
        json_array_append_new(maps, json_pack("{s:i,s:i,s:o}", "iteration", update->iteration,
                                              "grid", update->grid, "cells", cells));
    }
    region_history_free(&history);
    return maps;
}

static json_t *page_run(const char *folder, const json_t *run, bool mapped)
{
    const json_t *summary = json_object_get(run, "summary");
    char *path = format_text("%s/%s", folder, json_string_value(json_object_get(run, "folder")));
    json_t *train = table_file_rows(path, "train.csv", "its curves are omitted"),
           *spare = table_file_rows(path, "spare.csv", "its updates are omitted");
    json_t *test = json_object_get(summary, "test"), *out = json_object();
    static const char *const copied[] = {"scene", "pipeline", "variant", "seed"};
    for (size_t k = 0; k < sizeof copied / sizeof *copied; ++k)
        json_object_set(out, copied[k], json_object_get(run, copied[k]));
    json_object_set(out, "gaussians", json_object_get(summary, "gaussians"));
    json_object_set(out, "seconds", json_object_get(summary, "seconds"));
    json_object_set(out, "test", test ? test : json_null());
    json_t *post = json_object_get(run, "post");
    json_object_set_new(out, "post", post ? json_incref(post) : json_array());
    json_object_set_new(out, "words", update_words(train, spare, summary));
    json_object_set_new(out, "train", train);
    json_object_set_new(out, "regions", mapped ? region_maps(path) : json_array());
    json_decref(spare);
    free(path);
    return out;
}

// ---- Pictures ----

static char *base64(const unsigned char *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char *text = malloc((size + 2) / 3 * 4 + 1), *to = text;
    for (size_t i = 0; text && i < size; i += 3) {
        const unsigned b = (unsigned)bytes[i] << 16 |
                           (i + 1 < size ? (unsigned)bytes[i + 1] << 8 : 0) |
                           (i + 2 < size ? bytes[i + 2] : 0u);
        *to++ = digits[b >> 18];
        *to++ = digits[b >> 12 & 63];
        *to++ = (char)(i + 1 < size ? digits[b >> 6 & 63] : '=');
        *to++ = (char)(i + 2 < size ? digits[b & 63] : '=');
    }
    if (text)
        *to = 0;
    return text;
}

// A PNG as a data URI, encoded through a temporary file. NULL after printing the error.
static json_t *picture_uri(const char *folder, const sgs_image8 *image)
{
    char *path = format_text("%s/.picture.XXXXXX.png", folder);
    const int descriptor = mkstemps(path, 4);
    json_t *uri = NULL;
    FILE *stream = NULL;
    if (descriptor < 0) {
        fail_run("%s: cannot be written: %s", path, strerror(errno));
        free(path);
        return NULL;
    }
    close(descriptor);
    if (sgs_png_write(path, image))
        fail_library();
    else
        stream = fopen(path, "rb");
    if (stream && !fseek(stream, 0, SEEK_END)) {
        const long size = ftell(stream);
        unsigned char *bytes = malloc((size_t)size + 1);
        rewind(stream);
        if (bytes && fread(bytes, 1, (size_t)size, stream) == (size_t)size) {
            char *encoded = base64(bytes, (size_t)size),
                 *text = format_text("data:image/png;base64,%s", encoded ? encoded : "");
            uri = json_string(text);
            free(text);
            free(encoded);
        }
        free(bytes);
    }
    if (stream)
        fclose(stream);
    unlink(path);
    free(path);
    return uri;
}

// A render of the first held-out view of the run in `path` (the first view if none is held out).
// NULL after printing the error.
static json_t *draw_picture(const char *folder, const char *path, const json_t *run)
{
    model_path located;
    json_t *picture = NULL;
    if (model_locate(path, &located)) {
        // An empty command line, so that the run's config applies.
        scene_values data;
        drawing_values drawing;
        option_group groups[] = {scene_group(&data), drawing_group(&drawing)};
        command_line nothing = {.command = "report", .groups = groups, .group_count = 2};
        char name[] = "report", *arguments[] = {name, NULL};
        const bool parsed = command_line_parse(&nothing, 1, arguments) < 0;
        const char *scene_path = json_string_value(json_object_get(located.config, "scene"));
        if (!scene_path)
            fail_run("%s/config.json: names no scene", path);
        const bool found = scene_path && (*scene_path == '/' || file_exists(scene_path));
        if (scene_path && !found)
            fail_run("%s: no such folder; run the report in the folder in which the experiment ran",
                     scene_path);
        sgs_scene *scene = parsed && found && model_scene_resolve(&data, &nothing, &located) < 0
                               ? scene_open(scene_path, &data, true)
                               : NULL;
        sgs_gaussians *model = NULL;
        evaluator evaluation = {0};
        view_score score;
        view_images images = {0};
        json_t *exposures = NULL;
        const sgs_view *view = scene ? &scene->views[0] : NULL;
        for (size_t v = 0; scene && v < scene->view_count && view->split != SGS_SPLIT_TEST; ++v)
            view = scene->views[v].split == SGS_SPLIT_TEST ? &scene->views[v] : view;
        if (scene)
            drawing_resolve(&drawing, &nothing, located.config, &data, scene);
        const bool ready = view && model_read(&located, &drawing, &model) &&
                           exposure_of_model(&located, scene, &exposures) &&
                           evaluator_open(&evaluation, model, scene, &drawing);
        evaluation.exposures = exposures;
        if (ready && evaluate_view(&evaluation, view, &score, &images)) {
            json_t *left = picture_uri(folder, &images.drawn),
                   *right = picture_uri(folder, &images.photo);
            char *label =
                format_text("%s / %s / %s: %s", json_string_value(json_object_get(run, "scene")),
                            json_string_value(json_object_get(run, "pipeline")),
                            json_string_value(json_object_get(run, "variant")), view->name);
            if (left && right)
                picture = json_pack("{s:s,s:O,s:O,s:b,s:o,s:o,s:o}", "label", label, "drawn", left,
                                    "photo", right, "identical", isinf(score.psnr) != 0, "psnr",
                                    json_number(score.psnr), "flip", json_number(score.flip),
                                    "sharpness", json_number(score.sharpness));
            json_decref(left);
            json_decref(right);
            free(label);
        }
        json_decref(exposures);
        view_images_free(&images);
        evaluator_close(&evaluation);
        sgs_gaussians_destroy(model);
        sgs_scene_destroy(scene);
    }
    model_path_free(&located);
    return picture;
}

// The picture of a run. NULL after a warning, or a signal.
static json_t *picture_of(const char *folder, const json_t *run)
{
    char *path = format_text("%s/%s", folder, json_string_value(json_object_get(run, "folder")));
    errors_hold(true);
    json_t *picture = draw_picture(folder, path, run);
    errors_hold(false);
    if (!picture && !interrupt_signal())
        print_warning("%s: no picture of this run: %s; --pictures 0 omits the pictures", path,
                      last_error_text());
    free(path);
    return picture;
}

// ---- The page ----

static json_t *page_data(const char *folder, const json_t *results, const json_t *tables,
                         const report_values *values)
{
    const json_t *runs = json_object_get(results, "runs");
    const char *title =
        json_string_value(json_object_get(json_object_get(results, "plan"), "title"));
    json_t *data = json_object(), *list = json_array(), *drawn = json_array();
    int mapped = 0, tried = 0;
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        json_t *run = page_run(folder, json_array_get(runs, k), mapped < values->maps);
        mapped += json_array_size(json_object_get(run, "regions")) > 0;
        json_array_append_new(list, run);
        if (tried++ < values->pictures && !interrupt_signal()) {
            json_t *picture = picture_of(folder, json_array_get(runs, k));
            if (picture)
                json_array_append_new(drawn, picture);
        }
    }
    json_object_set_new(data, "title", json_string(title ? title : "Experiment"));
    json_object_set_new(data, "runs", list);
    json_object_set_new(data, "pictures", drawn);
    json_object_set(data, "tables", (json_t *)tables);
    return data;
}

static bool write_page(const char *path, json_t *data)
{
    char *json = json_dumps(data, JSON_COMPACT | JSON_REAL_PRECISION(6));
    json_decref(data);
    static const char mark[] = "@DATA@";
    const char *at = strstr(report_page, mark);
    if (!json || !at) {
        free(json);
        fail_run("%s: not enough memory for the page", path);
        return false;
    }
    // "</script" would end the script element that contains the data, and "<!--<script" would
    // extend it. JSON has '<' in texts only.
    static const char escape[] = "\\u003c";
    size_t extra = 0;
    for (const char *c = json; (c = strchr(c, '<')); ++c)
        extra += strlen(escape) - 1;
    char *safe = malloc(strlen(json) + extra + 1), *to = safe;
    for (const char *c = json; safe && *c; ++c) {
        const bool escaped = *c == '<';
        memcpy(to, escaped ? escape : c, escaped ? strlen(escape) : 1);
        to += escaped ? strlen(escape) : 1;
    }
    bool written = false;
    if (safe) {
        *to = 0;
        char *page =
            format_text("%.*s%s%s", (int)(at - report_page), report_page, safe, at + strlen(mark));
        written = write_text(path, page);
        free(page);
    }
    free(safe);
    free(json);
    return written;
}

// The member of results.json that does not have the type that tables and page require, or NULL.
// Release with free().
static char *results_fault(const json_t *results)
{
    static const char *const texts[] = {"scene", "pipeline", "variant", "folder"};
    const json_t *pipelines = json_object_get(json_object_get(results, "plan"), "pipelines"),
                 *runs = json_object_get(results, "runs");
    if (!json_is_array(pipelines))
        return format_text("plan.pipelines must be a list");
    for (size_t k = 0; k < json_array_size(pipelines); ++k)
        if (!json_is_string(json_array_get(pipelines, k)))
            return format_text("plan.pipelines[%zu] must be a string", k);
    for (size_t k = 0; k < json_array_size(runs); ++k) {
        const json_t *run = json_array_get(runs, k);
        for (size_t t = 0; t < sizeof texts / sizeof *texts; ++t)
            if (!json_is_string(json_object_get(run, texts[t])))
                return format_text("runs[%zu].%s must be a string", k, texts[t]);
        if (!json_is_object(json_object_get(run, "summary")))
            return format_text("runs[%zu].summary must be an object", k);
    }
    return NULL;
}

// The results of an experiment, or NULL after printing the error.
static json_t *read_results(const char *folder)
{
    char *path = format_text("%s/results.json", folder), *fault = NULL;
    json_error_t error;
    json_t *results = load_json(path, 0, &error);
    if (!results) {
        fault = json_load_fault(path, &error);
        fail_run("%s; DIR must be the folder of an experiment", fault);
    } else if (!json_array_size(json_object_get(results, "runs"))) {
        fault = format_text("%s: no run is complete yet; continue 'sparegs experiment'", path);
        fail_run("%s", fault);
    } else if ((fault = results_fault(results))) {
        fail_run("%s: %s; delete it and rerun 'sparegs experiment', which writes it again", path,
                 fault);
    }
    if (fault) {
        json_decref(results);
        results = NULL;
    }
    free(fault);
    free(path);
    return results;
}

static bool write_report(const char *folder, const report_values *values, const json_t *results,
                         const char *text_path, const char *page_path)
{
    json_t *tables = report_tables(results);
    char *markdown = report_markdown(results, tables);
    const bool done = make_folder_of(text_path) && make_folder_of(page_path) &&
                      write_text(text_path, markdown) &&
                      write_page(page_path, page_data(folder, results, tables, values));
    if (done) {
        report_file(text_path);
        report_file(page_path);
    }
    free(markdown);
    json_decref(tables);
    return done;
}

// False if a file exists that does not begin with `start` and have `mark` near its beginning, as an
// earlier report does: a photo, say.
static bool may_replace(const char *path, const char *start, const char *mark)
{
    struct stat info;
    if (stat(path, &info) || !S_ISREG(info.st_mode) || !info.st_size)
        return true;
    char text[4096] = "";
    FILE *stream = open_input(path, NULL);
    if (stream)
        text[fread(text, 1, sizeof text - 1, stream)] = '\0';
    const bool may = !strncmp(text, start, strlen(start)) && strstr(text, mark);
    if (stream)
        fclose(stream);
    if (!may)
        fail_run("%s: is not a report and would be replaced; choose another file", path);
    return may;
}

static int report(const char *folder, const report_values *values)
{
    char *text_path = values->markdown ? format_text("%s", values->markdown)
                                       : format_text("%s/report.md", folder);
    char *page_path =
        values->html ? format_text("%s", values->html) : format_text("%s/report.html", folder);
    int status = -1;
    if (same_file(text_path, page_path))
        status = fail_usage("the tables and the page are both %s; choose different files with "
                            "--markdown and --html",
                            page_path);
    json_t *results = status < 0 ? read_results(folder) : NULL;
    if (status < 0)
        status = results && may_replace(text_path, "# ", tables_mark) &&
                         may_replace(page_path, page_start, page_title) &&
                         check_output(text_path) && check_output(page_path) &&
                         write_report(folder, values, results, text_path, page_path)
                     ? interrupt_status()
                     : EXIT_FAILED;
    free(text_path);
    free(page_path);
    json_decref(results);
    return status;
}

int command_report(int argc, char **argv)
{
    command_call call;
    report_values values = {0};
    const command_spec spec = {.name = "report",
                               .synopsis = "DIR [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Report",
                               .options = report_options,
                               .option_count = sizeof report_options / sizeof *report_options,
                               .values = &values};
    const int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    interrupt_watch();
    if (call.common.json)
        reported_files_begin();
    const int done = report(call.line.operands[0], &values);
    const bool prints = call.common.json && done != EXIT_FAILED && done != EXIT_USAGE;
    return !prints || reported_files_print() ? done : EXIT_FAILED;
}
