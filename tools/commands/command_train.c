// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs train`. The order of steps: check that OUT is writable, load the scene, create the
// trainer, and only then replace the files of an earlier run; train; save the model; free the
// trainer; read the saved model back and evaluate that file on the held-out and training views.

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "arguments/train_record.h"
#include "cli/commands.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "commands/training.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "run/checkpoint_pace.h"
#include "run/evaluate_saved.h"
#include "run/memory_check.h"
#include "run/region_file.h"
#include "run/run_record.h"
#include "run/trace_file.h"
#include "sparegs/rank_check.h"
#include "sparegs/runtime.h"

static const char description[] =
    "Trains 3D Gaussians on SCENE: a folder with a COLMAP model (sparse/0, sparse or "
    "colmap/sparse/0, binary or text) and its images, or with transforms_train.json or "
    "transforms.json (NeRF synthetic, nerfstudio). Writes into OUT:\n  "
    "point_cloud/iteration_N/point_cloud.ply  the model, readable by 3DGS viewers\n  cameras.json, "
    "input.ply, config.json     cameras, initial cloud, options\n  train.csv, spare.csv, "
    "summary.json       training curves and results\n  checkpoint/                              "
    "full state for --resume\nOn SIGINT, SIGTERM, SIGUSR2, SIGXCPU or SIGHUP, train finishes the "
    "current "
    "iteration and saves; a second SIGINT, SIGTERM or SIGHUP exits without saving, but a SIGTERM "
    "within 5 s of the first signal is ignored. On SIGUSR1, it saves a checkpoint and continues. "
    "Under mpirun or srun, several processes train one model, with the same result as one process.";

// ---- Before the first iteration ----

// Reads the plan of --region: box and views of the block.
static bool load_plan(training *run)
{
    const char *path = run->values.region_plan;
    const int block = run->values.region_block;
    if (!path)
        return true;
    if (!block_plan_read(path, &run->plan) || !block_plan_has(&run->plan, path, block))
        return false;
    run->values.options.region = run->plan.boxes[block];
    run->data.kept = block_plan_views(&run->plan, (size_t)block);
    run->data.held_out = NULL; // the record of a run to resume names views of the block only
    return true;
}

static bool load_scene(training *run)
{
    const double start = clock_seconds();
    run->scene = scene_open(run->scene_path, &run->data, true);
    if (!run->scene)
        return false;
    if (run->plan.root && !block_plan_is_of(&run->plan, run->values.region_plan, run->scene))
        return false;
    if (run->values.options.exposure && !scene_names_are_text(run->scene, "exposure.json"))
        return false;
    run->load_seconds = clock_seconds() - start;
    scene_warn_idle(run->scene, &run->data, run->line);
    train_warn_idle(&run->values, run->line);
    const bool random = run->values.options.background_random; // of --opaque, too
    if (run->scene->white_background && !option_set(run->line, "background") && !random)
        for (int c = 0; c < 3; ++c)
            run->values.options.background[c] = 1;
    run->data.white_point = run->scene->white_point; // for config.json: the measured value
    const size_t test = scene_split_count(run->scene, SGS_SPLIT_TEST);
    print_note("%s: %zu training images, %zu held out, %zu points, loaded in %.1f s",
               run->scene_path, run->scene->view_count - test, test, run->scene->point_count,
               run->load_seconds);
    if (run->scene->linear_images)
        print_note("%s: white level %.4g for %zu scene-linear images", run->scene_path,
                   run->scene->white_point, run->scene->linear_images);
    if (run->values.region)
        print_note("%s: mixing the images with renders of the initial model", run->scene_path);
    if (!run->scene->point_count && !run->values.init)
        print_note("%s: no points; starting from %zu random points", run->scene_path,
                   sgs_train_random_points(run->scene, &run->values.options));
    return true;
}

// Estimates the memory of the images and the initial model before loading. It must not exceed
// --max-memory or, without that option, the memory of the machine divided by its ranks.
static bool memory_suffices(const training *run)
{
    messages_hear_library(false); // the same warnings follow when the images are loaded
    scene_values sizes = run->data;
    sizes.headers_only = true; // loading the images checks the files
    sgs_scene *scene = scene_open(run->scene_path, &sizes, false);
    messages_hear_library(true);
    if (!scene)
        return false;
    const size_t continued = run->values.resume ? run_folder_checkpoint_gaussians(&run->folder) : 0;
    const bool suffices = memory_check(scene, &run->values.options, (size_t)run->data.cache_bytes,
                                       memory_first_count(scene, &run->values, continued),
                                       memory_of_view(&run->values), run->values.max_memory);
    sgs_scene_destroy(scene);
    return suffices;
}

