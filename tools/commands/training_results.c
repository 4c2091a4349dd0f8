// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "commands/training.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "report/scaling_report.h"
#include "run/memory_check.h"
#include "run/run_record.h"
#include "sparegs/runtime.h"

bool training_stopped_early(const training *run)
{
    return run->stop >= SGS_STOP_SIGNAL;
}

const char *training_stop_text(const training *run)
{
    return interrupt_is_request() && run->stop == SGS_STOP_SIGNAL ? "stopped from the viewer"
           : run->stop == SGS_STOP_SIGNAL                         ? "stopped by a signal"
           : run->stop == SGS_STOP_TIME_LIMIT                     ? "stopped by --time-limit"
           : run->stop == SGS_STOP_MEMORY_LIMIT                   ? "stopped by --max-memory"
                                                : sgs_trainer_stop_text(run->trainer);
}

bool training_save(training *run)
{
    const sgs_train_options *options = &run->values.options;
    run->iterations = sgs_trainer_iteration(run->trainer);
    run->gaussians = sgs_trainer_count(run->trainer);
    run->seconds = sgs_trainer_seconds(run->trainer);
    run->bytes = sgs_trainer_bytes(run->trainer);
    run->skipped = sgs_trainer_skipped(run->trainer);
    run->stop_text = format_text("%s", training_stop_text(run));
    const size_t most = run->most_gaussians > run->gaussians ? run->most_gaussians : run->gaussians;
    run->memory_estimate = sgs_train_memory_per_rank(
        run->scene, options, (size_t)run->data.cache_bytes, most, group_count(),
        sgs_train_ray_limit(memory_of_process(run->values.max_memory)));
    const memory_reserve view = memory_of_view(&run->values);
    run->memory_estimate += view.bytes + most * view.row_bytes;
    run->traffic = group_traffic();
    if (sgs_trainer_hash(run->trainer, run->hash)) {
        fail_library();
        return false;
    }
    if (!run->iterations)
        return true;
    bool saved = run_folder_share_trained(&run->folder, run->scene, run->trainer, run->iterations);
    if (run->values.region)
        run->region_count = sgs_trainer_trained(run->trainer);
    run->checkpoint_is_temporary = group_leads() && !training_stopped_early(run) &&
                                   !run->values.checkpoint_every &&
                                   !run_folder_has_checkpoint(&run->folder);
    run->checkpoint_lost = !run_folder_share_checkpoint(&run->folder, run->trainer);
    return saved;
}

drawing_values training_drawing(const training *run)
{
    drawing_values drawing = {.filter = run->values.options.filter,
                              .near_distance = sgs_near_distance(run->scene->extent),
                              .compact_box = run->values.options.compact_box,
                              .space = run->scene->space,
                              .white_point = run->scene->white_point};
    memcpy(drawing.background, run->values.options.background, sizeof drawing.background);
    return drawing;
}

static json_t *summary_json(const training *run)
{
    json_t *summary = json_result_new();
    json_t *seconds =
        run_record_seconds(&run->seconds, run->load_seconds, run->folder.checkpoint_total);
    json_object_set_new(summary, "iterations", json_integer(run->iterations));
    json_object_set_new(summary, "batch", json_integer(run->values.options.batch));
    json_object_set_new(summary, "stop_reason", json_string(run_record_stop_reason(run->stop)));
    json_object_set_new(summary, "stop_text", json_string(run->stop_text));
    json_object_set_new(summary, "gaussians", json_integer((json_int_t)run->gaussians));
    if (run->values.region)
        json_object_set_new(summary, "region_gaussians",
                            json_integer((json_int_t)run->region_count));
    json_object_set_new(summary, "train_seconds", json_number(run->train_seconds));
    json_object_set_new(summary, "wall_seconds", json_number(run->wall_seconds));
    json_object_set_new(summary, "seconds", seconds);
    scaling_add_training(summary, &run->seconds, &run->bytes);
    json_object_set_new(summary, "skipped",
                        json_pack("{s:I, s:I}", "steps", (json_int_t)run->skipped.steps,
                                  "gradients", (json_int_t)run->skipped.gradients));
    json_object_set_new(summary, "test", split_score_json(&run->test));
    json_object_set_new(summary, "train", split_score_json(&run->train));
    json_object_set_new(summary, "threads", json_integer(sgs_threads_get()));
    json_object_set_new(summary, "ranks", json_integer(group_count()));
    if (run->traffic)
        json_object_set(summary, "traffic", run->traffic);
    if (run->per_rank)
        json_object_set(summary, "per_rank", run->per_rank);
    json_object_set_new(summary, "isa", json_string(sgs_isa_name(sgs_isa_get())));
    json_object_set_new(summary, "peak_rss_bytes", json_integer((json_int_t)sgs_rss_peak()));
    json_object_set_new(summary, "memory_estimate_bytes",
                        json_integer((json_int_t)run->memory_estimate));
    json_object_set_new(summary, "model_hash", json_string(run->hash));
    json_object_set_new(summary, "seed", json_integer((json_int_t)run->common.seed));
    json_object_set_new(summary, "version", json_string(sgs_version()));
    json_object_set_new(summary, "commit", json_string(sgs_version_commit()));
    json_set_path(summary, "scene", "%s", run->scene_path);
    json_set_path(summary, "output", "%s", run->values.output);
    if (run->iterations)
        json_set_path(summary, "model", "%s/point_cloud/iteration_%d/point_cloud.ply",
                      run->values.output, run->iterations);
    return summary;
}

bool training_report(training *run)
{
    char *path = format_text("%s/summary.json", run->values.output);
    run->wall_seconds = clock_seconds() - run->started;
    json_t *summary = summary_json(run);
    bool done = write_json(path, json_incref(summary));
    if (done) {
        char *kept = format_text("the run is complete, its result is in %s", path);
        stdout_set_complete(kept);
        free(kept);
    }
    free(path);
    if (run->common.json)
        return print_json(summary) && done;
    json_decref(summary);
    printf("%d iteration%s in %.1f s (this command: %.1f s)%s%s, %zu primitives, "
           "model %s\n",
           run->iterations, run->iterations == 1 ? "" : "s", run->train_seconds, run->wall_seconds,
           *run->stop_text ? ": " : "", run->stop_text, run->gaussians, run->hash);
    split_score_print("held-out images:", &run->test);
    split_score_print("training images:", &run->train);
    rank_clock_print(run->per_rank);
    if (run->iterations)
        printf("%s/point_cloud/iteration_%d/point_cloud.ply\n", run->values.output,
               run->iterations);
    return done;
}
