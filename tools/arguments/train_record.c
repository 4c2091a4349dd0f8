// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// config.json is written from the struct that configures the trainer, so a run can be repeated from
// it. Every key under "options" is a long option with '_' in place of '-'. Numbers have 9 digits;
// those that need more are texts under "precise", so that a resumed run computes with the same
// bits.

#include "arguments/train_record.h"

#include <stdlib.h>
#include <string.h>

#include "arguments/model_path.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/option_descriptors.h"
#include "sparegs/runtime.h"

enum { MAX_TEXT = 96 };

// The name of an option from its key. Release with free().
static char *name_of(const char *key)
{
    char *name = format_text("%s", key);
    key_to_name(name);
    return name;
}

static void set_word(json_t *object, const char *key, const char *words, int index)
{
    const char *at = words;
    for (const char *bar; index > 0 && (bar = strchr(at, '|')); --index)
        at = bar + 1;
    json_object_set_new(object, key, json_stringn(at, strcspn(at, "|")));
}

static void set_text(json_t *object, const char *key, const char *text)
{
    json_object_set_new(object, key, json_text(text));
}

static void set_integer(json_t *object, const char *key, uint64_t value)
{
    json_object_set_new(object, key, json_integer((json_int_t)value));
}

// 0 means that the option was not given.
static void set_given(json_t *object, const char *key, int value)
{
    json_object_set_new(object, key, value ? json_integer(value) : json_null());
}

// The words of a set or the numbers of a colour.
static json_t *list_json(const sgs_train_option *row, const sgs_train_options *options)
{
    json_t *list = json_array();
    const void *field = (const char *)options + row->offset;
    const float *color = field;
    for (int c = 0; c < 3 && row->type == SGS_OPTION_COLOR; ++c)
        json_array_append_new(list, json_real((double)color[c]));
    const unsigned bits = row->type == SGS_OPTION_SET ? *(const unsigned *)field : 0;
    const char *word = row->values;
    for (unsigned k = 0; bits >> k; ++k) {
        const size_t length = strcspn(word, ",");
        if (bits >> k & 1)
            json_array_append_new(list, json_stringn(word, length));
        word += length + (word[length] == ',');
    }
    return list;
}

static json_t *value_json(const sgs_train_option *row, const train_values *values)
{
    const sgs_train_options *options = &values->options;
    const void *field = (const char *)options + row->offset;
    char text[MAX_TEXT];
    switch (row->type) {
    case SGS_OPTION_BOOL:
        return json_boolean(*(const bool *)field);
    case SGS_OPTION_INT:
        return json_integer(*(const int *)field);
    case SGS_OPTION_SIZE:
        return json_integer((json_int_t) * (const size_t *)field);
    case SGS_OPTION_UINT64:
        return json_integer((json_int_t) * (const uint64_t *)field);
    case SGS_OPTION_DOUBLE:
        return json_real(*(const double *)field);
    case SGS_OPTION_CHOICE:
        sgs_train_option_text(row, options, text, sizeof text);
        return json_string(text);
    case SGS_OPTION_COLOR:
        if (*(const bool *)((const char *)options + row->random_offset))
            return json_string("random");
        return list_json(row, options);
    case SGS_OPTION_SET:
        return list_json(row, options);
    case SGS_OPTION_BOX:
        sgs_train_option_text(row, options, text, sizeof text);
        return json_string(text);
    case SGS_OPTION_MODEL:
        return json_text(values->init);
    }
    return json_null();
}

// The options that affect the result; a resumed run must use the same.
static json_t *shaping_options(const train_values *values, const scene_values *scene)
{
    json_t *options = json_object();
    set_text(options, "images", scene->images); // null: not given, as the names say
    set_given(options, "downscale", scene->downscale);
    set_given(options, "test_every", scene->test_every);
    set_text(options, "test_images", scene->test_images);
    set_text(options, "masks", scene->masks);
    json_object_set_new(options, "invert_masks", json_boolean(scene->invert_masks));
    set_word(options, "alpha", ALPHA_WORDS, scene->alpha);
    set_text(options, "input_colorspace", scene->colorspace);
    set_word(options, "train_space", SPACE_WORDS, scene->space);
    json_object_set_new(options, "white", json_real(scene->white_point));
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count; ++i)
        json_object_set_new(options, rows[i].name, value_json(&rows[i], values));
    return options;
}

// The texts of numbers that need more digits than the file has.
static json_t *precise_options(const train_values *values, const scene_values *scene)
{
    json_t *precise = json_object();
    char text[MAX_TEXT], stored[MAX_TEXT];
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count; ++i) {
        if (rows[i].type != SGS_OPTION_DOUBLE)
            continue;
        const double value = *(const double *)((const char *)&values->options + rows[i].offset);
        sgs_train_option_text(&rows[i], &values->options, text, sizeof text);
        snprintf(stored, sizeof stored, "%.9g", value);
        if (strtod(stored, NULL) != value)
            json_object_set_new(precise, rows[i].name, json_string(text));
    }
    snprintf(text, sizeof text, "%.17g", scene->white_point);
    snprintf(stored, sizeof stored, "%.9g", scene->white_point);
    if (strtod(stored, NULL) != scene->white_point)
        json_object_set_new(precise, "white", json_string(text));
    return precise;
}

