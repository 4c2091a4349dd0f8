// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "processes/sub_command.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cli/output.h"
#include "cli/progress.h"
#include "options/options.h"
#include "processes/child_process.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"

// In the new process. Does not return.
static void become_command(const char *const *arguments, pid_t parent, const char *output,
                           const char *log)
{
    // A new process group: Ctrl-C reaches only this program, which forwards it.
    setpgid(0, 0);
    signal(SIGTTOU, SIG_IGN); // it shows its progress on the terminal
    child_end_with_parent(parent, INTERRUPT_PASSED_ON);
    const int errors = log ? open(log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666) : -1;
    if (errors >= 0)
        dup2(errors, STDERR_FILENO);
    if (freopen(output ? output : "/dev/null", "w", stdout))
        execv("/proc/self/exe", (char *const *)arguments);
    _exit(EXIT_FAILED);
}

char *sub_command_log(const char *folder)
{
    return group_leads() ? NULL : format_text("%s/log.txt", folder);
}

char *sub_command_fault(int status)
{
    static const struct {
        int number;
        const char *name;
    } signals[] = {{SIGHUP, "SIGHUP"},
                   {SIGINT, "SIGINT"},
                   {SIGQUIT, "SIGQUIT"},
                   {SIGILL, "SIGILL"},
                   {SIGABRT, "SIGABRT"},
                   {SIGBUS, "SIGBUS"},
                   {SIGFPE, "SIGFPE"},
                   {SIGSEGV, "SIGSEGV"},
                   {SIGTERM, "SIGTERM"},
                   {SIGXCPU, "SIGXCPU"},
                   {SIGKILL, "SIGKILL; the system may have run out of memory"}};
    // A command that a signal asks to stop ends with 128 + signal.
    const bool stopped =
        status == 128 + SIGHUP || status == 128 + SIGINT || status == 128 + SIGTERM;
    const int number = stopped ? status - 128 : -status;
    if (number <= 0)
        return format_text("failed with status %d", status);
    const char *name = NULL;
    for (size_t k = 0; k < sizeof signals / sizeof *signals; ++k)
        if (signals[k].number == number)
            name = signals[k].name;
    return format_text("was %s by signal %d%s%s%s", stopped ? "stopped" : "killed", number,
                       name ? " (" : "", name ? name : "", name ? ")" : "");
}

// ---- Ctrl-Z ----

static volatile sig_atomic_t suspend_wanted;

static void receive_suspend(int signal_number)
{
    (void)signal_number;
    suspend_wanted = 1;
}

// Suspends this process as SIGTSTP does without a handler, unless its process group is orphaned.
static void suspend_self(void)
{
    const struct sigaction by_default = {.sa_handler = SIG_DFL};
    struct sigaction handler;
    sigaction(SIGTSTP, &by_default, &handler);
    raise(SIGTSTP); // returns when SIGCONT arrives
    sigaction(SIGTSTP, &handler, NULL);
}

// The terminal suspends the process group of this program only.
static void suspend_both(pid_t child)
{
    suspend_wanted = 0;
    kill(-child, SIGSTOP);
    suspend_self();
    kill(-child, SIGCONT);
}

// Waits until the child ends. Returns its state as waitpid does, or -1 with errno set.
static int await_child(pid_t child)
{
    int state;
    bool forwarded = false;
    for (pid_t ended; (ended = waitpid(child, &state, WNOHANG)) != child;) {
        if (ended < 0 && errno != EINTR)
            return -1;
        if (suspend_wanted)
            suspend_both(child);
        if (interrupt_signal() && !forwarded) {
            forwarded = !kill(child, INTERRUPT_PASSED_ON);
            kill(child, SIGCONT); // a terminal may have suspended it
        }
        nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    }
    return state;
}

int sub_command_run(const char *const *arguments, const char *output, const char *log)
{
    size_t count = 0;
    while (arguments[count])
        ++count;
    const char **line = calloc(count + 2, sizeof *line);
    if (!line)
        return fail_run("out of memory");
    line[0] = "sparegs";
    memcpy(line + 1, arguments, count * sizeof *line);
    fflush(NULL);
    struct sigaction before, action = {.sa_handler = receive_suspend, .sa_flags = SA_RESTART};
    suspend_wanted = 0;
    sigaction(SIGTSTP, NULL, &before);
    if (before.sa_handler != SIG_IGN)
        sigaction(SIGTSTP, &action, NULL);
    const pid_t parent = getpid(), child = fork();
    if (!child)
        become_command(line, parent, output, log);
    free(line);
    if (child > 0)
        setpgid(child, child); // also here: the child may not have run yet
    const int state = child > 0 ? await_child(child) : -1, reason = errno;
    sigaction(SIGTSTP, &before, NULL);
    if (suspend_wanted && child > 0)
        suspend_self(); // it came at the very end
    if (state < 0)
        return fail_run("cannot %s 'sparegs %s': %s", child < 0 ? "start" : "wait for",
                        arguments[0], strerror(reason));
    return WIFEXITED(state) ? WEXITSTATUS(state) : -WTERMSIG(state);
}
