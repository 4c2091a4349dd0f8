// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Ranks: processes on one or several machines, started by mpirun or srun, that train one model.
// Every rank calls the same functions in the same order. Each call also carries the status of the
// caller, so that all ranks learn of a failure in the same call and stop together. Messages only
// move bytes, and sums are computed in a fixed order: the model has the same bits for any number of
// ranks.
//
// NULL stands for a single process: every function accepts it and does nothing, or returns what a
// single process would.
//
// Threads: all calls on the ranks of a process come from one thread, outside of loops;
// sgs_ranks_raise may be called from any thread.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgs_ranks sgs_ranks;

// Number of processes according to the launcher's environment variables (Open MPI, MPICH, Slurm); 1
// without a launcher. *rank receives the number of this process, from 0; it may be NULL. Cannot
// fail.
SGS_API int sgs_ranks_launched(int *rank);
// Removes these variables from the environment, so that child processes do not take themselves for
// ranks.
SGS_API void sgs_ranks_forget_launcher(void);

// Joins the ranks of a launcher through the plug-in of its MPI library, which is loaded now:
// "ranks-openmpi.so" or "ranks-mpich.so", in `folder`, or, if it is NULL, next to the program and
// in LIBDIR/sparegs of the installation. *ranks is NULL, with success, if there is one process.
// Fails with UNSUPPORTED if no plug-in can be loaded, or with OUT_OF_MEMORY. Collective. Call at
// most once per process.
SGS_API sgs_status sgs_ranks_open(const char *folder, sgs_ranks **ranks);
// Waits for all ranks, unless a collective call has failed, and leaves them. Accepts NULL.
SGS_API void sgs_ranks_close(sgs_ranks *ranks);

SGS_API int sgs_ranks_rank(const sgs_ranks *ranks);  // 0 without ranks
SGS_API int sgs_ranks_count(const sgs_ranks *ranks); // 1 without ranks

// Collective: all ranks return OK, or all fail with the status and message of the lowest rank that
// failed, as "rank 3 (node07): ...". The message is that rank's sgs_last_error(). After that, every
// collective call fails at once with this status. Without ranks it returns `own`.
SGS_API sgs_status sgs_ranks_agree(sgs_ranks *ranks, sgs_status own);

// The same with `text` as the message of this rank if it fails; NULL = sgs_last_error().
SGS_API sgs_status sgs_ranks_agree_text(sgs_ranks *ranks, sgs_status own, const char *text);

// Compares `text`, lines of the form "what: value", with that of rank 0, and refuses ranks that
// differ. The message names the first line that differs. Collective; fails with INVALID_ARGUMENT.
SGS_API sgs_status sgs_ranks_compare(sgs_ranks *ranks, sgs_status own, const char *text);

// Sets flags that this rank sends with its next collective call; bits 0 to 15 are free for callers.
// sgs_ranks_raised returns the flags that any rank had sent by the last collective call: the same
// on all ranks. Without ranks no flag is kept, and it returns 0.
SGS_API void sgs_ranks_raise(sgs_ranks *ranks, uint32_t flags);
SGS_API uint32_t sgs_ranks_raised(const sgs_ranks *ranks);
// Clears flags that all ranks have seen. All ranks call it between the same two collective calls.
SGS_API void sgs_ranks_lower(sgs_ranks *ranks, uint32_t flags);
// Permits collective calls again after a failure, for instance to save the state. All ranks call it
// after the call that failed and before the next collective one.
SGS_API void sgs_ranks_recover(sgs_ranks *ranks);

// Copies *bytes of rank 0, `*size` of them, to all other ranks, where *bytes is replaced by memory
// from malloc that the caller frees, with a NUL after the last byte. Rank 0 keeps its own. Fails
// with OUT_OF_MEMORY; *bytes is then unchanged. Collective.
SGS_API sgs_status sgs_ranks_broadcast(sgs_ranks *ranks, sgs_status own, void **bytes,
                                       size_t *size);

// Gathers `size` bytes of each rank, the same size on all, into got[count][size] on all ranks, in
// the order of the ranks. Fails with LIMIT if `size` exceeds 1 GiB, or with INVALID_ARGUMENT if it
// differs between ranks. Collective.
SGS_API sgs_status sgs_ranks_gather(sgs_ranks *ranks, sgs_status own, const void *bytes,
                                    size_t size, void *got);

// Sends `size` bytes of each of the first `senders` ranks (1 to the number of ranks) to rank 0,
// into its got[senders][size]. All ranks pass the same `size` and `senders`. Ranks from `senders`
// on may pass NULL as `bytes`, all but rank 0 as `got`. Collective.
SGS_API sgs_status sgs_ranks_collect(sgs_ranks *ranks, sgs_status own, const void *bytes,
                                     size_t size, int senders, void *got);

// Bytes that this rank has sent to others, and messages (one per call and receiver), by purpose.
typedef struct sgs_ranks_traffic {
    uint64_t calls, messages, bytes;
} sgs_ranks_traffic;
typedef enum sgs_ranks_purpose {
    SGS_RANKS_STATUS,    // the header of every call
    SGS_RANKS_IMAGE,     // colour and transmittance around the cells of other ranks
    SGS_RANKS_SUMS,      // sums of loss and exposure per cell, costs, depth bounds
    SGS_RANKS_RECORDS,   // projected primitives, from their owners to the cells they may overlap
    SGS_RANKS_GRADIENTS, // gradient sums of the cells' primitives, to their owners
    SGS_RANKS_STRUCTURE, // structural updates: columns of all rows, rows to their new owners
    SGS_RANKS_SCORES,    // records, images and sums for scores from views
    SGS_RANKS_OTHER,     // start, evaluation, files
    SGS_RANKS_PURPOSE_COUNT
} sgs_ranks_purpose;
SGS_API sgs_ranks_traffic sgs_ranks_traffic_get(const sgs_ranks *ranks, sgs_ranks_purpose purpose);

// Seconds that this rank has spent in collective calls, by purpose. Every call begins with a header
// that is complete when the last rank has sent its part: the time until then counts as waiting. A
// call without data, such as sgs_ranks_agree, counts as SGS_RANKS_STATUS.
typedef struct sgs_ranks_seconds {
    double waiting; // for the other ranks, and the latency of the header
    double moving;  // transfer of the bytes of the call
} sgs_ranks_seconds;
SGS_API sgs_ranks_seconds sgs_ranks_seconds_get(const sgs_ranks *ranks, sgs_ranks_purpose purpose);
// "status", "image", ...; "unknown" outside the enumeration. Constant string.
SGS_API const char *sgs_ranks_purpose_name(sgs_ranks_purpose purpose);

#ifdef __cplusplus
}
#endif
