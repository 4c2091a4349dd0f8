// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/model_filter.h"

#include <stdlib.h>
#include <string.h>

#include "cli/progress.h"

// Clears the flags of the floaters among the primitives that are kept so far.
static bool drop_floaters(const sgs_floater_options *options, const sgs_gaussians *model,
                          unsigned char *keep)
{
    sgs_gaussians *kept = NULL;
    unsigned char *connected = malloc(model->count + 1);
    bool done =
        connected && !sgs_gaussians_create(model->count, &kept) && !sgs_gaussians_copy(kept, model);
    if (!done)
        fail_run("not enough memory to filter %zu primitives", model->count);
    if (done) {
        sgs_selection_apply(kept, keep);
        memset(connected, 1, kept->count);
        done = !sgs_select_connected(kept, options, connected);
        if (!done)
            fail_library();
    }
    for (size_t i = 0, k = 0; done && i < model->count; ++i)
        if (keep[i])
            keep[i] = connected[k++];
    free(connected);
    sgs_gaussians_destroy(kept);
    return done;
}

bool model_filter_select(const model_filter *filter, const sgs_gaussians *model,
                         unsigned char *keep)
{
    memset(keep, 1, model->count);
    if (filter->box)
        sgs_select_box(model, filter->box, filter->box + 3, keep);
    if (filter->sphere)
        sgs_select_sphere(model, filter->sphere, filter->sphere[3], keep);
    for (int k = 0; k < filter->condition_count; ++k) {
        const model_condition *c = &filter->conditions[k];
        if (sgs_select_value(model, c->name, c->comparison, c->value, keep)) {
            fail_library();
            return false;
        }
    }
    if (filter->opacity > 0)
        sgs_select_value(model, "opacity", SGS_GREATER_EQUAL, filter->opacity, keep);
    for (size_t i = 0; filter->region && i < model->count; ++i)
        keep[i] = keep[i] &&
                  (filter->only_region < 0 || filter->region[i] == filter->only_region) &&
                  (double)filter->slack[i] >= filter->slack_low;
    return !filter->floaters || drop_floaters(filter->floaters, model, keep);
}
