// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs prune`: removes the least important primitives of a stored model by a published score.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cameras/camera_file.h"
#include "cli/commands.h"
#include "processes/interrupt.h"
#include "cli/json_result.h"
#include "cli/json_output.h"
#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "arguments/scene_files.h"
#include "cli/standard_output.h"
#include "run/exposure_file.h"
#include "run/finetune.h"
#include "run/run_record.h"
#include "sparegs/prune.h"

static const char description[] =
    "Removes the fraction R of the primitives of MODEL (a model file, or a run folder, whose "
    "latest iteration is used) with the lowest importance scores, and writes the rest to OUT. "
    "lightgaussian: opacity times transmittance over all hits in the training views, weighted by "
    "volume. refine: closed form from the parameters and the camera positions, without rendering. "
    "pup: log determinant of the Fisher matrix of position and scale over the training views (PUP "
    "3D-GS). rap: a network on 15 features of the parameters; its weights are a file of RAP's "
    "authors.\nWith several ratios OUT is a folder of files prune_R.ply. lightgaussian and pup "
    "require SCENE; refine reads the cameras of SCENE, or of the run's cameras.json. Image folder, "
    "size, split, filter and background default to those of the run.";

enum { MAX_RATIOS = 32 };

typedef struct prune_values {
    const char *output, *scores, *ratio, *features, *weights, *run;
    int method, finetune, fisher_downscale;
    double volume_power;
} prune_values;

static const option prune_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_FOLDER,
     .offset = offsetof(prune_values, output),
     .argument = "OUT",
     .shown = "none; required without --scores and --features",
     .help = "output file; its extension selects the format; with several ratios a folder of "
             "prune_R.ply"},
    {.name = "method",
     .kind = OPTION_CHOICE,
     .offset = offsetof(prune_values, method),
     .argument = "lightgaussian|refine|pup|rap",
     .help = "importance score (required)"},
    {.name = "ratio",
     .kind = OPTION_TEXT,
     .offset = offsetof(prune_values, ratio),
     .argument = "R[,R...]",
     .shown = "required with -o",
     .needs = "output",
     .help = "fractions of the primitives to remove, from 0 to less than 1"},
    {.name = "scores",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(prune_values, scores),
     .argument = "FILE",
     .shown = "none",
     .help = "write the score of each primitive of MODEL to a CSV file"},
    {.name = "weights",
     .kind = OPTION_TEXT,
     .path = PATH_INPUT,
     .offset = offsetof(prune_values, weights),
     .argument = "FILE",
     .shown = "none",
     .needs = "method=rap",
     .help = "RAP's network weights, net_f15.pth from its authors; required "
             "to compute scores"},
    {.name = "features",
     .kind = OPTION_TEXT,
     .path = PATH_OUTPUT,
     .offset = offsetof(prune_values, features),
     .argument = "FILE",
     .shown = "none",
     .needs = "method=rap",
     .help = "write RAP's 15 features of each primitive of MODEL to a CSV file"},
    {.name = "finetune",
     .kind = OPTION_INTEGER,
     .offset = offsetof(prune_values, finetune),
     .low = 0,
     .high = 1e7,
     .argument = "N",
     .initial = "0",
     .unit = "iterations",
     .needs = "output",
     .help = "train the pruned models: all parameters, final learning rate of the positions, no "
             "densification"},
    {.name = "volume-power",
     .kind = OPTION_REAL,
     .offset = offsetof(prune_values, volume_power),
     .low = 0,
     .high = 10,
     .argument = "X",
     .initial = "0.1",
     .needs = "method=lightgaussian",
     .help = "exponent of the volume in LightGaussian's score"},
    {.name = "fisher-downscale",
     .kind = OPTION_INTEGER,
     .offset = offsetof(prune_values, fisher_downscale),
     .low = 1,
     .high = 1024,
     .argument = "K",
     .initial = "4",
     .needs = "method=pup",
     .help = "divide width and height of the views of PUP's Fisher matrices by K"},
    RUN_OPTION(prune_values),
};

static const char *const method_names[] = {"lightgaussian", "refine", "pup", "rap"};

typedef struct ratio_list {
    int count;
    double values[MAX_RATIOS];
    char texts[MAX_RATIOS][24]; // as given, for file names
} ratio_list;

