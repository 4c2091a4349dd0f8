// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The ranks of this program under mpirun or srun (sparegs/ranks.h). Only rank 0 prints; the
// messages of the others reach it when they fail. All ranks write the images of their views, and
// the folders of their runs; rank 0 writes everything else. Without a launcher there are no ranks,
// and every function does what a single process needs.

#include <jansson.h>
#include <stdbool.h>

#include "options/options.h"
#include "sparegs/ranks.h"

// Requests that must reach all ranks in the same iteration.
enum {
    GROUP_TERMINATE = 1, // SIGTERM, see group_stop_requested
    GROUP_TIME = 2,
    GROUP_MEMORY = 4,
    GROUP_CHECKPOINT = 8,
    GROUP_VIEW = 16,      // the viewer needs the model
    GROUP_INTERRUPT = 32, // SIGINT
    GROUP_HANG_UP = 64    // SIGHUP
};

// Discards the output of this process if it is a rank other than 0. Call it first.
void group_silence(void);
// For a rank other than 0 that ends with an error before it has joined the others. Waits a moment,
// because the launcher ends the job when the first rank exits, and the message of rank 0 would be
// lost. If the job still runs then, rank 0 has no error, and this rank prints its own.
void group_let_lead_speak(int status);
// Joins the ranks, if there is a launcher. `command` is for messages; supported: whether it works
// on several ranks. Returns -1 to continue, or an exit status.
int group_open(const char *command, bool supported);
// Warns if the launcher has bound rank 0 to fewer cores than it has threads, or to one of many, or
// if the ranks of its machine have more threads than the machine has cores. Open MPI binds each
// rank to a core or a socket by default. Call when the number of threads is known.
void group_check_binding(void);
// Leaves the ranks. Returns `status`, a failure if another rank failed, or the status of a signal
// if one stopped a rank while it loaded the scene.
int group_close(int status);

// NULL without ranks.
sgs_ranks *group_ranks(void);
bool group_leads(void); // rank 0, or no ranks
int group_count(void);  // 1 without ranks
// Ranks on this machine, which share its memory: those with the same host name and boot; 1 without
// ranks.
int group_machine_ranks(void);

// Collective: true if all ranks pass true. Rank 0 prints the error of a rank that passes false: the
// last one that this rank has passed to fail_run() or fail_library(). Rank 0 prints its own error
// itself. A signal to this rank is sent with the call, see group_stop_requested.
bool group_all(bool own);

// Whether the options in "a|b|c", which decide on collective calls, are those of rank 0. Otherwise
// false on all ranks; rank 0 has printed the error. Collective.
bool group_same_options(const command_line *line, const char *names);
// The same for lines "what: value", see sgs_ranks_compare. Frees the text; NULL: out of memory.
bool group_same_text(char *text);

// True if the request was raised on any rank; the same on all ranks in the same iteration. `own`
// raises it.
bool group_requested(unsigned request, bool own);

// The same for a request that may be made again: it is withdrawn.
bool group_taken(unsigned request, bool own);

// True if any rank had received a signal to stop at the last collective call. A rank without one
// then behaves as if it had received the same signal, so that all end with its status.
bool group_stop_requested(void);

// For loops of rounds in which every rank does work of its own: whether to continue with `round`.
// The ranks meet in every `every`-th round; if one has failed (`own` is false) or received a
// signal, all leave the loop there. Until then that rank has no more work to do. Collective.
enum { GROUP_ROUNDS = 8 }; // `every` for rounds that need no other rank
bool group_continues(size_t round, size_t every, bool own);

// After a failure that all ranks have received: they may communicate again. True if all pass true.
// Collective.
bool group_recover(bool own);

// The value of rank 0 on all ranks. Collective.
int group_number(int value);

// The value of rank 0 on all ranks; NULL if that is NULL, or on failure. Takes over the reference
// of `value`. Collective.
json_t *group_json(json_t *value);

// Whether `folder` is the same folder on all ranks: the others must see a file that rank 0 makes in
// it. Otherwise false on all; rank 0 has printed the error. Collective.
bool group_shares_folder(const char *folder);

// The values of all ranks in their order, on rank 0; NULL on the others, or on failure, which rank
// 0 has printed. Takes over the reference of `value`. Without ranks an array of it. Collective.
json_t *group_gather_json(json_t *value);

// Bytes and messages between the ranks so far, by purpose, summed over the ranks: {"records":
// {"calls":n,"messages":n,"bytes":n}, ...}. NULL without ranks. Collective.
json_t *group_traffic(void);
