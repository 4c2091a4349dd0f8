// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/photo_queue.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cli/progress.h"
#include "processes/async_task.h"

#define OWED_SECONDS 10.0 // at most, after one photo

void photo_queue_open(photo_queue *queue, view_hub *hub, view_source *source,
                      const _Atomic double *share)
{
    *queue = (photo_queue){.hub = hub, .source = source, .share = share};
    pthread_mutex_init(&queue->turn, NULL);
    pthread_mutex_init(&queue->lock, NULL);
    if (source->scene)
        queue->thumbnails = calloc(source->scene->view_count + 1, sizeof *queue->thumbnails);
}

void photo_queue_close(photo_queue *queue)
{
    for (size_t k = 0; queue->thumbnails && k < queue->source->scene->view_count; ++k)
        encoded_picture_free(&queue->thumbnails[k]);
    free(queue->thumbnails);
    pthread_mutex_destroy(&queue->lock);
    pthread_mutex_destroy(&queue->turn);
}

// ---- Thumbnails ----

static bool copy_picture(const encoded_picture *from, encoded_picture *to)
{
    to->bytes = malloc(from->size);
    to->size = to->bytes ? from->size : 0;
    if (to->bytes)
        memcpy(to->bytes, from->bytes, from->size);
    return to->bytes != NULL;
}

static bool find_thumbnail(photo_queue *queue, size_t index, encoded_picture *picture)
{
    pthread_mutex_lock(&queue->lock);
    const bool found = queue->thumbnails && queue->thumbnails[index].size &&
                       copy_picture(&queue->thumbnails[index], picture);
    pthread_mutex_unlock(&queue->lock);
    return found;
}

static void keep_thumbnail(photo_queue *queue, size_t index, const encoded_picture *picture)
{
    pthread_mutex_lock(&queue->lock);
    if (queue->thumbnails && !queue->thumbnails[index].size &&
        queue->thumbnail_bytes + picture->size <= THUMBNAIL_BYTES &&
        copy_picture(picture, &queue->thumbnails[index]))
        queue->thumbnail_bytes += picture->size;
    pthread_mutex_unlock(&queue->lock);
}

// ---- Decoding ----

typedef struct photo_job {
    photo_queue *queue;
    size_t index;
    photo_use use;
    encoded_picture *picture;
    photo_answer answer;
} photo_job;

// Waits for the time that earlier photos owe. False if the viewer ends.
static bool await_turn(const photo_queue *queue)
{
    while (clock_seconds() < queue->due && atomic_load(queue->share) < 1 &&
           !view_hub_is_stopping(queue->hub))
        nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    return !view_hub_is_stopping(queue->hub);
}

static void add_seconds(_Atomic double *sum, double seconds)
{
    double before = atomic_load(sum);
    while (!atomic_compare_exchange_weak(sum, &before, before + seconds))
        ;
}

static photo_answer decode(photo_job *job)
{
    photo_queue *queue = job->queue;
    view_source *source = queue->source;
    const double start = clock_seconds();
    const bool made = photo_picture(source->scene, job->index, source->drawing.background, job->use,
                                    job->picture);
    const double end = clock_seconds(), share = atomic_load(queue->share);
    queue->due = end + fmin((end - start) * (1 / share - 1), OWED_SECONDS);
    if (share < 1)
        add_seconds(&source->photo_seconds, end - start);
    return made ? PHOTO_MADE : PHOTO_UNREADABLE;
}

static bool make_photo(void *context)
{
    photo_job *job = context;
    photo_queue *queue = job->queue;
    const bool is_small = job->use == PHOTO_THUMBNAIL;
    pthread_mutex_lock(&queue->turn);
    if (is_small && find_thumbnail(queue, job->index, job->picture)) // made meanwhile
        job->answer = PHOTO_MADE;
    else
        job->answer = await_turn(queue) ? decode(job) : PHOTO_STOPPED;
    if (is_small && job->answer == PHOTO_MADE)
        keep_thumbnail(queue, job->index, job->picture);
    pthread_mutex_unlock(&queue->turn);
    return true;
}

// Decodes in another thread: those of CivetWeb have small stacks.
photo_answer photo_queue_get(photo_queue *queue, size_t index, photo_use use,
                             encoded_picture *picture)
{
    *picture = (encoded_picture){0};
    photo_job job = {queue, index, use, picture, PHOTO_STOPPED};
    async_task task = {0};
    if (view_hub_is_stopping(queue->hub))
        return PHOTO_STOPPED;
    if (use == PHOTO_THUMBNAIL && find_thumbnail(queue, index, picture))
        return PHOTO_MADE;
    async_task_start(&task, true, make_photo, &job);
    async_task_wait(&task);
    return job.answer;
}
