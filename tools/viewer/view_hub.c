// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_hub.h"

#include <stdlib.h>
#include <string.h>

#include "cli/progress.h"

void view_hub_open(view_hub *hub, const camera_list *views)
{
    *hub = (view_hub){.views = views};
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&hub->lock, NULL);
    pthread_cond_init(&hub->work, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

void view_hub_close(view_hub *hub)
{
    pthread_cond_destroy(&hub->work);
    pthread_mutex_destroy(&hub->lock);
}

void view_hub_stop(view_hub *hub)
{
    pthread_mutex_lock(&hub->lock);
    hub->stopping = true;
    pthread_cond_broadcast(&hub->work);
    for (int i = 0; i < HUB_CLIENTS; ++i)
        if (hub->clients[i].used)
            pthread_cond_broadcast(&hub->clients[i].filled);
    pthread_mutex_unlock(&hub->lock);
}

// ---- Outgoing ----

bool view_hub_post(view_client *client, bool binary, const void *head, size_t head_size,
                   const void *bytes, size_t size)
{
    if (!client->used || client->leaving || client->broken || client->queued >= HUB_QUEUE)
        return false;
    outgoing *message = malloc(sizeof *message + head_size + size);
    if (!message)
        return false;
    *message = (outgoing){.binary = binary, .size = head_size + size};
    if (head_size)
        memcpy(message->bytes, head, head_size);
    if (size)
        memcpy(message->bytes + head_size, bytes, size);
    if (client->last)
        client->last->next = message;
    else
        client->first = message;
    client->last = message;
    ++client->queued;
    pthread_cond_signal(&client->filled);
    return true;
}

void view_hub_post_json(view_client *client, json_t *root)
{
    char *text = root ? json_dumps(root, JSON_COMPACT) : NULL;
    if (text)
        view_hub_post(client, false, NULL, 0, text, strlen(text));
    free(text);
    json_decref(root);
}

void view_hub_broadcast(view_hub *hub, json_t *root)
{
    char *text = root ? json_dumps(root, JSON_COMPACT) : NULL;
    pthread_mutex_lock(&hub->lock);
    for (int i = 0; text && i < HUB_CLIENTS; ++i)
        view_hub_post(&hub->clients[i], false, NULL, 0, text, strlen(text));
    pthread_mutex_unlock(&hub->lock);
    free(text);
    json_decref(root);
}

static void *send_all(void *argument)
{
    view_client *client = argument;
    view_hub *hub = client->hub;
    json_t *greeting = hub->greet(hub->greet_context);
    pthread_mutex_lock(&hub->lock);
    view_hub_post_json(client, greeting);
    while (!client->leaving && !hub->stopping) {
        outgoing *message = client->first;
        if (!message) {
            pthread_cond_wait(&client->filled, &hub->lock);
            continue;
        }
        pthread_mutex_unlock(&hub->lock);
        const bool sent =
            client->send(client->connection, message->binary, message->bytes, message->size);
        pthread_mutex_lock(&hub->lock);
        client->first = message->next;
        if (!client->first)
            client->last = NULL;
        --client->queued;
        free(message);
        if (!sent) {
            client->broken = true;
            break;
        }
        if (client->job_count)
            pthread_cond_signal(&hub->work); // there is room for the replies
    }
    pthread_mutex_unlock(&hub->lock);
    return NULL;
}

// ---- Clients ----

view_client *view_hub_join(view_hub *hub, hub_send_fn send, void *connection, hub_refusal *why)
{
    view_client *client = NULL;
    hub_refusal reason = HUB_FULL;
    pthread_mutex_lock(&hub->lock);
    for (int i = 0; i < HUB_CLIENTS && !client && !hub->stopping; ++i)
        if (!hub->clients[i].used)
            client = &hub->clients[i];
    if (client) {
        *client = (view_client){.hub = hub,
                                .connection = connection,
                                .send = send,
                                .used = true,
                                .scale = 0.5,
                                .generation = client->generation + 1};
        pthread_cond_init(&client->filled, NULL);
        if (pthread_create(&client->sender, NULL, send_all, client)) {
            pthread_cond_destroy(&client->filled);
            client->used = false;
            client = NULL;
            reason = HUB_BUSY;
        }
    } else {
        reason = hub->stopping ? HUB_STOPPING : HUB_FULL;
    }
    pthread_mutex_unlock(&hub->lock);
    if (!client && why)
        *why = reason;
    return client;
}

void view_hub_leave(view_client *client)
{
    view_hub *hub = client->hub;
    pthread_mutex_lock(&hub->lock);
    client->leaving = true;
    pthread_cond_broadcast(&client->filled);
    pthread_mutex_unlock(&hub->lock);
    pthread_join(client->sender, NULL);
    pthread_mutex_lock(&hub->lock);
    while (client->first) {
        outgoing *next = client->first->next;
        free(client->first);
        client->first = next;
    }
    client->last = NULL;
    client->queued = 0;
    client->used = client->has_request = false;
    client->job_count = 0;
    ++client->changes; // ends a drawing for it
    pthread_cond_destroy(&client->filled);
    pthread_mutex_unlock(&hub->lock);
}

void view_hub_wake(view_hub *hub)
{
    pthread_mutex_lock(&hub->lock);
    pthread_cond_broadcast(&hub->work);
    pthread_mutex_unlock(&hub->lock);
}

bool view_hub_is_stopping(view_hub *hub)
{
    pthread_mutex_lock(&hub->lock);
    const bool stopping = hub->stopping;
    pthread_mutex_unlock(&hub->lock);
    return stopping;
}

int view_hub_count(view_hub *hub)
{
    int count = 0;
    pthread_mutex_lock(&hub->lock);
    for (int i = 0; i < HUB_CLIENTS; ++i)
        count += hub->clients[i].used && !hub->clients[i].leaving;
    pthread_mutex_unlock(&hub->lock);
    return count;
}

// ---- Incoming ----

// A job refers to the camera at this time: the page may move on before it is done. A newer pixel,
// ray, EXR file or history replaces an older one that waits.
static void add_job(view_client *client, const view_message *message)
{
    const bool replaces = message->type == MESSAGE_PROBE || message->type == MESSAGE_RAY ||
                          message->type == MESSAGE_EXR || message->type == MESSAGE_HISTORY;
    int at = 0;
    while (at < client->job_count && !(replaces && client->jobs[at].type == message->type))
        ++at;
    if (at == HUB_JOBS) {
        view_hub_post_json(client, json_pack("{s:s,s:s}", "type", "error", "text",
                                             "too many requests are waiting; try again"));
        return;
    }
    client->jobs[at] = *message;
    client->jobs[at].request = client->request;
    if (message->has_crop)
        client->jobs[at].request.crop = message->request.crop;
    client->job_count += at == client->job_count;
}

static void accept_message(view_client *client, const view_message *message)
{
    view_hub *hub = client->hub;
    switch (message->type) {
    case MESSAGE_CAMERA:
        client->request = message->request;
        client->has_request = true;
        client->next_scale = client->scale;
        ++client->changes;
        if (message->request.moving)
            client->moved = clock_seconds();
        break;
    case MESSAGE_ACK:
        if (client->frame - message->number < client->frame - client->seen)
            client->seen = message->number;
        break;
    default:
        add_job(client, message);
    }
    pthread_cond_signal(&hub->work);
}

bool view_hub_receive(view_client *client, const char *text, size_t size)
{
    view_hub *hub = client->hub;
    view_message message;
    const char *problem = view_message_parse(text, size, hub->views, &message);
    if (!problem && hub->no_crop)
        message.request.crop.preview = CROP_OFF;
    pthread_mutex_lock(&hub->lock);
    const bool open = !hub->stopping && !client->broken;
    if (problem || message.refused)
        view_hub_post_json(client, json_pack("{s:s,s:s}", "type", "error", "text",
                                             problem ? problem : message.refused));
    if (!problem && message.type != MESSAGE_RUN)
        accept_message(client, &message);
    pthread_mutex_unlock(&hub->lock);
    if (!problem && message.type == MESSAGE_RUN && hub->act)
        hub->act(hub->act_context, message.action);
    return open && size <= MESSAGE_BYTES;
}
