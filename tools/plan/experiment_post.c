// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/experiment_post.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli/commands.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "options/options.h"
#include "plan/plan_values.h"
#include "plan/run_settings.h"
#include "processes/interrupt.h"
#include "processes/sub_command.h"
#include "sparegs/compress.h"
#include "sparegs/runtime.h"

// A kind of step.
typedef struct post_kind {
    const char *name, *sweep; // the option whose list gives the points
    const char *defaults;     // its values
    int (*command)(int argc, char **argv);
} post_kind;

static const post_kind kinds[] = {
    {"prune", "ratio", "0.3,0.5,0.7", command_prune},
    {"compress", "preset", "spare-1,spare-2,spare-3", command_compress},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

// Options that the experiment sets itself.
static const char *const own_options[] = {"output", "json", "quiet", "help", "scores", "features"};

static const post_kind *kind_of(const json_t *step)
{
    const post_kind *found = NULL;
    for (int k = 0; k < KINDS; ++k)
        if (json_object_get(step, kinds[k].name))
            found = found ? NULL : &kinds[k];
    return found;
}

// ---- Values as arguments ----

// The name of an option with dashes. Release with free().
static char *option_name(const char *key)
{
    char *name = format_text("%s", key);
    key_to_name(name);
    return name;
}

// ---- Checks ----

// The table of options of a command: {"options": [{"name", "kind", "argument", ...}]}.
static json_t *option_table(const post_kind *kind)
{
    char name[32], help[] = "--help", json[] = "--json";
    snprintf(name, sizeof name, "%s", kind->name);
    char *arguments[] = {name, help, json, NULL};
    return kind->command(3, arguments) == EXIT_DONE ? json_result_take() : NULL;
}

static const json_t *option_row(const json_t *table, const char *name)
{
    size_t k;
    const json_t *row;
    json_array_foreach(json_object_get(table, "options"), k, row)
    {
        if (!strcmp(json_string_value(json_object_get(row, "name")), name))
            return row;
    }
    return NULL;
}

// Why a value does not suit an option, or NULL.
static const char *value_fault(const json_t *row, const json_t *value)
{
    const char *kind = json_string_value(json_object_get(row, "kind"));
    const char *words = json_string_value(json_object_get(row, "argument"));
    const json_t *low = json_object_get(row, "minimum"), *high = json_object_get(row, "maximum");
    if (!strcmp(kind, "flag"))
        return json_is_boolean(value) ? NULL : "expected true or false";
    if (!strcmp(kind, "choice"))
        return json_is_string(value) && find_word(words, json_string_value(value)) >= 0
                   ? NULL
                   : "unknown word";
    if (!json_is_string(value) && !json_is_number(value))
        return "expected a number or a string";
    if (json_is_number(value) && json_is_number(low) && json_is_number(high) &&
        !(json_number_value(value) >= json_number_value(low) &&
          json_number_value(value) <= json_number_value(high)))
        return "out of range";
    return NULL;
}

static bool refuse(const char *plan_path, const char *kind, const char *key, const char *why)
{
    fail_run("%s: post: %s: %s: %s", plan_path, kind, key, why);
    return false;
}

// Ratios are text for the command, which accepts lists.
static const char *ratio_fault(const json_t *value)
{
    char *text = json_is_string(value) || json_is_number(value) ? plan_value_text(value) : NULL;
    char *end = text;
    const double ratio = text ? strtod(text, &end) : NAN;
    const bool good = text && *text && !*end && ratio >= 0 && ratio < 1;
    free(text);
    return good ? NULL : "expected shares from 0 to less than 1";
}

static const char *point_fault(const json_t *row, const char *key, const json_t *value)
{
    return strcmp(key, "ratio") ? value_fault(row, value) : ratio_fault(value);
}

// True if two points of a list have the same text, which names their files.
static bool repeats_point(const json_t *list)
{
    bool repeated = false;
    for (size_t k = 1; k < json_array_size(list); ++k)
        for (size_t j = 0; j < k; ++j) {
            char *one = plan_value_text(json_array_get(list, j)),
                 *other = plan_value_text(json_array_get(list, k));
            repeated = repeated || !strcmp(one, other);
            free(one);
            free(other);
        }
    return repeated;
}

static bool check_value(const char *plan_path, const post_kind *kind, const json_t *row,
                        const char *key, const json_t *value)
{
    const char *fault = NULL;
    if (json_is_array(value) && !strcmp(key, kind->sweep)) {
        size_t k;
        const json_t *item;
        json_array_foreach(value, k, item)
        {
            if (!fault)
                fault = point_fault(row, key, item);
        }
        if (!json_array_size(value))
            fault = "the list is empty";
        else if (!fault && repeats_point(value))
            fault = "two points of the list are the same";
    } else {
        fault = point_fault(row, key, value);
    }
    return !fault || refuse(plan_path, kind->name, key, fault);
}

// True if the option has an effect with this method.
static bool suits_method(const json_t *row, const char *method)
{
    const char *needs = json_string_value(json_object_get(row, "needs"));
    char *condition = format_text("method=%s", method ? method : "");
    const bool suits = !needs || !strstr(needs, "method=") || strstr(needs, condition);
    free(condition);
    return suits;
}

// The key of the option that makes the presets of a method equal, or NULL.
static const char *preset_rival(const json_t *options, const char *method)
{
    const char *wanted = NULL, *found = NULL, *key, *name;
    for (int m = 0; (name = sgs_compress_method_name((sgs_compress_method)m)); ++m)
        if (!strcmp(name, method))
            wanted = sgs_compress_preset_option((sgs_compress_method)m);
    json_t *value;
    json_object_foreach((json_t *)options, key, value)
    {
        char *given = option_name(key);
        found = wanted && !strcmp(given, wanted) ? key : found;
        free(given);
    }
    return found;
}

static bool check_options(const char *plan_path, const post_kind *kind, const json_t *options)
{
    json_t *table = option_table(kind);
    bool good = table != NULL;
    const char *key, *method = json_string_value(json_object_get(options, "method"));
    json_t *value;
    json_object_foreach((json_t *)options, key, value)
    {
        if (!good)
            break;
        char *name = option_name(key);
        const json_t *row = option_row(table, name);
        for (size_t k = 0; k < sizeof own_options / sizeof *own_options; ++k)
            if (!strcmp(name, own_options[k]))
                good = refuse(plan_path, kind->name, key, "is set by the experiment");
        if (good && !row)
            good = refuse(plan_path, kind->name, key, "unknown option");
        if (good && !suits_method(row, method))
            good = refuse(plan_path, kind->name, key, "has no effect with this method");
        good = good && check_value(plan_path, kind, row, name, value);
        free(name);
    }
    json_decref(table);
    if (good && !method)
        return refuse(plan_path, kind->name, "method", "is missing");
    const json_t *presets = json_object_get(options, "preset");
    const char *rival =
        good && !strcmp(kind->name, "compress") ? preset_rival(options, method) : NULL;
    if (rival && (!presets || json_array_size(presets) > 1))
        return refuse(plan_path, kind->name, rival,
                      "makes all presets equal; set \"preset\" to one of them");
    if (good && !strcmp(method, "rap") && !json_object_get(options, "weights"))
        return refuse(plan_path, kind->name, "weights", "rap requires the file of its authors");
    return good;
}

static bool has_variant(const json_t *variants, const char *name)
{
    size_t k;
    const json_t *variant;
    json_array_foreach(variants, k, variant)
    {
        const char *is = json_string_value(json_object_get(variant, "name"));
        if (is && name && !strcmp(is, name))
            return true;
    }
    return false;
}

static bool check_step(const char *plan_path, const json_t *root, const json_t *step)
{
    const post_kind *kind = kind_of(step);
    const json_t *variants = json_object_get(step, "variants");
    if (!kind) {
        fail_run("%s: post: each step is an object with either \"prune\" or \"compress\"",
                 plan_path);
        return false;
    }
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)step, key, value)
    {
        if (strcmp(key, kind->name) && strcmp(key, "name") && strcmp(key, "variants"))
            return refuse(plan_path, kind->name, key, "unknown key");
    }
    if (!json_is_object(json_object_get(step, kind->name)))
        return refuse(plan_path, kind->name, "options", "expected an object");
    if (variants && !json_array_size(variants))
        return refuse(plan_path, kind->name, "variants", "expected a list of names");
    for (size_t k = 0; k < json_array_size(variants); ++k)
        if (!has_variant(json_object_get(root, "variants"),
                         json_string_value(json_array_get(variants, k))))
            return refuse(plan_path, kind->name, "variants", "unknown variant");
    return check_options(plan_path, kind, json_object_get(step, kind->name));
}

