// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Plug-ins: shared objects that are loaded when a function of theirs is first needed.

#include <stdbool.h>
#include <stddef.h>

// Loads the plug-in `file` from `folder`, or, if it is NULL, from the folder of the program or
// LIBDIR/sparegs of the installation. `global`: libraries that are loaded later see its symbols.
// Plug-ins stay loaded. Returns the handle of dlopen, or NULL: a plug-in that exists and cannot be
// loaded leaves the reason in reason[bytes], a missing one leaves it unchanged.
void *sgsi_plugin_load(const char *folder, const char *file, bool global, char *reason,
                       size_t bytes);

// Stores the address of the plug-in's function `name` in *function, a pointer to a function. False,
// with the reason, if there is none.
bool sgsi_plugin_find(void *plugin, const char *name, void *function, char *reason, size_t bytes);
