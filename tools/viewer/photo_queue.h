// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Photos for pages, decoded one at a time: a large photo takes some hundred MB while it is decoded.
//
// Threads: photo_queue_get may be called from any thread.

#include <pthread.h>

#include "viewer/photo_picture.h"
#include "viewer/view_hub.h"
#include "viewer/view_source.h"

typedef struct photo_queue {
    view_hub *hub;
    const view_source *source;
    pthread_mutex_t turn; // of the photo that is decoded
} photo_queue;

typedef enum photo_answer {
    PHOTO_MADE,
    PHOTO_UNREADABLE,
    PHOTO_STOPPED // the viewer ends
} photo_answer;

void photo_queue_open(photo_queue *queue, view_hub *hub, const view_source *source);
void photo_queue_close(photo_queue *queue);

// The photo of a view; see photo_picture. Waits for the photos before it, unless the viewer ends.
photo_answer photo_queue_get(photo_queue *queue, size_t index, photo_use use,
                             encoded_picture *picture);