typedef struct pruning {
    const command_line *line;
    const prune_values *values;
    const common_values *common;
    const char *model_name;
    ratio_list ratios;
    model_path located;
    sgs_scene *scene; // NULL without SCENE
    drawing_values drawing;
    sgs_gaussians *model;
    sgs_rap_network *rap;
    float *features; // RAP
    double *scores, score_seconds;
    double (*cameras)[3];
    size_t camera_count;
    json_t *outputs;
} pruning;

// ---- Arguments ----

// False after printing the usage error.
static bool parse_ratios(const char *text, ratio_list *list)
{
    for (const char *at = text; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        const size_t length = strcspn(at, ",");
        char *end;
        if (list->count == MAX_RATIOS) {
            fail_usage("--ratio: more than %d ratios", MAX_RATIOS);
            return false;
        }
        char *word = list->texts[list->count];
        snprintf(word, sizeof list->texts[0], "%.*s", (int)length, at);
        const double value = strtod(word, &end);
        if (!length || length >= sizeof list->texts[0] || *end || strpbrk(word, " xXpP") ||
            !(value >= 0 && value < 1)) {
            fail_usage("--ratio: '%.*s' is not a share from 0 to less than 1", (int)length, at);
            return false;
        }
        for (int k = 0; k < list->count; ++k)
            if (list->values[k] == value) {
                fail_usage("--ratio: %s is given twice", word);
                return false;
            }
        list->values[list->count++] = value;
    }
    return true;
}

static bool needs_views(int method)
{
    return method == SGS_PRUNE_LIGHTGAUSSIAN || method == SGS_PRUNE_PUP;
}

// Returns -1 to continue, or an exit status.
static int check_values(pruning *p)
{
    const prune_values *values = p->values;
    const bool has_scene = p->line->operand_count > 1;
    if (!option_given(p->line, "method"))
        return fail_usage("prune requires --method %s", prune_options[1].argument);
    if (!values->output && !values->scores && !values->features)
        return fail_usage("prune requires an output, -o OUT, --scores FILE or --features FILE");
    if (values->method == SGS_PRUNE_RAP && !values->weights && (values->output || values->scores))
        return fail_usage("--method rap requires --weights FILE, the network of RAP's authors "
                          "(net_f15.pth), which is not part of sparegs; --features FILE alone "
                          "writes the features without it");
    if (values->weights && !values->output && !values->scores)
        return refuse_idle(p->line, "weights", "on --features alone");
    if (values->output && !values->ratio)
        return fail_usage("-o requires --ratio R, the fraction of the primitives to remove");
    if (values->ratio && !parse_ratios(values->ratio, &p->ratios))
        return EXIT_USAGE;
    sgs_model_format format;
    if (values->output && p->ratios.count == 1 && model_output_format(values->output, &format) >= 0)
        return EXIT_USAGE;
    if (values->output && p->ratios.count > 1 && sgs_model_format_of_name(values->output, &format))
        return fail_usage("-o %s: several ratios require a folder; give one ratio, or a name "
                          "without a model extension",
                          values->output);
    if (!has_scene && needs_views(values->method))
        return fail_usage("--method %s requires the argument SCENE for its training views",
                          method_names[values->method]);
    if (!has_scene && values->finetune)
        return fail_usage("--finetune requires the argument SCENE");
    if (!has_scene)
        return refuse_idle(p->line,
                           "images|downscale|eval|test-every|test-images|masks|invert-masks|alpha|"
                           "image-cache|input-colorspace|filter|compact-box|background|near",
                           "without SCENE");
    return -1;
}

static void warn_idle_options(const pruning *p)
{
    if (!p->scene)
        return;
    if (!p->values->finetune)
        warn_idle(p->line, "masks|invert-masks|alpha|image-cache|input-colorspace",
                  "without --finetune: the score reads no photos");
    if (!p->values->finetune && p->values->method != SGS_PRUNE_PUP)
        warn_idle(p->line, "background", "without --finetune: only --method pup reads it");
    if (!p->values->finetune && !needs_views(p->values->method))
        // The filter is recorded in OUT.
        warn_idle(p->line,
                  p->values->output ? "compact-box|near|eval|test-every|test-images"
                                    : "filter|compact-box|near|eval|test-every|test-images",
                  "on a score that renders no views");
    else if (!needs_views(p->values->method))
        warn_idle(p->line, "near",
                  "on --finetune, which trains with the near distance of the scene");
}

// ---- Scores ----

