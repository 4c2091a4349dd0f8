// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One value of Adam (Kingma and Ba 2015), for methods that train outside of the trainer.

#include <math.h>

typedef struct sgsi_adam_step {
    double correction1, correction2; // 1 / (1 - beta^t)
} sgsi_adam_step;

// The corrections of step t >= 1.
static inline sgsi_adam_step sgsi_adam_begin(int t)
{
    return (sgsi_adam_step){1 / (1 - pow(0.9, t)), 1 / (1 - pow(0.999, t))};
}

// A gradient that is not finite changes nothing.
static inline void sgsi_adam_update(const sgsi_adam_step *step, double gradient, double rate,
                                    float *value, float *m, float *v)
{
    if (!isfinite(gradient))
        return;
    *m = (float)(0.9 * (double)*m + 0.1 * gradient);
    *v = (float)(0.999 * (double)*v + 0.001 * gradient * gradient);
    *value -= (float)(rate * (double)*m * step->correction1 /
                      (sqrt((double)*v * step->correction2) + 1e-15));
}
