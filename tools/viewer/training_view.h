// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// `train --view`: shows the model that is being trained. Pages can pause the training, request a
// checkpoint, and stop it. The viewer draws a copy of the model, made between two iterations, and
// sleeps so that it takes a given share of the time; the training computes the same bits.
//
// The functions are for the thread that trains. All accept NULL (no viewer).

#include "arguments/shared_options.h"
#include "sparegs/trainer.h"

typedef struct training_view training_view;

typedef struct training_view_options {
    const char *place;      // "[ADDRESS:]PORT", valid
    const char *token;      // or NULL; see view_session.h
    double share;           // (0, 1]
    const char *folder;     // of the run
    drawing_values drawing; // of the model
    const sgs_scene *scene;
    int total;                         // iterations
    size_t picture_bytes, photo_bytes; // see view_source.h
    bool has_regions, prints_to_stderr;
} training_view_options;

// Starts the server and prints its URL. NULL after printing the error.
training_view *training_view_open(const training_view_options *options, const sgs_trainer *trainer);
// True if the viewer would like to draw the present model; NULL does not.
bool training_view_wants(training_view *view);
// After an iteration. With several ranks, after sgs_trainer_collect if the viewer wants the model.
void training_view_step(training_view *view, const sgs_step_info *info, const sgs_trainer *trainer);
// True while a page has paused the training; returns after a fraction of a second. Call until
// false. With several ranks a pause begins when the model that training_view_wants asks for has
// been collected, since the others wait then. A pause ends PAUSE_SECONDS_ALONE after the last page
// has gone, so that a batch job does not idle until its time limit.
bool training_view_holds(training_view *view, const sgs_trainer *trainer);
// The training has ended: pages cannot control it any more, and nothing is drawn until
// training_view_show_last or training_view_close, so that the results are saved first.
void training_view_finish(training_view *view, const sgs_trainer *trainer);
// Pages show the last model, without a limit on the time, and can be used until
// training_view_close. Waits for a file that a page has requested, unless a signal arrives.
void training_view_show_last(training_view *view, const sgs_trainer *trainer);
void training_view_close(training_view *view);

// The time without pages of a pause; zero-initialise.
enum { PAUSE_SECONDS_ALONE = 60 };
typedef struct pause_watch {
    bool is_alone;
    double since; // seconds
} pause_watch;
// Call repeatedly with the number of connected pages and the time. True if no page has been
// connected for PAUSE_SECONDS_ALONE.
bool pause_watch_expires(pause_watch *watch, int pages, double now);

// NULL if the texts of --view and --view-token (or NULL) are valid, else what is expected.
const char *training_view_check(const char *place, const char *token);
// False after printing the error if the place of --view (or NULL) cannot be listened on.
bool training_view_is_possible(const char *place);
