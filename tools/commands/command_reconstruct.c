// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs reconstruct`: estimates cameras of photos with COLMAP as a child process, in three
// stages: features, matches, models. SCENE/colmap/state.json records the completed stages and their
// inputs, so that an interrupted run resumes. The model with the most images becomes
// SCENE/sparse/0, where `train` looks for it.
//
// COLMAP's own files stay in SCENE/colmap: database, logs, all models.

#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "arguments/shared_options.h"
#include "cli/commands.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/resolved_path.h"
#include "processes/child_process.h"
#include "processes/interrupt.h"
#include "run/lock_file.h"
#include "run/reconstructed_scene.h"
#include "sparegs/image.h"
#include "sparegs/runtime.h"

static const char description[] =
    "Estimates the cameras of the photos in the folder PHOTOS with COLMAP (the program "
    "`colmap`, 3.8 or newer, must be installed) and prepares SCENE for `sparegs train`: "
    "SCENE/images is a link to the photos, SCENE/sparse/0 is the model, SCENE/colmap holds "
    "the database and logs. Needs neither a display nor a GPU. An interrupted run resumes after "
    "the last completed stage. If SCENE/sparse/0 or SCENE/images exists and was not created by "
    "this command, it refuses to start.";

typedef struct reconstruct_values {
    const char *output, *colmap, *camera_model;
    int matcher, cameras;
} reconstruct_values;

enum { MAX_EXHAUSTIVE = 150, MATCHER_AUTO = 0, MATCHER_EXHAUSTIVE = 1, MAX_DEPTH = 8 };

static const option reconstruct_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = offsetof(reconstruct_values, output),
     .argument = "SCENE",
     .help = "scene folder to create (required)"},
    {.name = "matcher",
     .kind = OPTION_CHOICE,
     .offset = offsetof(reconstruct_values, matcher),
     .argument = "auto|exhaustive|sequential",
     .initial = "auto",
     .shown = "auto: exhaustive for up to 150 photos",
     .help = "match all pairs of photos, or neighbours in the order of their names (video)"},
    {.name = "camera-model",
     .kind = OPTION_TEXT,
     .offset = offsetof(reconstruct_values, camera_model),
     .argument = "MODEL",
     .initial = "OPENCV",
     .help = "COLMAP camera model: SIMPLE_RADIAL, OPENCV, OPENCV_FISHEYE, ..."},
    {.name = "cameras",
     .kind = OPTION_CHOICE,
     .offset = offsetof(reconstruct_values, cameras),
     .argument = "auto|shared|own",
     .initial = "auto",
     .shown = "auto: shared if all photos have the same size",
     .help = "one camera for all photos, or one per photo"},
    {.name = "colmap",
     .kind = OPTION_TEXT,
     .offset = offsetof(reconstruct_values, colmap),
     .argument = "PROGRAM",
     .initial = "colmap",
     .help = "name or path of the program"},
};

typedef struct reconstruction {
    const reconstruct_values *values;
    const char *photos; // as given
    char *photos_path;  // absolute
    char *work, *database, *models, *state_path, *list_path;
    FILE *list;  // names of the photos, a line each, for COLMAP
    char *names; // its text
    size_t name_bytes;
    size_t count;       // photos
    size_t unread;      // photos in other formats
    char *first_unread; // name
    int width, height;  // of all photos, or 0 if they differ
    // {"made_from": ..., "stages": [...], "kept": [...]}: `kept` has the digests of the models that
    // may be in SCENE/sparse/0.
    json_t *state;
    int lock; // descriptor; excludes a second run until the process ends
} reconstruction;

// ---- The photos ----

static bool has_ending(const char *name, const char *const *endings)
{
    const char *dot = strrchr(name, '.');
    for (; dot && *endings; ++endings)
        if (!strcasecmp(dot + 1, *endings))
            return true;
    return false;
}

static bool is_photo(const char *name)
{
    static const char *const endings[] = {"jpg", "jpeg", "jpe", "jfif", "png", "tif", "tiff",
                                          "bmp", "webp", "ppm", "pgm",  "gif", "tga", NULL};
    return has_ending(name, endings) && !sgs_mask_is_name(name);
}

