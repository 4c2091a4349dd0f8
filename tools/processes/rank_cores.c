// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "processes/rank_cores.h"

#include <stdbool.h>
#include <stddef.h>

#include "cli/output.h"

char *rank_cores_advice(const rank_cores *c)
{
    const char *many = c->threads == 1 ? "" : "s";
    const bool bound = c->own < c->machine;
    const bool idle = bound && c->own == 1 && c->machine >= 2L * c->ranks;
    if ((bound && c->own < c->threads) || idle)
        return format_text("each rank may use %d of %ld cores and has %d thread%s; start mpirun "
                           "with --map-by ppr:1:node --bind-to none, or srun with -c",
                           c->own, c->machine, c->threads, many);
    if (c->ranks < 2 || (long)c->threads * c->ranks <= c->machine)
        return NULL;
    const long share = c->machine / c->ranks;
    if (!share)
        return format_text("%d ranks oversubscribe the %ld core%s of their machine; start fewer",
                           c->ranks, c->machine, c->machine == 1 ? "" : "s");
    return format_text("%d ranks with %d thread%s each oversubscribe the %ld cores of their "
                       "machine; start mpirun with --map-by ppr:1:node --bind-to none, or use "
                       "--threads %ld",
                       c->ranks, c->threads, many, c->machine, share);
}
