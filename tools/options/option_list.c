// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "options/option_list.h"

static const char *const kinds[] = {
    [OPTION_FLAG] = "flag",         [OPTION_INTEGER] = "integer",   [OPTION_COUNT] = "integer",
    [OPTION_SIZE] = "integer",      [OPTION_REAL] = "number",       [OPTION_TEXT] = "text",
    [OPTION_FOLDER] = "text",       [OPTION_CHOICE] = "choice",     [OPTION_SET] = "set",
    [OPTION_INTEGERS] = "integers", [OPTION_DURATION] = "duration", [OPTION_BYTES] = "bytes",
    [OPTION_COLOR] = "color"};

static void set_text(json_t *object, const char *name, const char *text)
{
    json_object_set_new(object, name, text ? json_string(text) : json_null());
}

static json_t *option_json(const option *row, const char *group)
{
    const bool ranged = row->high > row->low;
    const char letter[] = {row->letter, 0};
    json_t *object = json_object();
    set_text(object, "name", row->name);
    set_text(object, "letter", row->letter ? letter : NULL);
    set_text(object, "group", group);
    set_text(object, "kind", kinds[row->kind]);
    set_text(object, "argument", row->argument);
    set_text(object, "default", row->shown ? row->shown : row->initial);
    set_text(object, "unit", row->unit);
    json_object_set_new(object, "minimum", ranged ? json_real(row->low) : json_null());
    json_object_set_new(object, "maximum", ranged ? json_real(row->high) : json_null());
    set_text(object, "needs", row->needs);
    set_text(object, "help", row->help);
    return object;
}

json_t *option_list_json(const command_line *line)
{
    json_t *root = json_object(), *options = json_array();
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i)
            if (option_is_listed(&line->groups[g], &line->groups[g].options[i]))
                json_array_append_new(
                    options, option_json(&line->groups[g].options[i], line->groups[g].title));
    set_text(root, "command", line->command);
    set_text(root, "synopsis", line->synopsis);
    set_text(root, "description", line->description);
    json_object_set_new(root, "options", options);
    return root;
}