// Other formats of photos: COLMAP 3.8 cannot read them, or reads raw files undeveloped.
static bool is_unread(const char *name)
{
    static const char *const endings[] = {"heic", "heif", "avif", "dng", "nef", "cr2",
                                          "cr3",  "arw",  "raf",  "rw2", "orf", "jp2",
                                          "jxl",  "exr",  "hdr",  "dpx", "psd", NULL};
    return has_ending(name, endings);
}

// True if there is the same photo in a format that COLMAP reads.
static bool has_copy(struct dirent *const *entries, int count, const char *name)
{
    const size_t length = (size_t)(strrchr(name, '.') + 1 - name); // with the dot
    for (int i = 0; i < count; ++i)
        if (!strncmp(entries[i]->d_name, name, length) && is_photo(entries[i]->d_name))
            return true;
    return false;
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
    return strcmp((*a)->d_name, (*b)->d_name);
}

static bool is_link(const char *path)
{
    struct stat info;
    return !lstat(path, &info) && S_ISLNK(info.st_mode);
}

// Appends a name. JSON cannot hold one that is not UTF-8: its bytes above 127 become \xNN.
static void append_name(json_t *list, const char *name)
{
    json_t *text = json_string(name);
    char *escaped = text ? NULL : calloc(4 * strlen(name) + 1, 1), *to = escaped;
    for (const char *from = name; escaped && *from; ++from)
        to += sprintf(to, *from & 0x80 ? "\\x%02x" : "%c", (unsigned char)*from);
    json_array_append_new(list, text ? text : json_string(escaped));
    free(escaped);
}

static void add_photo(reconstruction *run, const char *path, const char *name,
                      const struct stat *info, json_t *made_from)
{
    int width = 0, height = 0;
    const bool listable = !strpbrk(name, "\r\n"),
               readable = listable && !sgs_image8_probe(path, &width, &height);
    if (!listable)
        print_warning("%s: the name contains a line break; COLMAP will not use it", path);
    else if (!readable)
        print_warning("%s; COLMAP will not use it", sgs_last_error());
    else if (!run->count++)
        run->width = width, run->height = height;
    else if (width != run->width || height != run->height)
        run->width = run->height = 0;
    if (readable)
        fprintf(run->list, "%s\n", name);
    char *line =
        format_text("%s %lld %lld", name, (long long)info->st_size, (long long)info->st_mtime);
    append_name(made_from, line);
    free(line);
}

// True for a link that leads out of the folder of the photos and the data set. Training does not
// follow it.
static bool leads_outside(const reconstruction *run, const char *path)
{
    return is_link(path) && !path_is_below(path, run->photos_path) &&
           !path_is_below(path, run->values->output);
}

// Lists the photos below `folder` and appends "NAME SIZE MTIME" of each to `made_from`. As
// COLMAP does, it follows links to photos and not links to folders, which can form cycles. Fails at
// a link to a photo elsewhere.
static bool list_photos(reconstruction *run, const char *folder, const char *below, int depth,
                        json_t *made_from)
{
    struct dirent **entries = NULL;
    const int n = scandir(folder, &entries, NULL, by_name);
    bool fine = n >= 0;
    if (!fine)
        fail_run("%s: cannot be read: %s", folder, strerror(errno));
    for (int i = 0; i < n; ++i) {
        char *path = format_text("%s/%s", folder, entries[i]->d_name);
        char *name = format_text("%s%s%s", below, *below ? "/" : "", entries[i]->d_name);
        struct stat info;
        if (fine && entries[i]->d_name[0] != '.' && !stat(path, &info)) {
            if (S_ISDIR(info.st_mode) && is_link(path)) {
                print_warning("%s: is a link to a folder, which COLMAP does not follow", path);
            } else if (S_ISDIR(info.st_mode) && depth < MAX_DEPTH) {
                fine = list_photos(run, path, name, depth + 1, made_from);
            } else if (S_ISREG(info.st_mode) && is_photo(name) && leads_outside(run, path)) {
                char *target = resolve_path(path);
                fine = false;
                fail_run("%s: symbolic link points outside the folder of the photos, to %s, where "
                         "training would not read it; replace the links with the files",
                         path, target);
                free(target);
            } else if (S_ISREG(info.st_mode) && is_photo(name)) {
                add_photo(run, path, name, &info, made_from);
            } else if (S_ISREG(info.st_mode) && is_unread(name) &&
                       !has_copy(entries, n, entries[i]->d_name) && !run->unread++) {
                run->first_unread = format_text("%s", name);
            }
        }
        free(name);
        free(path);
    }
    for (int i = 0; i < n; ++i)
        free(entries[i]);
    free(entries);
    return fine;
}

