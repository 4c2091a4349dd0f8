// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Stopping on request. A handler does nothing but what is allowed in one: it stores a number, or
// ends.

#include "interrupt.h"

#include <stddef.h>
#include <unistd.h>

static volatile sig_atomic_t received, passed_on, checkpoint_wanted;

static void receive(int signal_number)
{
    if (received && !passed_on)
        _exit(128 + signal_number);
    received = signal_number;
    passed_on = 0;
}

// From the program that started this one: the same request may come directly as well, before this
// or behind it.
static void receive_once(int signal_number)
{
    (void)signal_number;
    passed_on = !received;
    if (!received)
        received = SIGTERM;
}

static void want_checkpoint(int signal_number)
{
    (void)signal_number;
    checkpoint_wanted = 1;
}

void interrupt_watch(void)
{
    struct sigaction action = {.sa_handler = receive, .sa_flags = SA_RESTART}, before;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (!sigaction(SIGHUP, NULL, &before) && before.sa_handler != SIG_IGN) // nohup wants it ignored
        sigaction(SIGHUP, &action, NULL);
    action.sa_handler = receive_once;
    sigaction(INTERRUPT_PASSED_ON, &action, NULL);
    action.sa_handler = want_checkpoint;
    sigaction(SIGUSR1, &action, NULL);
    // A reader of our messages that has gone, or a limit on file sizes, is an error of that write
    // and no reason to die.
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
}

int interrupt_signal(void)
{
    return received;
}

bool interrupt_take_checkpoint(void)
{
    const bool wanted = checkpoint_wanted;
    checkpoint_wanted = 0;
    return wanted;
}

int interrupt_status(void)
{
    return received ? 128 + received : 0;
}
