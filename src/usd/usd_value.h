// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The numbers of an attribute: its value and its time samples, as OpenUSD resolves them for a time
// code. Samples precede the value. Between two samples the numbers change linearly, and quaternions
// by slerp; before the first and after the last one they stay. A sample without a value ("None")
// blocks: there is no number until the next one, and the one before it stays until then.

#include "usd/usd_text.h"

typedef struct sgsi_usd_sample {
    double time;
    size_t first; // of its numbers in `numbers`
    int count;    // of its numbers; 0: blocked
} sgsi_usd_sample;

typedef struct sgsi_usd_value {
    double fixed[SGSI_USD_NUMBERS];
    int count;       // of `fixed`; 0: invalid
    bool given;      // has a value
    bool has_spline; // which is not evaluated
    bool has_samples;
    bool is_invalid;          // some sample is
    sgsi_usd_sample *samples; // [sample_count], by increasing time, or NULL if they are not kept
    size_t sample_count;
    double *numbers; // of all samples
} sgsi_usd_value;

// Reads what follows "NAME SUFFIX =". suffix: "", ".timeSamples", ".spline"; others have no effect.
// keeps: samples are stored; else only has_samples is set. False without memory.
bool sgsi_usd_value_set(sgsi_usd_value *value, const char *suffix, sgsi_usd_text text, bool keeps);
void sgsi_usd_value_free(sgsi_usd_value *value);

typedef enum sgsi_usd_blend { SGSI_USD_LINEAR, SGSI_USD_SLERP } sgsi_usd_blend;

// The numbers at a time code, with SLERP of quaternions w x y z. Returns how many: 0 without a
// value, -1 if the text of the value is invalid. *between: they are between those of two samples.
int sgsi_usd_value_at(const sgsi_usd_value *value, double time, sgsi_usd_blend blend,
                      double numbers[SGSI_USD_NUMBERS], bool *between);