// ---- Stages ----

static bool stage_done(const reconstruction *run, const char *stage)
{
    size_t i;
    json_t *entry;
    json_array_foreach(json_object_get(run->state, "stages"), i, entry)
    {
        if (!strcmp(json_string_value(entry) ? json_string_value(entry) : "", stage))
            return true;
    }
    return false;
}

static bool note_stage(reconstruction *run, const char *stage)
{
    json_array_append_new(json_object_get(run->state, "stages"), json_string(stage));
    return write_json(run->state_path, json_incref(run->state));
}

// Progress parsed from COLMAP's log: "Processed file [3/16]", "Matching block [1/2, 1/2]" (since
// 3.13 "Processing block"), "Registering image #5 (7)".
typedef struct stage_progress {
    const char *label;
    size_t photos, done;
    double error;     // "Mean reprojection error: 0.51px"
    long long points; // "Points: 4711"
} stage_progress;

static void follow_log(void *context, const char *text)
{
    stage_progress *progress = context;
    const char *at;
    size_t done, total;
    double error;
    long long points;
    if ((at = strstr(text, "Processed file [")) && sscanf(at + 16, "%zu/%zu", &done, &total) == 2)
        progress_count(progress->label, done, total);
    else if (((at = strstr(text, "ing block [")) || (at = strstr(text, "ing image ["))) &&
             sscanf(at + 11, "%zu/%zu", &done, &total) == 2)
        progress_count(progress->label, done, total);
    else if (strstr(text, "Registering image #"))
        progress_count(progress->label,
                       ++progress->done < progress->photos ? progress->done : progress->photos,
                       progress->photos);
    else if ((at = strstr(text, "Mean reprojection error: ")) &&
             sscanf(at + 25, "%lf", &error) == 1)
        progress->error = error;
    else if ((at = strstr(text, "Points: ")) && sscanf(at + 8, "%lld", &points) == 1)
        progress->points = points;
}

// Runs `colmap COMMAND ...`. Returns -1 to continue, or an exit status.
static int run_colmap(const reconstruction *run, const char *const *arguments,
                      stage_progress *progress)
{
    char *log = format_text("%s/%s.log", run->work, arguments[1]);
    child_process child = {
        .arguments = arguments, .log_path = log, .line = follow_log, .context = progress};
    const int status = child_run(&child);
    const int reason = errno;
    int result = -1;
    progress_end();
    if (status == CHILD_INTERRUPTED) {
        result = interrupt_status();
    } else if (status == CHILD_MISSING) {
        result = fail_run("%s: program not found; install COLMAP (Debian and Ubuntu: apt install "
                          "colmap) or give its path with --colmap",
                          arguments[0]);
    } else if (status == CHILD_UNSTARTED) {
        result = fail_run("%s: cannot start: %s", arguments[0], strerror(reason));
    } else if (status == CHILD_LOST) {
        result = fail_run("%s: cannot wait for colmap %s: %s", arguments[0], arguments[1],
                          strerror(reason));
    } else if (status) {
        char *tail = child_tail(&child);
        const bool apart = strstr(tail, "No good initial image pair found");
        result =
            fail_run("%s: colmap %s failed with status %d: %s%s", log, arguments[1], status, tail,
                     apart ? "; take photos with more overlap, or try --matcher exhaustive or "
                             "another --camera-model"
                           : "");
        free(tail);
    }
    free(log);
    return result;
}

