// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/training_view.h"

#include <stdio.h>
#include <stdlib.h>

#include "arguments/model_argument.h"
#include "cli/json_output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"
#include "sparegs/runtime.h"
#include "viewer/view_session.h"

#define REPORT_SECONDS 0.5

struct training_view {
    view_session session;
    double share;
    atomic_bool paused;
    pthread_mutex_t lock; // of what follows
    pthread_cond_t changed;
    sgs_step_info info;
    sgs_train_seconds seconds;
    int total;
    bool finished;
    double rate; // iterations per second
    // Of the training thread.
    double reported;
    int reported_iteration;
    pause_watch watch;
};

// ---- What pages see ----

static json_t *phases_json(const sgs_train_seconds *s)
{
    return json_pack("{s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f,s:f}", "gather", s->gather, "forward",
                     s->forward, "loss", s->loss, "backward", s->backward, "optimizer",
                     s->optimizer, "bvh_refit", s->bvh_refit, "bvh_build", s->bvh_build, "density",
                     s->density, "spare", s->spare, "image_io", s->image_io);
}

static json_t *progress_json(void *context)
{
    training_view *view = context;
    pthread_mutex_lock(&view->lock);
    const sgs_step_info info = view->info;
    const sgs_train_seconds seconds = view->seconds;
    const double rate = view->rate;
    const bool finished = view->finished;
    pthread_mutex_unlock(&view->lock);
    json_t *root = json_pack(
        "{s:s,s:i,s:i,s:f,s:f,s:I,s:f,s:I,s:b,s:b}", "type", "progress", "iteration",
        info.iteration, "total", view->total, "loss", info.loss_average, "psnr", info.psnr_average,
        "gaussians", (json_int_t)info.gaussians, "rate", rate, "rss", (json_int_t)sgs_rss_current(),
        "paused", atomic_load(&view->paused), "finished", finished);
    json_object_set_new(
        root, "eta", rate > 0 ? json_number((view->total - info.iteration) / rate) : json_null());
    json_object_set_new(root, "phases", phases_json(&seconds));
    return root;
}

static void report(training_view *view)
{
    view_hub_broadcast(&view->session.hub, progress_json(view));
}

// ---- Pauses ----

bool pause_watch_expires(pause_watch *watch, int pages, double now)
{
    if (pages > 0)
        watch->is_alone = false;
    else if (!watch->is_alone)
        *watch = (pause_watch){true, now};
    return watch->is_alone && now - watch->since >= PAUSE_SECONDS_ALONE;
}

// A paused run leaves the cores to the viewer. Call with the lock held.
static void set_paused(training_view *view, bool paused, const char *note)
{
    atomic_store(&view->session.render.share, paused ? 1 : view->share);
    if (atomic_exchange(&view->paused, paused) != paused)
        print_note("%s", note);
}

// With the lock held.
static void control(training_view *view, run_action action)
{
    switch (action) {
    case RUN_PAUSE:
        set_paused(view, true, "paused from the viewer; press Ctrl-C to save and quit");
        break;
    case RUN_CONTINUE:
        set_paused(view, false, "resumed from the viewer");
        break;
    case RUN_CHECKPOINT:
        interrupt_want_checkpoint();
        break;
    case RUN_STOP:
        if (!interrupt_signal())
            print_note("stopped from the viewer; saving");
        interrupt_request();
        break;
    }
}

// Called by a thread of the server. A request that arrives after the last iteration has no effect:
// a stop would end the evaluation.
static void act(void *context, run_action action)
{
    training_view *view = context;
    pthread_mutex_lock(&view->lock);
    if (!view->finished)
        control(view, action);
    pthread_cond_broadcast(&view->changed);
    pthread_mutex_unlock(&view->lock);
    report(view);
}

// ---- Start ----

const char *training_view_check(const char *place, const char *token)
{
    view_address address;
    if (place && !view_address_parse(place, &address))
        return "--view: must be PORT or ADDRESS:PORT with a numeric IPv4 address";
    if ((place || token) && !view_token_is_possible(token))
        return token ? "--view-token: " VIEW_TOKEN_SYNTAX
                     : VIEW_TOKEN_VARIABLE ": " VIEW_TOKEN_SYNTAX;
    return NULL;
}

bool training_view_is_possible(const char *place)
{
    view_address address;
    return !place || !view_address_parse(place, &address) || view_address_is_free(&address);
}

static bool start(training_view *view, const training_view_options *options,
                  const sgs_trainer *trainer)
{
    view_session_options session = {
        .token = options->token, .share = options->share, .training = true};
    sgs_gaussians *model;
    view_source *source = &view->session.source;
    if (!view_address_parse(options->place, &session.address))
        return false;
    if (sgs_gaussians_create(sgs_trainer_model(trainer)->count, &model)) {
        fail_library();
        return false;
    }
    source->drawing = options->drawing;
    source->name = options->folder;
    source->scene = options->scene;
    source->expects_regions = options->has_regions;
    source->picture_bytes = options->picture_bytes;
    source->photo_bytes = options->photo_bytes;
    atomic_store(&source->wanted, true);
    if (!view_source_open(source, model, options->folder, sgs_trainer_iteration(trainer)))
        return false;
    view_source_offer(source, sgs_trainer_model(trainer), sgs_trainer_filter_3d(trainer),
                      sgs_trainer_iteration(trainer));
    model_measure(sgs_trainer_model(trainer), source->center, &source->extent);
    return view_session_start(&view->session, &session);
}