static bool show_preparing(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("preparing images", done, total);
    return !interrupt_signal();
}

// Creates the trainer from `init`, which may be NULL. False after printing the error or when a
// signal ended it.
static bool create_from(training *run, sgs_gaussians **init)
{
    sgs_train_options options = run->values.options;
    options.progress = show_preparing;
    progress_work_start();
    const sgs_status status = sgs_trainer_create_from(run->scene, &options, init, &run->trainer);
    progress_end();
    interrupt_note_cancelled(status == SGS_STATUS_CANCELLED);
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    return !status;
}

static bool create_trainer(training *run)
{
    sgs_gaussians *init = NULL;
    bool ready = training_init_read(run, &init);
    // Warnings about the initial model do not apply if a checkpoint replaces it.
    messages_hear_library(!run->values.resume || !run_folder_has_checkpoint(&run->folder));
    ready = ready && create_from(run, &init);
    messages_hear_library(true);
    sgs_gaussians_destroy(init);
    ready = group_all(ready);
    if (ready && sgs_trainer_ranks_set(run->trainer, group_ranks())) {
        ready = false;
        if (group_leads())
            fail_library();
    }
    if (ready)
        sgs_trainer_ray_limit_set(run->trainer,
                                  sgs_train_ray_limit(memory_of_process(run->values.max_memory)));
    if (ready && run->values.max_memory)
        sgs_trainer_memory_limit_set(run->trainer, (size_t)run->values.max_memory,
                                     (size_t)run->data.cache_bytes);
    const memory_reserve view = memory_of_view(&run->values);
    if (ready)
        sgs_trainer_memory_reserve_set(run->trainer, view.bytes, view.row_bytes);
    return ready;
}

// Finds the checkpoint of --resume; one process loads it. 1 if found, 0 if not, -1 on failure.
static int find_checkpoint(training *run, const char *config_path, json_t *config)
{
    if (!run->values.resume)
        return 0;
    if (!run_record_split_agrees(config_path, run->stored, run->scene) ||
        !train_config_agrees(config_path, run->stored, config, &run->values.options))
        return -1;
    const int found = run_folder_load_checkpoint(&run->folder, run->trainer, &run->checkpoint);
    const bool replaces = found > 0 && !run->values.region;
    if (found < 0 || !run_record_init_agrees(config_path, run->stored, config, replaces))
        return -1;
    if (!found && (run->init_is_replaced || run_folder_has_results(&run->folder))) {
        fail_run("%s: no checkpoint to resume from: checkpoint/state.bin does not exist; start "
                 "again with --overwrite",
                 run->values.output);
        return -1;
    }
    if (!found)
        print_note("%s: no checkpoint yet; starting at iteration 0", run->values.output);
    return found;
}

// config.json of this run. Call once the trainer exists.
static json_t *config_of(const training *run)
{
    json_t *config = train_config(run->scene_path, &run->values, &run->data, &run->common);
    const double limit = run->values.time_limit;
    json_object_set_new(config, "checkpoint_every_given",
                        json_boolean(option_set(run->line, "checkpoint-every")));
    json_object_set_new(config, "image_cache", json_integer((json_int_t)run->data.cache_bytes));
    json_object_set_new(config, "max_memory", json_integer((json_int_t)run->values.max_memory));
    json_object_set_new(config, "time_limit", limit >= 0 ? json_number(limit) : json_null());
    json_object_set_new(config, "trace", json_text(run->values.trace));
    json_object_set_new(config, "view", json_text(run->values.view));
    json_object_set_new(config, "view_share",
                        run->values.view ? json_number(run->values.view_share) : json_null());
    json_object_set_new(config, "near_distance",
                        json_number(sgs_near_distance(run->scene->extent)));
    run_record_milestones(config, run->trainer, run->scene);
    run_record_split(config, run->scene);
    if (run->values.init)
        json_object_set_new(config, "init_hash", json_string(run->init_hash));
    if (run->plan.root)
        block_plan_record(&run->plan, run->values.region_plan, run->values.region_block, config);
    return config;
}

