// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Stopping on request. The handlers are async-signal-safe: they change a lock-free integer or call
// _exit. Handlers of two signals may run concurrently on two threads.

#include "processes/interrupt.h"

#include <stdatomic.h>
#include <stddef.h>
#include <time.h>
#include <unistd.h>

_Static_assert(ATOMIC_INT_LOCK_FREE == 2 && ATOMIC_LONG_LOCK_FREE == 2,
               "handlers need atomic integers without locks");

enum { PASSED_ON = 1 << 16, REPEATED_SECONDS = 5 };
static atomic_int received; // the signal, with PASSED_ON while only the forwarded one has arrived
static atomic_long received_at; // seconds, of the first one that is not forwarded
static atomic_int stop_wanted;  // by the program itself; the handlers do not look at it
static atomic_int checkpoint_wanted;
static atomic_bool call_cancelled;

static long seconds(void)
{
    struct timespec now = {0};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec;
}

// A batch system sends SIGTERM to the process and to its launcher, which forwards it: a second one
// soon after the first is the same request.
static void receive(int signal_number)
{
    const long now = seconds();
    int before = received;
    if (!before || before & PASSED_ON)
        received_at = now;
    do {
        if (before && !(before & PASSED_ON)) {
            if (signal_number == SIGTERM && now - received_at < REPEATED_SECONDS)
                return;
            _exit(128 + signal_number);
        }
    } while (!atomic_compare_exchange_weak(&received, &before, signal_number));
}

// Forwarded by the parent program. The same request may also arrive directly, before or after.
static void receive_once(int signal_number)
{
    (void)signal_number;
    int before = 0;
    if (atomic_compare_exchange_strong(&received, &before, SIGTERM | PASSED_ON))
        return;
    if (before & PASSED_ON)
        received_at = seconds();
    atomic_fetch_and(&received, ~PASSED_ON);
}

// The kernel repeats SIGXCPU every second until the hard limit, which kills the process.
static void receive_limit(int signal_number)
{
    (void)signal_number;
    interrupt_follow(SIGTERM);
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
    if (!sigaction(SIGHUP, NULL, &before) && before.sa_handler != SIG_IGN) // nohup ignores SIGHUP
        sigaction(SIGHUP, &action, NULL);
    action.sa_handler = receive_once;
    sigaction(INTERRUPT_PASSED_ON, &action, NULL);
    action.sa_handler = receive_limit;
    sigaction(SIGXCPU, &action, NULL);
    action.sa_handler = want_checkpoint;
    sigaction(SIGUSR1, &action, NULL);
    // A closed pipe or a file-size limit is reported as an error of the write instead.
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
}

int interrupt_signal(void)
{
    const int signal_number = received & ~PASSED_ON;
    return signal_number ? signal_number : stop_wanted ? SIGINT : 0;
}

void interrupt_request(void)
{
    stop_wanted = 1;
}

bool interrupt_is_request(void)
{
    const int signal_number = received;
    return stop_wanted && (!signal_number || signal_number == (SIGINT | PASSED_ON));
}

void interrupt_follow(int signal_number)
{
    int before = 0;
    atomic_compare_exchange_strong(&received, &before, signal_number | PASSED_ON);
}

void interrupt_want_checkpoint(void)
{
    checkpoint_wanted = 1;
}

void interrupt_note_cancelled(bool cancelled)
{
    call_cancelled = cancelled;
}

bool interrupt_was_cancelled(void)
{
    return call_cancelled;
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
