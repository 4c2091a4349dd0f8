// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/sub_command.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cli/child_process.h"
#include "cli/interrupt.h"
#include "cli/options.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/rank_group.h"

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
    const pid_t parent = getpid(), child = fork();
    if (!child)
        become_command(line, parent, output, log);
    free(line);
    if (child < 0)
        return fail_run("cannot start 'sparegs %s': %s", arguments[0], strerror(errno));
    int state;
    bool forwarded = false;
    for (pid_t ended; (ended = waitpid(child, &state, WNOHANG)) != child;) {
        if (ended < 0 && errno != EINTR)
            return fail_run("cannot wait for 'sparegs %s': %s", arguments[0], strerror(errno));
        if (interrupt_signal() && !forwarded) {
            forwarded = !kill(child, INTERRUPT_PASSED_ON);
            kill(child, SIGCONT); // a terminal may have suspended it
        }
        nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    }
    return WIFEXITED(state) ? WEXITSTATUS(state) : 128 + WTERMSIG(state);
}
