// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Stopping on request. The handler does nothing but what is allowed in a handler: it stores a number, or ends.

#include "interrupt.h"

#include <signal.h>
#include <stddef.h>
#include <unistd.h>

static volatile sig_atomic_t received;

static void receive(int signal_number)
{
    if (received)
        _exit(128 + signal_number);
    received = signal_number;
}

void interrupt_watch(void)
{
    struct sigaction action = {.sa_handler = receive, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

int interrupt_signal(void)
{
    return received;
}

int interrupt_status(void)
{
    return received ? 128 + received : 0;
}
