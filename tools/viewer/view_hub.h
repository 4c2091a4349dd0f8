// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The connected pages: what each one requests, and what is on its way to it. One thread per page
// sends, so that a slow page delays nobody else. Memory is bounded: a page that does not read gets
// no further pictures or replies.
//
// Threads: all functions may be called from any thread. Fields of view_hub and view_client that are
// not constant are protected by view_hub.lock.

#include <pthread.h>

#include "viewer/view_message.h"

enum { HUB_CLIENTS = 8, HUB_JOBS = 8, HUB_QUEUE = 16, HUB_UNSEEN = 2 };

// Sends one WebSocket message and blocks until it is sent or failed.
typedef bool (*hub_send_fn)(void *connection, bool binary, const void *bytes, size_t size);

typedef struct outgoing {
    struct outgoing *next;
    size_t size;
    bool binary;
    unsigned char bytes[];
} outgoing;

typedef struct view_client {
    struct view_hub *hub;
    void *connection;
    hub_send_fn send;
    pthread_t sender;
    pthread_cond_t filled;
    bool used, leaving, broken;
    bool told_limit;     // that pictures are smaller than requested
    uint32_t generation; // counts the users of this slot
    outgoing *first, *last;
    int queued;

    // Requests.
    view_request request;
    bool has_request;
    uint32_t changes;            // counts the requests
    view_message jobs[HUB_JOBS]; // other messages, oldest first, with the request before them
    int job_count;
    uint32_t frame, seen; // number of the last picture sent, and displayed

    // Drawing; see view_render_thread.c.
    double scale, next_scale; // of a moving picture; of the next one, 0 = none
    double pixel_seconds;     // measured cost, 0 = unknown
    view_request drawn;       // shown last, at drawn_scale
    double drawn_scale;
    uint64_t drawn_version; // of the model
    double moved;           // time of the last moving request
} view_client;

typedef struct view_hub {
    pthread_mutex_t lock;
    pthread_cond_t work; // a request arrived or `stopping` was set
    bool stopping;
    uint32_t turn;
    view_client clients[HUB_CLIENTS];
    const camera_list *views;
    // The first message to every page; a new reference.
    json_t *(*greet)(void *context);
    void *greet_context;
    // Receives the action of a page; NULL: pages cannot control a run.
    void (*act)(void *context, run_action action);
    void *act_context;
    bool no_crop; // crops are not shown: they take the memory of another model
} view_hub;

void view_hub_open(view_hub *hub, const camera_list *views);
// Ends the senders. All clients must have left.
void view_hub_close(view_hub *hub);
// Wakes the render thread and the senders for the end of the server.
void view_hub_stop(view_hub *hub);

typedef enum hub_refusal {
    HUB_FULL,     // HUB_CLIENTS are connected
    HUB_STOPPING, // the viewer ends
    HUB_BUSY      // no thread can be started
} hub_refusal;

// NULL if the page cannot join; then *why receives the reason, unless `why` is NULL.
view_client *view_hub_join(view_hub *hub, hub_send_fn send, void *connection, hub_refusal *why);
// Waits for the sender; call before the connection becomes invalid.
void view_hub_leave(view_client *client);
// A message from the page. False if the connection must be closed.
bool view_hub_receive(view_client *client, const char *text, size_t size);

// Queues a copy of the message. False if it is dropped, because the page does not read or no memory
// is left. Call with the lock held.
bool view_hub_post(view_client *client, bool binary, const void *head, size_t head_size,
                   const void *bytes, size_t size);
// Queues JSON text. Steals the reference. Call with the lock held.
void view_hub_post_json(view_client *client, json_t *root);
// Queues JSON text for all clients. Steals the reference. Takes the lock.
void view_hub_broadcast(view_hub *hub, json_t *root);
// Wakes the render thread: the source has a new model.
void view_hub_wake(view_hub *hub);
// True after view_hub_stop. Takes the lock.
bool view_hub_is_stopping(view_hub *hub);
// Number of connected clients. Takes the lock.
int view_hub_count(view_hub *hub);
