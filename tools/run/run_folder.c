// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The run folder. state.bin is a complete checkpoint even if the process is killed: the next one is
// written as state.next.bin, the current one is linked as state.previous.bin, and then
// state.next.bin is renamed to state.bin. A row of train.csv counts events since the previous row;
// partial counts at a checkpoint are saved in checkpoint/sums.csv, so that a resumed run writes the
// same table.

#include "run/run_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/run_files.h"
#include "processes/rank_group.h"
#include "run/exposure_file.h"
#include "run/lock_file.h"
#include "sparegs/model_file.h"
#include "sparegs/run.h"
#include "sparegs/runtime.h"

enum { ROW_EVERY = 100 };

static const char train_header[] =
    "iteration,seconds,loss,gaussians,psnr_train,densified,pruned,spare_pruned,rss_bytes";
static const char spare_header[] = "iteration,regions,gaussians,over_budget_share,mean_weight,bmd_"
                                   "suppressed,bmd_boosted,rap_pruned,seconds";

static const char sums_header[] = "iteration,densified,pruned,spare_pruned";

static char *lock_path(const run_folder *folder)
{
    return format_text("%s/.lock", folder->path);
}

// Against the processes of this machine, also where nothing can be written.
static bool lock_folder(run_folder *folder)
{
    const lock_result result = lock_folder_take(folder->path, &folder->lock);
    return lock_admits(folder->path, result, errno);
}

// Against the processes of all machines that share the file system.
static bool lock_shared(run_folder *folder)
{
    char *path = lock_path(folder);
    folder->was_locked = file_exists(path);
    const lock_result result = lock_file_take(path, &folder->shared_lock);
    const int code = errno;
    free(path);
    return lock_admits(folder->path, result, code);
}

bool run_folder_is_used(const run_folder *folder)
{
    char *config = format_text("%s/config.json", folder->path);
    const bool used = file_exists(config);
    free(config);
    return used;
}

// False if the summary is that of a run that was stopped before its first iteration.
static bool summary_has_results(const char *path)
{
    json_error_t error;
    json_t *summary = load_json(path, 0, &error);
    const json_t *iterations = json_object_get(summary, "iterations");
    const bool has = !json_is_integer(iterations) || json_integer_value(iterations) > 0;
    json_decref(summary);
    return has;
}

static bool has_results(const char *folder)
{
    char *clouds = format_text("%s/point_cloud", folder);
    char *summary = format_text("%s/summary.json", folder);
    const bool has = file_exists(clouds) || (file_exists(summary) && summary_has_results(summary));
    free(clouds);
    free(summary);
    return has;
}

bool run_folder_has_results(const run_folder *folder)
{
    return has_results(folder->path);
}

// True if a run can be resumed, also if it was killed while it saved a checkpoint.
static bool has_state(const char *folder)
{
    static const char *const names[] = {"state", "state.next", "state.previous"};
    bool has = false;
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        char *path = format_text("%s/checkpoint/%s.bin", folder, names[k]);
        has = has || file_exists(path);
        free(path);
    }
    return has;
}

bool run_folder_replaces_previous(const run_folder *folder)
{
    return has_results(folder->path) || has_state(folder->path);
}

// The output of a run in a folder without config.json that a new run would replace, or NULL.
static const char *unmarked_entry(const run_folder *folder)
{
    char model[4096];
    int iteration;
    if (!sgs_run_model_path(folder->path, model, sizeof model, &iteration))
        return "models";
    if (has_state(folder->path))
        return "a checkpoint";
    const char *found = NULL;
    for (int k = 0; k < RUN_ENTRIES && !found; ++k) {
        struct stat info;
        char *path = format_text("%s/%s", folder->path, run_entries[k]);
        if (!stat(path, &info) && !S_ISDIR(info.st_mode))
            found = run_entries[k];
        free(path);
    }
    return found;
}

static void unlink_lock(const run_folder *folder)
{
    char *path = lock_path(folder);
    if (folder->shared_lock >= 0)
        unlink(path);
    free(path);
}

