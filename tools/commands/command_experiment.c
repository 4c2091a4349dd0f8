// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs experiment`: runs the trainings of a plan one after the other, each in its own process.
// A run with a summary is not repeated; an interrupted one resumes from its checkpoint.

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include "cli/commands.h"
#include "run/experiment_plan.h"
#include "cli/interrupt.h"
#include "cli/json_file.h"
#include "cli/json_result.h"
#include "cli/options.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/shared_options.h"

static const char description[] =
    "Runs the trainings defined by PLAN.json (scenes x pipelines x variants x seeds), one at a "
    "time, into DIR, and updates DIR/results.json and DIR/results.csv after each. The plan is "
    "validated before the first run. Rerun the same command to continue an interrupted experiment. "
    "'sparegs report DIR' creates tables and an HTML page.";

typedef struct experiment_values {
    const char *output;
    bool check;
} experiment_values;

static const option experiment_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = offsetof(experiment_values, output),
     .argument = "DIR",
     .help = "output folder for runs and results (required without --check)"},
    {.name = "check",
     .kind = OPTION_FLAG,
     .offset = offsetof(experiment_values, check),
     .help = "validate the plan, list its runs and exit"},
};

// The summary of a completed run, or NULL.
static json_t *finished(const experiment_run *run)
{
    char *path = format_text("%s/summary.json", run->folder);
    json_t *summary = json_load_file(path, 0, NULL);
    free(path);
    const char *reason = json_string_value(json_object_get(summary, "stop_reason"));
    if (reason && (!strcmp(reason, "schedule") || !strcmp(reason, "equilibrium")))
        return summary;
    json_decref(summary);
    return NULL;
}

// Options that may change between sessions, because results do not depend on them.
static bool is_free(const char *key)
{
    static const char *const names[] = {"threads",    "isa",        "image-cache",
                                        "max-memory", "time-limit", "checkpoint-every",
                                        "save-at",    "trace"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k)
        if (!strcmp(key, names[k]))
            return true;
    return false;
}

static char *settings_path(const experiment_run *run)
{
    return format_text("%s/experiment.json", run->folder);
}

static bool fail_changed(const experiment_run *run, const char *name, const json_t *old,
                         const json_t *now)
{
    char *was = old ? json_dumps(old, JSON_ENCODE_ANY) : NULL;
    char *is = now ? json_dumps(now, JSON_ENCODE_ANY) : NULL;
    fail_run("%s: was trained with %s %s, but the plan has %s; use another -o DIR, or delete this "
             "folder to train again",
             run->folder, name, was ? was : "none", is ? is : "none");
    free(was);
    free(is);
    return false;
}

static bool same_members(const experiment_run *run, json_t *old, json_t *now)
{
    json_t *all = json_object();
    json_object_update(all, old);
    json_object_update(all, now);
    const char *key;
    json_t *value;
    bool same = true;
    json_object_foreach(all, key, value)
    {
        const json_t *was = json_object_get(old, key), *is = json_object_get(now, key);
        if (!same || is_free(key) || json_equal(was, is))
            continue;
        same = json_is_object(was) && json_is_object(is)
                   ? same_members(run, json_object_get(old, key), json_object_get(now, key))
                   : fail_changed(run, key, was, is);
    }
    json_decref(all);
    return same;
}

// Checks that a run that was started belongs to this plan. (Earlier builds stored no settings.)
static bool plan_agrees(const experiment_run *run)
{
    char *path = settings_path(run);
    json_t *old = json_load_file(path, 0, NULL);
    const bool agrees = !old || same_members(run, old, run->settings);
    json_decref(old);
    free(path);
    return agrees;
}

static bool plans_agree(const experiment_plan *plan)
{
    for (size_t i = 0; i < plan->count; ++i)
        if (!plan_agrees(&plan->runs[i]))
            return false;
    return true;
}

// Records the settings of a run before it starts.
static bool write_settings(const experiment_run *run)
{
    char *path = settings_path(run);
    const bool written = make_folder(run->folder) && write_json(path, json_incref(run->settings));
    free(path);
    return written;
}

static const char *const csv_columns[] = {"iterations", "stop_reason", "gaussians", "train_seconds",
                                          "model_hash"};

// The metrics of test and train, in this order: columns of results.csv.
static const char *const csv_metrics[][2] = {
    {"test", "psnr"},  {"test", "ssim"},      {"train", "psnr"}, {"train", "ssim"},
    {"test", "flip"},  {"test", "sharpness"}, {"train", "flip"}, {"train", "sharpness"},
    {"test", "lpips"}, {"train", "lpips"}};
enum { CSV_METRICS = sizeof csv_metrics / sizeof *csv_metrics };

// Joins two strings from format_text and releases them.
static char *append(char *text, char *added)
{
    char *longer = format_text("%s%s", text, added);
    free(text);
    free(added);
    return longer;
}

