// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// SIGINT and SIGTERM as a request to finish: the first one only sets a flag, the second ends the process
// at once with status 128 + signal.

// Installs the handlers.
void interrupt_watch(void);

// The signal that asked to stop, or 0.
int interrupt_signal(void);

// 130 after SIGINT, 143 after SIGTERM, 0 if there was none.
int interrupt_status(void);