bool run_folder_admits(const run_folder *folder, bool overwrite, const char *advice)
{
    const bool used = run_folder_is_used(folder);
    const char *foreign = used || folder->was_locked ? NULL : unmarked_entry(folder);
    if (foreign) {
        fail_run("%s: contains %s, but no config.json: the output of another program; move it "
                 "away, or choose another folder",
                 folder->path, foreign);
        unlink_lock(folder);
        return false;
    }
    if (used && !overwrite)
        fail_run("%s: already contains a run; %s", folder->path, advice);
    return !used || overwrite;
}

// ---- An earlier run ----

static char *previous_path(const run_folder *folder, const char *kind)
{
    return format_text("%s/previous%s", folder->path, kind);
}

// Moves the files of a run from one folder to another. Skips missing entries.
static bool move_run(const char *from, const char *to, bool back)
{
    bool moved = true;
    for (int k = 0; k < RUN_ENTRIES && moved; ++k) {
        const char *entry = run_entries[back ? RUN_ENTRIES - 1 - k : k];
        char *source = format_text("%s/%s", from, entry);
        char *target = format_text("%s/%s", to, entry);
        moved = !rename(source, target) || errno == ENOENT;
        if (!moved)
            fail_run("%s: cannot be moved to %s: %s", source, target, strerror(errno));
        free(source);
        free(target);
    }
    return moved;
}

static int remove_entry(const char *path, const struct stat *info, int kind, struct FTW *place)
{
    (void)info;
    (void)kind;
    (void)place;
    return remove(path);
}

static void remove_tree(const char *path)
{
    if (nftw(path, remove_entry, 16, FTW_DEPTH | FTW_PHYS | FTW_MOUNT) && errno != ENOENT)
        print_warning("%s: cannot be removed: %s", path, strerror(errno));
}

bool run_folder_set_aside(const run_folder *folder)
{
    char *next = previous_path(folder, ".next"), *previous = previous_path(folder, "");
    char *config = format_text("%s/config.json", previous);
    bool moved = !file_exists(previous) || file_exists(config);
    if (!moved)
        fail_run("%s: is not an earlier run and would be replaced by --overwrite; move it away",
                 previous);
    else if (!make_folder(next) || !move_run(folder->path, next, false)) {
        run_folder_restore(folder);
        moved = false;
    }
    free(config);
    free(previous);
    free(next);
    return moved;
}

void run_folder_restore(const run_folder *folder)
{
    char *next = previous_path(folder, ".next");
    for (int k = 0; k < RUN_ENTRIES; ++k) { // removes files of the new run
        char *kept = format_text("%s/%s", next, run_entries[k]);
        char *own = format_text("%s/%s", folder->path, run_entries[k]);
        if (file_exists(kept) && file_exists(own))
            remove_tree(own);
        free(kept);
        free(own);
    }
    if (move_run(next, folder->path, true))
        rmdir(next);
    free(next);
}

bool run_folder_keep_previous(const run_folder *folder)
{
    char *next = previous_path(folder, ".next"), *previous = previous_path(folder, "");
    char *old = format_text("%s/.previous.old", folder->path);
    remove_tree(old);
    const bool stays = file_exists(previous) && !has_results(next) && !has_state(next);
    const bool kept =
        stays || ((!rename(previous, old) || errno == ENOENT) && !rename(next, previous));
    if (stays) {
        remove_tree(next);
        print_note("%s: the replaced run had no results; %s stays", folder->path, previous);
    } else if (kept) {
        remove_tree(old);
        print_note("%s: the earlier run is now in %s", folder->path, previous);
    } else {
        fail_run("%s: cannot be renamed to %s: %s", next, previous, strerror(errno));
    }
    free(next);
    free(previous);
    free(old);
    return kept;
}

