// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Pages take turns. A moving picture is drawn at the page's `scale` (of width and height), which
// grows or shrinks with the time that the last one took. At rest each picture is STEP times larger.
// A large picture is abandoned when its page changes the request, and after PATIENCE seconds if
// another page moves or a page waits for more than the value of a pixel. While another page moves,
// no picture is started that would hold it up for more than PATIENCE seconds.
//
// With a share below 1 the thread sleeps after each stretch of work of length s for s (1 / share -
// 1), inside of large pictures too.

#include "viewer/view_render_thread.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/progress.h"
#include "run/region_json.h"
#include "viewer/frame_encoder.h"
#include "viewer/ray_inspect.h"

#define MOVING_SECONDS 0.075 // of one moving picture
#define PATIENCE 0.25        // seconds
#define STEP 2.5
#define SCALE_MINIMUM 0.06
#define COPY_SECONDS 1.0 // at least, between two copies of the model
enum { QUALITY_MOVING = 75, QUALITY_REST = 90 };

typedef struct render_task {
    view_client *client;
    uint32_t generation, changes;
    view_request request;
    view_message job; // MESSAGE_INVALID: a picture
    double scale;
} render_task;

// ---- The share of the time ----

static struct timespec deadline(double seconds)
{
    return (struct timespec){(time_t)seconds, (long)((seconds - floor(seconds)) * 1e9)};
}

// True if the page of the task has left, or the viewer or the training ends. With the hub's lock
// held.
static bool is_unwanted(const view_render_thread *render, const render_task *task)
{
    const view_client *client = task->client;
    return render->hub->stopping || atomic_load(&render->source->replacing) || !client->used ||
           client->leaving || client->generation != task->generation;
}

// True if the picture of the task is not required any more. With the hub's lock held.
static bool is_obsolete(const view_render_thread *render, const render_task *task)
{
    return is_unwanted(render, task) || task->client->changes != task->changes;
}

// Sleeps for what the work since the last call, photos and earlier work owe. Returns early, and
// still owes the rest, when `task` becomes obsolete (NULL: never).
static void keep_share(view_render_thread *render, const render_task *task)
{
    view_hub *hub = render->hub;
    const double share = atomic_load(&render->share), now = clock_seconds();
    const double work = now - render->slice + atomic_exchange(&render->source->photo_seconds, 0);
    render->owed = share < 1 ? fmin(render->owed + work * (1 / share - 1), 10) : 0;
    const double end = now + render->owed;
    const struct timespec until = deadline(end);
    pthread_mutex_lock(&hub->lock);
    while (!hub->stopping && clock_seconds() < end && atomic_load(&render->share) < 1 &&
           !(task && is_obsolete(render, task)))
        pthread_cond_timedwait(&hub->work, &hub->lock, &until);
    pthread_mutex_unlock(&hub->lock);
    render->slice = clock_seconds();
    render->slept += render->slice - now;
    render->owed = fmax(end - render->slice, 0);
}

// ---- What to draw next; with the hub's lock held ----

static bool others_move(const view_hub *hub, const view_client *client, double now)
{
    for (int i = 0; i < HUB_CLIENTS; ++i)
        if (&hub->clients[i] != client && hub->clients[i].used && now - hub->clients[i].moved < 1)
            return true;
    return false;
}

// The largest scale of a picture of the request that its memory permits.
static double most_scale(const view_render_thread *render, const view_request *request)
{
    const double pixels = (double)request->camera.width * request->camera.height,
                 bytes = (double)render->source->picture_bytes;
    return bytes > 0 ? fmin(1, sqrt(bytes / PICTURE_PIXEL_BYTES / pixels)) : 1;
}

// The scale of the client's next picture without a limit; 0 if none is due.
static double wanted_scale(const view_render_thread *render, const view_client *client, double now)
{
    if (!client->used || client->leaving || client->broken || !client->has_request ||
        !(client->next_scale > 0) || client->frame - client->seen >= HUB_UNSEEN)
        return 0;
    const double pixels = (double)client->request.camera.width * client->request.camera.height;
    if (client->request.moving)
        return client->scale;
    double scale = client->next_scale;
    // Do not repeat what the page shows already.
    if (client->drawn_version == render->version &&
        view_request_same(&client->drawn, &client->request) && client->drawn.moving &&
        scale <= client->drawn_scale && client->drawn_scale < 1)
        scale = fmin(1, STEP * client->drawn_scale);
    if (others_move(render->hub, client, now) &&
        client->pixel_seconds * pixels * scale * scale > PATIENCE)
        return 0;
    return scale;
}

