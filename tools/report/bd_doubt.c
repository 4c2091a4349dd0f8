// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/bd_doubt.h"

#include <math.h>
#include <stdbool.h>

#include "cli/output.h"

static const double LEAST_COMMON_DB = 0.02; // published values are rounded to 0.01 dB

char *bd_doubt(const sgs_bd *bd, int k)
{
    const bool is_narrow = !isnan(bd->rate_percent) && bd->common_psnr_db < LEAST_COMMON_DB;
    if (bd->ties && !k--)
        return format_text("equal PSNRs or sizes within a curve were moved apart by 1e-9 (%zu "
                           "point%s); the result depends on their rounding",
                           bd->ties, bd->ties == 1 ? "" : "s");
    if (is_narrow && !k--)
        return format_text("the PSNR ranges of the curves overlap by %.2g dB only; BD-rate depends "
                           "on the rounding of the points",
                           bd->common_psnr_db);
    return NULL;
}