// After a process was killed while it moved an earlier run: a complete run goes to OUT/previous, an
// incomplete one back to OUT.
static bool finish_move(const run_folder *folder)
{
    char *next = previous_path(folder, ".next"), *config = format_text("%s/config.json", next);
    bool finished = true;
    if (file_exists(config))
        finished = run_folder_keep_previous(folder);
    else if (file_exists(next))
        run_folder_restore(folder);
    free(next);
    free(config);
    return finished;
}

bool run_folder_prepare(run_folder *folder, const char *path)
{
    *folder = (run_folder){.path = path, .lock = -1, .shared_lock = -1};
    return make_folder(path) && lock_folder(folder) && check_writable(path) &&
           lock_shared(folder) && finish_move(folder);
}

// ---- Temporary files of a killed process ----

// True for NAME.tmp.NUMBER, where NAME is one of the names: a file while it is written.
static bool is_temporary(const char *name, const char *const names[], size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        const size_t length = strlen(names[k]);
        const char *mark = name + length;
        if (!strncmp(name, names[k], length) && !strncmp(mark, ".tmp.", 5) && mark[5] &&
            !mark[5 + strspn(mark + 5, "0123456789")])
            return true;
    }
    return false;
}

static void remove_temporaries(const char *folder, const char *const names[], size_t count)
{
    DIR *stream = opendir(folder);
    for (const struct dirent *entry; stream && (entry = readdir(stream));) {
        struct stat info;
        if (is_temporary(entry->d_name, names, count) &&
            !fstatat(dirfd(stream), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) &&
            S_ISREG(info.st_mode))
            unlinkat(dirfd(stream), entry->d_name, 0);
    }
    if (stream)
        closedir(stream);
}

void run_folder_clean(const run_folder *folder)
{
    static const char *const own[] = {"config.json",   "cameras.json", "input.ply",
                                      "train.csv",     "spare.csv",    "summary.json",
                                      "exposure.json", "regions.bin",  "experiment.json"};
    static const char *const saved[] = {"state.next.bin", "sums.csv"};
    static const char *const models[] = {"point_cloud.ply", "point_cloud_filter_3D.ply",
                                         "exposure.json"};
    static const char iteration[] = "iteration_";
    char *checkpoint = format_text("%s/checkpoint", folder->path),
         *clouds = format_text("%s/point_cloud", folder->path);
    remove_temporaries(folder->path, own, sizeof own / sizeof *own);
    remove_temporaries(checkpoint, saved, sizeof saved / sizeof *saved);
    DIR *stream = opendir(clouds);
    for (const struct dirent *entry; stream && (entry = readdir(stream));) {
        if (strncmp(entry->d_name, iteration, strlen(iteration)))
            continue;
        char *cloud = format_text("%s/%s", clouds, entry->d_name);
        remove_temporaries(cloud, models, sizeof models / sizeof *models);
        free(cloud);
    }
    if (stream)
        closedir(stream);
    free(checkpoint);
    free(clouds);
}

void run_folder_leave(const run_folder *folder)
{
    if (run_folder_is_used(folder) || unmarked_entry(folder))
        return;
    unlink_lock(folder);
    rmdir(folder->path); // fails, as intended, if the folder is not empty
}

// Reads the partial sums saved with the checkpoint of `iteration`.
static void read_sums(run_folder *folder, const char *path, int iteration)
{
    FILE *stream = open_input(path, NULL);
    char line[128];
    while (stream && fgets(line, sizeof line, stream)) {
        int at;
        size_t densified, pruned, spare_pruned;
        if (sscanf(line, "%d,%zu,%zu,%zu", &at, &densified, &pruned, &spare_pruned) == 4 &&
            at == iteration) {
            folder->densified = densified;
            folder->pruned = pruned;
            folder->spare_pruned = spare_pruned;
        }
    }
    if (stream)
        fclose(stream);
}