// The scale of the client's next picture; 0 if none is due.
static double due_scale(const view_render_thread *render, const view_client *client, double now)
{
    return fmin(wanted_scale(render, client, now), most_scale(render, &client->request));
}

static bool has_job(const view_client *client)
{
    return client->used && !client->leaving && client->job_count && client->queued < HUB_QUEUE / 2;
}

static bool find_task(view_render_thread *render, render_task *task)
{
    view_hub *hub = render->hub;
    const double now = clock_seconds();
    for (uint32_t i = 1; i <= HUB_CLIENTS; ++i) {
        view_client *client = &hub->clients[(hub->turn + i) % HUB_CLIENTS];
        const bool is_job = has_job(client);
        const double scale = due_scale(render, client, now);
        if (!is_job && !(scale > 0))
            continue;
        *task = (render_task){.client = client,
                              .generation = client->generation,
                              .changes = client->changes,
                              .request = client->request,
                              .scale = scale};
        if (is_job) {
            task->job = client->jobs[0];
            task->request = task->job.request;
            memmove(client->jobs, client->jobs + 1,
                    (size_t)--client->job_count * sizeof *client->jobs);
        } else {
            hub->turn = (hub->turn + i) % HUB_CLIENTS;
        }
        return true;
    }
    return false;
}

// The model does not change any more: complete pictures of it are drawn again, without loss.
static void renew_exact(view_render_thread *render)
{
    const bool exact = atomic_load(&render->share) >= 1, begins = exact && !render->exact;
    render->exact = exact;
    for (int i = 0; i < HUB_CLIENTS && begins; ++i) {
        view_client *client = &render->hub->clients[i];
        if (client->used && client->has_request && !client->request.moving &&
            !(client->next_scale > 0))
            client->next_scale = client->drawn_scale;
    }
}

// A new copy of the model: all pages at rest are drawn again, at the size that they show.
static void renew(view_render_thread *render)
{
    const uint64_t version = atomic_load(&render->source->version);
    renew_exact(render);
    if (version == render->version)
        return;
    render->version = version;
    render->copied = clock_seconds();
    for (int i = 0; i < HUB_CLIENTS; ++i) {
        view_client *client = &render->hub->clients[i];
        if (client->used && client->has_request && !client->request.moving)
            client->next_scale = client->drawn_scale > 0 ? client->drawn_scale : client->scale;
    }
}

static bool next_task(view_render_thread *render, render_task *task)
{
    view_hub *hub = render->hub;
    bool found = false;
    pthread_mutex_lock(&hub->lock);
    while (!hub->stopping && !found) {
        bool any = false;
        for (int i = 0; i < HUB_CLIENTS; ++i)
            any = any || hub->clients[i].used;
        if (render->is_live) {
            renew(render);
            if (any && clock_seconds() - render->copied > COPY_SECONDS)
                atomic_store(&render->source->wanted, true);
        }
        found = !atomic_load(&render->source->replacing) && find_task(render, task);
        if (found)
            break;
        const struct timespec until = deadline(clock_seconds() + (any ? 0.1 : 1));
        pthread_cond_timedwait(&hub->work, &hub->lock, &until);
    }
    pthread_mutex_unlock(&hub->lock);
    return found;
}

// ---- Whether to continue ----

typedef struct work_context {
    view_render_thread *render;
    const render_task *task;
    double start; // seconds
    bool abandoned, gives_way;
} work_context;

static work_context work_begin(view_render_thread *render, const render_task *task)
{
    return (work_context){.render = render, .task = task, .start = clock_seconds()};
}

// Of moving pictures and files: false if they are unwanted.
static bool continue_work(void *user, size_t done, size_t total)
{
    work_context *context = user;
    view_hub *hub = context->render->hub;
    (void)done;
    (void)total;
    pthread_mutex_lock(&hub->lock);
    context->abandoned = is_unwanted(context->render, context->task);
    pthread_mutex_unlock(&hub->lock);
    return !context->abandoned;
}