// Names are used as folder names.
static bool check_step_name(const char *plan_path, const post_plan *post, const char *name)
{
    if (!name || !*name || *name == '.' || strlen(name) > 60 ||
        strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") !=
            strlen(name))
        return refuse(plan_path, "name", name ? name : "(missing)",
                      "use letters, digits, '.', '_' and '-'");
    for (size_t k = 0; k < post->count; ++k)
        if (!strcmp(post->points[k].step, name))
            return refuse(plan_path, "name", name, "two steps have this name; set \"name\"");
    return true;
}

// ---- The points ----

static void add_point(post_plan *post, const post_kind *kind, const char *step,
                      const json_t *options, const json_t *value, const json_t *variants)
{
    post->points = realloc(post->points, (post->count + 1) * sizeof *post->points);
    if (!post->points)
        exit(fail_run("out of memory"));
    json_t *own = json_copy((json_t *)options);
    json_object_set(own, kind->sweep, (json_t *)value);
    json_t *settings = json_pack("{s:s,s:o}", "kind", kind->name, "options", own);
    post->points[post->count++] = (post_point){
        .step = format_text("%s", step),
        .kind = format_text("%s", kind->name),
        .method = format_text("%s", json_string_value(json_object_get(options, "method"))),
        .point = plan_value_text(value),
        .settings = json_as_stored(settings),
        .variants = variants};
    json_decref(settings);
}