int run_folder_saved_iteration(const char *path)
{
    char *sums = format_text("%s/checkpoint/sums.csv", path), line[128];
    FILE *stream = open_input(sums, NULL);
    int saved = 0;
    for (int at; stream && fgets(line, sizeof line, stream);)
        saved = sscanf(line, "%d", &at) == 1 ? at : saved;
    if (stream)
        fclose(stream);
    free(sums);
    return saved;
}

bool run_folder_open_tables(run_folder *folder, int iteration, int structure_iteration)
{
    char *train = format_text("%s/train.csv", folder->path),
         *spare = format_text("%s/spare.csv", folder->path);
    char *sums = format_text("%s/checkpoint/sums.csv", folder->path);
    bool opened = make_folder_of(sums) &&
                  (folder->train_csv = csv_open(train, train_header, iteration)) &&
                  (folder->spare_csv = csv_open(spare, spare_header, structure_iteration)) &&
                  (folder->sums_csv = csv_open(sums, sums_header, iteration));
    if (opened && iteration)
        read_sums(folder, sums, iteration);
    free(train);
    free(spare);
    free(sums);
    return opened;
}

void run_folder_close_tables(run_folder *folder)
{
    FILE **const tables[] = {&folder->train_csv, &folder->spare_csv, &folder->sums_csv};
    bool complete = true;
    for (size_t i = 0; i < sizeof tables / sizeof *tables; ++i) {
        if (*tables[i]) {
            const bool failed = ferror(*tables[i]);
            complete = !fclose(*tables[i]) && !failed && complete;
        }
        *tables[i] = NULL;
    }
    if (!complete)
        print_warning("%s: train.csv or spare.csv is incomplete; disk full?", folder->path);
}

void run_folder_record_update(run_folder *folder, const sgs_step_info *info)
{
    folder->densified += info->densified;
    folder->pruned += info->pruned;
    folder->spare_pruned += info->spare_pruned;
    if (!info->regions)
        return;
    fprintf(folder->spare_csv, "%d,%zu,%zu,%.6f,%.6f,%zu,%zu,%zu,%.6f\n", info->structure_iteration,
            info->regions, info->gaussians, info->over_budget_share, info->mean_weight,
            info->bmd_suppressed, info->bmd_boosted, info->spare_pruned, info->spare_seconds);
    fflush(folder->spare_csv);
}

void run_folder_record(run_folder *folder, const sgs_step_info *info, double seconds, bool last)
{
    if (info->iteration % ROW_EVERY && !last)
        return;
    fprintf(folder->train_csv, "%d,%.3f,%.6f,%zu,%.4f,%zu,%zu,%zu,%" PRIu64 "\n", info->iteration,
            seconds, info->loss_average, info->gaussians, info->psnr_average, folder->densified,
            folder->pruned, folder->spare_pruned, sgs_rss_current());
    fflush(folder->train_csv);
    folder->densified = folder->pruned = folder->spare_pruned = 0;
}

static char *model_file(const run_folder *folder, int iteration)
{
    return format_text("%s/point_cloud/iteration_%d/point_cloud.ply", folder->path, iteration);
}

static bool write_inputs(const run_folder *folder, const sgs_scene *scene,
                         const sgs_trainer *trainer)
{
    const float *points;
    const unsigned char *colors;
    const size_t count = sgs_trainer_initial_cloud(trainer, &points, &colors);
    char *cameras = format_text("%s/cameras.json", folder->path);
    char *input = format_text("%s/input.ply", folder->path);
    const bool written = !sgs_scene_write_cameras_json(scene, cameras) &&
                         (!count || !sgs_ply_write_points(input, points, colors, count));
    if (!written)
        fail_library();
    free(cameras);
    free(input);
    return written;
}

// Writes what marks the folder as that of the run, config.json last.
static bool write_mark(const run_folder *folder, const sgs_trainer *trainer)
{
    char *path = format_text("%s/config.json", folder->path);
    const bool written = write_inputs(folder, folder->scene, trainer) &&
                         write_json(path, json_incref(folder->config));
    free(path);
    return written;
}

