// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs profile`: cost and quality of the BVH over a model, for the cameras of a scene or an
// orbit.

#include <stdlib.h>

#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "arguments/shared_options.h"
#include "cameras/render_cameras.h"
#include "cli/commands.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "processes/interrupt.h"
#include "report/profile_report.h"
#include "run/trace_file.h"
#include "sparegs/runtime.h"

static const char description[] =
    "Profiles the BVH of MODEL (a model file or a run folder) with rays from the cameras of SCENE. "
    "Compares Embree build qualities (low, medium, high), the refittable tree used in training, "
    "and that tree after many refits. Reports build and refit time, memory, SAH cost, overlap, "
    "traversal counts, false positives, hits until rays terminate, cost per tile, and the phases "
    "of a training iteration over the same views, then recommends a build quality and a rebuild "
    "interval, and names the dominant phase. With -o DIR, writes heat maps per pixel and per tile "
    "as EXR and PNG.";

typedef struct profile_values {
    const char *output, *view, *trace, *run;
    int split, views, orbit, refits, repeat, samples;
} profile_values;

#define AT(member) offsetof(profile_values, member)

static const option profile_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = AT(output),
     .argument = "DIR",
     .shown = "none",
     .help = "folder for heat maps"},
    {.name = "view",
     .kind = OPTION_TEXT,
     .offset = AT(view),
     .argument = "NAME",
     .shown = "see --split",
     .help = "profile only this view: an image name"},
    {.name = "split",
     .kind = OPTION_CHOICE,
     .offset = AT(split),
     .argument = "test|train|all",
     .initial = "all",
     .help = "views to choose from"},
    {.name = "views",
     .kind = OPTION_INTEGER,
     .offset = AT(views),
     .low = 1,
     .high = 16,
     .argument = "N",
     .initial = "4",
     .help = "number of views of the split, evenly spaced, sorted by name"},
    {.name = "orbit",
     .kind = OPTION_INTEGER,
     .offset = AT(orbit),
     .low = 0,
     .high = 16,
     .argument = "N",
     .initial = "0",
     .help =
         "use N views on a level orbit around the point that the views look at instead; 0 = off"},
    {.name = "refits",
     .kind = OPTION_INTEGER,
     .offset = AT(refits),
     .low = 0,
     .high = 1000000,
     .argument = "K",
     .initial = "100",
     .help = "number of refits of the aged tree"},
    {.name = "repeat",
     .kind = OPTION_INTEGER,
     .offset = AT(repeat),
     .low = 1,
     .high = 1000,
     .argument = "N",
     .initial = "3",
     .help = "repetitions; the best time is reported"},
    {.name = "samples",
     .kind = OPTION_INTEGER,
     .offset = AT(samples),
     .low = 0,
     .high = 4096,
     .argument = "N",
     .initial = "64",
     .unit = "rays",
     .help = "rays per view traced by brute force"},
    {.name = "trace",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = AT(trace),
     .argument = "FILE",
     .shown = "none",
     .help = "write the phases of the training iterations as a Chrome/Perfetto trace"},
    RUN_OPTION(profile_values),
};

enum { VIEWS_MAX = 16, ALL = 2 }; // ALL: of the words of --split

static sgs_split chosen_split(const profile_values *values)
{
    static const sgs_split splits[] = {SGS_SPLIT_TEST, SGS_SPLIT_TRAIN, SGS_SPLIT_ALL};
    return splits[values->split];
}

// The cameras selected by --view, --split, --views or --orbit.
static bool choose_cameras(const sgs_scene *scene, const profile_values *values, bool split_given,
                           camera_list *list)
{
    const camera_choice choice = {.view = values->view,
                                  .split = chosen_split(values),
                                  .split_given = split_given,
                                  .orbit = values->orbit};
    if (!cameras_choose(&choice, scene, list))
        return false;
    if (!values->orbit)
        camera_list_thin(list, (size_t)values->views);
    return true;
}

typedef struct profiling {
    const profile_values *values;
    const common_values *common;
    const sgs_gaussians *model;
    sgs_profile_options options;
    sgs_render_options render;
    camera_list cameras;    // at most VIEWS_MAX
    sgs_counters *counters; // NULL if unavailable
    profile_report report;
} profiling;

// The next view of the split after that of the name, or the first one; NULL if there is no other.
static const sgs_view *next_view(const sgs_scene *scene, sgs_split split, const char *name)
{
    const size_t count = scene->view_count;
    const ptrdiff_t own = sgs_scene_find_view(scene, name);
    for (size_t k = 0; k < count; ++k) {
        const size_t v = ((size_t)(own + 1) + k) % count;
        if ((ptrdiff_t)v != own && view_in_split(&scene->views[v], split))
            return &scene->views[v];
    }
    return NULL;
}

