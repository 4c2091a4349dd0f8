// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The threads that the library creates. They block all signals but those of their own faults, so
// that handlers run on threads of the program.

#include <pthread.h>
#include <stdbool.h>

// pthread_create with default attributes. False if the system refuses.
bool sgsi_thread_create(pthread_t *thread, void *(*run)(void *), void *argument);
