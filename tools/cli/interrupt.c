// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Stopping on request. A handler does nothing but what is allowed in one: it changes a lock-free
// number, or ends. Handlers of two signals may run at once, on two threads.

#include "cli/interrupt.h"

#include <stdatomic.h>
#include <stddef.h>
#include <unistd.h>

_Static_assert(ATOMIC_INT_LOCK_FREE == 2, "handlers need atomic integers without locks");

enum { PASSED_ON = 1 << 16 };
static atomic_int received; // the signal, with PASSED_ON while nothing but that has come
static atomic_int checkpoint_wanted;

static void receive(int signal_number)
{
    int before = received;
    do {
        if (before && !(before & PASSED_ON))
            _exit(128 + signal_number);
    } while (!atomic_compare_exchange_weak(&received, &before, signal_number));
}

// From the program that started this one: the same request may come directly as well, before this
// or behind it.
static void receive_once(int signal_number)
{
    (void)signal_number;
    int before = 0;
    if (!atomic_compare_exchange_strong(&received, &before, SIGTERM | PASSED_ON))
        atomic_fetch_and(&received, ~PASSED_ON);
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
    return received & ~PASSED_ON;
}

bool interrupt_take_checkpoint(void)
{
    return atomic_exchange(&checkpoint_wanted, 0);
}

int interrupt_status(void)
{
    const int signal_number = interrupt_signal();
    return signal_number ? 128 + signal_number : 0;
}