// True if another page moves, or any page waits for an answer. Values under the cursor and tables
// are requested all the time; they wait for the picture. With the hub's lock held.
static bool others_wait(const view_hub *hub, const view_client *client)
{
    for (int i = 0; i < HUB_CLIENTS; ++i)
        for (int k = 0; has_job(&hub->clients[i]) && k < hub->clients[i].job_count; ++k) {
            const view_message_type type = hub->clients[i].jobs[k].type;
            if (type != MESSAGE_PROBE && type != MESSAGE_HISTORY)
                return true;
        }
    return others_move(hub, client, clock_seconds());
}

// Between bands of a picture at rest: false if it is not required any more, or gives way.
static bool continue_picture(void *user, size_t done, size_t total)
{
    work_context *context = user;
    view_hub *hub = context->render->hub;
    if (done < total)
        keep_share(context->render, context->task);
    pthread_mutex_lock(&hub->lock);
    context->gives_way = done < total && clock_seconds() - context->start > PATIENCE &&
                         others_wait(hub, context->task->client);
    context->abandoned = context->gives_way || is_obsolete(context->render, context->task);
    pthread_mutex_unlock(&hub->lock);
    return !context->abandoned;
}

// ---- Pictures ----

static int scaled(int size, double scale)
{
    const int result = (int)lround(size * scale);
    return result < 1 ? 1 : result;
}

static json_t *frame_json(const view_render_thread *render, const render_task *task,
                          const painted_picture *picture, double seconds, bool lossless,
                          bool limited)
{
    const view_source *source = render->source;
    json_t *head = json_pack("{s:I,s:i,s:i,s:i,s:i,s:b,s:s,s:s,s:i,s:I,s:f}", "serial",
                             (json_int_t)task->request.serial, "width", picture->image.width,
                             "height", picture->image.height, "full_width",
                             task->request.camera.width, "full_height", task->request.camera.height,
                             "lossless", lossless, "encoding", lossless ? "png" : "jpeg", "aov",
                             aov_words[task->request.aov], "iteration", source->iteration,
                             "gaussians", (json_int_t)source->model->count, "seconds", seconds);
    if (limited)
        json_object_set_new(head, "limited", json_true());
    if (picture->is_cropped)
        json_object_set_new(head, "removed", json_integer((json_int_t)picture->removed));
    if (picture->range.high > picture->range.low)
        json_object_set_new(
            head, "range",
            json_pack("[f,f]", (double)picture->range.low, (double)picture->range.high));
    return head;
}

// Message of a picture: 4 bytes length of the header (little-endian), JSON header, image file.
// False if the picture was not queued; then it is drawn again.
static bool post_picture(view_client *client, json_t *head, const encoded_picture *encoded)
{
    bool posted = false;
    json_object_set_new(head, "frame", json_integer(client->frame + 1));
    char *text = json_dumps(head, JSON_COMPACT);
    const size_t length = text ? strlen(text) : 0;
    unsigned char *start = malloc(4 + length);
    if (text && start) {
        for (int k = 0; k < 4; ++k)
            start[k] = (unsigned char)(length >> 8 * k);
        memcpy(start + 4, text, length);
        posted = view_hub_post(client, true, start, 4 + length, encoded->bytes, encoded->size);
    }
    client->frame += posted;
    free(start);
    free(text);
    return posted;
}

// Once per page.
static void tell_limit(view_client *client, const view_render_thread *render)
{
    char text[80];
    snprintf(text, sizeof text, "frames are limited to %zu pixels by --max-memory",
             render->source->picture_bytes / PICTURE_PIXEL_BYTES);
    view_hub_post_json(client, json_pack("{s:s,s:s}", "type", "error", "text", text));
    client->told_limit = true;
}

