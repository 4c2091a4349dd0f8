// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Child processes. stdout and stderr share one pipe, so that the log keeps their order. Between
// fork and exec only async-signal-safe functions are called. A failed exec reports errno through a
// second pipe, which a successful exec closes.

#include "processes/child_process.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#include "cli/output.h"
#include "processes/interrupt.h"

static void close_pair(int ends[2])
{
    close(ends[0]);
    close(ends[1]);
}

void child_end_with_parent(pid_t parent, int signal_number)
{
#ifdef __linux__
    signal(signal_number, SIG_DFL); // not the handler of the parent, which only sets a flag
    prctl(PR_SET_PDEATHSIG, signal_number);
    if (getppid() != parent) // it was killed before
        _exit(128 + signal_number);
#else
    (void)parent;
    (void)signal_number;
#endif
}

static void become(const child_process *child, pid_t parent, const int output[2],
                   const int failure[2])
{
    child_end_with_parent(parent, SIGTERM);
    dup2(output[1], STDOUT_FILENO);
    dup2(output[1], STDERR_FILENO);
    close(output[0]);
    close(output[1]);
    close(failure[0]);
    execvp(child->arguments[0], (char *const *)child->arguments);
    const int reason = errno;
    const ssize_t reported = write(failure[1], &reason, sizeof reason);
    _exit(reported == (ssize_t)sizeof reason ? 127 : 126);
}

// Starts the program. Returns -1 with errno set on failure.
static pid_t start(const child_process *child, int *output)
{
    int pipe_output[2], pipe_failure[2], reason = 0;
    if (pipe(pipe_output))
        return -1;
    if (pipe(pipe_failure)) {
        close_pair(pipe_output);
        return -1;
    }
    fcntl(pipe_failure[1], F_SETFD, FD_CLOEXEC);
    fflush(NULL);
    const pid_t parent = getpid(), pid = fork();
    if (pid == 0)
        become(child, parent, pipe_output, pipe_failure);
    reason = errno;
    close(pipe_output[1]);
    close(pipe_failure[1]);
    const bool failed =
        pid < 0 || read(pipe_failure[0], &reason, sizeof reason) == (ssize_t)sizeof reason;
    close(pipe_failure[0]);
    if (!failed) {
        *output = pipe_output[0];
        return pid;
    }
    close(pipe_output[0]);
    if (pid > 0)
        waitpid(pid, NULL, 0);
    errno = reason;
    return -1;
}

static void take_line(child_process *child, const char *text)
{
    if (child->line)
        child->line(child->context, text);
    if (!text[strspn(text, " \t=-")])
        return;
    memmove(child->tail[0], child->tail[1], sizeof child->tail - sizeof child->tail[0]);
    snprintf(child->tail[CHILD_TAIL - 1], sizeof child->tail[0], "%s", text + strspn(text, " \t"));
}

// Reads until the program closes its output (true) or a signal asks to stop (false).
static bool listen(child_process *child, int output, FILE *log)
{
    char line[1024];
    size_t length = 0;
    for (;;) {
        struct pollfd ready = {.fd = output, .events = POLLIN};
        if (interrupt_signal())
            return false;
        if (poll(&ready, 1, 200) <= 0)
            continue;
        char bytes[4096];
        const ssize_t got = read(output, bytes, sizeof bytes);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            break;
        fwrite(bytes, 1, (size_t)got, log);
        fflush(log);
        for (ssize_t i = 0; i < got; ++i) {
            if (bytes[i] != '\n' && bytes[i] != '\r') {
                if (length + 1 < sizeof line)
                    line[length++] = bytes[i];
                continue;
            }
            line[length] = 0;
            take_line(child, line);
            length = 0;
        }
    }
    line[length] = 0;
    if (length)
        take_line(child, line);
    return !interrupt_signal(); // Ctrl-C in a terminal ends the program as well
}

int child_run(child_process *child)
{
    memset(child->tail, 0, sizeof child->tail);
    child->signal = 0;
    FILE *log = fopen(child->log_path, "w");
    if (!log)
        return CHILD_UNSTARTED;
    int output, status = 0;
    pid_t waited;
    const pid_t pid = start(child, &output);
    if (pid < 0) {
        const int reason = errno;
        fclose(log);
        errno = reason;
        return reason == ENOENT ? CHILD_MISSING : CHILD_UNSTARTED;
    }
    const bool ended = listen(child, output, log);
    close(output);
    fclose(log);
    if (!ended)
        kill(pid, SIGTERM);
    while ((waited = waitpid(pid, &status, 0)) < 0 && errno == EINTR)
        continue;
    if (!ended)
        return CHILD_INTERRUPTED;
    if (waited < 0)
        return CHILD_LOST;
    child->signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    return child->signal ? 128 + child->signal : WEXITSTATUS(status);
}

char *child_tail(const child_process *child)
{
    int first = 0;
    while (first < CHILD_TAIL - 1 && !child->tail[first][0])
        ++first;
    char *text = format_text("%s", child->tail[first]);
    for (int k = first + 1; k < CHILD_TAIL; ++k) {
        char *longer = format_text("%s | %s", text, child->tail[k]);
        free(text);
        text = longer;
    }
    return text;
}