// The points of a step in the order of its list.
static void add_points(post_plan *post, const json_t *step, const char *name)
{
    const post_kind *kind = kind_of(step);
    const json_t *options = json_object_get(step, kind->name);
    const json_t *variants = json_object_get(step, "variants");
    const json_t *sweep = json_object_get(options, kind->sweep);
    for (size_t k = 0; k < json_array_size(sweep); ++k)
        add_point(post, kind, name, options, json_array_get(sweep, k), variants);
    if (sweep && !json_is_array(sweep))
        add_point(post, kind, name, options, sweep, variants);
    for (const char *at = kind->defaults; !sweep && at; at = strchr(at, ',')) {
        at += *at == ',';
        json_t *value = json_stringn(at, strcspn(at, ","));
        add_point(post, kind, name, options, value, variants);
        json_decref(value);
    }
}

// Resolves the paths in the options of a step. False after printing the error.
static bool resolve_paths(const char *plan_path, json_t *options)
{
    static const char name[] = "weights";
    const char *path = json_string_value(json_object_get(options, name));
    if (!path)
        return true;
    char *resolved = format_text("%s", path);
    const bool good = plan_path_option(plan_path, name, PATH_INPUT, &resolved);
    json_object_set_new(options, name, json_string(resolved));
    free(resolved);
    return good;
}

// Points are compared by held-out images.
static bool holds_out(const json_t *options)
{
    static const char *const names[] = {"eval", "test_every", "test-every", "test_images",
                                        "test-images"};
    bool holds = false;
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        const json_t *value = json_object_get(options, names[k]);
        holds = holds || (value && !json_is_false(value) && !json_is_null(value));
    }
    return holds;
}

// Each scene or the plan must hold out images. False after printing the error.
static bool all_hold_out(const char *plan_path, const json_t *root)
{
    size_t s;
    json_t *scene; // or a variant
    bool all = json_array_size(json_object_get(root, "variants")) > 0;
    json_array_foreach(json_object_get(root, "variants"), s, scene)
    {
        all = all && holds_out(json_object_get(scene, "options"));
    }
    all = all || holds_out(json_object_get(root, "options"));
    json_array_foreach(json_object_get(root, "scenes"), s, scene)
    {
        if (all || holds_out(json_object_get(scene, "options")))
            continue;
        fail_run("%s: post: scene '%s' has no held-out images to compare; set the option "
                 "\"eval\": true",
                 plan_path, json_string_value(json_object_get(scene, "name")));
        return false;
    }
    return true;
}

// False after printing the error if a step is for no variant of the plan.
static bool has_work(const char *plan_path, const json_t *root, const post_plan *post)
{
    for (size_t k = 0; k < post->count; ++k) {
        size_t v;
        json_t *variant;
        bool applies = false;
        json_array_foreach(json_object_get(root, "variants"), v, variant)
        {
            const char *name = json_string_value(json_object_get(variant, "name"));
            applies = applies || post_applies(&post->points[k], name);
        }
        if (!applies) {
            fail_run("%s: post: step '%s' is for the variants 'off' and 'on', which the plan does "
                     "not have; set \"variants\" of the step",
                     plan_path, post->points[k].step);
            return false;
        }
    }
    return true;
}

