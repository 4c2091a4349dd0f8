// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Transport of bytes between ranks: threads of one process, or an MPI plug-in. Every function is
// called by all ranks in the same order, by one thread of each. Failures of the network end the
// process, as MPI does by default.

#include <stddef.h>

enum { SGSI_TRANSPORT_VERSION = 1, SGSI_TRANSPORT_UNIT = 64 };

static inline size_t sgsi_ranks_padded(size_t bytes)
{
    return (bytes + SGSI_TRANSPORT_UNIT - 1) / SGSI_TRANSPORT_UNIT * SGSI_TRANSPORT_UNIT;
}

typedef struct sgsi_transport {
    int rank, count;
    void *state;
    // `bytes` of every rank, at most 1 GiB, to got[count][bytes] of every rank.
    void (*gather)(void *state, const void *send, size_t bytes, void *got);
    // The same with sizes[count] bytes, multiples of SGSI_TRANSPORT_UNIT; got has no gaps.
    void (*gather_sizes)(void *state, const void *send, const size_t *sizes, void *got);
    // to[r] bytes for rank r, from `send` without gaps; got receives from[r] bytes of rank r. All
    // sizes are multiples of SGSI_TRANSPORT_UNIT.
    void (*exchange)(void *state, const void *send, const size_t *to, void *got,
                     const size_t *from);
    // `bytes` of rank 0 to all.
    void (*broadcast)(void *state, void *bytes, size_t size);
    void (*close)(void *state); // waits for all ranks
} sgsi_transport;

// The only symbol of a plug-in: joins the ranks. Returns SGSI_TRANSPORT_VERSION.
typedef int (*sgsi_transport_open_fn)(sgsi_transport *transport);
#define SGSI_TRANSPORT_OPEN "sgsi_transport_open"
