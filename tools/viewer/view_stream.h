// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The WebSockets of the viewer: they connect pages to the hub.

#include <civetweb.h>

#include "viewer/view_hub.h"

// Serves WebSockets at /stream for the hub. Requests are checked before, by the caller.
void view_stream_serve(struct mg_context *server, view_hub *hub);