bool post_plan_read(const char *plan_path, const json_t *root, post_plan *post)
{
    *post = (post_plan){0};
    const json_t *steps = json_object_get(root, "post");
    if (steps && !json_is_array(steps)) {
        fail_run("%s: \"post\" must be a list of steps", plan_path);
        return false;
    }
    bool good = true;
    for (size_t k = 0; k < json_array_size(steps) && good; ++k) {
        const json_t *step = json_array_get(steps, k);
        good = check_step(plan_path, root, step);
        if (!good)
            break;
        const post_kind *kind = kind_of(step);
        json_t *options = json_object_get(step, kind->name);
        const json_t *label = json_object_get(step, "name");
        if (label && !json_is_string(label)) {
            fail_run("%s: post: the name of step %zu must be a text", plan_path, k + 1);
            good = false;
            break;
        }
        const char *given = json_string_value(label);
        char *name = given ? format_text("%s", given)
                           : format_text("%s-%s", kind->name,
                                         json_string_value(json_object_get(options, "method")));
        good = resolve_paths(plan_path, options) && check_step_name(plan_path, post, name);
        if (good)
            add_points(post, step, name);
        free(name);
    }
    good = good &&
           (!post->count || (all_hold_out(plan_path, root) && has_work(plan_path, root, post)));
    if (!good)
        post_plan_free(post);
    return good;
}

void post_plan_free(post_plan *post)
{
    for (size_t k = 0; k < post->count; ++k) {
        post_point *point = &post->points[k];
        free(point->step);
        free(point->kind);
        free(point->method);
        free(point->point);
        json_decref(point->settings);
    }
    free(post->points);
    *post = (post_plan){0};
}

bool post_applies(const post_point *point, const char *variant)
{
    if (!point->variants)
        return !strcmp(variant, "off") || !strcmp(variant, "on");
    for (size_t k = 0; k < json_array_size(point->variants); ++k)
        if (!strcmp(json_string_value(json_array_get(point->variants, k)), variant))
            return true;
    return false;
}

// ---- Execution ----

// RUN/post/STEP/POINT and a suffix. Release with free().
static char *point_path(const post_point *point, const post_run *run, const char *suffix)
{
    return format_text("%s/post/%s/%s%s", run->folder, point->step, point->point, suffix);
}

// True if a result has what --lpips and --lpips-input of the run request.
static bool has_lpips(const json_t *result, const post_run *run)
{
    if (!run->lpips)
        return true;
    const char *input = json_string_value(json_object_get(result, "lpips_input"));
    return json_is_number(json_object_get(json_object_get(result, "test"), "lpips")) &&
           !strcmp(input ? input : "unit", run->lpips_input ? run->lpips_input : "unit");
}

json_t *post_result(const post_point *point, const post_run *run)
{
    char *path = point_path(point, run, ".json");
    json_t *result = load_json(path, 0, NULL);
    free(path);
    const char *hash = json_string_value(json_object_get(result, "model_hash"));
    if (hash && !strcmp(hash, run->model_hash) &&
        json_equal(json_object_get(result, "settings"), point->settings) && has_lpips(result, run))
        return result;
    json_decref(result);
    return NULL;
}

// A growing argument list whose texts are released with it.
typedef struct argument_list {
    char *texts[128];
    int count;
} argument_list;

static void add_text(argument_list *list, const char *text)
{
    const int most = (int)(sizeof list->texts / sizeof *list->texts) - 1;
    if (list->count < most) // the options of a command are fewer
        list->texts[list->count++] = format_text("%s", text);
}

static void add_option(argument_list *list, const char *name, const char *value)
{
    if (!value)
        return;
    add_text(list, name);
    add_text(list, value);
}

static void argument_list_free(argument_list *list)
{
    for (int k = 0; k < list->count; ++k)
        free(list->texts[k]);
}

// Runs a command with --json. Its result, or NULL after printing the error.
static json_t *run_for_result(argument_list *list, const post_run *run, const char *output,
                              int *status)
{
    add_option(list, "--threads", run->threads);
    add_option(list, "--isa", run->isa);
    add_text(list, "--json");
    add_text(list, "--quiet");
    char *log = sub_command_log(run->folder);
    *status = sub_command_run((const char *const *)list->texts, output, log);
    free(log);
    json_t *result = *status ? NULL : load_json(output, 0, NULL);
    unlink(output);
    if (!*status && !result)
        *status = fail_run("%s: the result of 'sparegs %s' is not JSON", output, list->texts[0]);
    return result;
}

