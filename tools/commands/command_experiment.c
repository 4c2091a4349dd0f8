// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs experiment`: trains the runs of a plan one after the other, each in its own process.
// A run with a summary is not repeated; an interrupted one resumes from its checkpoint.

#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "arguments/shared_options.h"
#include "cli/commands.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "options/options.h"
#include "plan/earlier_results.h"
#include "plan/experiment_plan.h"
#include "plan/run_settings.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "processes/sub_command.h"
#include "run/lock_file.h"
#include "run/rank_work.h"
#include "run/run_folder.h"
#include "run/run_record.h"
#include "sparegs/runtime.h"

static const char description[] =
    "Trains the runs defined by PLAN.json (scenes x pipelines x variants x seeds), one at a time, "
    "into DIR, and updates DIR/results.json and DIR/results.csv after each. The plan is validated "
    "before the first run. --threads and --isa apply to the runs, unless the plan sets them. Steps "
    "of \"post\" prune or compress the trained models and evaluate the "
    "results. Rerun the same command to continue an interrupted experiment. 'sparegs report DIR' "
    "creates tables and an HTML page. Under mpirun or srun, the runs are distributed over the "
    "processes.";

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
    json_t *summary = run_settings_load(run, "summary.json");
    if (run_record_is_complete(summary))
        return summary;
    json_decref(summary);
    return NULL;
}