training_view *training_view_open(const training_view_options *options, const sgs_trainer *trainer)
{
    training_view *view = calloc(1, sizeof *view);
    if (!view) {
        fail_run("not enough memory for the viewer");
        return NULL;
    }
    pthread_mutex_init(&view->lock, NULL);
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&view->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    view->share = options->share;
    view->total = options->total;
    view->info.iteration = view->reported_iteration = sgs_trainer_iteration(trainer);
    view->info.gaussians = sgs_trainer_model(trainer)->count;
    view->seconds = sgs_trainer_seconds(trainer);
    view->reported = clock_seconds();
    view->session.progress = progress_json;
    view->session.act = act;
    view->session.run_context = view;
    if (!start(view, options, trainer)) {
        training_view_close(view);
        return NULL;
    }
    if (options->prints_to_stderr)
        fprintf(stderr, "sparegs: view: %s\n", view_server_url(view->session.server));
    else
        view_session_print(&view->session);
    return view;
}

// ---- Between iterations ----

bool training_view_wants(training_view *view)
{
    return view && (atomic_load(&view->session.source.wanted) || atomic_load(&view->paused));
}

// With several ranks the model is whole only where training_view_wants asked for it.
static bool is_whole(const sgs_trainer *trainer)
{
    return sgs_trainer_model(trainer)->count == sgs_trainer_count(trainer);
}

static bool offer(training_view *view, const sgs_trainer *trainer, int iteration)
{
    return is_whole(trainer) && view_source_offer(&view->session.source, sgs_trainer_model(trainer),
                                                  sgs_trainer_filter_3d(trainer), iteration);
}

void training_view_step(training_view *view, const sgs_step_info *info, const sgs_trainer *trainer)
{
    if (!view)
        return;
    const sgs_regions regions = sgs_trainer_regions(trainer);
    if (info->structural && regions.iteration == info->structure_iteration)
        view_source_add_regions(&view->session.source, &regions);
    if (offer(view, trainer, info->iteration))
        view_hub_wake(&view->session.hub);
    const double now = clock_seconds(), passed = now - view->reported;
    pthread_mutex_lock(&view->lock);
    view->info = *info;
    if (passed >= REPORT_SECONDS) {
        view->seconds = sgs_trainer_seconds(trainer);
        view->rate = (info->iteration - view->reported_iteration) / passed;
    }
    pthread_mutex_unlock(&view->lock);
    if (passed < REPORT_SECONDS)
        return;
    view->reported = now;
    view->reported_iteration = info->iteration;
    report(view);
}

// Copies the model of a pause if the viewer has an earlier one.
static void offer_last(training_view *view, const sgs_trainer *trainer)
{
    view_source *source = &view->session.source;
    const int iteration = sgs_trainer_iteration(trainer);
    if (atomic_load(&source->iteration) == iteration)
        return;
    atomic_store(&source->wanted, true);
    if (offer(view, trainer, iteration))
        view_hub_wake(&view->session.hub);
}

// The same after the training, whose model is about to be freed.
static void replace_last(training_view *view, const sgs_trainer *trainer)
{
    view_source *source = &view->session.source;
    const int iteration = sgs_trainer_iteration(trainer);
    if (!is_whole(trainer) || atomic_load(&source->iteration) == iteration)
        atomic_store(&source->replacing, false);
    else if (!view_source_replace(source, sgs_trainer_model(trainer),
                                  sgs_trainer_filter_3d(trainer), iteration) &&
             !interrupt_signal())
        print_warning("not enough memory to show the last model; the viewer shows that of "
                      "iteration %d",
                      atomic_load(&source->iteration));
}

static void show_pause(training_view *view)
{
    const sgs_step_info *info = &view->info; // written by this thread only
    progress_pause(&(progress_state){info->iteration, view->total, info->loss_average,
                                     info->psnr_average, info->gaussians});
    if (!pause_watch_expires(&view->watch, view_hub_count(&view->session.hub), clock_seconds()))
        return;
    pthread_mutex_lock(&view->lock);
    set_paused(view, false, "resumed: no page has been open for a minute");
    pthread_mutex_unlock(&view->lock);
    report(view);
}

bool training_view_holds(training_view *view, const sgs_trainer *trainer)
{
    if (!view || !atomic_load(&view->paused) || !is_whole(trainer)) {
        if (view)
            view->watch = (pause_watch){0};
        return false;
    }
    offer_last(view, trainer);
    show_pause(view);
    const double end = clock_seconds() + 0.1;
    const struct timespec until = {(time_t)end, (long)((end - (double)(time_t)end) * 1e9)};
    pthread_mutex_lock(&view->lock);
    if (atomic_load(&view->paused))
        pthread_cond_timedwait(&view->changed, &view->lock, &until);
    pthread_mutex_unlock(&view->lock);
    view->reported = clock_seconds(); // a pause does not reduce the rate
    return atomic_load(&view->paused);
}

void training_view_finish(training_view *view, const sgs_trainer *trainer)
{
    if (!view)
        return;
    pthread_mutex_lock(&view->lock);
    view->finished = true;
    view->seconds = sgs_trainer_seconds(trainer);
    pthread_mutex_unlock(&view->lock);
    view_source_expect_last(&view->session.source);
    view_hub_wake(&view->session.hub); // ends the sleep of a picture for the share
    report(view);
}

void training_view_show_last(training_view *view, const sgs_trainer *trainer)
{
    if (!view)
        return;
    replace_last(view, trainer);
    atomic_store(&view->session.render.share, 1);
    view_hub_wake(&view->session.hub);
}

void training_view_close(training_view *view)
{
    if (!view)
        return;
    view_session_stop(&view->session);
    view_source_close(&view->session.source);
    pthread_cond_destroy(&view->changed);
    pthread_mutex_destroy(&view->lock);
    free(view);
}