typedef struct option_search {
    const char *name;
    bool found;
} option_search;

static void look_for_option(void *context, const char *text)
{
    option_search *search = context;
    search->found = search->found || strstr(text, search->name);
}

// True if the installed version of COLMAP lists an option in the help of a command. 3.13 moved the
// options of SIFT that do not depend on the type of feature to other groups.
static bool has_option(const reconstruction *run, const char *command, const char *name)
{
    const char *const arguments[] = {run->values->colmap, command, "--help", NULL};
    char *log = format_text("%s/%s.log", run->work, command);
    option_search search = {.name = name};
    child_process child = {
        .arguments = arguments, .log_path = log, .line = look_for_option, .context = &search};
    child_run(&child); // the stage reports errors
    free(log);
    return search.found;
}

static int find_features(reconstruction *run, const char *threads)
{
    const reconstruct_values *v = run->values;
    const bool renamed = has_option(run, "feature_extractor", "--FeatureExtraction.use_gpu");
    const bool shared = v->cameras == 1 || (v->cameras == 0 && run->width);
    const char *const arguments[] = {
        v->colmap,
        "feature_extractor",
        "--database_path",
        run->database,
        "--image_path",
        run->photos_path,
        "--image_list_path",
        run->list_path,
        "--ImageReader.camera_model",
        v->camera_model,
        "--ImageReader.single_camera",
        shared ? "1" : "0",
        renamed ? "--FeatureExtraction.use_gpu" : "--SiftExtraction.use_gpu",
        "0",
        renamed ? "--FeatureExtraction.num_threads" : "--SiftExtraction.num_threads",
        threads,
        NULL};
    stage_progress progress = {.label = "extracting features", .photos = run->count};
    return write_text(run->list_path, run->names) ? run_colmap(run, arguments, &progress)
                                                  : EXIT_FAILED;
}

static bool is_exhaustive(const reconstruction *run)
{
    const int matcher = run->values->matcher;
    return matcher == MATCHER_AUTO ? run->count <= MAX_EXHAUSTIVE : matcher == MATCHER_EXHAUSTIVE;
}

static int find_matches(reconstruction *run, const char *threads)
{
    const reconstruct_values *v = run->values;
    const char *const command = is_exhaustive(run) ? "exhaustive_matcher" : "sequential_matcher";
    const bool renamed = has_option(run, command, "--FeatureMatching.use_gpu");
    const char *const arguments[] = {
        v->colmap,
        command,
        "--database_path",
        run->database,
        renamed ? "--FeatureMatching.use_gpu" : "--SiftMatching.use_gpu",
        "0",
        renamed ? "--FeatureMatching.num_threads" : "--SiftMatching.num_threads",
        threads,
        NULL};
    stage_progress progress = {.label = "matching", .photos = run->count};
    return run_colmap(run, arguments, &progress);
}

static int remove_entry(const char *path, const struct stat *info, int kind, struct FTW *place)
{
    (void)info, (void)kind, (void)place;
    return remove(path);
}

static int find_cameras(reconstruction *run, const char *threads)
{
    if (file_exists(run->models) && nftw(run->models, remove_entry, 8, FTW_DEPTH | FTW_PHYS))
        return fail_run("%s: cannot remove the models of an earlier run: %s", run->models,
                        strerror(errno));
    const char *const arguments[] = {run->values->colmap,
                                     "mapper",
                                     "--database_path",
                                     run->database,
                                     "--image_path",
                                     run->photos_path,
                                     "--output_path",
                                     run->models,
                                     "--Mapper.num_threads",
                                     threads,
                                     NULL};
    stage_progress progress = {.label = "estimating cameras", .photos = run->count};
    return make_folder(run->models) ? run_colmap(run, arguments, &progress) : EXIT_FAILED;
}

// ---- The result ----

