// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "density/run_length.h"

#include <math.h>

#include "sparegs/trainer.h"

double sgsi_run_shortness(const sgs_train_options *options)
{
    if (options->schedule != SGS_SCHEDULE_SCALED)
        return 0.0;
    const double beyond = log((double)options->iterations / SGSI_SHORT_LENGTH) /
                          log((double)SGSI_PAPER_LENGTH / SGSI_SHORT_LENGTH);
    return 1.0 - fmin(fmax(beyond, 0.0), 1.0);
}
