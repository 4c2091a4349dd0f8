// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One descriptor per field of sgs_train_options: name, type, default, range, help, the pipelines
// that read it, and what may change when a run is resumed. Defaults, range checks, checkpoints and
// the command line all derive from this table; other programs can build their own interface from
// it.
//
// options NULL = the defaults.
//
// Threads: all functions may be called from any thread at any time.

#include <stddef.h>

#include "sparegs/trainer.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_option_type {
    SGS_OPTION_BOOL = 0, // bool
    SGS_OPTION_INT,      // int
    SGS_OPTION_SIZE,     // size_t
    SGS_OPTION_UINT64,   // uint64_t
    SGS_OPTION_DOUBLE,   // double
    SGS_OPTION_CHOICE,   // an enumeration: index into the words of `values`, "a|b|c"
    SGS_OPTION_SET,      // unsigned: bit k for word k of `values`, "a,b,c"
    SGS_OPTION_COLOR,    // float[3], and a bool at random_offset that replaces it
    SGS_OPTION_MODEL,    // const sgs_gaussians *, or NULL
    SGS_OPTION_BOX       // sgs_box; infinite by default
} sgs_option_type;

// Whether an option may differ when a run is resumed from a checkpoint.
typedef enum sgs_resume_rule {
    SGS_RESUME_FIXED = 0,  // no
    SGS_RESUME_FREE,       // yes, with a warning; the new value is used from then on
    SGS_RESUME_FREE_PAPER, // as FREE under SGS_SCHEDULE_PAPER, else as FIXED
    SGS_RESUME_START,      // used for the first model only, which the checkpoint replaces
    SGS_RESUME_FREE_WHOLE  // as FREE without a region, whose target images depend on it, else as
                           // FIXED
} sgs_resume_rule;

typedef struct sgs_train_option {
    const char *name; // of the field; unique, lower case with '_'
    sgs_option_type type;
    size_t offset, size;  // bytes of the field in sgs_train_options
    size_t random_offset; // COLOR: of the bool; 0 for other types
    double initial;       // default; an index for CHOICE, bits for SET, each channel of COLOR
    double low, high;     // range, both ends included, of INT, SIZE, DOUBLE, COLOR; low 1 of a SET:
                          // it may not be empty
    const char *values;   // words of CHOICE and SET; else a placeholder for help texts, or NULL
    const char *initial_text; // the default in words where `initial` needs explaining, or NULL
    const char *unit;         // or NULL
    const char *help;
    const char *group;  // heading for help texts
    unsigned pipelines; // bit k: pipeline k of sgs_pipeline reads it
    unsigned spare;     // SGS_SPARE_ bits: read only if one of these parts is on; 0 = always
    sgs_resume_rule resume;
} sgs_train_option;

// The table, [*count] in the order of help texts; static. Cannot fail. Each field of
// sgs_train_options except struct_size has a row; background_random is part of the row of
// background.
SGS_API const sgs_train_option *sgs_train_option_descriptors(size_t *count);

// The row of a name, or NULL.
SGS_API const sgs_train_option *sgs_train_option_find(const char *name);

// True unless only parts of SPARE-GS read the option and `options` has them all off. Cannot fail.
SGS_API bool sgs_train_option_is_read(const sgs_train_option *option,
                                      const sgs_train_options *options);

// True if the option may differ from its earlier value in a run that continues with `options`: its
// resume rule allows it, or it is not read. Cannot fail.
SGS_API bool sgs_train_option_may_change(const sgs_train_option *option,
                                         const sgs_train_options *options);

// Writes the value that `options` has as text, at most `bytes` with the terminator: "30000", "mip",
// "bmd,rap" ("off" for an empty set), "true", "0.05" (the shortest decimal that reads back to the
// same double; a point in any locale), "0,0.5,1" or "random", "model" or "none", the bounds of a
// box "x0,y0,z0,x1,y1,z1" with "-inf" and "inf", or "none". Returns the length without truncation.
// Cannot fail.
SGS_API size_t sgs_train_option_text(const sgs_train_option *option,
                                     const sgs_train_options *options, char *text, size_t bytes);

// INVALID_ARGUMENT naming the first field that is out of range, or fields that exclude each other.
// sgs_trainer_create calls it.
SGS_API sgs_status sgs_train_options_check(const sgs_train_options *options);

#ifdef __cplusplus
}
#endif