// Adapts the scales after a picture that took `seconds`.
static void learn(const view_render_thread *render, view_client *client, const render_task *task,
                  double seconds, bool first)
{
    const double pixels = (double)task->request.camera.width * task->request.camera.height *
                          task->scale * task->scale;
    int movers = 0;
    for (int i = 0; i < HUB_CLIENTS; ++i)
        movers +=
            render->hub->clients[i].used && clock_seconds() - render->hub->clients[i].moved < 1;
    const double share = atomic_load(&render->share);
    const double target = MOVING_SECONDS * fmax(share, 0.25) / (movers > 1 ? movers : 1);
    client->pixel_seconds = seconds / pixels;
    if (!first) {
        const double factor = fmin(fmax(sqrt(target / seconds), 0.4), 1.6);
        const double wanted = task->scale * factor;
        if (task->request.moving || wanted < client->scale)
            client->scale = fmin(fmax(0.5 * (client->scale + wanted), SCALE_MINIMUM), 1);
    }
    client->drawn = task->request;
    client->drawn_scale = task->scale;
    client->drawn_version = render->version;
    if (client->changes != task->changes)
        return;
    const double most = most_scale(render, &task->request);
    if (task->request.moving)
        client->next_scale = 0;
    else
        client->next_scale = task->scale < most ? fmin(most, STEP * task->scale) : 0;
    if (!task->request.moving && most < 1 && !client->next_scale && !client->told_limit)
        tell_limit(client, render);
}

// After a failure: a larger picture, since a wide lens requires a minimum of pixels, or the error.
static void retry(const view_render_thread *render, view_client *client, const render_task *task)
{
    const double most = most_scale(render, &task->request);
    client->next_scale = 0;
    if (task->scale < most)
        client->next_scale = client->scale = fmin(most, STEP * task->scale);
    else
        view_hub_post_json(client,
                           json_pack("{s:s,s:s}", "type", "error", "text", sgs_last_error()));
}

static void draw_picture(view_render_thread *render, const render_task *task, bool built)
{
    view_source *source = render->source;
    view_client *client = task->client;
    const view_request *request = &task->request;
    const double most = most_scale(render, request); // not larger at rest
    const bool full = !request->moving && task->scale >= most,
               lossless = full && !(render->is_live && atomic_load(&render->share) < 1);
    const int width = scaled(request->camera.width, fmin(task->scale, 1)),
              height = scaled(request->camera.height, fmin(task->scale, 1));
    work_context context = work_begin(render, task);
    painted_picture picture;
    encoded_picture encoded = {0};
    const double start = context.start, slept = render->slept;
    pthread_mutex_lock(&source->lock);
    bool done =
        view_painter_draw(&render->painter, request, width, height, full ? request->samples : 1,
                          request->moving ? continue_work : continue_picture, &context, &picture);
    json_t *head = NULL;
    if (done) {
        done = lossless ? encode_png(&picture.image, &encoded)
                        : encode_jpeg(&picture.image,
                                      request->moving ? QUALITY_MOVING : QUALITY_REST, &encoded);
        head = frame_json(render, task, &picture, clock_seconds() - start - (render->slept - slept),
                          lossless, full && most < 1);
        sgs_image8_free(&picture.image);
    }
    pthread_mutex_unlock(&source->lock);
    const double seconds = clock_seconds() - start;
    pthread_mutex_lock(&render->hub->lock);
    if (client->generation == task->generation && client->used) {
        if (done) {
            if (post_picture(client, head, &encoded))
                learn(render, client, task, seconds, built);
        } else if (context.gives_way) { // its cost is at least this
            client->pixel_seconds = fmax(client->pixel_seconds, seconds / ((double)width * height));
        } else if (!context.abandoned && !is_obsolete(render, task)) {
            retry(render, client, task);
        }
    }
    pthread_mutex_unlock(&render->hub->lock);
    json_decref(head);
    encoded_picture_free(&encoded);
}

// ---- Other messages ----

// The records of a region of the shown model: what `explain` reports for its centre. The grid may
// differ between updates. Call with the source's lock held.
static json_t *region_records(view_source *source, uint32_t voxel)
{
    json_t *list = json_array();
    double center[3];
    const int iteration = view_source_regions(source)->iteration; // of the grid that numbers them
    const sgs_regions *grid = NULL;
    pthread_mutex_lock(&source->history_lock);
    const region_history *history = &source->history;
    for (size_t u = 0; u < history->count; ++u)
        if (history->updates[u].iteration == iteration)
            grid = &history->updates[u];
    if (grid)
        region_center(grid, voxel, center);
    for (size_t u = 0; grid && u < history->count; ++u) {
        const sgs_regions *update = &history->updates[u];
        bool inside;
        const uint32_t at = region_voxel(update, center, &inside);
        const sgs_region *region = inside ? region_find(update, at) : NULL;
        if (region)
            json_array_append_new(list, region_json(update, region));
    }
    pthread_mutex_unlock(&source->history_lock);
    return json_pack("{s:s,s:I,s:o}", "type", "region", "voxel", (json_int_t)voxel, "updates",
                     list);
}

