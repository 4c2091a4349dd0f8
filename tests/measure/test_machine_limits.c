// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loops that measure the machine peaks compute what they count, in every lane. (Of equal
// registers the compiler computes one, and the measured peak would be too high;
// test_peak_loops.sh counts the instructions.)

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "measure/limit_kernels.h"
#include "sparegs/runtime.h"

enum { CHAINS = SGSI_LIMIT_CHAINS, ROUNDS = 1000 };

static void every_lane_of_every_chain_is_computed(void **state)
{
    (void)state;
    const sgs_isa best = sgs_isa_get();
    const float factor = 0.999f, term = 0.25f;
    _Alignas(64) float start[CHAINS][16], out[16];
    double expected[16] = {0};
    for (int chain = 0; chain < CHAINS; ++chain)
        for (int lane = 0; lane < 16; ++lane) {
            start[chain][lane] = (float)(chain + 1) * (1.0f + 4.0f * (float)lane);
            double x = start[chain][lane];
            for (int i = 0; i < ROUNDS; ++i)
                x = x * (double)factor + (double)term;
            expected[lane] += x;
        }
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        sgsi_limit_kernels_get()->multiply_add(ROUNDS, start[0], factor, term, out);
        for (int lane = 0; lane < 16; ++lane) {
            if (!(fabs(out[lane] - expected[lane]) <= 1e-5 * expected[lane]))
                fail_msg("%s: lane %d has %.9g, expected %.9g", sgs_isa_name((sgs_isa)isa), lane,
                         (double)out[lane], expected[lane]);
            assert_true(!lane || out[lane] > out[lane - 1]);
        }
    }
    sgs_isa_set(best);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_lane_of_every_chain_is_computed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