static bool add_camera(pruning *p, const double center[3])
{
    double(*grown)[3] = realloc(p->cameras, (p->camera_count + 1) * sizeof *grown);
    if (!grown) {
        fail_run("not enough memory for %zu cameras", p->camera_count + 1);
        return false;
    }
    p->cameras = grown;
    memcpy(p->cameras[p->camera_count++], center, sizeof *grown);
    return true;
}

// The cameras of SCENE in the order of cameras.json: held-out views first.
static bool cameras_of_scene(pruning *p)
{
    bool added = true;
    for (int pass = 0; pass < 2; ++pass)
        for (size_t v = 0; v < p->scene->view_count && added; ++v) {
            double center[3];
            const sgs_view *view = &p->scene->views[v];
            sgs_pose_center(&view->pose, center);
            if (view->split == (pass ? SGS_SPLIT_TRAIN : SGS_SPLIT_TEST))
                added = add_camera(p, center);
        }
    return added;
}

static bool cameras_of_run(pruning *p)
{
    char *path = format_text("%s/cameras.json", p->located.run ? p->located.run : p->model_name);
    camera_list list = {0};
    bool added = file_exists(path);
    if (!added)
        fail_run("%s: no cameras: give SCENE, or a run folder with cameras.json", p->model_name);
    added = added && camera_file_read(path, 0, &list);
    for (size_t c = 0; c < list.count && added; ++c) {
        double center[3];
        sgs_pose_center(&list.cameras[c].pose, center);
        added = add_camera(p, center);
    }
    camera_list_free(&list);
    free(path);
    return added;
}

static bool show_views(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("scoring view", done, total);
    return !interrupt_signal();
}

static bool show_features(void *user, size_t done, size_t total)
{
    (void)user;
    progress_work("computing features", done, total);
    return !interrupt_signal();
}

static bool has_memory(const void *block, const pruning *p, const char *what)
{
    if (!block)
        fail_run("not enough memory for the %s of %zu primitives", what, p->model->count);
    return block != NULL;
}

// The features first, as --features writes them too.
static sgs_status rap_scores(pruning *p)
{
    const sgs_status status = sgs_rap_features(p->model, show_features, NULL, p->features);
    for (size_t i = 0; i < p->model->count && !status && p->rap; ++i)
        p->scores[i] = sgs_rap_score(p->rap, p->features + i * SGS_RAP_FEATURES);
    return status;
}

static sgs_status view_scores(pruning *p)
{
    sgs_prune_options options = sgs_prune_options_default();
    options.method = (sgs_prune_method)p->values->method;
    options.scene = p->scene;
    const sgs_render_options render = drawing_render_options(&p->drawing);
    sgs_view_pass_options views = sgs_view_pass_options_default();
    views.render = &render;
    views.progress = show_views;
    options.views = &views;
    options.volume_power = p->values->volume_power;
    options.fisher_downscale = p->values->fisher_downscale;
    memcpy(options.background, p->drawing.background, sizeof options.background);
    options.cameras = (const double(*)[3])p->cameras;
    options.camera_count = p->camera_count;
    return sgs_prune_scores(p->model, &options, p->scores);
}

static bool compute_scores(pruning *p)
{
    const double start = clock_seconds();
    const int method = p->values->method;
    const size_t count = p->model->count ? p->model->count : 1;
    if (method == SGS_PRUNE_REFINE && !(p->scene ? cameras_of_scene(p) : cameras_of_run(p)))
        return false;
    if (p->values->weights && sgs_rap_read(p->values->weights, &p->rap)) {
        fail_library();
        return false;
    }
    p->scores = calloc(count, sizeof *p->scores);
    if (method == SGS_PRUNE_RAP)
        p->features = calloc(count, SGS_RAP_FEATURES * sizeof *p->features);
    if (!has_memory(p->scores, p, "scores") ||
        (method == SGS_PRUNE_RAP && !has_memory(p->features, p, "features")))
        return false;
    progress_work_start();
    const sgs_status status = method == SGS_PRUNE_RAP ? rap_scores(p) : view_scores(p);
    progress_end();
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    p->score_seconds = clock_seconds() - start;
    return !status;
}

typedef void (*csv_row_fn)(const pruning *p, FILE *stream, size_t i);

static void put_score(const pruning *p, FILE *stream, size_t i)
{
    fprintf(stream, "%zu,%.9g\n", i, p->scores[i]);
}

static void put_features(const pruning *p, FILE *stream, size_t i)
{
    fprintf(stream, "%zu", i);
    for (int k = 0; k < SGS_RAP_FEATURES; ++k)
        fprintf(stream, ",%.7g", (double)p->features[i * SGS_RAP_FEATURES + (size_t)k]);
    fputc('\n', stream);
}

