// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A plan:
//   {"scenes": [{"name": "room", "path": "data/room", "data_set": "indoor",
//                "options": {"downscale": 2}}],
//    "pipelines": ["3dgs", "mip"],
//    "variants": [{"name": "off", "options": {"spare": "off"}}, {"name": "on"},
//                 {"name": "tau-0.1", "pipelines": ["3dgs"], "options": {"spare_tau_alpha": 0.1}}],
//    "seeds": [0, 1],
//    "options": {"iterations": 7000, "eval": true}}
// Options are those of `sparegs train`, with '_' or '-'. A scene's options override the plan's, a
// variant's override both. "variants" defaults to off and on. "data_set" groups scenes in the
// tables; all scenes have one, or none. "post" is described in experiment_post.h.
// Seeds and pipelines are distinct, and the runs at most MAX_RUNS. Paths are relative to the
// plan's folder, those of scenes and of options; "images" and "masks" are folders of the scene.

#include "plan/experiment_plan.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "cli/commands.h"
#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "options/options.h"
#include "plan/plan_values.h"
#include "sparegs/scene.h"

enum { MAX_RUNS = 10000 };

static const char *plan_path;

static bool refuse(const char *what, const char *name)
{
    fail_run("%s: %s '%s'", plan_path, what, name);
    return false;
}

// Names are used as folder names.
static bool check_name(const char *what, const json_t *value)
{
    const char *name = json_string_value(value);
    if (!name || !*name || strlen(name) > 60 || *name == '.' ||
        strspn(name, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-") !=
            strlen(name)) {
        fail_run("%s: invalid %s name %s%s%s; use letters, digits, '.', '_' and '-'", plan_path,
                 what, name ? "'" : "(missing)", name ? name : "", name ? "'" : "");
        return false;
    }
    return true;
}

static void add_argument(experiment_run *run, char *text)
{
    run->arguments =
        realloc(run->arguments, (size_t)(run->argument_count + 2) * sizeof *run->arguments);
    if (!run->arguments)
        exit(fail_run("out of memory"));
    run->arguments[run->argument_count++] = text;
    run->arguments[run->argument_count] = NULL;
}

// Appends the merged options of a run as arguments.
static bool add_options(experiment_run *run, json_t *options)
{
    static const char *const own[] = {"output", "resume", "overwrite", "json",
                                      "quiet",  "help",   "seed",      "pipeline"};
    const char *key;
    json_t *value;
    json_object_foreach(options, key, value)
    {
        char *name = format_text("--%s", key);
        key_to_name(name);
        for (size_t k = 0; k < sizeof own / sizeof *own; ++k)
            if (!strcmp(name + 2, own[k])) {
                free(name);
                return refuse("option is set by the experiment:", own[k]);
            }
        const option *row = command_train_option(name + 2);
        if (row && row->kind == OPTION_FLAG && !json_is_boolean(value)) {
            free(name);
            return refuse("expected true or false for option", key);
        }
        if (json_is_true(value)) {
            add_argument(run, name);
            continue;
        }
        char *text = json_is_false(value) ? NULL : plan_value_text(value);
        if (text && row && !plan_path_option(plan_path, key, row->path, &text)) {
            free(text);
            free(name);
            return false;
        }
        if (text) {
            add_argument(run, name);
            add_argument(run, text);
        } else {
            free(name);
        }
        if (!text && !json_is_false(value))
            return refuse("expected a number, string, list or boolean for option", key);
    }
    return true;
}

json_t *experiment_plan_options(const json_t *options)
{
    json_t *copy = json_object();
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)options, key, value)
    {
        char *name = format_text("%s", key);
        for (char *dash = name; (dash = strchr(dash, '-'));)
            *dash = '_';
        json_object_set(copy, name, value);
        free(name);
    }
    return copy;
}

static json_t *merged_options(const json_t *plan, const json_t *scene, const json_t *variant)
{
    json_t *all = json_object();
    const json_t *const parts[] = {plan, scene, variant};
    for (int k = 0; k < 3; ++k) {
        json_t *options = experiment_plan_options(json_object_get(parts[k], "options"));
        json_object_update(all, options);
        json_decref(options);
    }
    return all;
}

// True if the variant runs with this pipeline.
static bool applies(const json_t *variant, const json_t *pipeline)
{
    const json_t *only = json_object_get(variant, "pipelines");
    for (size_t k = 0; k < json_array_size(only); ++k)
        if (json_equal(pipeline, json_array_get(only, k)))
            return true;
    return !only;
}