static char *csv_row(const experiment_run *run, const json_t *summary)
{
    char *row = format_text("%s,%s,%s,%d", run->scene, run->pipeline, run->variant, run->seed);
    for (size_t k = 0; k < sizeof csv_columns / sizeof *csv_columns; ++k) {
        const json_t *value = json_object_get(summary, csv_columns[k]);
        row = json_is_string(value) ? append(row, format_text(",%s", json_string_value(value)))
                                    : append(row, format_text(",%.9g", json_number_value(value)));
    }
    for (size_t k = 0; k < CSV_METRICS; ++k) {
        const json_t *value =
            json_object_get(json_object_get(summary, csv_metrics[k][0]), csv_metrics[k][1]);
        row = json_is_number(value) ? append(row, format_text(",%.6f", json_number_value(value)))
                                    : append(row, format_text(","));
    }
    return append(row, format_text("\n"));
}

static char *csv_header(void)
{
    char *header = format_text("scene,pipeline,variant,seed");
    for (size_t k = 0; k < sizeof csv_columns / sizeof *csv_columns; ++k)
        header = append(header, format_text(",%s", csv_columns[k]));
    for (size_t k = 0; k < CSV_METRICS; ++k)
        header = append(header, format_text(",%s_%s", csv_metrics[k][0], csv_metrics[k][1]));
    return append(header, format_text("\n"));
}

// Writes the results of all completed runs.
static bool write_results(const experiment_plan *plan, const char *folder)
{
    json_t *root = json_result_new(), *list = json_array();
    char *csv = csv_header();
    for (size_t i = 0; i < plan->count; ++i) {
        const experiment_run *run = &plan->runs[i];
        json_t *summary = finished(run);
        if (!summary)
            continue;
        // NOLINTNEXTLINE(clang-analyzer-core.NonNullParamChecker): set for a plan that runs
        const char *name = run->folder + strlen(folder) + 1; // "FOLDER/NAME"
        char *row = csv_row(run, summary), *longer = format_text("%s%s", csv, row);
        free(row);
        free(csv);
        csv = longer;
        json_array_append_new(list,
                              json_pack("{s:s,s:s,s:s,s:i,s:s,s:o}", "scene", run->scene,
                                        "pipeline", run->pipeline, "variant", run->variant, "seed",
                                        run->seed, "folder", name, "summary", summary));
    }
    json_object_set(root, "plan", plan->root);
    json_object_set_new(root, "runs", list);
    char *json_path = format_text("%s/results.json", folder),
         *csv_path = format_text("%s/results.csv", folder);
    const bool written = write_json(json_path, root) && write_text(csv_path, csv);
    free(json_path);
    free(csv_path);
    free(csv);
    return written;
}

// The option for a run that was started before: --resume with a checkpoint, --overwrite without
// one. NULL for a new run.
static const char *continuation_of(const experiment_run *run)
{
    static const char *const marks[][2] = {{"checkpoint/state.bin", "--resume"},
                                           {"checkpoint/state.previous.bin", "--resume"},
                                           {"config.json", "--overwrite"}};
    const char *chosen = NULL;
    for (size_t k = 0; k < sizeof marks / sizeof *marks && !chosen; ++k) {
        char *path = format_text("%s/%s", run->folder, marks[k][0]);
        if (file_exists(path))
            chosen = marks[k][1];
        free(path);
    }
    return chosen;
}

// Trains in a new process of this program, so that runs share neither memory, threads nor crashes.
// Unlike child_run (child_process.h) it does not redirect stderr, forwards a request to stop and
// waits until the training has saved its state. Returns its exit status.
static int run_training(const experiment_run *run)
{
    const char **arguments = calloc((size_t)run->argument_count + 3, sizeof *arguments);
    if (!arguments)
        return fail_run("out of memory");
    const char *continuation = continuation_of(run);
    if (continuation)
        arguments[run->argument_count + 1] = continuation;
    arguments[0] = "sparegs";
    for (int k = 0; k < run->argument_count; ++k)
        arguments[k + 1] = run->arguments[k];
    fflush(NULL);
    const pid_t child = fork();
    if (child < 0) {
        free(arguments);
        return fail_run("%s: cannot start the training process: %s", run->folder, strerror(errno));
    }
    if (!child) {
        // A new process group: Ctrl-C reaches only this program, which forwards it.
        setpgid(0, 0);
#ifdef __linux__
        prctl(PR_SET_PDEATHSIG, INTERRUPT_PASSED_ON); // if this program is killed
#endif
        if (!freopen("/dev/null", "w", stdout)) // the summary is read from the file
            _exit(EXIT_FAILED);
        execv("/proc/self/exe", (char *const *)arguments);
        _exit(EXIT_FAILED);
    }
    free(arguments);
    int state;
    bool forwarded = false;
    for (pid_t ended; (ended = waitpid(child, &state, WNOHANG)) != child;) {
        if (ended < 0 && errno != EINTR)
            return fail_run("%s: cannot wait for the training process: %s", run->folder,
                            strerror(errno));
        if (interrupt_signal() && !forwarded) {
            forwarded = !kill(child, INTERRUPT_PASSED_ON);
            kill(child, SIGCONT); // a terminal may have suspended it
        }
        nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    }
    return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}