// Writes a table with a row for each primitive. False after printing the error.
static bool write_table(const pruning *p, const char *path, const char *header, csv_row_fn put)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    if (stream)
        fputs(header, stream);
    for (size_t i = 0; i < p->model->count && stream; ++i)
        put(p, stream, i);
    bool written = stream && !fclose(stream);
    if (!written)
        fail_run("%s: not enough memory for %zu rows", path, p->model->count);
    written = written && make_folder_of(path) && write_text(path, text);
    free(text);
    return written;
}

static bool write_tables(const pruning *p)
{
    if (p->values->scores && !write_table(p, p->values->scores, "primitive,score\n", put_score))
        return false;
    if (!p->values->features)
        return true;
    char *header = format_text("primitive");
    for (int k = 0; k < SGS_RAP_FEATURES; ++k) {
        char *longer = format_text("%s,%s", header, sgs_rap_feature_name(k));
        free(header);
        header = longer;
    }
    char *line = format_text("%s\n", header);
    const bool written = write_table(p, p->values->features, line, put_features);
    free(header);
    free(line);
    return written;
}

// ---- Models ----

static bool write_model(const pruning *p, int k, const char *path, const sgs_gaussians *pruned)
{
    const sgs_model_write_options options = model_write_options(&p->drawing);
    sgs_model_written info;
    sgs_model_format format;
    if (!make_folder_of(path))
        return false;
    if (sgs_model_format_of_name(path, &format))
        model_warn_unmarked(path, format, &options);
    if (sgs_model_write(path, pruned, &options, &info)) {
        fail_library();
        return false;
    }
    if (!p->outputs) {
        printf("%s: %zu of %zu primitives, %.2f MiB\n", path, pruned->count, p->model->count,
               (double)info.bytes / 0x1p20);
        stdout_flush();
        return true;
    }
    json_t *entry = json_object();
    json_object_set_new(entry, "file", json_text(path));
    json_object_set_new(entry, "ratio", json_number(p->ratios.values[k]));
    json_object_set_new(entry, "gaussians", json_integer((json_int_t)pruned->count));
    json_object_set_new(entry, "bytes", json_integer((json_int_t)info.bytes));
    json_array_append_new(p->outputs, entry);
    return true;
}

static sgs_gaussians *prune_model(const pruning *p, double ratio)
{
    bool *keep = malloc(p->model->count ? p->model->count : 1);
    size_t kept;
    sgs_gaussians *pruned = NULL;
    if (!keep)
        fail_run("not enough memory for %zu primitives", p->model->count);
    else if (sgs_prune_select((sgs_prune_method)p->values->method, p->scores, p->model->count,
                              ratio, keep, &kept) ||
             sgs_gaussians_keep(p->model, keep, &pruned))
        fail_library();
    free(keep);
    return pruned;
}

// The file of a ratio; release with free().
static char *output_path(const pruning *p, int k)
{
    return p->ratios.count > 1
               ? format_text("%s/prune_%s.ply", p->values->output, p->ratios.texts[k])
               : format_text("%s", p->values->output);
}

// Refuses a model at `path` that would replace the input, a table, or a file of a run.
static int refuse_replacing(const pruning *p, const char *path)
{
    if (same_file(path, p->located.ply_path))
        return refuse_input("output", path);
    const char *const names[] = {"scores", "features"};
    const char *const tables[] = {p->values->scores, p->values->features};
    for (size_t t = 0; t < sizeof tables / sizeof *tables; ++t)
        if (tables[t] && same_file(path, tables[t]))
            return fail_usage("--%s and --output are both %s; choose different files", names[t],
                              path);
    return refuse_file_of_run("output", path, NULL);
}

// Checks before the work that the files can be written and replace nothing of the command. Returns
// -1 to continue, or an exit status.
static int check_outputs(const pruning *p)
{
    const char *const tables[] = {p->values->scores, p->values->features};
    int status = refuse_outputs_at(p->line, p->located.ply_path);
    for (size_t t = 0; t < sizeof tables / sizeof *tables && status < 0; ++t)
        if (tables[t] && !check_output(tables[t]))
            status = EXIT_FAILED;
    for (int k = 0; k < p->ratios.count && status < 0; ++k) {
        char *path = output_path(p, k);
        status = refuse_replacing(p, path);
        if (status < 0 && !check_output(path))
            status = EXIT_FAILED;
        free(path);
    }
    return status;
}

