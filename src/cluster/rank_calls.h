// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Ranks inside the library: collective calls with buffers that are kept from call to call, and
// ranks as threads of one process for tests. Every call takes the caller's own status and fails on
// all ranks if it is a failure on one.

#include "cluster/transport.h"
#include "sparegs/ranks.h"

// Raised by the library, besides the flags of callers.
enum {
    SGSI_RANKS_SEEN = 1 << 16,   // a primitive was hit
    SGSI_RANKS_LIMITED = 1 << 17 // the memory of a rank is limited
};

struct sgs_ranks {
    sgsi_transport transport;
    char node[64];
    sgs_status failed;         // of a collective call; all later ones fail
    char message[1200];        // of that failure
    _Atomic uint32_t own;      // flags raised here
    uint32_t raised;           // flags of all ranks
    uint64_t cut_seed;         // tests: random cuts of the cells, 0 = by cost
    unsigned char *send, *got; // buffers of sgsi_ranks_share and sgsi_ranks_exchange
    size_t send_capacity, got_capacity;
    size_t most_shared;   // bytes of the largest sgsi_ranks_share
    size_t most_received; // bytes of the largest sgsi_ranks_deliver on any rank
    size_t *sizes;        // [count]
    uint64_t *matrix;     // [count][count]: of sgsi_ranks_deliver
    void *headers;        // [count]: of a call
    sgs_ranks_traffic counted[SGS_RANKS_PURPOSE_COUNT];
    sgs_ranks_seconds spent[SGS_RANKS_PURPOSE_COUNT];
};

// Ranks over a transport, which sgs_ranks_close closes. Fails on all ranks alike, with
// OUT_OF_MEMORY if one has no memory, or with LIMIT (more than 65536); the transport is then
// closed. Collective.
sgs_status sgsi_ranks_create(const sgsi_transport *transport, sgs_ranks **ranks);

// `count` transports of threads of this process; each is used by its own thread. Frees itself with
// the last close. False if out of memory.
bool sgsi_ranks_threads(int count, sgsi_transport *transports);

// Memory to fill for the next call, on this rank; NULL if out of memory. Valid until that call.
void *sgsi_ranks_room(sgs_ranks *ranks, size_t bytes);

// Sends `bytes` from sgsi_ranks_room to all ranks. *got receives the bytes of all ranks in their
// order, where rank r has sizes[r] of them, padded to SGSI_TRANSPORT_UNIT; `sizes` [count] is owned
// by the ranks. Both are valid until the next call. got of this rank is included.
sgs_status sgsi_ranks_share(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                            size_t bytes, const unsigned char **got, const size_t **sizes);

// Sends to[r] bytes to each rank r, from sgsi_ranks_room without gaps, and receives from[r], which
// the caller knows; all multiples of SGSI_TRANSPORT_UNIT.
sgs_status sgsi_ranks_exchange(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                               const size_t *to, const size_t *from, const unsigned char **got);

// The same where the receivers do not know the sizes: *from [count] receives them, owned by the
// ranks.
sgs_status sgsi_ranks_deliver(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                              const size_t *to, const unsigned char **got, const size_t **from);

// Copies `bytes` of rank 0, the same number on all ranks, to the others.
sgs_status sgsi_ranks_copy(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose, void *data,
                           size_t bytes);

enum { SGSI_RANKS_HEADER_BYTES = 24 }; // of every call, from each rank to each other
