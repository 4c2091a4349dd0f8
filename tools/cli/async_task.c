// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/async_task.h"

static void *run(void *argument)
{
    background *self = argument;
    self->result = self->work(self->context);
    return NULL;
}

void background_start(background *self, bool beside, bool (*work)(void *), void *context)
{
    self->work = work;
    self->context = context;
    self->running = beside && !pthread_create(&self->thread, NULL, run, self);
    if (!self->running)
        run(self);
}

bool background_wait(background *self)
{
    if (self->running)
        pthread_join(self->thread, NULL);
    const bool result = self->work ? self->result : true;
    self->running = false;
    self->work = NULL;
    return result;
}