// False after printing the error if a file of a ratio would replace a file of the scene; the parser
// and scene_open do not know these names.
static bool spares_scene(const pruning *p)
{
    scene_files files = scene_files_of(p->scene);
    bool spares = true;
    for (int k = 0; k < p->ratios.count && spares; ++k) {
        char *path = output_path(p, k);
        spares = scene_files_admit(&files, path, "choose another folder");
        free(path);
    }
    scene_files_free(&files);
    return spares;
}

static bool make_output(pruning *p, int k)
{
    sgs_gaussians *pruned = prune_model(p, p->ratios.values[k]);
    bool done = pruned != NULL;
    if (done && !pruned->count)
        print_warning("ratio %s removes all %zu primitives", p->ratios.texts[k], p->model->count);
    if (done && p->values->finetune && pruned->count)
        done = finetune_model(&pruned, p->scene, &p->drawing, p->values->finetune, p->common->seed);
    char *path = output_path(p, k);
    done = done && write_model(p, k, path, pruned);
    free(path);
    sgs_gaussians_destroy(pruned);
    return done;
}

static bool print_result(pruning *p, double seconds)
{
    if (!p->outputs)
        return true;
    json_t *root = json_result_new();
    json_object_set_new(root, "method", json_string(method_names[p->values->method]));
    json_object_set_new(root, "input", json_integer((json_int_t)p->model->count));
    json_object_set_new(root, "outputs", json_incref(p->outputs));
    json_object_set_new(root, "score_seconds", json_number(p->score_seconds));
    json_object_set_new(root, "seconds", json_number(seconds));
    return print_json(root);
}

static bool prune(pruning *p)
{
    const double start = clock_seconds();
    if (!model_read_filled(&p->located, &p->drawing, &p->model))
        return false;
    if (p->common->json)
        p->outputs = json_array();
    bool done = compute_scores(p) && write_tables(p);
    for (int k = 0; k < p->ratios.count && done; ++k)
        done = !interrupt_signal() && make_output(p, k);
    return done && print_result(p, clock_seconds() - start);
}

// Opens SCENE, if given, and sets how its views are rendered. False after printing the error.
static bool open_scene(pruning *p, const scene_values *data)
{
    if (p->line->operand_count > 1) {
        p->scene = scene_open(p->line->operands[1], data, p->values->finetune > 0);
        if (!p->scene || !spares_scene(p))
            return false;
        if (p->located.run)
            run_record_check_scene(p->located.run, p->scene);
        if (p->values->finetune)
            scene_warn_idle(p->scene, data, p->line);
    }
    drawing_resolve(&p->drawing, p->line, p->located.config, data, p->scene);
    if (p->values->finetune)
        exposure_warn_finetune(p->located.ply_path, p->located.config);
    warn_idle_options(p);
    return true;
}

int command_prune(int argc, char **argv)
{
    command_call call;
    scene_values data;
    prune_values values = {0};
    pruning p = {.values = &values, .common = &call.common, .line = &call.line};
    const command_spec spec = {.name = "prune",
                               .synopsis = "MODEL [SCENE] -o OUT --method M --ratio R[,R...]",
                               .description = description,
                               .operand_minimum = 1,
                               .operand_maximum = 2,
                               .title = "Pruning",
                               .options = prune_options,
                               .option_count = sizeof prune_options / sizeof *prune_options,
                               .values = &values,
                               .scene = &data,
                               .drawing = &p.drawing};
    int status = command_begin(&spec, argc, argv, &call);
    if (status < 0)
        status = check_values(&p);
    if (status >= 0)
        return status;
    interrupt_watch();
    p.model_name = call.line.operands[0];
    bool done = model_locate_of_run(p.model_name, values.run, &p.located);
    if (done)
        status = check_outputs(&p);
    if (done && status < 0)
        status = model_scene_resolve(&data, &call.line, &p.located);
    if (status < 0)
        done = done && open_scene(&p, &data) && prune(&p);
    json_decref(p.outputs);
    free(p.cameras);
    free(p.scores);
    free(p.features);
    sgs_rap_destroy(p.rap);
    sgs_gaussians_destroy(p.model);
    sgs_scene_destroy(p.scene);
    model_path_free(&p.located);
    if (status >= 0)
        return status;
    return interrupt_signal() ? interrupt_status() : done ? EXIT_DONE : EXIT_FAILED;
}