// Moves an earlier run away and writes the first files, config.json last: it marks OUT as a run. If
// writing fails, the earlier run is restored.
static bool begin_run(training *run, json_t *config)
{
    const bool replaces = !run->values.resume && run_folder_is_used(&run->folder);
    if (replaces && !run_folder_set_aside(&run->folder))
        return false;
    const bool written = run_folder_mark(&run->folder, run->scene, run->trainer, config);
    if (!replaces)
        return written;
    if (!written)
        run_folder_restore(&run->folder);
    return written && run_folder_keep_previous(&run->folder);
}

// Of rank 0, which alone uses the folder.
static bool open_own_folder(training *run, json_t *config, bool resumed)
{
    const int iteration = sgs_trainer_iteration(run->trainer),
              structure = sgs_trainer_structure_iteration(run->trainer);
    if (resumed) {
        train_config_record(run->values.output, run->stored, config, iteration);
        print_note("%s: resuming at iteration %d", run->values.output, iteration);
    }
    return begin_run(run, config) && run_folder_open_tables(&run->folder, iteration, structure) &&
           region_file_cut(run->values.output, structure);
}

static bool open_folder(training *run)
{
    char *config_path = format_text("%s/config.json", run->values.output);
    if (group_leads())
        training_init_follow(run);
    json_t *config = group_leads() ? config_of(run) : NULL;
    const int found = group_leads() ? find_checkpoint(run, config_path, config) : 0;
    bool ready =
        group_all(found >= 0) && run_folder_load_shared(run->trainer, run->checkpoint, found);
    ready = group_all(ready && (!group_leads() || open_own_folder(run, config, found == 1)));
    if (ready && run->values.init && !sgs_trainer_iteration(run->trainer))
        ready = group_all(run_folder_share_cloud(&run->folder, run->trainer));
    run->train_seconds = ready ? sgs_trainer_seconds(run->trainer).total : 0;
    json_decref(config);
    free(config_path);
    free(run->checkpoint);
    return ready;
}

// ---- The iterations ----

static bool is_save_point(const training *run, int iteration)
{
    for (int i = 0; i < run->values.save_at.count; ++i)
        if (run->values.save_at.values[i] == iteration)
            return true;
    return false;
}

// Saves a checkpoint if it is due or was requested. A failure is only a warning: the disk may have
// space again later.
static void save_checkpoint(training *run, int iteration, bool due)
{
    const bool asked = group_taken(GROUP_CHECKPOINT, group_leads() && interrupt_take_checkpoint());
    if (!asked && !due)
        return;
    if (!run_folder_share_checkpoint(&run->folder, run->trainer))
        print_warning("the checkpoint of iteration %d was not saved; training continues",
                      iteration);
    else if (asked)
        print_note("%s: saved a checkpoint at iteration %d", run->values.output, iteration);
}

// Whether a periodic checkpoint is saved now. Rank 0, which saves it, decides for all.
static bool checkpoint_is_due(training *run, int iteration)
{
    const int every = run->values.checkpoint_every;
    if (!every || iteration % every)
        return false;
    const double now = clock_seconds();
    const checkpoint_pace pace = {.elapsed = now - run->iterating_since,
                                  .spent = run->folder.checkpoint_total,
                                  .age =
                                      now - fmax(run->folder.checkpoint_at, run->iterating_since),
                                  .intervals = ++run->folder.checkpoint_intervals};
    return group_number(option_set(run->line, "checkpoint-every") || checkpoint_pace_allows(&pace));
}

// Periodic saves, except after the last iteration.
static void save_due(training *run, int iteration)
{
    if (is_save_point(run, iteration) &&
        !run_folder_share_trained(&run->folder, run->scene, run->trainer, iteration))
        print_warning("the model of iteration %d was not saved; training continues", iteration);
    save_checkpoint(run, iteration, checkpoint_is_due(run, iteration));
}

// Seconds that one more iteration and saving may take.
static double time_needed(const training *run)
{
    const double slow_disk = 1e-8; // seconds per byte, before the first checkpoint
    const size_t bytes = run->trainer ? sgs_trainer_checkpoint_bytes(run->trainer) : 0;
    const double expected = (double)bytes * fmax(run->folder.checkpoint_rate, slow_disk);
    return run->longest_step + 2 * fmax(run->folder.checkpoint_seconds, expected) + 1;
}

static bool time_is_up(const training *run)
{
    const double spent = clock_seconds() - run->started;
    return run->values.time_limit >= 0 && run->values.time_limit < spent + time_needed(run);
}