bool run_folder_mark(run_folder *folder, const sgs_scene *scene, const sgs_trainer *trainer,
                     json_t *config)
{
    folder->config = json_incref(config);
    folder->scene = scene;
    return write_mark(folder, trainer);
}

void run_folder_unmark(run_folder *folder)
{
    json_decref(folder->config);
    folder->config = NULL;
}

// Locks the new folder in place of the one that was moved or removed.
static bool lock_again(run_folder *folder)
{
    const int old[] = {folder->lock, folder->shared_lock};
    folder->lock = folder->shared_lock = -1;
    const bool locked = lock_folder(folder) && lock_shared(folder);
    for (size_t k = 0; k < sizeof old / sizeof *old; ++k)
        if (old[k] >= 0)
            close(old[k]);
    return locked;
}

// Opens tables in the new folder. If that fails, the old ones stay open.
static bool open_tables_again(run_folder *folder, const sgs_trainer *trainer)
{
    run_folder fresh = *folder;
    fresh.train_csv = fresh.spare_csv = fresh.sums_csv = NULL;
    const bool opened = run_folder_open_tables(&fresh, sgs_trainer_iteration(trainer),
                                               sgs_trainer_structure_iteration(trainer));
    run_folder_close_tables(opened ? folder : &fresh);
    if (opened)
        *folder = fresh;
    return opened;
}

// True if OUT is the folder that this run has locked, or if there is no lock.
static bool is_own(const run_folder *folder)
{
    struct stat locked, now;
    return folder->lock < 0 || fstat(folder->lock, &locked) ||
           (!stat(folder->path, &now) && locked.st_dev == now.st_dev &&
            locked.st_ino == now.st_ino);
}

void run_folder_drop_summary(const run_folder *folder)
{
    char *path = format_text("%s/summary.json", folder->path);
    if (is_own(folder) && unlink(path) && errno != ENOENT)
        print_warning("%s: is that of the earlier part of the run, and cannot be removed: %s", path,
                      strerror(errno));
    free(path);
}

// Before each save, of rank 0: OUT may have been moved, emptied or removed since the last one.
// False after printing the error, also if another run is in its place.
static bool keep_marked(run_folder *folder, const sgs_trainer *trainer)
{
    const bool own = is_own(folder), used = folder->config && run_folder_is_used(folder);
    if (!folder->config || (own && used))
        return true;
    if (used) {
        fail_run("%s: was moved during the training, and another run is in its place",
                 folder->path);
        return false;
    }
    if (!folder->was_lost)
        print_warning("%s: was moved or removed during the training; it is created again, without "
                      "the earlier rows of its tables",
                      folder->path);
    folder->was_lost = true;
    return make_folder(folder->path) && (own || lock_again(folder)) &&
           open_tables_again(folder, trainer) && write_mark(folder, trainer);
}

bool run_folder_save_model(const run_folder *folder, const sgs_gaussians *model, int iteration,
                           const sgs_model_write_options *options)
{
    char *path = model_file(folder, iteration);
    bool saved = make_folder_of(path);
    if (saved && sgs_model_write(path, model, options, NULL)) {
        fail_library();
        saved = false;
    }
    free(path);
    return saved;
}

static char *checkpoint_path(const run_folder *folder, const char *kind)
{
    return format_text("%s/checkpoint/state%s.bin", folder->path, kind);
}

// Links `newest` as `previous`, so that `newest` stays in place; renames it where the file system
// has no hard links.
static bool keep_previous(const char *newest, const char *previous)
{
    if ((unlink(previous) && errno != ENOENT) ||
        (link(newest, previous) && errno != ENOENT && rename(newest, previous))) {
        fail_run("%s: cannot be renamed: %s", newest, strerror(errno));
        return false;
    }
    return true;
}

