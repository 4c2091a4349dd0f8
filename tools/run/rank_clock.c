// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/rank_clock.h"

#include <math.h>
#include <stdio.h>

#include "sparegs/runtime.h"

static void read_totals(sgs_ranks_seconds totals[SGS_RANKS_PURPOSE_COUNT])
{
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k)
        totals[k] = sgs_ranks_seconds_get(group_ranks(), (sgs_ranks_purpose)k);
}

void rank_clock_start(rank_clock *clock)
{
    read_totals(clock->before);
}

void rank_clock_stop(rank_clock *clock, double seconds, bool warm)
{
    sgs_ranks_seconds now[SGS_RANKS_PURPOSE_COUNT];
    read_totals(now);
    clock->warm_seconds += warm ? seconds : 0;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k) {
        const double waiting = now[k].waiting - clock->before[k].waiting,
                     moving = now[k].moving - clock->before[k].moving;
        clock->spent[k].waiting += waiting;
        clock->spent[k].moving += moving;
        clock->warm_waiting += warm ? waiting : 0;
        clock->warm_moving += warm ? moving : 0;
    }
}

static json_t *share_of(double part, double whole)
{
    return whole > 0 ? json_real(part / whole) : json_null();
}

json_t *rank_clock_json(const rank_clock *clock, double train_seconds)
{
    if (!group_ranks())
        return NULL;
    json_t *waiting = json_object(), *moving = json_object();
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k) {
        const char *name = sgs_ranks_purpose_name((sgs_ranks_purpose)k);
        json_object_set_new(waiting, name, json_real(clock->spent[k].waiting));
        json_object_set_new(moving, name, json_real(clock->spent[k].moving));
    }
    json_t *own = json_object();
    json_object_set_new(own, "train_seconds", json_real(train_seconds));
    json_object_set_new(own, "waiting", waiting);
    json_object_set_new(own, "moving", moving);
    json_object_set_new(own, "waiting_share", share_of(clock->warm_waiting, clock->warm_seconds));
    json_object_set_new(own, "moving_share", share_of(clock->warm_moving, clock->warm_seconds));
    json_object_set_new(own, "peak_rss_bytes", json_integer((json_int_t)sgs_rss_peak()));
    return group_gather_json(own);
}

// The smallest and the largest number under `key`; NaN without any.
static void range_of(const json_t *clocks, const char *key, double range[2])
{
    range[0] = range[1] = NAN;
    for (size_t r = 0; r < json_array_size(clocks); ++r) {
        const json_t *value = json_object_get(json_array_get(clocks, r), key);
        if (!json_is_number(value))
            continue;
        range[0] = fmin(range[0], json_number_value(value));
        range[1] = fmax(range[1], json_number_value(value));
    }
}

void rank_clock_print(const json_t *clocks)
{
    double waiting[2], moving[2], peak[2];
    if (!clocks)
        return;
    range_of(clocks, "waiting_share", waiting);
    range_of(clocks, "moving_share", moving);
    range_of(clocks, "peak_rss_bytes", peak);
    printf("%zu ranks: ", json_array_size(clocks));
    if (!isnan(waiting[1]))
        printf("waiting %.1f to %.1f %% and sending %.1f to %.1f %% of an iteration after the "
               "first epoch, ",
               100 * waiting[0], 100 * waiting[1], 100 * moving[0], 100 * moving[1]);
    printf("up to %.0f MB of memory\n", peak[1] / 1e6);
}