// Sets the camera that the refitted trees of view v are built for: that of another profiled view,
// else of another view of the scene. Returns its name, or NULL if there is none.
static const char *choose_built_for(profiling *job, const sgs_scene *scene, size_t v)
{
    const named_camera *cameras = job->cameras.cameras;
    const size_t count = job->cameras.count;
    if (count > 1) {
        const named_camera *other = &cameras[(v ? v : count) - 1];
        job->options.built_for = &other->pose;
        return other->name;
    }
    const sgs_view *other = next_view(scene, chosen_split(job->values), cameras[v].name);
    job->options.built_for = other ? &other->pose : NULL;
    return other ? other->name : NULL;
}

static bool profile_views(profiling *job, const sgs_scene *scene)
{
    for (size_t v = 0; v < job->cameras.count && !interrupt_signal(); ++v) {
        const named_camera *view = &job->cameras.cameras[v];
        sgs_profile *profile;
        const char *built_for = choose_built_for(job, scene, v);
        progress_count("profiling", v, job->cameras.count);
        if (sgs_profile_view(job->model, &view->camera, &view->pose, &job->options, &profile)) {
            fail_library();
            return false;
        }
        profile_report_add(&job->report, view->name, built_for, profile);
        const bool written =
            !job->values->output || profile_write_maps(job->values->output, view, profile,
                                                       job->common->json ? stderr : stdout);
        sgs_profile_destroy(profile);
        if (!written)
            return false;
    }
    progress_end();
    profile_report_finish(&job->report);
    return true;
}

// The times of one iteration, in the form that the trace takes.
static sgs_train_seconds train_seconds(const sgs_bench_sample *sample)
{
    return (sgs_train_seconds){.gather = sample->gather,
                               .forward = sample->forward,
                               .loss = sample->loss,
                               .backward = sample->backward,
                               .optimizer = sample->optimizer,
                               .bvh_refit = sample->refit};
}

static void add_sample(sgs_bench_sample *to, const sgs_bench_sample *sample, double share)
{
    to->refit += share * sample->refit;
    to->gather += share * sample->gather;
    to->forward += share * sample->forward;
    to->loss += share * sample->loss;
    to->backward += share * sample->backward;
    to->optimizer += share * sample->optimizer;
    to->iteration += share * sample->iteration;
}

// Times a build and an iteration per view.
static bool repeat_training(const profiling *job, sgs_bench *bench, trace_file *trace, int *number,
                            sgs_bench_sample *mean, sgs_counter_values *counted)
{
    const double share = 1.0 / (double)job->cameras.count;
    bool done = !sgs_bench_build(bench, mean);
    if (done && trace)
        trace_span(trace, "bvh_build", clock_seconds() - mean->build,
                   mean->build); // projects first
    for (size_t v = 0; done && v < job->cameras.count && !interrupt_signal(); ++v) {
        const sgs_train_seconds zero = {0};
        sgs_bench_sample sample = {0};
        const double began = clock_seconds();
        if (job->counters)
            sgs_counters_start(job->counters);
        done = !sgs_bench_step(bench, &sample);
        if (job->counters) {
            const sgs_counter_values values = sgs_counters_stop(job->counters);
            profile_counters_add(counted, &values, share);
        }
        sgs_bench_restore(bench);
        add_sample(mean, &sample, share);
        const sgs_train_seconds phases = train_seconds(&sample);
        if (done && trace)
            trace_iteration(trace, ++*number, began, sample.iteration, &zero, &phases);
    }
    if (!done)
        fail_library();
    return done;
}

// Runs training iterations over the views for the phase times, the trace and the hardware counters.
// Keeps the fastest repetition.
static bool measure_training(profiling *job)
{
    const camera_list *cameras = &job->cameras;
    sgs_view views[VIEWS_MAX];
    for (size_t v = 0; v < cameras->count; ++v)
        views[v] = (sgs_view){.name = cameras->cameras[v].name,
                              .camera = cameras->cameras[v].camera,
                              .pose = cameras->cameras[v].pose};
    sgs_bench *bench;
    if (sgs_bench_create_with(job->model, views, cameras->count, &job->render, &bench)) {
        fail_library();
        return false;
    }
    trace_file *trace = NULL;
    int number = 0;
    bool done = !job->values->trace || (trace = trace_open(job->values->trace)) != NULL;
    for (int i = 0; i < job->values->repeat && done && !interrupt_signal(); ++i) {
        sgs_bench_sample sample = {0};
        sgs_counter_values counted = {0};
        done = repeat_training(job, bench, trace, &number, &sample, &counted);
        if (i && sample.iteration >= job->report.training.iteration)
            continue;
        job->report.training = sample;
        job->report.counters = counted;
    }
    sgs_bench_destroy(bench);
    return trace_close(trace, done) && done;
}

