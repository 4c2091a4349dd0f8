// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "processes/async_task.h"

static void *run(void *argument)
{
    async_task *self = argument;
    self->result = self->work(self->context);
    return NULL;
}

void async_task_start(async_task *self, bool asynchronous, bool (*work)(void *), void *context)
{
    self->work = work;
    self->context = context;
    self->running = asynchronous && !pthread_create(&self->thread, NULL, run, self);
    if (!self->running)
        run(self);
}

bool async_task_wait(async_task *self)
{
    if (self->running)
        pthread_join(self->thread, NULL);
    const bool result = self->work ? self->result : true;
    self->running = false;
    self->work = NULL;
    return result;
}