// True, after printing the error, if the time limit leaves no time for the first iteration.
static bool has_no_time(const training *run)
{
    if (!time_is_up(run))
        return false;
    fail_run(
        "%s: --time-limit %gs leaves no time for an iteration: at least %.0f s are required "
        "including loading and saving; nothing was trained; allow more time, or omit --time-limit",
        run->values.output, run->values.time_limit,
        ceil(clock_seconds() - run->started + time_needed(run)));
    return true;
}

static void record_update(training *run, const sgs_step_info *info)
{
    const sgs_regions regions = sgs_trainer_regions(run->trainer);
    if (regions.iteration == info->structure_iteration)
        region_file_append(run->values.output, &regions);
    run_folder_record_update(&run->folder, info);
}

// Handles a failed step. Saves the state if it is whole on all ranks, as after an unreadable
// photo.
static bool give_up(training *run, const sgs_step_info *info, bool whole)
{
    char *reason = format_text("%s", sgs_last_error());
    const int iteration = sgs_trainer_iteration(run->trainer);
    whole = whole && iteration;
    progress_end();
    if (whole && info->structural && group_leads())
        record_update(run, info);
    const bool saved = whole && run_folder_share_checkpoint(&run->folder, run->trainer);
    if (whole)
        run_folder_share_trained(&run->folder, run->scene, run->trainer, iteration);
    if (saved)
        fail_run("%s; saved a checkpoint at iteration %d: fix this, then rerun with --resume",
                 reason, iteration);
    else
        fail_run("%s", reason);
    free(reason);
    return false;
}

// True if the process exceeds --max-memory in spite of the estimates; the run then ends.
static bool exceeds_memory(const training *run)
{
    return run->values.max_memory && sgs_rss_current() > run->values.max_memory;
}

// Whether to stop before the next iteration; the same on all ranks. Only rank 0 reads the clock.
static sgs_stop_reason stop_requested(const training *run)
{
    if (group_stop_requested())
        return SGS_STOP_SIGNAL;
    if (sgs_trainer_iteration(run->trainer) >= run->values.options.iterations)
        return SGS_STOP_SCHEDULE; // resumed from a checkpoint of the last iteration
    if (group_requested(GROUP_TIME, group_leads() && run->longest_step > 0 && time_is_up(run)))
        return SGS_STOP_TIME_LIMIT;
    if (group_requested(GROUP_MEMORY, run->longest_step > 0 && exceeds_memory(run)))
        return SGS_STOP_MEMORY_LIMIT;
    return SGS_STOP_NONE;
}

// Tables and progress, of rank 0.
static void record_step(training *run, trace_file *trace, double start,
                        const sgs_train_seconds *before, const sgs_step_info *info)
{
    if (trace)
        trace_step(trace, run->trainer, start, before, info);
    if (info->structural)
        record_update(run, info);
    run_folder_record(&run->folder, info, run->train_seconds, run->stop != SGS_STOP_NONE);
    progress_step(&(progress_state){info->iteration, run->values.options.iterations,
                                    info->loss_average, info->psnr_average, info->gaussians});
}

// Makes the model whole for the viewer on rank 0. After a failure, of which all ranks learn, the
// training continues, and pages keep the model that they show. Collective.
static bool collect_for_view(training *run)
{
    if (run->view_lost)
        return false;
    if (!sgs_trainer_collect(run->trainer))
        return true;
    print_warning("%s: training continues %s: %s", run->values.output,
                  run->view ? "without newer models in the viewer" : "without the viewer",
                  sgs_last_error());
    run->view_lost = true;
    group_recover(true); // a failed copy leaves the trainer whole
    return false;
}

// The viewer of rank 0. Several ranks save what it requests after a pause.
static void show_step(training *run, const sgs_step_info *info)
{
    if (group_taken(GROUP_VIEW, group_leads() && training_view_wants(run->view)))
        collect_for_view(run);
    if (!group_leads())
        return;
    training_view_step(run->view, info, run->trainer);
    while (training_view_holds(run->view, run->trainer) && !interrupt_signal() && !time_is_up(run))
        if (!group_ranks())
            save_checkpoint(run, info->iteration, false);
}

