// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs bench`: times the phases of a training iteration on built-in scenes and on the user's
// models. The repetitions of all settings of a scene are interleaved, so that a temporary slowdown
// of the machine affects them alike.

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "cameras/camera_file.h"
#include "cli/commands.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "processes/interrupt.h"
#include "report/bench_report.h"

static const char description[] =
    "Measures the phases of a training iteration on built-in scenes (listed by --list; by default "
    "sparse-32k, dense-500k and dense-2m), or on MODEL (a model file or a run folder) viewed from "
    "the cameras of SCENE. Prints median, minimum and maximum over the repetitions: core time "
    "(wall-clock time x threads) per ray hit (TSC cycles, ns) and per megapixel. Machine peaks are "
    "measured in the same run. `forward` is projection, ordering and blending, without `gather`; "
    "`total` is gather, forward and backward; `iteration` is everything except `build`. --ranks "
    "predicts training on several machines.";

typedef struct bench_values {
    integer_list threads, ranks;
    unsigned isas;
    int repeat, views;
    uint64_t seed;
    bool list, json, csv, quiet;
} bench_values;

#define AT(member) offsetof(bench_values, member)

static const option bench_options[] = {
    {.name = "list",
     .kind = OPTION_FLAG,
     .offset = AT(list),
     .help = "list the built-in scenes and exit"},
    {.name = "threads",
     .kind = OPTION_INTEGERS,
     .offset = AT(threads),
     .low = 0,
     .high = 4096,
     .argument = "A,B,...",
     .initial = "0",
     .shown = "0 = all cores available to the process",
     .help = "thread counts to measure"},
    {.name = "isa",
     .kind = OPTION_SET,
     .offset = AT(isas),
     .argument = "baseline,avx2,avx512",
     .shown = "the best that the CPU supports",
     .help = "instruction sets to measure"},
    {.name = "repeat",
     .kind = OPTION_INTEGER,
     .offset = AT(repeat),
     .low = 1,
     .high = 1000,
     .argument = "N",
     .initial = "5",
     .help = "repetitions"},
    {.name = "views",
     .kind = OPTION_INTEGER,
     .offset = AT(views),
     .low = 1,
     .high = 16,
     .argument = "N",
     .initial = "3",
     .help = "number of views of SCENE, evenly spaced, sorted by name"},
    {.name = "seed",
     .kind = OPTION_COUNT,
     .offset = AT(seed),
     .low = 0,
     .high = 9007199254740991.0,
     .argument = "N",
     .initial = "0",
     .help = "random seed of the built-in scenes"},
    {.name = "ranks",
     .kind = OPTION_INTEGERS,
     .offset = AT(ranks),
     .low = 2,
     .high = 1024,
     .argument = "A,B,...",
     .shown = "none",
     .help = "also predict the messages of that many ranks, one per machine, and the speed-up over "
             "one machine for several networks"},
    {.name = "json",
     .kind = OPTION_FLAG,
     .offset = AT(json),
     .help = "print the result as one JSON object on stdout"},
    {.name = "csv",
     .kind = OPTION_FLAG,
     .offset = AT(csv),
     .help = "print one CSV row per scene and setting on stdout"},
    {.name = "quiet",
     .kind = OPTION_FLAG,
     .offset = AT(quiet),
     .help = "suppress progress and notes"},
};

typedef struct bench_setting {
    int threads;
    sgs_isa isa;
    sgs_machine_limits limits;
} bench_setting;

// A MODEL and its SCENE.
typedef struct bench_input {
    model_path located;
    sgs_scene *scene;
    drawing_values drawing;
} bench_input;

enum { MAX_OPERANDS = 8 };

typedef struct bench_run {
    const bench_values *values;
    bench_input inputs[MAX_OPERANDS / 2]; // opened before the first measurement
    size_t input_count;
    bench_setting settings[64 * SGS_ISA_COUNT];
    size_t setting_count;
    bench_report report;
    size_t capacity; // of report.results
} bench_run;

static bool apply(const bench_setting *setting)
{
    sgs_threads_set(setting->threads);
    if (!sgs_isa_set(setting->isa))
        return true;
    fail_library();
    return false;
}