static bool profile_model(profiling *job, const sgs_scene *scene, bool split_given)
{
    if (!choose_cameras(scene, job->values, split_given, &job->cameras))
        return false;
    job->options.step =
        SGS_TRAIN_LR_MEAN *
        scene->extent; // initial learning rate of the means: the size of an Adam step
    job->report.refits = job->values->refits;
    job->report.repeat = job->values->repeat;
    bool done = measure_training(job) && profile_views(job, scene);
    if (done && !interrupt_signal()) {
        if (job->common->json)
            done = print_json(profile_json(&job->report));
        else
            profile_print(&job->report);
    }
    camera_list_free(&job->cameras);
    return done;
}

static int run_profile(const command_line *line, const profile_values *values,
                       const common_values *common, scene_values *data, drawing_values *drawing)
{
    model_path located;
    sgs_scene *scene = NULL;
    sgs_gaussians *model = NULL;
    sgs_counters *counters = sgs_counters_open(); // they count threads that start later
    char *reason = counters ? NULL : format_text("%s", sgs_last_error());
    int status = model_locate_of_run(line->operands[0], values->run, &located) ? -1 : EXIT_FAILED;
    if (status < 0)
        status = refuse_outputs_at(line, located.ply_path);
    if (status < 0)
        status = model_scene_resolve(data, line, &located);
    if (status < 0 && values->output &&
        !(make_folder(values->output) && check_writable(values->output)))
        status = EXIT_FAILED;
    if (status < 0 && values->trace && !check_output(values->trace))
        status = EXIT_FAILED;
    if (status < 0) {
        scene = scene_open(line->operands[1], data, false);
        status = scene ? -1 : EXIT_FAILED;
    }
    if (status < 0) {
        drawing_resolve(drawing, line, located.config, data, scene);
        status = model_read_filled(&located, drawing, &model) ? -1 : EXIT_FAILED;
    }
    if (status < 0) {
        drawing->compact_box = 1; // a profile counts hits of the whole support
        profiling *job = calloc(1, sizeof *job);
        if (job) {
            *job = (profiling){.values = values,
                               .common = common,
                               .model = model,
                               .counters = counters,
                               .report = {.counted = counters != NULL,
                                          .no_counters = reason,
                                          .model = line->operands[0],
                                          .scene = line->operands[1]},
                               .options = sgs_profile_options_default()};
            job->render = drawing_render_options(drawing);
            job->options.render = &job->render;
            job->options.refits = values->refits;
            job->options.repeat = values->repeat;
            job->options.samples = values->samples;
            job->options.seed = common->seed;
            const bool done = profile_model(job, scene, option_given(line, "split"));
            status = done ? interrupt_status() : EXIT_FAILED;
            json_decref(job->report.per_view);
        } else {
            status = fail_run("not enough memory for a profile");
        }
        free(job);
    }
    sgs_counters_close(counters);
    free(reason);
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
    model_path_free(&located);
    return status;
}

int command_profile(int argc, char **argv)
{
    command_call call;
    scene_values data;
    drawing_values drawing;
    profile_values values = {0};
    const command_spec spec = {.name = "profile",
                               .synopsis = "MODEL SCENE [options]",
                               .description = description,
                               .operand_minimum = 2,
                               .operand_maximum = 2,
                               .title = "Profiling",
                               .options = profile_options,
                               .option_count = sizeof profile_options / sizeof *profile_options,
                               .values = &values,
                               .scene = &data,
                               .drawing = &drawing};
    int status = command_begin(&spec, argc, argv, &call);
    const bool split = option_given(&call.line, "split") || option_given(&call.line, "views");
    if (status < 0 && values.orbit && (values.view || split))
        status = fail_usage("--orbit selects the views; omit --view, --views and --split");
    if (status < 0)
        status = refuse_idle(&call.line, "compact-box",
                             "on profile, which counts the hits of the whole support");
    if (status < 0 && values.view && split)
        status = fail_usage("--view selects one view; omit --views and --split");
    if (status >= 0)
        return status;
    warn_idle(&call.line,
              "masks|invert-masks|alpha|image-cache|input-colorspace|train-space|white|background",
              "on profile, which reads no images and renders no colours");
    if (values.view || values.orbit || !option_given(&call.line, "split") || values.split == ALL)
        warn_idle(&call.line, "eval|test-every|test-images",
                  "without --split test or --split train");
    interrupt_watch();
    return run_profile(&call.line, &values, &call.common, &data, &drawing);
}