// Checks that the runs that were started and the results in the folder belong to this plan.
static bool plans_agree(const experiment_plan *plan, const char *folder)
{
    for (size_t i = 0; i < plan->count; ++i)
        if (!run_settings_agree(&plan->runs[i]))
            return false;
    return earlier_results_admit(folder, plan);
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

// Trains in a new process. Returns its status as sub_command_run does.
static int run_training(const experiment_run *run, const char *continuation)
{
    const char **arguments = calloc((size_t)run->argument_count + 2, sizeof *arguments);
    if (!arguments)
        return fail_run("out of memory");
    memcpy(arguments, run->arguments, (size_t)run->argument_count * sizeof *arguments);
    arguments[run->argument_count] = continuation;
    char *log = sub_command_log(run->folder);
    const int status = sub_command_run(arguments, NULL, log); // the summary is read from the file
    free(log);
    free(arguments);
    return status;
}

// The same, with the record of the settings and the session. EXIT_FAILED after printing the error
// if they cannot be recorded.
static int run_session(const experiment_run *run)
{
    const char *continuation = continuation_of(run);
    const bool continues = continuation && !strcmp(continuation, "--resume");
    session_start start;
    if (!run_settings_start(run, continues, &start))
        return EXIT_FAILED;
    const int status = run_training(run, continuation);
    return run_settings_finish(run, &start, run_folder_saved_iteration(run->folder)) ? status
                                                                                     : EXIT_FAILED;
}

// ---- Steps after the training ----

// `summary` must outlive the result.
static post_run post_run_of(const experiment_run *run, const json_t *summary)
{
    const char *hash = json_string_value(json_object_get(summary, "model_hash"));
    return (post_run){.folder = run->folder,
                      .scene_path = run->arguments[1],
                      .model_hash = hash ? hash : "",
                      .threads = experiment_run_argument(run, "threads"),
                      .isa = experiment_run_argument(run, "isa"),
                      .lpips = experiment_run_argument(run, "lpips"),
                      .lpips_input = experiment_run_argument(run, "lpips-input")};
}

// The recorded results of a completed run.
static json_t *post_results(const experiment_plan *plan, const experiment_run *run,
                            const json_t *summary)
{
    json_t *list = json_array();
    const post_run trained = post_run_of(run, summary);
    for (size_t k = 0; k < plan->post.count; ++k) {
        const post_point *point = &plan->post.points[k];
        json_t *result = post_applies(point, run->variant) ? post_result(point, &trained) : NULL;
        if (result)
            json_array_append_new(list, result);
    }
    return list;
}

static char *post_header(void)
{
    return format_text("scene,pipeline,variant,seed,step,point,gaussians,bytes,seconds,"
                       "decode_seconds,psnr,ssim,flip,lpips\n");
}

// Adds a row of post.csv for each result.
static char *post_rows(char *rows, const experiment_run *run, const json_t *results)
{
    static const char *const metrics[] = {"psnr", "ssim", "flip", "lpips"};
    size_t k;
    const json_t *result;
    json_array_foreach(results, k, result)
    {
        rows = append(rows, format_text("%s,%s,%s,%d,%s,%s,%.0f,%.0f,%.6g,", run->scene,
                                        run->pipeline, run->variant, run->seed,
                                        json_string_value(json_object_get(result, "step")),
                                        json_string_value(json_object_get(result, "point")),
                                        json_number_value(json_object_get(result, "gaussians")),
                                        json_number_value(json_object_get(result, "bytes")),
                                        json_number_value(json_object_get(result, "seconds"))));
        const json_t *decode = json_object_get(result, "decode_seconds");
        if (json_is_number(decode))
            rows = append(rows, format_text("%.6g", json_number_value(decode)));
        for (size_t m = 0; m < sizeof metrics / sizeof *metrics; ++m) {
            const json_t *value = json_object_get(json_object_get(result, "test"), metrics[m]);
            rows =
                append(rows, json_is_number(value) ? format_text(",%.6f", json_number_value(value))
                                                   : format_text(","));
        }
        rows = append(rows, format_text("\n"));
    }
    return rows;
}

// Writes the results of all completed runs. Another experiment may have begun another plan in this
// folder since the start.
static bool write_results_locked(const experiment_plan *plan, const char *folder)
{
    if (!plans_agree(plan, folder))
        return false;
    json_t *root = json_result_new(), *list = json_array();
    char *csv = csv_header(), *points = post_header();
    for (size_t i = 0; i < plan->count; ++i) {
        const experiment_run *run = &plan->runs[i];
        json_t *summary = finished(run);
        if (!summary)
            continue;
        const char *name = run->folder + strlen(folder) + 1; // "FOLDER/NAME"
        char *row = csv_row(run, summary), *longer = format_text("%s%s", csv, row);
        free(row);
        free(csv);
        csv = longer;
        json_t *post = post_results(plan, run, summary);
        points = post_rows(points, run, post);
        json_t *entry = json_pack("{s:s,s:s,s:s,s:i,s:s,s:o}", "scene", run->scene, "pipeline",
                                  run->pipeline, "variant", run->variant, "seed", run->seed,
                                  "folder", name, "summary", summary);
        json_t *sessions = run_settings_sessions(run, summary);
        if (sessions)
            json_object_set_new(entry, "sessions", sessions);
        if (plan->post.count)
            json_object_set(entry, "post", post);
        json_decref(post);
        json_array_append_new(list, entry);
    }
    json_object_set(root, "plan", plan->root);
    json_object_set_new(root, "runs", list);
    char *json_path = format_text("%s/results.json", folder),
         *csv_path = format_text("%s/results.csv", folder);
    char *post_path = format_text("%s/post.csv", folder);
    const bool written = write_json(json_path, root) && write_text(csv_path, csv) &&
                         (!plan->post.count || write_text(post_path, points));
    if (written && !plan->post.count)
        earlier_results_drop_post(folder);
    free(json_path);
    free(csv_path);
    free(post_path);
    free(csv);
    free(points);
    return written;
}

// The same. Another experiment with the same plan, which may complete a run now, waits: otherwise
// the older list of runs could replace the newer one. After a request to stop, nothing is written
// while the other one works: the next experiment adds the missing runs.
static bool write_results(const experiment_plan *plan, const char *folder)
{
    int lock;
    char *path = format_text("%s/.results", folder);
    const bool written =
        lock_file_wait(path, &lock) == LOCK_BUSY || write_results_locked(plan, folder);
    if (lock >= 0)
        close(lock);
    free(path);
    return written;
}

// Executes the points that have no result yet. Returns the number of failures.
static int run_post(const experiment_plan *plan, const experiment_run *run, const json_t *summary)
{
    int failed = 0;
    const post_run trained = post_run_of(run, summary);
    for (size_t k = 0; k < plan->post.count && !interrupt_signal(); ++k) {
        const post_point *point = &plan->post.points[k];
        if (!post_applies(point, run->variant))
            continue;
        json_t *result = post_result(point, &trained);
        json_decref(result);
        if (result)
            continue;
        print_note("%s: %s, %s", run->folder, point->step, point->point);
        const int status = post_execute(point, &trained);
        if (!status || interrupt_signal())
            continue;
        ++failed;
        char *fault = sub_command_fault(status);
        print_warning("%s: %s, %s %s; continuing", run->folder, point->step, point->point, fault);
        free(fault);
    }
    return failed;
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

// Locks a run against other experiments with the same plan, such as the jobs of an array. False if
// one of them works on it. If the file system has no locks, only the lock of the training protects
// the run.
static bool lock_run(const experiment_run *run, int *lock)
{
    char *path = format_text("%s/.experiment", run->folder);
    const bool free_to_run = !make_folder(run->folder) || lock_file_take(path, lock) != LOCK_BUSY;
    free(path);
    return free_to_run;
}

// True if a run that is not complete ended at the time limit of the plan.
static bool reached_time_limit(const experiment_run *run)
{
    json_t *summary = run_settings_load(run, "summary.json");
    const char *reason = json_string_value(json_object_get(summary, "stop_reason"));
    const bool reached = reason && !strcmp(reason, run_record_stop_reason(SGS_STOP_TIME_LIMIT));
    json_decref(summary);
    return reached;
}

// Trains, unless the run is complete. Returns its summary, or NULL after a failure, a time limit
// (*limited) or a request to stop.
static json_t *complete_run(const experiment_run *run, bool *limited)
{
    json_t *summary = finished(run);
    int status = EXIT_DONE;
    if (!summary) {
        status = run_session(run);
        summary = finished(run);
    }
    if (summary)
        drop_checkpoint(run); // also one that a stop, or the end of an experiment, has left
    if (!status && summary)
        return summary;
    json_decref(summary);
    if (interrupt_signal())
        return NULL;
    *limited = !status && reached_time_limit(run);
    char *fault = sub_command_fault(status);
    if (status)
        print_warning("%s: training %s; continuing with the remaining runs", run->folder, fault);
    else
        print_warning("%s: %s; rerun the experiment to continue it", run->folder,
                      *limited ? "reached its time limit" : "stopped before its end");
    free(fault);
    return NULL;
}

// Numbers of runs, and of steps after the training.
enum { FAILED_RUNS, LIMITED_RUNS, FAILED_POINTS, OTHERS_RUNS, OTHER_PLANS, COUNTS };

// Adds those of all ranks. False after printing the error.
static bool add_counts(int counts[COUNTS])
{
    int *all = calloc(COUNTS * (size_t)group_count(), sizeof *all);
    if (!all)
        fail_run("out of memory");
    const bool done =
        group_all(all != NULL) &&
        !sgs_ranks_gather(group_ranks(), SGS_STATUS_OK, counts, COUNTS * sizeof *all, all);
    memset(counts, 0, COUNTS * sizeof *counts);
    for (int i = 0; i < COUNTS * group_count() && done && all; ++i)
        counts[i % COUNTS] += all[i];
    free(all);
    return done;
}

// Runs without a result on rank 0.
static size_t count_missing(const experiment_plan *plan)
{
    size_t missing = 0;
    for (size_t i = 0; i < plan->count; ++i) {
        json_t *summary = finished(&plan->runs[i]);
        missing += !summary;
        json_decref(summary);
    }
    return missing;
}

// All ranks have finished their runs. A network file system may show the files of another machine
// later: NFS caches the absence of a file for up to 30 s by default. Writes the results of the runs
// that appear. False after printing the error.
static bool await_results(const experiment_plan *plan, const char *folder)
{
    enum { SECONDS = 60 };
    const size_t at_first = count_missing(plan);
    size_t missing = at_first;
    for (int k = 0; missing && k < SECONDS && !interrupt_signal(); ++k) {
        sleep(1);
        missing = count_missing(plan);
    }
    if (missing < at_first && !write_results(plan, folder))
        return false;
    if (missing)
        fail_run("%s: the results of %zu of %zu runs are missing; rerun the experiment to repeat "
                 "them",
                 folder, missing, plan->count);
    return !missing;
}

typedef enum run_claim {
    CLAIM_TAKEN,
    CLAIM_OTHERS, // another experiment works on the run
    CLAIM_ORPHAN, // so does a training run that an earlier experiment has left
    CLAIM_STOPPED // a request to stop came while waiting
} run_claim;

// For a training run of an earlier experiment: a large checkpoint on a slow disk may take longer.
static int orphan_seconds(void)
{
    enum { SECONDS = 60, MAXIMUM = 86400 };
    const char *text = getenv("SPAREGS_WAIT_SECONDS");
    char *end = NULL;
    const long seconds = text ? strtol(text, &end, 10) : SECONDS;
    return end && (end == text || *end || seconds < 0 || seconds > MAXIMUM) ? SECONDS
                                                                            : (int)seconds;
}

// Waits for a training that an experiment which was killed has left: it saves its state.
static run_claim await_orphan(const experiment_run *run, int seconds)
{
    char *path = format_text("%s/.lock", run->folder);
    bool busy = lock_file_is_busy(path);
    if (busy)
        print_note("%s: waiting up to %d s for a training run left by an earlier experiment",
                   run->folder, seconds);
    for (int k = 0; busy && k < 10 * seconds && !interrupt_signal(); ++k) {
        nanosleep(&(struct timespec){.tv_nsec = 100000000}, NULL);
        busy = lock_file_is_busy(path);
    }
    free(path);
    return interrupt_signal() ? CLAIM_STOPPED : busy ? CLAIM_ORPHAN : CLAIM_TAKEN;
}

// Adds the log of a run to the list, if it has one.
static void add_log(const experiment_run *run, json_t *logs)
{
    char *path = sub_command_log(run->folder);
    if (path)
        json_array_append_new(logs, json_text(path));
    free(path);
}

// ", see LOG" with the first log of all ranks, on rank 0; "" without one. Steals the list.
// Collective.
static char *see_log(json_t *logs)
{
    json_t *all = group_gather_json(logs);
    const char *path = NULL;
    for (size_t r = 0; r < json_array_size(all) && !path; ++r)
        path = json_string_value(json_array_get(json_array_get(all, r), 0));
    char *text = format_text("%s%s", path ? ", see " : "", path ? path : "");
    json_decref(all);
    return text;
}

static void print_run(const experiment_plan *plan, size_t i, const char *state)
{
    const experiment_run *run = &plan->runs[i];
    print_note("run %zu of %zu: %s, %s, %s, seed %d%s", i + 1, plan->count, run->scene,
               run->pipeline, run->variant, run->seed, state);
}

// Trains run i, which is locked, and executes its steps: see do_run.
static bool do_locked_run(const experiment_plan *plan, size_t i, int counts[COUNTS], json_t *logs)
{
    const experiment_run *run = &plan->runs[i];
    if (!run_settings_agree(run)) { // started meanwhile by an experiment with another plan
        ++counts[OTHER_PLANS];
        return false;
    }
    json_t *done = finished(run);
    print_run(plan, i, done ? ": already complete" : "");
    json_decref(done);
    bool limited = false;
    json_t *summary = complete_run(run, &limited);
    const int failures = counts[FAILED_RUNS] + counts[FAILED_POINTS];
    if (!summary)
        counts[limited ? LIMITED_RUNS : FAILED_RUNS] += !interrupt_signal();
    else
        counts[FAILED_POINTS] += run_post(plan, run, summary);
    if (counts[FAILED_RUNS] + counts[FAILED_POINTS] > failures)
        add_log(run, logs);
    const bool complete = summary != NULL;
    json_decref(summary);
    return complete;
}

// Trains run i and executes its steps, unless another experiment does. Counts what is not complete,
// and adds the log of a failure to `logs`. True if it is complete.
static bool do_run(const experiment_plan *plan, size_t i, int counts[COUNTS], json_t *logs)
{
    const experiment_run *run = &plan->runs[i];
    const int seconds = orphan_seconds();
    int lock = -1;
    bool complete = false;
    switch (lock_run(run, &lock) ? await_orphan(run, seconds) : CLAIM_OTHERS) {
    case CLAIM_TAKEN:
        complete = do_locked_run(plan, i, counts, logs);
        break;
    case CLAIM_OTHERS:
        print_run(plan, i, ": in use by another experiment, skipped");
        ++counts[OTHERS_RUNS];
        break;
    case CLAIM_ORPHAN:
        print_warning("%s: a training run still uses this folder after %d s", run->folder, seconds);
        ++counts[FAILED_RUNS];
        break;
    case CLAIM_STOPPED:
        break;
    }
    if (lock >= 0)
        close(lock);
    return complete;
}

// The error of an experiment with runs that failed or reached their time limit.
static int fail_unfinished(const experiment_plan *plan, const char *folder,
                           const int counts[COUNTS], const char *log)
{
    const int failed = counts[FAILED_RUNS], limited = counts[LIMITED_RUNS];
    if (!limited)
        return fail_run("%s: %d of %zu runs failed%s; rerun the experiment to resume or repeat "
                        "them",
                        folder, failed, plan->count, log);
    if (!failed)
        return fail_run("%s: %d of %zu runs reached their time limit; rerun the experiment to "
                        "continue them",
                        folder, limited, plan->count);
    return fail_run("%s: %d of %zu runs failed%s, and %d reached their time limit; rerun the "
                    "experiment to resume or repeat them",
                    folder, failed, plan->count, log, limited);
}

// Exit status of an experiment that no signal ended, on all ranks. log: see see_log.
static int status_of(const experiment_plan *plan, const char *folder, const int counts[COUNTS],
                     const char *log)
{
    if (counts[FAILED_RUNS] || counts[LIMITED_RUNS])
        return fail_unfinished(plan, folder, counts, log);
    if (counts[OTHERS_RUNS] && group_leads())
        print_note("%s: other jobs took %d of %zu runs; the last job to finish completes the "
                   "results",
                   folder, counts[OTHERS_RUNS], plan->count);
    else if (group_leads() && !await_results(plan, folder))
        return EXIT_FAILED;
    return counts[FAILED_POINTS]
               ? fail_run("%s: %d steps after training failed%s; rerun the experiment to repeat "
                          "them",
                          folder, counts[FAILED_POINTS], log)
               : EXIT_DONE;
}

// Warns if the remaining runs will be trained with other numbers of threads, say, than those that
// were started before: their times cannot be compared.
static void warn_of_conditions(const experiment_plan *plan)
{
    const experiment_run *changed = NULL;
    char *change = NULL;
    bool remain = false;
    for (size_t i = 0; i < plan->count && !(remain && change); ++i) {
        json_t *summary = finished(&plan->runs[i]);
        remain = remain || !summary;
        json_decref(summary);
        changed = change ? changed : &plan->runs[i];
        change = change ? change : run_settings_change(changed);
    }
    if (remain && change)
        print_warning("%s: was trained with %s; 'sparegs report' omits changes of time between "
                      "such runs",
                      changed->folder, change);
    free(change);
}

// Run i on rank i modulo their number; rank 0 writes the results. A signal to one rank does not
// interrupt the runs of the others, but all then end with its status.
static int run_all(const experiment_plan *plan, const char *folder)
{
    int counts[COUNTS] = {0};
    json_t *logs = json_array();
    bool written = true;
    const size_t ranks = (size_t)group_count(), rank = (size_t)sgs_ranks_rank(group_ranks());
    if (group_leads())
        warn_of_conditions(plan);
    for (size_t i = rank; i < plan->count && written && !interrupt_signal(); i += ranks) {
        const bool complete = do_run(plan, i, counts, logs);
        written =
            !counts[OTHER_PLANS] && (!complete || !group_leads() || write_results(plan, folder));
    }
    if (!group_all(written) || !add_counts(counts) ||
        (group_leads() && !write_results(plan, folder))) {
        json_decref(logs);
        return EXIT_FAILED;
    }
    char *log = see_log(logs);
    const int status =
        group_stop_requested() ? interrupt_status() : status_of(plan, folder, counts, log);
    free(log);
    return status;
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
        json_array_append_new(runs, json_text(folder));
        if (!json)
            printf("%s\n", folder);
    }
    json_object_set_new(root, "runs", runs);
    if (json)
        return print_json(root);
    json_decref(root);
    return true;
}

static bool describe_runs(FILE *out, const void *context)
{
    const experiment_plan *plan = context;
    fprintf(out, "number of runs: %zu\n", plan->count);
    bool done = true;
    for (size_t i = 0; i < plan->count && done; ++i) {
        char *run = format_text("run %s, plan", plan->runs[i].folder);
        done = rank_work_write_json(out, run, plan->runs[i].settings);
        free(run);
    }
    return done && rank_work_write_json(out, "post", json_object_get(plan->root, "post"));
}

// Options of this command that its runs take. They show their progress on a terminal: in a file,
// their lines would hide those of the experiment, and several ranks would share the terminal.
static void pass_on(const command_line *line, const common_values *common, experiment_plan *plan)
{
    const bool quiet = common->quiet || !isatty(STDERR_FILENO) || group_ranks();
    char *threads = format_text("%d", common->threads);
    for (size_t i = 0; i < plan->count; ++i) {
        if (option_given(line, "threads"))
            experiment_run_add(&plan->runs[i], "threads", threads);
        if (option_given(line, "isa"))
            experiment_run_add(&plan->runs[i], "isa", sgs_isa_name((sgs_isa)common->isa));
        if (quiet)
            experiment_run_add(&plan->runs[i], "quiet", NULL);
    }
    free(threads);
}

static int experiment(const command_line *line, const experiment_values *values,
                      const common_values *common)
{
    const bool json = common->json;
    experiment_plan plan;
    if (!experiment_plan_read(line->operands[0], values->output ? values->output : ".", &plan))
        return EXIT_FAILED;
    pass_on(line, common, &plan);
    int status = EXIT_FAILED;
    if (!rank_work_agrees(&(rank_work){line, NULL, describe_runs, &plan}) ||
        !group_all(!values->output || plans_agree(&plan, values->output))) {
        experiment_plan_free(&plan);
        return status;
    }
    if (values->check)
        status = print_runs(&plan, json) ? EXIT_DONE : EXIT_FAILED;
    else if (values->output && make_folder(values->output) && check_writable(values->output))
        status = group_shares_folder(values->output) ? run_all(&plan, values->output) : EXIT_FAILED;
    if (!values->check && json && status != EXIT_FAILED && !print_results(values->output))
        status = EXIT_FAILED;
    experiment_plan_free(&plan);
    return status;
}

int command_experiment(int argc, char **argv)
{
    command_call call;
    experiment_values values = {0};
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
    if (status < 0 && option_given(&call.line, "seed"))
        status = fail_usage("--seed has no effect on the runs of an experiment; set \"seeds\" in "
                            "the plan");
    if (status < 0 && !values.output && !values.check)
        status =
            fail_usage("experiment requires an output folder, -o DIR; usage: sparegs experiment %s",
                       call.line.synopsis);
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    interrupt_watch();
    return experiment(&call.line, &values, &call.common);
}