// One iteration. False after a failure, which is printed.
static bool iterate_once(training *run, trace_file *trace)
{
    sgs_step_info info = {0};
    const double start = clock_seconds();
    const sgs_train_seconds before = sgs_trainer_seconds(run->trainer);
    rank_clock_start(&run->clock);
    const sgs_status status = sgs_trainer_step(run->trainer, &info);
    const double spent = clock_seconds() - start;
    rank_clock_stop(&run->clock, spent,
                    run->own_iterations++ >= (int)scene_split_count(run->scene, SGS_SPLIT_TRAIN));
    run->train_seconds += spent;
    run->longest_step = spent > run->longest_step ? spent : run->longest_step;
    if (status == SGS_STATUS_LIMIT && *sgs_trainer_stop_text(run->trainer)) {
        run->stop = SGS_STOP_EQUILIBRIUM; // resumed from a checkpoint made in equilibrium
        print_note("%s: the run ended in equilibrium at iteration %d of %d; to continue it, "
                   "change --spare-eps-loss, --spare-eps-count or --spare-patience, or leave "
                   "edt out of --spare",
                   run->values.output, sgs_trainer_iteration(run->trainer),
                   run->values.options.iterations);
        return true;
    }
    const bool whole = !status || group_recover(sgs_trainer_is_consistent(run->trainer));
    if (status == SGS_STATUS_OUT_OF_MEMORY && sgs_trainer_update_refused(run->trainer) && whole) {
        run->stop = SGS_STOP_MEMORY_LIMIT;
        return true;
    }
    if (status)
        return give_up(run, &info, whole);
    run->stop = info.stop;
    run->most_gaussians =
        info.gaussians > run->most_gaussians ? info.gaussians : run->most_gaussians;
    if (run->stop == SGS_STOP_NONE && !group_ranks() && exceeds_memory(run))
        run->stop = SGS_STOP_MEMORY_LIMIT;
    if (group_leads())
        record_step(run, trace, start, &before, &info);
    if (group_leads() && run->values.resume && run->own_iterations == 1)
        run_folder_drop_summary(&run->folder);
    if (run->stop == SGS_STOP_NONE)
        save_due(run, info.iteration);
    show_step(run, &info);
    return true;
}

static bool iterate(training *run, trace_file *trace)
{
    progress_start(sgs_trainer_iteration(run->trainer));
    run->iterating_since = clock_seconds();
    bool done = true;
    while (done && run->stop == SGS_STOP_NONE) {
        run->stop = stop_requested(run);
        if (run->stop != SGS_STOP_NONE)
            break;
        done = run->own_iterations || group_all(!group_leads() || !has_no_time(run));
        done = done && iterate_once(run, trace);
    }
    progress_end();
    if (done)
        training_view_finish(run->view, run->trainer);
    return done;
}

// Shows the model that was saved, if the command continues with the evaluation. Collective.
static void show_last(training *run)
{
    if (!run->values.view || training_stopped_early(run))
        return;
    collect_for_view(run);
    training_view_show_last(run->view, run->trainer);
}

// ---- After the last iteration ----

static bool evaluate(training *run)
{
    const saved_evaluation input = {.output = run->values.output,
                                    .iterations = run->iterations,
                                    .scene = run->scene,
                                    .train_most = (size_t)run->values.eval_train,
                                    .drawing = training_drawing(run),
                                    .has_exposure = run->values.options.exposure,
                                    .lpips = run->lpips,
                                    .lpips_input = (sgs_lpips_input)run->values.lpips_input};
    const bool done = evaluate_saved(&input, &run->test, &run->train);
    if (done &&
        (run->test.is_stopped || run->train.is_stopped)) { // --resume repeats the evaluation
        run->stop = SGS_STOP_SIGNAL;
        free(run->stop_text);
        run->stop_text = format_text("%s", training_stop_text(run));
    }
    return done;
}

// Claims OUT. False after printing the error.
static bool claim_folder(training *run)
{
    const train_values *values = &run->values;
    return run_record_claim(&run->folder, values->output, values->resume, values->overwrite,
                            &run->stored);
}

// The config of the run to resume, for all ranks.
static bool share_config(training *run)
{
    if (!run->values.resume)
        return true;
    run->stored = group_json(run->stored);
    return group_all(run->stored != NULL);
}

// What follows from the values of all options. Returns -1 to continue, or an exit status.
static int resolve_values(training *run, const command_line *line)
{
    train_resolve(&run->values, line, run->common.seed);
    const int status = train_region_resolve(&run->values);
    return status < 0 ? train_values_check(&run->values, line) : status;
}