json_t *train_config(const char *scene_path, const train_values *values, const scene_values *scene,
                     const common_values *common)
{
    json_t *config = json_object(), *save_at = json_array();
    for (int i = 0; i < values->save_at.count; ++i)
        json_array_append_new(save_at, json_integer(values->save_at.values[i]));
    set_text(config, "version", sgs_version());
    set_text(config, "commit", sgs_version_commit());
    set_text(config, "libraries", sgs_version_libraries());
    set_text(config, "isa", sgs_isa_name(sgs_isa_get()));
    set_integer(config, "threads", (uint64_t)sgs_threads_get());
    set_text(config, "scene", scene_path);
    set_integer(config, "seed", common->seed);
    json_object_set_new(config, "options", shaping_options(values, scene));
    json_object_set_new(config, "precise", precise_options(values, scene));
    json_object_set_new(config, "save_at", save_at);
    set_integer(config, "checkpoint_every", (uint64_t)values->checkpoint_every);
    set_text(config, "lpips", values->lpips);
    set_word(config, "lpips_input", LPIPS_INPUT_WORDS, values->lpips_input);
    json_object_set_new(config, "eval_train",
                        values->eval_train == EVALUATE_ALL ? json_string("all")
                                                           : json_integer(values->eval_train));
    return config;
}

// True if equal at the precision of the file.
static bool same_value(const json_t *a, const json_t *b)
{
    if (json_is_array(a) && json_is_array(b) && json_array_size(a) == json_array_size(b)) {
        for (size_t i = 0; i < json_array_size(a); ++i)
            if (!same_value(json_array_get(a, i), json_array_get(b, i)))
                return false;
        return true;
    }
    if (json_is_real(a) && json_is_number(b)) {
        char x[32], y[32];
        snprintf(x, sizeof x, "%.9g", json_number_value(a));
        snprintf(y, sizeof y, "%.9g", json_number_value(b));
        return !strcmp(x, y);
    }
    return json_equal(a, b);
}

// True if the option was not given, or is the default of COLMAP data sets, which earlier versions
// recorded in its place.
static bool is_default_folder(const json_t *images)
{
    const char *name = json_string_value(images);
    return json_is_null(images) || (name && !strcmp(name, "images"));
}

// A value as written on the command line.
static char *option_text(const json_t *value)
{
    if (json_is_null(value))
        return format_text("not given");
    if (json_is_string(value))
        return format_text("%s", json_string_value(value));
    if (!json_is_array(value)) {
        char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(9));
        return text ? text : format_text("?");
    }
    return json_array_size(value) ? json_joined(value, option_text) : format_text("off");
}

bool train_config_agrees(const char *config_path, const json_t *stored, const json_t *now,
                         const sgs_train_options *options)
{
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(now, "options"), key, value)
    {
        const json_t *old = config_option(stored, key);
        const sgs_train_option *row = sgs_train_option_find(key);
        if (same_value(value, old) || (old && row && sgs_train_option_may_change(row, options)))
            continue; // the library warns about a change
        if (!strcmp(key, "init") && json_object_get(now, "init_hash") &&
            same_value(json_object_get(now, "init_hash"), json_object_get(stored, "init_hash")))
            continue; // the same model under another path
        if (!strcmp(key, "images") && is_default_folder(value) && is_default_folder(old))
            continue;
        char *name = name_of(key), *is = option_text(value);
        char *was = old ? option_text(old) : format_text("not recorded");
        fail_run("%s: --%s was %s when the run started and is %s now; resume with the same "
                 "options, or train into another folder",
                 config_path, name, was, is);
        free(was);
        free(is);
        free(name);
        return false;
    }
    return true;
}

// The recorded value of an option as written on the command line; NULL if it has none.
static char *recorded_text(const json_t *stored, const char *key)
{
    const json_t *value = config_option(stored, key);
    const json_t *precise = json_object_get(json_object_get(stored, "precise"), key);
    if (!value || json_is_null(value) || json_is_false(value))
        return NULL;
    return option_text(json_is_string(precise) ? precise : value);
}

// --region as recorded: a box, or a plan and its block.
static char *recorded_region(const json_t *stored)
{
    const json_t *block = json_object_get(stored, "block"),
                 *index = json_object_get(block, "index");
    const char *plan = json_string_value(json_object_get(block, "plan"));
    if (plan && json_is_integer(index))
        return format_text("%s:%d", plan, (int)json_integer_value(index));
    char *box = recorded_text(stored, "region");
    if (!box || strcmp(box, "none") != 0)
        return box;
    free(box);
    return NULL;
}

