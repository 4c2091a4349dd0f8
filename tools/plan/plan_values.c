// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "plan/plan_values.h"

#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"

char *plan_path_resolve(const char *plan, const char *path)
{
    const char *slash = strrchr(plan, '/');
    return *path == '/' || !slash ? format_text("%s", path)
                                  : format_text("%.*s/%s", (int)(slash - plan), plan, path);
}

bool plan_path_option(const char *plan, const char *name, option_path kind, char **text)
{
    char *colon = kind == PATH_BLOCK ? strrchr(*text, ':') : NULL;
    if (kind == PATH_NONE || !**text || (kind == PATH_BLOCK && !colon))
        return true;
    if (colon)
        *colon = 0;
    char *path = plan_path_resolve(plan, *text);
    const bool good = kind == PATH_OUTPUT || file_exists(path);
    if (!good)
        fail_run("%s: option '%s': %s does not exist; paths are relative to the plan", plan, name,
                 path);
    char *resolved = colon ? format_text("%s:%s", path, colon + 1) : format_text("%s", path);
    free(path);
    free(*text);
    *text = resolved;
    return good;
}

char *plan_value_text(const json_t *value)
{
    if (json_is_string(value))
        return format_text("%s", json_string_value(value));
    if (json_is_integer(value))
        return format_text("%lld", (long long)json_integer_value(value));
    if (json_is_real(value))
        return format_text("%.9g", json_real_value(value));
    return json_is_array(value) ? json_joined(value, plan_value_text) : NULL;
}