// Deletes the files that a completed run no longer needs.
static void drop_checkpoint(const experiment_run *run)
{
    static const char *const names[] = {"state.bin", "state.previous.bin", "sums.csv"};
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        char *path = format_text("%s/checkpoint/%s", run->folder, names[k]);
        unlink(path);
        free(path);
    }
}

static int run_all(const experiment_plan *plan, const char *folder)
{
    int failed = 0;
    for (size_t i = 0; i < plan->count && !interrupt_signal(); ++i) {
        const experiment_run *run = &plan->runs[i];
        json_t *done = finished(run);
        json_decref(done);
        print_note("run %zu of %zu: %s, %s, %s, seed %d%s", i + 1, plan->count, run->scene,
                   run->pipeline, run->variant, run->seed, done ? ": already complete" : "");
        if (done)
            continue;
        const int status = write_settings(run) ? run_training(run) : EXIT_FAILED;
        if (interrupt_signal())
            break;
        if (status) {
            ++failed;
            print_warning("%s: training failed with status %d; continuing with the remaining runs",
                          run->folder, status);
            continue;
        }
        json_t *summary = finished(run);
        json_decref(summary);
        if (!summary) {
            ++failed;
            print_warning("%s: stopped before its end; rerun the experiment to continue it",
                          run->folder);
            continue;
        }
        drop_checkpoint(run);
        if (!write_results(plan, folder))
            return EXIT_FAILED;
    }
    if (!write_results(plan, folder))
        return EXIT_FAILED;
    if (interrupt_signal())
        return interrupt_status();
    return failed ? fail_run("%s: %d of %zu runs failed; rerun the experiment to repeat them",
                             folder, failed, plan->count)
                  : EXIT_DONE;
}

static bool print_results(const char *folder)
{
    char *path = format_text("%s/results.json", folder);
    json_t *results = read_json(path);
    free(path);
    return results && print_json(results);
}

static bool print_runs(const experiment_plan *plan, bool json)
{
    json_t *root = json_object(), *runs = json_array();
    for (size_t i = 0; i < plan->count; ++i) {
        const char *folder = plan->runs[i].folder;
        json_t *name = json_string(folder);
        json_array_append_new(runs, name ? name : json_null());
        if (!json)
            printf("%s\n", folder);
    }
    json_object_set_new(root, "runs", runs);
    if (json)
        return print_json(root);
    json_decref(root);
    return true;
}

static int experiment(const char *path, const experiment_values *values, bool json)
{
    experiment_plan plan;
    if (!experiment_plan_read(path, values->output ? values->output : ".", &plan))
        return EXIT_FAILED;
    int status = EXIT_FAILED;
    if (values->output && !plans_agree(&plan)) {
        experiment_plan_free(&plan);
        return status;
    }
    if (values->check)
        status = print_runs(&plan, json) ? EXIT_DONE : EXIT_FAILED;
    else if (make_folder(values->output) && check_writable(values->output))
        status = run_all(&plan, values->output);
    if (!values->check && json && status != EXIT_FAILED && !print_results(values->output))
        status = EXIT_FAILED;
    experiment_plan_free(&plan);
    return status;
}

int command_experiment(int argc, char **argv)
{
    command_call call;
    experiment_values values = {0};
    static const char *const own[] = {"seed", "threads", "isa"}; // of the runs
    const command_spec spec = {.name = "experiment",
                               .synopsis = "PLAN.json -o DIR [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Experiment",
                               .options = experiment_options,
                               .option_count =
                                   sizeof experiment_options / sizeof *experiment_options,
                               .values = &values};
    int status = command_parse(&spec, argc, argv, &call);
    for (size_t k = 0; k < sizeof own / sizeof *own && status < 0; ++k)
        if (option_given(&call.line, own[k]))
            status =
                fail_usage("--%s has no effect on the runs of an experiment; set \"%s\" in the "
                           "plan",
                           own[k], k ? own[k] : "seeds");
    if (status < 0 && !values.output && !values.check)
        status =
            fail_usage("experiment requires an output folder, -o DIR; usage: sparegs experiment %s",
                       call.line.synopsis);
    if (status >= 0)
        return status;
    // Threads, instruction set and --quiet belong to the runs: set them in the plan's options.
    messages_set_quiet(call.common.quiet);
    interrupt_watch();
    return experiment(call.line.operands[0], &values, call.common.json);
}
