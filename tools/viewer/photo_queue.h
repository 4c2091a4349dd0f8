// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Photos for pages, decoded one at a time: a large photo takes some hundred MB while it is decoded.
// Thumbnails are kept, up to THUMBNAIL_BYTES. Beside a training, decoding has the share of the time
// that drawing has: the next photo waits for what the last one owes, and the drawing thread sleeps
// for photos, too.
//
// Threads: photo_queue_get may be called from any thread.

#include <pthread.h>

#include "viewer/photo_picture.h"
#include "viewer/view_hub.h"
#include "viewer/view_source.h"

enum { THUMBNAIL_BYTES = 8 << 20 };

typedef struct photo_queue {
    view_hub *hub;
    view_source *source;
    const _Atomic double *share; // see view_render_thread.h
    pthread_mutex_t turn;        // of the photo that is decoded
    double due;                  // of the turn: time of the next photo
    pthread_mutex_t lock;        // of what follows
    encoded_picture *thumbnails; // [view_count]; NULL without a scene or memory
    size_t thumbnail_bytes;
} photo_queue;

typedef enum photo_answer {
    PHOTO_MADE,
    PHOTO_UNREADABLE,
    PHOTO_STOPPED // the viewer ends
} photo_answer;

void photo_queue_open(photo_queue *queue, view_hub *hub, view_source *source,
                      const _Atomic double *share);
void photo_queue_close(photo_queue *queue);

// The photo of a view; see photo_picture. Waits for the photos before it, unless the viewer ends.
photo_answer photo_queue_get(photo_queue *queue, size_t index, photo_use use,
                             encoded_picture *picture);
