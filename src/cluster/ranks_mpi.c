// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The plug-in: moves bytes by MPI. The only file that includes mpi.h; compiled once per MPI library
// as ranks-openmpi.so or ranks-mpich.so. It never adds numbers. Counts of MPI are ints, so messages
// are counted in units of 64 bytes. Only the thread that opened the transport calls MPI.

#include <mpi.h>
#include <stdlib.h>

#include "cluster/transport.h"

enum { UNIT = SGSI_TRANSPORT_UNIT, PIECE = 1 << 30 };

// Counts and displacements of gather_sizes and exchange.
typedef struct mpi_state {
    int rank, count;
    MPI_Datatype unit;
    int *sizes, *begins, *other_sizes, *other_begins;
} mpi_state;

int sgsi_transport_open(sgsi_transport *transport);

static void gather(void *context, const void *send, size_t bytes, void *got)
{
    (void)context;
    MPI_Allgather(send, (int)bytes, MPI_BYTE, got, (int)bytes, MPI_BYTE, MPI_COMM_WORLD);
}

static void in_units(int count, const size_t *bytes, int *sizes, int *begins)
{
    int at = 0;
    for (int r = 0; r < count; ++r) {
        sizes[r] = (int)(bytes[r] / UNIT);
        begins[r] = at;
        at += sizes[r];
    }
}

static void gather_sizes(void *context, const void *send, const size_t *sizes, void *got)
{
    mpi_state *s = context;
    in_units(s->count, sizes, s->sizes, s->begins);
    MPI_Allgatherv(send, s->sizes[s->rank], s->unit, got, s->sizes, s->begins, s->unit,
                   MPI_COMM_WORLD);
}

static void exchange(void *context, const void *send, const size_t *to, void *got,
                     const size_t *from)
{
    mpi_state *s = context;
    in_units(s->count, to, s->sizes, s->begins);
    in_units(s->count, from, s->other_sizes, s->other_begins);
    MPI_Alltoallv(send, s->sizes, s->begins, s->unit, got, s->other_sizes, s->other_begins, s->unit,
                  MPI_COMM_WORLD);
}

static void broadcast(void *context, void *bytes, size_t size)
{
    (void)context;
    for (size_t at = 0; at < size; at += PIECE) {
        const size_t piece = size - at < PIECE ? size - at : PIECE;
        MPI_Bcast((char *)bytes + at, (int)piece, MPI_BYTE, 0, MPI_COMM_WORLD);
    }
}

static void leave(void *context)
{
    mpi_state *s = context;
    MPI_Type_free(&s->unit);
    MPI_Finalize();
    free(s->sizes);
    free(s);
}

__attribute__((visibility("default"))) int sgsi_transport_open(sgsi_transport *transport)
{
    int provided = 0;
    MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &provided);
    mpi_state *s = calloc(1, sizeof *s);
    if (!s || provided < MPI_THREAD_FUNNELED) {
        MPI_Abort(MPI_COMM_WORLD, 1);
        free(s); // is not reached
        return 0;
    }
    MPI_Comm_rank(MPI_COMM_WORLD, &s->rank);
    MPI_Comm_size(MPI_COMM_WORLD, &s->count);
    s->sizes = calloc(4 * (size_t)s->count, sizeof *s->sizes);
    if (!s->sizes) {
        MPI_Abort(MPI_COMM_WORLD, 1);
        free(s);
        return 0;
    }
    s->begins = s->sizes + s->count;
    s->other_sizes = s->begins + s->count;
    s->other_begins = s->other_sizes + s->count;
    MPI_Type_contiguous(UNIT, MPI_BYTE, &s->unit);
    MPI_Type_commit(&s->unit);
    *transport = (sgsi_transport){.rank = s->rank,
                                  .count = s->count,
                                  .state = s,
                                  .gather = gather,
                                  .gather_sizes = gather_sizes,
                                  .exchange = exchange,
                                  .broadcast = broadcast,
                                  .close = leave};
    return SGSI_TRANSPORT_VERSION;
}