// Number of registered images in a binary model, 0 if there is none.
static unsigned long long model_images(const char *folder)
{
    char *path = format_text("%s/images.bin", folder);
    FILE *stream = fopen(path, "rb");
    unsigned char bytes[8] = {0};
    unsigned long long count = 0;
    if (stream && fread(bytes, 1, sizeof bytes, stream) == sizeof bytes)
        for (int i = 7; i >= 0; --i)
            count = count << 8 | bytes[i];
    if (stream)
        fclose(stream);
    free(path);
    return count;
}

// The folder of the model with the most images; release with free(). NULL after printing the error.
static char *largest_model(const reconstruction *run, unsigned long long *registered, int *models)
{
    char *best = NULL;
    *registered = 0;
    *models = 0;
    for (int k = 0; k < 10000; ++k) {
        char *folder = format_text("%s/%d", run->models, k);
        const unsigned long long images = model_images(folder);
        *models += images > 0;
        if (images <= *registered) {
            const bool there = file_exists(folder);
            free(folder);
            if (there)
                continue;
            break;
        }
        *registered = images;
        free(best);
        best = folder;
    }
    if (!best)
        fail_run("%s: COLMAP registered none of the %zu photos; take more photos with "
                 "more overlap, of a textured subject",
                 run->photos, run->count);
    return best;
}

// Copies a model to SCENE/sparse/0, if it is not there. state.json lists both models meanwhile, so
// that a killed process always leaves a listed one. False after printing the error.
static bool keep_model(reconstruction *run, const char *model)
{
    const char *scene = run->values->output;
    char *kept = format_text("%s/sparse/0", scene), *digest = reconstructed_model_digest(model);
    char *before = reconstructed_model_digest(kept);
    json_t *known = json_object_get(run->state, "kept");
    bool done = digest != NULL;
    if (!done)
        fail_run("%s: the model cannot be read: %s", model, strerror(errno));
    else if (!before || strcmp(before, digest)) {
        json_t *both = json_is_array(known) ? json_copy(known) : json_array();
        json_array_append_new(both, json_string(digest));
        json_object_set_new(run->state, "kept", both);
        done = reconstructed_scene_check(scene, run->photos_path, both) &&
               write_json(run->state_path, json_incref(run->state)) &&
               reconstructed_model_keep(scene, model);
        if (done) {
            json_object_set_new(run->state, "kept", json_pack("[s]", digest));
            done = write_json(run->state_path, json_incref(run->state));
        }
    }
    free(kept);
    free(digest);
    free(before);
    return done;
}

static int report(reconstruction *run, bool json)
{
    unsigned long long registered;
    int models;
    char *largest = largest_model(run, &registered, &models);
    const bool kept = largest && keep_model(run, largest) &&
                      reconstructed_images_link(run->values->output, run->photos_path);
    free(largest);
    if (!kept)
        return EXIT_FAILED;
    char *model = format_text("%s/sparse/0", run->values->output);
    const char *const arguments[] = {run->values->colmap, "model_analyzer", "--path", model, NULL};
    stage_progress progress = {.label = "analysing", .error = -1, .points = -1};
    const int status = run_colmap(run, arguments, &progress);
    free(model);
    if (status >= 0)
        return status;
    if (models > 1)
        print_note("%s: COLMAP produced %d separate models; the largest is used", run->photos,
                   models);
    if (!json) {
        printf("%llu of %zu photos registered, %lld points, mean reprojection error %.3f "
               "px\n%s\n",
               registered, run->count, progress.points, progress.error, run->values->output);
        return EXIT_DONE;
    }
    json_t *root = json_object();
    json_object_set_new(root, "scene", json_text(run->values->output));
    json_object_set_new(root, "photos", json_integer((json_int_t)run->count));
    json_object_set_new(root, "registered", json_integer((json_int_t)registered));
    json_object_set_new(root, "models", json_integer(models));
    json_object_set_new(root, "points",
                        progress.points < 0 ? json_null() : json_integer(progress.points));
    json_object_set_new(root, "mean_reprojection_error",
                        progress.error < 0 ? json_null() : json_number(progress.error));
    return print_json(root) ? EXIT_DONE : EXIT_FAILED;
}

// ---- All of it ----