// Fills one option. Texts that the values point to belong to `stored` and to `values`.
static bool recall(const command_line *line, const json_t *stored, const char *key,
                   train_values *values)
{
    const bool is_region = !strcmp(key, "region");
    char *name = name_of(key);
    char *text = is_region ? recorded_region(stored) : recorded_text(stored, key);
    const char *model = json_string_value(config_option(stored, key));
    const bool is_model = !strcmp(key, "init") && model;
    const bool filled = !text || option_fill(line, name, is_model ? model : text);
    if (is_region)
        values->region_text = text;
    else
        free(text);
    free(name);
    return filled;
}

// --checkpoint-every as given when the run started; NULL if it was not. Earlier versions did not
// record which.
static char *recorded_interval(const json_t *stored)
{
    const json_t *every = json_object_get(stored, "checkpoint_every"),
                 *given = json_object_get(stored, "checkpoint_every_given");
    const bool was_given = given ? json_is_true(given) : json_integer_value(every) != 1000;
    return every && was_given ? option_text(every) : NULL;
}

// Fills the options of the output, whose effect a run keeps. The path of the weights belongs to
// `stored`.
static bool recall_output(const command_line *line, const char *config_path, const json_t *stored,
                          const train_values *values)
{
    const json_t *list = json_object_get(stored, "save_at");
    const char *lpips = json_string_value(json_object_get(stored, "lpips")),
               *input = json_string_value(json_object_get(stored, "lpips_input"));
    const json_t *eval_train = json_object_get(stored, "eval_train");
    char *images = eval_train ? option_text(eval_train) : NULL;
    char *save_at = json_array_size(list) ? option_text(list) : NULL,
         *every = recorded_interval(stored);
    fail_usage_within(config_path);
    const bool filled = (!save_at || option_fill(line, "save-at", save_at)) &&
                        (!every || option_fill(line, "checkpoint-every", every)) &&
                        (!lpips || option_fill(line, "lpips", lpips)) &&
                        (!lpips || !input || option_fill(line, "lpips-input", input)) &&
                        (!images || option_fill(line, "eval-train", images));
    fail_usage_within(NULL);
    free(save_at);
    free(every);
    free(images);
    if (!filled || !lpips || values->lpips != lpips || file_exists(lpips))
        return filled;
    fail_run("%s: the LPIPS weights of the run, %s, do not exist; specify their file with "
             "--lpips FILE",
             config_path, lpips);
    return false;
}

bool train_config_recall(const command_line *line, const char *config_path, const json_t *stored,
                         train_values *values, scene_values *scene)
{
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    bool filled = true;
    fail_usage_within(config_path);
    for (size_t i = 0; i < count && filled; ++i)
        filled = recall(line, stored, rows[i].name, values);
    fail_usage_within(NULL);
    filled = filled && recall_output(line, config_path, stored, values);
    if (!filled || scene_resolve(scene, line, stored) >= 0)
        return false;
    // Earlier versions recorded a measured white point with 9 digits only: it is measured again.
    const json_t *precise = json_object_get(stored, "precise");
    const char *white = json_string_value(json_object_get(precise, "white"));
    if (!option_given(line, "white"))
        scene->white_point = white ? strtod(white, NULL) : precise ? scene->white_point : 0;
    if (!option_given(line, "images") && !precise &&
        is_default_folder(config_option(stored, "images")))
        scene->images = NULL;
    return true;
}

static bool is_saved(const char *folder, json_int_t iteration)
{
    char *path = format_text("%s/point_cloud/iteration_%d/point_cloud.ply", folder, (int)iteration);
    const bool exists = file_exists(path);
    free(path);
    return exists;
}

// Warns about new iterations of --save-at that a run which resumes at `iteration` has passed
// without a model.
static void warn_passed(const char *folder, const json_t *stored, const json_t *now, int iteration)
{
    const json_t *list = json_object_get(now, "save_at"), *old = json_object_get(stored, "save_at");
    const json_int_t last = json_integer_value(config_option(now, "iterations"));
    for (size_t i = 0; i < json_array_size(list); ++i) {
        const json_int_t at = json_integer_value(json_array_get(list, i));
        bool known = at > iteration || at == last; // the last one is always saved
        for (size_t k = 0; k < json_array_size(old); ++k)
            known = known || at == json_integer_value(json_array_get(old, k));
        if (!known && !is_saved(folder, at))
            print_warning("--save-at: the run resumes at iteration %d; the model of iteration %d "
                          "cannot be saved",
                          iteration, (int)at);
    }
}

void train_config_record(const char *folder, const json_t *stored, json_t *now, int iteration)
{
    warn_passed(folder, stored, now, iteration);
    json_t *list = json_deep_copy(json_object_get(stored, "resumed")), *entry = json_object(),
           *changed = json_object();
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(now, "options"), key, value)
    {
        json_t *old = config_option(stored, key);
        if (!same_value(value, old))
            json_object_set(changed, key, old);
    }
    json_object_set_new(entry, "iteration", json_integer(iteration));
    json_object_set_new(entry, "changed_from", changed);
    if (!json_is_array(list)) {
        json_decref(list);
        list = json_array();
    }
    json_array_append_new(list, entry);
    json_object_set_new(now, "resumed", list);
}
