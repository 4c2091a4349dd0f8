// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "arguments/recorded_options.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "cli/progress.h"
#include "options/options.h"

typedef struct recorded_option {
    const char *name;
    option_kind kind;
    double low, high;  // of INTEGER and REAL
    const char *words; // of CHOICE
} recorded_option;

static const recorded_option recorded_options[] = {
    {.name = "images", .kind = OPTION_TEXT},
    {.name = "downscale", .kind = OPTION_INTEGER, .high = 64},
    {.name = "test_every", .kind = OPTION_INTEGER, .high = 1e6},
    {.name = "test_images", .kind = OPTION_TEXT},
    {.name = "masks", .kind = OPTION_TEXT},
    {.name = "invert_masks", .kind = OPTION_FLAG},
    {.name = "alpha", .kind = OPTION_CHOICE, .words = ALPHA_WORDS},
    {.name = "input_colorspace", .kind = OPTION_TEXT},
    {.name = "train_space", .kind = OPTION_CHOICE, .words = SPACE_WORDS},
    {.name = "white", .kind = OPTION_REAL, .high = 1e30},
    {.name = "filter", .kind = OPTION_CHOICE, .words = FILTER_WORDS},
    {.name = "compact_box", .kind = OPTION_REAL, .low = 1e-9, .high = 1},
    {.name = "background", .kind = OPTION_COLOR},
    {.name = "exposure", .kind = OPTION_FLAG},
};

static const recorded_option near_distance = {
    .name = "near_distance", .kind = OPTION_REAL, .high = 1e9};

static bool in_range(const json_t *value, double low, double high)
{
    return json_is_number(value) && json_number_value(value) >= low &&
           json_number_value(value) <= high;
}

static bool is_color(const json_t *value)
{
    const char *word = json_string_value(value);
    bool is = json_array_size(value) == 3;
    for (size_t c = 0; c < 3 && is; ++c)
        is = in_range(json_array_get(value, c), 0, 1);
    return is || (word && !strcmp(word, "random"));
}

static bool is_valid(const recorded_option *row, const json_t *value)
{
    if (!value || json_is_null(value)) // not recorded, or not given
        return true;
    if (row->kind == OPTION_FLAG)
        return json_is_boolean(value);
    if (row->kind == OPTION_CHOICE)
        return find_word(row->words, json_string_value(value)) >= 0;
    if (row->kind == OPTION_COLOR)
        return is_color(value);
    if (row->kind == OPTION_TEXT)
        return json_is_string(value);
    return (row->kind == OPTION_REAL || json_is_integer(value)) &&
           in_range(value, row->low, row->high);
}

static void check_member(json_t *object, const recorded_option *row, const char *path)
{
    if (is_valid(row, json_object_get(object, row->name)))
        return;
    print_warning("%s: '%s' has an unknown value, which is ignored; correct it, or specify the "
                  "option",
                  path, row->name);
    json_object_del(object, row->name);
}

// The held-out images: a list of names.
static void check_held_out(json_t *config, const char *path)
{
    json_t *list = json_object_get(config, "test_images"), *name;
    size_t i;
    bool valid = !list || json_is_null(list) || json_is_array(list);
    json_array_foreach(list, i, name)
    {
        valid = valid && json_is_string(name);
    }
    if (valid)
        return;
    print_warning("%s: 'test_images' is not a list of names, and is ignored; correct it, or "
                  "specify --test-images, --test-every or --eval",
                  path);
    json_object_del(config, "test_images");
}

void recorded_options_check(json_t *config, const char *path)
{
    json_t *options = json_object_get(config, "options");
    if (!json_is_object(options))
        print_warning("%s: contains no options of a run; the defaults are used", path);
    for (size_t k = 0; k < sizeof recorded_options / sizeof *recorded_options; ++k)
        check_member(options, &recorded_options[k], path);
    check_member(config, &near_distance, path);
    check_held_out(config, path);
}