// Of rank 0; the others call sgs_trainer_save_checkpoint.
static bool save_checkpoint(run_folder *folder, const sgs_trainer *trainer)
{
    const double start = clock_seconds();
    char *newest = checkpoint_path(folder, ""), *previous = checkpoint_path(folder, ".previous");
    bool saved = keep_marked(folder, trainer) && make_folder_of(newest);
    // The other ranks save their parts in any case; those of another run stay as they are.
    char *next = checkpoint_path(folder, saved ? ".next" : ".lost");
    fprintf(folder->sums_csv, "%d,%zu,%zu,%zu\n", sgs_trainer_iteration(trainer), folder->densified,
            folder->pruned, folder->spare_pruned);
    fflush(folder->sums_csv);
    const sgs_status status = sgs_trainer_save_checkpoint(trainer, next); // collective
    if (saved && status)
        fail_library();
    saved = saved && !status && keep_previous(newest, previous);
    if (saved && rename(next, newest)) {
        fail_run("%s: cannot be renamed: %s", next, strerror(errno));
        saved = false;
    }
    if (!saved)
        unlink(next);
    free(newest);
    free(next);
    free(previous);
    const double seconds = clock_seconds() - start;
    folder->checkpoint_total += seconds;
    if (!saved)
        return false;
    folder->checkpoint_seconds = fmax(folder->checkpoint_seconds, seconds);
    folder->checkpoint_rate =
        fmax(folder->checkpoint_rate, seconds / (double)sgs_trainer_checkpoint_bytes(trainer));
    folder->checkpoint_at = start + seconds;
    folder->checkpoint_intervals = 0;
    return true;
}

bool run_folder_has_checkpoint(const run_folder *folder)
{
    char *path = checkpoint_path(folder, "");
    const bool exists = file_exists(path);
    free(path);
    return exists;
}

void run_folder_remove_checkpoint(const run_folder *folder)
{
    static const char *const kinds[] = {"", ".previous", ".next"};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
        char *path = checkpoint_path(folder, kinds[k]);
        unlink(path);
        free(path);
    }
}

size_t run_folder_checkpoint_gaussians(const run_folder *folder)
{
    char *path = checkpoint_path(folder, "");
    size_t count = 0;
    if (file_exists(path))
        sgs_checkpoint_gaussians(path, &count); // errors are reported when it is loaded
    free(path);
    return count;
}

// Several ranks load it together later.
static sgs_status check_checkpoint(const char *path, sgs_trainer *trainer)
{
    messages_hear_library(false);
    const sgs_status status = sgs_trainer_check_checkpoint(trainer, path);
    messages_hear_library(true);
    return status;
}

typedef enum checkpoint_state {
    CHECKPOINT_LOADED,
    CHECKPOINT_MISSING,
    CHECKPOINT_DAMAGED,
    CHECKPOINT_UNREADABLE, // now
    CHECKPOINT_REFUSED     // of another run, or out of memory; the error is printed
} checkpoint_state;

static checkpoint_state load_checkpoint(const char *path, sgs_trainer *trainer)
{
    if (!file_exists(path))
        return CHECKPOINT_MISSING;
    const sgs_status status = group_ranks() ? check_checkpoint(path, trainer)
                                            : sgs_trainer_load_checkpoint(trainer, path);
    if (!status)
        return CHECKPOINT_LOADED;
    if (status == SGS_STATUS_FORMAT || status == SGS_STATUS_IO)
        return status == SGS_STATUS_FORMAT ? CHECKPOINT_DAMAGED : CHECKPOINT_UNREADABLE;
    fail_library();
    return CHECKPOINT_REFUSED;
}