static char *scene_path(const json_t *scene)
{
    const char *path = json_string_value(json_object_get(scene, "path"));
    return path ? plan_path_resolve(plan_path, path) : format_text("%s", "");
}

// Removes "--name" and its value from the arguments of a run.
static void remove_argument(experiment_run *run, const char *name)
{
    int kept = 0;
    for (int k = 0; k < run->argument_count; ++k) {
        if (!strncmp(run->arguments[k], "--", 2) && !strcmp(run->arguments[k] + 2, name)) {
            free(run->arguments[k]);
            const bool has_value =
                k + 1 < run->argument_count && strncmp(run->arguments[k + 1], "--", 2) != 0;
            if (has_value)
                free(run->arguments[++k]);
            continue;
        }
        run->arguments[kept++] = run->arguments[k];
    }
    run->argument_count = kept;
    run->arguments[kept] = NULL;
}

// The member of an options object that is --name, with either spelling.
static bool has_option(const json_t *options, const char *name)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)options, key, value)
    {
        char *flag = format_text("%s", key);
        key_to_name(flag);
        const bool same = !strcmp(flag, name);
        free(flag);
        if (same)
            return true;
    }
    return false;
}

void experiment_run_drop_idle(const experiment_run *run, json_t *options)
{
    const char *key;
    json_t *value;
    void *next;
    json_object_foreach_safe(options, next, key, value)
    {
        char *flag = format_text("%s", key);
        key_to_name(flag);
        bool idle = false;
        for (size_t k = 0; k < json_array_size(run->idle) && !idle; ++k)
            idle = !strcmp(flag, json_string_value(json_array_get(run->idle, k)));
        free(flag);
        if (idle)
            json_object_del(options, key);
    }
}

// Checks the command line of a run. An option of the plan or of a scene belongs to those of its
// runs that it has an effect on; one of the variant must have an effect.
static bool check_run(experiment_run *run, const json_t *variant)
{
    const char *idle = NULL;
    while (command_train_check(run->argument_count, run->arguments, &idle) < 0) {
        if (!idle) {
            experiment_run_drop_idle(run, json_object_get(run->settings, "options"));
            return true;
        }
        if (has_option(json_object_get(variant, "options"), idle))
            return command_train_check(run->argument_count, run->arguments, NULL) < 0;
        json_array_append_new(run->idle, json_string(idle));
        remove_argument(run, idle);
    }
    return false;
}

static bool add_run(experiment_plan *plan, const char *folder, const json_t *scene,
                    const char *pipeline, const json_t *variant, int seed)
{
    plan->runs = realloc(plan->runs, (plan->count + 1) * sizeof *plan->runs);
    if (!plan->runs)
        exit(fail_run("out of memory"));
    experiment_run *run = &plan->runs[plan->count++];
    *run = (experiment_run){.seed = seed, .idle = json_array()};
    run->scene = format_text("%s", json_string_value(json_object_get(scene, "name")));
    run->pipeline = format_text("%s", pipeline);
    run->variant = format_text("%s", json_string_value(json_object_get(variant, "name")));
    run->folder = format_text("%s/runs/%s/%s/%s/seed_%d", folder, run->scene, run->pipeline,
                              run->variant, seed);
    add_argument(run, format_text("train"));
    add_argument(run, scene_path(scene));
    add_argument(run, format_text("-o"));
    add_argument(run, format_text("%s", run->folder));
    add_argument(run, format_text("--pipeline"));
    add_argument(run, format_text("%s", pipeline));
    add_argument(run, format_text("--seed"));
    add_argument(run, format_text("%d", seed));
    json_t *options = merged_options(plan->root, scene, variant);
    const char *path = json_string_value(json_object_get(scene, "path"));
    json_t *settings = json_pack("{s:s,s:s,s:i,s:o}", "scene", path ? path : "", "pipeline",
                                 pipeline, "seed", seed, "options", options);
    run->settings = json_as_stored(settings);
    const bool added = add_options(run, options);
    json_decref(settings);
    if (!added)
        return false;
    char *context = format_text("%s: scene %s, pipeline %s, variant %s", plan_path, run->scene,
                                run->pipeline, run->variant);
    fail_usage_within(context);
    const bool good = check_run(run, variant);
    fail_usage_within(NULL);
    free(context);
    return good;
}

const char *experiment_run_argument(const experiment_run *run, const char *name)
{
    for (int k = 0; k + 1 < run->argument_count; ++k)
        if (!strncmp(run->arguments[k], "--", 2) && !strcmp(run->arguments[k] + 2, name))
            return run->arguments[k + 1];
    return NULL;
}