static json_t *save_exr(view_render_thread *render, const render_task *task)
{
    char *path, text[200];
    work_context context = work_begin(render, task);
    if (!view_painter_allows(render->source, &task->request.camera, EXR_PIXEL_BYTES)) {
        snprintf(text, sizeof text,
                 "an EXR file of more than %zu pixels exceeds the memory that --max-memory leaves "
                 "the viewer; select a smaller size, or use 'sparegs render' after the training",
                 render->source->picture_bytes / EXR_PIXEL_BYTES);
        return json_pack("{s:s,s:s}", "type", "error", "text", text);
    }
    const bool done =
        view_painter_exr(&render->painter, &task->request, continue_work, &context, &path);
    const char *error = context.abandoned
                            ? "the EXR file was not written because training has ended; save again"
                        : path ? sgs_last_error()
                               : "all file names view_NNNN.exr are in use; move some of the files "
                                 "away";
    json_t *reply = done ? json_pack("{s:s,s:o}", "type", "saved", "path", json_text(path))
                         : json_pack("{s:s,s:s}", "type", "error", "text", error);
    free(path);
    return reply;
}

static json_t *crop_reply(view_render_thread *render, const render_task *task)
{
    work_context context = work_begin(render, task);
    if (render->is_live)
        return json_pack("{s:s,s:s}", "type", "error", "text",
                         "cannot crop while training is running");
    json_t *reply = crop_save(&task->request.crop, render->source, continue_work, &context);
    if (reply)
        return reply;
    const char *error = last_error_text();
    return json_pack("{s:s,s:o}", "type", "error", "text", json_message(error, strlen(error)));
}

// Why a request has no answer.
static const char *failure(const render_task *task)
{
    const view_message *job = &task->job;
    const sgs_camera *camera = &task->request.camera;
    if (!camera->width)
        return "the page has not sent a camera yet";
    if (job->x >= camera->width || job->y >= camera->height)
        return "the pixel is outside of the view";
    return "not enough memory to answer the request";
}

static void answer(view_render_thread *render, const render_task *task)
{
    view_source *source = render->source;
    const view_message *job = &task->job;
    const bool has_camera = task->request.camera.width > 0;
    json_t *reply = NULL;
    pthread_mutex_lock(&source->lock);
    if (job->type == MESSAGE_PROBE && has_camera)
        reply = view_painter_probe(&render->painter, &task->request, job->x, job->y);
    else if (job->type == MESSAGE_RAY && has_camera)
        reply = ray_inspect(source, &task->request, job->x, job->y);
    else if (job->type == MESSAGE_EXR && has_camera)
        reply = save_exr(render, task);
    else if (job->type == MESSAGE_CROP && has_camera)
        reply = crop_reply(render, task);
    else if (job->type == MESSAGE_REGION)
        reply = region_records(source, job->number);
    pthread_mutex_unlock(&source->lock);
    if (job->type == MESSAGE_HISTORY)
        reply = render->history(render->context);
    if (!reply)
        reply = json_pack("{s:s,s:s}", "type", "error", "text", failure(task));
    pthread_mutex_lock(&render->hub->lock);
    if (task->client->generation == task->generation)
        view_hub_post_json(task->client, reply);
    else
        json_decref(reply);
    pthread_mutex_unlock(&render->hub->lock);
}

static void *draw_all(void *argument)
{
    view_render_thread *render = argument;
    render_task task;
    uint64_t built = UINT64_MAX; // the model whose BVH exists
    while (next_task(render, &task)) {
        render->slice = clock_seconds();
        if (task.job.type != MESSAGE_INVALID) {
            answer(render, &task);
        } else {
            draw_picture(render, &task, built != render->version);
            built = render->version;
        }
        keep_share(render, NULL);
    }
    return NULL;
}

bool view_render_thread_start(view_render_thread *render)
{
    render->painter.source = render->source;
    render->running = !pthread_create(&render->thread, NULL, draw_all, render);
    if (!render->running)
        fail_run("cannot start the rendering thread");
    return render->running;
}

void view_render_thread_join(view_render_thread *render)
{
    if (render->running)
        pthread_join(render->thread, NULL);
    render->running = false;
    view_painter_free(&render->painter);
}
