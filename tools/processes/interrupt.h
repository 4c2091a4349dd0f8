// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// SIGINT, SIGTERM and SIGHUP request a stop: the first one sets a flag, a second one exits
// immediately with status 128 + signal. A second SIGTERM within five seconds has no effect: batch
// systems send one to the process and one to its launcher, which forwards it. SIGUSR1 requests a
// checkpoint. INTERRUPT_PASSED_ON is SIGTERM forwarded by the parent program; it never exits
// immediately, because the same request may also have arrived directly. SIGXCPU, sent at the soft
// limit of CPU time, is such a SIGTERM, too.

#include <signal.h>
#include <stdbool.h>

#define INTERRUPT_PASSED_ON SIGUSR2

// Installs the handlers. SIGPIPE and SIGXFSZ become write errors. SIGHUP stays ignored if it was
// (nohup).
void interrupt_watch(void);

// The signal that requested a stop, SIGINT for interrupt_request, or 0.
int interrupt_signal(void);

// The same requests by the program itself: a stop and a checkpoint. The stop does not count as a
// first signal: the next one requests the same stop and does not exit immediately.
void interrupt_request(void);
void interrupt_want_checkpoint(void);
// True if the program has requested the stop, and no signal has. Several ranks follow the request
// of one as a SIGINT.
bool interrupt_is_request(void);

// A stop because another process of this run has received this signal, as if it were forwarded: the
// signal itself may still arrive here. No effect after a signal.
void interrupt_follow(int signal_number);

// Records whether the last long call of the library was cancelled because of such a request. Its
// command fails without an error of its own, and the program exits with interrupt_status().
void interrupt_note_cancelled(bool cancelled);
bool interrupt_was_cancelled(void);

// True once per request for a checkpoint.
bool interrupt_take_checkpoint(void);

// Exit status: 129 after SIGHUP, 130 after SIGINT, 143 after SIGTERM, 0 without a signal.
int interrupt_status(void);