void experiment_run_add(experiment_run *run, const char *name, const char *value)
{
    if (experiment_run_argument(run, name))
        return;
    add_argument(run, format_text("--%s", name));
    if (value)
        add_argument(run, format_text("%s", value));
}

static bool has_argument(const experiment_run *run, const char *flag)
{
    for (int k = 0; k < run->argument_count; ++k)
        if (!strcmp(run->arguments[k], flag))
            return true;
    return false;
}

// Every option of the plan, or of a scene, has an effect on some of its runs.
static bool check_effects(const experiment_plan *plan, const json_t *owner, const char *scene)
{
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(owner, "options"), key, value)
    {
        char *flag = format_text("--%s", key);
        key_to_name(flag);
        bool found = json_is_false(value);
        for (size_t i = 0; i < plan->count && !found; ++i)
            found = (!scene || !strcmp(plan->runs[i].scene, scene)) &&
                    has_argument(&plan->runs[i], flag);
        free(flag);
        if (!found)
            return refuse(scene ? "an option of a scene has no effect on any of its runs; remove"
                                : "an option has no effect on any run of the plan; remove",
                          key);
    }
    return true;
}

// Every step after the training has a run.
static bool check_steps(const experiment_plan *plan)
{
    for (size_t k = 0; k < plan->post.count; ++k) {
        bool found = false;
        for (size_t i = 0; i < plan->count && !found; ++i)
            found = post_applies(&plan->post.points[k], plan->runs[i].variant);
        if (!found) {
            fail_run("%s: post: step '%s' has no run: its variants have no pipeline of the plan; "
                     "set \"variants\" of the step, or remove it",
                     plan_path, plan->post.points[k].step);
            return false;
        }
    }
    return true;
}

// Warns of traces that replace each other.
static void warn_about_traces(const experiment_plan *plan)
{
    json_t *seen = json_object();
    for (size_t i = 0; i < plan->count; ++i) {
        const char *trace = experiment_run_argument(&plan->runs[i], "trace");
        if (trace && json_object_get(seen, trace)) {
            print_warning("%s: several runs write the trace '%s'; the last one remains", plan_path,
                          trace);
            break;
        }
        if (trace)
            json_object_set_new(seen, trace, json_true());
    }
    json_decref(seen);
}

// Each scene can be read, from each folder of photos that its runs use.
static bool check_scene_files(const experiment_plan *plan)
{
    json_t *seen = json_object();
    bool good = true;
    for (size_t i = 0; i < plan->count && good; ++i) {
        const char *path = plan->runs[i].arguments[1];
        sgs_scene_options options = sgs_scene_options_default();
        options.load_images = false;
        options.images_dir = experiment_run_argument(&plan->runs[i], "images");
        char *key = format_text("%s\n%s", path, options.images_dir ? options.images_dir : "");
        sgs_scene *loaded = NULL;
        if (!json_object_get(seen, key) && sgs_scene_load(path, &options, &loaded)) {
            fail_library();
            good = false;
        }
        json_object_set_new(seen, key, json_true());
        sgs_scene_destroy(loaded);
        free(key);
    }
    json_decref(seen);
    return good;
}

static bool check_keys(const json_t *object, const char *const known[], size_t count)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)object, key, value)
    {
        char near[SUGGESTION_LENGTH];
        bool found = false;
        for (size_t k = 0; k < count; ++k)
            found = found || !strcmp(key, known[k]);
        if (!found) {
            fail_run("%s: unknown key '%s'%s", plan_path, key,
                     suggestion(near, "", key, known, count));
            return false;
        }
    }
    return true;
}

// "options" of the plan (without `what`), of a scene or of a variant.
static bool check_options(const json_t *owner, const char *what, const char *name)
{
    const json_t *options = json_object_get(owner, "options");
    if (options && !json_is_object(options)) {
        fail_run("%s: %s%s%s\"options\" must be an object: {\"iterations\": 7000}", plan_path, what,
                 name, *what ? ": " : "");
        return false;
    }
    json_t *distinct = experiment_plan_options(options);
    const bool good = json_object_size(distinct) == json_object_size(options);
    json_decref(distinct);
    if (!good)
        fail_run("%s: %s%s%s\"options\" names an option twice, with '-' and with '_'", plan_path,
                 what, name, *what ? ": " : "");
    return good;
}

