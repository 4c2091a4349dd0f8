// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/standard_output.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <unistd.h>

enum { BUFFER_BYTES = 1 << 16 }; // larger than the tables: their errors show in stdout_flush

static int first_error;

void stdout_buffer(void)
{
    if (!isatty(STDOUT_FILENO))
        setvbuf(stdout, NULL, _IOFBF, BUFFER_BYTES);
}

// Notes the reason of a failure, if it is the first one.
static void note(bool failed)
{
    if (failed && !first_error)
        first_error = errno ? errno : EIO;
}

void stdout_flush(void)
{
    errno = 0;
    note(fflush(stdout) != 0);
}

void stdout_write(const char *text)
{
    errno = 0;
    note(fputs(text, stdout) < 0);
}

int stdout_error(void)
{
    stdout_flush();
    errno = 0;
    note(ferror(stdout) != 0);
    return first_error;
}
