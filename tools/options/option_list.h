// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The option tables as JSON, for programs that build a command line: `sparegs help --json` and
// `sparegs COMMAND --help --json`.

#include <jansson.h>

#include "options/options.h"

// {"command","synopsis","description","options":[{"name","letter","group","kind","argument",
// "default","unit","minimum","maximum","needs","help"}]}; members that an option does not have are
// null.
json_t *option_list_json(const command_line *line);