// Outer loop over threads, inner over instruction sets. Limits are those of the best instruction
// set.
static bool make_settings(bench_run *run, bool isa_given)
{
    const sgs_isa best = sgs_isa_get();
    for (int t = 0; t < run->values->threads.count; ++t) {
        bench_setting made = {.isa = best};
        sgs_threads_set(run->values->threads.values[t]);
        made.threads = sgs_threads_get();
        if (made.threads > sgs_cores())
            print_warning("%d threads oversubscribe %d cores; the times include waiting for a core",
                          made.threads, sgs_cores());
        if (sgs_machine_limits_measure(&made.limits)) {
            fail_library();
            return false;
        }
        for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
            if (isa_given ? !(run->values->isas >> isa & 1) : isa != (int)best)
                continue;
            made.isa = (sgs_isa)isa;
            if (!apply(&made))
                return false;
            run->settings[run->setting_count++] = made;
            sgs_isa_set(best);
        }
    }
    return true;
}

static bench_result *add_result(bench_run *run, const char *name, const bench_setting *setting)
{
    bench_result *result = &run->report.results[run->report.count++];
    *result =
        (bench_result){.name = name,
                       .isa = setting->isa,
                       .threads = setting->threads,
                       .limits = setting->limits,
                       .repeat = (size_t)run->values->repeat,
                       .measures = calloc((size_t)run->values->repeat, sizeof(bench_measure))};
    return result->measures ? result : NULL;
}

static void free_results(bench_run *run, size_t first)
{
    for (size_t i = first; run->report.results && i < run->report.count; ++i) {
        free(run->report.results[i].measures);
        free(run->report.results[i].ranks);
    }
    run->report.count = first;
}

// Into the result of the first setting.
static bool predict_ranks(const bench_run *run, sgs_bench *bench, bench_result *result)
{
    const integer_list *ranks = &run->values->ranks;
    if (!ranks->count)
        return true;
    const size_t count = (size_t)ranks->count;
    result->ranks = calloc(count, sizeof *result->ranks);
    if (!result->ranks) {
        fail_run("not enough memory for the predictions");
        return false;
    }
    if (apply(&run->settings[0])) {
        if (!sgs_bench_ranks(bench, ranks->values, count, result->ranks)) {
            result->rank_count = count;
            return true;
        }
        fail_library();
    }
    free(result->ranks);
    result->ranks = NULL;
    return false;
}

static bool measure_once(bench_run *run, size_t setting, sgs_bench *bench, bench_result *result,
                         bench_measure *to)
{
    if (!apply(&run->settings[setting]))
        return false;
    if (sgs_bench_run(bench, &to->sample) ||
        (setting == 0 && run->values->ranks.count && sgs_bench_rank_build(bench, &to->sample))) {
        fail_library();
        return false;
    }
    to->total = to->sample.gather + to->sample.forward + to->sample.backward;
    result->counts = sgs_bench_counts_get(bench);
    return true;
}

// All repetitions of all settings. False after an error, or if they were interrupted.
static bool repeat(bench_run *run, const char *name, sgs_bench *bench, bench_result *results)
{
    for (int i = 0; i < run->values->repeat; ++i)
        for (size_t s = 0; s < run->setting_count; ++s) {
            progress_count(name, (size_t)i * run->setting_count + s,
                           (size_t)run->values->repeat * run->setting_count);
            if (interrupt_signal() ||
                !measure_once(run, s, bench, &results[s], &results[s].measures[i]))
                return false;
        }
    return true;
}

// render NULL: the defaults. A scene whose measurement fails or is interrupted leaves no results.
static bool measure(bench_run *run, const char *name, const sgs_gaussians *model,
                    const sgs_view *views, size_t view_count, const sgs_render_options *render)
{
    sgs_bench *bench = NULL;
    const size_t first = run->report.count;
    bench_result *results = &run->report.results[first];
    bool done = true;
    for (size_t s = 0; s < run->setting_count && done; ++s)
        done = add_result(run, name, &run->settings[s]) != NULL;
    if (!done)
        fail_run("not enough memory for the measurements");
    if (done && (!apply(&run->settings[0]) ||
                 sgs_bench_create_with(model, views, view_count, render, &bench))) {
        fail_library();
        done = false;
    }
    const bool complete = done && repeat(run, name, bench, results);
    progress_end();
    if (!complete)
        free_results(run, first);
    done = complete && (interrupt_signal() || predict_ranks(run, bench, results));
    sgs_bench_destroy(bench);
    return done;
}