// Completes the options of --resume from the config of the run. Returns -1 to continue, or an exit
// status.
static int recall_options(training *run)
{
    command_line *line = run->line;
    if (!run->values.resume)
        return -1;
    char *path = format_text("%s/config.json", run->values.output);
    const bool recalled = train_config_recall(line, path, run->stored, &run->values, &run->data);
    free(path);
    if (!recalled)
        return EXIT_FAILED;
    run->data.held_out = json_object_get(run->stored, "test_images");
    training_init_recall(run);
    const int status = command_line_check_needs(line);
    return status < 0 ? resolve_values(run, line) : status;
}

static void print_stopped(const training *run)
{
    print_warning("%s: stopped before the first iteration; nothing was written",
                  run->values.output);
}

// Whether all ranks, which score different images, score alike. The trainer compares the images.
static bool same_scoring(const training *run)
{
    const train_values *values = &run->values;
    return !group_ranks() ||
           group_same_text(format_text(
               "--lpips-input: %s\ncontent of the file of --lpips: %016" PRIx64 "\nwhite: %.17g\n",
               values->lpips_input == SGS_LPIPS_SIGNED ? "signed" : "unit",
               values->lpips ? sgs_rank_file_digest(values->lpips) : 0, run->scene->white_point));
}

// Prepares OUT, the scene and the trainer. Returns -1 to continue, or an exit status.
static int prepare(training *run)
{
    const bool claimed =
        group_same_options(run->line, "resume|checkpoint-every|save-at|view") &&
        (!group_leads() || (!has_no_time(run) && training_view_is_possible(run->values.view) &&
                            (!run->values.trace || check_output(run->values.trace)) &&
                            claim_folder(run) && training_init_stays(run)));
    if (!group_all(claimed) || !share_config(run))
        return EXIT_FAILED;
    const int recalled = recall_options(run);
    if (!group_all(recalled < 0))
        return recalled < 0 ? EXIT_FAILED : recalled;
    scene_share_memory(&run->data, run->line, run->values.max_memory);
    bool loaded = load_plan(run) && memory_suffices(run) && load_scene(run) &&
                  evaluate_lpips(run->values.lpips, run->scene, &run->lpips);
    loaded = group_all(loaded) && same_scoring(run);
    if (loaded && group_stop_requested()) {
        print_stopped(run);
        if (group_leads())
            run_folder_leave(&run->folder);
        return interrupt_status();
    }
    loaded = loaded && create_trainer(run);
    if (interrupt_was_cancelled())
        print_stopped(run);
    if (loaded && group_all(!group_leads() || !has_no_time(run)))
        return open_folder(run) ? -1 : EXIT_FAILED;
    if (group_leads())
        run_folder_leave(&run->folder);
    return EXIT_FAILED;
}

// Starts the viewer of --view. False after printing the error.
static bool open_view(training *run)
{
    const train_values *values = &run->values;
    const bool limited = values->max_memory > 0;
    const training_view_options options = {.place = values->view,
                                           .token = values->view_token,
                                           .share = values->view_share / 100,
                                           .folder = values->output,
                                           .drawing = training_drawing(run),
                                           .scene = run->scene,
                                           .total = values->options.iterations,
                                           .picture_bytes = limited ? VIEW_PICTURE_BYTES : 0,
                                           .photo_bytes = limited ? VIEW_PHOTO_BYTES : 0,
                                           .has_regions = values->options.spare != 0,
                                           .prints_to_stderr = run->common.json};
    run->view = values->view ? training_view_open(&options, run->trainer) : NULL;
    return !values->view || run->view;
}

// Iterates, saves the results and frees the trainer. A trace that cannot be written is the last
// step and loses nothing else; group_close passes its failure on to the other ranks.
static bool iterate_and_save(training *run)
{
    const bool traces = run->values.trace && group_leads();
    trace_file *trace = traces ? trace_open(run->values.trace) : NULL;
    const bool opened = !traces || trace;
    const bool viewed = run->values.view && collect_for_view(run);
    const bool iterated =
        group_all(opened && (!group_leads() || !viewed || open_view(run))) && iterate(run, trace);
    const bool done = group_all(iterated) && group_all(training_save(run));
    if (done)
        show_last(run);
    run->trace_lost = !trace_close(trace, iterated);
    if (group_leads())
        run_folder_close_tables(&run->folder);
    sgs_trainer_destroy(run->trainer);
    run->trainer = NULL;
    return done;
}