// Reads the state of an earlier run, if there is one. A damaged file is an error: without it, hours
// of features and matches would be discarded.
static bool read_state(reconstruction *run)
{
    static const char advice[] = "repair it, or move its folder away to start again";
    json_decref(run->state);
    run->state = NULL;
    if (!file_exists(run->state_path))
        return true;
    json_error_t error;
    run->state = load_json(run->state_path, 0, &error);
    if (!run->state) {
        char *fault = json_load_fault(run->state_path, &error);
        fail_run("%s; %s", fault, advice);
        free(fault);
        return false;
    }
    if (json_is_array(json_object_get(run->state, "made_from")) &&
        json_is_array(json_object_get(run->state, "stages")))
        return true;
    fail_run("%s: \"made_from\" and \"stages\" must be lists; %s", run->state_path, advice);
    return false;
}

// Without a state, the files in SCENE/colmap are those of another program.
static bool check_work(const reconstruction *run)
{
    const char *const paths[] = {run->database, run->models};
    for (int k = 0; k < 2 && !run->state; ++k)
        if (file_exists(paths[k])) {
            fail_run("%s: was not written by reconstruct; move it away, or choose another folder "
                     "with -o",
                     paths[k]);
            return false;
        }
    return true;
}

// Reads the state, and refuses files of the user in SCENE.
static bool inspect_scene(reconstruction *run)
{
    return read_state(run) && check_work(run) &&
           reconstructed_scene_check(run->values->output, run->photos_path,
                                     json_object_get(run->state, "kept"));
}

// Against the processes of all machines that share the file system.
static bool lock_work(reconstruction *run)
{
    char *path = format_text("%s/.lock", run->work);
    const lock_result result = lock_file_take(path, &run->lock);
    const int code = errno;
    free(path);
    return lock_admits(run->values->output, result, code);
}

// Features and matches can be hours of work: those of other photos or options are kept.
static bool keep_database(const reconstruction *run)
{
    char *kept = format_text("%s/database.previous.db", run->work);
    const bool exists = file_exists(run->database);
    const bool moved = !exists || !rename(run->database, kept);
    if (!moved)
        fail_run("%s: cannot rename to %s: %s", run->database, kept, strerror(errno));
    else if (exists)
        print_note("%s: the photos or the options have changed, so that all stages start "
                   "again; the earlier features and matches are in %s",
                   run->values->output, kept);
    free(kept);
    return moved;
}

// Keeps the completed stages of an earlier run with the same photos and options.
static bool open_state(reconstruction *run, json_t *made_from)
{
    if (run->state && json_equal(json_object_get(run->state, "made_from"), made_from)) {
        if (json_array_size(json_object_get(run->state, "stages")))
            print_note("%s: continuing an earlier reconstruction", run->values->output);
        return true;
    }
    if (!keep_database(run))
        return false;
    json_t *kept = json_incref(json_object_get(run->state, "kept"));
    json_decref(run->state);
    run->state = json_object();
    if (kept)
        json_object_set_new(run->state, "kept", kept);
    json_object_set(run->state, "made_from", made_from);
    json_object_set_new(run->state, "stages", json_array());
    return write_json(run->state_path, json_incref(run->state));
}

// Discards stages whose files were removed. The models do not require the database any more.
static void forget_removed(reconstruction *run)
{
    json_t *stages = json_object_get(run->state, "stages");
    if (!stage_done(run, "models") || !file_exists(run->models)) {
        const size_t kept = file_exists(run->database) ? 2 : 0; // features and matches
        while (json_array_size(stages) > kept)
            json_array_remove(stages, json_array_size(stages) - 1);
    }
}

static int run_stages(reconstruction *run)
{
    static const struct {
        const char *name, *text;
        int (*run)(reconstruction *, const char *);
    } stages[] = {{"features", "extracting features of", find_features},
                  {"matches", "matching", find_matches},
                  {"models", "estimating the cameras of", find_cameras}};
    char threads[16];
    snprintf(threads, sizeof threads, "%d", sgs_threads_get());
    forget_removed(run);
    for (size_t i = 0; i < sizeof stages / sizeof *stages; ++i) {
        if (stage_done(run, stages[i].name))
            continue;
        print_note("%s: %s %zu photos", run->photos, stages[i].text, run->count);
        const int status = stages[i].run(run, threads);
        if (status >= 0)
            return status;
        if (!note_stage(run, stages[i].name))
            return EXIT_FAILED;
    }
    return -1;
}

