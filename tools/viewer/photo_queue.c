// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/photo_queue.h"

#include "cli/async_task.h"

void photo_queue_open(photo_queue *queue, view_hub *hub, const view_source *source)
{
    *queue = (photo_queue){.hub = hub, .source = source};
    pthread_mutex_init(&queue->turn, NULL);
}

void photo_queue_close(photo_queue *queue)
{
    pthread_mutex_destroy(&queue->turn);
}

typedef struct photo_job {
    photo_queue *queue;
    size_t index;
    photo_use use;
    encoded_picture *picture;
    photo_answer answer;
} photo_job;

static photo_answer decode(photo_job *job)
{
    const view_source *source = job->queue->source;
    return photo_picture(source->scene, job->index, source->drawing.background, job->use,
                         job->picture)
               ? PHOTO_MADE
               : PHOTO_UNREADABLE;
}

static bool make_photo(void *context)
{
    photo_job *job = context;
    photo_queue *queue = job->queue;
    pthread_mutex_lock(&queue->turn);
    job->answer = view_hub_is_stopping(queue->hub) ? PHOTO_STOPPED : decode(job);
    pthread_mutex_unlock(&queue->turn);
    return true;
}

// Decodes in another thread: those of CivetWeb have small stacks.
photo_answer photo_queue_get(photo_queue *queue, size_t index, photo_use use,
                             encoded_picture *picture)
{
    photo_job job = {queue, index, use, picture, PHOTO_STOPPED};
    async_task task = {0};
    *picture = (encoded_picture){0};
    if (view_hub_is_stopping(queue->hub))
        return PHOTO_STOPPED;
    async_task_start(&task, true, make_photo, &job);
    async_task_wait(&task);
    return job.answer;
}