static bool measure_made(bench_run *run, const char *name)
{
    sgs_bench_scene *scene;
    if (sgs_bench_scene_create(name, run->values->seed, &scene)) {
        fail_library();
        return false;
    }
    const bool done =
        measure(run, scene->name, scene->model, scene->views, scene->view_count, NULL);
    sgs_bench_scene_destroy(scene);
    return done;
}

static bool measure_model(bench_run *run, const char *model, bench_input *input)
{
    sgs_gaussians *gaussians = NULL;
    bool done = model_read_filled(&input->located, &input->drawing, &gaussians);
    if (done) {
        const sgs_scene *scene = input->scene;
        sgs_view views[16];
        const size_t wanted = (size_t)run->values->views;
        const size_t count = wanted < scene->view_count ? wanted : scene->view_count;
        for (size_t v = 0; v < count; ++v)
            views[v] = scene->views[evenly_spaced(v, count, scene->view_count)];
        const sgs_render_options render = drawing_render_options(&input->drawing);
        done = measure(run, model, gaussians, views, count, &render);
    }
    sgs_gaussians_destroy(gaussians);
    return done;
}

static bool is_made(const char *name)
{
    for (size_t i = 0; sgs_bench_scene_name(i); ++i)
        if (!strcmp(sgs_bench_scene_name(i), name))
            return true;
    return false;
}

static int print_list(bool json)
{
    if (json) {
        json_t *list = json_array();
        for (size_t i = 0; sgs_bench_scene_name(i); ++i)
            json_array_append_new(list, json_pack("{s:s,s:s}", "name", sgs_bench_scene_name(i),
                                                  "text", sgs_bench_scene_text(i)));
        json_t *root = json_object();
        json_object_set_new(root, "scenes", list);
        return print_json(root) ? EXIT_DONE : EXIT_FAILED;
    }
    for (size_t i = 0; sgs_bench_scene_name(i); ++i)
        printf("%-14s %s\n", sgs_bench_scene_name(i), sgs_bench_scene_text(i));
    return EXIT_DONE;
}

// Each operand is the name of a built-in scene, or a MODEL followed by a SCENE.
static int check_operands(const command_line *line)
{
    const char *names[16];
    char near[SUGGESTION_LENGTH];
    size_t count = 0;
    while (count < 16 && sgs_bench_scene_name(count)) {
        names[count] = sgs_bench_scene_name(count);
        ++count;
    }
    for (int i = 0; i < line->operand_count; ++i) {
        const char *operand = line->operands[i];
        if (is_made(operand))
            continue;
        if (!model_is(operand))
            return fail_usage(
                "'%s' is neither a built-in scene%s nor a model; --list lists the scenes", operand,
                suggestion(near, "", operand, names, count));
        if (++i == line->operand_count)
            return fail_usage("bench requires a SCENE after MODEL '%s'; usage: sparegs bench %s",
                              operand, line->synopsis);
    }
    return -1;
}

static bool open_input(const char *model, const char *scene, scene_values *data,
                       const command_line *line, bench_input *input)
{
    drawing_group(&input->drawing); // the defaults
    if (!model_locate(model, &input->located))
        return false;
    if (access(scene, R_OK)) {
        fail_run("%s: %s; specify a scene folder", scene, strerror(errno));
        return false;
    }
    if (model_scene_resolve(data, line, &input->located) >= 0 ||
        !(input->scene = scene_open(scene, data, false)))
        return false;
    drawing_resolve(&input->drawing, line, input->located.config, data, input->scene);
    return true;
}

// Opens the scenes of all models, so that wrong ones are reported before minutes of measurement.
static bool open_inputs(bench_run *run, const command_line *line, scene_values *data)
{
    for (int i = 0; i < line->operand_count; ++i)
        if (!is_made(line->operands[i])) {
            const char *model = line->operands[i], *scene = line->operands[++i];
            if (!open_input(model, scene, data, line, &run->inputs[run->input_count++]))
                return false;
        }
    return true;
}