// Loads the previous checkpoint in place of the newest one, which `newest_state` prevents.
static checkpoint_state load_previous(const char *newest, checkpoint_state newest_state,
                                      const char *previous, sgs_trainer *trainer, char **loaded)
{
    if (newest_state != CHECKPOINT_MISSING)
        print_warning("%s; trying the previous checkpoint", sgs_last_error());
    const checkpoint_state state = load_checkpoint(previous, trainer);
    if (state == CHECKPOINT_DAMAGED || state == CHECKPOINT_UNREADABLE)
        fail_library();
    if (state == CHECKPOINT_MISSING && newest_state == CHECKPOINT_DAMAGED)
        fail_run("%s: is damaged, and there is no previous checkpoint; start again with "
                 "--overwrite",
                 newest);
    if (state == CHECKPOINT_MISSING && newest_state == CHECKPOINT_UNREADABLE)
        fail_run("%s: cannot be read, and there is no previous checkpoint; make it readable, then "
                 "rerun with --resume",
                 newest);
    if (state != CHECKPOINT_LOADED)
        return state;
    // Otherwise the next checkpoint would keep the damaged one as state.previous.bin.
    const bool replaced = newest_state == CHECKPOINT_DAMAGED && !rename(previous, newest);
    if (replaced)
        print_warning(
            "%s: replaced by the previous checkpoint; the iterations after it are repeated",
            newest);
    else if (newest_state != CHECKPOINT_MISSING)
        print_warning("%s: used instead; the iterations after it are repeated", previous);
    *loaded = format_text("%s", replaced ? newest : previous);
    return state;
}

int run_folder_load_checkpoint(const run_folder *folder, sgs_trainer *trainer, char **loaded)
{
    *loaded = NULL;
    char *newest = checkpoint_path(folder, ""), *previous = checkpoint_path(folder, ".previous");
    const checkpoint_state first = load_checkpoint(newest, trainer);
    checkpoint_state state = first;
    if (first == CHECKPOINT_LOADED)
        *loaded = format_text("%s", newest);
    else if (first != CHECKPOINT_REFUSED)
        state = load_previous(newest, first, previous, trainer, loaded);
    free(newest);
    free(previous);
    if (state == CHECKPOINT_LOADED)
        return 1;
    return first == CHECKPOINT_MISSING && state == CHECKPOINT_MISSING ? 0 : -1;
}

// Adds a step of saving in which all ranks take part, even if an earlier one failed on rank 0,
// which reports the first failure.
static bool saved_too(bool before, sgs_status status)
{
    if (before && status && group_leads())
        fail_library();
    return before && !status;
}

bool run_folder_share_cloud(const run_folder *folder, sgs_trainer *trainer)
{
    char *path = format_text("%s/input.ply", folder->path);
    const bool saved = saved_too(true, sgs_trainer_write_points(trainer, path));
    free(path);
    return saved;
}

bool run_folder_share_trained(run_folder *folder, const sgs_scene *scene, sgs_trainer *trainer,
                              int iteration)
{
    char *path = model_file(folder, iteration);
    char *filtered = format_text("%s/point_cloud/iteration_%d/point_cloud_filter_3D.ply",
                                 folder->path, iteration);
    bool saved = !group_leads() || (keep_marked(folder, trainer) && make_folder_of(path));
    saved = saved_too(saved, sgs_trainer_write_ply(trainer, path));
    if (sgs_trainer_filter_3d(trainer))
        saved = saved_too(saved, sgs_trainer_write_ply_filter_3d(trainer, filtered));
    char *exposure = format_text("%s/exposure.json", folder->path), // of the newest model
        *own = format_text("%s/point_cloud/iteration_%d/exposure.json", folder->path, iteration);
    saved = saved && (!group_leads() || (exposure_write(own, scene, trainer) &&
                                         exposure_write(exposure, scene, trainer)));
    free(exposure);
    free(own);
    free(filtered);
    free(path);
    return saved;
}

bool run_folder_share_checkpoint(run_folder *folder, sgs_trainer *trainer)
{
    return group_leads() ? save_checkpoint(folder, trainer)
                         : !sgs_trainer_save_checkpoint(trainer, NULL);
}

bool run_folder_load_shared(sgs_trainer *trainer, const char *path, int found)
{
    if (!group_ranks() || group_number(found) != 1)
        return true;
    const bool loaded = !sgs_trainer_load_checkpoint(trainer, path);
    if (!loaded && group_leads())
        fail_library();
    return loaded;
}