// Lists the photos of the whole folder. False after printing the error.
static bool find_photos(reconstruction *run, json_t *made_from)
{
    run->list = open_memstream(&run->names, &run->name_bytes);
    bool found = run->list && list_photos(run, run->photos_path, "", 0, made_from);
    if (!run->list || fclose(run->list)) {
        fail_run("%s: not enough memory for the names of its photos", run->photos);
        found = false;
    }
    if (found && run->unread)
        print_warning("%s: %zu photo(s) in other formats are not used, first '%s'; convert them "
                      "to JPEG, PNG or TIFF",
                      run->photos, run->unread, run->first_unread);
    free(run->first_unread);
    return found;
}

static int reconstruct(reconstruction *run, bool json)
{
    const reconstruct_values *v = run->values;
    json_t *made_from = json_array();
    int status = EXIT_FAILED;
    run->photos_path = realpath(run->photos, NULL);
    if (!run->photos_path) {
        fail_run("%s: %s", run->photos, strerror(errno));
    } else if (find_photos(run, made_from)) {
        append_name(made_from, run->photos_path);
        json_array_append_new(made_from, json_string(v->camera_model));
        json_array_append_new(made_from, json_boolean(is_exhaustive(run)));
        json_array_append_new(made_from, json_integer(v->cameras));
        if (run->count < 2)
            fail_run("%s: contains %zu photo(s); at least 2 are required, 20 or more recommended",
                     run->photos, run->count);
        else if (inspect_scene(run) && make_folder(run->work) && check_writable(run->work) &&
                 lock_work(run) &&
                 inspect_scene(run) && // another run may have ended before the lock was taken
                 open_state(run, made_from))
            status = run_stages(run);
        if (status < 0)
            status = report(run, json);
    }
    json_decref(made_from);
    return status;
}

int command_reconstruct(int argc, char **argv)
{
    command_call call;
    reconstruct_values values = {0};
    const command_spec spec = {.name = "reconstruct",
                               .synopsis = "PHOTOS -o SCENE [options]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 1,
                               .title = "Reconstruction",
                               .options = reconstruct_options,
                               .option_count =
                                   sizeof reconstruct_options / sizeof *reconstruct_options,
                               .values = &values};
    int status = command_parse(&spec, argc, argv, &call);
    sgs_camera_model model;
    if (status < 0 && !values.output)
        status = fail_usage(
            "reconstruct requires a scene folder, -o SCENE; usage: sparegs reconstruct %s",
            call.line.synopsis);
    if (status < 0 && !sgs_camera_model_from_name(values.camera_model, &model))
        status = fail_usage("--camera-model: '%s' is not a COLMAP camera model; common ones are "
                            "SIMPLE_RADIAL, OPENCV and OPENCV_FISHEYE",
                            values.camera_model);
    if (status < 0)
        status = common_apply(&call.common, &call.line);
    if (status >= 0)
        return status;
    interrupt_watch();
    setenv("QT_QPA_PLATFORM", "offscreen",
           1); // otherwise Qt, which COLMAP links, requires a display
    reconstruction run = {.values = &values, .photos = call.line.operands[0]};
    run.work = format_text("%s/colmap", values.output);
    run.database = format_text("%s/database.db", run.work);
    run.models = format_text("%s/models", run.work);
    run.state_path = format_text("%s/state.json", run.work);
    run.list_path = format_text("%s/photos.txt", run.work);
    status = reconstruct(&run, call.common.json);
    json_decref(run.state);
    char *const strings[] = {run.photos_path, run.work,      run.database, run.models,
                             run.state_path,  run.list_path, run.names};
    for (size_t i = 0; i < sizeof strings / sizeof *strings; ++i)
        free(strings[i]);
    return status;
}