// A list of distinct strings.
static bool check_pipelines(const char *what, const json_t *list)
{
    json_t *seen = json_object();
    bool good = json_array_size(list) > 0;
    for (size_t k = 0; k < json_array_size(list) && good; ++k) {
        const char *pipeline = json_string_value(json_array_get(list, k));
        good = pipeline && !json_object_get(seen, pipeline) &&
               !json_object_set_new(seen, pipeline, json_true());
    }
    json_decref(seen);
    if (!good)
        fail_run("%s: \"pipelines\"%s must be a list of distinct names", plan_path, what);
    return good;
}

static bool check_seeds(const json_t *seeds)
{
    bool good = json_array_size(seeds) > 0 || !seeds;
    for (size_t k = 0; k < json_array_size(seeds) && good; ++k) {
        const json_t *seed = json_array_get(seeds, k);
        good = json_is_integer(seed) && json_integer_value(seed) >= 0 &&
               json_integer_value(seed) <= INT_MAX;
        for (size_t j = 0; j < k && good; ++j)
            good = json_integer_value(json_array_get(seeds, j)) != json_integer_value(seed);
    }
    if (!good)
        fail_run("%s: \"seeds\" must be a list of distinct integers from 0 to %d", plan_path,
                 INT_MAX);
    return good;
}

static bool check_members(const json_t *root)
{
    static const char *const known[] = {"scenes",  "pipelines", "variants", "seeds",
                                        "options", "title",     "post"};
    static const char *const lists[] = {"scenes", "pipelines", "variants", "seeds"};
    if (!check_keys(root, known, sizeof known / sizeof *known))
        return false;
    if (!json_array_size(json_object_get(root, "scenes")) ||
        !json_array_size(json_object_get(root, "pipelines"))) {
        fail_run("%s: \"scenes\" and \"pipelines\" are required and must be non-empty lists",
                 plan_path);
        return false;
    }
    for (size_t k = 0; k < sizeof lists / sizeof *lists; ++k)
        if (json_array_size(json_object_get(root, lists[k])) > MAX_RUNS) {
            fail_run("%s: \"%s\" has %zu entries; the limit is %d", plan_path, lists[k],
                     json_array_size(json_object_get(root, lists[k])), MAX_RUNS);
            return false;
        }
    return check_options(root, "", "") && check_pipelines("", json_object_get(root, "pipelines")) &&
           check_seeds(json_object_get(root, "seeds"));
}

// Checks that the names of a list are valid and unique.
static bool check_names(const char *what, const json_t *list)
{
    for (size_t k = 0; k < json_array_size(list); ++k) {
        const json_t *name = json_object_get(json_array_get(list, k), "name");
        if (!check_name(what, name))
            return false;
        for (size_t j = 0; j < k; ++j)
            if (json_equal(name, json_object_get(json_array_get(list, j), "name")))
                return refuse("duplicate name", json_string_value(name));
    }
    return true;
}

// Checks the members of the scenes. Data sets are all or nothing: a mean over data sets would
// otherwise omit scenes.
static bool check_scenes(const json_t *scenes)
{
    static const char *const known[] = {"name", "path", "data_set", "options"};
    const bool in_sets = json_object_get(json_array_get(scenes, 0), "data_set");
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        const json_t *scene = json_array_get(scenes, s),
                     *data_set = json_object_get(scene, "data_set");
        const char *name = json_string_value(json_object_get(scene, "name"));
        if (in_sets != (data_set != NULL))
            return refuse(in_sets ? "\"data_set\" is missing for scene"
                                  : "the first scene has no \"data_set\", but scene",
                          name);
        if (data_set && !check_name("data set", data_set))
            return false;
        if (!check_keys(scene, known, sizeof known / sizeof *known) ||
            !check_options(scene, "scene ", name))
            return false;
    }
    return true;
}

static bool check_variants(const json_t *variants)
{
    static const char *const known[] = {"name", "pipelines", "options"};
    if (!json_array_size(variants)) {
        fail_run("%s: \"variants\" must be a non-empty list", plan_path);
        return false;
    }
    for (size_t v = 0; v < json_array_size(variants); ++v) {
        const json_t *variant = json_array_get(variants, v),
                     *pipelines = json_object_get(variant, "pipelines");
        const char *name = json_string_value(json_object_get(variant, "name"));
        char *of = format_text(" of variant %s", name);
        const bool good = check_keys(variant, known, sizeof known / sizeof *known) &&
                          check_options(variant, "variant ", name) &&
                          (!pipelines || check_pipelines(of, pipelines));
        free(of);
        if (!good)
            return false;
    }
    return true;
}