static void close_inputs(bench_run *run)
{
    for (size_t i = 0; i < run->input_count; ++i) {
        sgs_scene_destroy(run->inputs[i].scene);
        model_path_free(&run->inputs[i].located);
    }
}

static bool measure_all(bench_run *run, const command_line *line)
{
    size_t input = 0;
    if (!line->operand_count)
        for (size_t i = 0; sgs_bench_scene_name(i); ++i)
            if (!sgs_bench_scene_by_name_only(i) &&
                (interrupt_signal() || !measure_made(run, sgs_bench_scene_name(i))))
                return false;
    for (int i = 0; i < line->operand_count && !interrupt_signal(); ++i) {
        const char *operand = line->operands[i];
        const bool made = is_made(operand);
        if (!(made ? measure_made(run, operand)
                   : measure_model(run, operand, &run->inputs[input++])))
            return false;
        i += !made; // its SCENE
    }
    return true;
}

static int run_bench(const bench_values *values, const command_line *line, scene_values *data)
{
    bench_run run = {.values = values};
    bool done = open_inputs(&run, line, data) && make_settings(&run, option_given(line, "isa"));
    run.report.results = calloc((run.setting_count + 1) * MAX_OPERANDS, sizeof *run.report.results);
    if (done && !run.report.results) {
        fail_run("not enough memory for the measurements");
        done = false;
    }
    done = done && measure_all(&run, line);
    if (run.report.count) { // also those before an error or a signal
        if (values->json)
            done = bench_print_json(&run.report) && done;
        else if (values->csv)
            bench_print_csv(&run.report);
        else
            bench_print_table(&run.report);
    }
    free_results(&run, 0);
    free(run.report.results);
    close_inputs(&run);
    return interrupt_signal() ? interrupt_status() : done ? EXIT_DONE : EXIT_FAILED;
}

#define SCENE_NAMES "images|downscale|eval|test-every|test-images"
#define PHOTO_NAMES "masks|invert-masks|alpha|image-cache|input-colorspace|train-space|white"

// Options without an effect: on a list, on built-in scenes, on models. Returns -1 to continue, or
// an exit status.
static int check_idle(const command_line *line, bool list)
{
    bool made = !line->operand_count, models = false;
    for (int i = 0; i < line->operand_count; ++i) {
        const bool is_name = is_made(line->operands[i]);
        made = made || is_name;
        models = models || !is_name;
    }
    int status =
        list ? refuse_idle(line, "threads|isa|repeat|views|seed|ranks|csv|quiet", "with --list")
             : -1;
    if (status < 0 && !models)
        status = refuse_idle(line, "views", "without a MODEL and its SCENE");
    if (status < 0 && !made)
        status = refuse_idle(line, "seed", "without a built-in scene");
    if (status >= 0)
        return status;
    if (!models)
        warn_idle(line, SCENE_NAMES, "without a MODEL and its SCENE");
    else
        warn_idle(line, "eval|test-every|test-images", "on bench, which uses all views");
    warn_idle(line, PHOTO_NAMES, "on bench, which reads no photos");
    return -1;
}

int command_bench(int argc, char **argv)
{
    bench_values values = {0};
    scene_values data;
    option_group groups[] = {{.title = "Measurement",
                              .options = bench_options,
                              .count = sizeof bench_options / sizeof *bench_options,
                              .values = &values},
                             scene_group(&data)};
    command_line line = {.command = "bench",
                         .synopsis = "[NAME|MODEL SCENE]... [options]",
                         .description = description,
                         .groups = groups,
                         .group_count = sizeof groups / sizeof *groups,
                         .operand_maximum = MAX_OPERANDS};
    int status = command_line_parse(&line, argc, argv);
    if (status < 0 && values.json && values.csv)
        status = fail_usage("--json and --csv are mutually exclusive");
    if (status < 0 && values.ranks.count && values.csv)
        status = fail_usage("--ranks and --csv are mutually exclusive; use --json");
    if (status < 0)
        status = check_idle(&line, values.list);
    if (status < 0)
        status = values.list ? print_list(values.json) : check_operands(&line);
    if (status >= 0)
        return status;
    messages_set_quiet(values.quiet);
    interrupt_watch();
    return run_bench(&values, &line, &data);
}