static int train(training *run)
{
    const int status = prepare(run);
    if (status >= 0)
        return status;
    bool done = iterate_and_save(run);
    if (done && !training_stopped_early(run))
        done = evaluate(run);
    if (done)
        run->per_rank = rank_clock_json(&run->clock, run->train_seconds);
    if (done && !run->checkpoint_lost && run->stop == SGS_STOP_TIME_LIMIT)
        print_note("%s: reached the time limit at iteration %d of %d; continue with --resume",
                   run->values.output, run->iterations, run->values.options.iterations);
    if (!done)
        return EXIT_FAILED;
    if (!group_leads())
        return interrupt_status();
    if (!training_report(run) || run->checkpoint_lost)
        return EXIT_FAILED;
    if (run->checkpoint_is_temporary && run->stop != SGS_STOP_SIGNAL)
        run_folder_remove_checkpoint(&run->folder);
    if (run->stop == SGS_STOP_MEMORY_LIMIT)
        return fail_run("%s: the next iterations of %zu primitives may exceed --max-memory; "
                        "saved a checkpoint at iteration %d: rerun with --resume and a larger "
                        "--max-memory, or with --max-gaussians",
                        run->values.output, run->gaussians, run->iterations);
    return run->trace_lost ? EXIT_FAILED : interrupt_status();
}

enum { GROUP_COUNT = TRAIN_GROUP_COUNT + 2 };

// Describes the options of `train` in `groups` and `line`.
static void describe_line(training *run, option_group groups[GROUP_COUNT], command_line *line)
{
    train_groups(&run->values, groups);
    groups[TRAIN_GROUP_COUNT] = scene_group(&run->data);
    groups[TRAIN_GROUP_COUNT + 1] = common_group(&run->common, "train");
    *line = (command_line){.command = "train",
                           .synopsis = "SCENE -o OUT [options]",
                           .description = description,
                           .groups = groups,
                           .group_count = GROUP_COUNT,
                           .operand_minimum = 1,
                           .operand_maximum = 1,
                           .fills = "resume",
                           .allow_idle = line->allow_idle};
}

// Parses the command line into `run`. Returns -1 to continue, or an exit status.
static int parse_line(training *run, option_group groups[GROUP_COUNT], command_line *line, int argc,
                      char **argv)
{
    describe_line(run, groups, line);
    int status = command_line_parse(line, argc, argv);
    if (status < 0)
        status = scene_resolve(&run->data, line, NULL);
    if (status < 0)
        status = train_scene_check(&run->data);
    if (status < 0)
        status = train_output_check(&run->values, line);
    const char *problem = training_view_check(run->values.view, run->values.view_token);
    if (status < 0 && problem)
        status = fail_usage("%s", problem);
    // --resume completes the options later.
    return status < 0 && !run->values.resume ? resolve_values(run, line) : status;
}

int command_train_check(int argc, char **argv, const char **idle)
{
    training run = {0};
    option_group groups[GROUP_COUNT];
    command_line line = {.allow_idle = idle != NULL};
    const int status = parse_line(&run, groups, &line, argc, argv);
    if (idle)
        *idle = line.idle;
    free(run.values.region_plan);
    return status;
}

const option *command_train_option(const char *name)
{
    training run = {0};
    option_group groups[GROUP_COUNT];
    command_line line = {0};
    describe_line(&run, groups, &line);
    return find_option(&line, name);
}

int command_train(int argc, char **argv)
{
    training run = {.started = clock_seconds()};
    option_group groups[GROUP_COUNT];
    command_line line = {0};
    int status = parse_line(&run, groups, &line, argc, argv);
    if (status < 0)
        status = common_apply(&run.common, &line);
    if (status >= 0)
        return status;
    run.line = &line;
    run.scene_path = line.operands[0];
    interrupt_watch();
    status = train(&run);
    training_view_close(run.view);
    sgs_trainer_destroy(run.trainer);
    sgs_scene_destroy(run.scene);
    sgs_lpips_destroy(run.lpips);
    run_folder_unmark(&run.folder);
    json_decref(run.stored);
    json_decref(run.traffic);
    json_decref(run.per_rank);
    block_plan_free(&run.plan);
    free(run.values.region_plan);
    free(run.values.region_text);
    free(run.stop_text);
    free(run.init_moved);
    return status;
}
