// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// SIGINT, SIGTERM and SIGHUP as a request to finish: the first one only sets a flag, the second
// ends the process at once with status 128 + signal. SIGUSR1 asks for a checkpoint.
// INTERRUPT_PASSED_ON is SIGTERM from a program that started this one, and never ends it at once:
// the same request may have come directly.

#include <signal.h>
#include <stdbool.h>

#define INTERRUPT_PASSED_ON SIGUSR2

// Installs the handlers; SIGPIPE and SIGXFSZ become write errors. SIGHUP stays ignored if it was
// (nohup).
void interrupt_watch(void);

// The signal that asked to stop, or 0.
int interrupt_signal(void);

// True once per request for a checkpoint.
bool interrupt_take_checkpoint(void);

// 129 after SIGHUP, 130 after SIGINT, 143 after SIGTERM, 0 if there was none.
int interrupt_status(void);