// Checks the number of runs before they are made.
static bool check_count(const json_t *root)
{
    const json_t *pipelines = json_object_get(root, "pipelines"),
                 *variants = json_object_get(root, "variants"),
                 *seeds = json_object_get(root, "seeds");
    const size_t each =
        json_array_size(json_object_get(root, "scenes")) * (seeds ? json_array_size(seeds) : 1);
    size_t count = 0;
    for (size_t p = 0; p < json_array_size(pipelines); ++p)
        for (size_t v = 0; v < json_array_size(variants); ++v) {
            count += applies(json_array_get(variants, v), json_array_get(pipelines, p)) ? each : 0;
            if (count <= MAX_RUNS)
                continue;
            fail_run("%s: the plan has more than %d runs; divide it", plan_path, MAX_RUNS);
            return false;
        }
    return true;
}

static bool unroll(experiment_plan *plan, const char *folder)
{
    const json_t *scenes = json_object_get(plan->root, "scenes"),
                 *pipelines = json_object_get(plan->root, "pipelines");
    const json_t *variants = json_object_get(plan->root, "variants"),
                 *seeds = json_object_get(plan->root, "seeds");
    const size_t seed_count = seeds ? json_array_size(seeds) : 1;
    for (size_t s = 0; s < json_array_size(scenes); ++s) {
        const json_t *scene = json_array_get(scenes, s);
        const char *path = json_string_value(json_object_get(scene, "path"));
        if (!path || !*path)
            return refuse("missing \"path\" of scene",
                          json_string_value(json_object_get(scene, "name")));
    }
    // Seeds are the outer loop: an interrupted experiment completes one seed before the next.
    for (size_t k = 0; k < seed_count; ++k)
        for (size_t s = 0; s < json_array_size(scenes); ++s)
            for (size_t p = 0; p < json_array_size(pipelines); ++p)
                for (size_t v = 0; v < json_array_size(variants); ++v) {
                    const json_t *pipeline = json_array_get(pipelines, p),
                                 *variant = json_array_get(variants, v);
                    const int seed = seeds ? (int)json_integer_value(json_array_get(seeds, k)) : 0;
                    if (applies(variant, pipeline) &&
                        !add_run(plan, folder, json_array_get(scenes, s),
                                 json_string_value(pipeline), variant, seed))
                        return false;
                }
    if (!plan->count)
        fail_run("%s: the plan contains no runs; no variant has a pipeline of the plan", plan_path);
    bool good = plan->count > 0 && check_effects(plan, plan->root, NULL);
    for (size_t s = 0; s < json_array_size(scenes) && good; ++s)
        good = check_effects(plan, json_array_get(scenes, s),
                             json_string_value(json_object_get(json_array_get(scenes, s), "name")));
    good = good && check_steps(plan) && check_scene_files(plan);
    if (good)
        warn_about_traces(plan);
    return good;
}

bool experiment_plan_read(const char *path, const char *folder, experiment_plan *plan)
{
    *plan = (experiment_plan){0};
    plan_path = path;
    plan->root = read_json(path);
    bool fine = json_is_object(plan->root);
    if (plan->root && !fine)
        fail_run("%s: not a JSON object", path);
    if (fine && !json_object_get(plan->root, "variants"))
        json_object_set_new(plan->root, "variants",
                            json_pack("[{s:s,s:{s:s}},{s:s,s:{s:s}}]", "name", "off", "options",
                                      "spare", "off", "name", "on", "options", "spare", "on"));
    fine = fine && check_members(plan->root) &&
           check_names("scene", json_object_get(plan->root, "scenes")) &&
           check_scenes(json_object_get(plan->root, "scenes")) &&
           check_names("variant", json_object_get(plan->root, "variants")) &&
           check_variants(json_object_get(plan->root, "variants")) && check_count(plan->root) &&
           post_plan_read(path, plan->root, &plan->post) && unroll(plan, folder);
    if (!fine)
        experiment_plan_free(plan);
    return fine;
}

void experiment_plan_free(experiment_plan *plan)
{
    for (size_t i = 0; i < plan->count; ++i) {
        experiment_run *run = &plan->runs[i];
        for (int k = 0; k < run->argument_count; ++k)
            free(run->arguments[k]);
        free(run->arguments);
        free(run->scene);
        free(run->pipeline);
        free(run->variant);
        free(run->folder);
        json_decref(run->settings);
        json_decref(run->idle);
    }
    free(plan->runs);
    post_plan_free(&plan->post);
    json_decref(plan->root);
    *plan = (experiment_plan){0};
}