// False for methods on which `compress` warns that SCENE has no effect.
static bool takes_scene(const post_point *point)
{
    return strcmp(point->method, "sog") != 0 && strcmp(point->method, "fcgs-like") != 0;
}

// Makes `file`: a pruned model or a compressed file.
static json_t *make_file(const post_point *point, const post_run *run, const char *file,
                         const char *output, int *status)
{
    argument_list list = {0};
    add_text(&list, point->kind);
    add_text(&list, run->folder);
    if (takes_scene(point))
        add_text(&list, run->scene_path);
    add_option(&list, "-o", file);
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(point->settings, "options"), key, value)
    {
        char *name = option_name(key), *flag = format_text("--%s", name);
        char *text = json_is_boolean(value) ? NULL : plan_value_text(value);
        if (text)
            add_option(&list, flag, text);
        else if (json_is_true(value))
            add_text(&list, flag);
        free(name);
        free(flag);
        free(text);
    }
    json_t *result = run_for_result(&list, run, output, status);
    argument_list_free(&list);
    return result;
}

static json_t *decompress(const post_run *run, const char *file, const char *model,
                          const char *output, int *status)
{
    argument_list list = {0};
    add_text(&list, "decompress");
    add_text(&list, file);
    add_option(&list, "-o", model);
    json_t *result = run_for_result(&list, run, output, status);
    argument_list_free(&list);
    return result;
}

static json_t *evaluate(const post_run *run, const char *model, const char *output, int *status)
{
    argument_list list = {0};
    add_text(&list, "eval");
    add_text(&list, model);
    add_text(&list, run->scene_path);
    add_option(&list, "--run", run->folder);
    add_option(&list, "--split", "test");
    add_option(&list, "--lpips", run->lpips);
    add_option(&list, "--lpips-input", run->lpips ? run->lpips_input : NULL);
    json_t *result = run_for_result(&list, run, output, status);
    argument_list_free(&list);
    return result;
}

static bool record(const post_point *point, const post_run *run, json_t *made, json_t *decoded,
                   json_t *evaluated)
{
    // `prune` lists its outputs, `compress` has one.
    const json_t *file = json_array_get(json_object_get(made, "outputs"), 0);
    file = file ? file : made;
    json_t *result = json_pack("{s:s,s:s,s:s,s:s,s:O,s:s}", "step", point->step, "kind",
                               point->kind, "method", point->method, "point", point->point,
                               "settings", point->settings, "model_hash", run->model_hash);
    json_object_set(result, "gaussians", json_object_get(file, "gaussians"));
    json_object_set(result, "bytes", json_object_get(file, "bytes"));
    json_object_set(result, "seconds", json_object_get(made, "seconds"));
    json_object_set(result, "decode_seconds",
                    decoded ? json_object_get(decoded, "seconds") : json_null());
    json_object_set(result, "test", json_object_get(evaluated, "mean"));
    json_object_set(result, "lpips_input", json_object_get(evaluated, "lpips_input"));
    json_t *session = session_of(run->threads, run->isa);
    json_object_update(result, session);
    json_decref(session);
    char *path = point_path(point, run, ".json");
    const bool written = write_json(path, result);
    free(path);
    return written;
}

int post_execute(const post_point *point, const post_run *run)
{
    const bool compresses = !strcmp(point->kind, "compress");
    char *model = point_path(point, run, ".ply"), *output = point_path(point, run, ".out");
    char *file = compresses ? point_path(point, run, ".bin") : format_text("%s", model);
    json_t *decoded = NULL, *evaluated = NULL, *made = NULL;
    int status = make_folder_of(file) ? EXIT_DONE : EXIT_FAILED;
    if (!status)
        made = make_file(point, run, file, output, &status);
    if (!status && compresses && !interrupt_signal())
        decoded = decompress(run, file, model, output, &status);
    if (!status && !interrupt_signal())
        evaluated = evaluate(run, model, output, &status);
    if (!status && evaluated && !interrupt_signal() &&
        !record(point, run, made, decoded, evaluated))
        status = EXIT_FAILED;
    unlink(model);
    json_decref(made);
    json_decref(decoded);
    json_decref(evaluated);
    free(model);
    free(file);
    free(output);
    return status;
}
