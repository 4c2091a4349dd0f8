// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The buffer of stdout and the reason why it could not be written. Cannot fail.

// Buffers stdout, unless it is a terminal. Call before the first output.
void stdout_buffer(void);
// Writes what is buffered. After a row that took long; messages on stderr do so, too.
void stdout_flush(void);
// Prints a text in one piece.
void stdout_write(const char *text);
// Flushes, and returns the first error as in errno; 0 if all was written.
int stdout_error(void);
