// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "usd/usd_value.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"

enum { FIRST_SAMPLES = 8 };

void sgsi_usd_value_free(sgsi_usd_value *value)
{
    sgsi_free(value->samples);
    sgsi_free(value->numbers);
    value->samples = NULL;
    value->numbers = NULL;
    value->sample_count = 0;
}

// ---- Reading ----

typedef struct sample_list {
    sgsi_usd_sample *samples;
    double *numbers;
    size_t count, capacity, number_count, number_capacity;
} sample_list;

static bool reserve(void **block, size_t count, size_t *capacity, size_t more, size_t size)
{
    if (count + more <= *capacity)
        return true;
    const size_t wanted = 2 * *capacity + FIRST_SAMPLES + more;
    if (!sgsi_grow(block, count, wanted, size))
        return false;
    *capacity = wanted;
    return true;
}

static bool add_sample(sample_list *list, double time, const double *numbers, int count)
{
    if (!reserve((void **)&list->samples, list->count, &list->capacity, 1, sizeof *list->samples) ||
        !reserve((void **)&list->numbers, list->number_count, &list->number_capacity, (size_t)count,
                 sizeof *list->numbers))
        return false;
    list->samples[list->count++] =
        (sgsi_usd_sample){.time = time, .first = list->number_count, .count = count};
    for (int k = 0; k < count; ++k)
        list->numbers[list->number_count++] = numbers[k];
    return true;
}

// By time; of one time, in the order of the text, in which the end of the numbers does not
// decrease.
static int compare_samples(const void *a, const void *b)
{
    const sgsi_usd_sample *x = a, *y = b;
    if (x->time != y->time)
        return x->time < y->time ? -1 : 1;
    if (x->first != y->first)
        return x->first < y->first ? -1 : 1;
    return x->count - y->count; // a blocked one precedes another with the same first number
}

// Of samples with one time, the last one counts.
static size_t sort_samples(sgsi_usd_sample *samples, size_t count)
{
    size_t kept = 0;
    bool sorted = true;
    for (size_t i = 1; i < count && sorted; ++i)
        sorted = samples[i - 1].time < samples[i].time;
    if (sorted)
        return count;
    qsort(samples, count, sizeof *samples, compare_samples);
    for (size_t i = 0; i < count; ++i)
        if (i + 1 == count || samples[i].time != samples[i + 1].time)
            samples[kept++] = samples[i];
    return kept;
}

// In names, ':' is a letter of the word; "1:50" is not one.
static bool accept_colon(sgsi_usd_text *text)
{
    sgsi_usd_skip_space(text);
    if (text->at >= text->end || *text->at != ':')
        return false;
    ++text->at;
    return true;
}

// "{ TIME: NUMBERS, TIME: None, ... }". *valid: it is.
static bool read_samples(sgsi_usd_text *text, sample_list *list, bool *valid)
{
    *valid = sgsi_usd_accept(text, "{");
    while (*valid && !sgsi_usd_accept(text, "}")) {
        double time, numbers[SGSI_USD_NUMBERS];
        int count = 0;
        if (sgsi_usd_accept(text, ","))
            continue;
        *valid = sgsi_usd_number(text, &time) && isfinite(time) && accept_colon(text);
        if (*valid && !sgsi_usd_accept(text, "None"))
            *valid = (count = sgsi_usd_numbers(text, numbers)) > 0;
        if (*valid && !add_sample(list, time, numbers, count))
            return false;
    }
    return true;
}

bool sgsi_usd_value_set(sgsi_usd_value *value, const char *suffix, sgsi_usd_text text, bool keeps)
{
    if (!strcmp(suffix, ".spline")) {
        value->has_spline = true;
    } else if (!strcmp(suffix, ".timeSamples")) {
        value->has_samples = true;
        if (!keeps)
            return true;
        sample_list list = {0};
        bool valid;
        const bool done = read_samples(&text, &list, &valid);
        sgsi_usd_value_free(value);
        value->is_invalid = !valid;
        value->samples = list.samples;
        value->numbers = list.numbers;
        value->sample_count = sort_samples(list.samples, list.count);
        return done;
    } else if (!*suffix && !sgsi_usd_accept(&text, "None")) { // a connection has no value
        value->given = true;
        value->count = sgsi_usd_numbers(&text, value->fixed);
    }
    return true;
}

// ---- Evaluation ----

static bool normalize(const double from[4], double to[4])
{
    const double norm =
        sqrt(from[0] * from[0] + from[1] * from[1] + from[2] * from[2] + from[3] * from[3]);
    for (int k = 0; k < 4; ++k)
        to[k] = from[k] / norm;
    return norm > 0.0;
}

// Shoemake 1985, along the shorter of the two arcs.
static void slerp(const double from[4], const double to[4], double share, double out[4])
{
    double a[4], b[4];
    memcpy(out, from, 4 * sizeof *out);
    if (!normalize(from, a) || !normalize(to, b))
        return;
    const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3],
                 angle = acos(fmin(fabs(dot), 1.0)), sine = sin(angle);
    double left = 1.0 - share, right = share;
    if (sine > 1e-6) { // else both are nearly equal
        left = sin(left * angle) / sine;
        right = sin(right * angle) / sine;
    }
    for (int k = 0; k < 4; ++k)
        out[k] = left * a[k] + (dot < 0.0 ? -right : right) * b[k];
}

// Index of the last sample at or before `time`, or 0.
static size_t find_sample(const sgsi_usd_value *value, double time)
{
    size_t low = 0, high = value->sample_count;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (value->samples[middle].time <= time)
            low = middle;
        else
            high = middle;
    }
    return low;
}

int sgsi_usd_value_at(const sgsi_usd_value *value, double time, sgsi_usd_blend blend,
                      double numbers[SGSI_USD_NUMBERS], bool *between)
{
    *between = false;
    if (value->is_invalid)
        return -1;
    if (!value->sample_count) {
        memcpy(numbers, value->fixed, sizeof value->fixed);
        return !value->given ? 0 : value->count ? value->count : -1;
    }
    const size_t k = find_sample(value, time);
    const sgsi_usd_sample *low = &value->samples[k];
    if (!low->count)
        return 0;
    const double *from = value->numbers + low->first;
    memcpy(numbers, from, (size_t)low->count * sizeof *numbers);
    if (!(time > low->time) || k + 1 == value->sample_count || low->count != low[1].count)
        return low->count;
    const double *to = value->numbers + low[1].first;
    const double share = (time - low->time) / (low[1].time - low->time);
    *between = true;
    if (blend == SGSI_USD_SLERP && low->count == 4)
        slerp(from, to, share, numbers);
    else
        for (int i = 0; i < low->count; ++i)
            numbers[i] = (1.0 - share) * from[i] + share * to[i];
    return low->count;
}
