// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Advice on the cores of ranks: for every way of binding them, on one machine and on several.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "processes/rank_cores.h"

// The advice has this text; NULL: there is none.
static void advises(rank_cores cores, const char *text)
{
    char *advice = rank_cores_advice(&cores);
    if (!text != !advice || (text && !strstr(advice, text)))
        fail_msg("%d of %ld cores, %d ranks with %d threads: '%s', not '%s'", cores.own,
                 cores.machine, cores.ranks, cores.threads, advice ? advice : "(none)",
                 text ? text : "(none)");
    free(advice);
}

static void a_rank_per_machine_with_all_cores_is_well_placed(void **state)
{
    (void)state;
    advises((rank_cores){.own = 64, .machine = 64, .ranks = 1, .threads = 64}, NULL);
    advises((rank_cores){.own = 64, .machine = 64, .ranks = 1, .threads = 128}, NULL); // by choice
    advises((rank_cores){.own = 1, .machine = 1, .ranks = 1, .threads = 1}, NULL);
    // Bound to sockets or cores that nobody shares.
    advises((rank_cores){.own = 32, .machine = 64, .ranks = 2, .threads = 32}, NULL);
    advises((rank_cores){.own = 1, .machine = 64, .ranks = 64, .threads = 1}, NULL);
    advises((rank_cores){.own = 1, .machine = 64, .ranks = 33, .threads = 1}, NULL);
}

static void bound_ranks_with_more_threads_than_cores_are_reported(void **state)
{
    (void)state;
    advises((rank_cores){.own = 32, .machine = 64, .ranks = 2, .threads = 64},
            "each rank may use 32 of 64 cores and has 64 threads; start mpirun with --map-by "
            "ppr:1:node --bind-to none");
}

// The number of ranks is that of the machine, whatever runs on others.
static void idle_cores_are_reported(void **state)
{
    (void)state;
    advises((rank_cores){.own = 1, .machine = 64, .ranks = 1, .threads = 1},
            "each rank may use 1 of 64 cores and has 1 thread; start mpirun");
    advises((rank_cores){.own = 1, .machine = 64, .ranks = 32, .threads = 1}, "each rank may use");
}

static void unbound_ranks_that_share_cores_are_reported(void **state)
{
    (void)state;
    advises((rank_cores){.own = 64, .machine = 64, .ranks = 4, .threads = 64},
            "4 ranks with 64 threads each oversubscribe the 64 cores of their machine; start "
            "mpirun with --map-by ppr:1:node --bind-to none, or use --threads 16");
    advises((rank_cores){.own = 64, .machine = 64, .ranks = 4, .threads = 16}, NULL);
    advises((rank_cores){.own = 64, .machine = 64, .ranks = 4, .threads = 17}, "--threads 16");
    // Two ranks on each of two sockets.
    advises((rank_cores){.own = 32, .machine = 64, .ranks = 4, .threads = 32}, "oversubscribe");
    advises((rank_cores){.own = 2, .machine = 2, .ranks = 3, .threads = 1},
            "3 ranks oversubscribe the 2 cores of their machine; start fewer");
    advises((rank_cores){.own = 1, .machine = 1, .ranks = 2, .threads = 1},
            "2 ranks oversubscribe the 1 core of their machine; start fewer");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_rank_per_machine_with_all_cores_is_well_placed),
        cmocka_unit_test(bound_ranks_with_more_threads_than_cores_are_reported),
        cmocka_unit_test(idle_cores_are_reported),
        cmocka_unit_test(unbound_ranks_that_share_cores_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
